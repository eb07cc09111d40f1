// models/analysis/loops.h: error of every pair of sensors.
//
// Proves: without noise, at the truth, every loop of a robot with all types of sensors is 0; a
// camera whose mount is wrong shows in exactly the loops with that camera; with noise and wrong
// values every loop, before and after, training and held out, is what an independent forward model
// (fixtures/forward_model.h) with its own rigid fit and its own perspective pose gives; a point
// behind a camera makes that figure unknown; sensors that never meet have no loop. Does not prove:
// that a small loop means a right robot (see the formats).
#include "../../../models/analysis/loops.h"

#include <catch2/catch.hpp>
#include <memory>
#include <set>

#include "../../../models/rig/parameters.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/transforms.h"

namespace loops_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// The nasty robot with enough points on its solid targets for a closed-form perspective pose (6).
Rig robot() {
  Rig rig = nasty_robot();
  for (const char* name : {"marks", "probe"}) {
    Eigen::Matrix3Xd& points = rig.targets[target_index(rig, name)].points;
    const Eigen::Index n = points.cols();
    points.conservativeResize(3, n + 3);
    points.rightCols(3) << -0.04, 0.09, 0.03, 0.06, 0.09, -0.05, 0.07, -0.03, 0.1;
  }
  return rig;
}

/// The whole target within 75 degrees of the sensor's axis.
bool ahead(const Rig& rig, int sensor, int target, const TruePosture& posture) {
  for (int i = 0; i < rig.targets[target].count(); ++i) {
    const Vector3d p =
        sensor_T_target(rig, sensor, target, posture) * target_point(rig.targets[target], i);
    if (p.z() < std::cos(75 * kPi / 180) * p.norm()) return false;
  }
  return true;
}

/// Samples in which every chain view tells the truth: the board is in the hand, or the hand has no
/// view.
std::vector<Sample> gripping_samples(const Rig& truth, int count, unsigned long seed,
                                     Random* noise) {
  Random random(seed);
  const int board = target_index(truth, "board"), probe = target_index(truth, "probe"),
            grip = sensor_index(truth, "grip"), fisheye = sensor_index(truth, "kb");
  const std::vector<std::string> cameras = {"pin", "bc5", "bc8", "kb"};
  std::vector<Sample> out;
  for (int n = 0; static_cast<int>(out.size()) < count; ++n) {
    REQUIRE(n < 20000);
    TruePosture p = random_posture(truth, random, 1.5, noise != nullptr);
    const bool held = n % 2;
    p.boards[board] =
        held ? in_hand(truth, grip, p, noise)
             : in_front(truth, sensor_index(truth, cameras[n % 4]), board, p, 0.7, 0.8, random);
    p.boards[probe] =
        in_front(truth, sensor_index(truth, cameras[(n / 2) % 4]), probe, p, 0.6, 1.0, random);
    Sample s = make_sample(truth, p, "sample_" + std::to_string(n));
    s.train = out.size() % 4 != 3;
    int of_board = 0;
    for (const int target :
         {board, target_index(truth, "wall"), target_index(truth, "marks"), probe})
      for (const int sensor : all_sensors(truth)) {
        if (!pair_allowed(truth, sensor, target) || (sensor == grip && !(held && target == board)))
          continue;
        if (sensor == fisheye && !ahead(truth, sensor, target, p))
          continue;  // perspective poses are found within 75 degrees
        std::vector<int> ids;
        if (target == board && (n + sensor) % 3 == 0) ids = {7, 0, 3, 10, 5, 11};
        const bool seen = add_view(s, truth, sensor, target, p, noise, ids);
        of_board += seen && target == board && truth.sensors[sensor].type == "camera";
      }
    if (of_board > 0) out.push_back(s);
  }
  return out;
}

/// Only what loops() reads: from the rig's values to these.
Solution at_values(const std::shared_ptr<const Recording>& recording, const VectorXd& values) {
  Solution solution;
  solution.recording = recording;
  solution.initial = recording->table.initial;
  solution.values.shared = values;
  return solution;
}

std::vector<Loop> loops_of(const Solution& solution) {
  return loops(solution, loop_views(solution));
}

using Pair = std::pair<std::string, std::string>;
struct Reference {
  double squared = 0;
  long points = 0;
};

