// models/fitting/starts.h: starting values in closed form.
//
// Proves: rigid fits, also of mirrored, flat and degenerate points; poses of free targets from
// every type of sensor, without noise to 1e-6, where a plane has two mirror solutions the right
// one; poses of sensors and mounted targets that are up to 180 degrees and 1 m from the identity,
// in the set-ups of the formats (eye in hand, eye to hand, camera and hand, laser, tracker,
// stereo), alone and together; what cannot be tied to anything is returned by name, and a sensor
// whose views tell no pose is named as the reason; the calibration finds the same optimum as from
// given poses; a tracker and its reflector, both unknown (40 sets); of nearly flat points the right
// side; boards beside and behind a fisheye. A calibration from given poses that are turned by 90 or
// 180 degrees ends where it would from the right ones and names them. Does not prove: good starts
// from few or very noisy views, or from targets much smaller than their distance.
#include <algorithm>
#include <catch2/catch.hpp>

#include "../../../models/calibration/calibration.h"
#include "../../../models/calibration/start_poses.h"
#include "../../../models/estimation/estimation.h"
#include "../../../models/fitting/starts.h"
#include "../../../models/fitting/unknown_poses.h"
#include "../../../models/rig/parameters.h"
#include "../../../models/rig/targets.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/height_sensor.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/study.h"
#include "../../fixtures/three_points.h"
#include "../../fixtures/transforms.h"

namespace starts_test {

using namespace kincal;
using namespace kincal::fixture;
using Eigen::Matrix3Xd;

namespace {

double difference(const Pose& a, const Pose& b) {
  return std::max((a.rotation - b.rotation).cwiseAbs().maxCoeff(),
                  (a.translation - b.translation).cwiseAbs().maxCoeff());
}
bool is_rotation(const Matrix3d& r) {
  return (r.transpose() * r - Matrix3d::Identity()).norm() < 1e-9 && r.determinant() > 0;
}

Matrix3Xd random_points(Random& random, int n, double size) {
  Matrix3Xd p(3, n);
  for (int i = 0; i < n; ++i) p.col(i) = random.vector(size);
  return p;
}

/// base -a1- .. -a6- tool: six oblique joints; base -pan- neck -scan- laser.
Rig arm() {
  Rig rig;
  add_link(rig, "world");
  add_joint(rig, JointType::fixed, "stand", "world", "base", {1, 0, 0},
            at({0.3, -0.2, 0.5}, {0.2, 0.1, 0.7}));
  rig.base = 1;
  add_joint(rig, JointType::revolute, "a1", "base", "l1", {0, 0, 1}, at({0, 0, 0.3}));
  add_joint(rig, JointType::revolute, "a2", "l1", "l2", {0, 1, 0}, at({0.1, 0, 0.2}, {0, 0, 0.3}));
  add_joint(rig, JointType::revolute, "a3", "l2", "l3", {0, -1, 0.1}, at({0.3, 0, 0.1}));
  add_joint(rig, JointType::revolute, "a4", "l3", "l4", {1, 0, 0}, at({0.2, 0, 0}));
  add_joint(rig, JointType::revolute, "a5", "l4", "l5", {0.1, 1, 0}, at({0.1, 0, 0}));
  add_joint(rig, JointType::revolute, "a6", "l5", "tool", {1, 0, 0.2}, at({0.1, 0, 0}));
  add_joint(rig, JointType::revolute, "pan", "base", "neck", {0, 0, 1}, at({0.1, 0.1, 0.8}));
  add_joint(rig, JointType::revolute, "scan", "neck", "laser", {0, 1, 0}, at({0.05, 0, 0.1}));
  finish_tree(rig.tree);
  return rig;
}

/// Near a posture.
TruePosture near(const Rig& rig, const TruePosture& middle, Random& random, double range) {
  TruePosture p = middle;
  for (size_t j = 0; j < rig.joints.size(); ++j)
    if (rig.tree.joints[j].has_reading()) p.readings[j] += random.uniform(-range, range);
  return p;
}

/// The truth, the samples, and which pose parameters are not known.
struct Unknown {
  Rig truth;
  std::vector<Sample> samples;
  std::vector<TruePosture> postures;
  std::vector<std::string> names;

