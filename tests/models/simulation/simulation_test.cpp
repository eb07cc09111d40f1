// models/simulation/simulation.h and io/rig/simulation_file.h: what a simulated robot logs, and the
// files of a simulation.
//
// Proves: with all sigmas 0 every residual at the truth is 0, for every type of sensor and lens,
// free and mounted targets, mimic, prismatic and scanning joints, offsets, scales and everything
// else off the rig; with noise, residuals at the truth (true readings, true targets) and errors of
// readings are standard normal after whitening, per sensor; the same seed gives the same bytes;
// only what is wholly seen is kept; the example keeps all its postures and views; files are read
// strictly and read back as written. Does not prove: that estimates are right (tests of the
// calibration), nor that a posture is free of collisions (nothing looks).
#include "../../../models/simulation/simulation.h"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <set>

#include "../../../io/document/json.h"
#include "../../../io/rig/rig_file.h"
#include "../../../io/rig/samples_file.h"
#include "../../../io/rig/simulation_file.h"
#include "../../../models/calibration/calibration.h"
#include "../../../models/estimation/estimation.h"
#include "../../../models/rig/configuration.h"
#include "../../../models/rig/numbers.h"
#include "../../../models/rig/selection.h"
#include "../../../models/rig/targets.h"
#include "../../../models/sensors/sensors.h"
#include "../../../models/sensors/tilting_laser.h"
#include "../../fixtures/open_recording.h"

