#include "plan_verify.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "../../models/analysis/compensation.h"
#include "../../models/design/clearance.h"
#include "../../models/rig/targets.h"
#include "../../models/rig/words.h"
#include "../../models/simulation/simulation.h"
#include "plan.h"
#include "verify.h"

namespace kincal {
namespace {

constexpr size_t kStarts = 6;      // known postures from which a point is tried
constexpr double kApproach = 0.1;  // length of an approach, of the cube's edge
const char* const kDirections = "xyz";

/// The only pair of an instrument and a target that it can verify.
std::pair<int, int> instrument_of(const RigFile& rig_file, const TestPoseSettings& settings) {
  const Rig& rig = rig_file.rig;
  std::vector<std::pair<int, int>> found;
  std::vector<std::string> names, why;
  for (const auto& [sensor, target] : usual_pairs(rig)) {
    if (!settings.sensor.empty() && rig.sensors[sensor].name != settings.sensor) continue;
    const std::string unfit = why_no_instrument(rig, sensor, target);
    if (unfit.empty()) {
      found.push_back({sensor, target});
      names.push_back(rig.sensors[sensor].name + " on " + rig.targets[target].name);
    } else if (std::find(why.begin(), why.end(), unfit) == why.end()) {
      why.push_back(unfit);
    }
  }
  if (found.empty() && why.empty() && !settings.sensor.empty())
    throw InputError(rig_file.path + ": " + option_name("sensor", settings.words) +
                     ": no sensor '" + settings.sensor + "' sees a target");
  if (found.empty())
    throw InputError(rig_file.path + ": nothing can be verified: " +
                     (why.empty() ? "no sensor sees a target" : why[0]));
  if (found.size() > 1)
    throw InputError(rig_file.path + ": one instrument and one target are verified, not " +
                     listed(names) + "; choose with " + option_name("sensor", settings.words) +
                     ", or remove the others from the rig");
  return found[0];
}

/// A robot that brings a target to points before the instrument.
struct Robot {
  CalibratedRobot robot;
  RobotTip tip;
  Vector3d centre;  // of the target's points, in its frame
  std::pair<int, int> view;
  std::uint64_t seed;
  std::optional<Clearance> clearance;
  std::vector<Vector3d> known;     // base frame
  std::vector<Readings> postures;  // in which the target is there

  bool allows(const Readings& readings) const {
    if (clearance) {
      const Readings all = completed(readings);
      if (clearance->near(Configuration(*robot.rig, *robot.table, robot.values, all)).first >= 0)
        return false;
    }
    SimulationOptions options;
    options.samples = 1;
    options.seed = seed;
    options.postures = {{"pose", readings, {view}, {}, {}}};
    return !simulate(*robot.rig, *robot.table, robot.values, options).samples.empty();
  }

