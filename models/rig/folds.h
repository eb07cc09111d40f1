// What is held out of a fit together, and how that is dealt to folds.
//
// Blocks. What is held out together: a sample; or, where a sensor's samples are spread over several mounted targets whose poses some step
// frees, one in each sample (placements: a block of sockets put here and there), all samples of one target. A placement of which some
// samples are in the fit is known already and tells nothing of the others' error; held out as a whole, its pose is estimated from its own
// samples when it is judged (the formats' `held_out`).
//
// Folds. Blocks are sorted by what is seen in them (names of sensors, and of targets that are no placements) and, where that is the same, by
// a hash of their names, and dealt like cards to the K folds; so every fold has its share of every kind, and neither the order nor the
// number of other samples of the file plays a role. If all blocks of a sensor or of a target (placements aside) came into one fold, the first
// of them is never held out, so that the fit always has something of it. Who holds out one fold only takes fold 0.
#pragma once

#include <string>
#include <vector>

#include "rig.h"
#include "samples.h"

namespace kincal {

/// What is held out together.
struct Blocks {
  std::vector<int> of;             // by sample
  std::vector<std::string> names;  // by block: the sample's id, or the target's name
  std::vector<char> target;        // by block: a placement
};
Blocks make_blocks(const Rig& rig, const std::vector<Sample>& samples);

/// Fold of each sample, 0 to count - 1; -1: never held out, or no training sample.
struct Folds {
  int count = 0;
  Blocks blocks;
  std::vector<int> of;
  std::vector<std::string> held_out(int fold) const;  // names of blocks; fold -1: of those of training samples that are never held out
  bool by_target() const;                             // some block is a placement

  std::vector<char> training;  // by sample
};
/// @throws std::invalid_argument where there are fewer than `count` blocks that can be held out.
Folds deal_folds(const Rig& rig, const std::vector<Sample>& samples, int count);

}  // namespace kincal