  void add(const TruePosture& p, const std::vector<std::pair<int, int>>& views,
           Random* noise = nullptr) {
    Sample s = make_sample(truth, p, "s" + std::to_string(samples.size()));
    for (const auto& [sensor, target] : views) add_view(s, truth, sensor, target, p, noise);
    if (s.views.empty()) return;
    samples.push_back(s);
    postures.push_back(p);
  }
  /// The rig as given: unknown poses are absent.
  Rig given() const {
    Rig rig = truth;
    for (Sensor& s : rig.sensors)
      if (std::count(names.begin(), names.end(), "sensor/" + s.name + "/pose"))
        s.link_T_sensor = Pose(), s.pose_given = false;
    for (Target& t : rig.targets)
      if (std::count(names.begin(), names.end(), "target/" + t.name + "/pose"))
        t.link_T_target = Pose(), t.pose_given = false;
    return rig;
  }
  struct Found {
    std::vector<std::string> lost;
    std::vector<AmbiguousStart> ambiguous;
    double worst = 0;
  };
  Found find() const {
    const Recording recording(given(), samples);
    const ParameterTable &table = recording.table, true_table(truth);
    std::vector<int> unknown;
    for (const std::string& name : names) unknown.push_back(table.select(name).at(0).parameter);
    Values values;
    values.shared = table.initial;
    Found out;
    UnknownStarts starts = start_unknown_poses(recording, recording.training(), unknown, values);
    out.lost = starts.lost;
    out.ambiguous = starts.ambiguous;
    for (const int p : unknown) {
      if (std::count(out.lost.begin(), out.lost.end(), table.all[p].name)) {
        CHECK(difference(get_pose(values.shared, table.all[p].start), Pose()) ==
              0);  // stays at the identity
        continue;
      }
      CHECK(is_rotation(get_pose(values.shared, table.all[p].start).rotation));
      out.worst = std::max(out.worst, difference(get_pose(values.shared, table.all[p].start),
                                                 get_pose(true_table.initial, table.all[p].start)));
    }
    for (size_t p = 0; p < table.all.size(); ++p)  // nobody else's values were touched
      if (!std::count(unknown.begin(), unknown.end(), static_cast<int>(p))) {
        const int size = table.all[p].pose ? 12 : table.all[p].size();
        CHECK(values.shared.segment(table.all[p].start, size) ==
              table.initial.segment(table.all[p].start, size));
      }
    return out;
  }
};

/// Eye in hand: a camera on the tool, a board on the base, both poses at random.
Unknown eye_in_hand(unsigned long seed, bool noise) {
  Random random(seed);
  Unknown u;
  u.truth = arm();
  const int camera = add_camera(u.truth, "camera", "tool", random.pose(1, kPi));
  const TruePosture middle = random_posture(u.truth, random, 1, false);
  const int board = add_grid(u.truth, "board", 5, 6, 0.06, "base", Pose());
  // in_front() gives it relative to the base, on which it is mounted.
  u.truth.targets[board].link = -1;
  u.truth.targets[board].link_T_target =
      to_pose(in_front(u.truth, camera, board, middle, 1, 0.5, random));
  u.truth.targets[board].link = link_index(u.truth, "base");
  for (int k = 0; k < 12; ++k)
    u.add(near(u.truth, middle, random, 0.35), {{camera, board}}, noise ? &random : nullptr);
  u.names = {"sensor/camera/pose", "target/board/pose"};
  return u;
}

/// Eye to hand: a camera that stands, a board on the tool, both poses at random.
Unknown eye_to_hand(unsigned long seed, bool noise, bool fisheye = false) {
  Random random(seed);
  Unknown u;
  u.truth = arm();
  const int camera = fisheye ? add_camera(u.truth, "camera", "base", Pose(), Lens::kannala_brandt,
                                          {0.02, -0.008, 0.003, -0.0005})
                             : add_camera(u.truth, "camera", "base", Pose());
  const int board = add_grid(u.truth, "board", 5, 6, 0.06, "tool", random.pose(1, kPi));
  const TruePosture middle = random_posture(u.truth, random, 1, false);
  const Isometry3d target = root_T_target(u.truth, board, middle);
  Isometry3d seen = Isometry3d::Identity();
  seen.linear() = random.rotation(0.5);
  seen.translation() = Vector3d(0, 0, 1.2) - seen.linear() * Vector3d(0.15, 0.12, 0);
  u.truth.sensors[camera].link_T_sensor =
      to_pose(root_T_link(u.truth, link_index(u.truth, "base"), middle).inverse() * target *
              seen.inverse());
  for (int k = 0; k < 12; ++k)
    u.add(near(u.truth, middle, random, 0.3), {{camera, board}}, noise ? &random : nullptr);
  u.names = {"sensor/camera/pose", "target/board/pose"};
  return u;
}

/// A free board in the hand before `cameras` cameras; the hand known or not.
Unknown hand_and_cameras(unsigned long seed, int cameras, bool hand_known, bool noise) {
  Random random(seed);
  Unknown u;
  u.truth = arm();
  const int board = add_grid(u.truth, "board", 5, 6, 0.06),
            hand = add_chain(u.truth, "hand", "tool", random.pose(0.5, kPi), 0.001, 0.002);
  const TruePosture middle = random_posture(u.truth, random, 1, false);
  std::vector<std::pair<int, int>> views = {{hand, board}};
  for (int c = 0; c < cameras; ++c) {
    const int camera =
        add_camera(u.truth, "camera" + std::to_string(c), c % 2 ? "neck" : "base", Pose());
    const Isometry3d target = root_T_sensor(u.truth, hand, middle);
    Isometry3d seen = Isometry3d::Identity();
    seen.linear() = random.rotation(0.5);
    seen.translation() = Vector3d(0, 0, 1.2) - seen.linear() * Vector3d(0.15, 0.12, 0);
    u.truth.sensors[camera].link_T_sensor =
        to_pose(root_T_link(u.truth, u.truth.sensors[camera].link, middle).inverse() * target *
                seen.inverse());
    views.push_back({camera, board});
    u.names.push_back("sensor/camera" + std::to_string(c) + "/pose");
  }
  if (!hand_known) u.names.push_back("sensor/hand/pose");
  for (int k = 0; k < 12; ++k) {
    TruePosture p = near(u.truth, middle, random, 0.3);
    p.boards[board] = in_hand(u.truth, hand, p, noise ? &random : nullptr);
    u.add(p, views, noise ? &random : nullptr);
  }
  return u;
}

}  // namespace

TEST_CASE("fit_points: rigid, with noise, mirrored") {
  Random random(1);
  for (int trial = 0; trial < 50; ++trial) {
    const Pose truth = random.pose(2, kPi);
    Matrix3Xd a = random_points(random, 3 + trial % 5, 1);
    if (trial % 3 == 0) a.row(2).setZero();  // flat
    Matrix3Xd b(3, a.cols());
    for (Eigen::Index i = 0; i < a.cols(); ++i) b.col(i) = isometry(truth) * Vector3d(a.col(i));
    CHECK(difference(fit_points(a, b), truth) < 1e-9);
    for (Eigen::Index i = 0; i < a.cols(); ++i) b.col(i) += random.vector(0.01);
    CHECK(is_rotation(fit_points(a, b).rotation));
    // The best mirror image of a body is no rotation: the answer still is one, and no other
    // rotation fits better.
    Matrix3Xd mirrored = b;
    mirrored.row(0) *= -1;
    const Pose fitted = fit_points(a, mirrored);
    CHECK(is_rotation(fitted.rotation));
    const auto misfit = [&](const Isometry3d& t) {
      double sum = 0;
      for (Eigen::Index i = 0; i < a.cols(); ++i)
        sum += (t * Vector3d(a.col(i)) - mirrored.col(i)).squaredNorm();
      return sum;
    };
    for (int k = 0; k < 20; ++k) {
      const double size = k % 2 ? 0.05 : 2;
      CHECK(misfit(isometry(fitted) * exponential(random.twist(size, size))) >
            misfit(isometry(fitted)));
    }
  }
  // Half a turn exactly, and the identity.
  const Matrix3Xd a = random_points(random, 6, 1);
  for (const Vector3d& axis : {Vector3d(1, 0, 0), Vector3d(0, 1, 0), Vector3d(0, 0, 1),
                               Vector3d(1.0 / 3, 2.0 / 3, 2.0 / 3)}) {
    const Matrix3d r = 2 * axis * axis.transpose() - Matrix3d::Identity();
    CHECK(difference(fit_points(a, r * a), {r, Vector3d::Zero()}) < 1e-12);
  }
  CHECK(difference(fit_points(a, a), Pose()) < 1e-12);
}

TEST_CASE(
    "fit_points: points that do not determine a motion are mapped onto each other all the same") {
  Random random(2);
  for (int n = 0; n <= 4; ++n)
    for (int trial = 0; trial < (n == 0 ? 1 : 20); ++trial) {
      const Pose truth = random.pose(1, kPi);
      const Vector3d start = random.vector(1), direction = random.direction();
      Matrix3Xd a(3, n), b(3, n);
      for (int i = 0; i < n; ++i) {
        a.col(i) = start + (trial == 0 ? 0 : random.uniform(-1, 1)) *
                               direction;  // on a line, once all in one place
        b.col(i) = isometry(truth) * Vector3d(a.col(i));
      }
      const Pose t = fit_points(a, b);
      INFO(n << " points, trial " << trial);
      CHECK(is_rotation(t.rotation));
      CHECK(t.translation.allFinite());
      for (int i = 0; i < n; ++i)
        CHECK((isometry(t) * Vector3d(a.col(i)) - b.col(i)).norm() < 1e-9);
      CHECK(on_a_line(a));
    }
  Matrix3Xd bent(3, 4);
  bent << 0, 1, 2, 3, 0, 0, 0, 0, 0, 0, 0, 0;
  CHECK(on_a_line(bent));
  bent(1, 2) = 1e-8;
  CHECK(on_a_line(bent));
  bent(1, 2) = 1e-4;
  CHECK_FALSE(on_a_line(bent));
  CHECK_FALSE(on_a_line(random_points(random, 3, 1)));
}

TEST_CASE("points at given values") {
  const Rig rig = nasty_robot();
  Random random(3);
  const Rig other = moved(rig, {"*"}, random, 0.05, 0.3, 1, 0.05);
  const ParameterTable table(rig);
  const VectorXd values = ParameterTable(other).initial;
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    const Matrix3Xd points = target_points(rig, table, values, static_cast<int>(t));
    REQUIRE(points.cols() == rig.targets[t].count());
    for (int i = 0; i < rig.targets[t].count(); ++i)
      CHECK((points.col(i) - target_point(other.targets[t], i)).norm() < 1e-15);
  }
}

TEST_CASE("start_targets: every type of sensor alone tells where a free target is") {
  Rig rig = nasty_robot();
  Random random(4);
  const int body =
      add_points(rig, "body",
                 random_points(random, 9, 0.15));  // not flat, enough for a direct linear transform
  const int board = target_index(rig, "board");
  for (const int sensor : all_sensors(rig))
    for (const int target : {board, body}) {
      if (!pair_allowed(rig, sensor, target)) continue;
      const std::string& type = rig.sensors[sensor].type;
      INFO(rig.sensors[sensor].name << " sees " << rig.targets[target].name);
      int seen = 0;
      for (int trial = 0; trial < 40 && seen < 12; ++trial) {
        TruePosture p = random_posture(rig, random, 1.2, false);
        if (type == "chain")
          p.boards[target] = in_hand(rig, sensor, p, nullptr);
        else
          p.boards[target] =
              in_front(rig, sensor, target, p, random.uniform(0.5, 0.9), 1.0, random);
        if (type == "tilting_laser")
          p.boards[target] = p.boards[target] * exponential(random.twist(0.3, 1));
        Sample sample = make_sample(rig, p, "a");
        if (!add_view(sample, rig, sensor, target, p)) continue;
        ++seen;
        const Recording recording(rig, {sample});
        Values values;
        values.shared = recording.table.initial;
        start_targets(recording, {0}, {sensor}, {}, values);
        REQUIRE(values.targets.count({0, target}) == 1);
        INFO("trial " << trial);
        CHECK(difference(values.targets.at({0, target}), to_pose(p.boards[target])) < 1e-6);
      }
      CHECK(seen >= 6);
    }
}

