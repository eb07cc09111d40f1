#include "study.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>
#include <stdexcept>

#include "../../kinematics/floating.h"
#include "../analysis/data_equations.h"
#include "../analysis/linearisation.h"
#include "../automatic/further.h"
#include "../automatic/guessed_noise.h"
#include "../doctor/plausibility.h"
#include "../doctor/target_mistakes.h"
#include "../estimation/estimation.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/words.h"
#include "../trials/estimate_noise.h"
#include "exchanged.h"
#include "gauge_freedoms.h"
#include "input_warnings.h"
#include "parameter_warnings.h"
#include "verdict.h"
#include "warnings.h"
#include "wrong_length.h"

namespace kincal {
namespace {

constexpr double kLooksResized = 0.5;  // share of a mistake from which a length is looked for

bool cannot_start(const Solution& solution) { return solution.status == Status::undefined_start; }

AutomaticOptions automatic_options(const StudyOptions& options) {
  AutomaticOptions out;
  static_cast<CalibrationOptions&>(out) = options.calibration;
  out.groups = options.groups;
  out.groups.frames = options.frames;
  return out;
}

/// A recording with the steps that run, and the options for them: on the automatic path those of
/// its starting widths, in which nothing is free that was to be held.
std::shared_ptr<const Recording> with_steps(const std::shared_ptr<const Recording>& recording,
                                            const StudyOptions& options,
                                            CalibrationOptions& calibration) {
  if (!recording->rig.steps.empty()) return recording;
  calibration.fix.clear();
  return kincal::with_steps(*recording, automatic_steps(*recording, automatic_options(options)));
}

/// Mistakes are looked for in the samples as they were used, with the rig as it was given.
void add_diagnosis(const Recording& recording, const StudyOptions& options, Report& report) {
  DoctorOptions doctor;
  doctor.noise = options.calibration.noise;
  doctor.threads = options.calibration.threads;
  const Status status = report.solution.status;
  if (status == Status::undefined_start) doctor.failure = FailureMode::cannot_start;
  if (status == Status::not_converged) doctor.failure = FailureMode::not_converged;
  doctor.progress = options.calibration.progress.in("looking for mistakes");
  report.diagnosis = uncancelled(diagnose(recording, doctor));
  doctor.progress.share(1);
}

/// Sizes, baselines and lenses that came out so far from the rig's that somebody was mistaken, or
/// by this share of that.
std::set<std::string> mistaken_numbers(const Report& report, double share = 1) {
  if (report.automatic.empty()) return {};
  const ParameterTable& table = report.solution.table();
  std::set<std::string> out;
  for (const AutomaticGroup& g : report.automatic)
    for (const AutomaticNumber& n : g.numbers)
      for (const Freed& f : table.select(n.name)) {
        const Scales off = scales(table, {f.parameter, f.components[0]}, table.initial);
        const double wider =  // than usual: the scale of a tilting laser's joint
            off.width < kInfinity ? n.width / (g.factor * off.width) : 1;
        if (!g.held && std::abs(n.value) > share * wider * off.mistaken)
          out.insert(table.all[f.parameter].name);
      }
  return out;
}

/// Whether a group came out so much worse than usual that it may take a mistake up, or a number or
/// a sensor's turn so far from the rig's that somebody was mistaken: residuals are good then.
bool takes_up_a_mistake(const Report& report) {
  return !mistaken_numbers(report).empty() || is_a_given_pose_turned(report.solution) ||
         std::any_of(report.automatic.begin(), report.automatic.end(), is_unusual);
}

/// The rig as it was found, but for parameters that somebody was mistaken about: these as given.
Rig found_but_for(const std::set<std::string>& mistaken, const Solution& solution) {
  const ParameterTable& table = solution.table();
  const VectorXd& values = solution.values.shared;
  Rig rig = solution.rig();
  rig.nominal.clear();
  for (const Parameter& p : table.all) {
    if (p.hidden() || mistaken.count(p.name)) continue;
    NominalValue found;
    found.parameter = p.name;
    if (p.pose) found.pose = get_pose(values, p.start);
    found.numbers.assign(values.data() + p.start,
                         values.data() + p.start + (p.pose ? 0 : p.size()));
    rig.nominal.push_back(found);
  }
  rig = centred(std::move(rig));
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    rig.sensors[s].link_T_sensor = get_pose(values, table.all[table.sensor_pose[s]].start);
    rig.sensors[s].pose_given = true;
  }
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    if (rig.targets[t].link < 0) continue;
    rig.targets[t].link_T_target = get_pose(values, table.all[table.target_pose[t]].start);
    rig.targets[t].pose_given = true;
  }
  for (size_t j = 0; j < rig.joints.size(); ++j)
    if (table.joint_offset[j] >= 0)
      rig.joints[j].offset = values(table.all[table.joint_offset[j]].start);
  rig.steps.resize(1);  // the mounts
  return rig;
}