  /// By steps from the postures that are nearest.
  std::optional<Readings> reach(const Vector3d& point) const {
    std::vector<size_t> order(known.size());
    for (size_t i = 0; i < order.size(); ++i) order[i] = i;
    const auto nearer = [&](size_t a, size_t b) {
      const double da = (known[a] - point).squaredNorm(), db = (known[b] - point).squaredNorm();
      return da < db || (da == db && a < b);
    };
    const size_t starts = std::min(kStarts, order.size());
    std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(starts),
                      order.end(), nearer);
    for (size_t i = 0; i < starts; ++i) {
      const std::optional<Readings> found = reach_point(tip, centre, point, postures[order[i]]);
      if (found && allows(*found)) return found;
    }
    return std::nullopt;
  }
};

Robot make_robot(const RigFile& rig_file, const Recording& recording,
                 const TestPoseSettings& settings, const Progress& progress,
                 std::vector<std::string>& notes) {
  Robot out;
  out.view = instrument_of(rig_file, settings);
  out.robot = {&recording.rig, &recording.table, recording.table.initial, {}};
  out.seed = settings.seed;
  const int target = out.view.second;
  const Frame frame{"target/" + recording.rig.targets[target].name,
                    recording.rig.targets[target].link, recording.table.target_pose[target]};
  out.tip = {out.robot, frame, {recording.rig.tree.links[recording.rig.base], recording.rig.base}};
  out.centre =
      target_points(recording.rig, recording.table, out.robot.values, target).rowwise().mean();
  if (settings.clearance >= 0) {
    Clearance clearance = robot_clearance(rig_file, out.robot, {}, settings.clearance, notes);
    if (!clearance.empty()) out.clearance = std::move(clearance);
  }
  SimulationOptions options;
  options.seed = settings.seed;
  options.samples = settings.candidates;
  options.pairs = {out.view};
  options.progress = progress.in("candidates");
  const Simulation some = simulate(recording.rig, recording.table, out.robot.values, options);
  for (const Readings& readings : some.true_readings) {
    const Vector3d at = out.tip.base_T_tip(readings) * out.centre;
    out.known.push_back(at);
    out.postures.push_back(readings);
  }
  return out;
}

/// The lowest (0) or highest (1) corner of the region.
Vector3d region_corner(const TestPoseSettings& settings, size_t which) {
  return Eigen::Map<const Vector3d>(settings.region.data() + 3 * which);
}

bool allowed(const TestPoseSettings& settings, const Vector3d& point) {
  return settings.region.empty() || ((point.array() >= region_corner(settings, 0).array()).all() &&
                                     (point.array() <= region_corner(settings, 1).array()).all());
}

/// "1.2 x 0.8 x 0.5 m": the box around all known positions.
std::string size_of(const std::vector<Vector3d>& known) {
  Vector3d low = known[0], high = known[0];
  for (const Vector3d& point : known) {
    low = low.cwiseMin(point);
    high = high.cwiseMax(point);
  }
  const Vector3d size = high - low;
  return text("%.3g x %.3g x %.3g m", size.x(), size.y(), size.z());
}

/// Where the robot comes from to a pose along an axis of the base: P1 from its negative side, the
/// others from inside the cube.
Readings approach_start(const Robot& robot, const TestPoses& cube, const TestPose& pose, int axis) {
  const double inwards = cube.centre(axis) - pose.point(axis), side = inwards > 0 ? 1 : -1;
  const Vector3d from = pose.point + side * kApproach * cube.edge * Vector3d::Unit(axis);
  const std::optional<Readings> found = reach_point(robot.tip, robot.centre, from, pose.readings);
  if (!found || !robot.allows(*found))
    throw InputError("plan: " + pose.name + " cannot be approached along " + kDirections[axis] +
                     " of the base, from " + length_text(kApproach * cube.edge) +
                     " away: another seed, or no approaches");
  return *found;
}

/// All postures in the order of the standard: P5, P4, P3, P2, P1, and again.
std::vector<Posture> in_cycles(const Robot& robot, const TestPoses& cube,
                               const TestPoseSettings& settings) {
  std::vector<std::pair<Posture, std::string>> cycle;  // with the approach behind its id
  for (size_t p = cube.poses.size(); p-- > 0;) {
    const TestPose& pose = cube.poses[p];
    const Posture posture{pose.name, pose.readings, {robot.view}, {}, {}};
    if (!settings.approaches || p == 2 || p == 4) {
      cycle.push_back({posture, ""});
      continue;
    }
    for (int axis = 0; axis < 3; ++axis) {
      cycle.push_back({posture, std::string("@") + kDirections[axis]});
      cycle.back().first.from = approach_start(robot, cube, pose, axis);
    }
  }
  std::vector<Posture> out;
  for (int k = 1; k <= settings.cycles; ++k)
    for (const auto& [posture, way] : cycle) {
      out.push_back(posture);
      out.back().id += text("_%02d", k) + way;
    }
  return out;
}

}  // namespace

