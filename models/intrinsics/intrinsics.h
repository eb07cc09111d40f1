// Lenses and relative poses of cameras from views of boards, without a robot.
//
// Every board is free: it has its own unknown pose in every sample, wherever the rig mounts it.
// Cameras on one rigid body that see the same boards in the same samples are calibrated together:
// a board has one pose for all of them, so their poses relative to the first are estimated. What is
// fitted is a recording of its own, with one link that all cameras stand on; it is calibrated by
// the same machinery as a robot. The noise of the corners is estimated from what the fit leaves.
//
// The choice of a lens. Each camera's views are cross-validated (trials/cross_validation.h) with
// each of lens_models(), on the same folds. A lens is worse than the best by the difference of
// their root mean squares on what was held out; the standard error of this difference comes from
// the jackknife over samples, paired, so that what makes a sample hard for both does not widen it.
// The lens with the fewest numbers that is worse by no more than its standard error is taken; where
// the views do not determine a focal length with that, they cannot tell lenses apart, and the rig's
// stays.
//
// Cameras that are calibrated together are asked once more together, for what one lens lacks shows
// in where the others stand: a tangential distortion that is too small to be seen by one camera
// pulls the others' by 19 sigmas, and their poses by 5. A lens with more numbers, or as many, is
// taken where chi2 of all falls by kSurely more than two for each number, and what is held out is
// better.
//
// Boards bend, and a bent board looks like a lens. The group is fitted once more with the warp of
// its boards (rig/targets.h) free. Where it is asked for, that stays if it is better on what was
// held out by more than the standard error of that, and the lenses are chosen again with the warp
// free in each fit; else it is said where it is better by three of them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../analysis/projection.h"
#include "../calibration/calibration.h"
#include "../sensors/sensors.h"
#include "../trials/cross_validation.h"
#include "camera_groups.h"
#include "intrinsics_notes.h"
#include "one_camera.h"

namespace kincal {

struct IntrinsicsOptions : CalibrationOptions {
  std::string model = "auto";  // name of a lens; "rig": of each camera as the rig has it
  int folds = 5;
  bool warp = false;  // whether boards may be bent
};

/// A LensTrial is how a lens did in the choice.
struct LensTrial {
  const LensModel* model = nullptr;
  std::string unusable;                     // why it cannot be chosen; else empty
  double rms = kNan, held_out = kNan;       // px
  double worse = kNan, worse_sigma = kNan;  // than the best, on what was held out
  bool loose = false;                       // the focal length is not determined with it
  HeldOutBlocks blocks;
};

struct CameraIntrinsics {
  int camera = -1;  // of the given rig
  int group = 0;    // of IntrinsicsResult::groups
  int sensor = -1;  // of the group's rig
  const LensModel* model = nullptr;
  std::vector<LensTrial> trials;  // empty: nothing was chosen
  Eigen::Vector2d image;          // px
  long views = 0, points = 0;
  double rms = kNan;
  double noise = kNan, stated = kNan;  // px; of the corners as the fit leaves it, and in the rig
  std::optional<HeldOutError> held_out;
  Grid coverage, near, far;  // corners; sigmas in px at the boards' distance, and far away
  double distance = 0, tilt = 0;
};

/// A WarpTrial says what boards that may be bent were worth: rms on what was held out, px.
struct WarpTrial {
  double flat = kNan, warped = kNan;
  double better = kNan, better_sigma = kNan;
  double largest = 0;  // of the numbers of all boards, m
  bool kept = false;   // the solution has the warp
};

struct IntrinsicsGroup {
  Solution solution;         // its rig has the cameras of the group only
  std::vector<int> cameras;  // of the given rig, by sensor; the first is the reference
  std::optional<WarpTrial> warp;
};

struct IntrinsicsResult {
  std::vector<IntrinsicsGroup> groups;
  std::vector<CameraIntrinsics> cameras;  // that see boards, in the rig's order
  std::vector<IntrinsicsNote> notes;
  Status status = Status::converged;  // the worst of the groups'
};

/// Calibrates all cameras of a rig. `samples` are of without_robot(rig); those that are held out
/// take no part. nullopt: cancelled.
/// @throws std::invalid_argument: there is no such lens, no camera sees a board; std::runtime_error
/// where a calibration cannot start.
std::optional<IntrinsicsResult> calibrate_intrinsics(const Rig& rig,
                                                     const std::vector<Sample>& samples,
                                                     const IntrinsicsOptions& options);

/// Returns the rig's camera with the lens and the pose that were found. The pose is that of the
/// given rig where it leaves open that of the reference. Its sigma stays: what a robot adds to the
/// noise of corners is not known here.
Sensor calibrated_camera(const Rig& rig, const IntrinsicsResult& result,
                         const CameraIntrinsics& camera);

}  // namespace kincal