bool finds_a_mistake(const Diagnosis& diagnosis) {
  return std::any_of(diagnosis.findings.begin(), diagnosis.findings.end(),
                     [](const Notice& f) { return can_spoil_the_fit(f.kind); });
}

/// Sizes of targets that came out so far from the rig's that they were mistaken.
Notices mistaken_sizes(const std::set<std::string>& mistaken, const Solution& solution) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  Notices out;
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    const int square = table.target_square[t];
    if (square < 0 || !mistaken.count(table.all[square].name)) continue;
    const int at = table.all[square].start;
    out.push_back(
        make_notice(NoticeKind::square, {Subject::target(rig.targets[t].name)},
                    wrong_size(rig.targets[t], solution.values.shared(at) / table.initial(at)), "",
                    kMeasureSize));
  }
  return out;
}

/// Mistakes that the automatic path took up in what it freed: first as if nothing but mounts and
/// offsets were wrong; then with all as it was found but for numbers that somebody was mistaken
/// about.
void look_for_what_was_taken_up(const Rig& given, const StudyOptions& options, Report& report) {
  const Solution& solution = report.solution;
  add_diagnosis(solution.recording->with_rig(given), options, report);
  const std::set<std::string> mistaken = mistaken_numbers(report);
  Notices& findings = report.diagnosis->findings;
  if (!first_mistake(report))
    for (Notice& size : mistaken_sizes(mistaken, solution)) findings.push_back(std::move(size));
  if (!first_mistake(report) && !mistaken.empty() && solution.rig().steps.size() > 1)
    add_diagnosis(solution.recording->with_rig(found_but_for(mistaken, solution)), options, report);
  if (report.diagnosis->findings.empty()) report.diagnosis.reset();
}

bool is_guessed(const Rig&, const NoiseLevel& level) { return level.guess > 0; }

bool guesses_noise(const Rig& rig) {
  return std::any_of(rig.sensors.begin(), rig.sensors.end(),
                     [](const Sensor& s) { return !s.noise_guess.empty(); }) ||
         std::any_of(rig.joints.begin(), rig.joints.end(),
                     [](const JointSettings& j) { return j.noise_guess > 0 && j.sigma > 0; });
}

/// In the other modes that of sensors is mixed with that of joints.
bool can_estimate_noise(const CalibrationOptions& options) {
  return options.noise == NoiseMode::latent || options.noise == NoiseMode::none;
}

void take(AutomaticCalibration found, Report& report) {
  report.solution = std::move(found.solution);
  report.automatic = std::move(found.groups);
  report.other_models = std::move(found.other_models);
  report.pose_errors = std::move(found.pose_errors);
  report.unchecked = std::move(found.unchecked);
  report.gauges = std::move(found.gauges);
  report.mounts = std::move(found.mounts);
  const std::vector<std::string> kept = begin_at(report.solution, report.automatic).further;
  for (TriedGroup& one : found.tried) {  // (those kept before are not tried again)
    const auto known = std::find_if(report.tried.begin(), report.tried.end(),
                                    [&](const TriedGroup& t) { return t.name == one.name; });
    if (known == report.tried.end())
      report.tried.push_back(std::move(one));
    else
      *known = std::move(one);
  }
  for (TriedGroup& one : report.tried)
    if (one.outcome == TriedGroup::Outcome::kept && !std::count(kept.begin(), kept.end(), one.name))
      one.outcome = TriedGroup::Outcome::lost;
  for (Stage& stage : found.stages) {
    if (stage.further.empty()) report.stages.clear();
    report.stages.push_back(std::move(stage));
  }
  const auto is_kept = [&](const std::string& g) {
    return std::count(kept.begin(), kept.end(), g);
  };
  report.stages.erase(  // those with a model that was lost later, or with all of them
      std::remove_if(report.stages.begin(), report.stages.end(),
                     [&](const Stage& stage) {
                       return stage.further.size() >= kept.size() ||
                              !std::all_of(stage.further.begin(), stage.further.end(), is_kept);
                     }),
      report.stages.end());
  const bool corrects = std::any_of(kept.begin(), kept.end(), corrects_readings);
  report.rigid = corrects && !report.stages.empty() ? report.stages.front().solution : nullptr;
}