namespace simulation_test {

using namespace kincal;
using Catch::Matchers::Contains;
using fixture::OpenRecording;
namespace fs = std::filesystem;

namespace {

const double kNaN = std::numeric_limits<double>::quiet_NaN();

Joint& add_joint(Tree& tree, JointType type, const std::string& parent, const std::string& child,
                 const Vector3d& axis, const Vector3d& xyz, const Vector3d& rpy, double limit) {
  Joint joint;
  joint.name = child + "_joint";
  joint.type = type;
  joint.parent = tree.find_link(parent);
  joint.child = static_cast<int>(tree.links.size());
  tree.links.push_back(child);
  joint.axis = axis.normalized();
  joint.parent_T_joint = {rotation_from_rpy(rpy), xyz};
  joint.lower = -limit;
  joint.upper = limit;
  tree.joints.push_back(joint);
  return tree.joints.back();
}

Target board(const std::string& name, int rows, int columns, double square, int link,
             const Pose& pose = {}) {
  Target t;
  t.name = name;
  t.type = "chessboard";
  t.square = square;
  t.layout.resize(3, rows * columns);
  for (int i = 0; i < rows * columns; ++i) t.layout.col(i) << i % columns, i / columns, 0;
  t.link = link;
  t.link_T_target = pose;
  return t;
}

Sensor sensor(const Rig& rig, const std::string& name, const std::string& type,
              const std::string& link, const Pose& pose, std::shared_ptr<const SensorModel> model,
              std::vector<double> sigma) {
  Sensor s;
  s.name = name;
  s.type = type;
  s.link = rig.tree.find_link(link);
  s.link_T_sensor = pose;
  s.model = std::move(model);
  s.sigma = std::move(sigma);
  return s;
}

Sensor camera(const Rig& rig, const std::string& name, const std::string& link, const Pose& pose,
              Lens lens, double f, const std::vector<double>& distortion, double baseline) {
  Sensor s = sensor(rig, name, "camera", link, pose,
                    make_camera(lens, static_cast<int>(distortion.size())), {0.2, 0.2});
  s.parameters = camera_parameters(lens, {f, f + 3, 320, 240}, distortion, baseline);
  s.image_width = 640;
  s.image_height = 480;
  return s;
}

/// A robot with an arm, a head, a laser that tilts, one that is lifted, one whose scanning joint
/// lies between it and the base from below, and every sensor there is.
Rig make_rig() {
  Rig rig;
  Tree& tree = rig.tree;
  tree.links = {"stand"};
  add_joint(tree, JointType::revolute, "stand", "base", {0, 1, 0.1}, {0, 0, 0.1}, {0.1, 0, 0},
            0.6);  // turns the stand's laser
  add_joint(tree, JointType::revolute, "base", "shoulder", {0, 0, -1}, {0.2, 0, 0.3}, {0, 0.1, 0},
            0.8);
  add_joint(tree, JointType::revolute, "shoulder", "elbow", {0, 1, 0.2}, {0.3, 0, 0}, {0, 0, 0.1},
            0.8);
  add_joint(tree, JointType::prismatic, "elbow", "slide", {1, 0, 0}, {0.1, 0, 0}, {0, 0, 0}, 0);
  add_joint(tree, JointType::continuous, "slide", "wrist", {1, 0.1, 0}, {0.2, 0, 0}, {0, 0, 0}, 0);
  add_joint(tree, JointType::revolute, "wrist", "finger", {0, 1, 0}, {0.05, 0, 0}, {0, 0, 0}, 1)
      .mimic = Mimic{2, -0.3, 0.05};
  add_joint(tree, JointType::revolute, "base", "pan", {0, 0, 1}, {0, 0, 0.6}, {0, 0, 0}, 0.7);
  add_joint(tree, JointType::revolute, "pan", "head", {0, 1, 0}, {0.05, 0, 0.1}, {0, 0, 0}, 0.6);
  add_joint(tree, JointType::revolute, "base", "tilt", {0, 1, 0}, {0, 0, 0.4}, {0, 0, 0}, 1.2);
  add_joint(tree, JointType::prismatic, "base", "lift", {0.1, 0, 1}, {0, 0.2, 0.2}, {0, 0, 0}, 1);
  finish_tree(tree);
  rig.base = tree.find_link("base");
  rig.joints.resize(tree.joints.size());
  for (JointSettings& joint : rig.joints) joint.sigma = 0.001;

  const Matrix3d optical = rotation_from_rpy({-kPi / 2, 0, -kPi / 2});  // z ahead, x right, y down
  const Pose out{optical, {0.08, -0.06, -0.04}};  // a board that shows its back to the robot's head
  rig.targets = {board("held", 4, 5, 0.03, -1),
                 board("wall", 5, 6, 0.12, rig.base, {optical, {1.8, 0.3, 0.6}}),
                 board("palm", 3, 4, 0.02, tree.find_link("finger"), out), Target()};
  rig.targets[3].name = "reflectors";
  rig.targets[3].type = "points";
  rig.targets[3].grid = false;
  rig.targets[3].points.resize(3, 4);
  rig.targets[3].points << 0, 0.1, 0, 0, 0, 0, 0.2, 0, 0, 0, 0, 0.3;
  rig.targets[3].link = tree.find_link("wrist");

  const Pose eye{optical, {0.1, 0.02, 0}};
  rig.sensors = {
      sensor(rig, "arm", "chain", "wrist", out, make_chain(),
             {0.001, 0.002, 0.003, 0.004, 0.005, 0.006}),
      camera(rig, "pinhole", "head", eye, Lens::pinhole, 400, {}, 0),
      camera(rig, "right", "head", eye, Lens::pinhole, 400, {}, 0.07),
      camera(rig, "brown", "head", eye, Lens::brown_conrady, 350, {-0.3, 0.1, 0.001, -0.002, 0}, 0),
      camera(rig, "rational", "head", eye, Lens::brown_conrady, 350,
             {0.2, 0.1, 0.001, -0.002, 0.01, 0.3, 0.05, 0.01}, 0),
      camera(rig, "fisheye", "head", eye, Lens::kannala_brandt, 250, {0.02, -0.01, 0.003, -0.0005},
             0),
      sensor(rig, "tracker", "point", "base", {rotation_from_rpy({0.1, 0.2, 3}), {2, 0, 0}},
             make_point(), {0.001, 0.002, 0.003}),
      sensor(rig, "mocap", "pose", "pan", {}, make_pose(),
             {0.001, 0.002, 0.003, 0.006, 0.005, 0.004}),
      sensor(rig, "tilting", "tilting_laser", "tilt", {Matrix3d::Identity(), {0.03, 0, 0.02}},
             make_tilting_laser(), {5e-4, 6e-4, 0.005}),
      sensor(rig, "lifted", "tilting_laser", "lift", {rotation_from_rpy({0.1, 0.1, 0}), {0, 0, 0}},
             make_tilting_laser(), {0.002, 6e-4, 0.005}),
      sensor(rig, "standing", "tilting_laser", "stand",
             {rotation_from_rpy({0, -0.2, 0}), {0, 0, 0.7}}, make_tilting_laser(),
             {5e-4, 6e-4, 0.005})};
  rig.sensors[8].scanning_joint = tree.find_joint("tilt_joint");
  rig.sensors[9].scanning_joint = tree.find_joint("lift_joint");
  rig.sensors[10].scanning_joint = tree.find_joint("base_joint");
  return rig;
}

const std::vector<Spread> kSpread = {
    {"joint/*/offset", 0.02},         {"joint/*/scale", 0.02},    {"joint/*/origin", 0.01},
    {"sensor/*/pose", 0.01},          {"sensor/*/intrinsics", 3}, {"sensor/*/distortion", 0.0005},
    {"sensor/right/baseline", 0.002}, {"target/*/pose", 0.01},    {"target/*/square", 0.0003},
    {"target/*/points", 0.002}};

SimulationOptions options_of(std::uint64_t seed, int samples) {
  SimulationOptions options;
  options.seed = seed;
  options.samples = samples;
  return options;
}

/// Residuals at the truth and the targets' true poses, of `recording`, whose samples become the
/// simulation's; `readings`: with the true readings in place of the logged ones.
std::vector<ViewResiduals> residuals_at_truth(OpenRecording& recording,
                                              const Simulation& simulation, bool readings) {
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  setup.sensors = indices(recording.rig.sensors.size());
  recording.samples = simulation.samples;
  for (size_t i = 0; readings && i < recording.samples.size(); ++i)
    recording.samples[i].readings = simulation.true_readings[i];
  Values values;
  values.shared = simulation.truth;
  values.targets = simulation.targets;
  Estimation estimation(recording, indices(recording.samples.size()), setup);
  const VectorXd state = estimation.pack(values);
  estimation.renew(state);
  return estimation.residuals(state);  // their views are the recording's
}

Rig without_noise(Rig rig) {
  for (JointSettings& joint : rig.joints) joint.sigma = 0;
  for (Sensor& s : rig.sensors) std::fill(s.sigma.begin(), s.sigma.end(), 0.0);
  return rig;
}

/// A directory that is gone at the end.
struct Scratch {
  fs::path path = fs::temp_directory_path() / ("kincal_simulation_" + std::to_string(getpid()));
  Scratch() { fs::create_directories(path); }
  ~Scratch() { fs::remove_all(path); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(path / name, std::ios::binary) << text;
    return (path / name).string();
  }
};

const std::string kExample = KINCAL_SOURCE_DIR "/examples/pr2/";

std::string message_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const std::exception& e) {
    return e.what();
  }
  return "nothing thrown";
}