TestPosePlan plan_test_poses(const RigFile& rig_file, const TestPoseSettings& settings,
                             const Progress& progress) {
  const Recording recording(rig_file.rig, {});
  const Rig& rig = recording.rig;
  TestPosePlan out;
  const std::pair<int, int> view = instrument_of(rig_file, settings);
  out.sensor = rig.sensors[view.first].name;
  out.target = rig.targets[view.second].name;
  out.base = rig.tree.links[rig.base];
  for (const int p : open_poses(rig, recording.table))
    throw InputError(rig_file.path + ": " + recording.table.all[p].name +
                     " is not known: give its pose, or plan with the result of a calibration");
  if (!settings.region.empty() &&
      !(region_corner(settings, 0).array() < region_corner(settings, 1).array()).all())
    throw InputError(option_name("region", settings.words) +
                     ": the first corner is not below the second: x, y, z of the lowest and of the "
                     "highest corner are expected, in m");
  const Robot robot = make_robot(rig_file, recording, settings, progress, out.notes);
  const Progress searching = progress.in("searching the largest cube");
  std::vector<Vector3d> within;
  for (const Vector3d& point : robot.known)
    if (allowed(settings, point)) within.push_back(point);
  if (!within.empty())
    out.cube = find_test_poses(within, [&](const Vector3d& point) {
      searching.check();
      return allowed(settings, point) ? robot.reach(point) : std::nullopt;
    });
  const std::string about = " where target '" + out.target + "' is reached and sensor '" +
                            out.sensor + "' sees it: its positions in " +
                            std::to_string(robot.known.size()) + " random postures span " +
                            size_of(robot.known);
  if (!(out.cube.edge > 0)) throw InputError(rig_file.path + ": no cube fits in the space" + about);
  if (out.cube.poses.empty())
    throw InputError(rig_file.path + ": the five poses are on no plane of the largest cube (" +
                     length_text(out.cube.edge) + ") in the space" + about);
  out.cycles = settings.cycles;
  out.postures = in_cycles(robot, out.cube, settings);
  return out;
}

Json test_poses_json(const Rig& rig, const TestPosePlan& plan) {
  Json poses = Json::array(), ids = Json::array();
  for (const TestPose& pose : plan.cube.poses) {
    Json joints = Json::object();
    for (size_t j = 0; j < pose.readings.size(); ++j)
      if (!std::isnan(pose.readings[j])) joints[rig.tree.joints[j].name] = pose.readings[j];
    poses.push_back({{"name", pose.name}, {"xyz", vector3(pose.point)}, {"joints", joints}});
  }
  for (const Posture& posture : plan.postures) ids.push_back(posture.id);
  return {{"standard", "iso9283"},
          {"sensor", plan.sensor},
          {"target", plan.target},
          {"base", plan.base},
          {"cube", {{"centre", vector3(plan.cube.centre)}, {"edge", plan.cube.edge}}},
          {"poses", poses},
          {"cycles", plan.cycles},
          {"postures", ids},
          {"notes", plan.notes}};
}

std::string test_poses_text(const TestPosePlan& plan) {
  const Vector3d& c = plan.cube.centre;
  std::string out =
      text("ISO 9283: 5 poses of target '%s', seen by '%s', in %d cycles: %zu postures.\n",
           plan.target.c_str(), plan.sensor.c_str(), plan.cycles, plan.postures.size());
  out += text("Cube: edge %.4g m, centre (%.4g, %.4g, %.4g) m in '%s', parallel to its axes.\n",
              plan.cube.edge, c.x(), c.y(), c.z(), plan.base.c_str());
  for (const TestPose& pose : plan.cube.poses)
    out += text("  %s %9.4f %9.4f %9.4f m\n", pose.name.c_str(), pose.point.x(), pose.point.y(),
                pose.point.z());
  for (const std::string& note : plan.notes) out += "Note: " + note + ".\n";
  return out;
}

}  // namespace kincal
