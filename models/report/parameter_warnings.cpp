#include "parameter_warnings.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "../analysis/hand_eye.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/words.h"
#include "gauge_freedoms.h"
#include "warning_items.h"

namespace kincal {
namespace {

/// "0.0114 m" or "1.2 degrees"; "" of other units, and of what is known well.
std::string loose_text(const std::string& unit, double sigma) {
  if (!(sigma > pose_scales(unit).yardstick)) return "";
  return unit == "m" ? text("%.3g m", sigma) : angle_text(sigma);
}

/// Whether an earlier step freed a number of which its prior alone tells, and the last one holds
/// it: what it may be stands in the poses that this estimates beside it.
bool is_held_at_its_prior(const Solution& solution, const ParameterEstimate& e, size_t c) {
  return !solution.steps.empty() && e.step != solution.steps.back().name &&
         e.sigma[c] > 0.95 * e.prior[c] && e.prior[c] > 0;
}

/// Warns of poses that are known no better than the zero of the first or last joint.
void warn_of_zero(const ZeroGauge& zero, std::vector<WarningItem> poses, Notices& out) {
  if (poses.empty()) return;
  std::stable_sort(poses.begin(), poses.end(),
                   [](const WarningItem& a, const WarningItem& b) { return a.size > b.size; });
  Notice warning =
      make_notice(zero.at_base ? NoticeKind::base_frame : NoticeKind::last_zero, {}, "");
  std::vector<std::string> words;
  for (const WarningItem& c : poses) {
    warning.where.push_back(c.what);
    words.push_back(c.what.name + " (" + c.text + ")");
  }
  const bool one = zero.numbers.size() == 1;
  const std::string number =
      one ? (zero.is_zero ? "the zero of joint '" : "the place of joint '") + zero.joint + "' (" +
                zero.numbers[0] + ")"
          : "parameters of the joints (" + listed(zero.numbers, kNamed) + ")";
  const std::string poses_are = listed(words, kNamed) + (poses.size() > 1 ? " are" : " is");
  warning.what =
      zero.at_base
          ? poses_are +
                " determined no better than the base frame, which is a free choice: moving "
                "it has the same effect as changing " +
                number
          : poses_are + " determined no better than " + number +
                (one ? ", the last one: changing it" : ": changing them") + " has the same effect";
  warning.why = zero.at_base
                    ? "no posture determines it, no measurement depends on it, and it does no harm"
                    : "no posture determines it, and no measurement depends on it; the position of "
                      "a tool there has this uncertainty";
  warning.cure = "to take the rig's value" + std::string(one ? "" : "s") + " for " +
                 (one ? "it" : "them") + ", fix " + listed(zero.numbers, kNamed) + " (`fix`)";
  out.push_back(std::move(warning));
}

/// How far a number is from where its prior has it: the rig's own, or the width of its group.
std::string prior_text(const Report& report, const std::string& name, double from_prior) {
  for (const AutomaticGroup& group : report.automatic)
    for (const AutomaticNumber& n : group.numbers)
      if (n.name == name)
        return name + " is off by " + shown_text(n.value, n.unit) +
               text(", %.1f times as much as its group '", std::abs(from_prior)) + group.name +
               "' usually is here (" + shown_text(n.width, n.unit) + ")";
  return name + text(" is %.1f prior sigmas from its prior", from_prior);
}

}  // namespace

void warn_of_movements(const Solution& solution, Notices& out) {
  std::vector<std::string> explained = solution.identity_starts;  // elsewhere
  for (const ReplacedStart& start : solution.replaced_starts) explained.push_back(start.name);
  if (solution.status == Status::converged)
    explained.insert(explained.end(), solution.computed_starts.begin(),
                     solution.computed_starts.end());
  std::vector<WarningItem> poses;
  for (const ParameterEstimate& e : solution.parameters) {
    if (!e.pose || std::find(explained.begin(), explained.end(), e.name) != explained.end())
      continue;
    const double shift = std::hypot(e.value[0], e.value[1], e.value[2]),
                 turn = std::hypot(e.value[3], e.value[4], e.value[5]),
                 moved = shift / pose_scales("m").reported,
                 turned = turn / pose_scales("rad").reported;
    if (!(moved > 1) && !(turned > 1)) continue;
    const std::string by_metres = moved > 1 ? text(" moved by %.3g m", shift) : "",
                      by_degrees =
                          turned > 1 ? text(" turned by %.3g degrees", turn * 180 / kPi) : "";
    poses.push_back({Subject::parameter(e.name),
                     e.name + by_metres + (moved > 1 && turned > 1 ? " and" : "") + by_degrees +
                         " from its initial value",
                     std::max(moved, turned)});
  }
  warn(NoticeKind::moved, "poses moved by more than 0.1 m or 10 degrees", std::move(poses),
       "check the pose on the robot and correct it in the rig; otherwise its link or its target is "
       "wrong, or it absorbs another mistake",
       out);
}

void warn_of_gauges(const Report& report, Notices& out) {
  const ParameterTable& table = report.solution.table();
  std::vector<std::string> fixed;
  std::vector<WarningItem> cases;
  for (const Gauge& gauge : report.gauges) {
    std::vector<std::string> with;
    for (const Component& c : gauge.with) with.push_back(table.name(c));
    fixed.push_back(table.name(gauge.fixed));
    cases.push_back({Subject::parameter(fixed.back()),
                     (with.empty() ? fixed.back() + " changes no measurement"
                                   : fixed.back() + " cannot be distinguished from " +
                                         listed(with, kNamed) + " in any posture") +
                         (gauge.given ? ": it is fixed as the rig gives it"
                                      : ": it is fixed at its starting value")});
  }
  warn(NoticeKind::gauge, "parameters are free choices", std::move(cases),
       "no measurement depends on the choice; if you need the absolute position of the others, "
       "measure " +
           listed(fixed, kNamed) + " and write the pose into the rig",
       out);
}

namespace {

/// Whether one of the parameters so far from their priors is more than the worst of so many by
/// chance: of a prior that the user stated each is, of the parameters of groups one in a hundred
/// calibrations would have such a one.
bool prior_is_doubtful(const Report& report) {
  constexpr double kRarely = 0.01, kSigmas = 3;
  if (report.automatic.empty() || !told_models(report.other_models, NoticeKind::prior).empty())
    return true;
  std::set<std::string> grouped;
  double told = 0, worst = 0;
  for (const AutomaticGroup& g : report.automatic) {
    if (!g.held) told += g.gamma;
    for (const AutomaticNumber& n : g.numbers) {
      grouped.insert(n.name);
      if (!n.held && n.width > 0) worst = std::max(worst, std::abs(n.value) / n.width);
    }
  }
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; c < e.value.size(); ++c)
      if (e.prior[c] > 0 && std::abs(e.value[c] - e.initial[c]) > kSigmas * e.prior[c] &&
          !grouped.count(e.component_name(c)))
        return true;
  return told * 2 * normal_tail(worst) < kRarely;
}

/// The pose component that is known worst, and how many times as badly as a mount may be.
struct LooseComponent {
  const ParameterEstimate* pose = nullptr;
  size_t component = 0;
  double times = 1;
  std::string size = "";  // of a target, that would have to be known

