#include "batch_table.h"

#include <algorithm>
#include <cmath>

#include "table.h"

namespace kincal {

std::string batch_table(const std::vector<SetSummary>& sets, size_t ignored) {
  std::string out = text("%zu %s", sets.size(), sets.size() == 1 ? "set" : "sets");
  for (const char* status :
       {"converged", "unobservable", "not_converged", "unexplained", "failed"}) {
    const auto n = std::count_if(sets.begin(), sets.end(),
                                 [&](const SetSummary& s) { return s.status == status; });
    if (n > 0) out += text(", %ld %s", static_cast<long>(n), status);
  }
  if (ignored > 0)
    out += text("; %zu other %s with neither rig.yaml nor samples.jsonl", ignored,
                ignored == 1 ? "folder" : "folders");
  out += "\n";

  // One line a quantity, in the order in which the sets name them: the middle one and the worst,
  // and whose that is.
  struct Quantity {
    std::string name;
    Unit unit;
    std::vector<std::pair<double, std::string>> values;
  };
  std::vector<Quantity> quantities;
  const auto add = [&](const std::string& name, const std::string& unit, double v,
                       const std::string& set) {
    if (!std::isfinite(v)) return;
    const Unit u = shown(unit);
    auto found = std::find_if(quantities.begin(), quantities.end(), [&](const Quantity& q) {
      return q.name == name && q.unit.name == u.name;
    });
    if (found == quantities.end()) found = quantities.insert(found, {name, u, {}});
    found->values.push_back({v, set});
  };
  for (const SetSummary& s : sets)
    if (s.status != "failed") add("chi2/dof", "", s.chi2_per_dof(), s.name);
  for (const SetSummary& s : sets)
    for (const SensorRms& r : s.sensors) {
      add("rms " + r.name, r.unit, r.train, s.name);
      add("rms " + r.name + ", held out", r.unit, r.test, s.name);
    }
  if (!quantities.empty()) {
    std::vector<std::vector<std::string>> rows = {{"", "unit", "median", "worst", ""}};
    for (Quantity& q : quantities) {
      std::stable_sort(q.values.begin(), q.values.end(),
                       [](const auto& x, const auto& y) { return x.first < y.first; });
      const auto& worst = q.values.back();
      const double median =
          (q.values[(q.values.size() - 1) / 2].first + q.values[q.values.size() / 2].first) / 2;
      rows.push_back({q.name, q.unit.name, value(median, q.unit.factor),
                      value(worst.first, q.unit.factor), worst.second});
    }
    out += align(rows, 2);
  }
  std::vector<std::vector<std::string>> failing;
  for (const SetSummary& s : sets)
    if (s.fails()) failing.push_back({s.name, s.status, s.error});
  if (!failing.empty()) out += "\nNot converged, or not to be relied on\n" + align(failing, 3);
  return out;
}

}  // namespace kincal
