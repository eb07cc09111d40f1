// The types of targets and sensors that a rig knows: the keys that they have, and their standard
// deviations.
#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "../../models/rig/rig.h"
#include "../document/document.h"

namespace kincal {

using Names = std::vector<std::string>;

struct TargetKeys {
  std::string name;  // of the type
  Names required, optional;
  const char* size;  // the key of Target::square, "" if it has none
};
const std::vector<TargetKeys>& target_types();

/// This is all that files know of a type of sensor. What it measures and how says its model.
struct SensorKeys {
  std::string name;  // of the type
  Names required, optional;
  const char*
      payload;  // key of a view's measured numbers, "" if the joint readings are the measurement
  std::shared_ptr<const SensorModel> (
      *make)();              // the model; of a camera one without a lens, until its keys are read
  const char *guess, *unit;  // sigma that `init` writes, and its units
  bool by_axis = false;      // sigma may be a list, one number a residual
};
const std::vector<SensorKeys>& sensor_types();

/// Names of joints, sensors, targets, or types of them stand in the order of `things`.
template <class T>
Names names_of(const std::vector<T>& things) {
  Names names;
  for (const T& thing : things) names.push_back(thing.name);
  return names;
}

/// The keys of a type are looked up by its name; null: there is no such type.
template <class Keys>
const Keys* find_type(const std::vector<Keys>& types, const std::string& name) {
  const auto found =
      std::find_if(types.begin(), types.end(), [&](const Keys& keys) { return keys.name == name; });
  return found == types.end() ? nullptr : &*found;
}

/// This is the key of the measured numbers in a sensor's views. Sensors of other types, which a
/// program may add to its rig, show points.
std::string payload_of(const Sensor& sensor);

/// The parts of a sensor's sigma have these names (noise_parts() of its model); empty: it is a
/// number or a list.
Names sigma_names(const Sensor& sensor);

/// Returns whether a list of numbers may stand for the sigma of a sensor. Sensors of types that
/// files do not know take one.
bool sigma_by_axis(const Sensor& sensor);

/// Returns what ROS calls a camera's lens with so many numbers of distortion; its own name where
/// ROS has none.
std::string ros_lens(const std::string& model, size_t numbers);

/// Returns whether `sigma` is {guess: ...}, which states nothing: the noise is estimated from
/// there.
bool is_guess(const Field& sigma);

/// Standard deviations are returned as the model takes them: camera 2, point 3, laser (joint,
/// bearing, range), poses 3 + 3.
std::vector<double> read_sigma(const Field& field, const Sensor& sensor);

}  // namespace kincal
