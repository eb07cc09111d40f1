#include "doctor.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "../fitting/free_targets.h"
#include "../rig/words.h"
#include "camera_mistakes.h"
#include "choice.h"
#include "data_checks.h"
#include "plausibility.h"
#include "start_values.h"
#include "stated_sigmas.h"
#include "suspects.h"
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
  out.sentences =
      now.complete()
          ? text("chi2 is %.6g as it is (chi2/dof %.3g) and %.6g (%.3g) without %s", now.chi2,
                 now.per_dof(), fit.chi2, fit.per_dof(), what)
          : text(
                "As it is the fit cannot even start (points behind a camera); without %s "
                "chi2 is %.6g (chi2/dof %.3g)",
                what, fit.chi2, fit.per_dof());
  return out;
}

/// Parameters that the estimate moved far, and that come back without the mistake.
std::vector<std::string> returned_parameters(const TrialFit& now, const TrialFit& fit) {
  std::vector<std::string> out;
  for (const auto& m : now.moved)
    if (m.second.times >= 1 && fit.moved.at(m.first).times <= 0.2 * m.second.times)
      out.push_back(m.first);
  return out;
}

/// The stage with parameters held at the rig's values.
Stage held(Stage stage, const std::vector<std::string>& parameters) {
  for (const std::string& name : parameters) stage = without(std::move(stage), name);
  return stage;
}

/// Whether a parameter is a whole pose that the rig gives and that the data tell.
bool is_given_pose(const Recording& recording, const std::string& name) {
  constexpr int kFewestToTurn = 3;  // points
  for (const Parameter& p : recording.table.all) {
    if (p.name != name) continue;
    if (p.kind == ParameterKind::sensor_pose) return recording.rig.sensors[p.owner].pose_given;
    return p.kind == ParameterKind::joint_origin ||
           (p.kind == ParameterKind::target_pose && recording.rig.targets[p.owner].pose_given &&
            recording.rig.targets[p.owner].count() >= kFewestToTurn);
  }
  return false;
}

/// Whether several poses come back so far, and so near to the rig's values, that this alone is
/// proof: by chance none comes back, and rough poses, held, explain nothing with or without.
bool several_return(const Recording& recording, const TrialFit& now, const TrialFit& fit,
                    const std::vector<std::string>& returned) {
  constexpr double kTimes = 10, kNear = 0.6;  // of what it was; of what is far
  return std::count_if(returned.begin(), returned.end(), [&](const std::string& name) {
           const double left = fit.moved.at(name).times;
           return is_given_pose(recording, name) && left < kNear &&
                  kTimes * left < now.moved.at(name).times;
         }) > 1;
}

/// Fits with and without the mistake, while what moved far is held at the rig's values. If other
/// parameters can take the place of these (a gear scale of -1, the axes around), all are held.
/// Nothing where chi2 does not fall by that, unless several come back.
std::optional<Evidence> prove_by_movement(const Recording& recording, const TrialContext& context,
                                          const TrialFit& now, const Trial& trial) {
  const std::vector<std::string> returned = returned_parameters(now, trial.fit);
  std::vector<std::string> all;
  for (const auto& m : now.moved) all.push_back(m.first);
  TrialFit before, after;
  bool decided = false, everything = false;
  for (bool all_held : {false, true}) {
    if (decided) break;
    everything = all_held;
    const std::vector<std::string>& names = all_held ? all : returned;
    before = best_fit(recording, context, held(context.all, names), {60, 1e-4});
    after = best_fit(trial.recording, context, held(trial.stage, names), {60, 1e-4});
    decided =
        after.complete() && (!before.complete() || before.cost > Thresholds::decisive * after.cost);
  }
  if (!decided && !several_return(recording, now, trial.fit, returned)) return std::nullopt;
  std::string names;
  for (const std::string& name : returned) names += (names.empty() ? "" : ", ") + name;
  const auto farthest_of = [&](const TrialFit& f) {
    double most = 0;
    for (const std::string& name : returned) most = std::max(most, f.moved.at(name).by);
    return most;
  };
  Evidence out;
  out.sentences =
      "The estimate hides it by moving " + names +
      text(" by up to %.3g (m, rad, or share of a length); without this mistake %.3g are enough",
           farthest_of(now), farthest_of(trial.fit));
  if (!decided) {
    out.before = now.chi2;
    out.after = trial.fit.chi2;
    out.sentences += text(". chi2 is %.6g either way", trial.fit.chi2);
    return out;
  }
  if (before.complete()) out.before = before.chi2;
  out.after = after.chi2;
  out.sentences += std::string(everything ? ". With all held at the rig's values "
                                          : ". With these held at the rig's values ") +
                   (before.complete() ? text("chi2 is %.6g as it is", before.chi2)
                                      : "the fit cannot even start as it is") +
                   text(" and %.6g without this mistake", after.chi2);
  return out;
}

