#include "warnings.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../analysis/hand_eye.h"
#include "../calibration/start_poses.h"
#include "../rig/configuration.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "cases.h"
#include "input_warnings.h"
#include "noise_warnings.h"
#include "parameter_warnings.h"
#include "scale_warnings.h"
#include "trial_warnings.h"
#include "verdict.h"

namespace kincal {
namespace {

constexpr size_t kShown = kNamed;
constexpr double kFitsWell = 5;  // chi2/dof, of a step that did not converge

/// Whether chi2/dof is further from 1 than noise of the stated sigmas would have it: by a fifth or
/// more, and by four of its standard deviations, sqrt(2/dof).
bool exceeds(double ratio, double dof) {
  return dof > 0 && ratio > std::max(1.25, 1 + 4 * std::sqrt(2 / dof));
}
bool falls_short(double ratio, double dof) {
  return dof > 0 && ratio < std::min(0.8, 1 - 4 * std::sqrt(2 / dof));
}

constexpr double kMostOfIt = 0.5;  // of the squares: one sample
constexpr char kLookOrState[] =
    ". What to do: look for what is wrong, or state the sigmas that are seen";

std::string excess_text(double ratio) {
  return text("chi2/dof is %.3g: the residuals are larger than the rig's sigmas allow", ratio);
}

std::string count_text(size_t count, const char* what) {
  return std::to_string(count) + " " + what + (count == 1 ? "" : "s");
}

void warn_of_starts(const Solution& solution, Warnings& out) {
  Warning useless{"no_effect", "", solution.without_effect};
  for (const std::string& message : solution.without_effect)
    useless.text += (useless.text.empty() ? "" : "; ") + message;
  if (!useless.text.empty()) out.push_back(std::move(useless));
  std::vector<Case> identity, lost, contradicted, ambiguous;
  for (const std::string& name : solution.identity_starts)
    identity.push_back({name, identity_text(solution, name)});
  for (const std::string& name : solution.lost_starts) {
    const std::string reason = lost_start_text(solution, name);
    if (!reason.empty()) lost.push_back({name, reason});
  }
  for (const ReplacedStart& start : solution.replaced_starts)
    contradicted.push_back(
        {start.name,
         start.name +
             text(": the data contradict the given pose; the estimate is %.3g m and %.3g degrees "
                  "from it. ",
                  start.moved, start.turned * 180 / kPi) +
             (start.cost_per_dof > 0 ? text("From there chi2/dof ended at %.3g", start.cost_per_dof)
                                     : std::string("No calibration can start there")) +
             ", so it was started where the data put it: correct it in the rig, or leave it away",
         start.moved + start.turned});
  for (const AmbiguousStart& start : solution.ambiguous_starts)
    ambiguous.push_back(
        {start.first,
         start.first + " and " + start.second +
             text(" are absent from the rig, and several solutions fit the readings equally well "
                  "(the next one is turned by %.3g degrees): ",
                  start.turned * 180 / kPi) +
             "give one of them a pose in the rig, or record more postures, as different as "
             "possible"});
  warn("identity", "poses start at the identity", std::move(identity), out);
  warn("no_start", "poses have no start", std::move(lost), out);
  warn("given_pose", "given poses contradict the data", std::move(contradicted), out);
  warn("ambiguous_start", "pairs of poses are ambiguous", std::move(ambiguous), out);
}

void warn_of_undefined(const Residuals& residuals, Warnings& out) {
  std::vector<Case> before, after;
  for (const UndefinedSample& sample : residuals.undefined)
    if (sample.before)
      before.push_back({sample.id, "sample '" + sample.id +
                                       "' cannot be evaluated at the rig's values (a point behind "
                                       "a camera): it is missing from rms_before"});
    else
      after.push_back({sample.id, "held-out sample '" + sample.id +
                                      "' cannot be evaluated at the estimate (a point behind a "
                                      "camera): it is missing from its rms"});
  warn("undefined_before", "samples cannot be evaluated at the rig's values", std::move(before),
       out);
  warn("undefined", "held-out samples cannot be evaluated", std::move(after), out);
}

void warn_of_unfinished(const std::vector<Unfinished>& unfinished, Warnings& out) {
  std::vector<Case> columns;
  for (const Unfinished& u : unfinished) {
    const std::string column =
        u.column + (u.train ? " of the training samples" : " of the held-out samples");
    columns.push_back(
        {column,
         column + " is not final: what was estimated to judge them did not converge in " +
             count_text(u.samples.size(), "sample") + ", first '" + u.samples.front() + "'",
         static_cast<double>(u.samples.size())});
  }
  warn("unfinished", "columns are not final", std::move(columns), out);
}

/// The first step that did not converge, what it may come from, and what to do.
void warn_of_steps(const Report& report, Warnings& out) {
  const Solution& solution = report.solution;
  for (const StepResult& s : solution.steps) {
    if (s.converged || s.repeated) continue;
    std::string what = "free less, in more steps, or start nearer to the truth";
    if (const Finding* first = first_mistake(report)) {
      what = "first look at " + first->id + ": " + first->text;
    } else if (const std::string held = counts_from_identity(solution); !held.empty()) {
      what = held;
    } else if (const std::string loose = loose_mount(report);
               !loose.empty() && solution.chi2_per_dof() < kFitsWell) {
      what = loose;
    } else if (has_redescending_loss(solution, s.name)) {
      what =
          "converge first with loss huber or none, in a step before this one: from a rough start "
          "this loss leaves out what is right as well";
    } else if (!report.outliers.empty()) {
      what = "a calibration that rejects outliers takes them out, or look at the samples named";
    }
    out.push_back({"not_converged",
                   "step '" + s.name + "' did not converge in " + std::to_string(s.iterations) +
                       " iterations. What to do: " + what,
                   {s.name}});
    break;
  }
}

void warn_of_directions(const Report& report, Warnings& out) {
  const Solution& solution = report.solution;
  std::vector<Case> directions;
  for (size_t i = 0; i < solution.unobservable.size(); ++i) {
    std::string sum;
    std::vector<std::string> numbers;
    for (const auto& c : solution.unobservable[i]) {
      sum += (sum.empty() ? "" : " ") + text("%+.4g ", c.second) + c.first;
      numbers.push_back(c.first);
    }
    const std::vector<WeakDirection>& weak =
        report.explanation.weak;  // those of `unobservable` stand first
    const std::string why = i < weak.size() ? weak[i].why + ". Cure: " + weak[i].cure
                                            : "hold one of these or give it a prior";
    directions.push_back({sum, "the data do not determine " + listed(numbers, kNamed) +
                                   (numbers.size() > 1 ? " together: " : ": ") + why});
  }
  warn("unobservable", "directions are not determined", std::move(directions), out);
}

/// A robot that did not turn enough, of mounts that are hardly known for that.
void warn_of_motion(const Report& report, Warnings& out) {
  if (!report.solution.unobservable.empty() || !has_open_mount(report) || hangs_on_a_size(report))
    return;
  const MotionLack lack = motion_lack(*report.solution.recording);
  if (!lack.why.empty()) out.push_back({"few_turns", lack.why + ". What to do: " + lack.cure, {}});
}

void warn_of_chi2(const Report& report, Warnings& out) {
  const Solution& solution = report.solution;
  const double ratio = solution.chi2_per_dof();
  std::string whole;
  if (exceeds(ratio, solution.dof_data)) whole = excess_text(ratio);
  if (falls_short(ratio, solution.dof_data) &&
      solution.noise != NoiseMode::point)  // there it means nothing
    whole = text(
        "chi2/dof is %.3g: the residuals are smaller than the sigmas of the rig say; the "
        "sigmas of the result are too large",
        ratio);
  std::vector<Case> sensors;
  for (const SensorResult& s : report.residuals.sensors) {
    const double count = static_cast<double>(s.train.whitened_count),
                 each = s.train.whitened_squared / count;
    if (exceeds(each, count))  // what the unknowns took makes it small: that says nothing
      sensors.push_back({s.name,
                         "sensor '" + s.name + "': " +
                             text("chi2/n is %.3g, its residuals are %.2g times its sigma", each,
                                  std::sqrt(each)),
                         each});
  }
  Warnings parts;
  warn("chi2", "sensors have larger residuals than their sigmas allow", std::move(sensors), parts);
  if (parts.empty() && whole.empty()) return;
  const bool larger = !parts.empty() || ratio > 1;
  if (parts.empty()) parts.push_back({"chi2", "", {}});
  parts[0].text =
      whole + (whole.empty() || parts[0].text.empty() ? "" : "; ") + parts[0].text +
      (larger ? kLookOrState : ". What to do: state those that are seen, or leave it so");
  out.push_back(std::move(parts[0]));
}

void warn_of_unexplained(const Report& report, Warnings& out) {
  if (!report.unexplained.empty()) out.push_back({"unexplained", report.unexplained, {}});
}

void warn_of_joint_errors(const Solution& solution, Warnings& out) {
  struct Excess {
    int count = 0, sample = -1;
    double worst = 0, error = 0;  // sigmas; rad or m
  };
  const Rig& rig = solution.rig();
  constexpr double kOneInFifty = 0.02;  // that one of so many right errors is beyond the limit
  const double count = static_cast<double>(solution.values.errors.size());
  double limit = 4;
  while (count * std::erfc(limit / std::sqrt(2.0)) > kOneInFifty) limit += 0.1;
  std::map<int, Excess> excess;  // by joint
  for (const auto& e : solution.values.errors) {
    const double sigmas =
        e.second / joint_sigma(rig, solution.samples()[e.first.first], e.first.second);
    if (solution.noise != NoiseMode::latent || !(std::abs(sigmas) > limit)) continue;
    Excess& x = excess[e.first.second];
    ++x.count;
    if (std::abs(sigmas) > std::abs(x.worst)) x = {x.count, e.first.first, sigmas, e.second};
  }
  std::vector<Case> joints;
  for (const auto& x : excess) {
    const std::string name = rig.tree.joints[x.first].name;
    joints.push_back(
        {name,
         "joint '" + name + "': its error exceeds " + text("%.2g", limit) + " sigmas in " +
             count_text(static_cast<size_t>(x.second.count), "sample") + ", at worst " +
             text("%+.3g sigmas (%.3g %s) in sample '", x.second.worst, 1e3 * x.second.error,
                  rig.tree.joints[x.first].type == JointType::prismatic ? "mm" : "mrad") +
             solution.samples()[x.second.sample].id + "'",
         std::abs(x.second.worst)});
  }
  if (joints.empty()) return;
  warn("joint_error", text("joints have errors above %.2g sigmas", limit).c_str(),
       std::move(joints), out);
  out.back().text += ". What to do: look at these samples, or state more noise of these joints";
}

void warn_of_joint_noise(const Report& report, Warnings& out) {
  std::vector<const NoiseLevel*> noisy;
  for (const NoiseLevel& level : report.noise_levels)
    if (level.joint >= 0 && level.used == level.assumed && level.differs() &&
        level.seen >= kNoisy * level.assumed)
      noisy.push_back(&level);
  std::stable_sort(noisy.begin(), noisy.end(), [](const NoiseLevel* a, const NoiseLevel* b) {
    return a->seen * b->assumed > b->seen * a->assumed;
  });
  std::vector<std::string> names, words;
  for (const NoiseLevel* level : noisy) {
    names.push_back(report.solution.rig().tree.joints[level->joint].name);
    words.push_back(quoted(names.back()) +
                    text(" (stated %.3g, seen %.3g ", level->assumed, level->seen) + level->unit +
                    ")");
  }
  if (!names.empty())
    out.push_back(
        {"joint_noise",
         count_text(names.size(), "joint") +
             " at least three times noisier than stated: " + listed(words, kShown) +
             ". State the noise that is seen, or have it estimated; if they are that good, "
             "the model lacks something of them (a gear, play) and the sigmas of the result "
             "are too small",
         names});
}

/// Returns how far a joint is from scale * reading + offset at most, in the samples (rad or m).
double largest_bend(const Solution& solution, int joint) {
  const Rig& rig = solution.rig();
  double largest = 0;
  const auto include = [&](const Sample& sample, double reading) {
    if (std::isnan(reading)) return;
    const Configuration robot(rig, solution.table(), solution.values.shared, sample.readings);
    const double* own = robot.own_numbers(joint);
    largest = std::max(largest, std::abs(rig.joints[joint].model->position(reading, own) -
                                         (own[1] * reading + own[0])));
  };
  for (const Sample& sample : solution.samples()) {
    include(sample, sample.readings[joint]);
    for (const View& v : sample.views)
      if (rig.sensors[v.sensor].scanning_joint == joint)
        for (size_t i = 0; i < v.z.size(); i += rig.sensors[v.sensor].model->numbers())
          include(sample, v.z[i]);
  }
  return largest;
}

/// A URDF takes up offsets, and scales on demand; who reads no more than it loses the rest of a
/// joint model.
void warn_of_joint_models(const Solution& solution, Warnings& out) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  std::vector<Case> bent;
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    if (table.joint_offset[j] < 0 || rig.joints[j].model->size() <= 2) continue;
    const double largest = largest_bend(solution, static_cast<int>(j));
    if (largest == 0) continue;
    std::string numbers;
    for (int k = 2; k < rig.joints[j].model->size(); ++k) {
      const Parameter& p = table.all[table.joint_offset[j] + k];
      numbers +=
          (numbers.empty() ? "" : ", ") + p.name + text(" = %.6g", solution.values.shared(p.start));
    }
    bent.push_back({rig.tree.joints[j].name,
                    "joint '" + rig.tree.joints[j].name +
                        "': a URDF cannot express its joint model (" + numbers +
                        "); a robot that takes the linear part alone is off by up to" +
                        text(" %.3g ", largest) + table.all[table.joint_offset[j]].units[0] +
                        " in these samples. The numbers stand in the calibrated rig",
                    largest});
  }
  warn("joint_model", "joints have models that a URDF cannot express", std::move(bent), out);
}