TEST_CASE("start_targets: of a plane's two mirror solutions the right one, with noise too") {
  // A board of 20 cm, 0.6 to 1.2 m away, turned by up to 60 degrees: with 0.2 px the two solutions
  // can be told apart.
  Rig rig;
  Random random(5);
  add_link(rig, "base");
  add_camera(rig, "camera", "base", random.pose(1, 3));
  const int board = add_grid(rig, "board", 5, 6, 0.04);
  finish_tree(rig.tree);
  for (int trial = 0; trial < 200; ++trial) {
    TruePosture p = empty_posture(rig);
    p.boards[board] = in_front(rig, 0, board, p, random.uniform(0.6, 1.2), kPi / 3, random);
    if (trial % 2) {  // in view, but far off the axis
      Vector6d aside = Vector6d::Zero();
      aside.head<3>() = random.vector(0.3);
      p.boards[board] = p.boards[board] * exponential(aside);
    }
    Sample sample = make_sample(rig, p, "a");
    if (!add_view(sample, rig, 0, board, p, &random)) continue;
    const Recording recording(rig, {sample});
    Values values;
    values.shared = recording.table.initial;
    start_targets(recording, {0}, {0}, {}, values);
    INFO("trial " << trial);
    CHECK(difference(values.targets.at({0, board}), to_pose(p.boards[board])) < 0.05);
  }
}

TEST_CASE("start_targets: four or five points before one camera start in the least minimum") {
  // Corners of a board, and points in space, as far apart as a hand, 0.6 to 1.5 m away, with noise
  // that leaves no doubt about the pose.
  Rig rig;
  Random random(8);
  add_link(rig, "base");
  add_camera(rig, "camera", "base", random.pose(1, 3));
  Matrix3Xd corners(3, 5);
  corners << 0, 0.2, 0, 0.1, 0.05, 0, 0, 0.15, 0.1, 0.2, 0, 0, 0, 0.08, 0.02;
  const int board = add_grid(rig, "board", 5, 7, 0.04), body = add_points(rig, "body", corners);
  finish_tree(rig.tree);
  int views = 0, wrong = 0;
  for (int trial = 0; trial < 600; ++trial) {
    const int target = trial % 2 ? board : body, n = trial % 4 < 2 ? 4 : 5;
    TruePosture p = empty_posture(rig);
    p.boards[target] = in_front(rig, 0, target, p, random.uniform(0.6, 1.5), 1.4, random);
    std::vector<int> ids;
    while (static_cast<int>(ids.size()) < n) {
      const int id = static_cast<int>(random.uniform() * rig.targets[target].count());
      if (!std::count(ids.begin(), ids.end(), id)) ids.push_back(id);
    }
    Sample sample = make_sample(rig, p, "a");
    if (!add_view(sample, rig, 0, target, p, &random, ids)) continue;
    const Recording recording(rig, {sample});
    if (on_a_line(select_columns(
            target_points(rig, recording.table, recording.table.initial, target), ids)))
      continue;
    Values values;
    values.shared = recording.table.initial;
    start_targets(recording, {0}, {0}, {}, values);
    p.boards[target] = isometry(values.targets.at({0, target}));
    ++views;
    wrong += residual(rig, sample.views[0], p).squaredNorm() >
             50 * std::pow(rig.sensors[0].sigma[0], 2);  // chi2 of 2 or 4 degrees of freedom
  }
  CHECK(views > 500);
  CHECK(wrong == 0);
}

TEST_CASE("start_targets: two or three points before two cameras start in the least minimum") {
  // Two points, three on a line (which leave a turn open), three off it.
  Rig rig;
  Random random(9);
  add_link(rig, "base");
  const Pose left = random.pose(1, 3);
  Pose beside;
  beside.translation << 0.3, 0.02, 0.05;
  beside.rotation = exp_so3(Vector3d(0.02, -0.2, 0.05));
  add_camera(rig, "left", "base", left);
  add_camera(rig, "right", "base", left * beside);
  Matrix3Xd two(3, 2), line(3, 3), three(3, 3);
  two << 0, 0.2, 0, 0, 0, 0;
  line << 0, 0.1, 0.25, 0, 0, 0, 0, 0, 0;
  three << 0, 0.2, 0.05, 0, 0, 0.15, 0, 0, 0;
  const std::vector<int> targets = {add_points(rig, "two", two), add_points(rig, "line", line),
                                    add_points(rig, "three", three)};
  finish_tree(rig.tree);
  int views = 0, wrong = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const int target = targets[trial % 3];
    TruePosture p = empty_posture(rig);
    p.boards[target] = in_front(rig, 0, target, p, random.uniform(0.7, 1.5), 1.4, random);
    Sample sample = make_sample(rig, p, "a");
    if (!add_view(sample, rig, 0, target, p, &random) ||
        !add_view(sample, rig, 1, target, p, &random))
      continue;
    const Recording recording(rig, {sample});
    Values values;
    values.shared = recording.table.initial;
    start_targets(recording, {0}, {0, 1}, {}, values);
    p.boards[target] = isometry(values.targets.at({0, target}));
    ++views;
    double squared = 0;
    for (const View& v : sample.views) squared += residual(rig, v, p).squaredNorm();
    wrong += squared > 60 * std::pow(rig.sensors[0].sigma[0], 2);
  }
  CHECK(views > 150);
  CHECK(wrong == 0);
}

TEST_CASE("calibration: free targets that started wrong start anew where the cameras have gone") {
  // Three points have several poses before a camera; with the other camera's pose 3 cm and 2
  // degrees off the wrong one fits better in some samples.
  int wrong = 0;
  for (int seed = 0; seed < 12; ++seed) {
    ThreePoints of;
    Rig& rig = of.rig;
    const int body = 0, board = 1;
    Random random(100 + seed);
    std::vector<Sample> samples;
    while (samples.size() < 24) {
      const int target = samples.size() % 3 == 0 ? board : body;
      TruePosture p = empty_posture(rig);
      p.boards[target] = in_front(rig, 0, target, p, random.uniform(0.7, 1.3), 1.2, random);
      Sample sample = make_sample(rig, p, "s" + std::to_string(samples.size()));
      if (add_view(sample, rig, 0, target, p, &random) &&
          add_view(sample, rig, 1, target, p, &random))
        samples.push_back(sample);
    }
    rig.sensors[1].link_T_sensor = of.left_T_right * random.pose(0.03, 0.035);
    const Solution solution = calibrate(make_recording(rig, samples), {});
    INFO("seed " << seed << ", chi2/dof " << solution.chi2_per_dof());
    CHECK(solution.status == Status::converged);
    CHECK(solution.steps[0].chi2_initial > solution.chi2);
    wrong += solution.chi2_per_dof() > 1.5;
  }
  CHECK(wrong == 0);
}

namespace {

/// 5 x 6 points, in a plane but for as much.
Matrix3Xd nearly_flat_points(Random& random, double height) {
  Matrix3Xd p(3, 30);
  for (int i = 0; i < 30; ++i) {
    const int row = i / 6;
    p.col(i) << 0.05 * (i % 6), 0.05 * row, height * random.normal();
  }
  return p;
}

}  // namespace

TEST_CASE("start_targets: points that are nearly in a plane start on the right side of it") {
  for (const double height : {1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3})
    for (unsigned long seed = 1; seed <= 20; ++seed) {
      Random random(seed);
      Rig rig;
      add_link(rig, "base");
      finish_tree(rig.tree);
      const int camera = add_camera(rig, "camera", "base", Pose());
      const int target = add_points(rig, "target", nearly_flat_points(random, height));
      TruePosture p = empty_posture(rig);
      p.boards[target] = in_front(rig, camera, target, p, 0.8, 0.8, random);
      Sample sample = make_sample(rig, p, "s");
      if (!add_view(sample, rig, camera, target, p, &random)) continue;
      const Recording recording(rig, {sample});
      Values values;
      values.shared = recording.table.initial;
      start_targets(recording, {0}, {camera}, {}, values);
      INFO("height " << height << ", seed " << seed);
      const Pose found = values.targets.at({0, target});
      CHECK(log_so3(found.rotation.transpose() * p.boards[target].linear()).norm() < 0.05);
    }
}

