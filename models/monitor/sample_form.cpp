#include "sample_form.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "../fitting/fit.h"
#include "../rig/configuration.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "../sensors/pose.h"
#include "drift_watch.h"

namespace kincal {
namespace {

constexpr size_t kRefined = 2;  // of a view's proposals, the best ones: a flat target has two

std::shared_ptr<std::vector<Sample>> alone(const Sample& sample) {
  auto out = std::make_shared<std::vector<Sample>>(1, sample);
  Sample& one = out->front();
  one.train = true;
  for (View& view : one.views) view.ids.own();  // whoever gave it writes the next ones there
  if (one.noise.empty()) one.noise.assign(one.readings.size(), 1);
  return out;
}

}  // namespace

SampleForm::SampleForm(const Recording& base, const Sample& sample, const EstimationSetup& setup,
                       const VectorXd& values)
    : samples_(alone(sample)), recording_(base.with_samples(samples_)), own_setup_(setup) {
  own_setup_.free.clear();
  values_.shared = values;
  auto problem = std::make_unique<Estimation>(recording_, std::vector<int>{0}, setup);
  if (problem->empty()) return;
  problem_ = std::move(problem);
  own_ = std::make_unique<Estimation>(recording_, std::vector<int>{0}, own_setup_);
  solver_ = std::make_unique<LevenbergMarquardt>(*own_, SolverOptions());
  start_ = own_->pack(values_);
  solver_->reserve(start_.size());
  for (const View& v : sample.views) {
    to_sensors_.push_back(
        find_path(recording_.rig.tree, recording_.rig.base, recording_.rig.sensors[v.sensor].link));
    scans_ = scans_ || recording_.rig.sensors[v.sensor].scanning_joint >= 0;
    by_views_.emplace_back();
    if (recording_.rig.targets[v.target].link < 0)
      by_views_.back().emplace(recording_.rig, recording_.table, values_.shared, v);
    if (recording_.rig.targets[v.target].link < 0 &&
        std::find(targets_.begin(), targets_.end(), v.target) == targets_.end())
      targets_.push_back(v.target);
  }
}

bool SampleForm::fits(const Sample& sample) const {
  const std::vector<View>& views = samples_->front().views;
  return std::equal(views.begin(), views.end(), sample.views.begin(), sample.views.end(),
                    [](const View& a, const View& b) {
                      return a.sensor == b.sensor && a.target == b.target && a.ids == b.ids &&
                             a.z.size() == b.z.size() && a.sigma.size() == b.sigma.size() &&
                             a.covariance.size() == b.covariance.size();
                    });
}

void SampleForm::take(const Sample& sample) {
  Sample& to = samples_->front();
  to.id = sample.id;
  to.readings = sample.readings;
  to.conditions = sample.conditions;
  if (sample.noise.empty())
    std::fill(to.noise.begin(), to.noise.end(), 1);
  else
    to.noise = sample.noise;
  for (size_t v = 0; v < to.views.size(); ++v) {
    View& view = to.views[v];
    view.z = sample.views[v].z;
    if (!(view.sigma == sample.views[v].sigma))
      std::copy(sample.views[v].sigma.begin(), sample.views[v].sigma.end(),
                view.sigma.own().begin());
    view.covariance = sample.views[v].covariance;
  }
  if (!problem_) return;
  problem_->reload();
  own_->reload();
}

Pose SampleForm::base_T_sensor(size_t view) const {
  const Sample& sample = samples_->front();
  const int sensor = sample.views[view].sensor;
  const Configuration at(recording_.rig, recording_.table, values_.shared, sample.readings,
                         sample.conditions, time_of(recording_.rig, sample.views[view]));
  Pose base_T_link;
  for (const PathStep& step : to_sensors_[view]) {
    Pose base_T_joint, base_T_next;
    walk(step, at.origin(step.joint), at.motion(step.joint), base_T_link, base_T_joint,
         base_T_next);
    base_T_link = base_T_next;
  }
  return base_T_link * at.link_T_sensor(sensor);
}

/// Finds the pose that a view measures, of a hand or of a tracker.
bool SampleForm::given_pose(size_t view, Pose& base_T_target) const {
  const Sample& sample = samples_->front();
  const View& v = sample.views[view];
  const MeasurementKind kind = recording_.rig.sensors[v.sensor].model->measurement_kind();
  if (kind != MeasurementKind::chain && kind != MeasurementKind::pose) return false;
  base_T_target = base_T_sensor(view);
  if (kind == MeasurementKind::chain) return true;
  const int block = recording_.table.sensor_block[v.sensor];
  const double scale = block < 0 ? 1 : values_.shared(recording_.table.all[block].start);
  base_T_target = base_T_target * measured_pose(v.z.data(), scale);
  return true;
}

/// Returns the cost where the target stands there; infinite if it is not defined.
double SampleForm::cost_at(const Pose& pose) {
  Cost cost;
  set_pose(state_, static_cast<int>(values_.shared.size()), pose);
  own_->renew(state_);
  return own_->evaluate(0, state_, 0, cost) && cost.doubled < kInfinity ? cost.doubled : kInfinity;
}

/// Adds the poses that a view proposes.
void SampleForm::propose_by(size_t view) {
  const Sample& sample = samples_->front();
  const View& v = sample.views[view];
  if (recording_.rig.sensors[v.sensor].model->measurement_kind() == MeasurementKind::scan) {
    for (const Pose& pose : proposals(recording_.rig, recording_.table, values_.shared, sample, v))
      proposed_.push_back({0, pose});
    return;
  }
  const Pose from = base_T_sensor(view);
  for (const Pose& pose : by_views_[view]->find(v)) proposed_.push_back({0, from * pose});
}

/// Minimises over the sample's own unknowns from the best start proposed. A minimum that
/// explains the sample is the one that is looked for.
bool SampleForm::solve_from_proposed() {
  if (proposed_.size() > 1)
    for (auto& [cost, pose] : proposed_) cost = cost_at(pose);
  std::sort(proposed_.begin(), proposed_.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  double least = kInfinity;
  for (size_t i = 0; i < proposed_.size() && i < kRefined; ++i) {
    if (!(proposed_[i].first < kInfinity)) break;
    trial_ = state_;
    set_pose(trial_, static_cast<int>(values_.shared.size()), proposed_[i].second);
    const SolveSummary& summary = solver_->solve(trial_);
    if (summary.outcome != Outcome::converged || !(summary.cost.doubled < least)) continue;
    least = summary.cost.doubled;
    best_ = trial_;
  }
  proposed_.clear();
  const GroupShape& shape = own_->groups()[0];
  const int dof = std::max(1, shape.rows - shape.private_size);
  if (!(least < kInfinity) || chi2_tail(least, dof) < kOutlier) return false;
  state_ = best_;
  return true;
}

/// Poses that views measure come first, then what others propose, one after the other.
bool SampleForm::start_target(int target) {
  const Sample& sample = samples_->front();
  for (size_t v = 0; v < sample.views.size(); ++v) {
    Pose pose;
    if (sample.views[v].target != target || !given_pose(v, pose)) continue;
    proposed_.push_back({0, pose});
    if (solve_from_proposed()) return true;
  }
  for (size_t v = 0; v < sample.views.size(); ++v) {
    if (sample.views[v].target != target) continue;
    propose_by(v);
    if (solve_from_proposed()) return true;
  }
  return false;
}

bool SampleForm::solve() {
  if (targets_.size() > 1) return false;
  if (targets_.size() == 1) return start_target(targets_[0]);
  return solver_->solve(state_).outcome == Outcome::converged;
}

/// From all proposals, as every calibration does.
bool SampleForm::solve_anew(std::string& why) {
  Values start;
  start.shared = values_.shared;
  try {
    const Fit fitted = fit(recording_, {0}, own_setup_, std::move(start));
    if (!fitted.defined()) {
      why = "a measured point cannot be seen from where it should be";
      return false;
    }
    state_ = own_->pack(fitted.values);
  } catch (const std::runtime_error& error) {
    why = error.what();
    return false;
  }
  return true;
}

bool SampleForm::linearise(const Sample& sample, std::string& why) {
  take(sample);
  if (!problem_) return true;
  state_ = start_;
  if (!solve() && !solve_anew(why)) return false;
  problem_->renew(state_);
  if (!problem_->noise_rows(0, state_, rows_, kinds_)) {
    why = "a residual is not defined";
    return false;
  }
  if (scans_) problem_->explicit_rows(0, state_, explicit_rows_);
  return true;
}

}  // namespace kincal
