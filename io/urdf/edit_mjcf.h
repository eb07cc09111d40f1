// A calibrated robot written into a MuJoCo model (MJCF) of it, in place.
#pragma once

#include <string>
#include <vector>

#include "../../kinematics/tree.h"

namespace kincal {

/// Whether a text is XML with <mujoco> at its top.
bool is_mjcf(const std::string& text);

/// A PlacedCamera is a camera on a link; its frame looks along z, y is down.
struct PlacedCamera {
  std::string name;
  int link = -1;
  Pose link_T_camera;
};

/// CalibratedTree is a robot before and after a calibration: origins by joint.
struct CalibratedTree {
  const Tree& tree;
  std::vector<Pose> before, after;
  std::vector<PlacedCamera> cameras;
};

struct EditedMjcf {
  std::string text;
  std::vector<std::string> notes;  // what of the robot it does not hold, and what was rewritten
};

/// Returns a model's text with its bodies where the calibrated robot has the links of their names,
/// for the same joint readings: `pos` and `quat` of bodies (another attribute that turns them
/// becomes `quat`), `pos` and `axis` of joints, where they differ; cameras by their names or
/// those of their links, and sites that are called as links. Everything else stays byte for byte.
/// Before it is returned it is read back, and the poses of these bodies are compared with the
/// robot's at 20 postures, to 1e-9 m and rad. @throws InputError, also where the model is not that
/// of the robot before the calibration (2e-3 m and rad: numbers in such models are rounded). Names
/// in the model may lack a prefix that the robot's have.
EditedMjcf edit_mjcf(const std::string& text, const std::string& path, const CalibratedTree& robot);

}  // namespace kincal
