// The usual mistakes, each as a transformation (rig, samples) -> (rig, samples) that undoes it. A
// mistake is its own inverse (exchange, sign, turn) or is undone by a factor, so undoing needs no
// knowledge of how it came about. Whether one was made, fits decide: doctor.h. Other numberings of
// a board's points: models/rig/targets.h.
#pragma once

#include <vector>

#include "observation_index.h"

namespace kincal {

/// Returns all hypotheses but those that need the values of a fit (bad samples, numbering of single
/// views: suspects.h). What is freed anyway is no hypothesis.
std::vector<Hypothesis> hypotheses(const Rig& rig, const ParameterTable& table,
                                   const std::vector<Sample>& samples, const FreedNames& freed);

}  // namespace kincal
