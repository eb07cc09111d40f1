// The kinematics of one problem at a state: joints' motions, what lies between sensors and targets,
// and M, the derivative of the pose that a sensor sees by the group's unknowns. This header is for
// the sources of this folder only.
//
// For each sample: walk(); for each of its views view_poses(), then, for derivatives,
// kinematic_matrix(). All of them write to the worker's scratch.
#pragma once

#include <utility>
#include <vector>

#include "layout.h"

namespace kincal {

/// A PathAtState is a sensor path with its joints at the current state.
struct PathAtState {
  std::vector<Pose> frames;  // by step of the path
  Pose link_T_far;           // from the sensor's link to the target's
  Pose link_T_before;  // with a scanning joint: to it, on the sensor's side; link_T_far is then
                       // seen from behind it
  RowMatrix twists;    // in its top left corner: the path's columns
};

constexpr int kTurns = 3;  // arrays of ScanView::turns

/// Scratch is one worker's memory for the sample at hand.
struct alignas(kCacheLine) Scratch {
  std::vector<Pose> motion;        // by joint
  std::vector<Pose> moved;         // by joint: origin * motion, parent_T_child
  const Sample* sample = nullptr;  // whose motions these are
  double row = 0;                  // of the image, at whose time they are
  std::vector<double> reading;     // by joint, error included
  BentPosture bent;                // where joints bend
  MatrixXd by_delta;
  BendingColumns through_bending;
  std::vector<PathAtState> paths;
  ViewInput input;
  Scan scan;
  std::vector<Eigen::Matrix3Xd> points;  // by target
  std::vector<Eigen::Matrix3Xd> plain,
      layouts;                   // by target: boards whose print may be out of scale
  std::vector<double> gathered;  // points of a view for its kernel
  std::vector<double> turned;    // what the joint of a scan does at each, for its kernel
  RowMatrix evaluated;           // L as sensors without a kernel write it
  AlignedNumbers rows_memory;
  Eigen::Map<MatrixXd> rows{
      nullptr, 0, 0};          // in its top left corner: [L r]; residuals alone in the last column
  VectorXd r;                  // residuals of sensors without a kernel
  std::vector<double> slopes;  // roots of the loss's slopes, by row
  MatrixXd projected, rooted;  // mode marginal: noise' [L r], and that times the root
  MatrixXd own_noise;
  // Of square roots, as large as they were needed so far:
  AlignedNumbers part, view, moved_rows;         // [L r] of a part and of all of a view; L K
  std::vector<std::pair<double, int>> by_share;  // rows of a triangle
  ExpandScratch expand;
  AlignedNumbers sums;  // SharedSums of Layout::sums, one behind the other
  std::vector<size_t> sums_start;
  bool summing = false;                  // between begin_piece() and end_piece()
  std::vector<char> is_begun;            // by sum: something was added in this piece
  std::vector<int> begun;                // these
  const PlacedSample* walked = nullptr;  // whose paths these are
  long version = -1;                     // of the motion that they were walked at
};

/// Makes scratch for `count` workers, sized for the largest view and path, so that nothing is
/// allocated later.
void resize_scratch(const Layout& layout, int count, std::vector<Scratch>& scratch);

class Motion {
 public:
  explicit Motion(const Layout& layout);
  /// Computes the charts of partly freed poses and the caches of joints at this state; nothing
  /// where its shared values are those of the last call.
  void prepare(const VectorXd& state);
  /// Takes no walk for done any more: readings have changed.
  void forget() { ++version_; }
  /// Computes the motions of a sample's joints and what lies along its paths, with `derivatives`
  /// also the paths' columns. What nothing that is estimated moves stays from the last call.
  /// False where its joints bend and there is no equilibrium.
  bool walk(const PlacedSample& s, const VectorXd& state, Scratch& scratch, bool derivatives) const;
  void path_columns(const SensorPath& path, const std::vector<MotionColumns>& program, int count,
                    const VectorXd& state, Scratch& scratch, PathAtState& walked) const;
  /// Adds to path.motion's columns what moves through bending joints.
  void bending_columns(const SensorPath& path, const PlacedSample& s, const VectorXd& state,
                       Scratch& scratch, PathAtState& walked) const;
  void view_poses(const PlacedView& v, const PlacedSample& s, const VectorXd& state,
                  Scratch& scratch) const;
  void seen_from_sensor(const PlacedView& v, const PlacedSample& s, const VectorXd& state,
                        int first, int count, Scratch& scratch) const;
  void kinematic_matrix(const PlacedView& v, const PlacedSample& s, const VectorXd& state,
                        Scratch& scratch) const;

 private:
  /// A JointCache has what a joint at position q does to its origin, where that is held:
  ///     origin * motion(q) = {R (1 + sin(q) [a]x + (1 - cos(q)) [a]x^2), t}   for an axis a,
  ///                          {R, t + q R a}                                   if it is prismatic.
  struct JointCache {
    int joint;
    bool held, prismatic;
    Driver driver;
    Pose origin;
    Matrix3d sine, versine;  // R [a]x, R [a]x^2
    Vector3d along;          // R a

    void set_origin(const Pose& pose, const Vector3d& axis);
  };
  const double* own_numbers(int joint, const VectorXd& state) const {
    return state.data() + layout_.table.all[layout_.table.joint_offset[joint]].start;
  }
  double by_column(const MotionColumns& column, const VectorXd& state,
                   const Scratch& scratch) const;
  void motions(const PlacedSample& s, const SensorPath& path, const VectorXd& state,
               Scratch& scratch) const;
  bool bend_joints(const PlacedSample& s, const VectorXd& state, Scratch& scratch) const;
  bool bends(int joint) const {
    return layout_.rig.elasticity && layout_.rig.elasticity->skeleton->index[joint] >= 0;
  }
  void walk_path(const SensorPath& path, const VectorXd& state, const Scratch& scratch,
                 PathAtState& walked) const;
  int target_start(const PlacedView& v, const PlacedSample& s) const;

  const Layout& layout_;
  VectorXd prepared_;               // shared values
  long version_ = 0;                // of these and the readings
  std::vector<MatrixXd> charts_;    // by parameter: 6 x freed components, of partly freed poses
  std::vector<JointCache> caches_;  // of joints that some view needs
  std::vector<int> cache_of_;       // by joint: which of them
};

}  // namespace kincal
