// What is held out of a fit together, and how that is dealt to folds.
//
// Blocks. A block is what is held out together: a sample; or, where a sensor's samples are spread
// over several mounted targets of one rigid body whose poses some step frees, one in each sample
// (placements: a block of sockets put here and there), all samples of one target. A placement of
// which some samples are in the fit is known already and shows nothing of the others' error; held
// out as a whole, its pose is estimated from its own samples when it is judged (the formats'
// `held_out`). Targets on different bodies (a board in each hand) are no placements of one another:
// without one of them its whole arm would be without data. Nor is a target that is all that some
// sensor sees of the body, or of which a step frees more than the pose.
//
// Folds. Blocks are sorted by what is seen in them (names of sensors, and of targets that are no
// placements) and, where that is the same, by a hash of their names, and dealt like cards to the K
// folds; so every fold has its share of every kind, and neither the order nor the number of other
// samples of the file plays a role. If all blocks of a sensor, of a target (placements aside) or of
// a joint (on the way from a sensor to what it sees) came into one fold, the first of them is never
// held out, so that the fit always has something of it. Where one fold only is held out, it is fold
// 0.
#pragma once

#include <string>
#include <vector>

#include "rig.h"
#include "samples.h"

namespace kincal {

/// Blocks are the units of data that are held out together.
struct Blocks {
  std::vector<int> of;             // by sample
  std::vector<std::string> names;  // by block: the sample's id, or the target's name
  std::vector<char> target;        // by block: a placement
};
Blocks make_blocks(const Rig& rig, const std::vector<Sample>& samples);

/// Folds give the fold of each sample, 0 to count - 1. It is -1 where the sample is never held out,
/// or is no training sample.
struct Folds {
  int count = 0;
  Blocks blocks;
  std::vector<int> of;
  /// Returns the names of a fold's blocks; of fold -1 these are the blocks of training samples that
  /// are never held out.
  std::vector<std::string> held_out(int fold) const;
  bool by_target() const;  // some block is a placement

  std::vector<char> training;  // by sample
};
/// Deals the blocks to `count` folds. @throws std::invalid_argument where there are fewer than
/// `count` blocks that can be held out.
Folds deal_folds(const Rig& rig, const std::vector<Sample>& samples, int count);

}  // namespace kincal