void warn_of_misfits(const char* id, const char* kind, const std::vector<Misfit>& found,
                     Warnings& out) {
  if (found.empty()) return;
  std::vector<std::string> names, words;
  for (const Misfit& misfit : found) {
    names.push_back(misfit.name);
    words.push_back(misfit.name + text(" (%.3g times)", std::sqrt(misfit.ratio)));
  }
  out.push_back({id,
                 count_text(found.size(), kind) +
                     " with residuals or joint errors far beyond what is usual here: " +
                     listed(words, kShown) +
                     ". What to do: look at what was recorded there, or leave it out",
                 names});
}

/// What a robust fit names, in place of the samples and views that stick out of a plain one, which
/// it may mislead.
void warn_of_outliers(const std::vector<Rejected>& outliers, Warnings& out) {
  struct Kind {
    const char *id, *one, *many;
    size_t count = 0;
    std::vector<std::string> names = {};
  };
  Kind kinds[] = {{"outlier_sample", " sample does", " samples do"},
                  {"outlier_view", " view does", " views do"},
                  {"outlier_point", " point does", " points do"}};
  for (const Rejected& r : outliers) {
    Kind& kind = kinds[r.sensor.empty() ? 0 : r.ids.empty() ? 1 : 2];
    kind.count += std::max<size_t>(1, r.ids.size());
    kind.names.push_back("'" + r.sample + "'" + (r.sensor.empty() ? "" : " " + r.sensor));
  }
  for (const Kind& kind : kinds)
    if (kind.count > 0)
      out.push_back({kind.id,
                     "a robust fit finds that " + std::to_string(kind.count) +
                         (kind.count == 1 ? kind.one : kind.many) +
                         " not belong to the others: " + listed(kind.names, kShown) +
                         "; a calibration that rejects outliers takes them out",
                     kind.names});
}

