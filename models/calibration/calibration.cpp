#include "calibration.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>

#include "../estimation/estimation.h"
#include "../fitting/fit.h"
#include "../rig/numbers.h"
#include "start_poses.h"

namespace kincal {

/// A solution and the solver of its last step, which a later solve() takes up again.
struct CalibrationRun {
  Solution solution;
  std::unique_ptr<LevenbergMarquardt> solver;
};

namespace {

// A step whose unknowns a later one frees again leaves a start for that one: it ends when an
// iteration lowers the cost by less than this share of it, or after so many.
constexpr double kRepeatedDecrease = 1e-7;
constexpr int kRepeatedIterations = 30;

/// How an undefined start ends a calibration.
struct CannotStart {
  std::string message;
};

/// `index`: of the sample; negative: what is undefined belongs to none.
std::string undefined_text(const Recording& recording, const StepPlan& plan, int index) {
  if (index < 0)
    return "step '" + plan.name +
           "': the prior terms are not finite at the initial values. "
           "Check the priors";
  const Sample& sample = recording.samples[index];
  std::string views;
  for (const View& v : sample.views)
    if (std::count(plan.sensors.begin(), plan.sensors.end(), v.sensor))
      views += (views.empty() ? "'" : ", '") + recording.rig.sensors[v.sensor].name + "' of '" +
               recording.rig.targets[v.target].name + "'";
  return "step '" + plan.name + "': in sample '" + sample.id +
         "' a residual is undefined at the initial values: a point lies behind a camera, or a "
         "number is not "
         "finite (a sigma is far too small, or a measured number far too large). Its views: " +
         views + ". Check poses, joint readings and the sensor's link";
}

/// How a step is fitted: as the last one; as StepVariations::robust has it; with a solver for
/// later.
struct StepKind {
  bool last, robust, keep_solver;
};

/// A step's fit. `noise_ratios`: of its loss, null: from the residuals. @throws CannotStart,
/// Cancelled
Fit fit_step(const StepPlan& plan, const CalibrationOptions& options, const StepKind& kind,
             const std::vector<double>* noise_ratios, Solution& solution) {
  const Recording& recording = *solution.recording;
  EstimationSetup setup;
  setup.noise = options.noise;
  setup.loss = kind.robust ? Loss{LossKind::cauchy, 3, true} : plan.loss;
  setup.sensors = plan.sensors;
  setup.free = plan.free;
  setup.priors = plan.priors;
  setup.initial = solution.initial;
  FitOptions fit_options;
  fit_options.solver.threads = options.threads;
  fit_options.solver.linear_solver = options.linear_solver;
  fit_options.solver.max_iterations = options.max_iterations;
  fit_options.solver.stop = options.stop;
  // (Where covariances follow the state, a cost that hardly falls says nothing.)
  const bool steady = options.noise == NoiseMode::latent || options.noise == NoiseMode::none;
  if (plan.repeated && options.stop && steady) {
    fit_options.solver.relative_decrease = kRepeatedDecrease;
    fit_options.solver.max_iterations = std::min(options.max_iterations, kRepeatedIterations);
  }
  fit_options.noise_ratios = noise_ratios;
  if (kind.robust) {
    fit_options.start_loss = Loss{LossKind::soft_l1, 3};
    fit_options.leave_out_undefined = true;
    fit_options.converge = false;
  }
  const Progress progress = options.progress.in(plan.name);
  progress.iteration(0);
  fit_options.solver.progress = progress;
  fit_options.targets.progress = progress.in("starting values");
  fit_options.keep_solver = kind.keep_solver;
  fit_options.restart_targets = kind.last;  // (the others are to fit badly, and lead there)
  Fit out;
  try {
    Values start = std::move(solution.values);
    solution.values.shared = start.shared;
    out = fit(recording, recording.training(), setup, std::move(start), fit_options);
  } catch (const std::runtime_error& error) {  // no pose of a target can be evaluated
    throw CannotStart{error.what()};
  }
  solution.values = std::move(out.values);
  if (out.problem->empty())
    throw CannotStart{"step '" + plan.name +
                      "': no sample can start: points lie behind their cameras"};
  if (!out.defined())
    throw CannotStart{
        undefined_text(recording, plan, out.problem->sample_of(out.summary.undefined_group))};
  out.problem->renew(out.state);
  return out;
}

/// What a step reports of itself.
StepResult step_result(const StepPlan& plan, const Fit& step, const Observability& observability,
                       const Solution& solution) {
  StepResult out;
  out.name = plan.name;
  out.unused = plan.unused;
  out.held_out = plan.held_out;
  out.converged = step.summary.outcome == Outcome::converged;
  out.repeated = plan.repeated;
  out.iterations = step.summary.iterations;
  out.history = step.summary.history;
  out.chi2_initial = step.summary.history.front().first;
  out.chi2 = step.summary.cost.chi2;
  out.cost = step.summary.cost.doubled / 2;
  out.dof = observability.dof();
  out.chi2_data = out.chi2 - observability.prior_chi2;
  out.dof_data = observability.dof_data();
  out.unobservable = named_directions(solution.table(), solution.columns, observability);
  return out;
}

/// From the solution's values: a solution, and, if it is to be used again, the solver of its last
/// step. (It has as much memory as all else.)
void run_steps(const std::vector<StepPlan>& plans, const CalibrationOptions& options,
               const StepVariations& variations, bool keep_solver, CalibrationRun& run) {
  Solution& solution = run.solution;
  if (variations.start) solution.values.shared = *variations.start;
  bool all_converged = true;
  for (const StepPlan& plan : plans) {
    const bool last = &plan == &plans.back();
    const auto begin = std::chrono::steady_clock::now();
    if (variations.before_step)
      variations.before_step(plan, solution.initial, solution.values.shared);
    const bool given = last && !variations.noise_ratios.empty();
    Fit step = fit_step(plan, options, {last, variations.robust, last && keep_solver},
                        given ? &variations.noise_ratios : nullptr, solution);
    solution.columns = step.problem->columns();
    auto observed = std::make_unique<LastProblem>();
    observed->observability =
        observe(*step.problem, step.state, last ? &observed->kept_rows : nullptr,
                options.progress.in(plan.name).in("uncertainties"));
    StepResult result = step_result(plan, step, observed->observability, solution);
    result.linear_solver = step.linear_solver;
    result.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    all_converged = all_converged && (result.converged || plan.repeated);
    set_sigmas(observed->observability, plan.name, plan.priors, solution);
    solution.steps.push_back(std::move(result));
    merge(solution.seen_held_out, plan.seen_held_out);
    if (!last) continue;
    const StepResult& end = solution.steps.back();
    solution.chi2 = end.chi2;
    solution.cost = end.cost;
    solution.dof = end.dof;
    solution.chi2_data = end.chi2_data;
    solution.dof_data = end.dof_data;
    solution.unobservable = end.unobservable;
    solution.status = !all_converged              ? Status::not_converged
                      : !end.unobservable.empty() ? Status::unobservable
                                                  : Status::converged;
    if (!all_converged) solution.message = "a step did not converge";
    solution.covariance = observed->observability.covariance;
    solution.setup = step.problem->setup();
    set_values(solution);
    observed->problem = std::move(step.problem);
    observed->state = std::move(step.state);
    solution.last = std::move(observed);
    run.solver = std::move(step.solver);
  }
}

/// A run that is to begin, at the rig's values.
CalibrationRun new_run(const std::shared_ptr<const Recording>& recording,
                       const CalibrationOptions& options, const std::vector<StepPlan>& plans) {
  CalibrationRun out;
  out.solution.recording = recording;
  out.solution.noise = options.noise;
  out.solution.initial = out.solution.values.shared = recording->table.initial;
  out.solution.without_effect = plans.back().without_effect;
  return out;
}

void run_to_end(const std::vector<StepPlan>& plans, const CalibrationOptions& options,
                const StepVariations& variations, bool keep_solver, CalibrationRun& run) {
  try {
    run_steps(plans, options, variations, keep_solver, run);
  } catch (const CannotStart& why) {
    run.solution.status = Status::undefined_start;
    run.solution.message = why.message;
    for (const std::string& pose : run.solution.lost_starts)
      run.solution.message += "; " + lost_start_text(run.solution, pose);
  }
}

/// From where the run begins, or from elsewhere where that ends badly. @throws Cancelled
void run_from_best_start(const std::vector<StepPlan>& plans, const CalibrationOptions& options,
                         const StepVariations& variations, bool keep_solver,
                         CalibrationRun& first) {
  options.progress.stage("starting values");
  start_absent_poses(plans, first.solution);
  run_to_end(plans, options, variations, keep_solver, first);
  // A robust run's cost is in units of what its residuals show: it compares with no other.
  const bool again_possible =
      !variations.start && !variations.before_step &&
      (!variations.robust || first.solution.status == Status::undefined_start);
  if (!again_possible || !ended_badly(first.solution)) return;
  CalibrationRun again = new_run(first.solution.recording, options, plans);
  if (!start_given_poses(plans, first.solution, again.solution)) return;
  run_to_end(plans, options, variations, keep_solver, again);
  if (!decisively_better(again.solution, first.solution)) return;
  name_replaced_starts(plans, first.solution, again.solution);
  first = std::move(again);
}

CalibrationRun run(const std::shared_ptr<const Recording>& recording,
                   const CalibrationOptions& options, const StepVariations& variations,
                   bool keep_solver) {
  const std::vector<StepPlan> plans = resolve_steps(*recording, options);
  CalibrationRun out = new_run(recording, options, plans);
  try {
    run_from_best_start(plans, options, variations, keep_solver, out);
  } catch (const Cancelled&) {
    out.solution.status = Status::cancelled;
    out.solution.message = "cancelled";
  }
  return out;
}

/// The same views with the same points and numbers of sigmas.
bool same_shape(const Sample& a, const Sample& b) {
  return a.readings.size() == b.readings.size() && a.train == b.train &&
         (b.noise.empty() || b.noise.size() == b.readings.size()) &&
         std::equal(a.views.begin(), a.views.end(), b.views.begin(), b.views.end(),
                    [](const View& x, const View& y) {
                      return x.sensor == y.sensor && x.target == y.target && x.ids == y.ids &&
                             x.z.size() == y.z.size() && x.sigma.size() == y.sigma.size() &&
                             x.covariance.size() == y.covariance.size();
                    });
}

}  // namespace

Solution calibrate(const std::shared_ptr<const Recording>& recording,
                   const CalibrationOptions& options, const StepVariations& variations) {
  return run(recording, options, variations, false).solution;
}

struct Calibration::Parts {
  std::shared_ptr<std::vector<Sample>> samples;  // its own: replace() writes into them
  std::shared_ptr<const Recording> recording;    // of them
  CalibrationOptions options;
  bool solved = false;
  CalibrationRun run;
  bool determined = true;                    // all directions, where that was asked last
  bool complete = true;                      // the solution
  std::vector<ParameterEstimate> estimates;  // at earlier values, where it is not
  std::shared_ptr<LastProblem>
      last;  // taken out of the solution, whose copies must not see later solves
};

Calibration::Calibration(const std::shared_ptr<const Recording>& recording,
                         CalibrationOptions options)
    : parts_(new Parts) {
  if (recording->samples.empty()) throw std::invalid_argument("there are no samples");
  resolve_steps(*recording, options);
  parts_->samples = std::make_shared<std::vector<Sample>>(recording->samples);
  for (Sample& sample : *parts_->samples)  // where sigmas of other samples have a place
    if (sample.noise.empty()) sample.noise.assign(sample.readings.size(), 1);
  parts_->recording = make_recording(recording->with_samples(parts_->samples));
  parts_->options = std::move(options);
}

Calibration::~Calibration() = default;
Calibration::Calibration(Calibration&&) noexcept = default;
Calibration& Calibration::operator=(Calibration&&) noexcept = default;

const Recording& Calibration::recording() const { return *parts_->recording; }

std::vector<StepPlan> Calibration::plan() const {
  std::vector<StepPlan> out = resolve_steps(*parts_->recording, parts_->options);
  for (StepPlan& plan : out) count(*parts_->recording, parts_->options.noise, plan);
  return out;
}

const Solution& Calibration::solve() {
  Parts& parts = *parts_;
  Solution& solution = parts.run.solution;
  if (!parts.solved) {
    parts.run = run(parts.recording, parts.options, {}, true);
    parts.last = std::move(solution.last);
    parts.solved = solution.usable();
    parts.determined = solution.unobservable.empty();
    return solution;
  }
  Estimation& problem = *parts.last->problem;
  VectorXd& state = parts.last->state;
  problem.reload();
  const SolveSummary& summary = parts.run.solver->solve(state);
  if (summary.outcome == Outcome::undefined_start || summary.outcome == Outcome::cancelled) {
    const bool cancelled = summary.outcome == Outcome::cancelled;
    solution.status = cancelled ? Status::cancelled : Status::undefined_start;
    solution.message = cancelled ? "cancelled" : "a residual is undefined at the last values";
    state = problem.pack(solution.values);
    return solution;
  }
  problem.unpack(state, solution.values);
  problem.renew(state);
  solution.chi2 = summary.cost.chi2;
  solution.cost = summary.cost.doubled / 2;
  Cost priors;
  if (problem.prior_group() >= 0) problem.evaluate(problem.prior_group(), state, 0, priors);
  solution.chi2_data = solution.chi2 - priors.chi2;
  if (parts.complete) parts.estimates.swap(solution.parameters);
  parts.complete = false;
  solution.unobservable.clear();
  solution.covariance.resize(0, 0);
  solution.dof_data = kNan;
  solution.message.clear();
  solution.status = parts.determined ? Status::converged : Status::unobservable;
  if (summary.outcome != Outcome::converged) {
    solution.status = Status::not_converged;
    solution.message = "the last step did not converge";
  }
  return solution;
}

const Solution& Calibration::last() {
  Solution& solution = parts_->run.solution;
  if (parts_->complete) return solution;
  solution.parameters = std::move(parts_->estimates);
  complete(solution);
  parts_->complete = true;
  parts_->determined = solution.unobservable.empty();
  return solution;
}

void Calibration::replace(int slot, const Sample& sample) {
  std::vector<Sample>& samples = *parts_->samples;
  if (slot < 0 || slot >= static_cast<int>(samples.size()) || !same_shape(samples[slot], sample))
    throw std::invalid_argument("sample " + std::to_string(slot) +
                                " is to be replaced by one that shows the same");
  Sample& to = samples[slot];
  to.readings = sample.readings;
  to.conditions = sample.conditions;
  if (sample.noise.empty())
    std::fill(to.noise.begin(), to.noise.end(), 1);
  else
    to.noise = sample.noise;
  to.time = sample.time;
  for (size_t v = 0; v < to.views.size(); ++v) {
    to.views[v].z = sample.views[v].z;
    to.views[v].sigma = sample.views[v].sigma;
    to.views[v].covariance = sample.views[v].covariance;
  }
}

}  // namespace kincal
