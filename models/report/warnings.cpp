#include "warnings.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "../rig/configuration.h"
#include "../rig/numbers.h"
#include "../rig/words.h"

namespace kincal {
namespace {

using Warnings = std::vector<Warning>;

constexpr size_t kShown = 5;
constexpr double kManyRejected = 0.2;  // share of the samples
constexpr double kWide = 5;            // times the width that a group begins with
constexpr double kNoisy = 3;  // times as noisy as stated: a joint that something else is wrong with

/// Whether chi2/dof is further from 1 than noise of the stated sigmas would have it: by a fifth or
/// more, and by four of its standard deviations, sqrt(2/dof).
bool exceeds(double ratio, double dof) {
  return dof > 0 && ratio > std::max(1.25, 1 + 4 * std::sqrt(2 / dof));
}
bool falls_short(double ratio, double dof) {
  return dof > 0 && ratio < std::min(0.8, 1 - 4 * std::sqrt(2 / dof));
}

std::string excess_text(double ratio) {
  return text("chi2/dof is %.3g: the residuals are larger than the rig's sigmas allow", ratio);
}

std::string count_text(size_t count, const char* what) {
  return std::to_string(count) + " " + what + (count == 1 ? "" : "s");
}

/// The types of the sensors whose views show what has this pose, if none of them can give a pose to
/// start from; else "".
std::string types_without_start(const Solution& solution, const std::string& pose) {
  std::string types;
  for (const Sample& sample : solution.samples())
    for (const View& v : sample.views) {
      const int target = solution.table().target_pose[v.target];
      if (solution.table().all[solution.table().sensor_pose[v.sensor]].name != pose &&
          (target < 0 || solution.table().all[target].name != pose))
        continue;
      const Sensor& sensor = solution.rig().sensors[v.sensor];
      if (sensor.model->measurement_kind() != MeasurementKind::none) return "";
      if (types.find(sensor.type) == std::string::npos)
        types += (types.empty() ? "" : ", ") + sensor.type;
    }
  return types;
}

void warn_of_starts(const Solution& solution, Warnings& out) {
  for (const std::string& message : solution.without_effect) out.push_back({"no_effect", message});
  for (const std::string& name : solution.identity_starts)
    out.push_back({"identity", name + " is absent from the rig and freed in part or with a prior: "
                                      "its initial value is the identity"});
  for (const std::string& name : solution.lost_starts) {
    const std::string types = types_without_start(solution, name);
    out.push_back(
        {"no_start",
         name + " is absent from the rig and " +
             (types.empty() ? "nothing with a known pose ties it down: it starts at the identity"
                            : "a sensor of type " + types +
                                  " gives no pose to start from: it starts at the identity, and "
                                  "the result may be "
                                  "wrong; give it a pose in the rig")});
  }
  for (const ReplacedStart& start : solution.replaced_starts)
    out.push_back(
        {"given_pose",
         start.name +
             text(": the data contradict the given pose; the estimate is %.3g m and %.3g degrees "
                  "from it. ",
                  start.moved, start.turned * 180 / kPi) +
             (start.cost_per_dof > 0 ? text("From there chi2/dof ended at %.3g", start.cost_per_dof)
                                     : std::string("No calibration can start there")) +
             ", so it was started where the data put it: correct it in the rig, or leave it away"});
  for (const AmbiguousStart& start : solution.ambiguous_starts)
    out.push_back(
        {"ambiguous_start",
         start.first + " and " + start.second +
             text(" are absent from the rig, and several solutions fit the readings equally well "
                  "(the next one is turned by %.3g degrees): ",
                  start.turned * 180 / kPi) +
             "give one of them a pose in the rig, or record more postures, as different as "
             "possible"});
}

/// Bodies that no training sample shows, one warning for those with a pose in the rig and one for
/// the others.
void warn_of_unseen(const Solution& solution, Warnings& out) {
  const UnseenPoses unseen = unseen_poses(solution);
  const auto warn = [&](const std::vector<int>& poses, const char* words) {
    std::string list;
    for (const int p : poses) list += (list.empty() ? "" : ", ") + solution.table().all[p].name;
    if (!list.empty())
      out.push_back(
          {"never_seen", list + ": no training sample shows what has this pose; " + words});
  };
  warn(unseen.open,
       "nothing is known of it, and of what depends on it (in the result it is the identity)");
  warn(unseen.given, "it keeps the rig's value, which predictions take as exact");
}

void warn_of_doubted_priors(const Report& report, Warnings& out) {
  for (const DoubtedPrior& prior : report.doubted)
    out.push_back({"prior", "the data contradict the rig's prior on " + prior.pattern +
                                text(": with one %.2g times as wide they are far more likely (log "
                                     "evidence %+.3g). With the prior as it is other numbers take "
                                     "the place of these; correct it, or leave it away",
                                     prior.factor, prior.gain)});
}

/// So many outliers that the majority need not be right.
void warn_of_rejected(const Report& report, Warnings& out) {
  std::set<std::string> samples;
  for (const Rejected& r : report.rejected)
    if (r.sensor.empty()) samples.insert(r.sample);
  const size_t all = samples.size() + report.solution.training().size();
  if (samples.empty() || samples.size() < kManyRejected * static_cast<double>(all)) return;
  std::string wide;
  for (const AutomaticGroup& group : report.automatic)
    if (!group.held && group.factor >= kWide)
      wide += (wide.empty() ? "" : ", ") + group.name + text(" (%.2g times)", group.factor);
  if (!wide.empty())
    wide = ". What is left asks for errors of the robot far beyond the usual: " + wide;
  out.push_back(
      {"rejected",
       std::to_string(samples.size()) + " of " + std::to_string(all) +
           " training samples were taken out as outliers. Among so many the good ones may "
           "be those that were taken out: look at both parts before the result is used" +
           wide});
}

void warn_of_undefined(const Residuals& residuals, Warnings& out) {
  for (const UndefinedSample& sample : residuals.undefined)
    out.push_back(
        sample.before
            ? Warning{"undefined_before",
                      "sample '" + sample.id +
                          "' cannot be evaluated at the rig's values (a point behind a "
                          "camera): it is missing from rms_before"}
            : Warning{"undefined", "held-out sample '" + sample.id +
                                       "' cannot be evaluated at the estimate (a point behind a "
                                       "camera): it is missing from its rms"});
}

void warn_of_unfinished(const std::vector<Unfinished>& unfinished, Warnings& out) {
  for (const Unfinished& u : unfinished)
    out.push_back({"unfinished",
                   u.column + (u.train ? " of the training samples" : " of the held-out samples") +
                       " is not final: what was estimated to judge them did not converge in " +
                       count_text(u.samples.size(), "sample") + ", first '" + u.samples.front() +
                       "'"});
}

void warn_of_steps(const Report& report, Warnings& out) {
  const Solution& solution = report.solution;
  for (const StepResult& s : solution.steps)
    if (!s.converged && !s.repeated)
      out.push_back({"not_converged", "step '" + s.name + "' did not converge in " +
                                          std::to_string(s.iterations) + " iterations"});
  for (size_t i = 0; i < solution.unobservable.size(); ++i) {
    std::string sum;
    for (const auto& c : solution.unobservable[i])
      sum += (sum.empty() ? "" : " ") + text("%+.4g ", c.second) + c.first;
    const std::vector<WeakDirection>& weak =
        report.explanation.weak;  // those of `unobservable` stand first
    const std::string why = i < weak.size() ? weak[i].why + ". Cure: " + weak[i].cure
                                            : "hold one of these or give it a prior";
    out.push_back({"unobservable",
                   "the data do not determine " + sum + ": " + why + "; their sigmas are unknown"});
  }
}

void warn_of_chi2(const Report& report, Warnings& out) {
  const Solution& solution = report.solution;
  const double ratio = solution.chi2_per_dof();
  if (exceeds(ratio, solution.dof_data)) out.push_back({"chi2", excess_text(ratio)});
  if (falls_short(ratio, solution.dof_data) &&
      solution.noise != NoiseMode::point)  // there it means nothing
    out.push_back({"chi2", text("chi2/dof is %.3g: the residuals are smaller than the sigmas of "
                                "the rig say; the sigmas of the result are too large",
                                ratio)});
  for (const SensorResult& s : report.residuals.sensors) {
    const double count = static_cast<double>(s.train.whitened_count),
                 each = s.train.whitened_squared / count;
    if (exceeds(each, count))  // what the unknowns took makes it small: that says nothing
      out.push_back({"chi2", "sensor '" + s.name + "': " +
                                 text("chi2/n is %.3g, its residuals are %.2g times its sigma",
                                      each, std::sqrt(each))});
  }
}

void warn_of_joint_errors(const Solution& solution, Warnings& out) {
  struct Excess {
    int count = 0, sample = -1;
    double worst = 0;
  };
  const Rig& rig = solution.rig();
  std::map<int, Excess> excess;  // by joint
  for (const auto& e : solution.values.errors) {
    const double sigmas = e.second / rig.joints[e.first.second].sigma;
    if (solution.noise != NoiseMode::latent || !(std::abs(sigmas) > 4)) continue;
    Excess& x = excess[e.first.second];
    ++x.count;
    if (std::abs(sigmas) > std::abs(x.worst)) x.worst = sigmas, x.sample = e.first.first;
  }
  for (const auto& x : excess)
    out.push_back({"joint_error",
                   "joint '" + rig.tree.joints[x.first].name + "': its error exceeds 4 sigmas in " +
                       count_text(static_cast<size_t>(x.second.count), "sample") + ", at worst " +
                       text("%+.3g sigmas (%.3g) in sample '", x.second.worst,
                            x.second.worst * rig.joints[x.first].sigma) +
                       solution.samples()[x.second.sample].id + "'"});
}

void warn_of_joint_noise(const Report& report, Warnings& out) {
  std::string list;
  for (const NoiseLevel& level : report.noise_levels)
    if (level.joint >= 0 && level.used == level.assumed && level.differs() &&
        level.seen >= kNoisy * level.assumed)
      list += (list.empty() ? "'" : ", '") + report.solution.rig().tree.joints[level.joint].name +
              "'" + text(" (stated %.3g, seen %.3g ", level.assumed, level.seen) + level.unit + ")";
  if (!list.empty())
    out.push_back({"joint_noise",
                   "these joints are at least three times noisier than stated: " + list +
                       ". What is stated of them is wrong, or the model lacks something of them; "
                       "the sigmas of the result are too small"});
}

void warn_of_parameters(const Solution& solution, Warnings& out) {
  std::vector<std::string> explained = solution.identity_starts;  // elsewhere
  for (const ReplacedStart& start : solution.replaced_starts) explained.push_back(start.name);
  for (const ParameterEstimate& e : solution.parameters) {
    if (e.pose && std::find(explained.begin(), explained.end(), e.name) == explained.end()) {
      const double moved = std::hypot(e.value[0], e.value[1], e.value[2]),
                   turned = std::hypot(e.value[3], e.value[4], e.value[5]);
      if (moved > 0.1)
        out.push_back(
            {"moved",
             e.name + text(" moved by %.3g m from its initial value: is that possible?", moved)});
      if (turned > 10 * kPi / 180)
        out.push_back(
            {"moved",
             e.name + text(" turned by %.3g degrees from its initial value: is that possible?",
                           turned * 180 / kPi)});
    }
    for (size_t c = 0; c < e.value.size(); ++c) {
      const std::string name = e.component_name(c);
      if (e.prior[c] > 0 && std::abs(e.value[c] - e.initial[c]) > 3 * e.prior[c])
        out.push_back({"prior", name + text(" is %.1f prior sigmas from its prior",
                                            (e.value[c] - e.initial[c]) / e.prior[c])});
      if (e.units[c] == "m" && e.sigma[c] > 0.01)
        out.push_back({"sigma", name + text(" is known to %.3g m only (one sigma)", e.sigma[c])});
      if (e.units[c] == "rad" && e.sigma[c] > kPi / 180)
        out.push_back({"sigma", name + text(" is known to %.3g degrees only (one sigma)",
                                            e.sigma[c] * 180 / kPi)});
    }
  }
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
    out.push_back(
        {"joint_model", "joint '" + rig.tree.joints[j].name +
                            "': a URDF cannot express its joint model (" + numbers +
                            "); a robot that takes the linear part alone is off by up to" +
                            text(" %.3g ", largest) + table.all[table.joint_offset[j]].units[0] +
                            " in these samples. The numbers stand in the calibrated rig"});
  }
}

void warn_of_misfits(const char* id, const char* kind, const std::vector<Misfit>& found,
                     Warnings& out) {
  if (found.empty()) return;
  std::string list;
  for (size_t i = 0; i < found.size() && i < kShown; ++i)
    list += (i ? ", " : "") + found[i].name + text(" (%.3g times)", std::sqrt(found[i].ratio));
  out.push_back({id, count_text(found.size(), kind) +
                         " with residuals or joint errors far beyond what is usual here: " + list +
                         (found.size() > kShown ? ", ..." : "")});
}

/// What a robust fit names, in place of the samples and views that stick out of a plain one, which
/// it may mislead.
void warn_of_outliers(const std::vector<Rejected>& outliers, Warnings& out) {
  struct Kind {
    const char *id, *one, *many;
    size_t count, shown;
    std::string list;
  };
  Kind kinds[] = {{"outlier_sample", " sample does", " samples do", 0, 0, ""},
                  {"outlier_view", " view does", " views do", 0, 0, ""},
                  {"outlier_point", " point does", " points do", 0, 0, ""}};
  for (const Rejected& r : outliers) {
    Kind& kind = kinds[r.sensor.empty() ? 0 : r.ids.empty() ? 1 : 2];
    kind.count += std::max<size_t>(1, r.ids.size());
    if (++kind.shown > kShown) continue;
    kind.list +=
        (kind.shown > 1 ? ", '" : "'") + r.sample + "'" + (r.sensor.empty() ? "" : " " + r.sensor);
  }
  for (const Kind& kind : kinds)
    if (kind.count > 0)
      out.push_back({kind.id, "a robust fit finds that " + std::to_string(kind.count) +
                                  (kind.count == 1 ? kind.one : kind.many) +
                                  " not belong to the others: " + kind.list +
                                  (kind.shown > kShown ? ", ..." : "") +
                                  "; a calibration that rejects outliers takes them out"});
}

/// Joints whose noise may be a gear of another ratio: nothing else was free to take that up.
std::string doubted_gears(const Report& report) {
  for (const AutomaticGroup& group : report.automatic)
    if (group.name == "gears") return "";
  std::string list;
  for (const NoiseLevel& level : report.noise_levels)
    if (level.joint >= 0 && level.assumed > 0 && level.used >= kNoisy * level.assumed)
      list +=
          (list.empty() ? "'" : ", '") + report.solution.rig().tree.joints[level.joint].name + "'";
  return list.empty() ? ""
                      : ". " + list +
                            " may have another gear ratio than stated, which looks like noise: "
                            "the group gears estimates it";
}

/// Groups that came out much worse than such numbers usually are, and gears that the rig's path
/// leaves out.
void warn_of_widths(const Report& report, Warnings& out) {
  constexpr double kUnusual = 9;    // two spreads of what is assumed of a width
  constexpr double kSpeaking = 10;  // log evidence
  for (const AutomaticGroup& group : report.automatic)
    if (group.factor > kUnusual && !group.held)
      out.push_back(
          {"width", "group '" + group.name +
                        text("': its numbers are off by %.0f times as much as usual: look "
                             "for a mistake in the rig or the data that they take up",
                             group.factor)});
  if (report.gears_gain > kSpeaking)
    out.push_back({"gears", text("the data speak for other gear ratios than stated (log evidence "
                                 "%.0f), which were not estimated: predicted errors may be too "
                                 "small; the group gears estimates them",
                                 report.gears_gain)});
}

void warn_of_noise(const Report& report, Warnings& out) {
  if (!report.noise_estimated) return;
  if (std::isfinite(report.noise_estimated->stated)) {
    std::string levels;
    for (const NoiseLevel& level : report.noise_levels)
      if (level.used != level.assumed)
        levels +=
            (levels.empty() ? "" : "; ") + level.of + (level.part.empty() ? "" : " " + level.part) +
            text(": %.3g, stated ", level.used) + text("%.3g ", level.assumed) + level.unit +
            (std::abs(std::log(level.used / level.assumed)) > std::log(9.99) ? " (at the bound)"
                                                                             : "");
    out.push_back({"noise", text("with the stated sigmas chi2/dof is %.3g, and no mistake explains "
                                 "that: sigmas were estimated from the data (joints stated exact "
                                 "began with 0.0001). ",
                                 report.noise_estimated->stated) +
                                levels + doubted_gears(report)});
  }
  if (!report.noise_estimated->converged)
    out.push_back({"noise", "the noise was estimated in " +
                                std::to_string(report.noise_estimated->count) +
                                " rounds and still moves: what the model lacks is taken for noise, "
                                "now of this and now of that"});
  for (const NoiseLevel& level : report.noise_levels)
    if (level.own_views > 0 && level.used != level.assumed && level.first == 0)
      out.push_back(
          {"noise", level.of + ": " + std::to_string(level.own_views) +
                        (level.own_views == 1 ? " view has" : " views have") +
                        " sigmas of their own in the samples file; they were multiplied by "
                        "the sensor's factor, the file keeps its numbers"});
}

/// Words for an error as read: metres and radians in thousandths.
std::string error_text(double value, const std::string& unit) {
  const bool metres = unit == "m", radians = unit == "rad";
  return text("%.3g ", value * (metres || radians ? 1e3 : 1)) + (metres    ? "mm"
                                                                 : radians ? "mrad"
                                                                           : unit);
}

/// A calibration that is worse than one that leaves the robot as it is.
void warn_of_held_out(const Validation& validation, Warnings& out) {
  if (!validation.baselines) return;
  std::string list;
  for (const Baseline& b : validation.baselines->rows)
    if (b.worse())
      list += (list.empty() ? "sensor '" : "; sensor '") + b.sensor + "' " +
              error_text(b.automatic, b.unit) + " as read, the mounts alone " +
              error_text(b.mounts, b.unit) + text(" (%.3g times, 95 %% ", b.ratio) +
              text("%.3g to %.3g)", b.of_ratio.low, b.of_ratio.high);
  if (!list.empty())
    out.push_back(
        {"held_out",
         "on data that it did not use this calibration is worse than its mounts alone: " + list +
             ". Too many numbers are free for these data, or a mistake somewhere is "
             "taken up by the arm's numbers: use the result for its mounts at most, "
             "leave groups out, and look for mistakes"});
}

void warn_of_minima(const Restarts& restarts, Warnings& out) {
  const std::vector<Minimum>& minima = restarts.minima;
  if (minima.size() < 2 ||
      !(minima[1].cost < minima[0].cost || same_cost(minima[1].cost, minima[0].cost)))
    return;
  const Minimum& m = minima[1];
  std::string names;
  for (size_t i = 0; i < std::min<size_t>(m.differs.size(), 3); ++i)
    names += (i ? ", " : "") + m.differs[i].first + text(" (%+.3g sigmas)", m.differs[i].second);
  out.push_back({"minima", std::to_string(m.count) + " of " + std::to_string(restarts.count) +
                               " restarts end in " +
                               (same_cost(m.cost, minima[0].cost)
                                    ? "another minimum that is as good as this result"
                                    : text("a better minimum: cost %.8g, this result has %.8g",
                                           m.cost, minima[0].cost)) +
                               ". Most different: " + names +
                               ". The result is the one that the rig's own values lead to"});
}

}  // namespace