/// Groups that came out much worse than such numbers usually are, and gears that the rig's path
/// leaves out.
void warn_of_widths(const Report& report, Warnings& out) {
  constexpr double kSpeaking = 10;  // log evidence
  std::vector<Case> wide;
  for (const AutomaticGroup& group : report.automatic)
    if (group.factor > kUnusualWidth && !group.held)
      wide.push_back({group.name,
                      "numbers of group '" + group.name +
                          text("' are off by %.0f times as much as usual: look for a mistake in "
                               "the rig or the data that they take up",
                               group.factor),
                      group.factor});
  warn("width", "groups are much worse than usual", std::move(wide), out);
  if (report.gears_gain > kSpeaking && report.unexplained.empty())
    out.push_back({"gears",
                   text("the data speak for other gear ratios than stated (log evidence "
                        "%.0f), which were not estimated: predicted errors may be too "
                        "small; the group gears estimates them",
                        report.gears_gain),
                   {}});
}

void warn_of_minima(const Restarts& restarts, Warnings& out) {
  const std::vector<Minimum>& minima = restarts.minima;
  if (minima.size() < 2 ||
      !(minima[1].cost < minima[0].cost || same_cost(minima[1].cost, minima[0].cost)))
    return;
  const Minimum& m = minima[1];
  std::vector<std::string> differing;
  for (const auto& d : m.differs) differing.push_back(d.first);
  std::string names;
  for (size_t i = 0; i < std::min<size_t>(m.differs.size(), 3); ++i)
    names += (i ? ", " : "") + m.differs[i].first + text(" (%+.3g sigmas)", m.differs[i].second);
  out.push_back({"minima",
                 std::to_string(m.count) + " of " + std::to_string(restarts.count) +
                     " restarts end in " +
                     (same_cost(m.cost, minima[0].cost)
                          ? "another minimum that is as good as this result"
                          : text("a better minimum: cost %.8g, this result has %.8g", m.cost,
                                 minima[0].cost)) +
                     ". Most different: " + names +
                     ". The result is the one that the rig's own values lead to",
                 differing});
}

