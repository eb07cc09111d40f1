// Samples of one form (the same views of the same points): what is estimated from one sample alone,
// and its rows there. All that does not depend on what was measured is made once.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/levenberg_marquardt.h"
#include "../estimation/estimation.h"
#include "../fitting/view_poses.h"

namespace kincal {

class SampleForm {
 public:
  /// Of samples like this one, which is of the recording's rig; `setup` has the columns, `values`
  /// the shared values.
  SampleForm(const Recording& base, const Sample& sample, const EstimationSetup& setup,
             const VectorXd& values);

  bool fits(const Sample& sample) const;
  /// Estimates the sample's own unknowns with the shared values as they are, and computes rows()
  /// there. False, and why, where that is not possible.
  bool linearise(const Sample& sample, std::string& why);

  const GroupShape& shape() const { return problem_->groups()[0]; }
  const MatrixXd& rows() const { return rows_; }  // Estimation::noise_rows()
  const std::vector<NoiseRows>& kinds() const { return kinds_; }
  const MatrixXd& explicit_rows() const { return explicit_rows_; }  // where something scans
  bool empty() const { return !problem_; }  // no view, or none with something to measure

 private:
  void take(const Sample& sample);
  bool start_target(int target);
  bool given_pose(size_t view, Pose& base_T_target) const;
  Pose base_T_sensor(size_t view) const;
  void propose_by(size_t view);
  bool solve_from_proposed();
  double cost_at(const Pose& pose);
  bool solve();
  bool solve_anew(std::string& why);

  std::shared_ptr<std::vector<Sample>> samples_;  // one
  Recording recording_;
  EstimationSetup own_setup_;
  std::unique_ptr<Estimation> problem_, own_;  // with the columns; without
  std::unique_ptr<LevenbergMarquardt> solver_;
  std::vector<int> targets_;                                // free ones
  std::vector<Path> to_sensors_;                            // from the base, by view
  std::vector<std::optional<RepeatedViewPoses>> by_views_;  // of free targets, where one is seen
  // Poses of a target and their costs, where there are several.
  std::vector<std::pair<double, Pose>> proposed_;
  bool scans_ = false;
  Values values_;
  VectorXd start_, state_, trial_, best_;
  MatrixXd rows_, explicit_rows_;
  std::vector<NoiseRows> kinds_;
};

}  // namespace kincal