TEST_CASE("pose_from_rays: points that are nearly in a plane, two a view") {
  for (const double height : {1e-5, 1e-4, 3e-4, 1e-3, 1e-2})
    for (unsigned long seed = 1; seed <= 20; ++seed) {
      Random random(seed);
      const Matrix3Xd points = nearly_flat_points(random, height);
      const Pose truth = random.pose(0.5, kPi);
      Matrix3Xd p(3, 60), o(3, 60), d(3, 60);
      for (int i = 0; i < 60; ++i) {
        if (i % 2 == 0) o.col(i) = truth * Vector3d(random.vector(0.4) + Vector3d(0, 0, 1));
        if (i % 2 == 1) o.col(i) = o.col(i - 1);
        p.col(i) = points.col((7 * i) % 30);
        d.col(i) = (truth * Vector3d(p.col(i)) - o.col(i)).normalized() + random.vector(0.0005);
      }
      Pose found;
      INFO("height " << height << ", seed " << seed);
      REQUIRE(pose_from_rays(p, o, d, found));
      CHECK(log_so3(found.rotation.transpose() * truth.rotation).norm() < 0.02);
    }
}

TEST_CASE("start_targets: a fisheye that sees a board beside and behind itself") {
  for (const double angle : {60.0, 86.0, 89.0, 92.0, 100.0, 130.0}) {
    Random random(static_cast<unsigned long>(angle));
    Rig rig;
    add_link(rig, "base");
    finish_tree(rig.tree);
    const int camera = add_camera(rig, "camera", "base", Pose(), Lens::kannala_brandt,
                                  {0.01, -0.003, 0.0005, -0.00005});
    const int board = add_grid(rig, "board", 4, 5, 0.05);
    const double a = angle * kPi / 180;
    const Pose sensor_T_board = Pose{exp_so3({0, a, 0}), Vector3d::Zero()} *
                                Pose{exp_so3({0.2, 0.3, 0}), {-0.1, -0.08, 0.8}};
    TruePosture p = empty_posture(rig);
    p.boards[board] = isometry(sensor_T_board);
    View view;
    view.sensor = camera;
    view.target = board;
    view.sigma = rig.sensors[camera].sigma;
    for (int id = 0; id < 20; ++id) {
      Eigen::Vector2d pixel;
      REQUIRE(project(rig.sensors[camera],
                      isometry(sensor_T_board) * target_point(rig.targets[board], id), pixel));
      view.ids.push_back(id);
      view.z.push_back(pixel.x() + 0.1 * random.normal());
      view.z.push_back(pixel.y() + 0.1 * random.normal());
    }
    Sample sample = make_sample(rig, p, "s");
    sample.views = {view};
    const Recording recording(rig, {sample});
    Values values;
    values.shared = recording.table.initial;
    INFO(angle << " degrees");
    REQUIRE_NOTHROW(start_targets(recording, {0}, {camera}, {}, values));
    const Pose found = values.targets.at({0, board});
    CHECK(log_so3(found.rotation.transpose() * sensor_T_board.rotation).norm() < 0.02);
    CHECK((found.translation - sensor_T_board.translation).norm() < 0.02);
  }
}

TEST_CASE("start_targets: one to five points, seen by anything, crash nothing") {
  Rig rig = nasty_robot();
  const int board = target_index(rig, "board"), probe = target_index(rig, "probe");
  Random random(6);
  for (const int sensor : all_sensors(rig))
    for (int n = 1; n <= 5; ++n)
      for (const int target : {board, probe})
        for (int trial = 0; trial < 12; ++trial) {
          if (!pair_allowed(rig, sensor, target) || rig.sensors[sensor].type == "chain" ||
              rig.sensors[sensor].type == "pose")
            continue;
          TruePosture p = random_posture(rig, random, 1, false);
          p.boards[target] = in_front(rig, sensor, target, p, 0.7, 0.8, random);
          std::vector<int> ids;
          for (int i = 0; i < n; ++i)
            ids.push_back(target == board ? (trial == 0 ? i % 4 : (3 * i + trial) % 12)
                                          : i % 4);  // trial 0: on a line
          std::sort(ids.begin(), ids.end());
          ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
          Sample sample = make_sample(rig, p, "a");
          if (!add_view(sample, rig, sensor, target, p, nullptr, ids)) continue;
          const Recording recording(rig, {sample});
          Values values;
          values.shared = recording.table.initial;
          INFO(rig.sensors[sensor].name << ", " << ids.size() << " points of "
                                        << rig.targets[target].name << ", trial " << trial);
          CHECK_NOTHROW(start_targets(recording, {0}, {sensor}, {},
                                      values));  // three of four on a line, all on a line, ...
          if (!values.targets.count({0, target})) continue;
          const Pose found = values.targets.at({0, target});
          CHECK(is_rotation(found.rotation));
          CHECK(found.translation.allFinite());
          // Points in space are where they were seen, however few.
          if (rig.sensors[sensor].type != "point") continue;
          p.boards[target] = isometry(found);
          CHECK(residual(rig, sample.views[0], p).cwiseAbs().maxCoeff() < 1e-6);
        }
}

TEST_CASE(
    "start_targets: several targets and sensors in many samples, held out ones too, a bad sensor "
    "does not decide") {
  Rig rig = nasty_robot();
  Random random(7);
  std::vector<TruePosture> postures;
  const int board = target_index(rig, "board"), probe = target_index(rig, "probe"),
            tracker = sensor_index(rig, "tracker"), depth = sensor_index(rig, "depth"),
            mocap = sensor_index(rig, "mocap");
  std::vector<Sample> samples;
  for (int k = 0; k < 6; ++k) {
    TruePosture p = random_posture(rig, random, 1, false);
    for (const int target : {board, probe})
      p.boards[target] = in_front(rig, depth, target, p, 0.8, 0.8, random);
    Sample s = make_sample(rig, p, "s" + std::to_string(k));
    for (const int target : {board, probe})
      for (const int sensor : {tracker, depth, mocap}) REQUIRE(add_view(s, rig, sensor, target, p));
    for (View& v : s.views)
      if (v.sensor == mocap) v.z[0] += 0.5;  // half a metre off
    samples.push_back(s);
    postures.push_back(p);
  }
  const Recording recording(rig, samples);
  Values values;
  values.shared = recording.table.initial;
  start_targets(recording, {1, 3, 4}, {tracker, depth, mocap}, {LossKind::cauchy, 2}, values);
  CHECK(values.targets.size() == 6);
  for (const int s : {1, 3, 4})
    for (const int target : {board, probe})
      CHECK(difference(values.targets.at({s, target}), to_pose(postures[s].boards.at(target))) <
            0.01);
}

TEST_CASE("start_targets: a pose that is there already stays if it can be evaluated") {
  const Rig rig = nasty_robot();
  Random random(8);
  const int board = target_index(rig, "board"), camera = sensor_index(rig, "bc5");
  TruePosture p = random_posture(rig, random, 1, false);
  p.boards[board] = in_front(rig, camera, board, p, 0.8, 0.8, random);
  Sample sample = make_sample(rig, p, "a");
  REQUIRE(add_view(sample, rig, camera, board, p));
  const Recording recording(rig, {sample});
  Values values;
  values.shared = recording.table.initial;
  const Pose near_by = to_pose(p.boards[board] * exponential(random.twist(0.02, 0.05)));
  values.targets[{0, board}] = near_by;
  start_targets(recording, {0}, {camera}, {}, values);
  CHECK(difference(values.targets.at({0, board}), near_by) < 1e-12);
  // Behind the camera: as good as none.
  Isometry3d behind = Isometry3d::Identity();
  behind.translation().z() = -1;
  values.targets[{0, board}] =
      to_pose(root_T_link(rig, rig.base, p).inverse() * root_T_sensor(rig, camera, p) * behind);
  start_targets(recording, {0}, {camera}, {}, values);
  CHECK(difference(values.targets.at({0, board}), to_pose(p.boards[board])) < 1e-6);
}

TEST_CASE("unknown poses: eye in hand, camera and mounted board") {
  for (unsigned long seed = 1; seed <= 12; ++seed) {
    INFO("seed " << seed);
    const Unknown u = eye_in_hand(seed, false);
    REQUIRE(u.samples.size() >= 5);
    const auto found = u.find();
    CHECK(found.lost.empty());
    CHECK(found.worst < 1e-6);
    CHECK(eye_in_hand(seed, true).find().worst < 0.05);
  }
}

