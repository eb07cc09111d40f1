// The parameters that the automatic path estimates: all that may be wrong, in groups.
//
// Mounts. Poses of sensors and mounted targets, estimated without a prior: everything else is
// measured from them. If the rig names a fixed joint as the mount, its origin is estimated instead
// of the pose. Two cameras of a rectified pair share one mount, the fixed joint above their link.
// Rotations that move no measured point are fixed: of a target of one point or points on a line,
// and of a sensor that measures points at one place of its own frame only.
//
// Groups. Components of one kind whose errors are known only by their usual size:
// x_i ~ N(0, t_i^2) around the rig's values, t_i = factor * start_i with one unknown factor a group
// (widths.h), from the widths of the table of scales (rig/scales.h). Components of a kind are
// assumed to be exchangeable.
//
//   offsets, slides            of revolute joints; of prismatic ones
//   lengths, angles            components of origins, by run
//   sizes                      of boards
//   baselines
//   ranges                     scale and offset, of point sensors, if the rig states them
//   focal lengths, centres, distortion  of each camera
//   scan scales, scan offsets  of a laser's joint
//   shapes                     of joint models
//   prints, warps, marker points, compliance, compliance across, loads, backlash, time offsets,
//   temperature, ripple/NAME, curve/NAME, coupling/NAME, gears
//                              of boards; of targets that are points; of joints that bend, of
//                              joints whose direction of approach the samples state, of sensors
//                              that measured while joints moved, of joints where the samples state
//                              different temperatures, and of one that turns: cycles of a gear
//                              whose ratio the rig states, its error over its angle, shares of the
//                              readings of the next joints, scales of all but scanning joints;
//                              tried after all others, or on request (further.h)
//
// A run is an unbranched row of joints. All components of their origins are members, except motion
// along the joint's own axis (the offset has it) and fixed joints below which nothing moves (the
// mounts have them). They are not independent of each other or of the mounts (the data determine
// about 4 n for n joints), but each has its own error. If those that others can express
// (rig/geometry.h) were omitted, an error of one would appear as a multiple in another, or as a
// board's size. Joints between the base and the point where the paths to sensors and targets branch
// are members too, but no measurement depends on them: only their group's width is known. So are
// those of a branch that no sensor or target is on, if the error of a frame there is requested, as
// a run of their own.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "../rig/recording.h"
#include "../rig/selection.h"

namespace kincal {

struct Member {
  Component component;
  double start = 0;  // starting width, in its own unit
};

struct WidthGroup {
  std::string name;
  std::vector<Member> members;  // some measurement depends on each
  std::vector<Member> unseen;   // no measurement depends on these
  bool width_known = false;     // the width is not learned
};

struct AutomaticGroups {
  std::vector<Freed> mounts;       // whole poses
  std::vector<Freed> pointing;     // of these, components that are fixed: no measurement depends on
                                   // them
  std::map<int, Vector3d> pivots;  // by pose with fixed rotation: the only measured point in its
                                   // frame
  std::vector<WidthGroup> groups;
  std::vector<Member> stated;        // with a prior in the rig, whose width is kept
  std::vector<Member> gears;         // of the group of this name, if it does not exist yet
  std::vector<std::string> further;  // groups that do not exist yet, to be tried (further.h)
};

/// An UncheckedScale is a length that no measurement checks, although others depend on it: the
/// readings of a sliding joint, or the spacings of all boards. If it were 1 % larger the data would
/// fit equally well and other components would change; `worst` is the one that changes most in its
/// sigmas.
struct UncheckedScale {
  std::vector<std::string> scales;  // joint/NAME/scale, or target/NAME/square of every board
  std::string worst, unit;
  double moved = 0, sigmas = 0;
};

/// Names of the groups of further models (further.h). Those of one joint end with its name.
inline const char* const kCompliance = "compliance";
inline const char* const kComplianceAcross = "compliance across";
inline const char* const kLoads = "loads";
inline const char* const kBacklash = "backlash";
inline const char* const kTimeOffsets = "time offsets";
inline const char* const kTemperature = "temperature";
inline const char* const kPrints = "prints";
inline const char* const kWarps = "warps";
inline const char* const kMarkers = "marker points";
inline const char* const kGears = "gears";
inline const std::string kRippleOf = "ripple/", kCurve = "curve/", kCouplingOf = "coupling/";
inline bool is_bending(const std::string& group) {
  return group == kCompliance || group == kComplianceAcross || group == kLoads;
}
inline bool is_of(const std::string& kind, const std::string& group) {
  return group.compare(0, kind.size(), kind) == 0;
}
/// Returns whether a group is one of a single joint: a ripple, a curve or a coupling.
inline bool is_of_joint(const std::string& group) {
  return is_of(kRippleOf, group) || is_of(kCurve, group) || is_of(kCouplingOf, group);
}
/// Returns whether a group is one that moves the robot where it stands: a URDF needs corrected
/// readings then.
inline bool corrects_readings(const std::string& group) {
  return is_bending(group) || group == kTemperature || group == kGears || is_of_joint(group);
}
inline bool is_further(const std::string& group) {
  return corrects_readings(group) || group == kBacklash || group == kTimeOffsets ||
         group == kPrints || group == kWarps || group == kMarkers;
}

/// A GroupChoice has names and globs of groups to add to the usual ones, and to omit, and the
/// frames whose predicted error is requested (links; other names change nothing).
struct GroupChoice {
  std::vector<std::string> with, without, frames = {};
};

/// Returns for each own[k] of a joint model whether the position depends on it in some training
/// sample.
std::vector<char> numbers_seen(const std::vector<Sample>& samples, int joint,
                               const JointModel& model);

/// Returns the joints whose direction of approach some training sample states, without scanning
/// ones.
std::vector<int> joints_with_backlash(const Rig& rig, const std::vector<Sample>& samples);

/// Returns whether the training samples state different temperatures.
bool temperature_varies(const std::vector<Sample>& samples);

/// Returns the joints to which a joint that turns may be coupled: those that turn, have a reading
/// and are next to it in the tree, above or below, with no other joint that moves between.
std::vector<int> next_joints(const Rig& rig, int joint);

/// Returns the sensors with a view in a training sample that states rates; without chains, which
/// measure nothing but readings.
std::vector<int> sensors_with_rates(const Rig& rig, const std::vector<Sample>& samples);

/// Returns whether two cameras are a rectified pair: on the same link, at the same pose, with
/// different baselines.
bool is_pair(const Rig& rig, int a, int b);

/// Returns the rig with one common pose for the cameras of each rectified pair (Sensor::pose_of).
/// If a fixed joint carries their link and nothing that moves, its origin replaces this pose
/// instead. Pairs with a stated mount are unchanged.
Rig with_pair_poses(Rig rig);

/// Returns the groups of a recording on which its training samples depend.
/// @throws std::invalid_argument: no training sample has a view; NameError beginning with
/// "group[N]" or "no_group[N]": no group has the name.
AutomaticGroups make_groups(const Recording& recording, const GroupChoice& choice);

/// Returns the reason why no parameter of a recording can be estimated. `on_demand`: the user fixed
/// many; `no_evidence`: no mount is estimated, and everything else was fixed for lack of evidence
/// of error.
std::string nothing_free(const Recording& recording, bool on_demand, bool no_evidence);

}  // namespace kincal