  Scales scales() const { return pose_scales(pose->units[component]); }
};

LooseComponent loosest(const Report& report) {
  LooseComponent out;
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; e.pose && c < e.sigma.size(); ++c) {
      const JudgedSigma judged = judged_sigma(gauge_freedoms(report), e, c);
      const double times = judged.sigma / pose_scales(e.units[c]).loose;
      if (times > out.times) out = {&e, c, times, judged.size};
    }
  return out;
}

/// Says why the worst of these is known so badly, and what to do.
/// `sizes` would have to be known.
void explain_loose(const Report& report, const ParameterEstimate& e,
                   const std::vector<std::string>& sizes, Notice& out) {
  const MotionLack lack =
      out.severity == Severity::fault ? motion_lack(*report.solution.recording) : MotionLack();
  if (!sizes.empty()) {
    out.why = "the data do not determine " + listed(sizes);
    out.cure = measure_words(sizes);
  } else if (!lack.why.empty()) {
    out.why = lack.why;
    out.cure = lack.cure;
    out.otherwise = lack.otherwise;
  } else {
    out.cure = "record more varied postures" +
               (out.severity == Severity::fault ? ", or give " + e.name + " a prior" : "");
  }
}

}  // namespace

bool has_open_mount(const Report& report) {
  const LooseComponent loose = loosest(report);
  return loose.pose && loose.times * loose.scales().loose > loose.scales().open;
}

