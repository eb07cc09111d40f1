// Blocks of data that are held out of a fit together, and their distribution to folds.
//
// Blocks. A block is held out as a whole: the samples of one posture (readings that do not differ
// by more than their noise; samples that see a free target are each their own); or, where a
// sensor's samples are spread over several mounted targets of one rigid body whose poses some step
// estimates, one in each sample (placements: a block of sockets put here and there), all samples of
// one target. If some samples of a placement were in the fit, its pose would be determined already,
// and the others would not show the error. Held out as a whole, its pose is estimated from its own
// samples when it is judged (the formats' `held_out`). Targets on different bodies (a board in each
// hand) are no placements: without one of them its whole arm would have no data. Nor is a target
// that is the only one that some sensor sees on the body, or that has more than its pose estimated
// in some step.
//
// Folds. Blocks are sorted by their views (names of sensors, and of targets that are no
// placements) and, if that is equal, by a hash of their names, and dealt like cards to the K folds.
// So every fold has its share of every kind, independent of the order and number of the file's
// other samples. If all blocks of a sensor, of a target (placements aside) or of a joint (between a
// sensor and its target) would be in one fold, the first of them is never held out, so that the fit
// always has some of its data. If only one fold is held out, it is fold 0.
#pragma once

#include <string>
#include <vector>

#include "rig.h"
#include "samples.h"

namespace kincal {

/// Returns whether readings of these joints are those of one posture: they differ by no more than
/// five sigmas of a difference. Readings that both samples lack are equal.
bool is_same_posture(const Rig& rig, const Sample& a, const Sample& b,
                     const std::vector<int>& joints);

/// Blocks are the units of data that are held out together.
struct Blocks {
  std::vector<int> of;             // by sample
  std::vector<std::string> names;  // by block: an id of its samples, or the target's name
  std::vector<char> target;        // by block: a placement
};
Blocks make_blocks(const Rig& rig, const std::vector<Sample>& samples);

/// Folds are the fold of each sample, 0 to count - 1; -1 if the sample is never held out, or is no
/// training sample.
struct Folds {
  int count = 0;
  Blocks blocks;
  std::vector<int> of;
  /// Returns the names of a fold's blocks; for fold -1 those of the training blocks that are never
  /// held out.
  std::vector<std::string> held_out(int fold) const;
  bool by_target() const;  // at least one block is a placement

  std::vector<char> training;  // by sample
};
/// Deals the blocks to `count` folds. @throws std::invalid_argument if fewer than `count` blocks
/// can be held out.
Folds deal_folds(const Rig& rig, const std::vector<Sample>& samples, int count);

}  // namespace kincal
