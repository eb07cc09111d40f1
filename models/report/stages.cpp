#include "stages.h"

#include <algorithm>

namespace kincal {

std::vector<StageError> compare_stages(const Rig& rig, const Blocks& blocks,
                                       const std::vector<Stage>& stages,
                                       const std::vector<std::string>& further,
                                       const std::vector<HeldOutSums>& sums) {
  std::vector<const HeldOutSums*> all;
  for (const HeldOutSums& one : sums) all.push_back(&one);
  std::vector<StageError> out;
  for (const ComparedError& row : compare_errors(rig, blocks, all))
    for (size_t stage = 0; stage < sums.size(); ++stage) {
      StageError one;
      one.sensor = row.sensor;
      one.unit = row.unit;
      one.points = row.points;
      one.blocks = row.blocks;
      one.by_target = row.by_target;
      one.rms = row.rms[stage];
      std::vector<std::string> before;
      if (stage > 0) {
        before = stages[stage - 1].further;
        one.ratio = one.rms / row.rms[stage - 1];
        one.of_ratio = row.ratio(stage, stage - 1);
      }
      for (const std::string& name : stage < stages.size() ? stages[stage].further : further)
        if (!std::count(before.begin(), before.end(), name)) one.added.push_back(name);
      out.push_back(std::move(one));
    }
  return out;
}

}  // namespace kincal
