// The geometry of a solution, written plainly: some views, and how what they see moves when the
// unknowns or the robot move.
//
// It is for reasons only (reasons.h), so a few views of each pair of sensor and target and a few
// points of each view are enough, and derivatives are central differences of the kinematics.
#pragma once

#include <utility>
#include <vector>

#include "../estimation/estimation.h"

namespace kincal {

/// A ProblemAt is a problem of the training samples at given values, its covariances renewed there.
struct ProblemAt {
  Estimation problem;
  VectorXd state;

  ProblemAt(const Recording& recording, const EstimationSetup& setup, const Values& values)
      : problem(recording, recording.training(), setup), state(problem.pack(values)) {
    problem.renew(state);
  }
};

/// A Scene is the problem of a step without its priors, at its solution. The values must outlive
/// it.
class Scene {
 public:
  /// Seen is a view that is looked at.
  struct Seen {
    int sample;
    const View* view;
    Path path;                     // from the sensor's link to the target's
    std::vector<Vector3d> points;  // of the target, a few; if the sensor measures poses: a tripod
  };

  /// `setup` must have no priors.
  Scene(const Recording& recording, const EstimationSetup& setup, const Values& values);

  const Recording& recording() const { return recording_; }
  const Rig& rig() const { return recording_.rig; }
  const ParameterTable& table() const { return recording_.table; }
  /// Returns the shared values of the solution.
  const VectorXd& solution() const { return values_.shared; }
  const std::vector<Seen>& seen() const { return seen_; }
  const std::vector<Component>& columns() const { return at_.problem.columns(); }
  const VectorXd& state() const { return at_.state; }
  Estimation& problem() { return at_.problem; }

  /// Returns the pose of the end of `path` in its beginning. Joint `moved` (-1: none) stands `by`
  /// further than it does in the sample.
  Pose along(const Path& path, const VectorXd& values, const Seen& s, int moved, double by) const;
  /// Returns sensor_T_target. A free target that a chain holds goes with the hand when a joint is
  /// moved (at the solution's values).
  Pose sensor_T_target(const VectorXd& values, const Seen& s, int moved = -1, double by = 0) const;
  /// Returns the shared values after a step of the shared unknowns.
  VectorXd after(const VectorXd& step) const;

 private:
  void add(int sample, const View* view);
  Vector3d point(const VectorXd& values, int target, int id) const;
  std::vector<double> readings(const Seen& s, int moved, double by) const;

  const Recording recording_;
  const Values& values_;
  ProblemAt at_;
  VectorXd zero_private_step_;
  std::vector<Seen> seen_;
};

/// A ViewMotion is what a step of the unknowns does to one view.
struct ViewMotion {
  Vector6d twist;  // of the target as seen from the sensor
  std::vector<Vector3d>
      points;  // of its points, as far as the sensor sees it (a camera: across the line of sight)
};

/// Returns the motions of all views of a scene per unit of `step`, with joint `moved` (-1: none)
/// standing `by` further than in the samples.
std::vector<ViewMotion> motions(const Scene& scene, const VectorXd& step, int moved = -1,
                                double by = 0);

/// Returns the squared lengths of the motions of all seen points: of `a`, or of `a` and `b`
/// together.
double squared_points(const std::vector<ViewMotion>& a, const std::vector<ViewMotion>* b = nullptr);
/// Returns the same of whole views, felt at 0.2 m around the target.
double squared_wholes(const Scene& scene, const std::vector<ViewMotion>& a,
                      const std::vector<ViewMotion>* b = nullptr);

}  // namespace kincal