TEST_CASE("unknown poses: eye to hand, camera and board on the tool") {
  for (unsigned long seed = 1; seed <= 12; ++seed)
    for (const bool fisheye : {false, true}) {
      INFO("seed " << seed << (fisheye ? ", fisheye" : ""));
      const Unknown u = eye_to_hand(seed, false, fisheye);
      REQUIRE(u.samples.size() >= 5);
      const auto found = u.find();
      CHECK(found.lost.empty());
      CHECK(found.worst < 1e-6);
    }
}

TEST_CASE("unknown poses: only one of the two") {
  for (unsigned long seed = 21; seed <= 26; ++seed)
    for (const char* name : {"sensor/camera/pose", "target/board/pose"})
      for (const bool in_the_hand : {false, true}) {
        Unknown u = in_the_hand ? eye_in_hand(seed, false) : eye_to_hand(seed, false);
        u.names = {name};
        const auto found = u.find();
        INFO("seed " << seed << ", " << name);
        CHECK(found.lost.empty());
        CHECK(found.worst < 1e-6);
      }
}

TEST_CASE("unknown poses: camera and hand, with a free board") {
  for (unsigned long seed = 1; seed <= 12; ++seed) {
    INFO("seed " << seed);
    const Unknown u = hand_and_cameras(seed, 1, false, false);
    REQUIRE(u.samples.size() >= 5);
    const auto found = u.find();
    CHECK(found.lost.empty());
    CHECK(found.worst < 1e-6);
    CHECK(hand_and_cameras(seed, 1, false, true).find().worst < 0.06);
  }
}

TEST_CASE("unknown poses: two cameras, hand known, four cameras and the hand, nothing known") {
  for (unsigned long seed = 1; seed <= 8; ++seed) {
    INFO("seed " << seed);
    const auto stereo = hand_and_cameras(seed, 2, true, false).find();
    CHECK(stereo.lost.empty());
    CHECK(stereo.worst < 1e-6);
    const auto many = hand_and_cameras(seed, 4, false, false).find();
    CHECK(many.lost.empty());
    CHECK(many.worst < 1e-6);
  }
}

TEST_CASE(
    "unknown poses: a tilting laser, by a wall that is known, and by free boards that a hand "
    "holds") {
  int walls = 0, hands = 0;
  for (unsigned long seed = 1; seed <= 60 && (walls < 6 || hands < 6); ++seed) {
    Random random(seed);
    Unknown u;
    u.truth = arm();
    const int laser =
        add_laser(u.truth, "laser", "laser", random.pose(1, kPi), "scan", {0.001, 0.001, 0.003});
    const int wall =
        add_grid(u.truth, "wall", 4, 5, 0.2, "base", at({2, 0.3, 1}, {-1.3, 0.2, -1.4}));
    const int board = add_grid(u.truth, "board", 4, 5, 0.06),
              hand = add_chain(u.truth, "hand", "tool", random.pose(0.3, kPi), 0.001, 0.002);
    Unknown v = u;
    for (int k = 0; k < 10; ++k) {
      TruePosture p = random_posture(u.truth, random, 0.8, false);
      u.add(p, {{laser, wall}});
      p.boards[board] = in_hand(v.truth, hand, p, nullptr);
      v.add(p, {{hand, board}, {laser, board}});
    }
    u.names = v.names = {"sensor/laser/pose"};
    const auto rays = [&](const Unknown& x) {
      int n = 0;
      for (const Sample& s : x.samples)
        for (const View& view : s.views) n += view.sensor == laser;
      return n;
    };
    INFO("seed " << seed);
    if (rays(u) >= 5) {
      ++walls;
      const auto found = u.find();
      CHECK(found.lost.empty());
      CHECK(found.worst < 1e-6);
    }
    if (rays(v) >= 5) {
      ++hands;
      const auto found = v.find();
      CHECK(found.lost.empty());
      CHECK(found.worst < 1e-6);
    }
  }
  CHECK(walls >= 6);
  CHECK(hands >= 6);
}

// Proves: a laser and another sensor, neither of which the rig places, start from the boards that
// both see (exactly without noise, near with it), on a head whose axes meet nowhere; boards that
// stay in one plane before the other sensor place nothing. Does not prove: outliers among them.
TEST_CASE("unknown poses: a tilting laser and a camera or a tracker, by free boards") {
  const auto head = [](unsigned long seed, bool tracks, bool noise) {
    Random random(seed);
    Unknown u;
    add_link(u.truth, "base");
    add_joint(u.truth, JointType::revolute, "pan", "base", "neck", {0, 0, 1}, at({0.05, 0, 0.4}));
    add_joint(u.truth, JointType::revolute, "tilt", "neck", "face", {0, 1, 0}, at({0.03, 0, 0.1}));
    add_joint(u.truth, JointType::revolute, "nod", "base", "nodder", {0, 1, 0}, at({0.1, 0, 0.1}));
    finish_tree(u.truth.tree);
    const Pose mount = at(random.vector(0.1), {-1.6, 0.1, -1.5});
    const int other = tracks ? add_tracker(u.truth, "other", "face", mount, {1e-3, 1e-3, 1e-3})
                             : add_camera(u.truth, "other", "face", mount);
    const int laser = add_laser(u.truth, "laser", "nodder", random.pose(0.05, 0.15), "nod",
                                {0.0005, 0.001, 0.004});
    const int board = add_grid(u.truth, "board", 4, 5, 0.1);
    for (int k = 0; k < 20; ++k) {
      TruePosture p = random_posture(u.truth, random, 0.4, noise);
      p.boards[board] = Isometry3d::Identity();
      p.boards[board].translation() =
          Vector3d(random.uniform(1.5, 2.5), random.uniform(-0.6, 0.6), random.uniform(0, 0.8));
      p.boards[board].linear() =
          (Eigen::AngleAxisd(random.uniform(-0.5, 0.5), Vector3d::UnitX()) *
           Eigen::AngleAxisd(-1.57 + random.uniform(-0.5, 0.5), Vector3d::UnitY()))
              .toRotationMatrix();
      u.add(p, {{laser, board}, {other, board}}, noise ? &random : nullptr);
    }
    u.names = {"sensor/other/pose", "sensor/laser/pose"};
    return u;
  };
  for (unsigned long seed = 1; seed <= 8; ++seed)
    for (const bool tracks : {false, true}) {
      INFO("seed " << seed << (tracks ? ", tracker" : ", camera"));
      const Unknown u = head(seed, tracks, false);
      REQUIRE(u.samples.size() >= 8);
      auto found = u.find();
      CHECK(found.lost.empty());
      CHECK(found.ambiguous.empty());
      CHECK(found.worst < 1e-6);
      found = head(seed, tracks, true).find();
      CHECK(found.lost.empty());
      CHECK(found.worst < 0.1);
    }
  std::vector<PointOfTwo> flat;
  Random random(1);
  for (int k = 0; k < 20; ++k)
    flat.push_back({random.vector(1), {random.uniform(-1, 1), random.uniform(-1, 1), 2}, Pose()});
  Pose y;
  CHECK(!two_poses_by_points(flat, y));
}

TEST_CASE(
    "unknown poses: a tracker of points, by a body on the tool, by one reflector, and with the "
    "body unknown too") {
  for (unsigned long seed = 1; seed <= 10; ++seed) {
    Random random(seed);
    Unknown u;
    u.truth = arm();
    const int tracker =
        add_tracker(u.truth, "tracker", "base", random.pose(1, kPi), {1e-4, 1e-4, 1e-4});
    const int body =
        add_points(u.truth, "body", random_points(random, 4, 0.2), "tool", random.pose(0.3, kPi));
    const int reflector =
        add_points(u.truth, "reflector", Eigen::Vector3d(0.03, 0.02, 0.1), "tool", Pose());
    Unknown one = u;
    for (int k = 0; k < 12; ++k) {
      const TruePosture p = random_posture(u.truth, random, 1, false);
      u.add(p, {{tracker, body}});
      one.add(p, {{tracker, reflector}});
    }
    INFO("seed " << seed);
    u.names = {"sensor/tracker/pose"};
    auto found = u.find();
    CHECK(found.lost.empty());
    CHECK(found.worst < 1e-6);
    u.names = {"sensor/tracker/pose", "target/body/pose"};
    found = u.find();
    CHECK(found.lost.empty());
    CHECK(found.worst < 1e-6);
    one.names = {"sensor/tracker/pose"};
    found = one.find();
    CHECK(found.lost.empty());
    CHECK(found.worst < 1e-6);
  }
}