/// sensor_T_target of a camera's view: a minimum of the sum of soft_l1 (scale 3) near a start,
/// derivatives by differences; its cost.
std::pair<double, Isometry3d> perspective_minimum(const Rig& rig, const View& view,
                                                  Isometry3d pose) {
  const std::vector<int> ids = seen_ids(rig, view);
  const auto residuals = [&](const Isometry3d& t) {
    VectorXd r(2 * static_cast<Eigen::Index>(ids.size()));
    for (size_t i = 0; i < ids.size(); ++i) {
      Vector2d pixel;
      if (!project(rig.sensors[view.sensor], t * target_point(rig.targets[view.target], ids[i]),
                   pixel))
        throw std::logic_error("behind");
      r.segment<2>(2 * static_cast<Eigen::Index>(i)) =
          (pixel - Vector2d(view.z[2 * i], view.z[2 * i + 1])) / view.sigma[0];
    }
    return r;
  };
  for (int step = 0; step < 600; ++step) {
    const VectorXd r = residuals(pose);
    MatrixXd j(r.size(), 6);
    for (int c = 0; c < 6; ++c)
      j.col(c) = derivative(
          [&](double h) { return residuals(pose * exponential(h * Vector6d::Unit(c))); }, 1e-4);
    VectorXd weight(r.size());
    for (Eigen::Index i = 0; i < r.size(); i += 2)
      weight(i) = weight(i + 1) = 1 / std::sqrt(1 + r.segment<2>(i).squaredNorm() / 9);
    const Vector6d step_of_pose = (j.transpose() * weight.asDiagonal() * j)
                                      .ldlt()
                                      .solve(j.transpose() * weight.asDiagonal() * r);
    pose = pose * exponential(-step_of_pose);
    if (step_of_pose.norm() < 1e-9) break;
  }
  double cost = 0;
  const VectorXd r = residuals(pose);
  for (Eigen::Index i = 0; i < r.size(); i += 2)
    cost += std::sqrt(1 + r.segment<2>(i).squaredNorm() / 9) - 1;
  return {cost, pose};
}

/// The better minimum: near a start, or near its mirror image across the line of sight, which a
/// board looks almost the same in.
Isometry3d perspective_pose(const Rig& rig, const View& view, const Isometry3d& start) {
  const Target& target = rig.targets[view.target];
  Vector3d middle = Vector3d::Zero();
  for (int i = 0; i < target.count(); ++i) middle += target_point(target, i) / target.count();
  const Vector3d sight = (start * middle).normalized();
  Isometry3d mirrored = start;
  mirrored.linear() = (2 * sight * sight.transpose() - Matrix3d::Identity()) * start.linear() *
                      Vector3d(-1, -1, 1).asDiagonal();
  mirrored.translation() = start * middle - mirrored.linear() * middle;
  const auto a = perspective_minimum(rig, view, start);
  if (!target.grid) return a.second;
  const auto b = perspective_minimum(rig, view, mirrored);
  return b.first < a.first ? b.second : a.second;
}

