#include "plan_table.h"

#include <algorithm>
#include <cmath>

#include "../../io/document/document.h"
#include "../../io/document/numbers.h"
#include "table.h"

namespace kincal {

std::string plan_table(const std::vector<StepPlan>& plans, const ParameterTable& table) {
  std::string out;
  for (const StepPlan& p : plans) {
    int shared = 0;
    for (const Freed& f : p.free) shared += static_cast<int>(f.components.size());
    out += text("step %s: %d shared components estimated, %d samples\n", p.name.c_str(), shared,
                p.samples);
    out += text(
        "  %ld residuals, joint-error and prior terms - %ld unknowns (%d shared, %ld in the "
        "samples) = %ld degrees of freedom\n",
        p.rows, p.unknowns, shared, p.unknowns - shared, p.rows - p.unknowns);
    for (const Freed& f : p.free) {
      const Parameter& parameter = table.all[f.parameter];
      std::string components;
      if (!f.whole(parameter))
        for (int c : f.components)
          components += (components.empty() ? "." : " .") + parameter.components[c];
      std::string priors;
      for (const Prior& prior : p.priors)
        if (prior.parameter == f.parameter)
          priors += (priors.empty() ? "  prior sigma " : ", ") + shortest(prior.sigma);
      out += "    " + parameter.name + (components.empty() ? "" : " " + components) + priors + "\n";
    }
    for (const std::string& n : p.unused)
      out += "    unused (no measurement of this step depends on it): " + n + "\n";
    for (const std::string& n : p.held_out)
      out += "    held out (only held-out samples see it): " + n + "\n";
    for (const std::string& n : p.without_effect) out += "    warning: " + n + "\n";
  }
  return out;
}

namespace {

/// A number in the unit that people read: mm, mrad, px, %.
std::string readable(double v, const std::string& unit) {
  if (unit == "m") return text("%.3g mm", v * 1e3);
  if (unit == "rad") return text("%.3g mrad", v * 1e3);
  if (unit == "px") return text("%.3g px", v);
  return text("%.3g", v);
}

}  // namespace

std::string automatic_plan(const AutomaticGroups& groups, const ParameterTable& table) {
  std::string out =
      "The rig has no `estimate`: everything below is estimated. The mounts are determined by the "
      "data alone; each group has a prior\n"
      "whose width is learned from the data, starting from the width shown:\n"
      "  mounts\n";
  for (const Freed& f : groups.mounts) out += "    " + table.all[f.parameter].name + "\n";
  for (const WidthGroup& g : groups.groups) {
    out += "  " + g.name + "\n";
    for (const Member& m : g.members)
      out += "    " + table.name(m.component) + "  " + readable(m.start, table.unit(m.component)) +
             "\n";
    for (const Member& m : g.unseen)
      out += "    " + table.name(m.component) +
             "  no measurement depends on it: its sigma comes from its group alone\n";
  }
  return out;
}

std::string automatic_table(const std::vector<AutomaticGroup>& groups) {
  std::vector<std::vector<std::string>> rows = {
      {"group", "", "components", "determined", "width found", "evidence"}};
  for (const AutomaticGroup& g : groups)
    if (!g.numbers.empty())
      rows.push_back({g.name, g.held ? "nominal" : "estimated", std::to_string(g.numbers.size()),
                      text("%.1f", g.gamma), readable(g.numbers[0].width, g.numbers[0].unit),
                      text("%.1f", g.gain)});
  return align(rows, 2);
}

std::string dropped_text(const std::vector<TriedGroup>& tried) {
  std::string out;
  for (const TriedGroup& one : tried) {
    const char* why = one.outcome == TriedGroup::Outcome::no_better_held_out
                          ? "no better on held-out samples"
                      : one.outcome == TriedGroup::Outcome::too_few_samples ? "too few samples"
                                                                            : "no evidence";
    if (one.outcome != TriedGroup::Outcome::kept)
      out += (out.empty() ? "" : ", ") + one.name + " (" + why + ")";
  }
  return out.empty() ? "" : "  tried and dropped: " + out + "\n";
}

}  // namespace kincal
