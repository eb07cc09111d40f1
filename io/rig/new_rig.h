// A first rig.yaml for a robot, from a few words: what `kincal init` writes.
#pragma once

#include <string>
#include <vector>

#include "../urdf/urdf.h"

namespace kincal {

/// A NewSensor is "TYPE:LINK[:NAME]" in parts.
struct NewSensor {
  std::string type, link, name;
};

/// A NewTarget is "TYPE:...[@LINK][:NAME]" in parts; without a link the target is free.
struct NewTarget {
  std::string type, link, name;
  int rows = 0, columns = 0;
  int id = 0;  // marker
  double size = 0,
         second = 0;  // square, spacing, tag or edge; marker (charuco) or gap / tag (apriltag_grid)
  std::string marks;  // dictionary (charuco, marker) or family (apriltag_grid); "": not said
  std::vector<double> points;  // x y z of each
};

/// These are the forms that the two options take, for help and messages.
std::string sensor_form();
extern const char* const kTargetForm;

/// Both parse one option. @throws InputError naming the option, what is wrong and what is valid
/// (types; the nearest links).
NewSensor parse_new_sensor(const std::string& text, const Tree& tree);
NewTarget parse_new_target(const std::string& text, const Tree& tree);

struct NewRig {
  std::string robot;  // as the rig names it; empty: a flange_robot()
  std::vector<NewSensor> sensors;
  std::vector<NewTarget> targets;
  /// These stand in the order of the cameras; one is for all of them if it is the only one.
  std::vector<std::vector<double>> intrinsics;  // fx fy cx cy
  std::vector<std::vector<int>> image_sizes;    // width height
};

/// Writes the commented text of a rig that read_rig() takes. Names that are missing are made from
/// the types. @throws InputError: duplicate names, a camera without intrinsics and image size, a
/// tilting laser without a joint that moves it. A camera is mounted by the fixed joint that its
/// link hangs on, where nothing but the camera hangs on that.
std::string new_rig_text(const Urdf& urdf, NewRig rig);

}  // namespace kincal