/// The same figures by the fixture's forward model; `rig` has the values.
std::map<Pair, Reference> reference(const Rig& rig, const std::vector<Sample>& samples,
                                    bool train) {
  std::map<Pair, Reference> out;
  for (const Sample& sample : samples) {
    if (sample.train != train) continue;
    TruePosture posture = empty_posture(rig);
    for (size_t j = 0; j < sample.readings.size(); ++j)
      if (!std::isnan(sample.readings[j])) posture.readings[j] = sample.readings[j];
    // From the frame of the link that carries the target (of a free one: the root), as it stands
    // while the sensor measures.
    const auto hub_T_sensor = [&](const View& v, const TruePosture& p) -> Isometry3d {
      const int link = rig.targets[v.target].link;
      return (link >= 0 ? root_T_link(rig, link, p) : Isometry3d::Identity()).inverse() *
             root_T_sensor(rig, v.sensor, p);
    };
    struct Points {
      const View* view;
      std::map<int, Vector3d> at;
    };
    std::vector<Points> points;
    for (const View& v : sample.views) {
      const Sensor& s = rig.sensors[v.sensor];
      Points p{&v, {}};
      const std::vector<int> ids = seen_ids(rig, v);
      Isometry3d sensor_T_target = Isometry3d::Identity();
      if (s.type == "pose") {
        sensor_T_target.linear() =
            Eigen::Quaterniond(v.z[6], v.z[3], v.z[4], v.z[5]).toRotationMatrix();
        sensor_T_target.translation() << v.z[0], v.z[1], v.z[2];
      }
      if (s.type == "camera") {
        // A start: what another sensor, the tracker or the motion capture, says of this target.
        bool started = false;
        for (const View& w : sample.views) {
          if (w.target != v.target || rig.sensors[w.sensor].type != "pose") continue;
          Isometry3d z = Isometry3d::Identity();
          z.linear() = Eigen::Quaterniond(w.z[6], w.z[3], w.z[4], w.z[5]).toRotationMatrix();
          z.translation() << w.z[0], w.z[1], w.z[2];
          sensor_T_target = hub_T_sensor(v, posture).inverse() * hub_T_sensor(w, posture) * z;
          started = true;
        }
        REQUIRE(started);
        sensor_T_target = perspective_pose(rig, v, sensor_T_target);
      }
      for (size_t i = 0; i < ids.size(); ++i) {
        const double* z = v.z.data() + 3 * i;
        if (s.type == "point")
          p.at[ids[i]] = hub_T_sensor(v, posture) * Vector3d(z[0], z[1], z[2]);
        else if (s.type == "tilting_laser")
          p.at[ids[i]] =
              hub_T_sensor(v, at_ray(rig, v.sensor, posture, z[0])) * ray_point(z[1], z[2]);
        else
          p.at[ids[i]] = hub_T_sensor(v, posture) * sensor_T_target *
                         target_point(rig.targets[v.target], ids[i]);
      }
      points.push_back(p);
    }
    for (const Points& from : points)
      for (const View& to : sample.views) {
        if (to.target != from.view->target || to.sensor == from.view->sensor) continue;
        const Sensor& s = rig.sensors[to.sensor];
        Reference& sum = out[{rig.sensors[from.view->sensor].name, s.name}];
        if (s.type == "pose" || s.type == "chain") {
          Eigen::Matrix3Xd a(3, from.at.size()), b = a;
          Eigen::Index k = 0;
          for (const auto& p : from.at) {
            a.col(k) = target_point(rig.targets[to.target], p.first);
            b.col(k++) = p.second;
          }
          Isometry3d hub_T_target, z = Isometry3d::Identity();
          hub_T_target.matrix() = Eigen::umeyama(a, b, false);
          if (s.type == "pose") {
            z.linear() = Eigen::Quaterniond(to.z[6], to.z[3], to.z[4], to.z[5]).toRotationMatrix();
            z.translation() << to.z[0], to.z[1], to.z[2];
          }
          sum.squared += ((hub_T_sensor(to, posture) * z).inverse() * hub_T_target)
                             .translation()
                             .squaredNorm();
          ++sum.points;
          continue;
        }
        const std::vector<int> ids = seen_ids(rig, to);
        for (size_t i = 0; i < ids.size(); ++i) {
          if (!from.at.count(ids[i])) continue;
          const Vector3d p = from.at.at(ids[i]);
          ++sum.points;
          if (s.type == "camera") {
            Vector2d pixel;
            if (!project(s, hub_T_sensor(to, posture).inverse() * p, pixel))
              throw std::logic_error("behind");
            sum.squared += (pixel - Vector2d(to.z[2 * i], to.z[2 * i + 1])).squaredNorm();
          } else {
            const double* z = to.z.data() + 3 * i;
            const bool laser = s.type == "tilting_laser";
            const Vector3d measured = laser ? ray_point(z[1], z[2]) : Vector3d(z[0], z[1], z[2]);
            const TruePosture at = laser ? at_ray(rig, to.sensor, posture, z[0]) : posture;
            sum.squared += (hub_T_sensor(to, at).inverse() * p - measured).squaredNorm();
          }
        }
      }
  }
  return out;
}

}  // namespace

TEST_CASE(
    "loops: nothing at the truth without noise, a wrong mount shows in the loops of that camera, "
    "and only there",
    "[loops]") {
  const Rig rig = robot();
  const std::vector<Sample> samples = gripping_samples(rig, 24, 5, nullptr);
  const std::shared_ptr<const Recording> recording = make_recording(rig, samples);
  const ParameterTable& table = recording->table;
  const std::vector<Loop> exact = loops_of(at_values(recording, recording->table.initial));
  std::set<std::string> seen;
  for (const Loop& loop : exact) {
    CAPTURE(loop.from, loop.to, loop.train.points);
    seen.insert({loop.from, loop.to});
    REQUIRE(loop.train.points + loop.test.points > 0);
    CHECK((loop.train.points == 0) == std::isnan(loop.train.rms));
    for (const double rms : {loop.train.rms, loop.train.rms_before, loop.test.rms})
      if (!std::isnan(rms)) CHECK(rms < (loop.unit == "px" ? 1e-5 : 1e-8));
  }
  CHECK(seen.size() == rig.sensors.size());

  const int camera = sensor_index(rig, "bc5"), pose = table.all[table.sensor_pose[camera]].start;
  VectorXd wrong = recording->table.initial;
  Vector6d xi;
  xi << 0.004, -0.003, 0.002, 0.01, -0.02, 0.015;
  set_pose(wrong, pose, get_pose(wrong, pose) * to_pose(exponential(xi)));
  const std::vector<Loop> planted = loops_of(at_values(recording, wrong));
  REQUIRE(planted.size() == exact.size());
  int showing = 0;
  for (size_t i = 0; i < planted.size(); ++i) {
    const Loop& loop = planted[i];
    CAPTURE(loop.from, loop.to);
    CHECK(loop.from == exact[i].from);
    CHECK(loop.to == exact[i].to);
    if (!std::isnan(loop.train.rms_before))
      CHECK(loop.train.rms_before < (loop.unit == "px" ? 1e-5 : 1e-8));
    if (std::isnan(loop.train.rms)) continue;
    const bool its = loop.from == "bc5" || loop.to == "bc5";
    showing += its;
    CHECK((loop.train.rms > (loop.unit == "px" ? 1.0 : 0.002)) == its);
  }
  CHECK(showing >= 10);
}

