// Poses in closed form: pure geometry, without rigs, sensors or iterations.
//
// Points and points: Kabsch's rigid fit. Points and directions from one place (perspective): the
// homography of a plane with both of its mirror solutions, else a direct linear transform. Points
// and rays from many places: d x (R p + t) = d x o, linear in R and t. Two unknown poses, A_i X = Y
// B_i over many i (robot-world-hand-eye): rotations from the largest singular vectors of sum R_B
// (x) R_A (Shah 2013), translations by linear least squares.
#pragma once

#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// Returns a matrix of one column a point.
Eigen::Matrix3Xd columns_of(const std::vector<Vector3d>& points);
/// Returns the columns of the given indices, in their order.
Eigen::Matrix3Xd select_columns(const Eigen::Matrix3Xd& points, const std::vector<int>& ids);

/// Returns the rigid motion with b ~ T a for points in columns (Kabsch). Fewer than three points,
/// or points on a line, determine only a part of it.
Pose fit_points(const Eigen::Matrix3Xd& a, const Eigen::Matrix3Xd& b);

/// Returns poses sensor_T_target of points c whose directions (x, y, 1) are xy1: by DLT, for planes
/// both mirror solutions.
std::vector<Pose> perspective_poses(const Eigen::Matrix3Xd& c, const Eigen::Matrix3Xd& xy1);

/// Finds the pose of one camera from points and directions of many views together: of
/// perspective_poses() that with the least angles. Returns false if they do not determine it.
bool pose_from_directions(const Eigen::Matrix3Xd& points, const Eigen::Matrix3Xd& xy1,
                          Pose& camera_T_frame);

/// Finds the pose frame_T_target of points p seen along rays o + s d, all in the frame:  d x (R p +
/// t) = d x o, linear in R and t. Coordinates are along the points' principal axes; of a plane the
/// third column of R is the cross product. Returns false if the rays do not determine it.
bool pose_from_rays(const Eigen::Matrix3Xd& p, const Eigen::Matrix3Xd& o, const Eigen::Matrix3Xd& d,
                    Pose& frame_T_target);

/// Returns a mean that a minority of wrong poses does not move: it is around the medoid, of those
/// within three median distances. `length`, in m, weighs as much as 1 rad.
Pose robust_mean(const std::vector<Pose>& poses, double length);

/// Finds X and Y of A_i X = Y B_i where a minority of the relations is grossly wrong: least squares
/// over all, or where three relations explain the middle one better by far (a third of the
/// discrepancy; 200 draws), over those that these explain (five times the middle one). Returns
/// false if the rotations do not determine them.
bool robust_robot_world_hand_eye(const std::vector<Pose>& a, const std::vector<Pose>& b, Pose& x,
                                 Pose& y);

}  // namespace kincal