/// The kinds of warnings, what matters most first.
size_t rank(const Warning& warning) {
  static const char* const kOrder[] = {"not_converged",   "unobservable",
                                       "few_turns",       "unexplained",
                                       "implausible",     "outside_image",
                                       "duplicates",      "few_data",
                                       "undefined",       "outlier_sample",
                                       "outlier_view",    "outlier_point",
                                       "no_consensus",    "chi2",
                                       "in_use",          "jump",
                                       "systematic",      "joint_error",
                                       "joint_noise",     "noise",
                                       "quiet_joints",    "scale",
                                       "arm_scale",       "prior",
                                       "sigma",           "minima",
                                       "given_pose",      "rescaled",
                                       "unchecked",       "no_start",
                                       "ambiguous_start", "moved",
                                       "identity",        "unfinished",
                                       "joint_model",     "no_effect",
                                       "few_poses",       "repeated",
                                       "last_zero",       "base_frame",
                                       "unused_prior",    "undefined_before"};
  return static_cast<size_t>(std::find(std::begin(kOrder), std::end(kOrder), warning.id) -
                             std::begin(kOrder));
}

/// Of a step that did not converge: that, and the first thing that it may come from. Everything
/// else follows from it.
void keep_first_cause(Warnings& all) {
  const auto may_cause = [](const Warning& w) {
    for (const char* id : {"implausible", "outside_image", "outlier_", "no_consensus", "no_start",
                           "ambiguous_start", "identity"})
      if (w.id.rfind(id, 0) == 0) return true;
    return false;
  };
  const auto cause = std::find_if(all.begin(), all.end(), may_cause);
  Warnings kept = {all.front()};
  if (cause != all.end()) kept.push_back(*cause);
  all = std::move(kept);
}

}  // namespace

