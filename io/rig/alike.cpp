#include "alike.h"

#include <set>

#include "../../models/fitting/numbering.h"

namespace kincal {

std::vector<int> turns_alike(const GridLayout& grid, bool large_origin) {
  const bool square = grid.rows == grid.columns;
  if (grid.kind == GridLayout::Kind::corners) {  // the outer squares of both ends may differ
    if (square && grid.rows % 2 == 0) return {0, 1, 2, 3};
    return square || (grid.rows + grid.columns) % 2 == 0 ? std::vector<int>{0, 2}
                                                         : std::vector<int>{0};
  }
  if (grid.kind != GridLayout::Kind::circles || large_origin) return {0};
  if (grid.asymmetric) return grid.rows % 2 == 0 ? std::vector<int>{0, 2} : std::vector<int>{0};
  return square ? std::vector<int>{0, 1, 2, 3} : std::vector<int>{0, 2};
}

std::map<int, std::vector<int>> alike_targets(const RigFile& rig) {
  std::map<int, std::vector<int>> out;
  const std::string& path = rig.path;
  for (size_t t = 0; t < rig.rig.targets.size(); ++t) {
    const Target& target = rig.rig.targets[t];
    const bool circles = target.type == "circles";
    if (!circles && target.type != "chessboard") continue;
    const Field field = top(rig.node, path)["targets"][target.name];
    GridLayout grid;
    grid.kind = circles ? GridLayout::Kind::circles : GridLayout::Kind::corners;
    grid.rows = field["rows"].integer(1, 10000);
    grid.columns = field["columns"].integer(1, 10000);
    grid.asymmetric = circles && field.has("asymmetric") && field["asymmetric"].boolean();
    const std::vector<int> turns = turns_alike(grid, field.has("origin"));
    if (turns.size() > 1) out[static_cast<int>(t)] = turns;
  }
  return out;
}

std::vector<std::pair<int, int>> undecided_numbers(const RigFile& rig,
                                                   const std::vector<Sample>& samples) {
  const std::map<int, std::vector<int>> alike = alike_targets(rig);
  std::vector<std::pair<int, int>> out;
  if (alike.empty()) return out;
  std::set<std::pair<int, int>> decided;  // of fewer than three views of a camera none is
  for (const ViewTurn& one : agreeing_numbers(rig.rig, samples, alike, {}))
    if (one.decided) decided.emplace(one.sample, one.view);
  const auto kind = [&](const View& view) {
    return rig.rig.sensors[view.sensor].model->measurement_kind();
  };
  for (size_t s = 0; s < samples.size(); ++s) {
    std::set<int> held;
    for (const View& view : samples[s].views)
      if (kind(view) == MeasurementKind::chain) held.insert(view.target);
    for (size_t v = 0; v < samples[s].views.size(); ++v) {
      const View& view = samples[s].views[v];
      const std::pair<int, int> at(static_cast<int>(s), static_cast<int>(v));
      if (alike.count(view.target) && kind(view) == MeasurementKind::rays && !decided.count(at) &&
          (rig.rig.targets[view.target].link >= 0 || held.count(view.target)))
        out.push_back(at);
    }
  }
  return out;
}

}  // namespace kincal