std::vector<Warning> warnings(const Report& report) {
  Warnings out;
  warn_of_starts(report.solution, out);
  warn_of_unseen(report.solution, out);
  warn_of_undefined(report.residuals, out);
  warn_of_steps(report, out);
  warn_of_unfinished(report.residuals.unfinished, out);
  warn_of_chi2(report, out);
  warn_of_joint_errors(report.solution, out);
  warn_of_joint_noise(report, out);
  warn_of_doubted_priors(report, out);
  warn_of_parameters(report.solution, out);
  warn_of_joint_models(report.solution, out);
  if (report.outliers.empty()) {
    warn_of_misfits("outlier_sample", "sample", report.misfits.samples, out);
    warn_of_misfits("outlier_view", "view", report.misfits.views, out);
  }
  warn_of_rejected(report, out);
  if (!report.no_consensus.empty()) out.push_back({"no_consensus", report.no_consensus});
  warn_of_noise(report, out);
  warn_of_widths(report, out);
  warn_of_outliers(report.outliers, out);
  if (report.restarts) warn_of_minima(*report.restarts, out);
  warn_of_held_out(report.validation, out);
  return out;
}

std::vector<Warning> warnings(const Evaluation& evaluation) {
  Warnings out;
  if (!evaluation.converged)
    out.push_back({"not_converged", "the estimation of targets or joint errors did not converge"});
  const double dof = static_cast<double>(evaluation.dof);
  if (exceeds(evaluation.chi2 / dof, dof))
    out.push_back({"chi2", excess_text(evaluation.chi2 / dof)});
  for (const std::string& name : evaluation.open)
    out.push_back({"open_pose", name + " is absent from the rig: it was estimated from the samples "
                                       "of each split"});
  for (const std::string& pattern : evaluation.without_effect)
    out.push_back(
        {"no_effect", "free '" + pattern + "' changes nothing: no measurement depends on it"});
  return out;
}

}  // namespace kincal