/// Sum of squares against its number: 4 sigmas of chi-square, and the mean against 0 (given the
/// sum).
void check_standard(const std::string& what, double squares, double sum, double count) {
  INFO(what << ": " << squares / count << " a number, mean " << sum / count << ", of " << count);
  CHECK(std::abs(squares - count) < 4 * std::sqrt(2 * count));
  CHECK(std::abs(sum) < 4 * std::sqrt(count));
}

}  // namespace

TEST_CASE("without noise every residual at the truth is 0", "[simulation]") {
  OpenRecording recording(without_noise(make_rig()));
  const Rig& rig = recording.rig;
  const VectorXd truth = draw_truth(recording.table, kSpread, 5);
  SimulationOptions options = options_of(3, 80);
  for (int s = 0; s < 11; ++s)  // all that can be, whatever is usual
    for (int t = 0; t < 4; ++t)
      if (s > 0 || t == 0) options.pairs.push_back({s, t});
  const Simulation simulation = simulate(rig, recording.table, truth, options);
  CHECK(simulation.samples.size() == 80);
  CHECK(simulation.idle.empty());
  std::set<std::pair<int, int>> seen;
  double worst = 0;
  for (const ViewResiduals& r : residuals_at_truth(recording, simulation, false)) {
    seen.insert({r.view->sensor, r.view->target});
    const double unit = rig.sensors[r.view->sensor].type == "camera" ? 1000 : 1;
    worst = std::max(worst, r.raw.cwiseAbs().maxCoeff() / unit);
    CHECK(r.raw.allFinite());
  }
  CHECK(worst < 1e-12);
  for (int s = 1; s < 11; ++s) {
    INFO(rig.sensors[s].name);
    CHECK(seen.count({s, 0}) + seen.count({s, 1}) + seen.count({s, 2}) + seen.count({s, 3}) >= 2);
    if (s < 8) CHECK(seen.count({s, 0}));
    CHECK(seen.count({s, 1}));
  }
  for (size_t i = 0; i < simulation.samples.size(); ++i)
    for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
      const double logged = simulation.samples[i].readings[j],
                   meant = simulation.true_readings[i][j];
      CHECK((logged == meant || (std::isnan(logged) && std::isnan(meant))));
    }
}

TEST_CASE("noise is what the rig says", "[simulation]") {
  OpenRecording recording(make_rig());
  const Rig& rig = recording.rig;
  const Simulation simulation =
      simulate(rig, recording.table, draw_truth(recording.table, kSpread, 5), options_of(11, 400));
  REQUIRE(simulation.samples.size() == 400);

  for (size_t j = 0; j < rig.joints.size(); ++j) {
    double squares = 0, sum = 0, count = 0;
    for (size_t i = 0; i < simulation.samples.size(); ++i) {
      const double e = (simulation.samples[i].readings[j] - simulation.true_readings[i][j]) /
                       rig.joints[j].sigma;
      if (std::isnan(e)) continue;
      squares += e * e, sum += e, ++count;
    }
    if (rig.tree.joints[j].mimic || j == 0 || j == 8 ||
        j == 9)  // scanning joints: each ray has its own
      CHECK(count == 0);
    else
      check_standard(rig.tree.joints[j].name, squares, sum, count);
  }

  const std::vector<ViewResiduals> residuals = residuals_at_truth(recording, simulation, true);
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const int rows = rig.sensors[s].model->rows();
    std::vector<double> squares(rows, 0), sum(rows, 0);
    double count = 0;
    for (const ViewResiduals& r : residuals) {
      if (r.view->sensor != static_cast<int>(s)) continue;
      for (Eigen::Index i = 0; i < r.whitened.size(); ++i)
        squares[i % rows] += r.whitened(i) * r.whitened(i), sum[i % rows] += r.whitened(i);
      count += static_cast<double>(r.whitened.size()) / rows;
    }
    REQUIRE(count > 50);
    for (int i = 0; i < rows; ++i)
      check_standard(rig.sensors[s].name + "[" + std::to_string(i) + "]", squares[i], sum[i],
                     count);
  }
}

TEST_CASE("errors of poses have exactly the formats' side and components, however large",
          "[simulation]") {
  Rig rig = make_rig();
  rig.sensors = {rig.sensors[0], rig.sensors[7]};  // nothing that could fail to see
  rig.targets = {rig.targets[0]};
  rig.sensors[0].sigma = {0.001, 0.3, 0.02, 0.7, 0.01, 0.1};
  rig.sensors[1].sigma = {0.02, 0.001, 0.3, 0.1, 0.01, 0.7};
  OpenRecording recording(rig);
  const ParameterTable& table = recording.table;
  const Simulation simulation =
      simulate(rig, table, draw_truth(table, {{"joint/*", 0.01}, {"sensor/*", 0.01}}, 5),
               options_of(11, 3000));
  double squares[12] = {}, sum[12] = {};
  for (const ViewResiduals& r : residuals_at_truth(recording, simulation, true))
    for (int i = 0; i < 6; ++i)
      squares[6 * r.view->sensor + i] += std::pow(r.whitened(i), 2),
          sum[6 * r.view->sensor + i] += r.whitened(i);
  for (int i = 0; i < 12; ++i) check_standard(std::to_string(i), squares[i], sum[i], 3000);
}

