// Where pictures of a simulated robot are taken: what stands where before its cameras.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "../../models/simulation/posture.h"
#include "../rig/rig_file.h"
#include "render.h"

namespace kincal {

/// A Studio is what all pictures of a robot have in common. It refers to the rig.
struct Studio {
  const Rig& rig;
  ParameterTable table;
  VectorXd truth;
  std::map<int, Print> prints;     // by target, but those that are points alone
  std::map<int, CameraRays> rays;  // by sensor, of cameras that were asked for
};

/// Makes a studio of a truth file; `rig` has to stay. @throws InputError
Studio make_studio(const RigFile& rig, const std::string& truth);

/// Gets the rays of a camera ready for its pictures.
void prepare_camera(Studio& studio, int sensor);

/// Returns what stands before a camera: all mounted targets, and the free ones of the posture; none
/// that the posture lacks a reading for.
std::vector<Sheet> sheets_before(const Studio& studio, int sensor, const Posture& posture);

}  // namespace kincal
