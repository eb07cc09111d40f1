#include "parameter_warnings.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../rig/numbers.h"
#include "cases.h"
#include "free_zeros.h"

namespace kincal {
namespace {

/// "0.0114 m" or "1.2 degrees"; "" of other units, and of what is known well.
std::string loose_text(const std::string& unit, double sigma) {
  if (!(sigma > loose_from(unit))) return "";
  return unit == "m" ? text("%.3g m", sigma) : angle_text(sigma);
}

/// Whether an earlier step freed a number of which its prior alone tells, and the last one holds
/// it: what it may be stands in the poses that this estimates beside it.
bool is_held_at_its_prior(const Solution& solution, const ParameterEstimate& e, size_t c) {
  return !solution.steps.empty() && e.step != solution.steps.back().name &&
         e.sigma[c] > 0.95 * e.prior[c] && e.prior[c] > 0;
}

/// Warns of poses that are known no better than the zero of the first or last joint.
void warn_of_zero(const FreeZero& zero, std::vector<Case> poses, Warnings& out) {
  if (poses.empty()) return;
  std::stable_sort(poses.begin(), poses.end(),
                   [](const Case& a, const Case& b) { return a.size > b.size; });
  const Warning of_base{"base_frame", "", {}};
  const Warning of_last{"last_zero", "", {}};
  Warning warning = zero.at_base ? of_base : of_last;
  std::vector<std::string> words;
  for (const Case& c : poses) {
    warning.names.push_back(c.name);
    words.push_back(c.name + " (" + c.text + ")");
  }
  const bool one = zero.numbers.size() == 1;
  const std::string number = one ? (zero.is_zero ? "the zero of joint '" : "the place of joint '") +
                                       zero.joint + "' (" + zero.numbers[0] + ")"
                                 : "numbers of the joints (" + listed(zero.numbers, kNamed) + ")";
  const char* same = one ? "one number" : "the same numbers";
  const std::string poses_are = listed(words, kNamed) + (poses.size() > 1 ? " are" : " is");
  warning.text =
      zero.at_base
          ? poses_are + " known no better than where the base frame is: that and " + number +
                " are " + same +
                ", the base frame's own choice. No posture tells it, nothing that is measured "
                "depends on it, and it does no harm. Hold "
          : poses_are + " known no better than " + number + (one ? ", the last one" : "") +
                ": they are " + same +
                ". No posture tells it, and nothing that is measured depends on it; a tool that "
                "sits there is where the rig says only up to this. Hold ";
  warning.text += listed(zero.numbers, kNamed) + " (`fix`) to take the rig's value" +
                  (one ? "" : "s") + " for " + (one ? "it" : "them");
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

void warn_of_movements(const Solution& solution, Warnings& out) {
  std::vector<std::string> explained = solution.identity_starts;  // elsewhere
  for (const ReplacedStart& start : solution.replaced_starts) explained.push_back(start.name);
  if (solution.status == Status::converged)
    explained.insert(explained.end(), solution.computed_starts.begin(),
                     solution.computed_starts.end());
  std::vector<Case> poses;
  for (const ParameterEstimate& e : solution.parameters) {
    if (!e.pose || std::find(explained.begin(), explained.end(), e.name) != explained.end())
      continue;
    const double moved = std::hypot(e.value[0], e.value[1], e.value[2]) / 0.1,
                 turned = std::hypot(e.value[3], e.value[4], e.value[5]) / (10 * kPi / 180);
    if (!(moved > 1) && !(turned > 1)) continue;
    const std::string by_metres = moved > 1 ? text(" moved by %.3g m", 0.1 * moved) : "",
                      by_degrees = turned > 1 ? text(" turned by %.3g degrees", 10 * turned) : "";
    poses.push_back({e.name,
                     e.name + by_metres + (moved > 1 && turned > 1 ? " and" : "") + by_degrees +
                         " from its initial value",
                     std::max(moved, turned)});
  }
  if (poses.empty()) return;
  warn("moved", "poses moved by more than 0.1 m or 10 degrees", std::move(poses), out);
  out.back().text +=
      ". What to do: look whether the robot is like that, and correct the pose in the rig; else "
      "its "
      "link or what it sees is another, or it takes up another mistake";
}

void warn_of_parameters(const Report& report, Warnings& out) {
  const std::string kDo = ". What to do: ";
  std::vector<Case> priors, sigmas;
  std::map<std::string, std::string> cures;  // by component
  const Untold& unknown = untold(report);
  std::map<const FreeZero*, std::vector<Case>> chosen;
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; c < e.value.size(); ++c) {
      const std::string name = e.component_name(c);
      const double from_prior = e.prior[c] > 0 ? (e.value[c] - e.initial[c]) / e.prior[c] : 0;
      if (std::abs(from_prior) > 3)
        priors.push_back({name, prior_text(report, name, from_prior), std::abs(from_prior)});
      const std::string known = loose_text(e.units[c], e.sigma[c]);
      if (known.empty()) continue;
      const double yardstick = loose_from(e.units[c]);
      const JudgedSigma judged = judged_sigma(unknown, e, c);
      if (is_held_at_its_prior(report.solution, e, c)) continue;
      if (loose_text(e.units[c], judged.sigma).empty())
        chosen[judged.zero].push_back({name, known, e.sigma[c] / yardstick});
      else
        sigmas.push_back(
            {name, name + " is known to " + known + " only (one sigma)", e.sigma[c] / yardstick});
      const std::string height = height_to_hold(report, e, c);
      cures[name] = !height.empty()        ? kDo + hold_words(height)
                    : !judged.size.empty() ? ", for the data do not tell " + judged.size + kDo +
                                                 measure_words(judged.size)
                                           : kDo + "record more varied postures";
    }
  warn("prior",
       report.automatic.empty() ? "parameters are more than 3 prior sigmas from their priors"
                                : "parameters are off by more than 3 times what is usual here",
       std::move(priors), out);
  if (!out.empty() && out.back().id == "prior")
    out.back().text +=
        report.automatic.empty()
            ? kDo + "see which of the two is wrong, the prior or the data"
            : kDo +
                  "compare this number with the robot; if it is right, look for another "
                  "mistake that it takes up";
  if (!sigmas.empty()) {
    warn("sigma", "parameters are known to no better than 1 cm or 1 degree", std::move(sigmas),
         out);
    out.back().text += cures[out.back().names[0]];
  }
  for (const FreeZero& zero : unknown.zeros) warn_of_zero(zero, std::move(chosen[&zero]), out);
}

}  // namespace kincal