TEST_CASE("all views of a sample share the error of a reading", "[simulation]") {
  Rig rig = without_noise(make_rig());
  for (JointSettings& joint : rig.joints) joint.sigma = 0.01;
  OpenRecording recording(rig);
  const Simulation simulation =
      simulate(rig, recording.table, recording.table.initial, options_of(2, 20));
  double off = 0;
  for (const ViewResiduals& r : residuals_at_truth(recording, simulation, false))
    off = std::max(off, r.raw.cwiseAbs().maxCoeff());
  CHECK(off > 1);
  off = 0;
  for (const ViewResiduals& r : residuals_at_truth(recording, simulation, true))
    off = std::max(off, r.raw.cwiseAbs().maxCoeff());
  CHECK(off < 1e-9);
}

TEST_CASE("the same seed gives the same bytes, another seed others", "[simulation]") {
  const Rig rig = make_rig();
  const ParameterTable table(rig);
  const auto written = [&](std::uint64_t truth_seed, std::uint64_t seed) {
    const Simulation simulation =
        simulate(rig, table, draw_truth(table, kSpread, truth_seed), options_of(seed, 12));
    return samples_text(rig, simulation.samples) + truth_text(rig, table, simulation);
  };
  const std::string first = written(1, 1);
  CHECK(first == written(1, 1));
  CHECK(first != written(1, 2));
  CHECK(first != written(2, 1));

  // More samples begin with the same ones; a wider spread leaves the other parameters' draws alone.
  const VectorXd truth = draw_truth(table, kSpread, 1);
  const Simulation few = simulate(rig, table, truth, options_of(1, 5)),
                   many = simulate(rig, table, truth, options_of(1, 9));
  for (int i = 0; i < 5; ++i) {
    CHECK(few.samples[i].id == many.samples[i].id);
    REQUIRE(few.samples[i].views.size() == many.samples[i].views.size());
    for (size_t v = 0; v < few.samples[i].views.size(); ++v)
      CHECK(few.samples[i].views[v].z == many.samples[i].views[v].z);
  }
  const VectorXd less = draw_truth(table, {{"joint/elbow_joint/offset", 0.02}}, 1);
  const int elbow = table.all[table.joint_offset[2]].start;
  CHECK(less(elbow) == truth(elbow));
  CHECK(less(elbow) != 0);
  CHECK((less - table.initial).cwiseAbs().sum() == std::abs(less(elbow)));
}

TEST_CASE("drawn truths", "[simulation]") {
  const Rig rig = make_rig();
  const ParameterTable table(rig);
  double squares = 0, sum = 0, count = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    const VectorXd truth = draw_truth(
        table, {{"joint/*", 0.5}, {"joint/pan_joint/origin", 0.1}, {"joint/pan_joint/origin.z", 0}},
        seed);
    const int start = table.all[table.joint_origin[6]].start;
    const Vector6d xi =
        log_se3(inverse(get_pose(table.initial, start)) * get_pose(truth, start)) / 0.1;
    CHECK(std::abs(xi(2)) < 1e-12);
    squares += xi.squaredNorm(), sum += xi.sum(), count += 5;
    CHECK(truth.tail(20) == table.initial.tail(20));
  }
  check_standard("xi", squares, sum, count);
  CHECK_THROWS_AS(draw_truth(table, {{"joint/nobody/*", 0.1}}, 1), NameError);
  CHECK_THROWS_WITH(draw_truth(table, {{"joint/*", -1}}, 1), Contains("at least 0"));
  CHECK_THROWS_WITH(draw_truth(table, {{"target/held/square", 10}}, 8),
                    Contains("target/held/square") && Contains("greater than 0"));
}

TEST_CASE("rays hit the points again", "[simulation]") {
  const Rig rig = without_noise(make_rig());
  const ParameterTable table(rig);
  const Simulation simulation =
      simulate(rig, table, draw_truth(table, kSpread, 7), options_of(4, 60));
  int views[11] = {};
  for (size_t i = 0; i < simulation.samples.size(); ++i)
    for (const View& v : simulation.samples[i].views) {
      ++views[v.sensor];
      const Sensor& s = rig.sensors[v.sensor];
      if (s.type != "tilting_laser") continue;
      const Target& target = rig.targets[v.target];
      const Configuration robot(rig, table, simulation.truth, simulation.true_readings[i]);
      const Pose base_T_target = target.link < 0
                                     ? simulation.targets.at({static_cast<int>(i), v.target})
                                     : robot.base_T_target(v.target);
      const Eigen::Matrix3Xd points = target_points(rig, table, simulation.truth, v.target);
      const Joint& joint = rig.tree.joints[s.scanning_joint];
      for (size_t k = 0; k < v.ids.size(); ++k) {
        const double* z = v.z.data() + 3 * k;
        const Vector3d hit = robot.with(s.scanning_joint, z[0]).base_T_sensor(v.sensor) *
                             TiltingLaser::measured_point(z);
        CHECK((hit - base_T_target * Vector3d(points.col(v.ids[k]))).norm() < 1e-12);
        CHECK(z[0] >= joint.lower);
        CHECK(z[0] <= joint.upper);
        CHECK(std::abs(z[1]) <= 135 * kPi / 180);
        CHECK(z[2] > 0.1);
      }
    }
  for (int s = 8; s < 11; ++s) CHECK(views[s] > 5);
}