std::vector<Warning> warnings(const Report& report) {
  Warnings out;
  warn_of_starts(report.solution, out);
  warn_of_input(report.input, out);
  warn_of_few_data(report.solution, out);
  warn_of_repetition(*report.solution.recording, out);
  warn_of_unseen(report.solution, out);
  warn_of_unused_priors(report.solution, out);
  warn_of_undefined(report.residuals, out);
  warn_of_steps(report, out);
  warn_of_directions(report, out);
  warn_of_motion(report, out);
  warn_of_unfinished(report.residuals.unfinished, out);
  warn_of_chi2(report, out);
  warn_of_unexplained(report, out);
  warn_of_joint_errors(report.solution, out);
  warn_of_joint_noise(report, out);
  warn_of_jumps(report, out);
  warn_of_trends(report, out);
  warn_of_quiet_joints(report, out);
  warn_of_contradicted(report, out);
  warn_of_use(report.residuals, out);
  warn_of_doubted_priors(report, out);
  warn_of_movements(report.solution, out);
  warn_of_rescaled(report.solution, out);
  warn_of_scales(report, out);
  warn_of_parameters(report, out);
  warn_of_joint_models(report.solution, out);
  if (report.outliers.empty()) {
    warn_of_misfits("outlier_sample", "sample", report.misfits.samples, out);
    warn_of_misfits("outlier_view", "view", report.misfits.views, out);
  }
  warn_of_rejected(report, out);
  if (!report.no_consensus.empty()) out.push_back({"no_consensus", report.no_consensus, {}});
  warn_of_noise(report, out);
  warn_of_widths(report, out);
  warn_of_outliers(report.outliers, out);
  if (report.restarts) warn_of_minima(*report.restarts, out);
  warn_of_held_out(report.validation, out);
  std::stable_sort(out.begin(), out.end(),
                   [](const Warning& a, const Warning& b) { return rank(a) < rank(b); });
  if (!out.empty() && out.front().id == "not_converged") keep_first_cause(out);
  return out;
}

