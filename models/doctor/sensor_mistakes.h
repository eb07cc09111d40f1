// Mistakes about sensors: mirrored images, units, poses, links, names, lenses, bearings. Each
// function appends its hypotheses.
#pragma once

#include <vector>

#include "observation_index.h"

namespace kincal {

/// Adds mirrored images of cameras, and left-handed axes of sensors that measure points.
void add_mirrors(const Rig& rig, const ObservationIndex& observations,
                 std::vector<Hypothesis>& out);
/// Adds measured points and positions in millimetres, centimetres, inches or feet.
void add_units(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out);
/// Adds measured poses whose positions have another scale: of a marker whose stated size is wrong.
void add_scales(const Rig& rig, const ObservationIndex& observations, const FreedNames& freed,
                const ParameterTable& table, std::vector<Hypothesis>& out);
/// Adds poses of sensors and mounted targets that are given the wrong way round, or whose
/// quaternions are written w x y z.
void add_poses(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out);
/// Adds sensors on the link of their target, and targets on the link of their sensor.
void add_sides(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out);
/// Adds baselines that are wrong or have the wrong sign, where the rig does not free them.
void add_baselines(const Rig& rig, const ParameterTable& table,
                   const ObservationIndex& observations, const FreedNames& freed,
                   std::vector<Hypothesis>& out);
/// Adds pairs of cameras whose names are exchanged.
void add_exchanges(const Rig& rig, const ObservationIndex& observations,
                   std::vector<Hypothesis>& out);
/// Adds distortion of images that are rectified, and missing distortion of images that are not,
/// where the rig does not free it.
void add_lenses(const Rig& rig, const ParameterTable& table, const ObservationIndex& observations,
                const FreedNames& freed, std::vector<Hypothesis>& out);
/// Adds fisheyes (kannala_brandt) that the rig has as pinhole or brown_conrady. (The reverse needs
/// no other model: its coefficients fit those lenses.)
void add_fisheyes(const Rig& rig, const ObservationIndex& observations,
                  std::vector<Hypothesis>& out);
/// Adds bearings of scanning sensors in degrees, or with the wrong sign, ranges that are not
/// metres, and rays whose numbers are in another order.
void add_bearings(const Rig& rig, const std::vector<Sample>& samples,
                  const ObservationIndex& observations, std::vector<Hypothesis>& out);
/// Adds sensors and mounted targets that sit on another link of their path: above theirs, or below.
void add_links(const Rig& rig, const std::vector<Sample>& samples, std::vector<Hypothesis>& out);

}  // namespace kincal
