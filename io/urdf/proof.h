// A written URDF read back and compared with what it shall mean.
#pragma once

#include <string>
#include <vector>

#include "urdf.h"

namespace kincal {

/// Proves that `text` means the model: for `postures` random positions (fixed seed, all joints,
/// within limits or +-pi) the pose of every link by the written file (position = reading) equals
/// that of (tree, origins, offsets: position = reading + offset) to 1e-9 m and rad. The file is
/// read with urdfdom, as ROS does, but for what no pose depends on (shapes and masses of links) and
/// no edit touches; where urdfdom refuses the input already, with read_urdf.
/// @throws std::runtime_error naming the first link that differs and by how much.
void prove_urdf(const std::string& text, const Urdf& input, const std::vector<Pose>& origins,
                const std::vector<double>& offsets, int postures = 20);

}  // namespace kincal