namespace {

/// A tracker on the base and one reflector on the tool, both poses at random.
Unknown tracker_and_reflector(unsigned long seed, int samples, bool noise) {
  Random random(seed);
  Unknown u;
  u.truth = arm();
  const int tracker =
      add_tracker(u.truth, "tracker", "base", random.pose(1.5, kPi), {1e-4, 1e-4, 1e-4});
  const int reflector = add_points(u.truth, "reflector", Vector3d::Zero(), "tool",
                                   {Matrix3d::Identity(), random.vector(0.2)});
  for (JointSettings& j : u.truth.joints) j.sigma = 1e-4;
  for (int k = 0; k < samples; ++k)
    u.add(random_posture(u.truth, random, 1.5, noise), {{tracker, reflector}},
          noise ? &random : nullptr);
  u.names = {"sensor/tracker/pose", "target/reflector/pose"};
  return u;
}

}  // namespace

TEST_CASE("unknown poses: a tracker and its reflector, both unknown, in 40 sets of 10 samples") {
  for (unsigned long seed = 1; seed <= 40; ++seed)
    for (const bool noise : {false, true}) {
      INFO("seed " << seed);
      const auto found = tracker_and_reflector(seed, 10, noise).find();
      CHECK(found.lost.empty());
      CHECK(found.ambiguous.empty());
      CHECK(found.worst < (noise ? 0.01 : 1e-6));
    }
}

TEST_CASE("unknown poses: several solutions for a tracker and its reflector are said to be there") {
  const auto found = tracker_and_reflector(3, 3, false).find();  // nine numbers, nine unknowns
  CHECK(found.lost.empty());
  REQUIRE(found.ambiguous.size() == 1);
  CHECK(found.ambiguous[0].first == "sensor/tracker/pose");
  CHECK(found.ambiguous[0].second == "target/reflector/pose");
  // Of two samples nothing places the tracker; the reflector starts where the tracker then sees it.
  CHECK(tracker_and_reflector(3, 2, false).find().lost.size() == 1);
}

TEST_CASE("calibration: a tracker and its reflector without poses end right, without warnings") {
  for (unsigned long seed = 1; seed <= 3; ++seed) {
    const Unknown u = tracker_and_reflector(seed, 20, true);
    const Report report = study_of(u.given(), u.samples);
    INFO("seed " << seed);
    CHECK(report.solution.status == Status::converged);
    CHECK(report.solution.chi2 < 2 * static_cast<double>(report.solution.dof));
    CHECK((report.solution.pose("sensor/tracker/pose").translation -
           u.truth.sensors[0].link_T_sensor.translation)
              .norm() < 0.005);
    for (const Notice& w : report.warnings) {
      CHECK(w.kind != NoticeKind::no_start);
      CHECK(w.kind != NoticeKind::moved);
      CHECK(w.kind != NoticeKind::ambiguous_start);
    }
  }
}

TEST_CASE("unknown poses: a robot that only slides, or slides and turns about one axis") {
  for (const bool turns : {false, true})
    for (unsigned long seed = 1; seed <= 5; ++seed) {
      Random random(seed);
      Unknown u;
      add_link(u.truth, "base");
      add_joint(u.truth, JointType::prismatic, "x", "base", "bridge", {1, 0, 0}, at({0, 0, 1}));
      add_joint(u.truth, JointType::prismatic, "y", "bridge", "cart", {0, 1, 0}, Pose());
      add_joint(u.truth, turns ? JointType::revolute : JointType::prismatic, "z", "cart", "tool",
                {0, 0, 1}, Pose());
      finish_tree(u.truth.tree);
      const int camera = add_camera(u.truth, "camera", "tool", random.pose(0.2, kPi)),
                board = add_grid(u.truth, "board", 5, 6, 0.06);
      const TruePosture middle = empty_posture(u.truth);
      u.truth.targets[board].link_T_target =
          to_pose(in_front(u.truth, camera, board, middle, 1, 0.5, random));
      u.truth.targets[board].link = link_index(u.truth, "base");
      for (int k = 0; k < 15; ++k)
        u.add(random_posture(u.truth, random, 0.8, false), {{camera, board}}, &random);
      if (u.samples.size() < 6) continue;  // the others do not see the whole board
      Rig rig = u.truth;
      rig.sensors[camera].link_T_sensor = rig.targets[board].link_T_target = Pose();
      rig.sensors[camera].pose_given = rig.targets[board].pose_given = false;
      Step step;
      step.name = "all";
      step.sensors = {camera};
      step.free = {"sensor/camera/pose", "target/board/pose"};
      rig.steps = {step};
      const Solution solution = solution_of(rig, u.samples);
      INFO("seed " << seed << (turns ? ", turns" : ", slides"));
      CHECK(solution.lost_starts.empty());
      CHECK(solution.status == Status::unobservable);  // where it is along the axis, or at all
      CHECK(solution.chi2 < 1.3 * static_cast<double>(solution.dof));
      CHECK(solution.steps[0].iterations < 10);
      CHECK((solution.pose("sensor/camera/pose").rotation -
             u.truth.sensors[camera].link_T_sensor.rotation)
                .norm() < 0.02);
    }
}

TEST_CASE("unknown poses: of a robot that only slides, the same at every size") {
  Random random(1);
  const Pose x = random.pose(0.3, kPi), y = random.pose(1, kPi);
  std::vector<Vector3d> slides;
  for (int k = 0; k < 10; ++k) slides.push_back(random.pose(0.5, kPi).translation);
  const auto start_at = [&](double size) {  // A X = Y B
    const auto scaled = [&](const Pose& p) { return Pose{p.rotation, size * p.translation}; };
    std::vector<Pose> a, b;
    for (const Vector3d& slide : slides) {
      a.push_back(at(size * slide));
      b.push_back(inverse(scaled(y)) * a.back() * scaled(x));
    }
    Pose found;
    const auto start = robot_world_hand_eye_by_points(a, b, found);
    REQUIRE(start.has_value());
    return std::make_pair(Vector3d(start->x.translation / size),
                          Vector3d(found.translation / size));
  };
  const auto [x_of_one, y_of_one] = start_at(1);
  for (const double size : {0.005, 0.05, 50.0}) {
    const auto [of_x, of_y] = start_at(size);
    CHECK((of_x - x_of_one).norm() < 1e-6);
    CHECK((of_y - y_of_one).norm() < 1e-6);
  }
}

TEST_CASE("unknown poses: motion capture and a depth camera that see a board in the hand") {
  for (unsigned long seed = 1; seed <= 6; ++seed) {
    Random random(seed);
    Unknown u;
    u.truth = arm();
    const int mocap = add_mocap(u.truth, "mocap", "base", random.pose(1, kPi), 0.001, 0.002);
    const int depth =
        add_tracker(u.truth, "depth", "neck", random.pose(1, kPi), {0.001, 0.001, 0.001});
    const int board = add_grid(u.truth, "board", 4, 5, 0.06),
              hand = add_chain(u.truth, "hand", "tool", random.pose(0.5, kPi), 0.001, 0.002);
    for (int k = 0; k < 10; ++k) {
      TruePosture p = random_posture(u.truth, random, 1, false);
      p.boards[board] = in_hand(u.truth, hand, p, nullptr);
      u.add(p, {{mocap, board}, {depth, board}, {hand, board}});
    }
    for (const std::vector<std::string>& names : std::vector<std::vector<std::string>>{
             {"sensor/mocap/pose"},
             {"sensor/mocap/pose", "sensor/depth/pose"},
             {"sensor/hand/pose"},
             {"sensor/mocap/pose", "sensor/depth/pose", "sensor/hand/pose"}}) {
      u.names = names;
      INFO("seed " << seed << ", " << names.size() << " unknown");
      const auto found = u.find();
      CHECK(found.lost.empty());
      CHECK(found.worst < 1e-6);
    }
  }
}

