// What the automatic path estimates: everything that could be wrong, in groups.
//
// Mounts. Poses of sensors and mounted targets, free without a prior: everything else is measured
// from them. Where the rig names a fixed joint as the mount, its origin is free in place of the
// pose. Two cameras of a rectified pair share one mount, the fixed joint above their link.
// Rotations that move no point seen are fixed: of a target of one point or points on a line, and of
// a sensor that measures points at one place of its own frame only.
//
// Groups. Numbers of one kind, of which nothing is known but how far such numbers are usually off:
// x_i ~ N(0, t_i^2) around the rig's values, t_i = factor * start_i with one unknown factor a group
// (widths.h), from the widths of the table of scales (rig/scales.h). Numbers of a kind are
// exchangeable: that is an assumption.
//
//   offsets, slides            of revolute joints; of prismatic ones
//   lengths, angles            numbers of origins, by run
//   sizes, bends               of boards; warps of those that have them
//   baselines
//   ranges                     scale and offset, of sensors of points for which the rig states them
//   focal lengths, centres, distortion  of each camera
//   scan scales, scan offsets  of a laser's joint
//   shapes                     of joint models
//   compliance, compliance across, loads, curve/NAME
//                              of joints that bend, and of one that turns: its error over its
//                              angle; tried behind all others (further.h)
//   gears                      scales of all others; only when asked for
//
// A run is an unbranched row of joints. Of their origins all numbers are members but what moves
// along the joint's own axis, which is its offset's, and fixed joints below which nothing moves,
// which the mounts there have. They are not independent of each other or of the mounts (of n joints
// the data tell 4 n or so), but each is off by itself: without those that others could express
// (rig/geometry.h) an error of one is taken for many times as much of another, or for a board's
// size. Joints that carry a sensor or target relative to the base, but stand before the paths
// between those part, are members too that no measurement sees: known only as well as their group.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "../rig/recording.h"
#include "../rig/selection.h"

namespace kincal {

struct Member {
  Component component;
  double start = 0;  // width that it begins with, in its own unit
};

struct WidthGroup {
  std::string name;
  std::vector<Member> members;  // some measurement depends on each
  std::vector<Member> unseen;   // none does
  bool width_known = false;     // it is not learned
};

struct AutomaticGroups {
  std::vector<Freed> mounts;       // whole poses
  std::vector<Freed> pointing;     // of these, components that are fixed: no measurement depends on
                                   // them
  std::map<int, Vector3d> pivots;  // by pose that is fixed in rotation: the single point in its
                                   // frame that is seen there
  std::vector<WidthGroup> groups;
  std::vector<Member> stated;        // with a prior in the rig, which is their width and stays
  std::vector<Member> gears;         // of the group that has this name, if it was not asked for
  std::vector<std::string> further;  // groups that are not there yet, to be tried (further.h)
};

/// An UncheckedScale is a length that everything hangs on and nothing checks: readings of a sliding
/// joint, or the squares of all boards. With it 1 % larger the data fit as well, and other numbers
/// come out elsewhere; worst, by their sigmas, this one.
struct UncheckedScale {
  std::vector<std::string> scales;  // joint/NAME/scale, or target/NAME/square of every board
  std::string worst, unit;
  double moved = 0, sigmas = 0;
};

/// Names of the groups of further models (further.h); that of a curve ends with its joint's.
inline const char* const kCompliance = "compliance";
inline const char* const kComplianceAcross = "compliance across";
inline const char* const kLoads = "loads";
inline const std::string kCurve = "curve/";
inline bool is_bending(const std::string& group) {
  return group == kCompliance || group == kComplianceAcross || group == kLoads;
}
inline bool is_further(const std::string& group) {
  return is_bending(group) || group.compare(0, kCurve.size(), kCurve) == 0;
}

/// A GroupChoice has names and globs of groups to add to the usual ones, and to leave out.
struct GroupChoice {
  std::vector<std::string> with, without;
};

/// Returns by own number of a joint model whether the position of a joint depends on it in some
/// training sample.
std::vector<char> numbers_seen(const std::vector<Sample>& samples, int joint,
                               const JointModel& model);

/// Returns whether two cameras are one thing, a rectified pair: on the same link, in the same
/// place, with another baseline.
bool is_pair(const Rig& rig, int a, int b);

/// Returns the rig with one pose for both cameras of each rectified pair that no fixed joint
/// carries alone (Sensor::pose_of). Else that joint's origin stands for the pair's pose.
Rig with_pair_poses(Rig rig);

/// Returns the groups of a recording that its training samples depend on.
/// @throws std::invalid_argument: no training sample has a view; NameError beginning with
/// "group[N]" or "no_group[N]": no group has the name.
AutomaticGroups make_groups(const Recording& recording, const GroupChoice& choice);

/// Turns poses about their pivots back to the rig's rotation (`initial`).
void turn_back(const ParameterTable& table, const std::map<int, Vector3d>& pivots,
               const Eigen::VectorXd& initial, Eigen::VectorXd& shared);

/// Returns why no parameter of a recording can be estimated. `on_demand`: the user fixed many;
/// `no_evidence`: no mount is estimated, and everything else was fixed for lack of evidence of
/// error.
std::string nothing_free(const Recording& recording, bool on_demand, bool no_evidence);

}  // namespace kincal