/// The samples of the solution, noise that nobody states as it was guessed, with the rig as given.
Recording as_guessed(const Report& report, const Rig& given) {
  std::vector<NoiseLevel> levels = report.noise_levels;
  for (NoiseLevel& level : levels) level.seen = level.guess > 0 ? level.guess : kNan;
  return scale_noise(*report.solution.recording, levels).with_rig(given);
}

/// On the automatic path, where the residuals are not of the stated size and no mistake explains
/// that (far from it: where the stated noise does): everything again with noise of the size that
/// they have. Larger residuals: levels of joints and sensors together (else the sensors take up
/// what all corners of a view share). Smaller ones: all stated sigmas by the same factor, which
/// leaves the estimates where they are. (Levels of their own would take model errors for noise of
/// this or that joint, and let go of its readings.)
void find_noise(const Rig& given, const StudyOptions& options,
                const CalibrationOptions& calibration, Report& report) {
  const double ratio = report.solution.chi2_per_dof();
  if (!report.solution.usable() || is_of_stated_size(ratio, report.solution.dof_data) ||
      options.estimate_noise || !can_estimate_noise(calibration))
    return;
  const bool far = ratio > kMistaken;
  if (far && counts_from_identity(report.solution)) return;  // (that is why, see study())
  if (options.diagnose && ratio > 1) {                       // (no mistake makes residuals smaller)
    // (What the automatic path frees may take a large mistake up.)
    add_diagnosis(far ? as_guessed(report, given) : report.solution.recording->training_only(),
                  options, report);
    const Notices& found = report.diagnosis->findings;
    if (finds_a_mistake(*report.diagnosis) ||
        (far && std::none_of(found.begin(), found.end(),
                             [](const Notice& f) { return f.kind == NoticeKind::wrong_sigma; })))
      return;
    if (!far) report.diagnosis.reset();
  } else if (far) {
    return;
  }
  std::vector<NoiseLevel> levels = noise_levels(linearise(report.solution));
  AutomaticOptions automatic = automatic_options(options);
  automatic.begin = begin_at(report.solution, report.automatic);
  automatic.noise_is = ratio < 1 ? StatedNoise::scaled : StatedNoise::wrong;
  AutomaticCalibration found =
      uncancelled(calibrate_automatically(*report.solution.recording, automatic));
  if (!found.solution.usable()) return;
  report.noise_estimated = NoiseRounds{1, found.noise_at_rest, ratio};
  for (NoiseLevel& level : levels)
    if (level.guess == 0)
      level.used = level.assumed * first_sigma(found.solution.rig(), level) /
                   first_sigma(report.solution.rig(), level);
  take(std::move(found), report);
  report.noise_levels = std::move(levels);
}

/// A message of each group that was asked for by name and is held, or is among the usual ones, and
/// where the data speak for none of a name.
void say_groups_without_effect(const GroupChoice& choice, Report& report) {
  std::vector<std::string>& out = report.solution.without_effect;
  for (const std::string& name : choice.with) {
    bool exists = report.automatic.empty();
    for (const AutomaticGroup& g : report.automatic) {
      if (g.name != name && !glob_matches(name, g.name)) continue;
      exists = true;
      if (g.held && !g.numbers.empty()) {
        out.push_back("`group` " + quoted(g.name) +
                      " was requested, but its parameters keep their nominal values: " +
                      text("the data give too little evidence of an error (log evidence %.1f, 3 is "
                           "needed). ",
                           g.gain) +
                      "To estimate them anyway, free each by name (`free`), for example " +
                      g.numbers[0].name);
      } else if (!g.held && g.name != kGears) {
        out.push_back("`group` " + quoted(g.name) +
                      " has no effect: this group is always tried, and was estimated");
      }
    }
    if (!exists)
      out.push_back("`group` " + quoted(name) +
                    " was requested, but the data give no evidence for it");
  }
}