TEST_CASE("only what is wholly seen is kept", "[simulation]") {
  Rig rig = without_noise(make_rig());
  const ParameterTable table(rig);
  const std::vector<double> zero(rig.tree.joints.size(), 0.0);
  const Matrix3d optical = rotation_from_rpy({-kPi / 2, 0, -kPi / 2});
  const auto seen = [&](int sensor, const Pose& base_T_board, std::string* why = nullptr,
                        bool listed = true) {
    SimulationOptions options = options_of(1, 1);
    options.postures = {{"p", zero, {{sensor, 0}}, {{0, base_T_board}}}};
    if (!listed) options.postures[0].views.clear(), options.pairs = {{sensor, 0}};
    const Simulation s = simulate(rig, table, table.initial, options);
    CHECK(s.samples.size() + s.dropped.size() == (listed ? 1 : s.samples.size()));
    if (why) *why = s.dropped.empty() ? "" : s.dropped[0].why;
    return s.samples.size() == 1;
  };
  const Vector3d eye(0.15, 0.02, 0.7),
      middle(0, 0.06, 0.045);  // of the pinhole camera; from the board's middle to its origin
  std::string why;
  const auto at = [&](const Vector3d& p) { return Pose{optical, eye + p + middle}; };
  CHECK(seen(1, at({1, 0, 0})));
  CHECK(!seen(1, at({-1, 0, 0}), &why));
  CHECK(why == "a point is behind the camera");
  CHECK(!seen(1, at({1, 0.76, 0}),
              &why));  // half out of the image: 400 px of focal length, 320 to its edge
  CHECK(why == "a point is outside the image");
  for (const Vector3d& p :
       {Vector3d(1, 0.7, 0), Vector3d(1, -0.7, 0), Vector3d(1, 0, 0.53), Vector3d(1, 0, -0.53)})
    CHECK(seen(1, at(p)));
  for (const Vector3d& p :
       {Vector3d(1, 0.75, 0), Vector3d(1, -0.75, 0), Vector3d(1, 0, 0.56), Vector3d(1, 0, -0.56)})
    CHECK(!seen(1, at(p)));
  CHECK(seen(1, at({1, 0, 0}), nullptr, false));
  const Pose turned{optical * rotation_from_rpy({0, kPi, 0}), eye + Vector3d(1, -0.06, 0.045)};
  CHECK(seen(1, turned));
  CHECK(!seen(1, turned, nullptr, false));  // its back
  // Where the polynomial of brown turns back, far outside, it comes through the image's middle
  // again.
  CHECK(seen(3, at({1, 0.3, 0})));
  rig.sensors[3].parameters[1].values = {-0.3, 0, 0, 0, 0};
  const ParameterTable folded(rig);
  SimulationOptions options = options_of(1, 1);
  options.postures = {{"p", zero, {{3, 0}}, {{0, at({1, 1.85, 0})}}}};
  Simulation s = simulate(rig, folded, folded.initial, options);
  REQUIRE(s.dropped.size() == 1);
  CHECK(s.dropped[0].why == "a point is where the lens is not one to one");

  CHECK(seen(8, at({1, 0, 0})));
  CHECK(!seen(8, at({-1, 0.1, 0}), &why));
  CHECK(why == "a point is out of the scan's reach");
  CHECK(!seen(8, at({0.1, 0, 2}), &why));

  // Chains: the first holds, and nothing that is placed or mounted.
  rig.sensors.push_back(rig.sensors[0]);
  rig.sensors.back().name = "other_arm";
  const ParameterTable two(rig);
  options.postures = {{"p", zero, {{0, 0}, {11, 0}, {7, 0}, {0, 1}}, {}}};
  s = simulate(rig, two, two.initial, options);
  REQUIRE(s.dropped.size() == 2);
  CHECK(s.dropped[0].sensor == 11);
  CHECK(s.dropped[0].why == "it is held by 'arm'");
  CHECK(s.dropped[1].why == "it is mounted on link 'base'");
  CHECK(s.samples[0].views.size() == 2);

  // Postures that cannot be.
  const auto error = [&](const Posture& p) {
    options.postures = {p};
    return message_of([&] { simulate(rig, two, two.initial, options); });
  };
  std::vector<double> lacking = zero;
  lacking[2] = kNaN;
  CHECK_THAT(error({"p", lacking, {{0, 0}}, {}}),
             Contains("posture 'p'") && Contains("elbow_joint"));
  CHECK_THAT(error({"p", zero, {{1, 0}}, {}}), Contains("'held'") && Contains("free"));
  CHECK_THAT(error({"p", zero, {{0, 0}}, {{0, Pose()}}}),
             Contains("'held'") && Contains("cannot be given"));
  CHECK_THAT(error({"p", zero, {}, {{1, Pose()}}}), Contains("'wall'") && Contains("mounted"));
}