TEST_CASE("loops: with noise and wrong values as the independent model has them", "[loops]") {
  const Rig rig = robot();
  Random noise(3), random(8);
  const std::vector<Sample> samples = gripping_samples(rig, 20, 6, &noise);
  const std::vector<std::string> wrong = {"joint/*/offset",  "joint/*/origin",
                                          "sensor/*/pose",   "sensor/*/intrinsics",
                                          "target/*/square", "target/*/points"};
  const Rig start = moved(rig, wrong, random, 0.004, 0.004, 2, 0),
            end = moved(rig, wrong, random, 0.001, 0.001, 0.5, 0);
  const std::shared_ptr<const Recording> recording = make_recording(start, samples);
  const std::vector<Loop> found = loops_of(at_values(recording, ParameterTable(end).initial));
  const auto before = reference(start, samples, true), after = reference(end, samples, true);
  const auto before_test = reference(start, samples, false),
             after_test = reference(end, samples, false);
  std::set<Pair> pairs;
  for (const Loop& loop : found) {
    const Pair pair(loop.from, loop.to);
    CAPTURE(loop.from, loop.to, loop.train.points, loop.test.points);
    CHECK(pairs.insert(pair).second);
    const auto check = [&](const std::map<Pair, Reference>& expected, long points, double rms) {
      const auto it = expected.find(pair);
      const Reference e = it == expected.end() ? Reference() : it->second;
      CHECK(points == e.points);
      if (e.points)
        CHECK(rms == Approx(std::sqrt(e.squared / static_cast<double>(e.points))).epsilon(1e-5));
    };
    check(before, loop.train.points, loop.train.rms_before);
    check(after, loop.train.points, loop.train.rms);
    check(before_test, loop.test.points, loop.test.rms_before);
    check(after_test, loop.test.points, loop.test.rms);
  }
  CHECK(pairs.size() >= 60);
  for (const auto& p : after) CHECK(pairs.count(p.first) == (p.second.points > 0));
}

TEST_CASE("loops: a point behind the camera makes the figure unknown, who never meets has none",
          "[loops]") {
  const Rig rig = robot();
  std::vector<Sample> samples = gripping_samples(rig, 12, 9, nullptr);
  for (Sample& s : samples)  // the tracker and the motion capture never look at the same target
    s.views.erase(std::remove_if(s.views.begin(), s.views.end(),
                                 [&](const View& v) {
                                   const std::string& sensor = rig.sensors[v.sensor].name;
                                   return (sensor == "tracker") ==
                                              (rig.targets[v.target].name == "board") &&
                                          (sensor == "tracker" || sensor == "mocap");
                                 }),
                  s.views.end());
  const std::shared_ptr<const Recording> recording = make_recording(rig, samples);
  VectorXd wrong = recording->table.initial;
  const int pose =
      recording->table.all[recording->table.sensor_pose[sensor_index(rig, "bc5")]].start;
  Pose turned = get_pose(wrong, pose);
  turned.rotation = turned.rotation * rpy(0, kPi, 0);
  set_pose(wrong, pose, turned);
  int unknown = 0;
  for (const Loop& loop : loops_of(at_values(recording, wrong))) {
    CAPTURE(loop.from, loop.to);
    CHECK_FALSE((loop.from == "tracker" && loop.to == "mocap"));
    CHECK_FALSE((loop.from == "mocap" && loop.to == "tracker"));
    if (loop.to != "bc5" || loop.train.points == 0) continue;
    ++unknown;
    CHECK(std::isnan(loop.train.rms));
    CHECK(loop.train.rms_before < 1e-5);
  }
  CHECK(unknown >= 3);
}

}  // namespace loops_test