TEST_CASE("unknown poses: what nothing ties to the rest is returned by name") {
  Random random(9);
  Unknown u = hand_and_cameras(3, 2, true, false);
  const int alone = add_camera(u.truth, "alone", "base", random.pose(1, 2)),
            blind = add_camera(u.truth, "blind", "neck", random.pose(1, 2));
  const int loose = add_grid(u.truth, "loose", 4, 5, 0.06);
  const int dark = add_grid(u.truth, "dark", 4, 5, 0.06, "tool", random.pose(1, 2));
  (void)blind;
  (void)dark;
  for (size_t k = 0; k < u.samples.size(); ++k) {
    u.postures[k].boards[loose] = in_front(u.truth, alone, loose, u.postures[k], 1, 0.6, random);
    REQUIRE(add_view(u.samples[k], u.truth, alone, loose, u.postures[k]));
  }
  // `alone` sees only a free board that nobody else sees, `blind` nothing; `dark` is seen by
  // nobody.
  u.names = {"sensor/camera0/pose", "sensor/alone/pose", "sensor/camera1/pose", "sensor/blind/pose",
             "target/dark/pose"};
  auto found = u.find();
  std::sort(found.lost.begin(), found.lost.end());
  CHECK(found.lost ==
        std::vector<std::string>{"sensor/alone/pose", "sensor/blind/pose", "target/dark/pose"});
  CHECK(found.worst < 1e-6);
}

TEST_CASE("starts: a sensor whose views tell no pose is said to be the reason") {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "pan", "base", "tool", {0, 0, 1}, at({0, 0, 0.5}));
  finish_tree(rig.tree);
  const int gauge = add_sensor(rig, "gauge", "height", "base", at({0, 0, 0.2}),
                               std::make_shared<PointwiseSensor<Height>>(), {0.001});
  add_grid(rig, "board", 3, 4, 0.1);
  add_grid(rig, "plate", 3, 4, 0.1, "tool", at({0.3, 0, 0}, {0.3, 0.2, 0}));
  std::vector<Sample> samples(3);
  for (size_t k = 0; k < samples.size(); ++k) {
    samples[k].id = "s" + std::to_string(k);
    samples[k].readings = {0.2 * static_cast<double>(k)};
    View view;
    view.sensor = gauge;
    view.target = target_index(rig, "plate");
    view.ids = {0, 5, 11};
    view.z = {0.3, 0.3, 0.3};
    view.sigma = {0.001};
    samples[k].views = {view};
  }
  Step step;
  step.name = "all";
  step.sensors = {gauge};
  step.free = {"sensor/gauge/pose"};
  rig.steps = {step};

  Rig absent = rig;
  absent.sensors[0].pose_given = false;
  const Report report = study_of(absent, samples);
  std::string words;
  for (const Notice& w : report.warnings)
    if (w.kind == NoticeKind::no_start) words += sentences(w);
  CHECK_THAT(
      words,
      Catch::Matchers::Contains(
          "sensor/gauge/pose is missing in the rig and a sensor of type height gives no pose"));

  for (Sample& sample : samples) sample.views[0].target = target_index(rig, "board");
  const Solution solution = solution_of(rig, samples);
  CHECK(solution.status == Status::undefined_start);
  CHECK_THAT(solution.message,
             Catch::Matchers::Contains(
                 "target 'board': the sensors that see it (height) do not determine its pose"));
}

TEST_CASE(
    "samples_to_start: enough views of each pair, spread over all samples, also of what is rarely "
    "seen") {
  Rig rig;
  add_link(rig, "base");
  finish_tree(rig.tree);
  std::vector<Sample> samples;
  for (int i = 0; i < 4000; ++i) {
    Sample sample;
    View view;
    view.sensor = i % 2;
    view.target = 0;
    sample.views.push_back(view);
    if (i % 10 == 7) {
      view.sensor = 2;
      sample.views.push_back(view);
    }
    if (i % 900 == 13) {  // five times
      view.target = 1;
      sample.views.push_back(view);
    }
    samples.push_back(sample);
  }
  const Recording recording(rig, samples);
  const std::vector<int> all = indices(recording.samples.size()),
                         few(all.begin(), all.begin() + 150);
  CHECK(samples_to_start(recording, few) == few);
  const std::vector<int> some = samples_to_start(recording, all);
  CHECK(some.size() <= 3 * kEnoughViews + 5);
  CHECK(std::is_sorted(some.begin(), some.end()));
  CHECK(std::adjacent_find(some.begin(), some.end()) == some.end());
  std::map<std::pair<int, int>, int> seen;
  std::vector<int> by_tenth(10, 0);
  for (const int i : some) {
    ++by_tenth[i / 400];
    for (const View& v : recording.samples[i].views) ++seen[{v.sensor, v.target}];
  }
  for (const int sensor : {0, 1, 2}) CHECK(seen[{sensor, 0}] >= kEnoughViews);
  CHECK(seen[{0, 1}] + seen[{1, 1}] + seen[{2, 1}] == 5);
  for (const int count : by_tenth) {
    CHECK(count > some.size() / 20.0);
    CHECK(count < some.size() / 5.0);
  }
}

TEST_CASE("calibration: where views of three points leave a pose without start, that is said") {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "pan", "base", "arm", {0, 0, 1}, at({0, 0, -1.2}));
  add_joint(rig, JointType::revolute, "tilt", "arm", "tool", {0, 1, 0}, at({0.3, 0, 0}));
  finish_tree(rig.tree);
  const int camera = add_camera(rig, "camera", "base", at({0, 0, 0}, {kPi, 0, 0}));
  Matrix3Xd corners(3, 4);
  corners << 0, 0.2, 0, 0.1, 0, 0, 0.15, 0.1, 0, 0, 0, 0.08;
  const int body = add_points(rig, "body", corners, "tool", at({0.1, 0, 0}, {0.3, 0.2, 0}));
  Step step;
  step.name = "all";
  step.sensors = {camera};
  step.free = {"sensor/camera/pose", "target/body/pose"};
  rig.steps = {step};
  for (const bool four : {false, true}) {
    std::vector<Sample> samples;
    for (int k = 0; k < 8; ++k) {
      TruePosture p = empty_posture(rig);
      p.readings[0] = 0.7 * k;
      p.readings[1] = 0.4 * (k % 3 - 1);
      Sample sample = make_sample(rig, p, "s" + std::to_string(k));
      REQUIRE(add_view(sample, rig, camera, body, p, nullptr,
                       four ? std::vector<int>{0, 1, 2, 3} : std::vector<int>{0, 1, 2}));
      samples.push_back(sample);
    }
    Rig absent = rig;
    absent.sensors[0].pose_given = absent.targets[0].pose_given = false;
    const Solution solution = solution_of(absent, samples);
    CHECK(solution.lost_starts.empty() == four);
    if (four) continue;
    Solution ended = solution;
    ended.status = Status::converged;  // (the solver finds the way here)
    CHECK(lost_start_text(ended, "sensor/camera/pose").empty());
    ended.status = Status::not_converged;
    CHECK_THAT(lost_start_text(ended, "sensor/camera/pose"),
               Catch::Matchers::Contains("is missing in the rig and is seen only by views of at "
                                         "most three points, and each view fits several poses"));
    CHECK_THAT(lost_start_text(ended, "sensor/that_sees_nothing/pose"),
               Catch::Matchers::Contains("nothing with a known pose ties it down"));
  }
}

TEST_CASE("calibration: absent poses end in the same optimum as given ones") {
  for (unsigned long seed = 41; seed <= 43; ++seed) {
    const Unknown u = hand_and_cameras(seed, 2, false, true);
    double chi2[2];
    std::vector<double> values[2];
    for (const int absent : {0, 1}) {
      Rig rig = absent ? u.given() : u.truth;
      for (Joint& j : rig.tree.joints) CHECK(j.type != JointType::floating);
      for (JointSettings& j : rig.joints) j.sigma = 0.0005;
      Step step;
      step.name = "all";
      step.sensors = all_sensors(rig);
      step.free = {"sensor/*/pose"};
      step.free_where = {"test"};
      rig.steps = {step};
      // Of camera and hand with a free board everything is determined but nothing else.
      const Solution result = calibrate(make_recording(rig, u.samples), {});
      CHECK(result.status == Status::converged);
      chi2[absent] = result.chi2;
      for (const ParameterEstimate& p : result.parameters) {
        REQUIRE(p.pose);
        values[absent].insert(values[absent].end(), p.pose->rotation.data(),
                              p.pose->rotation.data() + 9);
        values[absent].insert(values[absent].end(), p.pose->translation.data(),
                              p.pose->translation.data() + 3);
        CHECK(p.name.find("/pose") != std::string::npos);
      }
    }
    INFO("seed " << seed);
    CHECK(std::abs(chi2[0] / chi2[1] - 1) < 1e-8);
    REQUIRE(values[0].size() == values[1].size());
    for (size_t i = 0; i < values[0].size(); ++i)
      CHECK(std::abs(values[0][i] - values[1][i]) < 1e-6);
  }
}

