#include "studio.h"

#include <cmath>

#include "../../models/rig/configuration.h"
#include "../rig/simulation_file.h"

namespace kincal {

Studio make_studio(const RigFile& rig, const std::string& truth) {
  Studio studio{rig.rig, ParameterTable(rig.rig), {}, {}, {}};
  studio.truth = read_truth(truth, studio.table);
  for (size_t t = 0; t < rig.rig.targets.size(); ++t)
    if (rig.rig.targets[t].type != "points")
      studio.prints[static_cast<int>(t)] = print_of(image_target(rig, rig.rig.targets[t]));
  return studio;
}

void prepare_camera(Studio& studio, int sensor) {
  if (!studio.rays.count(sensor))
    studio.rays[sensor] = camera_rays(studio.rig, studio.table, studio.truth, sensor);
}

std::vector<Sheet> sheets_before(const Studio& studio, int sensor, const Posture& posture) {
  const Configuration robot(studio.rig, studio.table, studio.truth, posture.readings,
                            posture.conditions);
  const int link = studio.rig.sensors[sensor].link;
  const Pose camera_T_link = inverse(robot.link_T_sensor(sensor));
  const auto stands = [&](int other) {  // relative to the camera
    for (int j : joints_between(studio.rig, link, other))
      if (std::isnan(posture.readings[j])) return false;
    return true;
  };
  std::vector<Sheet> sheets;
  for (const auto& [t, print] : studio.prints) {
    const Target& target = studio.rig.targets[t];
    const auto placed = posture.targets.find(t);
    Sheet sheet;
    sheet.print = &print;
    const int frame = target.link >= 0 ? target.link : studio.rig.base;
    if ((target.link < 0 && placed == posture.targets.end()) || !stands(frame)) continue;
    const Pose frame_T_print =
        target.link < 0
            ? placed->second
            : get_pose(studio.truth, studio.table.all[studio.table.target_pose[t]].start);
    sheet.camera_T_print = camera_T_link * robot.a_T_b(link, frame) * frame_T_print;
    if (target.grid)
      sheet.unit = studio.truth(studio.table.all[studio.table.target_square[t]].start);
    sheet.y_up = target.y_up;
    sheets.push_back(sheet);
  }
  return sheets;
}

}  // namespace kincal