TEST_CASE("random postures", "[simulation]") {
  const Rig rig = make_rig();
  const ParameterTable table(rig);
  const std::vector<std::pair<int, int>> pairs = usual_pairs(rig);
  for (const auto& p : pairs) {
    if (p.first == 0) CHECK(p.second == 0);
    if (p.first == 6) CHECK(p.second == 3);
    if (p.first >= 1 && p.first <= 5) CHECK(p.second < 3);
  }
  const Simulation simulation = simulate(rig, table, table.initial, options_of(1, 100));
  CHECK(simulation.idle.empty());
  std::set<std::string> ids;
  for (size_t i = 0; i < simulation.samples.size(); ++i) {
    const Sample& s = simulation.samples[i];
    ids.insert(s.id);
    int held = 0, mounted = 0;
    for (const View& v : s.views) {
      held += v.target == 0;
      mounted += v.target > 0;
      CHECK(std::find(pairs.begin(), pairs.end(), std::make_pair(v.sensor, v.target)) !=
            pairs.end());
    }
    CHECK((held >= 2 || (held == 0 && mounted > 0)));
    CHECK(simulation.targets.count({static_cast<int>(i), 0}) == (held > 0));
    for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
      const Joint& joint = rig.tree.joints[j];
      const double limit = joint.lower < joint.upper            ? joint.upper
                           : joint.type == JointType::prismatic ? 0.5
                                                                : kPi;
      const double reading = simulation.true_readings[i][j];
      CHECK((std::isnan(reading) || std::abs(reading) <= limit));
      CHECK(std::isnan(reading) == (joint.mimic.has_value() || j == 0 || j == 8 || j == 9));
    }
  }
  CHECK(ids.size() == 100);

  SECTION("free targets without a chain are placed") {
    Rig other = rig;
    other.sensors.erase(other.sensors.begin());
    const ParameterTable small(other);
    const Simulation placed = simulate(other, small, small.initial, options_of(1, 60));
    int by_camera = 0;
    for (const Sample& s : placed.samples)
      for (const View& v : s.views)
        by_camera += v.target == 0 && other.sensors[v.sensor].type == "camera";
    CHECK(by_camera > 60);
    CHECK(placed.idle.empty());
  }
  SECTION("one camera alone needs one view") {
    Rig other = rig;
    other.sensors = {rig.sensors[1]};
    other.targets = {rig.targets[0]};
    const ParameterTable small(other);
    CHECK(simulate(other, small, small.initial, options_of(1, 20)).samples.size() == 20);
  }
  SECTION("what is never seen is named") {
    Rig other = rig;
    other.sensors = {rig.sensors[0], rig.sensors[1]};
    other.targets = {rig.targets[0]};
    other.sensors[1].link_T_sensor.rotation *= rotation_from_rpy({0, kPi, 0});  // looks to the back
    const ParameterTable small(other);
    const std::string message =
        message_of([&] { simulate(other, small, small.initial, options_of(1, 3)); });
    CHECK_THAT(message, Contains("never seen: 'held' by 'pinhole'") && Contains("held by 'arm'"));
    other.sensors.pop_back();
    const ParameterTable alone(other);
    CHECK_THAT(message_of([&] { simulate(other, alone, alone.initial, options_of(1, 3)); }),
               Contains("no sensor of this rig sees a target"));
  }
  CHECK_THROWS_WITH(simulate(rig, table, table.initial, options_of(1, 0)),
                    Contains("at least one sample"));
}

TEST_CASE("the example's postures are all seen, and random ones show every sensor something",
          "[simulation]") {
  const RigFile file = read_rig(kExample + "rig.yaml");
  const ParameterTable table(file.rig);
  const VectorXd truth = read_truth(kExample + "truth_values.json", table);
  SimulationOptions options = options_of(1, 64);
  options.postures = read_postures(kExample + "postures.jsonl", file.rig);
  REQUIRE(options.postures.size() == 64);
  Simulation simulation = simulate(file.rig, table, truth, options);
  for (const Simulation::Dropped& d : simulation.dropped) {
    INFO(d.sample << " " << file.rig.sensors[d.sensor].name << ": " << d.why);
    CHECK(false);
  }
  REQUIRE(simulation.samples.size() == 64);
  size_t views = 0;
  for (size_t i = 0; i < 64; ++i) {
    CHECK(simulation.samples[i].views.size() == options.postures[i].views.size());
    CHECK(simulation.samples[i].id == options.postures[i].id);
    views += simulation.samples[i].views.size();
  }
  CHECK(views == 369);
  CHECK(simulation.idle.empty());

  SECTION("written, read and calibrated: the truth within its sigmas") {
    const Scratch scratch;
    const std::string path =
        scratch.write("samples.jsonl", samples_text(file.rig, simulation.samples));
    const Solution result = calibrate(make_recording(file.rig, read_samples(path, file.rig)), {});
    CHECK(result.status == Status::converged);
    CHECK(result.chi2 / static_cast<double>(result.dof) == Approx(1).margin(0.05));
    double squares = 0, count = 0;
    for (const ParameterEstimate& p : result.parameters) {
      const Freed found = table.select(p.name).at(0);
      const Parameter& named = table.all[found.parameter];
      Vector6d xi = Vector6d::Zero();
      if (named.pose)
        xi = log_se3(inverse(get_pose(table.initial, named.start)) * get_pose(truth, named.start));
      for (size_t c = 0; c < p.value.size(); ++c) {
        if (!(p.sigma[c] > 0)) continue;
        const double e = (p.value[c] - (named.pose ? xi(static_cast<Eigen::Index>(c))
                                                   : truth(named.start + static_cast<int>(c)))) /
                         p.sigma[c];
        CHECK(std::abs(e) < 5);
        squares += e * e, ++count;
      }
    }
    CHECK(count >= 56);
    CHECK(squares / count > 0.4);
    CHECK(squares / count < 1.9);
  }
  SECTION("again from the first, with new noise and another id") {
    options.samples = 130;
    const Simulation more = simulate(file.rig, table, truth, options);
    REQUIRE(more.samples.size() == 130);
    CHECK(more.samples[64].id == more.samples[0].id + "_2");
    CHECK(more.samples[128].id == more.samples[0].id + "_3");
    CHECK(more.samples[0].views[1].z == simulation.samples[0].views[1].z);
    CHECK(more.samples[64].views[1].z != more.samples[0].views[1].z);
    CHECK(more.true_readings[0][2] == more.true_readings[0][2]);
  }
  SECTION("at random") {
    const Simulation random = simulate(file.rig, table, truth, options_of(1, 40));
    CHECK(random.samples.size() == 40);
    CHECK(random.idle.empty());
    for (const Sample& s : random.samples)
      for (const View& v : s.views)  // a hand does not hold a board of 0.8 m
        if (file.rig.sensors[v.sensor].type == "chain")
          CHECK(file.rig.targets[v.target].name == "small_board");
  }
}

