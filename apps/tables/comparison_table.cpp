#include "comparison_table.h"

#include <algorithm>
#include <cmath>

#include "table.h"

namespace kincal {
namespace {

constexpr double kRounding = 1e-11;  // of what was written

}  // namespace

std::string errors_text(const CalibratedFiles& b, const Comparison& comparison) {
  std::string out;
  for (const bool estimated : {true, false})
    if (const ErrorsInSigmas e = errors_in_sigmas(b, comparison, estimated); e.components > 0)
      out += text("  rms %.2f, largest %.2f, of %d components %s\n", e.rms, e.worst, e.components,
                  estimated ? "that were estimated" : "kept at nominal values");
  std::vector<std::string> exact;  // wholly: of others the table has the components
  for (const ParameterDifference& d : comparison.parameters) {
    bool off = false;
    for (size_t c = 0; c < d.difference.size(); ++c)
      off = off || (std::isnan(d.sigma[c]) && std::abs(d.difference[c]) > kRounding);
    if (off && !b.sigma.count(d.name)) exact.push_back(d.name);
  }
  if (!exact.empty())
    out += wrapped("not estimated, but not true: " + listed(exact) +
                       ". Other parameters with the same effect, such as the mount behind a joint, "
                       "absorb these errors: compare the frames",
                   "  ", 4);
  return out.empty() ? "" : "\nError / sigma (1 is expected)\n" + out;
}

std::string comparison_table(const Comparison& comparison, size_t most) {
  std::vector<WeightedRow> lines;
  bool poses = false;
  for (const ParameterDifference& d : comparison.parameters)
    for (size_t c = 0; c < d.difference.size(); ++c) {
      if (std::abs(d.difference[c]) < kRounding * std::max(1.0, std::abs(d.a[c]))) continue;
      const Unit unit = shown(d.units[c]);
      const double sigmas = std::abs(d.difference[c]) / d.sigma[c];
      const auto cell = [&](double value) {  // a pose's own numbers do not subtract
        return d.pose ? std::string("-") : text("%.7g", value * unit.factor + 0.0);
      };
      poses = poses || d.pose;
      // Without a sigma by size, behind the others.
      const double weight =
          std::isfinite(sigmas) ? sigmas + 1e9 : weight_of(d.difference[c], d.units[c]);
      lines.push_back({weight,
                       {component_name(d.name, d.components[c]), unit.name, cell(d.a[c]),
                        cell(d.b[c]), text("%+.4g", d.difference[c] * unit.factor),
                        std::isfinite(d.sigma[c]) ? "± " + text("%.2g", d.sigma[c] * unit.factor)
                        : d.undetermined[c]       ? "not determined"
                                                  : "-",
                        std::isfinite(sigmas) ? text("%.2f", sigmas) : "-"}});
    }
  sort_by_weight(lines);
  std::vector<std::vector<std::string>> rows = {
      {"parameter", "unit", comparison.errors ? "true" : "A", comparison.errors ? "estimated" : "B",
       comparison.errors ? "error" : "difference", "sigma", "in sigmas"}};
  for (size_t i = 0; i < lines.size() && i < most; ++i) rows.push_back(lines[i].cells);
  std::string out =
      comparison.errors ? "Errors of the parameters\n" : "Parameters that differ most\n";
  if (poses)
    out += std::string("  Poses and origins: translation and rotation of ") +
           (comparison.errors ? "the estimated frame relative to the true one, along and about its"
                              : "B's frame relative to A's, along and about A's") +
           " axes;\n  --json has xyz and rpy of both, which cannot be subtracted.\n";
  out += lines.empty() ? "  none\n" : align(rows, 2);
  if (lines.size() > most) out += text("  ... and %zu more with --json\n", lines.size() - most);
  if (!comparison.frames.empty()) {
    out += "\nFrames relative to " + comparison.base + " over postures" +
           (comparison.workspace == "limits" ? ", random within the joints' limits\n"
                                             : " of the samples\n");
    rows = {{"frame", "unit", "postures", "rms", "worst", "sigma", "in sigmas"}};
    for (const FrameDifference& f : comparison.frames)
      for (bool rotation : {false, true}) {
        const double rms = rotation ? f.rotation_rms : f.position_rms,
                     worst = rotation ? f.rotation_worst : f.position_worst;
        const double sigma = rotation ? f.rotation_sigma : f.position_sigma;
        const std::string none = comparison.sigmas && f.postures > 0 ? "not determined" : "-";
        rows.push_back({rotation ? "" : f.frame, rotation ? "mrad" : "mm",
                        rotation ? "" : std::to_string(f.postures), value(rms, 1e3),
                        value(worst, 1e3), std::isfinite(sigma) ? "± " + value(sigma, 1e3) : none,
                        value(rms / sigma)});
      }
    out += align(rows, 2);
  }
  const std::pair<const char*, const std::vector<std::string>*> only[] = {
      {"A", &comparison.only_in_a}, {"B", &comparison.only_in_b}};
  for (const auto& side : only)
    for (const std::string& name : *side.second)
      out += std::string("  only in ") + side.first + ": " + name + "\n";
  const std::pair<const char*, const std::vector<std::string>*> open[] = {
      {"A", &comparison.open_in_a}, {"B", &comparison.open_in_b}};
  for (const auto& side : open)
    for (const std::string& name : *side.second)
      out += std::string("  not compared: ") + side.first + " leaves " + name + " open\n";
  for (const std::string& note : comparison.notes) out += "  note: " + note + "\n";
  return out;
}

}  // namespace kincal
