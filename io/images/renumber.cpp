#include "renumber.h"

#include <algorithm>

#include "../../models/fitting/numbering.h"
#include "../../models/rig/targets.h"
#include "../document/error.h"
#include "../rig/alike.h"
#include "../rig/samples_file.h"

namespace kincal {
namespace {

using Json = nlohmann::ordered_json;

/// The points of a view under their new numbers, in ascending order.
void renumber_view(const Target& target, int quarters, Json& view) {
  static const int cosines[] = {1, 0, -1, 0};
  const int c = cosines[quarters], s = cosines[(quarters + 3) % 4];
  Eigen::Matrix2d turn;
  turn << c, -s, s, c;
  const std::vector<int> places = relabeling(target, turn);
  if (places.empty()) return;
  std::vector<std::pair<int, Json>> points;
  for (size_t i = 0; i < view["pixels"].size(); ++i) {
    const size_t id = view.contains("ids") ? view["ids"][i].get<size_t>() : i;
    points.emplace_back(places.at(id), view["pixels"][i]);
  }
  std::sort(points.begin(), points.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  for (size_t i = 0; i < points.size(); ++i) {
    if (view.contains("ids")) view["ids"][i] = points[i].first;
    view["pixels"][i] = points[i].second;
  }
}

}  // namespace

std::vector<int> open_turns(const ImageTarget& target) {
  using Kind = ImageTarget::Kind;
  if (target.kind != Kind::chessboard && target.kind != Kind::circles) return {0};
  GridLayout grid{GridLayout::Kind::corners, target.rows, target.columns, target.asymmetric};
  if (target.kind == Kind::circles) grid.kind = GridLayout::Kind::circles;
  return turns_alike(grid, target.large_origin);
}

std::vector<std::string> renumber(const RigFile& rig,
                                  const std::map<std::string, ImageTarget>& targets,
                                  const std::set<std::pair<int, int>>& filled,
                                  std::vector<Json>& samples) {
  std::map<int, std::vector<int>> open;
  std::string names, text;
  for (size_t t = 0; t < rig.rig.targets.size(); ++t) {
    const auto found = targets.find(rig.rig.targets[t].name);
    if (found == targets.end() || open_turns(found->second).size() < 2) continue;
    open[static_cast<int>(t)] = open_turns(found->second);
    names += (names.empty() ? "'" : ", '") + found->first + "'";
  }
  if (open.empty()) return {};
  const std::string alone =
      "numbering of " + names + ": half a turn gives the same image, each is numbered by itself";
  for (const Json& sample : samples) text += sample.dump() + "\n";
  std::vector<Sample> parsed;
  try {
    parsed = parse_samples(text, "samples", rig.rig);
  } catch (const InputError&) {
    return {alone + ": there are no joint readings to decide it"};
  }
  std::vector<std::pair<int, int>> fixed;
  for (size_t s = 0; s < parsed.size(); ++s)
    for (size_t v = 0; v < parsed[s].views.size(); ++v)
      if (!filled.count({static_cast<int>(s), static_cast<int>(v)})) fixed.emplace_back(s, v);
  int turned = 0;
  std::string doubtful;
  const std::vector<ViewTurn> turns = agreeing_numbers(rig.rig, parsed, open, fixed);
  for (const ViewTurn& one : turns) {
    Json& view = samples[static_cast<size_t>(one.sample)]["views"][static_cast<size_t>(one.view)];
    if (!one.decided) doubtful += (doubtful.empty() ? "" : ", ") + parsed[one.sample].id;
    if (one.quarters == 0) continue;
    ++turned;
    renumber_view(rig.rig.targets[parsed[one.sample].views[one.view].target], one.quarters, view);
  }
  if (turns.empty()) return {alone + ": the robot's readings do not decide it"};
  std::vector<std::string> said = {
      "numbering of " + names + ": half a turn gives the same image; by the joint readings " +
      std::to_string(turned) + " of " + std::to_string(turns.size()) + " views were turned"};
  if (!doubtful.empty()) said.push_back("numbering not decided by the joint readings: " + doubtful);
  return said;
}

}  // namespace kincal