TEST_CASE("truth files", "[simulation]") {
  const RigFile file = read_rig(kExample + "rig.yaml");
  const ParameterTable table(file.rig);
  const Scratch scratch;
  const VectorXd truth = read_truth(kExample + "truth_values.json", table);
  CHECK(truth(table.all[table.joint_scale[file.rig.tree.find_joint("laser_tilt_mount_joint")]]
                  .start) == 1.02);
  CHECK(truth(table.all[table.sensor_block[1] + 1].start) == 0.0911);
  const int mount =
      table.all[table.joint_origin[file.rig.tree.find_joint("laser_tilt_joint")]].start;
  Vector6d xi;
  xi << 0, 0, -0.0061, 0.0192, 0, -0.0151;
  CHECK((log_se3(inverse(get_pose(table.initial, mount)) * get_pose(truth, mount)) - xi).norm() <
        1e-15);

  SimulationOptions options = options_of(1, 3);
  options.postures = read_postures(kExample + "postures.jsonl", file.rig);
  const Simulation simulation = simulate(file.rig, table, truth, options);
  const std::string text = truth_text(file.rig, table, simulation),
                    path = scratch.write("truth.json", text);
  CHECK((read_truth(path, table) - truth).cwiseAbs().maxCoeff() < 1e-15);
  const Node node = parse_json(text, path);
  CHECK(node.find("parameters")->members.size() == 56);
  const Node* first = node.find("samples")->find("left_000");
  REQUIRE(first);
  CHECK(Field{first->find("joints"), &path, ""}["l_elbow_flex_joint"].number() == -1.5306);
  const Pose held = Field{first->find("targets"), &path, ""}["small_board"].pose();
  CHECK((held.translation - simulation.targets.at({0, 0}).translation).norm() == 0);
  CHECK((held.rotation - simulation.targets.at({0, 0}).rotation).norm() < 1e-15);

  const auto values = [&](const std::string& parameters) {
    return read_truth(
        scratch.write("t.json", "{\"about\": \"\", \"samples\": [1],\n\"parameters\": {\n" +
                                    parameters + "}}"),
        table);
  };
  const auto error = [&](const std::string& parameters) {
    return message_of([&] { values(parameters); });
  };
  const int pan = table.all[table.joint_offset[file.rig.tree.find_joint("head_pan_joint")]].start;
  CHECK(values("\"joint/head_pan_joint/offset\": 0.5")(pan) == 0.5);
  CHECK(values("\"joint/head_pan_joint/offset\": [0.5]")(pan) == 0.5);
  CHECK(values("\"joint/head_pan_joint/offset\": {\"initial\": 0, \"true\": 0.5}")(pan) == 0.5);
  CHECK(values("\"sensor/forearm_left/distortion.k2\": {\"true\": 0.5}")(
            table.all[table.sensor_block[4] + 1].start + 1) == 0.5);
  CHECK(values("\"sensor/forearm_left/intrinsics\": {\"true\": [1, 2, 3, 4]}")(
            table.all[table.sensor_block[4]].start + 3) == 4);
  CHECK((values("\"joint/laser_tilt_joint/origin.z\": -0.0061, "
                "\"joint/laser_tilt_joint/origin.rx\": {\"true\": 0.0192}, "
                "\"joint/laser_tilt_joint/origin.rz\": -0.0151")
             .segment(mount, 12) -
         truth.segment(mount, 12))
            .norm() < 1e-15);
  CHECK_THAT(error("\"joint/head_pan_joint/ofset\": 1"),
             Contains("t.json:3: ") && Contains("nearest: joint/head_pan_joint/offset"));
  CHECK_THAT(error("\"sensor/left_arm/pose\": [1, 2]"), Contains("a list of 6 numbers"));
  CHECK_THAT(error("\"sensor/left_arm/pose\": 1"), Contains("a list of 6 numbers"));
  CHECK_THAT(error("\"sensor/left_arm/pose.x\": [1]"), Contains("a finite number"));
  CHECK_THAT(error("\"sensor/left_arm/pose.x\": {\"initial\": 1}"),
             Contains("key 'true' is missing"));
  CHECK_THAT(error("\"sensor/left_arm/pose.x\": {\"true\": 1, \"sigma\": 1}"),
             Contains("unknown key 'sigma'"));
  CHECK_THAT(error("\"sensor/left_arm/pose\": [1, 2, 3, 4, 5, 6], \"sensor/left_arm/pose.rz\": 1"),
             Contains("occurs twice"));
  CHECK_THAT(error("\"joint/head_pan_joint/scale\": 0"),
             Contains("t.json:3: ") && Contains("a scale is not 0"));
  CHECK_THAT(error("\"target/small_board/square\": -1"), Contains("greater than 0"));
  CHECK_THAT(message_of([&] { read_truth(scratch.write("u.json", "{\"parameter\": {}}"), table); }),
             Contains("nearest: parameters"));
}

