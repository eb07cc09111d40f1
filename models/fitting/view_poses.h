// The poses of a target that single views propose. A chain proposes its hand, a pose sensor its
// pose, points a rigid fit (Kabsch), a scan a rigid fit in the base frame, a camera its PnP
// (closed_form.h).
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "../rig/parameters.h"
#include "../rig/samples.h"
#include "closed_form.h"

namespace kincal {

/// Finds the directions of the pixels of a camera's view of `count` points: (x, y, 1), or unit
/// vectors where these are further from the axis than 88.85 degrees (fisheyes). Those that could
/// not be found are left out; `keep` gets the places in the view of the others.
Eigen::Matrix3Xd seen_directions(const Rig& rig, const ParameterTable& table,
                                 const VectorXd& values, const View& view, int count,
                                 std::vector<int>& keep);

/// Returns the poses sensor_T_target that one view proposes by itself; a scanner's view proposes
/// none.
std::vector<Pose> view_poses(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                             const View& view);

/// The same again and again for views of the same points by the same sensor, in the same memory:
/// after the first view nothing is allocated, but for few points, points nearly in a plane,
/// directions that are not found and sensors that see sideways. `values` must outlive it.
class RepeatedViewPoses {
 public:
  RepeatedViewPoses(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                    const View& view);
  /// The reference holds until the next call.
  const std::vector<Pose>& find(const View& view);

 private:
  const Sensor* sensor_;
  const double* own_;  // of the sensor, in the values
  Eigen::Matrix3Xd points_, directions_, point_;
  std::vector<int> keep_;
  RepeatedPoses poses_;
  std::vector<Pose> out_;
};

/// Returns the points of a scanning view in the base frame, in m.
Eigen::Matrix3Xd scanned_points(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                                const Sample& sample, const View& view);

/// Returns the poses base_T_target that the views of a target by the marked cameras, of few points
/// each (fewer than six), propose together; none where fewer than two see it, or one sees more.
std::vector<Pose> proposals_of_all(const Rig& rig, const ParameterTable& table,
                                   const VectorXd& values, const Sample& sample, int target,
                                   const std::vector<char>& used);

/// A memory of what single views tell, for fits that ask for the same again and again, as the
/// trials of many hypotheses about one recording do.
class ViewPosesMemory {
 public:
  /// What one view tells, as far as it was asked for.
  struct Told {
    std::optional<std::vector<Pose>> poses;        // view_poses()
    std::optional<std::optional<Pose>> minimised;  // pose_from_view()
  };
  /// Returns what is remembered of a view: by its numbers, its target's points and its sensor's
  /// numbers and noise, which are all that these poses depend on. The reference holds until the
  /// next call.
  Told& of(const Rig& rig, const ParameterTable& table, const VectorXd& values, const View& view);

 private:
  std::map<std::pair<std::shared_ptr<const SensorModel>, std::vector<double>>, Told> known_;
};

/// Returns the poses base_T_target that one view proposes if its sensor's pose is known.
std::vector<Pose> proposals(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                            const Sample& sample, const View& view,
                            ViewPosesMemory* memory = nullptr);

}  // namespace kincal
