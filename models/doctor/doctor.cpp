#include "doctor.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "../fitting/free_targets.h"
#include "../rig/words.h"
#include "alternatives.h"
#include "camera_mistakes.h"
#include "choice.h"
#include "data_checks.h"
#include "plausibility.h"
#include "stated_sigmas.h"
#include "suspects.h"
#include "target_mistakes.h"
#include "trial_fits.h"
#include "two_parts.h"

namespace kincal {
namespace {

using SharedRecording = std::shared_ptr<const Recording>;

// ------------------------------------------------------------------------------------------------
// prove
/// What chi2 is with the mistake and without, and a sentence about it.
struct Evidence {
  std::optional<double> before, after;
  std::string sentences;  // without the last full stop
};

/// `what`: what the second fit is without.
Evidence prove_by_chi2(const TrialFit& now, const TrialFit& fit,
                       const char* what = "this mistake") {
  Evidence out;
  if (now.complete()) out.before = now.chi2;
  out.after = fit.chi2;
  out.sentences = now.complete()
                      ? text("chi2 is %.6g as it is (chi2/dof %.3g) and %.6g (%.3g) without %s",
                             now.chi2, now.per_dof(), fit.chi2, fit.per_dof(), what)
                      : text(
                            "Without changes the fit cannot even start (points behind a camera); "
                            "without %s chi2 is %.6g (chi2/dof %.3g)",
                            what, fit.chi2, fit.per_dof());
  return out;
}

/// Of a fit that leaves nothing to explain: which parameters moved far, and come back without the
/// mistake.
Evidence prove_by_movement(const TrialFit& now, const TrialFit& fit) {
  std::string names;
  double before = 0, after = 0;
  for (const auto& [name, moved] : now.moved) {
    const auto other = fit.moved.find(name);
    if (moved.times < 1 || other == fit.moved.end() || other->second.times > 0.2 * moved.times)
      continue;
    names += (names.empty() ? "" : ", ") + name;
    before = std::max(before, moved.by);
    after = std::max(after, other->second.by);
  }
  Evidence out = prove_by_chi2(now, fit);
  if (!names.empty())
    out.sentences =
        "With the mistake, " + names +
        text(
            " must move by up to %.3g (m, rad, or share of a length); without it, by %.3g. "
            "chi2 is %.6g as it is and %.6g without",
            before, after, now.chi2, fit.chi2);
  return out;
}

/// "Or it is ...", of other mistakes that are as likely.
std::string or_else(const AcceptedHypothesis& best) {
  std::map<std::string, double> odds;  // by name: one mistake may be undone in several ways
  for (const Alternative& a : best.as_likely)
    odds[std::string(id(a.kind)) + " (" + joined(names_of(a.where)) + ")"] +=
        std::exp(a.log_odds - best.log_odds);
  std::string out;
  for (const auto& [name, times] : odds)
    out += (out.empty() ? ". Or it is " : ", or ") + name +
           text(": that is %.2g times as likely", times);
  return out;
}

// ------------------------------------------------------------------------------------------------
// scale and word
/// Gives the targets the sizes that the fit found, and replaces what the hypothesis has by these.
/// `before`: the rig with the mistake.
void scale(const Rig& before, AcceptedHypothesis& accepted, Rig& rig) {
  Hypothesis& h = accepted.hypothesis;
  const std::vector<double> factors = size_factors(before, h, accepted.trial);
  h.mistake.clear();
  h.where.clear();
  double largest = 0;
  for (const double factor : factors) largest = std::max(largest, std::abs(std::log(factor)));
  for (size_t i = 0; i < factors.size(); ++i) {
    const Target& old = before.targets[h.squares[i]];
    rig.targets[h.squares[i]].square = (old.grid ? old.square : 1) * factors[i];
    if (std::abs(std::log(factors[i])) < 0.1 * largest) continue;  // tried with others: it is right
    h.where.push_back(Subject::target(old.name));
    h.mistake += h.mistake.empty() ? "" : "; ";
    h.mistake += wrong_size(old, factors[i]);
  }
  h.cure = kMeasureSize;
}

Notice word(const Hypothesis& h, const Evidence& evidence) {
  Notice finding = make_notice(h.kind, h.where, h.mistake, evidence.sentences, h.cure);
  finding.chi2_as_is = evidence.before;
  finding.chi2_corrected = evidence.after;
  return finding;
}

/// The recording; one whose rig calls all readings exact, as none are, with a guess of their noise.
SharedRecording with_guessed_readings(const SharedRecording& recording,
                                      const TrialContext& context) {
  Rig rig = recording->rig;
  if (context.noise != NoiseMode::latent ||
      std::any_of(rig.joints.begin(), rig.joints.end(),
                  [](const JointSettings& joint) { return joint.sigma > 0; }))
    return recording;
  for (JointSettings& joint : rig.joints)
    joint.sigma = joint.noise_guess = Thresholds::guessed_reading;
  return make_recording(recording->with_rig(std::move(rig)));
}

/// What was found so far: the mistakes, the recording with them undone, and the fit of that.
struct State {
  SharedRecording given, recording;
  TrialContext context;
  TrialFit now;
  std::vector<Notice> findings;
  std::optional<Hypothesis> last = {};  // that was found

