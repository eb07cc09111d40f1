#include "stages.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace kincal {
namespace {

/// Sums of squares of each stage, by block.
using StageSquares = std::map<int, std::vector<double>>;

/// Whether every stage has as many points there.
bool is_judged(const std::vector<HeldOutSums>& sums, const std::pair<int, int>& place,
               long points) {
  return std::all_of(sums.begin(), sums.end(), [&](const HeldOutSums& of) {
    const auto found = of.all.find(place);
    return found != of.all.end() && found->second.points == points;
  });
}

std::vector<double> column(const StageSquares& squares, size_t stage) {
  std::vector<double> out;
  for (const auto& entry : squares) out.push_back(entry.second[stage]);
  return out;
}

/// The rows of one sensor, of translations or of rotations.
void add_rows(const Blocks& blocks, int sensor, double BlockSums::*part,
              const std::vector<HeldOutSums>& sums, StageError row, std::vector<StageError>& out) {
  StageSquares by_block, by_sample;
  for (const auto& [place, of] : sums.back().all) {
    if (place.first != sensor || !is_judged(sums, place, of.points)) continue;
    const int block = blocks.of[place.second];
    row.points += of.points;
    row.by_target = row.by_target || blocks.target[block];
    for (std::vector<double>* to : {&by_block[block], &by_sample[place.second]}) {
      to->resize(sums.size(), 0);
      for (size_t s = 0; s < sums.size(); ++s) (*to)[s] += sums[s].all.at(place).*part;
    }
  }
  if (row.points == 0) return;
  const bool whole = by_block.size() >= 3;
  const StageSquares& parts = whole ? by_block : by_sample;
  row.by_target = whole && row.by_target;
  row.blocks = static_cast<long>(parts.size());
  std::vector<double> before;
  for (size_t s = 0; s < sums.size(); ++s) {
    const std::vector<double> now = column(parts, s);
    double sum = 0;
    for (const double square : now) sum += square;
    StageError one = row;
    one.rms = std::sqrt(sum / static_cast<double>(row.points));
    if (s > 0) {
      one.ratio = one.rms / (out.end() - 1)->rms;
      one.of_ratio = rms_ratio_interval(now, before);
    }
    out.push_back(std::move(one));
    before = now;
  }
}

}  // namespace

std::vector<StageError> compare_stages(const Rig& rig, const Blocks& blocks,
                                       const std::vector<Stage>& stages,
                                       const std::vector<std::string>& further,
                                       const std::vector<HeldOutSums>& sums) {
  std::vector<StageError> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    for (const auto part : {&BlockSums::as_read, &BlockSums::rotation_as_read}) {
      const bool rotation = part == &BlockSums::rotation_as_read;
      const SensorModel& model = *rig.sensors[s].model;
      if (rotation && !model.measures_pose()) continue;
      StageError row;
      row.sensor = rig.sensors[s].name;
      row.unit = rotation ? "rad" : model.unit();
      const size_t first = out.size();
      add_rows(blocks, static_cast<int>(s), part, sums, std::move(row), out);
      for (size_t i = first; i < out.size(); ++i) {
        const size_t stage = i - first;
        const std::vector<std::string>& now =
            stage < stages.size() ? stages[stage].further : further;
        for (const std::string& name : now)
          if (stage == 0 ||
              !std::count(stages[stage - 1].further.begin(), stages[stage - 1].further.end(), name))
            out[i].added.push_back(name);
      }
    }
  return out;
}

}  // namespace kincal
