#include "warnings.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../analysis/hand_eye.h"
#include "../calibration/start_poses.h"
#include "../rig/configuration.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "input_warnings.h"
#include "noise_warnings.h"
#include "parameter_warnings.h"
#include "scale_warnings.h"
#include "trial_warnings.h"
#include "verdict.h"
#include "warning_items.h"

namespace kincal {
namespace {

constexpr size_t kShown = kNamed;
constexpr double kFitsWell = 5;  // chi2/dof, of a step that did not converge

/// Whether chi2/dof is above or below what noise of the stated sigmas makes it.
bool exceeds(double ratio, double dof) { return ratio > 1 && !is_of_stated_size(ratio, dof); }
bool falls_short(double ratio, double dof) { return ratio < 1 && !is_of_stated_size(ratio, dof); }

constexpr char kLookOrLeaveOut[] = "check the samples recorded there, or leave them out";
constexpr double kMostOfIt = 0.5;  // of the squares: one sample
constexpr char kLookOrState[] = "look for the mistake, or state the estimated sigmas";

std::string excess_text(double ratio) {
  return text("chi2/dof is %.3g: the residuals are larger than the rig's sigmas allow", ratio);
}

std::string count_text(size_t count, const char* what) {
  return std::to_string(count) + " " + what + (count == 1 ? "" : "s");
}

void warn_of_starts(const Report& report, Notices& out) {
  const Solution& solution = report.solution;
  std::string useless;
  for (const std::string& message : solution.without_effect)
    useless += (useless.empty() ? "" : "; ") + message;
  if (!useless.empty())
    out.push_back(make_notice(NoticeKind::no_effect,
                              subjects(Subject::Kind::part, solution.without_effect),
                              std::move(useless)));
  std::vector<WarningItem> identity, lost, contradicted, ambiguous;
  std::string cure_of_identity;
  for (const std::string& name : solution.identity_starts) {
    const Notice one = identity_notice(solution, name);
    identity.push_back({one.where[0], one.what});
    cure_of_identity = one.cure;
  }
  for (const std::string& name : solution.lost_starts) {
    const std::string reason = lost_start_text(solution, name);
    if (!reason.empty()) lost.push_back({Subject::parameter(name), reason});
  }
  for (const ReplacedStart& start : solution.replaced_starts)
    contradicted.push_back(
        {Subject::parameter(start.name),
         start.name +
             text(": the data contradict the given pose; the estimate is %.3g m and %.3g degrees "
                  "from it; ",
                  start.moved, start.turned * 180 / kPi) +
             (start.cost_per_dof > 0 ? text("from there chi2/dof ended at %.3g", start.cost_per_dof)
                                     : std::string("no calibration can start there")) +
             ", so it was started from the data",
         start.moved + start.turned});
  for (const AmbiguousStart& start : solution.ambiguous_starts)
    ambiguous.push_back({Subject::parameter(start.first),
                         start.first + " and " + start.second +
                             text(" are missing in the rig, and several solutions fit the readings "
                                  "equally well (the next one is turned by %.3g degrees)",
                                  start.turned * 180 / kPi)});
  if (!identity.empty()) {
    out.push_back(notice_of(NoticeKind::identity, "poses start at the identity",
                            std::move(identity), "", std::move(cure_of_identity)));
    if (!report.automatic.empty()) out.back().severity = Severity::doubt;  // somebody held it there
  }
  warn(NoticeKind::no_start, "poses have no start", std::move(lost), "", out);
  warn(NoticeKind::given_pose, "given poses contradict the data", std::move(contradicted),
       "correct it in the rig, or delete it there", out);
  warn(NoticeKind::ambiguous_start, "pairs of poses are ambiguous", std::move(ambiguous),
       "give one of them a pose in the rig, or record more postures, as different as possible",
       out);
}

void warn_of_undefined(const Residuals& residuals, Notices& out) {
  std::vector<WarningItem> before, after;
  for (const UndefinedSample& sample : residuals.undefined)
    if (sample.before)
      before.push_back({Subject::sample(sample.id),
                        "sample '" + sample.id +
                            "' cannot be evaluated at the rig's values (a point behind "
                            "a camera): it is missing from rms_before"});
    else
      after.push_back({Subject::sample(sample.id),
                       "held-out sample '" + sample.id +
                           "' cannot be evaluated at the estimate (a point behind a "
                           "camera): it is missing from its rms"});
  warn(NoticeKind::undefined_before, "samples cannot be evaluated at the rig's values",
       std::move(before), "", out);
  warn(NoticeKind::undefined, "held-out samples cannot be evaluated", std::move(after), "", out);
}

void warn_of_unfinished(const std::vector<Unfinished>& unfinished, Notices& out) {
  std::vector<WarningItem> columns;
  for (const Unfinished& u : unfinished) {
    const std::string column =
        u.column + (u.train ? " of the training samples" : " of the held-out samples");
    columns.push_back(
        {{Subject::Kind::part, column},
         column + " is not final: their free targets or joint errors did not converge in " +
             count_text(u.samples.size(), "sample") + ", first '" + u.samples.front() + "'",
         static_cast<double>(u.samples.size())});
  }
  warn(NoticeKind::unfinished, "columns are not final", std::move(columns), "", out);
}

/// The first step that did not converge, what it may come from, and what to do.
void warn_of_steps(const Report& report, Notices& out) {
  const Solution& solution = report.solution;
  for (const StepResult& s : solution.steps) {
    if (s.converged || s.repeated) continue;
    Notice notice = make_notice(
        NoticeKind::not_converged, {{Subject::Kind::step, s.name}},
        "step '" + s.name + "' did not converge in " + std::to_string(s.iterations) + " iterations",
        "", "estimate fewer parameters, use more steps, or start nearer to the truth");
    const auto because = [&](const Notice& cause) {
      notice.why = cause.what + (cause.why.empty() ? "" : ". " + capital(cause.why));
      notice.cure = cause.cure;
      notice.otherwise = cause.otherwise;
    };
    const std::optional<Notice> identity = counts_from_identity(solution),
                                loose = loose_parameters(report);
    if (const Notice* first = first_mistake(report)) {
      notice.cause = first->kind;
      notice.why = std::string("look first at ") + id(first->kind) + ": " + first->what;
      notice.cure = first->cure;
    } else if (identity)
      because(*identity);
    else if (loose && loose->severity == Severity::fault && solution.chi2_per_dof() < kFitsWell)
      because(*loose);
    else if (has_redescending_loss(solution, s.name))
      notice.cure =
          "add a step with loss huber or none before this one: from rough starting values this "
          "loss also rejects good data";
    else if (!report.outliers.empty())
      notice.cure = "reject outliers (`reject`), or check the samples named";
    if (solution.status != Status::not_converged) notice.severity = Severity::remark;
    out.push_back(std::move(notice));
    break;
  }
}

void warn_of_directions(const Report& report, Notices& out) {
  const Solution& solution = report.solution;
  std::vector<WarningItem> directions;
  for (const auto& direction : solution.unobservable) {
    std::string sum;
    std::vector<std::string> parameters;
    for (const auto& c : direction) {
      sum += (sum.empty() ? "" : " ") + text("%+.4g ", c.second) + c.first;
      parameters.push_back(c.first);
    }
    directions.push_back({{Subject::Kind::part, sum},
                          "the data do not determine " + listed(parameters, kNamed) +
                              (parameters.size() > 1 ? " together" : "")});
  }
  if (directions.empty()) return;
  // (Those of `unobservable` stand first.)
  const std::vector<WeakDirection>& weak = report.explanation.weak;
  out.push_back(notice_of(NoticeKind::unobservable, "directions are not determined",
                          std::move(directions), weak.empty() ? "" : weak[0].why,
                          weak.empty() ? "fix one of these or give it a prior" : weak[0].cure));
  if (solution.status != Status::unobservable) out.back().severity = Severity::remark;
}

/// A robot that did not turn enough, of mounts that are hardly known for that.
void warn_of_motion(const Report& report, Notices& out) {
  if (!report.solution.unobservable.empty() || !has_open_mount(report) || hangs_on_a_size(report))
    return;
  const MotionLack lack = motion_lack(*report.solution.recording);
  if (lack.why.empty()) return;
  out.push_back(make_notice(NoticeKind::few_turns, {}, lack.why, "", lack.cure));
  out.back().otherwise = lack.otherwise;
  if (report.solution.status == Status::unobservable) out.back().severity = Severity::fault;
}

void warn_of_chi2(const Report& report, Notices& out) {
  const Solution& solution = report.solution;
  const double ratio = solution.chi2_per_dof();
  std::string whole;
  const bool exceeded = exceeds(ratio, solution.dof_data);
  if (exceeded) whole = excess_text(ratio);
  if (falls_short(ratio, solution.dof_data) &&
      solution.noise != NoiseMode::point)  // there it means nothing
    whole = text(
        "chi2/dof is %.3g: the residuals are smaller than the rig's sigmas predict; the sigmas of "
        "the result are too large",
        ratio);
  std::vector<WarningItem> sensors;
  for (const SensorResult& s : report.residuals.sensors) {
    const double count = static_cast<double>(s.train.whitened_count),
                 each = s.train.whitened_squared / count;
    if (exceeds(each, count))  // what the unknowns took makes it small: that says nothing
      sensors.push_back({Subject::sensor(s.name),
                         "sensor '" + s.name + "': " +
                             text("chi2/n is %.3g, its residuals are %.2g times its sigma", each,
                                  std::sqrt(each)),
                         each});
  }
  if (sensors.empty() && whole.empty()) return;
  const bool larger = !sensors.empty() || ratio > 1;
  Notice notice =
      sensors.empty()
          ? make_notice(NoticeKind::chi2, {}, whole)
          : notice_of(NoticeKind::chi2, "sensors have larger residuals than their sigmas allow",
                      std::move(sensors));
  if (!whole.empty() && notice.what != whole) {
    notice.why = std::move(notice.what);
    notice.what = std::move(whole);
  }
  if (exceeded)
    notice.why = text(
                     "sigmas of the result use the stated noise: they are too small by a factor of "
                     "at least %.2g",
                     std::sqrt(ratio)) +
                 (notice.why.empty() ? "" : ". " + capital(notice.why));
  notice.cure = larger ? kLookOrState
                       : "state the estimated sigmas (`estimate_noise`), or leave them: the errors "
                         "are smaller than the sigmas predict";
  if (larger && neighbours_err_alike(solution.samples(), report.residuals.after))
    say_no_noise(notice);
  out.push_back(std::move(notice));
}

void warn_of_unexplained(const Report& report, Notices& out) {
  if (!report.unexplained) return;
  out.push_back(*report.unexplained);
  if (report.solution.status != Status::unexplained) out.back().severity = Severity::doubt;
}

void warn_of_joint_errors(const Solution& solution, Notices& out) {
  struct Excess {
    int count = 0, sample = -1;
    double worst = 0, error = 0;  // sigmas; rad or m
  };
  const Rig& rig = solution.rig();
  constexpr double kOneInFifty = 0.02;  // that one of so many right errors is beyond the limit
  const double count = static_cast<double>(solution.values.errors.size());
  double limit = 4;
  while (count * 2 * normal_tail(limit) > kOneInFifty) limit += 0.1;
  std::map<int, Excess> excess;  // by joint
  for (const auto& e : solution.values.errors) {
    const double sigmas =
        e.second / joint_sigma(rig, solution.samples()[e.first.first], e.first.second);
    if (solution.noise != NoiseMode::latent || !(std::abs(sigmas) > limit)) continue;
    Excess& x = excess[e.first.second];
    ++x.count;
    if (std::abs(sigmas) > std::abs(x.worst)) x = {x.count, e.first.first, sigmas, e.second};
  }
  std::vector<WarningItem> joints;
  for (const auto& x : excess) {
    const std::string name = rig.tree.joints[x.first].name;
    joints.push_back(
        {Subject::joint(name),
         "joint '" + name + "': its error exceeds " + text("%.2g", limit) + " sigmas in " +
             count_text(static_cast<size_t>(x.second.count), "sample") + ", at worst " +
             text("%+.3g sigmas (%.3g %s) in sample '", x.second.worst, 1e3 * x.second.error,
                  rig.tree.joints[x.first].type == JointType::prismatic ? "mm" : "mrad") +
             solution.samples()[x.second.sample].id + "'",
         std::abs(x.second.worst)});
  }
  warn(NoticeKind::joint_error, text("joints have errors above %.2g sigmas", limit),
       std::move(joints), "check these samples, or state a larger noise of these joints", out);
}

void warn_of_joint_noise(const Report& report, Notices& out) {
  std::vector<const NoiseLevel*> noisy;
  for (const NoiseLevel& level : report.noise_levels)
    if (level.joint >= 0 && level.guess == 0 && level.used == level.assumed && level.differs() &&
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
  if (names.empty()) return;
  out.push_back(
      make_notice(NoticeKind::joint_noise, subjects(Subject::Kind::joint, names),
                  count_text(names.size(), "joint") +
                      " at least three times noisier than stated: " + listed(words, kShown),
                  "if the stated noise is right, the model lacks an effect of these joints (a "
                  "gear, play) and the sigmas of the result are too small",
                  "state the estimated noise, or let it be estimated (`estimate_noise`), if the "
                  "joints are that noisy"));
  out.back().otherwise = "otherwise look for effects that the model lacks: a gear, play, bending";
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
        for (size_t i = 0; i < v.z.size(); i += rig.sensors[v.sensor].model->measurement_size())
          include(sample, v.z[i]);
  }
  return largest;
}

/// How much joints bend, and where what goes with the load is no elasticity; "": they do not.
std::string bending_words(const Report& report) {
  const Solution& solution = report.solution;
  const auto most = std::max_element(
      report.deflections.begin(), report.deflections.end(),
      [](const Deflection& a, const Deflection& b) { return a.largest < b.largest; });
  if (most == report.deflections.end()) return "";
  std::string out = most->frame + text(" sags by %.2g mm on average, ", 1e3 * most->mean) +
                    text("by %.2g mm at most (sample '", 1e3 * most->largest) +
                    solution.samples()[most->largest_in].id + "')";
  std::vector<std::string> names;
  for (const int j : bent_against_load(solution))
    names.push_back(quoted(solution.rig().tree.joints[j].name));
  if (!names.empty())
    out += "; joint " + listed(names, kShown) +
           " turns against the load: this depends on the load but is not elasticity (compensating "
           "servos, springs)";
  return out;
}

/// A URDF takes up offsets, and scales on demand; who reads no more than it loses the rest of a
/// joint model.
void warn_of_joint_models(const Report& report, Notices& out) {
  const Solution& solution = report.solution;
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  std::vector<WarningItem> bent;
  if (report.rigid) {
    for (const SensorResult& s : report.residuals.sensors) {
      const SplitStatistics& errors = s.test.points > 0 ? s.test : s.train;
      bent.push_back(
          {Subject::sensor(s.name),
           "joints have errors that a URDF cannot express: with robot.urdf alone sensor '" +
               s.name + "' errs by " + shown_text(errors.rms_uncorrected, s.unit) +
               ", with rig.yaml, which has them, by " + shown_text(errors.rms_as_read, s.unit),
           errors.rms_uncorrected / errors.rms_as_read});
    }
    out.push_back(notice_of(NoticeKind::joint_model,
                            "sensors have larger errors with robot.urdf alone", std::move(bent),
                            bending_words(report),
                            "command the readings that `kincal compensate` computes, or use "
                            "rig.yaml; robot.urdf alone lacks these errors"));
    return;
  }
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    if (table.joint_offset[j] < 0 || rig.joints[j].model->size() <= 2) continue;
    const double largest = largest_bend(solution, static_cast<int>(j));
    if (largest == 0) continue;
    std::string numbers;
    for (int k = table.joint_offset[j] + 2; k < table.joint_origin[j]; ++k) {
      const Parameter& p = table.all[k];
      numbers += (numbers.empty() ? "" : ", ") + p.name +
                 (p.size() == 1 ? text(" = %.6g", solution.values.shared(p.start)) : "");
    }
    bent.push_back({Subject::joint(rig.tree.joints[j].name),
                    "joint '" + rig.tree.joints[j].name +
                        "': a URDF cannot express its joint model (" + numbers +
                        "); a robot that takes the linear part alone is off by up to" +
                        text(" %.3g ", largest) + table.all[table.joint_offset[j]].units[0] +
                        " in these samples (the calibrated rig has all of them)",
                    largest});
  }
  warn(NoticeKind::joint_model, "joints have models that a URDF cannot express", std::move(bent),
       "", out);
}

void warn_of_misfits(NoticeKind kind, Subject::Kind of, const std::vector<Misfit>& found,
                     Notices& out) {
  if (found.empty()) return;
  Subjects where;
  std::vector<std::string> words;
  for (const Misfit& misfit : found) {
    where.push_back({of, misfit.name});
    words.push_back(misfit.name + text(" (%.3g times)", std::sqrt(misfit.ratio)));
  }
  out.push_back(make_notice(
      kind, std::move(where),
      count_text(found.size(), of == Subject::Kind::view ? "view" : "sample") +
          " with residuals or joint errors far larger than usual here: " + listed(words, kShown),
      "", kLookOrLeaveOut));
}

/// What a robust fit names, in place of the samples and views that stick out of a plain one, which
/// it may mislead.
void warn_of_outliers(const std::vector<Rejected>& outliers, Notices& out) {
  struct Kind {
    NoticeKind kind;
    Subject::Kind of;
    const char *one, *many;
    size_t count = 0;
    std::vector<std::string> names = {};
  };
  Kind kinds[] = {
      {NoticeKind::outlier_sample, Subject::Kind::sample, " sample does", " samples do"},
      {NoticeKind::outlier_view, Subject::Kind::view, " view does", " views do"},
      {NoticeKind::outlier_point, Subject::Kind::view, " point does", " points do"}};
  for (const Rejected& r : outliers) {
    Kind& kind = kinds[r.sensor.empty() ? 0 : r.ids.empty() ? 1 : 2];
    kind.count += std::max<size_t>(1, r.ids.size());
    kind.names.push_back("'" + r.sample + "'" + (r.sensor.empty() ? "" : " " + r.sensor));
  }
  for (const Kind& kind : kinds)
    if (kind.count > 0)
      out.push_back(make_notice(kind.kind, subjects(kind.of, kind.names),
                                "a robust fit finds that " + std::to_string(kind.count) +
                                    (kind.count == 1 ? kind.one : kind.many) +
                                    " not belong to the others: " + listed(kind.names, kShown),
                                "", std::string(kLookOrLeaveOut) + " (`reject` does)"));
}

/// Groups that came out much worse than such numbers usually are.
void warn_of_widths(const Report& report, Notices& out) {
  std::vector<WarningItem> wide;
  for (const AutomaticGroup& group : report.automatic)
    if (is_unusual(group))
      wide.push_back({{Subject::Kind::group, group.name},
                      "parameters of group '" + group.name +
                          text("' are off by %.0f times the usual amount", group.widest),
                      group.widest});
  if (!wide.empty()) {
    out.push_back(notice_of(NoticeKind::width, "groups are much worse than usual", std::move(wide),
                            "they may absorb a mistake in the rig or the data",
                            "compare the rig's values of these parameters with the robot, and the "
                            "readings with the robot's display"));
    out.back().otherwise = "and look for the usual mistakes (`check`)";
  }
}

void warn_of_minima(const Restarts& restarts, Notices& out) {
  const std::vector<Minimum>& minima = restarts.minima;
  if (minima.size() < 2 ||
      !(minima[1].cost < minima[0].cost || same_cost(minima[1].cost, minima[0].cost)))
    return;
  const Minimum& m = minima[1];
  Subjects differing;
  for (const auto& d : m.differs) differing.push_back(Subject::parameter(d.first));
  std::string names;
  for (size_t i = 0; i < std::min<size_t>(m.differs.size(), 3); ++i)
    names += (i ? ", " : "") + m.differs[i].first + text(" (%+.3g sigmas)", m.differs[i].second);
  out.push_back(make_notice(
      NoticeKind::minima, std::move(differing),
      std::to_string(m.count) + " of " + std::to_string(restarts.count) + " restarts end in " +
          (same_cost(m.cost, minima[0].cost)
               ? "another minimum with the same cost as this result"
               : text("a better minimum: cost %.8g, this result has %.8g", m.cost,
                      minima[0].cost)) +
          ". Most different: " + names,
      "this result was reached from the rig's own values",
      "give better starting values for these, or record more varied postures"));
}

/// Of a step that did not converge: that, and the first thing that it may come from. Everything
/// else follows from it.
void keep_first_cause(Notices& all) {
  const auto cause = std::find_if(all.begin(), all.end(),
                                  [](const Notice& w) { return can_spoil_the_fit(w.kind); });
  Notices kept = {all.front()};
  if (cause != all.end()) kept.push_back(*cause);
  all = std::move(kept);
}

}  // namespace