namespace {

/// A solution of one step that frees these.
Report study_freeing(Rig rig, const std::vector<Sample>& samples,
                     const std::vector<std::string>& free) {
  Step step;
  step.name = "all";
  step.sensors = all_sensors(rig);
  step.free = free;
  rig.steps = {step};
  return study_of(std::move(rig), samples);
}

bool warns_of(const Report& report, const std::string& id) {
  return std::any_of(report.warnings.begin(), report.warnings.end(),
                     [&](const Notice& w) { return kincal::id(w.kind) == id; });
}

}  // namespace

TEST_CASE("calibration: a given pose that the data contradict is left for where they put it") {
  const std::vector<std::string> free = {"sensor/camera/pose", "target/board/pose"};
  for (unsigned long seed = 51; seed <= 54; ++seed) {
    const Unknown u = eye_in_hand(seed, true);
    const Report right = study_freeing(u.truth, u.samples, free);
    REQUIRE(right.solution.status == Status::converged);
    CHECK(right.solution.replaced_starts.empty());
    for (const Vector3d& turn : {Vector3d(kPi, 0, 0), Vector3d(0, kPi, 0), Vector3d(0, 0, kPi),
                                 Vector3d(kPi / 2, 0, 0), Vector3d(0, 0, -kPi / 2)}) {
      Rig rig = u.truth;
      rig.sensors[0].link_T_sensor =
          rig.sensors[0].link_T_sensor * Pose{exp_so3(turn), Vector3d::Zero()};
      INFO("seed " << seed << ", turned by " << turn.transpose());
      const Report wrong = study_freeing(rig, u.samples, free);
      CHECK(wrong.solution.status == Status::converged);
      CHECK(wrong.solution.chi2 == Approx(right.solution.chi2).epsilon(1e-6));
      CHECK((wrong.solution.pose("sensor/camera/pose").rotation -
             right.solution.pose("sensor/camera/pose").rotation)
                .norm() < 1e-4);
      // Estimates count from the given pose; where no iteration found the way, a warning says so.
      CHECK(wrong.solution["sensor/camera/pose"].value[3] != 0);
      REQUIRE(warns_of(wrong, "given_pose") == !wrong.solution.replaced_starts.empty());
      if (turn.norm() < 3 || wrong.solution.replaced_starts.empty()) continue;
      CHECK(wrong.solution.replaced_starts.size() == 1);
      CHECK(wrong.solution.replaced_starts[0].name == "sensor/camera/pose");
      CHECK(wrong.solution.replaced_starts[0].turned == Approx(kPi).margin(0.05));
      CHECK_FALSE(warns_of(wrong, "moved"));
    }
  }
}

TEST_CASE("calibration: a given pose is left for where the data put it whatever lens they show") {
  // Of a first step that estimates poses only, chi2/dof says little: a later one has the lens.
  const Unknown u = eye_in_hand(51, true);
  Rig rig = u.truth;
  rig.sensors[0].parameters[0].values[0] *= 1.2;
  rig.sensors[0].link_T_sensor =
      rig.sensors[0].link_T_sensor * Pose{exp_so3({kPi, 0, 0}), Vector3d::Zero()};
  const Solution solution =
      study_freeing(rig, u.samples, {"sensor/camera/pose", "target/board/pose"}).solution;
  CHECK(solution.chi2_per_dof() > 100);
  REQUIRE(solution.replaced_starts.size() == 1);
  CHECK(solution.replaced_starts[0].name == "sensor/camera/pose");
}

TEST_CASE("calibration: a given pose that is held in part or has a prior is never left") {
  const Unknown u = eye_in_hand(51, true);
  Rig rig = u.truth;
  rig.sensors[0].link_T_sensor =
      rig.sensors[0].link_T_sensor * Pose{exp_so3({kPi, 0, 0}), Vector3d::Zero()};
  const Report report = study_freeing(rig, u.samples, {"sensor/camera/pose.r[xyz]"});
  CHECK(report.solution.replaced_starts.empty());
  CHECK(report.solution.status == Status::undefined_start);
}

TEST_CASE("calibration: the origin of a fixed joint that looks the wrong way is found too") {
  for (unsigned long seed = 61; seed <= 63; ++seed) {
    Random random(seed);
    Unknown u;
    u.truth = arm();
    const Pose mount = random.pose(0.2, kPi);
    const int joint =
        add_joint(u.truth, JointType::fixed, "mount", "tool", "head", {1, 0, 0}, mount);
    add_joint(u.truth, JointType::fixed, "optical", "head", "eye", {1, 0, 0},
              at({0, 0, 0.02}, {-kPi / 2, 0, -kPi / 2}));
    finish_tree(u.truth.tree);
    const int camera = add_camera(u.truth, "camera", "eye", at({0.01, 0, 0}));
    const TruePosture middle = random_posture(u.truth, random, 1, false);
    const int board = add_grid(u.truth, "board", 5, 6, 0.06);
    const Pose base_T_board = to_pose(in_front(u.truth, camera, board, middle, 1, 0.5, random));
    u.truth.targets[board].link_T_target = base_T_board;
    u.truth.targets[board].link = link_index(u.truth, "base");
    for (int k = 0; k < 12; ++k)
      u.add(near(u.truth, middle, random, 0.35), {{camera, board}}, &random);
    Rig rig = u.truth;
    rig.tree.joints[joint].parent_T_joint = mount * Pose{exp_so3({0, kPi, 0}), Vector3d::Zero()};
    finish_tree(rig.tree);
    INFO("seed " << seed);
    const std::vector<std::string> free = {"joint/mount/origin", "target/board/pose"};
    const Report right = study_freeing(u.truth, u.samples, free),
                 wrong = study_freeing(rig, u.samples, free);
    CHECK(wrong.solution.status == Status::converged);
    CHECK(wrong.solution.chi2 == Approx(right.solution.chi2).epsilon(1e-6));
    REQUIRE(wrong.solution.replaced_starts.size() == 1);
    CHECK(wrong.solution.replaced_starts[0].name == "joint/mount/origin");
  }
}

TEST_CASE("calibration: poses half a turn off are no place to stay") {
  // At half a turn the logarithm's sign is noise's: readings pull either way.
  for (unsigned long seed = 71; seed <= 80; ++seed) {
    Random random(seed);
    Rig rig;
    add_link(rig, "base");
    add_joint(rig, JointType::revolute, "pan", "base", "head", {0, 0, 1}, at({0, 0, 0.5}));
    finish_tree(rig.tree);
    const int mocap = add_mocap(rig, "mocap", "head", Pose(), 0.001, 0.002);
    const int body =
        add_points(rig, "body", random_points(random, 3, 0.2), "base", random.pose(0.5, kPi));
    std::vector<Sample> samples;
    for (int k = 0; k < 2 + static_cast<int>(seed % 3); ++k) {
      const TruePosture p = random_posture(rig, random, 1, false);
      samples.push_back(make_sample(rig, p, "s" + std::to_string(k)));
      REQUIRE(add_view(samples.back(), rig, mocap, body, p, &random));
    }
    const Report right = study_freeing(rig, samples, {"target/body/pose"});
    Rig turned = rig;
    turned.targets[body].link_T_target =
        rig.targets[body].link_T_target * Pose{exp_so3(kPi * random.direction()), Vector3d::Zero()};
    const Report wrong = study_freeing(turned, samples, {"target/body/pose"});
    INFO("seed " << seed);
    CHECK(wrong.solution.status == Status::converged);
    CHECK(wrong.solution.chi2 == Approx(right.solution.chi2).epsilon(1e-6));
  }
}

}  // namespace starts_test
