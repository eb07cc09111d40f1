// Poses in closed form: pure geometry, without rigs, sensors or iterations.
//
// Points and points: Kabsch's rigid fit. Points and directions from one place (perspective): the
// homography of a plane with both of its mirror solutions, else a direct linear transform. Points
// and rays from many places: d x (R p + t) = d x o, linear in R and t. Of points nearly in a plane
// (what they stick out is less than a tenth of their spread in it) neither is safe: noise decides
// between the mirror solutions. There all minima of the points' distances from the rays are taken
// (rotation_minima.h), of which the residuals decide. Two unknown poses, A_i X = Y
// B_i over many i (robot-world-hand-eye): rotations from the largest singular vectors of sum R_B
// (x) R_A (Shah 2013), translations by linear least squares. A sensor's pose and the places of
// points that it sees one at a time, X p_i = A_i y: linear in R_X, t_X and y (rotation_minima.h).
// The same with y = Y q_i of what another sensor sees: linear in R_X, t_X and an affine Y.
#pragma once

#include <memory>
#include <optional>
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

/// Returns poses sensor_T_target of points c whose directions are xy1, (x, y, 1) or unit vectors
/// beside and behind: by DLT, for planes both mirror solutions; of fewer than six points, and what
/// is nearly a plane, all poses that are nearest to the directions.
std::vector<Pose> perspective_poses(const Eigen::Matrix3Xd& c, const Eigen::Matrix3Xd& xy1);

/// Both again and again, in the same memory: of as many points nothing is allocated, but for what
/// needs poses_at_rays().
class RepeatedPoses {
 public:
  RepeatedPoses();
  RepeatedPoses(RepeatedPoses&&) noexcept;
  ~RepeatedPoses();
  Pose fit(const Eigen::Matrix3Xd& a, const Eigen::Ref<const Eigen::Matrix3Xd>& b);
  /// The reference holds until the next call.
  const std::vector<Pose>& perspective(const Eigen::Matrix3Xd& c, const Eigen::Matrix3Xd& xy1);

 private:
  /// Where points lie.
  struct Placed {
    Vector3d mean;
    Matrix3d axes;
    double size;
    bool flat;
  };
  void add_linear(const Eigen::Matrix3Xd& xy1, const Placed& points);

  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// Returns the poses frame_T_target at which points p are nearest to rays o + s d of the frame, the
/// least distances first; few rays leave some of a pose open, and there are many.
std::vector<Pose> poses_at_rays(const Eigen::Matrix3Xd& p, const Eigen::Matrix3Xd& o,
                                const Eigen::Matrix3Xd& d);

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

/// A SinglePoint is what relates a sensor's pose X and a point's place y:  X measured = A y.
struct SinglePoint {
  Vector3d measured;  // in the sensor's frame
  Pose a;             // from the link that y is fixed to, to the link that X is fixed to
  int point = 0;      // which y
  Eigen::Vector4d shares = Eigen::Vector4d::UnitX();  // of y and the three after it, whose weighted
                                                      // mean this is; the sum is 1
};

/// A SinglePointPose is what leaves the least.
struct SinglePointPose {
  Pose x;
  Matrix3Xd y;             // one a column
  bool ambiguous = false;  // another solution leaves no more than chance explains
  double turned = 0;       // by how much X of the other is turned from this, rad
};

/// Finds a sensor's pose and the places of `points` points from readings of single points. nullopt
/// where these do not determine it: fewer than a point's unknowns, or all in one line.
std::optional<SinglePointPose> pose_from_single_points(const std::vector<SinglePoint>& readings,
                                                       int points);

/// Finds X and Y of A_i X = Y B_i where the rotations alone do not determine them (a robot that
/// only slides, or turns about one axis): by four points of Y's body as X's body sees them. What
/// the relations leave open is the shortest translation, or any turn.
std::optional<SinglePointPose> robot_world_hand_eye_by_points(const std::vector<Pose>& a,
                                                              const std::vector<Pose>& b, Pose& y);

/// A PointOfTwo is one point as two sensors see it, with poses X and Y:  X in_x = A Y in_y.
struct PointOfTwo {
  Vector3d in_x, in_y;
  Pose a;  // from the link of Y to the link of X
};

/// Finds X and Y of single points that both saw, where no view of X has a pose (a scanner whose
/// every ray has its own A). Y is looked for as an affine map, the place of four corners, and then
/// made rigid. nullopt where the points do not determine them; those of Y must not lie in a plane.
std::optional<SinglePointPose> two_poses_by_points(const std::vector<PointOfTwo>& points, Pose& y);

}  // namespace kincal
