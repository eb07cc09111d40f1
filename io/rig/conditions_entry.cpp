#include "conditions_entry.h"

#include <algorithm>

#include "../document/json.h"
#include "../document/names.h"
#include "../document/numbers.h"

namespace kincal {
namespace {

// Degrees Celsius: no robot works colder or hotter; 200 K and more are.
constexpr double kColdest = -100, kHottest = 200, kZeroCelsius = 273.15;

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
  static const std::vector<std::string> keys = {"approach", "rates", "temperature", "payload"};
  return keys;
}

int read_link(const Field& field, const Tree& tree) {
  const std::string name = field.string();
  const int link = tree.find_link(name);
  if (link < 0)
    field.fail("unknown link '" + name + "'" + nearest_or_all(name, tree.links, "the robot has"));
  return link;
}

std::vector<Payload> read_payloads(const Field& field, const Tree& tree) {
  constexpr double kHeaviest = 5000, kFarthest = 10;  // kg, m: beyond those of any arm
  std::vector<Payload> out;
  for (const auto& member : field.members()) {
    const Field entry = field[member.first];
    entry.check_keys({"link", "mass"}, {"com"});
    Payload payload;
    payload.name = member.first;
    payload.link = read_link(entry["link"], tree);
    payload.mass = entry["mass"].number();
    if (!(payload.mass > 0 && payload.mass <= kHeaviest))
      entry["mass"].fail("kilograms are expected, more than 0 and at most " + shortest(kHeaviest) +
                         ", not " + shortest(payload.mass));
    if (entry.has("com")) payload.centre = Vector3d(entry["com"].vector(3).data());
    if (payload.centre.norm() > kFarthest)
      entry["com"].fail("the centre of mass is expected in metres, at most " + shortest(kFarthest) +
                        " from the link's origin");
    out.push_back(std::move(payload));
  }
  return out;
}

int find_payload(const Rig& rig, const std::string& name, const std::string& where) {
  std::vector<std::string> valid;
  for (size_t i = 0; i < rig.payloads.size(); ++i) {
    valid.push_back(rig.payloads[i].name);
    if (valid.back() == name) return static_cast<int>(i);
  }
  throw InputError(where + ": " +
                   (valid.empty() ? "the rig has no `payloads`"
                                  : "unknown payload '" + name + "'" +
                                        nearest_or_all(name, valid, "the rig has")));
}

Conditions read_conditions(const Field& sample, const Rig& rig) {
  const Tree& tree = rig.tree;
  Conditions out;
  if (sample.has("payload")) {
    const Field entry = sample["payload"];
    out.payload = find_payload(rig, entry.string(), entry.where());
  }
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
  if (sample.has("temperature")) {
    const Field entry = sample["temperature"];
    out.temperature = entry.number();
    if (!(*out.temperature >= kColdest && *out.temperature <= kHottest))
      entry.fail("degrees Celsius are expected, " + shortest(kColdest) + " to " +
                 shortest(kHottest) + ", not " + shortest(*out.temperature) +
                 (*out.temperature > kHottest
                      ? " (kelvin? then it is " + shortest(*out.temperature - kZeroCelsius) + ")"
                      : ""));
  }
  return out;
}

std::vector<std::string> joint_keys(const JointModels& models) {
  std::vector<std::string> keys = {"sigma",       "offset",     "scale",  "model",   "backlash",
                                   "temperature", "gear_ratio", "ripple", "coupling"};
  for (const auto& model : models)
    for (const JointNumber& number : model->extra_parameters()) keys.push_back(number.name);
  return keys;
}

void read_terms(const Field& entry, const Tree& tree, int joint, JointTerms& terms) {
  if (entry.has("backlash")) terms.backlash = entry["backlash"].number();
  if (entry.has("temperature")) terms.temperature = entry["temperature"].number();
  if (entry.has("gear_ratio")) {
    const Field ratios = entry["gear_ratio"];
    terms.gear_ratios = ratios.node->kind == Node::Kind::scalar
                            ? std::vector<double>{ratios.number()}
                            : ratios.vector();
    if (tree.joints[joint].type == JointType::prismatic)
      ratios.fail("joint '" + tree.joints[joint].name +
                  "' slides; a gear ratio is one of a joint that turns");
    for (const double ratio : terms.gear_ratios)
      if (!(ratio > 0)) ratios.fail("a ratio greater than 0 is expected, not " + shortest(ratio));
    for (const double& a : terms.gear_ratios)
      for (const double& b : terms.gear_ratios)
        if (a == 2 * b || (a == b && &a < &b))
          ratios.fail(shortest(a) + " cycles in a turn are those of " + shortest(b) +
                      (a == b ? " again" : ", twice as many; state one of them"));
    terms.ripple.assign(kRipple * terms.gear_ratios.size(), 0);
  }
  if (entry.has("ripple")) {
    if (terms.gear_ratios.empty())
      entry["ripple"].fail("joint '" + tree.joints[joint].name + "' has no gear_ratio");
    terms.ripple = entry["ripple"].vector(static_cast<int>(kRipple * terms.gear_ratios.size()));
  }
  if (!entry.has("coupling")) return;
  const Field coupling = entry["coupling"];
  if (coupling.node->kind != Node::Kind::mapping)
    coupling.fail("a mapping of joint names to numbers is expected");
  const auto slides = [&](int j) { return tree.joints[j].type == JointType::prismatic; };
  std::vector<std::string> valid;
  for (int j = 0; j < static_cast<int>(tree.joints.size()); ++j)
    if (j != joint && tree.joints[j].has_reading() && tree.joints[j].first_axis < 0 &&
        slides(j) == slides(joint))
      valid.push_back(tree.joints[j].name);
  terms.coupled_to.clear();
  terms.coupling.clear();
  for (const auto& [name, node] : coupling.node->members) {
    const Field share{&node, coupling.path, coupling.name + "." + name};
    if (std::find(valid.begin(), valid.end(), name) == valid.end())
      share.fail("'" + name + "' is no other joint that " + (slides(joint) ? "slides" : "turns") +
                 " and has a reading" + nearest_or_all(name, valid, "there are"));
    terms.coupled_to.push_back(tree.find_joint(name));
    terms.coupling.push_back(share.number());
  }
}

void check_terms_of_scanning(const Field& joints, const Rig& rig) {
  for (const Sensor& sensor : rig.sensors)
    for (size_t j = 0; sensor.scanning_joint >= 0 && j < rig.joints.size(); ++j) {
      const JointTerms& terms = rig.joints[j].terms;
      const bool scans = sensor.scanning_joint == static_cast<int>(j);
      if ((scans && (!terms.ripple.empty() || !terms.coupling.empty())) ||
          std::count(terms.coupled_to.begin(), terms.coupled_to.end(), sensor.scanning_joint))
        joints.fail("joint '" + rig.tree.joints[j].name + "': sensor '" + sensor.name +
                    "' scans with joint '" + rig.tree.joints[sensor.scanning_joint].name +
                    "', which can have no gear_ratio and no coupling");
    }
}

void read_times(const Field& field, Sensor& sensor) {
  if (field.has("time_offset")) {
    if (sensor.model->measurement_kind() == MeasurementKind::chain)
      field["time_offset"].fail("a chain measures the readings themselves: it has no time offset");
    sensor.time_offset = field["time_offset"].number();
  }
  if (!field.has("line_time")) return;
  constexpr double kSlowest = 1e-3;  // s a row: an image of 1,000 rows took a second
  sensor.line_time = field["line_time"].number();
  if (std::abs(*sensor.line_time) > kSlowest)
    field["line_time"].fail("seconds from one row of the image to the next are expected, " +
                            shortest(kSlowest) + " at most (about 2e-5)");
}

std::string conditions_text(const Rig& rig, const Conditions& conditions) {
  return by_joint("approach", rig.tree, conditions.approach) +
         by_joint("rates", rig.tree, conditions.rates) +
         (conditions.temperature ? ", \"temperature\": " + shortest(*conditions.temperature) : "") +
         (conditions.payload >= 0
              ? ", \"payload\": " + json_string(rig.payloads[conditions.payload].name)
              : "");
}

}  // namespace kincal
