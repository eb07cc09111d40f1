#include "simulation_file.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <unordered_map>

#include "../../kinematics/floating.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/targets.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/kinds.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "conditions_entry.h"
#include "samples_file.h"

namespace kincal {
namespace {

constexpr double kNoReading = std::numeric_limits<double>::quiet_NaN();
constexpr double kNoIncrement = 1e-14;  // rounding of an increment that is 0

// ------------------------------------------------------------------------------------------------
// postures
template <class T>
int index_of(const Field& where, const std::string& name, const std::vector<T>& things,
             const std::string& what) {
  std::vector<std::string> names;
  for (size_t i = 0; i < things.size(); ++i) {
    if (things[i].name == name) return static_cast<int>(i);
    names.push_back(things[i].name);
  }
  where.fail("unknown " + what + " '" + name + "'" + nearest_or_all(name, names, "the rig has"));
}

std::vector<double> read_joints(const Field& field, const Tree& tree) {
  if (field.node->kind != Node::Kind::mapping)
    field.fail("a mapping of joint names to readings is expected");
  std::vector<double> readings(tree.joints.size(), kNoReading);
  for (const auto& [name, node] : field.node->members) {
    const Field reading{&node, field.path, field.name + "." + name};
    const Joint& joint = tree.joints[index_of(reading, name, tree.joints, "joint")];
    const int j = static_cast<int>(&joint - tree.joints.data());
    if (joint.first_axis >= 0) {
      set_pose_reading(tree, j, read_pose_reading(reading), readings);
      continue;
    }
    if (!joint.has_reading())
      reading.fail(joint.mimic ? "a mimic joint has no reading of its own"
                               : "the joint does not move");
    readings[j] = reading.number();
  }
  return readings;
}

void read_views(const Field& field, const Rig& rig, Posture& posture) {
  if (field.node->kind != Node::Kind::sequence) field.fail("a list of views is expected");
  std::set<int> held;
  for (size_t i = 0; i < field.size(); ++i) {
    const Field view = field.item(i);
    view.check_keys({"sensor", "target"});
    const int s = index_of(view["sensor"], view["sensor"].string(), rig.sensors, "sensor");
    const int t = index_of(view["target"], view["target"].string(), rig.targets, "target");
    const std::pair<int, int> pair{s, t};
    if (std::find(posture.views.begin(), posture.views.end(), pair) != posture.views.end())
      view.fail("the view occurs twice");
    posture.views.push_back(pair);
    for (int j : needed_readings(rig, s, t))
      if (std::isnan(posture.readings[j]))
        view.fail("needs joint '" + read_name(rig.tree, j) + "', which the posture lacks");
    if (rig.sensors[s].model->measurement_kind() != MeasurementKind::chain) continue;
    const Target& target = rig.targets[t];
    if (target.link >= 0)
      view["target"].fail("a chain holds free targets only, '" + target.name +
                          "' is mounted on link '" + rig.tree.links[target.link] + "'");
    if (on_a_line(target.grid ? target.layout : target.points))
      view["target"].fail("a chain needs a target with three points not on a line, '" +
                          target.name + "' has none");
    if (posture.targets.count(t))
      view.fail("target '" + target.name +
                "' has a pose in 'targets'; a chain that holds it gives another");
    held.insert(t);
  }
  for (size_t i = 0; i < field.size(); ++i) {
    const int t = posture.views[i].second;
    if (rig.targets[t].link < 0 && !held.count(t) && !posture.targets.count(t))
      field.item(i)["target"].fail(
          "'" + rig.targets[t].name +
          "' is free: a view of a chain that holds it, or its pose in 'targets', is needed");
  }
}

/// Poses of free targets.
std::map<int, Pose> read_places(const Field& targets, const Rig& rig) {
  if (targets.node->kind != Node::Kind::mapping)
    targets.fail("a mapping of target names to poses is expected");
  std::map<int, Pose> out;
  for (const auto& [name, node] : targets.node->members) {
    const Field pose{&node, targets.path, targets.name + "." + name};
    const int t = index_of(pose, name, rig.targets, "target");
    if (rig.targets[t].link >= 0)
      pose.fail("the target is mounted on link '" + rig.tree.links[rig.targets[t].link] + "'");
    out[t] = pose.pose();
  }
  return out;
}

Posture read_posture(const Field& field, const Rig& rig) {
  std::vector<std::string> optional = {"views", "targets", "from"};
  optional.insert(optional.end(), condition_keys().begin(), condition_keys().end());
  field.check_keys({"id", "joints"}, optional);
  Posture posture;
  if (!field["id"].node->quoted) field["id"].fail("a string is expected, e.g. \"posture_7\"");
  posture.id = field["id"].string();
  posture.readings = read_joints(field["joints"], rig.tree);
  if (field.has("from")) posture.from = read_joints(field["from"], rig.tree);
  posture.conditions = read_conditions(field, rig);
  if (field.has("targets")) posture.targets = read_places(field["targets"], rig);
  if (field.has("views")) read_views(field["views"], rig, posture);
  return posture;
}

// ------------------------------------------------------------------------------------------------
// truth
/// A number or a list of `size` numbers; of points also a list of x y z.
std::vector<double> read_numbers(const Field& field, int size) {
  if (size == 1 && field.node->kind != Node::Kind::sequence) return {field.number()};
  const bool rows = size % 3 == 0 && field.node->kind == Node::Kind::sequence &&
                    !field.node->items.empty() && field.node->items[0].kind == Node::Kind::sequence;
  if (!rows) return field.vector(size);
  const std::vector<double> numbers = field.table(3);
  if (static_cast<int>(numbers.size()) != size)
    field.fail(std::to_string(size / 3) + " points are expected");
  return numbers;
}

/// Puts those of the absolute values in their places that are `absolute`; all must be proper.
void read_values(const Field& values, const ParameterTable& table, const std::vector<int>& absolute,
                 VectorXd& truth) {
  for (const auto& [name, node] : values.members()) {
    const Field field = values[name];
    const auto found =
        std::find_if(table.all.begin(), table.all.end(),
                     [&, &wanted = name](const Parameter& p) { return p.name == wanted; });
    if (found == table.all.end())
      field.fail("unknown parameter '" + name + "'" + nearest_names(name, table.names()));
    const bool counts = std::count(absolute.begin(), absolute.end(), found - table.all.begin()) > 0;
    if (found->pose) {
      const Pose pose = field.pose();
      if (counts) set_pose(truth, found->start, pose);
      continue;
    }
    const std::vector<double> numbers = read_numbers(field, found->size());
    for (int c = 0; c < found->size(); ++c) {
      if (const char* why = improper_value(*found, c, numbers[c])) field.fail(why);
      if (counts) truth(found->start + c) = numbers[c];
    }
  }
}

/// Names may hold bytes that are no UTF-8; these are replaced.
std::string json_name(const std::string& text) {
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// Entries of a JSON mapping, one a line.
class Lines {
 public:
  void add(const std::string& name, const std::string& value) {
    text_ += (text_.empty() ? "\n  " : ",\n  ") + json_name(name) + ": " + value;
  }
  std::string text() const { return "{" + text_ + (text_.empty() ? "}" : "\n }"); }

 private:
  std::string text_;
};

}  // namespace

std::vector<Posture> read_postures(const std::string& path, const Rig& rig) {
  return parse_postures(read_file(path), path, rig);
}

std::vector<Posture> parse_postures(const std::string& text, const std::string& path,
                                    const Rig& rig) {
  std::vector<Posture> postures;
  refuse_other_kinds(text, path, Wanted::postures);
  for_each_json_line(text, path, [&](const Field& field) {
    postures.push_back(read_posture(field, rig));
    return postures.back().id;
  });
  if (postures.empty()) throw InputError(path + ": no postures");
  return postures;
}

VectorXd read_truth(const std::string& path, const ParameterTable& table) {
  return parse_truth(read_file(path), path, table);
}

VectorXd parse_truth(const std::string& text, const std::string& path, const ParameterTable& table,
                     const std::vector<int>& absolute) {
  refuse_other_kinds(text, path, Wanted::truth);
  const Node node = parse_json(text, path);
  const Field all = top(node, path);
  all.check_keys({"parameters"}, {"about", "values", "samples"});
  const Field parameters = all["parameters"];
  if (parameters.node->kind != Node::Kind::mapping)
    parameters.fail("a mapping of parameter names to values is expected");

  struct Place {
    int parameter, component;  // -1: all
  };
  std::unordered_map<std::string, Place> places;
  std::vector<std::vector<double>> values(
      table.all.size());  // components of what is named, NaN: not named
  for (int i = 0; i < static_cast<int>(table.all.size()); ++i) {
    const Parameter& p = table.all[i];
    values[i].assign(p.size(), kNoReading);
    for (int c = 0; c < p.size(); ++c) places.emplace(p.component_name(c), Place{i, c});
    places[p.name] = {i, -1};
  }
  for (const auto& [name, value] : parameters.node->members) {
    Field field{&value, parameters.path, parameters.name + "." + name};
    const auto place = places.find(name);
    if (place == places.end())
      field.fail("unknown parameter '" + name + "'" + nearest_names(name, table.names()));
    if (value.kind == Node::Kind::mapping) {
      field.check_keys({"true"}, {"initial"});
      field = field["true"];
    }
    const Parameter& p = table.all[place->second.parameter];
    const bool whole = place->second.component < 0;
    const int first = whole ? 0 : place->second.component;
    const std::vector<double> numbers =
        whole ? read_numbers(field, p.size()) : std::vector<double>{field.number()};
    for (size_t k = 0; k < numbers.size(); ++k) {
      const int c = first + static_cast<int>(k);
      double& slot = values[place->second.parameter][c];
      if (!std::isnan(slot)) field.fail("'" + p.component_name(c) + "' occurs twice");
      slot = numbers[k];
      if (const char* why = improper_value(p, c, slot)) field.fail(why);
    }
  }
  VectorXd truth = table.initial;
  for (size_t i = 0; i < table.all.size(); ++i) {
    const Parameter& p = table.all[i];
    Vector6d increment = Vector6d::Zero();
    for (int c = 0; c < p.size(); ++c) {
      if (std::isnan(values[i][c])) continue;
      if (p.pose)
        increment(c) = values[i][c];
      else
        truth(p.start + c) = values[i][c];
    }
    if (!increment.isZero(0))
      set_pose(truth, p.start, get_pose(truth, p.start) * exp_se3(increment));
  }
  if (all.has("values")) read_values(all["values"], table, absolute, truth);
  return truth;
}

std::map<std::string, Posture> read_true_postures(const std::string& path, const Rig& rig) {
  const std::string text = read_file(path);
  refuse_other_kinds(text, path, Wanted::truth);
  const Node node = parse_json(text, path);
  const Field samples = top(node, path)["samples"];
  std::map<std::string, Posture> out;
  for (const auto& [id, value] : samples.members()) {
    const Field sample{&value, samples.path, samples.name + "." + id};
    std::vector<std::string> optional = condition_keys();
    optional.push_back("targets");
    sample.check_keys({"joints"}, optional);
    Posture& posture = out[id];
    posture.id = id;
    posture.readings = read_joints(sample["joints"], rig.tree);
    posture.conditions = read_conditions(sample, rig);
    if (sample.has("targets")) posture.targets = read_places(sample["targets"], rig);
  }
  return out;
}

namespace {

std::string true_pose_text(const Pose& pose) {
  const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
  return "{\"xyz\": " + list_text(pose.translation.data(), 3) +
         ", \"quat\": " + list_text(q.data(), 4) + "}";
}

/// The value of a sensor's or target's parameter; "" of any other.
std::string value_text(const Parameter& p, const VectorXd& values) {
  const bool of_joint = p.kind < ParameterKind::sensor_pose;
  if (of_joint || p.hidden() || p.replaced_by >= 0) return "";
  return p.pose ? true_pose_text(get_pose(values, p.start))
                : list_text(values.data() + p.start, p.size());
}

}  // namespace

std::string truth_text(const Rig& rig, const ParameterTable& table, const Simulation& simulation) {
  Lines parameters, values, samples;
  for (const Parameter& p : table.all) {
    if (const std::string value = value_text(p, simulation.truth); !value.empty())
      values.add(p.name, value);
    Vector6d increment = Vector6d::Zero();
    if (p.pose)
      increment =
          log_se3(inverse(get_pose(table.initial, p.start)) * get_pose(simulation.truth, p.start));
    for (int c = 0; c < p.size(); ++c) {
      const double initial = p.pose ? 0 : table.initial(p.start + c),
                   value = p.pose ? increment(c) : simulation.truth(p.start + c);
      if (p.pose ? std::abs(value) <= kNoIncrement : value == initial) continue;
      parameters.add(p.component_name(c),
                     "{\"initial\": " + shortest(initial) + ", \"true\": " + shortest(value) + "}");
    }
  }
  for (size_t k = 0; k < simulation.samples.size(); ++k) {
    std::string targets;
    const int sample = static_cast<int>(k);
    for (auto t = simulation.targets.lower_bound({sample, 0});
         t != simulation.targets.end() && t->first.first == sample; ++t)
      targets += (targets.empty() ? "" : ", ") + json_name(rig.targets[t->first.second].name) +
                 ": " + true_pose_text(t->second);
    samples.add(simulation.samples[k].id,
                "{\"joints\": " + readings_text(rig.tree, simulation.true_readings[k]) +
                    conditions_text(rig, simulation.samples[k].conditions) + ", \"targets\": {" +
                    targets + "}}");
  }
  return "{\n \"about\": \"What the simulated robot really is. parameters: all that differ from "
         "the rig; poses as increments from the "
         "rig's "
         "value, in the frame itself. values: those of sensors and targets, poses as link_T_frame. "
         "samples: readings without noise; poses of free targets in "
         "the rig's base frame.\",\n "
         "\"parameters\": " +
         parameters.text() + ",\n \"values\": " + values.text() +
         ",\n \"samples\": " + samples.text() + "\n}\n";
}

}  // namespace kincal
