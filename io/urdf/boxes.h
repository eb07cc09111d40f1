// The boxes around what a URDF draws of its links, for pictures: nothing is calculated with them.
#pragma once

#include <vector>

#include "urdf.h"

namespace kincal {

/// A LinkBox is the box around one shape of a link: its size along its own axes, in m.
struct LinkBox {
  Pose link_T_box;
  Vector3d size;
};

/// LinkBoxes are those of all links, by index of the tree as it stands in the file.
struct LinkBoxes {
  std::vector<std::vector<LinkBox>> of;
  int left_out = 0;  // links with meshes alone: not there, not STL, or not named by a path
};

/// Reads boxes, cylinders, spheres and STL meshes of each link: of <visual>, else of <collision>.
/// What is wrong in them is left out, for a picture is no reason to refuse a robot.
LinkBoxes link_boxes(const Urdf& urdf);

}  // namespace kincal