/// Whether the noise of a rig with steps is estimated: on demand, or as nobody states it.
bool estimates_noise(const Rig& rig, const StudyOptions& options) {
  return !rig.steps.empty() && (options.estimate_noise || guesses_noise(rig)) &&
         can_estimate_noise(options.calibration);
}

/// Parts 1 to 4 up to the solution. The recording returned has the samples as given.
/// `rig` is as the user gave it.
std::shared_ptr<const Recording> solve(const std::shared_ptr<const Recording>& given,
                                       const Rig& rig, const StudyOptions& options,
                                       Report& report) {
  CalibrationOptions calibration = options.calibration;
  const bool automatic = given->rig.steps.empty();
  const std::shared_ptr<const Recording> recording = with_steps(given, options, calibration);
  std::shared_ptr<const Recording> left = recording;
  bool solved = false;
  if (options.reject) {
    Cleaned clean = uncancelled(calibrate_without_outliers(left, calibration));
    report.solution = std::move(clean.solution);
    report.rejected = std::move(clean.rejected);
    report.no_consensus = std::move(clean.no_consensus);
    left = report.solution.recording;
    solved = !automatic;
    if (cannot_start(report.solution)) return recording;
  }
  if (automatic) {
    take(uncancelled(calibrate_automatically(*left, automatic_options(options))), report);
    solved = true;
    if (cannot_start(report.solution)) return recording;
    find_noise(rig, options, calibration, report);
    say_groups_without_effect(options.groups, report);
    left = report.solution.recording;
  }
  if (options.estimate_noise || estimates_noise(given->rig, options)) {
    NoiseEstimate estimate = uncancelled(
        estimate_noise(left, calibration, options.estimate_noise ? nullptr : is_guessed));
    report.solution = std::move(estimate.solution);
    if (options.estimate_noise) {
      report.noise_levels = std::move(estimate.levels);
      report.noise_estimated = NoiseRounds{estimate.rounds, estimate.converged};
    }
    report.no_consensus.clear();  // it was about the calibration before
    solved = true;
    if (automatic && report.solution.usable()) {  // what may be wrong is to be learned with these
      AutomaticOptions again = automatic_options(options);
      again.begin = begin_at(report.solution, report.automatic);
      take(uncancelled(calibrate_automatically(*report.solution.recording, again)), report);
    }
  }
  if (!solved) report.solution = uncancelled(calibrate(left, calibration));
  return automatic ? make_recording(recording->with_rig(report.solution.rig())) : recording;
}

/// What cross-validation is made of: the samples as given, with the sigmas of the result.
std::shared_ptr<const Recording> recording_to_fold(const Recording& given, const Report& report) {
  std::vector<NoiseLevel> levels = report.noise_levels;
  for (NoiseLevel& level : levels) {
    level.seen = level.used;
    if (level.guess > 0) level.assumed = level.guess;
  }
  return make_recording(scale_noise(given, levels).with_rig(report.solution.rig()));
}

/// The held-out errors of each stage. `sums` has those of the final calibration. `fold`:
/// cross-validates another recording; null: the samples that were held out.
StageErrors stage_errors(const Report& report, const Blocks& blocks, HeldOutSums sums,
                         const std::function<HeldOutSums(const Solution&)>& fold) {
  std::vector<HeldOutSums> all;
  for (const Stage& stage : report.stages) {
    const Solution& solution = *stage.solution;
    all.emplace_back();
    if (fold)
      all.back() = fold(solution);
    else
      all.back().add(*solution.recording, held_out_as_read(solution, solution.values.shared),
                     indices(solution.samples().size()));
  }
  all.push_back(std::move(sums));
  return {fold != nullptr,
          compare_stages(report.solution.rig(), blocks, report.stages,
                         begin_at(report.solution, report.automatic).further, all)};
}