Notices warnings(const Report& report) {
  Notices out;
  warn_of_starts(report, out);
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
  warn_of_other_models(report, out);
  warn_of_movements(report.solution, out);
  warn_of_rescaled(report, out);
  warn_of_scales(report, out);
  warn_of_parameters(report, out);
  warn_of_gauges(report, out);
  warn_of_joint_models(report, out);
  if (report.outliers.empty()) {
    warn_of_misfits(NoticeKind::outlier_sample, Subject::Kind::sample, report.misfits.samples, out);
    warn_of_misfits(NoticeKind::outlier_view, Subject::Kind::view, report.misfits.views, out);
  }
  warn_of_rejected(report, out);
  if (!report.no_consensus.empty())
    out.push_back(make_notice(NoticeKind::no_consensus, {}, "`reject`: " + report.no_consensus));
  warn_of_noise(report, out);
  warn_of_widths(report, out);
  warn_of_outliers(report.outliers, out);
  if (report.restarts) warn_of_minima(*report.restarts, out);
  warn_of_held_out(report.validation, out);
  std::stable_sort(out.begin(), out.end(), before);
  if (!out.empty() && out.front().kind == NoticeKind::not_converged) keep_first_cause(out);
  return out;
}

Notices warnings(const Evaluation& evaluation) {
  Notices out;
  if (!evaluation.converged)
    out.push_back(make_notice(NoticeKind::not_converged, {},
                              "the estimation of targets or joint errors did not converge"));
  std::vector<WarningItem> undefined, open;
  for (const std::string& id : evaluation.undefined)
    undefined.push_back({Subject::sample(id),
                         "sample '" + id +
                             "' cannot be evaluated (a point lies behind a camera, wherever its "
                             "target is put): it is missing from these numbers"});
  warn(NoticeKind::undefined, "samples cannot be evaluated", std::move(undefined), "", out);
  const double dof = static_cast<double>(evaluation.dof);
  if (exceeds(evaluation.chi2 / dof, dof)) {
    Notice excess =
        make_notice(NoticeKind::chi2, {}, excess_text(evaluation.chi2 / dof), "", kLookOrState);
    if (evaluation.worst_share > kMostOfIt && evaluation.views.size() > 1) {
      excess.what +=
          text("; %.0f %% of their squares are those of sample '", 100 * evaluation.worst_share) +
          evaluation.worst_sample + "'";
      excess.where.push_back(Subject::sample(evaluation.worst_sample));
    }
    out.push_back(std::move(excess));
  }
  for (const std::string& name : evaluation.open)
    open.push_back(
        {Subject::parameter(name),
         name + " is missing in the rig: it was estimated from the samples of each split"});
  warn(NoticeKind::open_pose, "poses are missing in the rig", std::move(open), "", out);
  std::string useless;
  for (const std::string& pattern : evaluation.without_effect)
    useless += (useless.empty() ? "" : "; ") + ("`free` '" + pattern) +
               "' has no effect: no measurement depends on it";
  if (!useless.empty())
    out.push_back(make_notice(NoticeKind::no_effect,
                              subjects(Subject::Kind::parameter, evaluation.without_effect),
                              std::move(useless)));
  return out;
}

}  // namespace kincal
