#include "plan_table.h"

#include "../../io/document/document.h"
#include "../../io/document/numbers.h"
#include "table.h"

namespace kincal {

std::string plan_table(const std::vector<StepPlan>& plans, const ParameterTable& table) {
  std::string out;
  for (const StepPlan& p : plans) {
    int shared = 0;
    for (const Freed& f : p.free) shared += static_cast<int>(f.components.size());
    out +=
        text("step %s: %d shared parameters free, %d samples\n", p.name.c_str(), shared, p.samples);
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

std::string staging_plan(
    const std::vector<std::pair<std::string, std::vector<std::string>>>& groups) {
  std::string out =
      "The rig has no `estimate`: calibrate stages it automatically. Groups in the order in which "
      "they are tried; what the\n"
      "data do not determine is held, and a group is kept only if it lowers the error on samples "
      "that were left out of the fit:\n";
  for (const auto& group : groups) {
    out += "  " + group.first + "\n";
    for (const std::string& name : group.second) out += "    " + name + "\n";
  }
  return out;
}

std::string staging_table(const std::vector<StagingTrial>& trials) {
  std::vector<std::vector<std::string>> rows = {{"group", "", "error without", "with", "numbers"}};
  for (const StagingTrial& t : trials)
    rows.push_back(
        {t.group,
         std::string(t.removal ? "again: " : "") + (t.parameters.empty()  ? "not determined"
                                                    : t.group == "mounts" ? "kept (always)"
                                                    : t.kept              ? "kept"
                                                             : "not kept (no clear gain)"),
         value(t.error_before), value(t.error_after), std::to_string(t.numbers)});
  return align(rows, 2);
}

}  // namespace kincal
