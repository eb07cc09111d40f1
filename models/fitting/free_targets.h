// Starting values of free targets' poses. Every view of the target proposes poses (view_poses.h).
// The two best proposals, by a robust cost over all views of the sample, are refined with exact
// joints; the better one stays. A single view, alone with its sensor, is the same problem.
#pragma once

#include <optional>
#include <vector>

#include "../../solver/progress.h"
#include "../estimation/setup.h"
#include "../rig/recording.h"
#include "view_poses.h"

namespace kincal {

/// How far the start of a free target's pose goes: the best proposal as it is (cheap), refined
/// until what follows converges from there, or to the minimum.
enum class StartEffort { proposed, refined, converged };

struct TargetStarts {
  StartEffort effort = StartEffort::refined;
  ViewPosesMemory* memory = nullptr;  // of what views proposed before
  Progress progress = {};             // is told which share of the samples is done
};

/// Finds values.targets of every free target that the given samples' views (of `sensors`) see. A
/// pose that is there already stays if it can be evaluated.
/// @throws std::runtime_error naming sample and target where no proposal can be evaluated.
void start_targets(const Recording& recording, const std::vector<int>& samples,
                   const std::vector<int>& sensors, const Loss& loss, Values& values,
                   const TargetStarts& how = {});

/// Returns whether some sensor of the rig tells no pose by its views alone (MeasurementKind::none):
/// a reason why a free target may have no start.
bool some_sensor_tells_no_pose(const Rig& rig);

/// Returns the sensor_T_target that a view gives by itself: a chain's (the identity), a measured
/// one, a rigid fit of points, a camera's perspective pose with its residuals minimised. nullopt
/// where it does not determine one (fewer than four pixels or three points, points on a line, a
/// scan).
std::optional<Pose> pose_from_view(const Rig& rig, const ParameterTable& table,
                                   const VectorXd& values, const View& view,
                                   ViewPosesMemory* memory = nullptr);

}  // namespace kincal