/// Held-out errors and cross-validation; on the automatic path of simpler calibrations, too: of the
/// mounts alone, and of the rig as it is.
void add_held_out(const Rig& as_it_is, const Recording& given, const StudyOptions& options,
                  Report& report) {
  const Solution& solution = report.solution;
  Validation& validation = report.validation;
  const bool automatic = !report.automatic.empty();  // more than mounts was free
  BaselineSums sums;
  validation.held_out = options.held_out;
  validation.test = held_out_errors(solution, report.residuals);
  const bool judged = !validation.test.empty();
  const auto compare = [&](const Blocks& blocks) {
    validation.baselines =
        Baselines{!judged, gives_poses(as_it_is), compare_baselines(solution.rig(), blocks, sums)};
  };
  if (automatic && judged) {
    const std::vector<int> all = indices(solution.samples().size());
    add_baselines(as_it_is, solution, report.mounts, options.calibration, all, sums);
    sums.automatic.add(*solution.recording, report.residuals, all);
    const Blocks blocks = make_blocks(solution.rig(), solution.samples());
    compare(blocks);
    if (!report.stages.empty())
      validation.stages = stage_errors(report, blocks, sums.automatic, nullptr);
  }
  if (options.cross_validate == 0) return;
  FoldJudge fold;
  if (automatic && !judged)
    fold = [&](const Solution& found, const std::vector<int>& index) {
      if (const std::optional<VectorXd> mounts = mounts_alone(found, options.calibration))
        add_baselines(as_it_is, found, *mounts, options.calibration, index, sums);
    };
  FoldFit fit = options.reject ? fit_without_outliers : fit_all;
  std::shared_ptr<const Recording> folded =
      options.reject ? recording_to_fold(given, report) : solution.recording;
  if (estimates_noise(as_it_is, options)) {  // with steps: each fold estimates it by itself
    folded = make_recording(given);
    fit = [reject = options.reject, which = options.estimate_noise ? nullptr : is_guessed](
              const std::shared_ptr<const Recording>& of, const CalibrationOptions& how) {
      Cleaned out;
      if (reject)
        out = fit_without_outliers(of, how);
      else
        out.kept = indices(of->samples.size());
      if (out.solution.status != Status::undefined_start || !reject)
        out.solution =
            uncancelled(estimate_noise(reject ? out.solution.recording : of, how, which)).solution;
      return out;
    };
  }
  validation.cross_validation =
      uncancelled(cross_validate(folded, options.calibration, options.cross_validate, fit, fold));
  validation.cross_validation->reject = options.reject;
  if (!fold) return;
  sums.automatic = validation.cross_validation->sums;
  compare(validation.cross_validation->blocks);
  if (report.stages.empty()) return;
  validation.stages = stage_errors(
      report, validation.cross_validation->blocks, sums.automatic, [&](const Solution& stage) {
        const Recording models = with_models_of(*folded, *stage.recording);
        return uncancelled(cross_validate(with_steps(models, stage.rig().steps),
                                          options.calibration, options.cross_validate, fit))
            .sums;
      });
}

void analyse(const Rig& as_it_is, const Recording& given, const StudyOptions& options,
             Report& report) {
  const CalibrationOptions& calibration = options.calibration;
  const Progress progress = calibration.progress.in("uncertainties and residuals");
  const Linearisation at = linearise(report.solution);
  report.leverage = leverage(at, progress.between(0, 0.2));
  report.data = data_equations(at);
  report.more = more_data(at, report.data);
  at.drop_reduced_rows();
  report.explanation = explain(at);
  std::vector<ViewResiduals> views = at.problem().residuals(at.state());
  const std::vector<NoiseLevel> levels = noise_levels(at, views, progress.between(0.3, 0.6));
  if (!report.noise_estimated) report.noise_levels = levels;
  for (NoiseLevel& level : report.noise_levels)  // as the data show it at last
    for (const NoiseLevel& now : levels) {
      if (now.of != level.of || now.part != level.part) continue;
      const NoiseLevel before = level;
      level = now;
      if (before.guess > 0) continue;
      level.assumed = before.assumed;
      level.used = before.used;
    }
  report.residuals = residuals(at, std::move(views), progress.between(0.4, 1));
  if (report.rigid) add_uncorrected(*report.rigid, report.residuals);
  report.deflections = deflections(report.solution);
  report.curves = joint_curves(report.solution);
  progress.share(1);
  report.misfits = misfits(report.solution, report.residuals);
  report.trends = trends(report.solution);
  report.jumps = jumps(report.solution);
  const Solution& solution = report.solution;
  const bool badly =
      solution.status == Status::not_converged || solution.chi2_data > 10 * solution.dof_data;
  if (badly && !options.reject)
    report.outliers = uncancelled(find_outliers(solution.recording, calibration));
  if (options.restarts > 0)
    report.restarts = uncancelled(restarts(solution, calibration, options.restarts));
  calibration.progress.stage("loops");
  if (options.loops) {
    report.loop_views = loop_views(solution);
    report.loops = loops(solution, report.loop_views);
    report.position_covariances = position_covariances(solution, last_unknowns(at));
  }
  add_held_out(as_it_is, given, options, report);
  Validation& validation = report.validation;
  if (!options.frames.empty()) {
    calibration.progress.stage("frames");
    const Unknowns unknowns = last_unknowns(at);
    for (const std::string& name : options.frames)
      validation.frames.push_back(report_frame(
          solution, unknowns, find_frame(solution.rig(), solution.table(), name).value()));
  }
  for (const Requirement& r : options.requirements)
    validation.requirements.push_back(
        judge_requirement(r, validation, report.residuals.sensors, solution.chi2_per_dof()));
}

}  // namespace