TEST_CASE("posture files", "[simulation]") {
  const RigFile file = read_rig(kExample + "rig.yaml");
  const Scratch scratch;
  const auto read = [&](const std::string& text) {
    return read_postures(scratch.write("p.jsonl", text), file.rig);
  };
  const auto error = [&](const std::string& text) {
    return message_of([&] { read("\n" + text); });
  };
  const std::string head = "\"head_pan_joint\": 0.1, \"head_tilt_joint\": 0.2";
  const std::vector<Posture> good =
      read("{\"id\": \"a\", \"joints\": {}}\n\n{\"id\": \"b\", \"joints\": {" + head +
           "}, \"views\": [{\"sensor\": \"wide_left\", \"target\": \"large_board\"}], \"targets\": "
           "{\"large_board\": {\"xyz\": [1, 2, 3], \"quat\": [0, 0, 1, 0]}}}\n");
  REQUIRE(good.size() == 2);
  CHECK(good[0].views.empty());
  CHECK(good[1].id == "b");
  CHECK(good[1].readings[file.rig.tree.find_joint("head_tilt_joint")] == 0.2);
  CHECK(std::isnan(good[0].readings[file.rig.tree.find_joint("head_tilt_joint")]));
  CHECK(good[1].views == std::vector<std::pair<int, int>>{{2, 1}});
  CHECK(good[1].targets.at(1).translation == Vector3d(1, 2, 3));

  const auto with = [&](const std::string& views, const std::string& more = "") {
    return error("{\"id\": \"a\", \"joints\": {" + head + "}, \"views\": [" + views + "]" + more +
                 "}");
  };
  CHECK_THAT(error(""), Contains("p.jsonl: no postures"));
  CHECK_THAT(error("{\"id\": \"a\", \"joints\": {\"head_pan_jont\": 1}}"),
             Contains("p.jsonl:2: joints.head_pan_jont") && Contains("nearest: head_pan_joint"));
  CHECK_THAT(error("{\"id\": \"a\", \"joints\": {\"head_plate_frame_joint\": 1}}"),
             Contains("does not move"));
  CHECK_THAT(error("{\"id\": \"a\", \"joints\": {\"head_pan_joint\": \"1\"}}"),
             Contains("a finite number"));
  CHECK_THAT(error("{\"id\": \"a\", \"joint\": {}}"),
             Contains("unknown key 'joint'; nearest: joints"));
  CHECK_THAT(error("{\"id\": 1, \"joints\": {}}"), Contains("a string is expected"));
  CHECK_THAT(error("{\"id\": \"a\", \"joints\": {}}\n{\"id\": \"a\", \"joints\": {}}"),
             Contains("p.jsonl:3: id") && Contains("line 2"));
  CHECK_THAT(with("{\"sensor\": \"wide_lef\", \"target\": \"large_board\"}"),
             Contains("views[0].sensor") && Contains("nearest: wide_left"));
  CHECK_THAT(with("{\"sensor\": \"wide_left\", \"target\": \"board\"}"),
             Contains("views[0].target") && Contains("small_board"));
  CHECK_THAT(with("{\"sensor\": \"wide_left\", \"target\": \"large_board\"}"),
             Contains("'large_board' is free"));
  CHECK_THAT(with("{\"sensor\": \"left_arm\", \"target\": \"small_board\"}"),
             Contains("needs joint 'l_shoulder_pan_joint'"));
  CHECK_THAT(with("{\"sensor\": \"wide_left\", \"target\": \"large_board\", \"ids\": [1]}"),
             Contains("unknown key 'ids'"));
  const std::string place = ", \"targets\": {\"large_board\": {\"xyz\": [1, 2, 3]}}",
                    view = "{\"sensor\": \"wide_left\", \"target\": \"large_board\"}";
  CHECK_THAT(with(view + ", " + view, place), Contains("views[1]: the view occurs twice"));
  CHECK_THAT(with(view, ", \"targets\": {\"large_boar\": {}}"),
             Contains("targets.large_boar") && Contains("nearest: large_board"));
  CHECK_THAT(with(view, ", \"targets\": {\"large_board\": {\"xy\": 1}}"),
             Contains("unknown key 'xy'"));
}

}  // namespace simulation_test
