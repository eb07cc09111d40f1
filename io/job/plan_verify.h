// Postures for the verification of a calibrated robot: the test poses of a standard, as `kincal
// plan --verify` plans them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "../../models/design/test_poses.h"
#include "../../models/simulation/posture.h"
#include "../results/json_values.h"
#include "job.h"

namespace kincal {

struct TestPoseSettings {
  std::string sensor;  // the instrument; empty: the only one
  int cycles = 30;
  bool approaches = false;     // P1, P2 and P4 from three directions each
  std::vector<double> region;  // x y z of two corners, m, base frame, that the cube stays between
  int candidates = 2000;       // random postures to begin from
  std::uint64_t seed = 1;
  double clearance = 0.02;  // m between links; below 0: they are not looked at
  Words words = Words::switches;
};

struct TestPosePlan {
  std::string sensor, target, base;  // names
  TestPoses cube;                    // with all five poses
  int cycles = 0;
  std::vector<Posture> postures;  // in the order of the test, with their ids
  std::vector<std::string> notes;
};

/// Plans the poses of ISO 9283, each reached by the centre of a target that an instrument sees.
/// @throws InputError: no instrument, or several; unknown poses; no cube, or no pose, is reached
TestPosePlan plan_test_poses(const RigFile& rig_file, const TestPoseSettings& settings,
                             const Progress& progress);

Json test_poses_json(const Rig& rig, const TestPosePlan& plan);
std::string test_poses_text(const TestPosePlan& plan);

}  // namespace kincal
