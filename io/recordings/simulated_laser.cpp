#include "simulated_laser.h"

#include <algorithm>
#include <cmath>

#include "../../models/rig/configuration.h"
#include "../document/error.h"

namespace kincal {

SimulatedLaser::SimulatedLaser(const Studio& studio, int sensor, const std::vector<Sample>& samples,
                               const std::vector<Stop>& stops, const SweepOptions& sweep,
                               const JourneyOptions& journey)
    : studio_(studio),
      sensor_(sensor),
      joint_(studio.rig.sensors[static_cast<size_t>(sensor)].scanning_joint),
      low_(1e300),
      high_(-1e300),
      sweep_(sweep),
      period_(journey.rest + journey.move) {
  constexpr double kBeyond = 0.15, kWall = 8;
  const Rig& rig = studio.rig;
  const std::string& name = rig.sensors[static_cast<size_t>(sensor)].name;
  for (const Sensor& camera : rig.sensors) {
    if (camera.type != "camera") continue;
    const std::vector<int> path = joints_between(rig, rig.base, camera.link);
    if (std::count(path.begin(), path.end(), joint_))
      throw InputError("--sweeps: camera '" + camera.name + "' moves with the joint of laser '" +
                       name + "': its pictures would not be at rest");
  }
  for (const int j : needed_readings(rig, sensor, -1))
    for (const Stop& stop : stops)
      if (j != joint_ && std::isnan(stop.truth.readings[static_cast<size_t>(j)]))
        throw InputError("--sweeps: sample '" + stop.truth.id + "' has no reading of joint '" +
                         rig.tree.joints[static_cast<size_t>(j)].name +
                         "', so it is not known where laser '" + name + "' is");
  for (const Sample& sample : samples)
    for (const View& view : sample.views)
      for (size_t i = 0; view.sensor == sensor && i < view.z.size(); i += 3) {
        low_ = std::min(low_, view.z[i] - kBeyond);
        high_ = std::max(high_, view.z[i] + kBeyond);
      }
  const auto [least, most] = usual_range(rig.tree.joints[static_cast<size_t>(joint_)]);
  low_ = low_ > high_ ? least : std::max(low_, least);
  high_ = std::max(low_, std::min(high_ < -1e299 ? most : high_, most));
  look_.turn = 1 / sweep.scan_rate;
  look_.wall = kWall;
}

double SimulatedLaser::reading(double time) const {
  const double since = time - period_ * std::floor(time / period_) - kQuiet;
  const double ways = std::clamp(since / sweep_.seconds, 0., 2.);
  return 0.5 * (low_ + high_) - 0.5 * (high_ - low_) * std::cos(kPi * ways);
}

Pose SimulatedLaser::base_T_laser(const Posture& posture, double time) const {
  return Configuration(studio_.rig, studio_.table, studio_.truth, posture.readings)
      .with(joint_, reading(time))
      .base_T_sensor(sensor_);
}

LaserScan SimulatedLaser::scan(const Journey& journey, double time, RandomStream draws) const {
  Posture posture = journey.at(time);
  posture.readings[static_cast<size_t>(joint_)] = reading(time);
  const Pose base_T_laser_then = base_T_laser(posture, time);
  LaserScene scene;
  scene.middle = base_T_laser_then.translation;
  scene.sheets = sheets_before(studio_, sensor_, posture);
  for (Sheet& sheet : scene.sheets) sheet.camera_T_print = base_T_laser_then * sheet.camera_T_print;
  return simulate_scan(
      scene, [&](double t) { return base_T_laser(posture, t); }, time, look_, draws);
}

}  // namespace kincal
