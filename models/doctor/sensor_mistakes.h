// Mistakes about sensors: mirrored images, units, poses, links, names, lenses, bearings. Each function appends its hypotheses.
#pragma once

#include <vector>

#include "survey.h"

namespace kincal {

/// Mirrored images of cameras, left-handed axes of sensors that measure points.
void add_mirrors(const Rig& rig, const Survey& survey, std::vector<Hypothesis>& out);
/// Logs in millimetres.
void add_units(const Rig& rig, const Survey& survey, std::vector<Hypothesis>& out);
/// Poses of sensors and mounted targets that are given the wrong way round.
void add_poses(const Rig& rig, const Survey& survey, std::vector<Hypothesis>& out);
/// A sensor on the link of its target and the other way round.
void add_sides(const Rig& rig, const Survey& survey, std::vector<Hypothesis>& out);
/// Two cameras whose names are exchanged.
void add_exchanges(const Rig& rig, const Survey& survey, std::vector<Hypothesis>& out);
/// Distortion of images that are rectified, and none of images that are not, where the rig does not free it.
void add_lenses(const Rig& rig, const ParameterTable& table, const Survey& survey, const FreedNames& freed, std::vector<Hypothesis>& out);
/// Bearings of scanning sensors in degrees, or with the wrong sign.
void add_bearings(const Rig& rig, const std::vector<Sample>& samples, const Survey& survey, std::vector<Hypothesis>& out);

}  // namespace kincal