bool hangs_on_a_size(const Report& report) { return !loosest(report).size.empty(); }

std::optional<Notice> loose_parameters(const Report& report) {
  LooseComponent worst;
  double largest = 0;
  std::vector<WarningItem> sigmas;
  std::set<std::string> sizes;
  const GaugeFreedoms& unknown = gauge_freedoms(report);
  const LooseComponent loose = loosest(report);
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; c < e.value.size(); ++c) {
      const std::string known = loose_text(e.units[c], e.sigma[c]);
      const JudgedSigma judged = judged_sigma(unknown, e, c);
      const bool first = &e == loose.pose && c == loose.component;  // of all: it is unfit for use
      if (!first && (known.empty() || loose_text(e.units[c], judged.sigma).empty() ||
                     is_held_at_its_prior(report.solution, e, c)))
        continue;
      const double size = first ? kInfinity : e.sigma[c] / pose_scales(e.units[c]).yardstick;
      const std::string name = e.component_name(c);
      sigmas.push_back(
          {Subject::parameter(name), name + " is known to " + known + " only (one sigma)", size});
      if (!judged.size.empty()) sizes.insert(judged.size);
      if (size > largest) largest = size, worst = {&e, c, 1, judged.size};
    }
  if (sigmas.empty()) return std::nullopt;
  Notice out =
      notice_of(NoticeKind::sigma, "parameters are known to no better than 1 cm or 1 degree",
                std::move(sigmas));
  if (loose.pose) out.severity = Severity::fault;
  if (worst.size.empty()) sizes.clear();
  explain_loose(report, *worst.pose, {sizes.begin(), sizes.end()}, out);
  return out;
}

void warn_of_parameters(const Report& report, Notices& out) {
  const bool automatic = !report.automatic.empty();
  std::vector<WarningItem> priors;
  const GaugeFreedoms& unknown = gauge_freedoms(report);
  std::map<const ZeroGauge*, std::vector<WarningItem>> chosen;
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; c < e.value.size(); ++c) {
      const std::string name = e.component_name(c);
      const double from_prior = e.prior[c] > 0 ? (e.value[c] - e.initial[c]) / e.prior[c] : 0;
      if (std::abs(from_prior) > 3)
        priors.push_back(
            {Subject::parameter(name), prior_text(report, name, from_prior), std::abs(from_prior)});
      const std::string known = loose_text(e.units[c], e.sigma[c]);
      if (known.empty() || is_held_at_its_prior(report.solution, e, c)) continue;
      const JudgedSigma judged = judged_sigma(unknown, e, c);
      if (loose_text(e.units[c], judged.sigma).empty())
        chosen[judged.zero].push_back(
            {Subject::parameter(name), known, e.sigma[c] / pose_scales(e.units[c]).yardstick});
    }
  if (!priors.empty()) {
    out.push_back(notice_of(NoticeKind::prior,
                            automatic
                                ? "parameters are off by more than 3 times the usual amount here"
                                : "parameters are more than 3 prior sigmas from their priors",
                            std::move(priors), "",
                            automatic ? "compare this parameter with the robot; if it is right, "
                                        "look for another mistake that it absorbs (`check`)"
                                      : "check which of the two is wrong, the prior or the data"));
    if (!prior_is_doubtful(report)) out.back().severity = Severity::remark;
  }
  if (std::optional<Notice> loose = loose_parameters(report)) out.push_back(std::move(*loose));
  for (const ZeroGauge& zero : unknown.zeros) warn_of_zero(zero, std::move(chosen[&zero]), out);
}

}  // namespace kincal
