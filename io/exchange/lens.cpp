#include "lens.h"

#include <algorithm>

#include "../../models/sensors/sensors.h"
#include "../document/error.h"
#include "../document/names.h"
#include "../document/numbers.h"

namespace kincal {
namespace {

std::string numbers_text(const std::vector<double>& numbers) {
  return list_text(numbers.data(), static_cast<int>(numbers.size()));
}

}  // namespace

std::string real_text(double value) {
  std::string text = shortest(value);
  const size_t exponent = text.find('e');
  if (text.find('.') == std::string::npos)
    text.insert(exponent == std::string::npos ? text.size() : exponent, ".0");
  return text;
}

LensNumbers lens_of(const Sensor& camera) {
  LensNumbers lens;
  lens.name = camera.name;
  lens.baseline = 0;
  lens.width = camera.image_width;
  lens.height = camera.image_height;
  for (const ParameterBlock& block : camera.parameters) {
    if (block.name == "intrinsics") lens.intrinsics = block.values;
    if (block.name == "distortion") lens.distortion = block.values;
    if (block.name == "baseline") lens.baseline = block.values[0];
  }
  lens.model = lens_type(camera.parameters).name;
  return lens;
}

RigKeys lens_keys(const LensNumbers& lens) {
  RigKeys keys = {{"model", lens.model}};
  if (lens.width > 0)
    keys.emplace_back("image_size",
                      "[" + std::to_string(lens.width) + ", " + std::to_string(lens.height) + "]");
  keys.emplace_back("intrinsics", numbers_text(lens.intrinsics));
  keys.emplace_back("distortion", lens.distortion.empty() ? "" : numbers_text(lens.distortion));
  if (lens.baseline)
    keys.emplace_back("baseline", *lens.baseline == 0 ? "" : shortest(*lens.baseline));
  return keys;
}

std::vector<const Sensor*> cameras_of(const Rig& rig, const std::vector<std::string>& names) {
  std::vector<const Sensor*> found;
  std::vector<std::string> cameras;
  for (const Sensor& sensor : rig.sensors)
    if (sensor.type == "camera") cameras.push_back(sensor.name);
  if (cameras.empty()) throw InputError("the rig has no camera");
  for (const std::string& name : names.empty() ? cameras : names) {
    const auto sensor = std::find_if(rig.sensors.begin(), rig.sensors.end(),
                                     [&](const Sensor& s) { return s.name == name; });
    if (sensor == rig.sensors.end() || sensor->type != "camera")
      throw InputError("--sensor: '" + name + "' is not a camera of the rig" +
                       nearest_names(name, cameras) + "; valid: " + comma_separated(cameras));
    found.push_back(&*sensor);
  }
  return found;
}

}  // namespace kincal