// ------------------------------------------------------------------------------------------------
// scale and word
/// Gives the targets the sizes that the fit found, and replaces what the hypothesis has by these.
/// `before`: the rig with the mistake.
void scale(const Rig& before, Explanatory& explanatory, Rig& rig) {
  Hypothesis& h = explanatory.hypothesis;
  const std::vector<double> factors = size_factors(before, h, explanatory.trial);
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
    h.mistake += old.grid ? "the size of target " + quoted(old.name) + " is wrong: " +
                                text("the rig says %.6g m, the data say %.6g m (times %.5g)",
                                     old.square, old.square * factors[i], factors[i])
                          : "the points of target " + quoted(old.name) +
                                " have the wrong unit or scale: " +
                                text("the data say %.5g times as large", factors[i]);
  }
  h.cure = "measure, and correct the size in the rig: metres, from corner to corner";
}

Notice word(const Hypothesis& h, const Evidence& evidence) {
  Notice finding = make_notice(h.kind, h.where, h.mistake, evidence.sentences, h.cure);
  finding.estimated = h.estimated;
  finding.chi2_as_is = evidence.before;
  finding.chi2_corrected = evidence.after;
  return finding;
}

/// Tests all mistakes, undoes the one that explains most, in the recording, the context and `now`,
/// and reports it; false if none is believed. `by_movement`: what it explains is not chi2 but that
/// the estimate is far from the rig's values.
bool explain(SharedRecording& recording, TrialContext& context, TrialFit& now, bool by_movement,
             std::vector<Notice>& out) {
  std::optional<Explanatory> best = choose(*recording, context, {now, by_movement});
  if (!best) return false;
  const std::optional<Evidence> evidence =
      by_movement ? prove_by_movement(*recording, context, now, best->trial)
                  : prove_by_chi2(now, best->trial.fit);
  if (!evidence) return false;
  Rig rig = best->trial.recording.rig;
  if (!best->hypothesis.squares.empty()) scale(recording->rig, *best, rig);
  if (best->hypothesis.told)
    std::tie(best->hypothesis.mistake, best->hypothesis.cure) = told(best->hypothesis, best->trial);
  if (by_movement && best->hypothesis.kind == NoticeKind::mirrored &&
      std::any_of(rig.targets.begin(), rig.targets.end(), [&](const Target& t) {
        return t.grid && t.pose_given &&
               std::count(best->hypothesis.where.begin(), best->hypothesis.where.end(),
                          Subject::target(t.name)) > 0;
      }))
    best->hypothesis.cure +=
        ". Or the points are right, and it is the pose in the rig that has z out of the board, "
        "where kincal's goes into it (x along a row, y from row to row): then nothing has to be "
        "done: the estimate is right";
  out.push_back(word(best->hypothesis, *evidence));
  recording = make_recording(best->trial.recording.with_rig(std::move(rig)));
  context.all = std::move(best->trial.stage);
  context.given_poses_freed = frees_given_poses(*recording, context.all);
  now = std::move(best->trial.fit);
  return true;
}

