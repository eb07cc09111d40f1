// Mistakes about targets: sizes, orders of points that are no board, mirrored points, moved ones.
// Functions that add append their hypotheses.
#pragma once

#include <optional>
#include <vector>

#include "observation_index.h"
#include "trial_fits.h"

namespace kincal {

/// Adds sizes of boards and units of points, where the rig does not free them.
void add_squares(const Rig& rig, const ParameterTable& table, const ObservationIndex& observations,
                 const FreedNames& freed, std::vector<Hypothesis>& out);
/// Adds points of a target (not a grid) that are measured in another order than the rig lists them:
/// the orders that suit the distances measured; of what measures no distances the reverse.
void add_point_orders(const Rig& rig, const std::vector<Sample>& samples,
                      const ObservationIndex& observations, std::vector<Hypothesis>& out);
/// Adds mirrored points that are no grid and not in a plane: their mirror image is another target.
void add_mirrored_points(const Rig& rig, const ObservationIndex& observations,
                         std::vector<Hypothesis>& out);

/// Adds views of a sensor that show a free target elsewhere than the views of other sensors on the
/// same body in the same samples: of another moment, or of another object. (Between bodies joints
/// may be the reason.)
void add_apart(const Rig& rig, const std::vector<Sample>& samples, std::vector<Hypothesis>& out);

/// Finds by fits the mounted target, and the sample of those that follow each other in time, from
/// which on that target stands elsewhere on its link. Nothing: none is seen in enough samples.
std::optional<Hypothesis> moved_target(const Recording& recording, const TrialContext& context);

/// Returns a clause that a target is so many times as large as the rig says, and the cure.
std::string wrong_size(const Target& target, double factor);
constexpr const char* kMeasureSize =
    "measure, and correct the size in the rig: metres, from corner to corner";

}  // namespace kincal
