#include "conditions_entry.h"

#include "../document/json.h"
#include "../document/names.h"
#include "../document/numbers.h"

namespace kincal {
namespace {

/// Numbers by joint. A joint that the robot lacks is left as its reading is. `check` fails on wrong
/// numbers.
template <class Check>
std::vector<double> read_by_joint(const Field& field, const Field& joints, const Tree& tree,
                                  const Check& check) {
  if (field.node->kind != Node::Kind::mapping)
    field.fail("a mapping of joint names to numbers is expected");
  std::vector<double> out(tree.joints.size(), 0);
  for (const auto& [name, node] : field.node->members) {
    const Field entry{&node, field.path, field.name + "." + name};
    const int j = tree.find_joint(name);
    if (j < 0 && joints.has(name)) continue;
    std::vector<std::string> valid;
    for (const Joint& joint : tree.joints)
      if (joint.has_reading()) valid.push_back(joint.name);
    if (j < 0)
      entry.fail("unknown joint '" + name + "'" + nearest_or_all(name, valid, "the robot has"));
    if (!tree.joints[j].has_reading())
      entry.fail("joint '" + name +
                 "' has no reading of its own; joints with one: " + comma_separated(valid));
    out[j] = entry.number();
    check(entry, out[j]);
  }
  return out;
}

std::string by_joint(const char* key, const Tree& tree, const std::vector<double>& values) {
  std::string out;
  for (size_t j = 0; j < values.size(); ++j)
    if (values[j] != 0)
      out +=
          (out.empty() ? "" : ", ") + json_string(tree.joints[j].name) + ": " + shortest(values[j]);
  return out.empty() ? out : ", \"" + std::string(key) + "\": {" + out + "}";
}

}  // namespace

const std::vector<std::string>& condition_keys() {
  static const std::vector<std::string> keys = {"approach", "rates"};
  return keys;
}

Conditions read_conditions(const Field& sample, const Tree& tree) {
  Conditions out;
  const Field joints = sample["joints"];
  if (sample.has("approach"))
    out.approach =
        read_by_joint(sample["approach"], joints, tree, [](const Field& entry, double value) {
          if (value != 1 && value != -1)
            entry.fail("the direction of the joint's last motion, 1 or -1, is expected, not " +
                       shortest(value));
        });
  if (sample.has("rates"))
    out.rates = read_by_joint(sample["rates"], joints, tree, [](const Field&, double) {});
  return out;
}

std::optional<double> read_time_offset(const Field& sensor, const SensorModel& model) {
  if (!sensor.has("time_offset")) return std::nullopt;
  if (model.measurement_kind() == MeasurementKind::chain)
    sensor["time_offset"].fail("a chain measures the readings themselves: it has no time offset");
  return sensor["time_offset"].number();
}

std::string conditions_text(const Tree& tree, const Conditions& conditions) {
  return by_joint("approach", tree, conditions.approach) +
         by_joint("rates", tree, conditions.rates);
}

}  // namespace kincal