/// As explain(), of two mistakes at once.
bool explain_two(SharedRecording& recording, TrialContext& context, TrialFit& now,
                 std::vector<Notice>& out) {
  std::optional<TwoMistakes> best = choose_two(*recording, context, now);
  if (!best) return false;
  Rig rig = best->trial.recording.rig;
  Explanatory explanatory{std::move(best->first), std::move(best->trial)};
  std::vector<Hypothesis> both;
  for (Hypothesis* h : {&explanatory.hypothesis, &best->second}) {
    if (h != &explanatory.hypothesis) explanatory.hypothesis = std::move(*h);
    if (!explanatory.hypothesis.squares.empty()) {
      if (size_factors(recording->rig, explanatory.hypothesis, explanatory.trial).empty())
        return false;
      scale(recording->rig, explanatory, rig);
    }
    both.push_back(explanatory.hypothesis);
  }
  const Evidence evidence = prove_by_chi2(now, explanatory.trial.fit, "both");
  for (size_t i = 0; i < 2; ++i) {
    Evidence one = evidence;
    one.sentences = std::string("This and ") + id(both[1 - i].kind) +
                    " are two mistakes of which neither alone explains the data. " +
                    evidence.sentences;
    out.push_back(word(both[i], one));
  }
  recording = make_recording(explanatory.trial.recording.with_rig(std::move(rig)));
  context.all = std::move(explanatory.trial.stage);
  context.given_poses_freed = frees_given_poses(*recording, context.all);
  now = std::move(explanatory.trial.fit);
  return true;
}

/// What was found so far: the recording with the mistakes undone, and the fit of it.
struct State {
  SharedRecording recording;
  TrialContext context;
  TrialFit now;
};

/// A mistake that leaves what no noise explains may have been believed in place of two others:
/// these are looked for in what was given, and take its place if they leave far less.
void try_two_in_their_place(const State& given, SharedRecording& recording, TrialContext& context,
                            TrialFit& now, std::vector<Notice>& findings) {
  State two = given;
  std::vector<Notice> both;
  if (!explain_two(two.recording, two.context, two.now, both) ||
      !(Thresholds::overwhelming * two.now.cost < now.cost))
    return;
  recording = std::move(two.recording);
  context = std::move(two.context);
  now = std::move(two.now);
  findings = std::move(both);
}

/// As explain(), where a few samples are wrong besides, which are left for the next round.
bool explain_most(SharedRecording& recording, TrialContext& context, TrialFit& now,
                  std::vector<Notice>& out) {
  std::optional<Explanatory> best = choose_by_most(*recording, context, now);
  if (!best) return false;
  Evidence evidence = prove_by_chi2(now, best->trial.fit);
  evidence.sentences = "Without this mistake most samples fit, but not all. " + evidence.sentences;
  Rig rig = best->trial.recording.rig;
  if (!best->hypothesis.squares.empty()) {
    if (size_factors(recording->rig, best->hypothesis, best->trial).empty()) return false;
    scale(recording->rig, *best, rig);
  }
  out.push_back(word(best->hypothesis, evidence));
  recording = make_recording(best->trial.recording.with_rig(std::move(rig)));
  context.all = std::move(best->trial.stage);
  context.given_poses_freed = frees_given_poses(*recording, context.all);
  now = std::move(best->trial.fit);
  return true;
}

/// Says of mistakes that leave what no noise explains that they are not all of it.
void say_what_is_left(const TrialFit& now, std::vector<Notice>& findings) {
  if (!now.complete() || !(now.per_dof() > Thresholds::no_noise)) return;
  for (Notice& f : findings)
    f.cure += text(
        ". But something else is wrong besides, or in its place: chi2/dof %.3g is left, "
        "which is no noise",
        now.per_dof());
}