  /// The log density of the views and points that were left out, with the prior of the findings.
  double log_besides() const {
    return log_left_out(*given, *recording, now) +
           log_prior(false, 1) * static_cast<double>(findings.size());
  }
  double log() const { return log_evidence(*recording, context, context.all, now) + log_besides(); }
  /// The subjects of the findings.
  Subjects about() const {
    Subjects out;
    for (const Notice& f : findings) out.insert(out.end(), f.where.begin(), f.where.end());
    return out;
  }
  double log_either_way() const {
    return log_evidence_either_way(*with_guessed_readings(recording, context), context, now) +
           log_besides();
  }
  void undo(Trial trial, Rig rig) {
    recording = make_recording(trial.recording.with_rig(std::move(rig)));
    context.all = std::move(trial.spec);
    context.given_poses_freed = frees_given_poses(*recording, context.all);
    now = std::move(trial.fit);
  }
};

/// Undoes a mistake and reports it with this evidence.
void undo_and_tell(AcceptedHypothesis best, Evidence evidence, State& state) {
  Hypothesis& h = best.hypothesis;
  const bool hidden = good(state.now);
  state.last = h;
  evidence.sentences += or_else(best);
  Rig rig = best.trial.recording.rig;
  if (!h.squares.empty()) scale(state.recording->rig, best, rig);
  if (h.told) std::tie(h.mistake, h.cure) = told(h, best.trial);
  if (hidden && h.kind == NoticeKind::mirrored &&
      std::any_of(rig.targets.begin(), rig.targets.end(), [&](const Target& t) {
        return t.grid && t.pose_given &&
               std::count(h.where.begin(), h.where.end(), Subject::target(t.name)) > 0;
      }))
    h.cure +=
        ". Or the points are right, and the pose in the rig has z pointing out of the board, while "
        "kincal's z points into it (x along a row, y from row to row): then the estimate is right "
        "and nothing has to be done";
  state.findings.push_back(word(h, evidence));
  state.undo(std::move(best.trial), std::move(rig));
}

/// Weighs all mistakes, undoes the likeliest and reports it; false if none is a finding.
bool explain(State& state) {
  std::optional<AcceptedHypothesis> best = choose(*state.recording, state.context, state.now);
  if (!best) return false;
  const bool hidden = state.now.per_dof() < Thresholds::clean_gain * best->trial.fit.per_dof();
  Evidence evidence = hidden ? prove_by_movement(state.now, best->trial.fit)
                             : prove_by_chi2(state.now, best->trial.fit);
  undo_and_tell(std::move(*best), std::move(evidence), state);
  return true;
}

/// Leaves what was found last alone, where that is likelier: what was found before it only seemed
/// to explain something.
void drop_the_former(const State& as_given, State& state) {
  State alone = as_given;
  alone.context.tried = nullptr;
  Trial trial = fit_without(*as_given.recording, as_given.context, *state.last);
  if (!std::isfinite(trial.cost)) return;
  Evidence evidence = prove_by_chi2(as_given.now, trial.fit);
  undo_and_tell({*state.last, std::move(trial), 0, {}}, std::move(evidence), alone);
  if (alone.log() > state.log()) state = std::move(alone);
}

/// The likeliest state with two mistakes undone: one of the first looks, and the mistake found on
/// top of it; without findings where no pair is likelier than the data as they are.
State explain_two(const State& as_given) {
  State best = as_given;
  double most = as_given.log() + kFound;
  for (AcceptedHypothesis& first :
       first_looks(*as_given.recording, as_given.context, as_given.now)) {
    State two = as_given;
    undo_and_tell(std::move(first), {}, two);
    if (!explain(two)) continue;
    const double log = two.log() - log_by_chance({{*as_given.recording, as_given.now}},
                                                 {{*two.recording, two.now}}, two.about());
    if (!(log > most)) continue;
    most = log;
    best = std::move(two);
  }
  const Evidence evidence = prove_by_chi2(as_given.now, best.now, "both");
  for (Notice& f : best.findings) {
    const bool is_first = &f == &best.findings.front();
    f.chi2_as_is = evidence.before;
    f.chi2_corrected = evidence.after;
    f.why = std::string("This and ") +
            id((is_first ? best.findings.back() : best.findings.front()).kind) +
            " are two mistakes; neither alone explains the data. " + evidence.sentences;
  }
  return best;
}

/// joint_noise(), of readings whose noise nobody states as well.
std::string noise_of_readings(const State& state, const FreerFit& freer) {
  const SharedRecording noisy = with_guessed_readings(state.recording, state.context);
  if (noisy == state.recording) return joint_noise(*noisy, freer.evidence);
  const auto found = fit_with_usual_errors(*noisy, state.context, state.context.all, state.now);
  return found ? joint_noise(*noisy, found->evidence, 0) : "";
}

/// Two parts that contradict each other, likelier than what was found.
std::optional<Changed> changed_between(const State& as_given, const State& state) {
  const SharedRecording noisy = with_guessed_readings(as_given.recording, as_given.context);
  std::optional<Changed> out =
      two_parts(*noisy, as_given.context,
                noisy == as_given.recording ? as_given.now : fit_as_is(*noisy, as_given.context));
  if (out && !state.findings.empty() && !(out->log_evidence > state.log_either_way())) out.reset();
  return out;
}

/// Says first of mistakes that leave what no noise explains that they are not all of it, or not
/// made at all. (`now` has the sigmas as they are stated.)
void say_what_is_left(const TrialFit& now, std::vector<Notice>& findings) {
  if (!now.complete() || !(now.per_dof() > Thresholds::no_noise)) return;
  for (Notice& f : findings) {
    if (f.kind == NoticeKind::wrong_sigma) continue;
    f.what =
        text("not the only mistake, or not made (chi2/dof is %.3g without it): ", now.per_dof()) +
        f.what;
    f.cure += ". Look for a further mistake or a different one";
  }
}

// ------------------------------------------------------------------------------------------------
// search
/// Adds the proof to joints that never move in the log but did; true if there is one. Such a joint
/// can look like many things: it goes first, and then nothing else can be concluded. (Its
/// hypothesis cannot decide that: without its readings the fit of many samples ends in some local
/// minimum.)
bool prove_still_joints(const Recording& recording, const TrialContext& context,
                        const TrialFit& now, std::vector<Notice>& findings) {
  bool found = false;
  for (Notice& f : findings) {
    if (f.kind != NoticeKind::still_joint || good(now)) continue;
    context.progress.share(0);
    Rig rig = recording.rig;
    rig.joints[rig.tree.find_joint(f.where[0].name)].sigma = 1;
    const TrialFit unknown =
        best_fit(recording.with_rig(std::move(rig)), context, context.all, {100, 1e-6});
    if (!unknown.complete() || (now.complete() && now.cost < Thresholds::decisive * unknown.cost))
      continue;
    found = true;
    if (now.complete()) f.chi2_as_is = now.chi2;
    f.chi2_corrected = unknown.chi2;
    f.why = "it did move: " +
            (now.complete() ? text("chi2 is %.6g as it is", now.chi2)
                            : "the fit cannot even start as it is") +
            text(" and %.6g with its readings unknown", unknown.chi2);
  }
  return found;
}

/// What the verdict is about.
struct Outcomes {
  FailureMode failure;  // the calibration that was diagnosed
  double per_dof_at_first;
  bool good_at_first;                       // its residuals need no explanation
  bool data_findings;                       // some mistake shows in the data alone
  bool wrong_numbers;                       // numbers among them that nobody can mean
  bool fit_findings;                        // some mistake was found by fits
  bool still_joint;                         // one of the former explains the fit
  bool changed;                             // two parts of the data contradict each other
  const std::string& readings;              // what errors of the joint readings would explain
  std::optional<double> with_usual_errors;  // Diagnosis::with_usual_errors
};

/// Of data that need no explanation, but whose calibration ended badly.
std::string not_a_mistake(const TrialFit& now, FailureMode failure) {
  std::string far;
  for (const auto& m : now.moved)
    if (m.second.times > 1)
      far += (far.empty() ? "" : ", ") + m.first + text(" (%.3g)", m.second.by);
  if (failure == FailureMode::cannot_start)
    return " from other starting values, found from the data. So none of these mistakes was made, "
           "but no fit can start from the rig's values: " +
           (far.empty() ? "give poses nearer to the truth, or delete them"
                        : "too far from the truth are " + far +
                              " (m, rad, or share of a length): correct them, or delete them") +
           ".";
  if (failure == FailureMode::not_converged)
    return " if everything is estimated at once instead of in steps. So none of these mistakes was "
           "made, but the steps do not reach the minimum: start nearer to the truth" +
           (far.empty() ? "" : " (" + far + ")") +
           ", or estimate fewer parameters in the first steps.";
  return "";
}

/// What fits worst, and where to look, of a fit that no noise explains.
std::string look_for_mistakes(const Rig& rig, const TrialFit& now) {
  int worst = -1;
  for (size_t s = 0; s < now.sensor.size(); ++s)
    if (!std::isnan(now.sensor[s]) && (worst < 0 || now.sensor[s] > now.sensor[worst]))
      worst = static_cast<int>(s);
  return " This is not a robot with small geometric errors: look for a mistake before more "
         "parameters are estimated" +
         (worst < 0 ? std::string()
                    : ", first in what sensor " + quoted(rig.sensors[worst].name) +
                          text(" sees, whose errors are %.3g times its sigma",
                               std::sqrt(now.sensor[worst]))) +
         " (its link, its target's link and size, ids, units, whether readings and views belong "
         "together).";
}

/// `now`: the fit with everything undone that was found.
std::string verdict(const Recording& recording, const TrialContext& context, const TrialFit& now,
                    const Outcomes& outcomes) {
  std::string out =
      std::isfinite(outcomes.per_dof_at_first)
          ? text("chi2/dof is %.3g", outcomes.per_dof_at_first)
          : "the fit cannot start: points lie behind a camera, or numbers are not finite";
  if (!std::isfinite(outcomes.per_dof_at_first) && some_sensor_tells_no_pose(recording.rig))
    out += ", or the sensor of a free target does not determine its pose";
  const bool any_finding = outcomes.data_findings || outcomes.fit_findings;
  if (good(now) && (outcomes.good_at_first || !outcomes.fit_findings)) {
    const std::string words = outcomes.fit_findings ? "" : not_a_mistake(now, outcomes.failure);
    out += !words.empty() ? words
           : any_finding  ? ": the fit itself needs no explanation."
                          : ": nothing to explain.";
  } else if (good(now)) {
    out += ": the findings explain it" + text(" (%.3g without).", now.per_dof());
  } else {
    out += outcomes.still_joint ? ": a joint that moved without its readings explains it."
           : outcomes.changed
               ? ": two parts of the data contradict each other; look at each by itself."
           : outcomes.wrong_numbers && !outcomes.fit_findings
               ? ": correct first the values named above; until then no fit can find more."
           : outcomes.with_usual_errors
               ? (outcomes.fit_findings
                      ? text("; %.3g with the findings corrected", now.per_dof())
                      : " with poses of sensors and targets and joint offsets estimated") +
                     text(
                         ", and %.3g with the usual errors of a robot (geometry, gears, lenses), "
                         "which calibrate estimates as well.",
                         *outcomes.with_usual_errors)
           : !outcomes.fit_findings
               ? ": none of these explains it."
               : text("; %.3g with the findings corrected: none of the others explains that.",
                      now.per_dof());
    if (outcomes.changed) return out;
    if (!outcomes.readings.empty()) out += " " + outcomes.readings;
    if (outcomes.with_usual_errors) return out;
    if (now.complete() && now.per_dof() > Thresholds::no_noise)
      out += look_for_mistakes(recording.rig, now);
    else if (context.usual_steps)
      out +=
          " The rig has no estimate: only poses of sensors and targets and joint offsets were "
          "fitted here. calibrate estimates more (the robot's geometry, gears, lenses): run it "
          "before looking for mistakes.";
  }
  out[0] = out[0] == 't' ? 'T' : out[0];
  return out;
}

/// A sentence about fixed parameters whose usual errors would explain the data; empty: they would
/// not.
std::string held_errors(const Recording& recording, const TrialFit& now, const TrialFit& freer) {
  constexpr double kLeft = 0.25;  // of chi2
  constexpr double kOff = 2;      // sigmas of the prior
  constexpr size_t kMost = 3;
  if (!(freer.chi2 < kLeft * now.chi2)) return "";
  const ParameterTable& table = recording.table;
  std::vector<std::pair<double, std::string>> off;
  for (const Prior& prior : freer.setup.priors) {
    const Component component{prior.parameter, prior.component};
    const int at = table.all[prior.parameter].start;
    const double by =
        table.all[prior.parameter].pose
            ? log_se3(inverse(get_pose(table.initial, at)) *
                      get_pose(freer.values.shared, at))(prior.component)
            : freer.values.shared(at + prior.component) - table.initial(at + prior.component);
    if (std::abs(by) > kOff * prior.sigma)
      off.push_back({-std::abs(by) / prior.sigma, table.name(component) + text(" (%.2g)", by)});
  }
  if (off.empty()) return "";
  std::sort(off.begin(), off.end());
  std::vector<std::string> names;
  for (size_t i = 0; i < off.size() && i < kMost; ++i) names.push_back(off[i].second);
  return "Errors of fixed parameters would, most of all " + listed(names) +
         " (m, rad or px): estimate those that are not known exactly.";
}

/// A number that nobody can mean, as the rig or the samples themselves show.
bool is_wrong_number(const Notice& f) { return !f.chi2_corrected && can_be_wrong_number(f.kind); }

/// Of those found by fits, what explains most first; then the others, without what is named
/// already. `explained`: nothing is left to explain; else numbers that cannot be meant come first.
std::vector<Notice> ordered(std::vector<Notice> by_fits, std::vector<Notice> by_data,
                            bool explained) {
  const auto ratio = [](const Notice& f) {
    return f.chi2_as_is && f.chi2_corrected ? *f.chi2_as_is / std::max(1e-300, *f.chi2_corrected)
                                            : kInfinity;
  };
  std::stable_sort(by_fits.begin(), by_fits.end(),
                   [&](const Notice& a, const Notice& b) { return ratio(a) > ratio(b); });
  const auto share = [](const Notice& f, const Notice& g) {
    return std::any_of(f.where.begin(), f.where.end(), [&](const Subject& w) {
      return std::count(g.where.begin(), g.where.end(), w) > 0;
    });
  };
  std::stable_partition(by_data.begin(), by_data.end(),
                        [](const Notice& f) { return f.kind != NoticeKind::points_outside; });
  by_fits.erase(std::remove_if(by_fits.begin(), by_fits.end(),
                               [&](const Notice& f) {
                                 return std::any_of(
                                     by_data.begin(), by_data.end(), [&](const Notice& g) {
                                       return explains(g.kind, f.kind) && share(f, g);
                                     });
                               }),
                by_fits.end());
  for (Notice& f : by_data)
    if (std::none_of(by_fits.begin(), by_fits.end(), [&](const Notice& g) {
          return (g.kind == f.kind || explains(g.kind, f.kind)) && share(f, g);
        }))
      by_fits.push_back(std::move(f));
  if (!explained) std::stable_partition(by_fits.begin(), by_fits.end(), is_wrong_number);
  return by_fits;
}

/// The rig's own numbers and the samples, before any fit.
std::vector<Notice> examine_data(const Recording& recording, const TrialContext& context) {
  std::vector<Notice> out = find_implausible(recording.rig, recording.samples);
  for (Notice& f : find_normalised(recording.rig, recording.samples)) out.push_back(std::move(f));
  const FreedNames freed = freed_names(recording.table, context.all);
  check_still_joints(recording, freed, out);
  check_connections(recording, freed, context.all.sensors, out);
  return out;
}

Diagnosis examine(const SharedRecording& recording, TrialContext context, FailureMode failure) {
  Diagnosis out;
  out.tested = tested_mistakes();
  std::vector<Notice> by_data = examine_data(*recording, context);
  TrialFit as_is = fit_as_is(*recording, context);
  if (as_is.complete()) out.chi2 = as_is.chi2;
  out.dof = as_is.dof;
  const double at_first = as_is.per_dof();
  const bool still_joint = prove_still_joints(*recording, context, as_is, by_data);
  std::optional<FreerFit> freer;  // of the data as they are in the end
  if (as_is.complete() && !good(as_is) && context.usual_steps)
    freer = fit_with_usual_errors(*recording, context, context.all, as_is);
  context.explained_as_given = good(freer ? freer->fit : as_is);
  const State as_given = {recording, recording, std::move(context), std::move(as_is), {}, {}};
  State state = as_given;
  const auto hopeless = [&] { return !(state.now.per_dof() < Thresholds::hopeless); };
  const auto found_still_joint = [&] {
    return !state.findings.empty() && state.findings.back().kind == NoticeKind::still_joint;
  };
  // (Where the parameters of a fit lie that explains nothing says nothing.)
  const auto to_explain = [&] { return !good(state.now) || state.now.farthest() > 1; };
  for (int round = 0; round < Thresholds::rounds && to_explain() && !still_joint; ++round) {
    const bool explained = explain(state);
    if (state.context.tried) out.alternatives = *std::exchange(state.context.tried, nullptr);
    if (!explained || found_still_joint()) break;
    if (state.findings.size() > 1) drop_the_former(as_given, state);
  }
  if (!still_joint && hopeless()) {
    // What leaves more than any noise may have been believed in place of two others.
    State one = as_given;
    one.context.tried = nullptr;
    State two = explain_two(one);
    if (!two.findings.empty() && (state.findings.empty() || two.log() > state.log() + kFound)) {
      state = std::move(two);
      drop_the_former(as_given, state);
    }
  }
  bool changed = false;
  if (!still_joint && !good(state.now) && (state.findings.empty() || hopeless())) {
    std::optional<Changed> parts = changed_between(as_given, state);
    changed = parts.has_value();
    if (changed) state.findings = {std::move(parts->finding)};
  }
  const bool wrong_numbers = std::any_of(by_data.begin(), by_data.end(), is_wrong_number);
  const TrialFit& now = state.now;
  if (now.complete() && !still_joint && !wrong_numbers && !changed &&
      (state.findings.empty() || !good(now))) {
    if (!freer || !state.findings.empty())
      freer = fit_with_usual_errors(*state.recording, state.context, state.context.all, now);
    if (freer) {
      if (!good(now) && !state.context.usual_steps) out.readings = noise_of_readings(state, *freer);
      if (!good(now) && !state.context.usual_steps && out.readings.empty() &&
          state.findings.empty())
        out.readings = held_errors(*state.recording, now, freer->fit);
      if (state.findings.empty())
        if (auto sigma = wrong_sigmas(*state.recording, state.context, now, freer->evidence))
          state.findings.push_back(std::move(*sigma));
      if (!good(now) && state.context.usual_steps && good(freer->fit))
        out.with_usual_errors = freer->fit.per_dof();
    }
  }
  out.verdict =
      verdict(*state.recording, state.context, now,
              {failure, at_first, good(as_given.now), !by_data.empty(), wrong_numbers,
               !state.findings.empty(), still_joint, changed, out.readings, out.with_usual_errors});
  if (!still_joint && !changed && !out.with_usual_errors) say_what_is_left(now, state.findings);
  out.findings = ordered(std::move(state.findings), std::move(by_data),
                         still_joint || changed || now.per_dof() < Thresholds::noise);
  return out;
}

}  // namespace

std::optional<Diagnosis> diagnose(const Recording& recording, const DoctorOptions& options) try {
  TrialContext context;
  context.noise = options.noise;
  context.threads = options.threads;
  context.progress = options.progress;
  if (options.compare) context.tried = std::make_shared<std::vector<Alternative>>();
  const SharedRecording planned = make_recording(plan_trials(recording, context));
  return examine(planned, std::move(context), options.failure);
} catch (const Cancelled&) {
  return std::nullopt;
}

}  // namespace kincal
