#include "types.h"

#include "../document/names.h"

namespace kincal {

const std::vector<TargetKeys>& target_types() {
  static const std::vector<TargetKeys> types = {{"chessboard", {"rows", "columns", "square"}, {}, "square"},
                                                {"circles", {"rows", "columns", "spacing"}, {"asymmetric"}, "spacing"},
                                                {"charuco", {"rows", "columns", "square", "marker", "dictionary"}, {}, "square"},
                                                {"apriltag_grid", {"rows", "columns", "tag", "spacing", "family"}, {}, "tag"},
                                                {"points", {"points"}, {}, ""}};
  return types;
}

const std::vector<SensorKeys>& sensor_types() {
  static const std::vector<SensorKeys> types = {
      {"camera", {"model", "intrinsics", "sigma"}, {"image_size", "distortion", "baseline"}, "pixels"},
      {"point", {"sigma"}, {}, "points"},
      {"pose", {"sigma"}, {}, "pose"},
      {"chain", {"sigma"}, {}, ""},
      {"tilting_laser", {"joint", "sigma"}, {}, "rays"}};
  return types;
}

std::string payload_of(const Sensor& sensor) {
  const SensorKeys* keys = find_type(sensor_types(), sensor.type);
  return keys ? keys->payload : "points";
}

Names sigma_names(const std::string& type) {
  if (type == "tilting_laser") return {"joint", "bearing", "range"};
  return type == "pose" || type == "chain" ? Names{"translation", "rotation"} : Names{};
}

std::vector<double> read_sigma(const Field& field, const std::string& type) {
  const Names names = sigma_names(type);
  if (names.empty()) {
    const bool list = type == "point" && field.node->kind == Node::Kind::sequence;
    if (!list) return std::vector<double>(type == "camera" ? 2 : 3, field.positive());
    const std::vector<double> sigma = field.vector(3);
    for (size_t i = 0; i < 3; ++i) field.item(i).positive();
    return sigma;
  }
  if (field.node->kind != Node::Kind::mapping)
    field.fail("a " + type + " takes {" + comma_separated(names) + "}, each a number greater than 0");
  field.check_keys(names);
  std::vector<double> sigma;
  for (const std::string& name : names) sigma.insert(sigma.end(), names.size() == 2 ? 3 : 1, field[name].positive());
  return sigma;
}

}  // namespace kincal