std::vector<Warning> warnings(const Evaluation& evaluation) {
  Warnings out;
  if (!evaluation.converged)
    out.push_back(
        {"not_converged", "the estimation of targets or joint errors did not converge", {}});
  std::vector<Case> undefined;
  for (const std::string& id : evaluation.undefined)
    undefined.push_back({id, "sample '" + id +
                                 "' cannot be evaluated (a point lies behind a camera, wherever "
                                 "its target is put): it is missing from these numbers"});
  warn("undefined", "samples cannot be evaluated", std::move(undefined), out);
  const double dof = static_cast<double>(evaluation.dof);
  if (exceeds(evaluation.chi2 / dof, dof)) {
    Warning excess{"chi2", excess_text(evaluation.chi2 / dof), {}};
    if (evaluation.worst_share > kMostOfIt && evaluation.views.size() > 1) {
      excess.text +=
          text("; %.0f %% of their squares are those of sample '", 100 * evaluation.worst_share) +
          evaluation.worst_sample + "'";
      excess.names.push_back(evaluation.worst_sample);
    }
    excess.text += kLookOrState;
    out.push_back(std::move(excess));
  }
  std::vector<Case> open;
  for (const std::string& name : evaluation.open)
    open.push_back({name, name + " is absent from the rig: it was estimated from the samples of "
                                 "each split"});
  warn("open_pose", "poses are absent from the rig", std::move(open), out);
  Warning useless{"no_effect", "", evaluation.without_effect};
  for (const std::string& pattern : evaluation.without_effect)
    useless.text += (useless.text.empty() ? "" : "; ") + ("free '" + pattern) +
                    "' changes nothing: no measurement depends on it";
  if (!useless.text.empty()) out.push_back(std::move(useless));
  return out;
}

}  // namespace kincal