std::optional<Report> study(const std::shared_ptr<const Recording>& recording,
                            const StudyOptions& options) try {
  Report report;
  report.input = find_implausible(recording->rig, recording->samples);
  const std::shared_ptr<const Recording> given =
      solve(recording->rig.steps.empty()
                ? make_recording(recording->with_rig(with_pair_poses(centred(recording->rig))))
                : recording,
            recording->rig, options, report);
  const Solution& solution = report.solution;
  const bool undefined = solution.status == Status::undefined_start;
  if (!undefined) analyse(recording->rig, *given, options, report);
  const bool whole = options.calibration.last_step.empty(),
             badly = solution.status != Status::converged ||
                     solution.chi2_data > kUnexplained * solution.dof_data;
  const double noise = beyond_guess(report);  // with a guess a mistake looks like noise
  // (Where a pose that nobody gave is held in part, that is why: other mistakes cannot be told.)
  const std::optional<Notice> held =
      badly && recording->rig.steps.empty() ? counts_from_identity(solution) : std::nullopt;
  if (undefined && held)
    report.solution.message =
        sentences(*held) + ". So no calibration can start: " + report.solution.message;
  if (!held &&
      (options.diagnose
           ? badly || noise > kUnexplained
           : whole && solution.usable() && std::max(data_misfit(report), noise) > kMistaken) &&
      !report.diagnosis) {
    const Recording used = undefined ? *given : as_guessed(report, given->rig);
    // (What the automatic path frees may take a mistake up.)
    add_diagnosis(recording->rig.steps.empty() ? used.with_rig(recording->rig) : used, options,
                  report);
    if (!badly && !finds_a_mistake(*report.diagnosis)) report.diagnosis.reset();
  } else if (options.diagnose && !report.diagnosis && takes_up_a_mistake(report)) {
    look_for_what_was_taken_up(recording->rig, options, report);
  }
  // (Lengths of a rig that was calibrated before count from its nominal values, not the URDF's.)
  if (options.diagnose && !badly && recording->rig.nominal.empty())
    find_wrong_length(mistaken_numbers(report, kLooksResized), report);
  if (options.diagnose && solution.status == Status::converged && !report.diagnosis) {
    Notices other = not_as_given(solution, report.residuals);
    if (!other.empty()) report.diagnosis.emplace().findings = std::move(other);
  }
  report.gauge_freedoms = std::make_shared<const GaugeFreedoms>(find_gauge_freedoms(report));
  // (With steps it was the user who freed the pose, and a wide prior may be what he wants.)
  if (recording->rig.steps.empty() && report.solution.status == Status::converged &&
      has_open_mount(report)) {
    report.solution.status = Status::unobservable;
    report.solution.message = sentences(loose_parameters(report).value());
  }
  report.unexplained = why_unexplained(report);
  if (report.unexplained && report.solution.status == Status::converged &&
      options.calibration.last_step.empty()) {
    report.solution.status = Status::unexplained;
    report.solution.message = sentences(*report.unexplained);
  }
  report.warnings = warnings(report);
  report.verdict = verdict(report);
  report.solution.last.reset();
  return report;
} catch (const Cancelled&) {
  return std::nullopt;
}

}  // namespace kincal