// ------------------------------------------------------------------------------------------------
// search
/// Adds the proof to joints that never move in the log but did; true if there is one. Such a joint
/// can look like many things: it goes first, and then nothing else can be concluded.
bool prove_still_joints(const Recording& recording, const TrialContext& context,
                        const TrialFit& now, std::vector<Notice>& findings) {
  bool found = false;
  for (Notice& f : findings) {
    if (f.kind != NoticeKind::still_joint || good(now)) continue;
    context.report(0, 1);
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
  Ended ended;  // the calibration that was diagnosed
  double per_dof_at_first;
  bool data_findings;           // some mistake shows in the data alone
  bool wrong_numbers;           // numbers among them that nobody can mean
  bool fit_findings;            // some mistake was found by fits
  bool still_joint;             // one of the former explains the fit
  bool changed;                 // two parts of the data contradict each other
  const std::string& readings;  // what errors of the joint readings would explain
};

/// Of data that need no explanation, but whose calibration ended badly.
std::string not_a_mistake(const TrialFit& now, Ended ended) {
  std::string far;
  for (const auto& m : now.moved)
    if (m.second.times > 1)
      far += (far.empty() ? "" : ", ") + m.first + text(" (%.3g)", m.second.by);
  if (ended == Ended::cannot_start)
    return " from other starting values, found from the data. So none of these mistakes was made, "
           "but from the rig's values no fit can start: " +
           (far.empty() ? "give poses nearer to the truth, or leave them away"
                        : "too far from the truth are " + far +
                              " (m, rad, or share of a length): correct them, or leave them away") +
           ".";
  if (ended == Ended::not_converged)
    return " if everything is freed at once, without the way of the steps. So none of these "
           "mistakes was made, but the steps do not lead there: start nearer to the truth" +
           (far.empty() ? "" : " (" + far + ")") + ", or free less in the first steps.";
  return "";
}

/// What fits worst, and where to look, of a fit that no noise explains.
std::string look_for_mistakes(const Rig& rig, const TrialFit& now) {
  int worst = -1;
  for (size_t s = 0; s < now.sensor.size(); ++s)
    if (!std::isnan(now.sensor[s]) && (worst < 0 || now.sensor[s] > now.sensor[worst]))
      worst = static_cast<int>(s);
  return " That is no robot whose geometry differs a little from its drawing: look for a mistake "
         "before more is freed" +
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
    out += ", or what sees a free target does not tell where it is";
  if (good(now) && !outcomes.fit_findings) {
    const std::string words = not_a_mistake(now, outcomes.ended);
    out += !words.empty()           ? words
           : outcomes.data_findings ? ": the fit itself needs no explanation."
                                    : ": nothing to explain.";
  } else if (good(now)) {
    out += ": what was found explains it" + text(" (%.3g without).", now.per_dof());
  } else {
    out += outcomes.still_joint ? ": a joint that moved without its readings explains it."
           : outcomes.changed
               ? ": two parts of the data contradict each other; look at each by itself."
           : outcomes.wrong_numbers && !outcomes.fit_findings
               ? ": correct first the numbers named above; before that no fit can tell more."
           : !outcomes.fit_findings
               ? ": none of these explains it."
               : text("; with what was found undone %.3g: none of the others explains that.",
                      now.per_dof());
    if (outcomes.changed) return out;
    if (!outcomes.readings.empty()) out += " " + outcomes.readings;
    if (now.complete() && now.per_dof() > Thresholds::no_noise)
      out += look_for_mistakes(recording.rig, now);
    else if (context.usual_steps)
      out +=
          " The rig has no estimate: only poses of sensors and targets and joint offsets were "
          "fitted here. calibrate tries more (the "
          "robot's "
          "geometry, gears, lenses): let it try before looking for mistakes.";
  }
  out[0] = out[0] == 't' ? 'T' : out[0];
  return out;
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
  std::stable_sort(by_fits.begin(), by_fits.end(), [&](const Notice& a, const Notice& b) {
    return std::make_pair(a.estimated, -ratio(a)) < std::make_pair(b.estimated, -ratio(b));
  });
  const auto says = [](const Notice& g, const Notice& f) {
    return (g.kind == f.kind || explains(g.kind, f.kind)) &&
           std::any_of(f.where.begin(), f.where.end(), [&](const Subject& w) {
             return std::count(g.where.begin(), g.where.end(), w) > 0;
           });
  };
  std::stable_partition(by_data.begin(), by_data.end(),
                        [](const Notice& f) { return f.kind != NoticeKind::points_outside; });
  for (Notice& f : by_data)
    if (std::none_of(by_fits.begin(), by_fits.end(), [&](const Notice& g) { return says(g, f); }))
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

Diagnosis examine(SharedRecording recording, TrialContext context, Ended ended) {
  Diagnosis out;
  out.tested = tested_mistakes();
  std::vector<Notice> by_data = examine_data(*recording, context), by_fits;

  TrialFit now = fit_as_is(*recording, context);
  if (now.complete()) out.chi2 = now.chi2;
  out.dof = now.dof;
  const double at_first = now.per_dof();
  const State as_given = {recording, context, now};
  const bool still_joint = prove_still_joints(*recording, context, now, by_data);
  for (int round = 0; round < Thresholds::rounds && !good(now) && !still_joint; ++round) {
    const bool explained = explain(recording, context, now, false, by_fits);
    if (context.tried) out.alternatives = *std::exchange(context.tried, nullptr);
    if (!explained || by_fits.back().kind == NoticeKind::still_joint) break;
  }
  if (!by_fits.empty() && !still_joint && now.per_dof() > Thresholds::hopeless)
    try_two_in_their_place(as_given, recording, context, now, by_fits);
  if (by_fits.empty() && !still_joint && !(now.per_dof() < Thresholds::hopeless)) {
    if (!explain_most(recording, context, now, by_fits))
      explain_two(recording, context, now, by_fits);
    else if (!good(now))
      explain(recording, context, now, false, by_fits);
  }
  if (!still_joint && !good(now) && (by_fits.empty() || now.per_dof() > Thresholds::hopeless))
    if (std::optional<Notice> changed =
            two_parts(*as_given.recording, as_given.context, as_given.now);
        changed &&
        (by_fits.empty() || !(now.chi2 < Thresholds::overwhelming * *changed->chi2_corrected)))
      by_fits = {std::move(*changed)};
  if (now.complete() && !still_joint &&
      (by_fits.empty() || by_fits.back().kind != NoticeKind::still_joint)) {
    const size_t before = by_fits.size();
    check_starts(*recording, context, now, by_fits);
    // (Where the numbers of a fit lie that explains nothing says nothing.)
    for (int round = 0; round < Thresholds::rounds && by_fits.size() == before + round &&
                        now.farthest() > 1 && now.per_dof() < Thresholds::hopeless;
         ++round)
      explain(recording, context, now, true, by_fits);
  }
  const bool normalised = std::any_of(by_data.begin(), by_data.end(), [](const Notice& f) {
    return f.kind == NoticeKind::normalised;
  });
  if (by_fits.empty() && !still_joint && !normalised)
    if (std::optional<Notice> sigma = wrong_sigmas(*recording, context, now))
      by_fits.push_back(std::move(*sigma));
  const bool changed = !by_fits.empty() && by_fits.front().kind == NoticeKind::changed;
  if (!good(now) && now.complete() && !still_joint && !changed && !context.usual_steps)
    out.readings = joint_noise(*recording, context, now);
  out.verdict = verdict(*recording, context, now,
                        {ended, at_first, !by_data.empty(),
                         std::any_of(by_data.begin(), by_data.end(), is_wrong_number),
                         !by_fits.empty(), still_joint, changed, out.readings});
  if (!still_joint && !changed) say_what_is_left(now, by_fits);
  out.findings = ordered(std::move(by_fits), std::move(by_data),
                         still_joint || changed || now.per_dof() < Thresholds::noise);
  return out;
}

}  // namespace

std::optional<Diagnosis> diagnose(const Recording& recording, const DoctorOptions& options) {
  TrialContext context;
  context.noise = options.noise;
  context.threads = options.threads;
  context.progress = options.progress;
  if (options.compare) context.tried = std::make_shared<std::vector<Alternative>>();
  try {
    SharedRecording planned = make_recording(plan_trials(recording, context));
    return examine(std::move(planned), std::move(context), options.ended);
  } catch (const Cancelled&) {
    return std::nullopt;
  }
}

}  // namespace kincal
