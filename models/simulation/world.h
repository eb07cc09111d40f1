// A robot as it really is: what its sensors see in a posture, and what they log. The models stand
// at the head of simulation.h.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../rig/configuration.h"
#include "../rig/random_stream.h"
#include "posture.h"

namespace kincal {

using SensorTarget = std::pair<int, int>;  // (sensor, target)

/// A DrawStream is one of the streams of draws of one seed; those of the samples follow each other.
enum DrawStream : std::uint64_t {
  kTruthStream,
  kPostureStream,
  kFirstSampleStream,
  kFirstConditionsStream = std::uint64_t{1} << 40
};

/// Returns the conditions of sample k: those on which a parameter of the rig depends. Each joint
/// that has a backlash was approached from either side; if a joint's position depends on
/// the temperature, that is 10 to 30 degrees; if a sensor has a time offset, joints turn by up to
/// 0.5 rad/s and slide by up to 0.1 m/s.
Conditions draw_conditions(const Rig& rig, std::uint64_t seed, int k);

inline bool is_chain(const Sensor& sensor) {
  return sensor.model->measurement_kind() == MeasurementKind::chain;
}

/// A Draft is a sample in the making.
struct Draft {
  Sample sample;                 // as logged
  std::vector<double> readings;  // true
  std::map<int, Pose> targets;   // true base_T_target of free targets
  std::vector<DroppedView> dropped;
  std::vector<std::string> unseen;  // why views are not possible
};

/// A CameraImage is the image of a camera in px, and its focal length and principal point.
struct CameraImage {
  double focal, cx, cy, width, height;
};

/// A World is a rig as it really is. It keeps references to its arguments.
class World {
 public:
  World(const Rig& rig, const ParameterTable& table, const VectorXd& truth);

  /// Carries out a posture. Those of `views` that cannot be are dropped; if they are `listed`, the
  /// reason is kept, and boards may be seen from behind.
  Draft carry_out(const Posture& posture, const std::vector<SensorTarget>& views, bool listed,
                  RandomStream noise) const;

  /// Places a target where the sensor is likely to see it, and returns base_T_target. Cameras: the
  /// board fills 20 to 60 % of the image, at least 0.4 m away. Lasers: 2 to 6 times its extent, at
  /// least 0.5 m away. Both: its front to them, tilted up to 45 degrees and turned at will. Others:
  /// 0.5 to 2 m away, at will.
  Pose place(const Sample& robot, int sensor, int target, RandomStream& draws) const;
  /// Returns where a sensor has a mounted target.
  Pose sensor_T_target(const Sample& robot, int sensor, int target) const {
    return inverse(base_T_sensor(robot, sensor)) * at(robot, sensor).base_T_target(target);
  }
  /// Returns where a sensor has it that stands at base_T_target.
  Pose sensor_T_target(const Sample& robot, int sensor, const Pose& base_T_target) const {
    return inverse(base_T_sensor(robot, sensor)) * base_T_target;
  }

 private:
  /// The robot when a sensor measures, a camera at a row of its image.
  Configuration at(const Sample& robot, int sensor, double row = 0) const {
    return Configuration(rig_, table_, truth_, robot.readings, robot.conditions, {sensor, row});
  }
  Pose base_T_sensor(const Sample& robot, int sensor, double scan_reading = 0) const {
    return at(robot, sensor)
        .with(rig_.sensors[sensor].scanning_joint, scan_reading)
        .base_T_sensor(sensor);
  }
  const double* own_numbers(int sensor) const {
    const int block = table_.sensor_block[sensor];
    return block >= 0 ? truth_.data() + table_.all[block].start : nullptr;
  }
  std::optional<CameraImage> image_of(int sensor) const;
  bool front_shows(int target, const Vector3d& eye) const;
  bool look(const Sample& robot, const SensorTarget& view, const Pose& base_T_target, bool any_side,
            std::vector<double>& z, std::string& why) const;
  bool scan(const Sample& robot, const SensorTarget& view, const Pose& base_T_target,
            std::vector<double>& z) const;
  bool roll(const Sample& robot, const SensorTarget& view, const Pose& base_T_target,
            Matrix3Xd& p_sensor, std::vector<double>& z) const;
  bool inside(int sensor, const Eigen::Matrix3Xd& p_sensor, const std::vector<double>& pixels,
              std::string& why) const;
  bool predict(int sensor, const Eigen::Matrix3Xd& p_sensor, std::vector<double>& z,
               RowMatrix* by_point) const;
  void add_noise(int sensor, RandomStream& noise, std::vector<double>& z) const;

  const Rig& rig_;
  const ParameterTable& table_;
  const VectorXd& truth_;
  std::vector<Eigen::Matrix3Xd> points_;
};

}  // namespace kincal
