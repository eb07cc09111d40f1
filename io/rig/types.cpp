#include "types.h"

#include "../../models/sensors/sensors.h"
#include "../../models/sensors/surface.h"
#include "../document/names.h"

namespace kincal {

const std::vector<TargetKeys>& target_types() {
  static const std::vector<TargetKeys> types = {
      {"chessboard", {"rows", "columns", "square"}, {"warp", "print"}, "square"},
      {"circles",
       {"rows", "columns", "spacing"},
       {"asymmetric", "origin", "warp", "print"},
       "spacing"},
      {"charuco",
       {"rows", "columns", "square", "marker", "dictionary"},
       {"warp", "print", "first_id"},
       "square"},
      {"apriltag_grid",
       {"rows", "columns", "tag", "spacing", "family"},
       {"warp", "print", "first_id"},
       "tag"},
      {"marker", {"dictionary", "id", "size"}, {"warp", "print"}, "size"},
      {"points", {"points"}, {}, ""},
      {"plane", {}, {}, ""}};
  return types;
}

const std::vector<SensorKeys>& sensor_types() {
  static const Names range = {"range_scale", "range_offset"};
  static const std::vector<SensorKeys> types = {
      {"camera",
       {"model", "intrinsics", "sigma"},
       {"image_size", "distortion", "baseline", "line_time"},
       "pixels",
       [] { return make_camera(Lens::pinhole, 0); },
       "0.2",
       "px"},
      {"point", {"sigma"}, range, "points", make_point, "0.0002", "m", true},
      {"surface", {"sigma"}, {}, "points", make_surface, "0.001", "m"},
      {"pose",
       {"sigma"},
       {"range_scale"},
       "pose",
       make_pose,
       "{translation: 0.0005, rotation: 0.001}",
       "m, rad"},
      {"chain",
       {"sigma"},
       {},
       "",
       make_chain,
       "{translation: 0.0005, rotation: 0.001}",
       "m, rad; of the grip"},
      {"tilting_laser",
       {"joint", "sigma"},
       {},
       "rays",
       make_tilting_laser,
       "{joint: 0.0005, bearing: 0.0005, range: 0.005}",
       "rad, rad, m"}};
  return types;
}

std::string payload_of(const Sensor& sensor) {
  const SensorKeys* keys = find_type(sensor_types(), sensor.type);
  return keys ? keys->payload : "points";
}

Names sigma_names(const Sensor& sensor) {
  Names names;
  const std::vector<NoisePart> parts = sensor.model->noise_parts();
  for (size_t i = 0; parts.size() > 1 && i < parts.size(); ++i) names.push_back(parts[i].name);
  return names;
}

bool sigma_by_axis(const Sensor& sensor) {
  const SensorKeys* keys = find_type(sensor_types(), sensor.type);
  return !keys || keys->by_axis;
}

std::string ros_lens(const std::string& model, size_t numbers) {
  if (model == "kannala_brandt") return "equidistant";
  if (model != "pinhole" && model != "brown_conrady") return model;
  return numbers < 8 ? "plumb_bob" : "rational_polynomial";
}

bool is_guess(const Field& sigma) {
  if (sigma.node->kind != Node::Kind::mapping || !sigma.has("guess")) return false;
  sigma.check_keys({"guess"});
  return true;
}

std::vector<double> read_sigma(const Field& field, const Sensor& sensor) {
  const Names names = sigma_names(sensor);
  if (names.empty()) {
    const int count = sensor.model->sigmas();
    const bool list = sigma_by_axis(sensor) && field.node->kind == Node::Kind::sequence;
    if (!list) return std::vector<double>(count, field.positive());
    const std::vector<double> sigma = field.vector(count);
    for (size_t i = 0; i < sigma.size(); ++i) field.item(i).positive();
    return sigma;
  }
  if (field.node->kind != Node::Kind::mapping)
    field.fail("a " + sensor.type + " takes {" + comma_separated(names) +
               "}, each a number greater than 0");
  field.check_keys(names);
  std::vector<double> sigma;
  for (const NoisePart& part : sensor.model->noise_parts())
    sigma.insert(sigma.end(), part.count, field[part.name].positive());
  return sigma;
}

}  // namespace kincal
