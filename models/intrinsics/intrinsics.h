// Lenses and relative poses of cameras from views of boards, without a robot.
//
// Every board is free: it has its own unknown pose in every sample, wherever the rig mounts it.
// Cameras on one rigid body that see the same boards in the same samples are calibrated together:
// a board has one pose for all of them, so their poses relative to the first are estimated. The fit
// is a recording of its own with all cameras on one link, calibrated like a robot. The noise of the
// corners is estimated from the residuals.
//
// The choice of a lens. Each camera's views are cross-validated (trials/cross_validation.h) with
// each of lens_models(), on the same folds. A lens is worse than the best by the difference of
// their root mean squares on held-out data; the standard error of this difference comes from a
// paired jackknife over samples, so that samples difficult for both do not widen it. The lens with
// the fewest parameters that is worse by no more than the standard error is chosen. If the views do
// not determine a focal length with it, they cannot distinguish lenses, and the rig's lens remains.
//
// Lenses of cameras that are calibrated together are then chosen again jointly, because a missing
// lens term biases the other cameras: a tangential distortion too small to be found with one camera
// changes the others' distortion by 19 sigmas, and their poses by 5. A lens with at least as many
// parameters is chosen if chi2 of all falls by kSurely more than two per parameter, and the
// held-out error is smaller.
//
// Boards bend, and a bent board has an effect like a lens. The group is fitted once more with the
// warp of its boards (rig/targets.h) estimated. If requested (`warp`), the warp is kept if it is
// better on held-out data by more than its standard error, and the lenses are chosen again with it;
// otherwise a note reports an improvement of three standard errors.
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
  std::string model = "auto";  // name of a lens; "rig": each camera's lens in the rig
  int folds = 5;
  bool warp = false;  // whether boards may be bent
};

/// A LensTrial is the result of one lens in the choice.
struct LensTrial {
  const LensModel* model = nullptr;
  std::string unusable;                     // reason why it cannot be chosen; else empty
  double rms = kNan, held_out = kNan;       // px
  double worse = kNan, worse_sigma = kNan;  // than the best, on held-out data
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
  double noise = kNan, stated = kNan;  // px; noise of the corners, estimated and in the rig
  std::optional<HeldOutError> held_out;
  Grid coverage, near, far;  // corners; sigmas in px at the boards' distance and far away
  double distance = 0, tilt = 0;
};

/// A WarpTrial is the effect of estimating the boards' warp: rms on held-out data, px.
struct WarpTrial {
  double flat = kNan, warped = kNan;
  double better = kNan, better_sigma = kNan;
  double largest = 0;  // largest warp component of all boards, m
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

/// Calibrates all cameras of a rig. `samples` belong to the rig that without_robot(rig) returns;
/// held-out samples are not used. nullopt: cancelled.
/// @throws std::invalid_argument: there is no such lens, or no camera sees a board;
/// std::runtime_error if a calibration cannot start.
std::optional<IntrinsicsResult> calibrate_intrinsics(const Rig& rig,
                                                     const std::vector<Sample>& samples,
                                                     const IntrinsicsOptions& options);

/// Returns the rig's camera with the calibrated lens and pose. The pose remains the given rig's for
/// the reference camera, and if the rig does not give that of the reference. The sigma is
/// unchanged, because the robot's contribution to the noise of corners is unknown here.
Sensor calibrated_camera(const Rig& rig, const IntrinsicsResult& result,
                         const CameraIntrinsics& camera);

}  // namespace kincal
