#include "batch_table.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../../kinematics/transform.h"
#include "table.h"

namespace kincal {
namespace {

constexpr double kBeyond = 4;  // sigmas, of the largest of many differences

/// A component of a parameter in all sets that determine it; of a pose in the frame that the first
/// of them found, so that its sigmas belong to it.
struct AcrossSets {
  struct Value {
    std::string set;
    double value, sigma;
  };
  std::string unit;
  std::vector<Value> values;
};

std::map<std::string, AcrossSets> across_sets(const std::vector<SetSummary>& sets) {
  std::map<std::string, AcrossSets> out;
  std::map<std::string, Pose> first;  // by the name of the pose
  for (const SetSummary& set : sets) {
    if (set.status != "converged" && set.status != "unobservable") continue;
    std::map<std::string, double> in_poses;  // values of their components
    for (const AbsolutePose& p : set.poses) {
      const Pose pose{rotation_from_rpy(p.rpy), p.xyz};
      const Pose e = inverse(first.emplace(p.name, pose).first->second) * pose;
      const Vector3d turned = log_so3(e.rotation);
      const char* names[] = {".x", ".y", ".z", ".rx", ".ry", ".rz"};
      for (int c = 0; c < 6; ++c)
        in_poses[p.name + names[c]] = c < 3 ? e.translation(c) : turned(c - 3);
    }
    for (const Change& c : set.changes) {
      if (!std::isfinite(c.sigma)) continue;
      const auto in_pose = in_poses.find(c.name);
      AcrossSets& all = out[c.name];
      all.unit = c.unit;
      all.values.push_back(
          {set.name, in_pose == in_poses.end() ? c.value : in_pose->second, c.sigma});
    }
  }
  return out;
}

/// A sentence about what differs most between two sets, in sigmas; "" where nothing is beyond them.
/// For each number its smallest and its largest value stand for all pairs.
std::string largest_move(const std::vector<SetSummary>& sets) {
  double most = kBeyond;
  std::string out;
  for (const auto& [name, all] : across_sets(sets)) {
    const auto [low, high] =
        std::minmax_element(all.values.begin(), all.values.end(),
                            [](const auto& x, const auto& y) { return x.value < y.value; });
    const double moved = high->value - low->value, sigma = std::hypot(low->sigma, high->sigma);
    if (!(moved > most * sigma)) continue;
    most = moved / sigma;
    const Unit unit = shown(all.unit);
    out = "\nMost different between two sets: " + name + ", by " + value(moved, unit.factor) + " " +
          unit.name + " (± " + text("%.2g", sigma * unit.factor) + ") between " +
          std::min(low->set, high->set) + " and " + std::max(low->set, high->set) +
          ". If they are of one robot, this moved; summary.csv has all sets\n";
  }
  return out;
}

}  // namespace

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
  out += largest_move(sets);
  std::vector<std::vector<std::string>> failing, doubtful;
  for (const SetSummary& s : sets)
    if (s.fails())
      failing.push_back({s.name, s.status, s.error});
    else if (s.verdict == "doubts")
      doubtful.push_back({s.name, s.error});
  if (!doubtful.empty()) out += "\nWith doubts\n" + align(doubtful, 2);
  if (!failing.empty()) out += "\nNot converged, or not to be relied on\n" + align(failing, 3);
  return out;
}

}  // namespace kincal
