#include "data_checks.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "../estimation/estimation.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "survey.h"

namespace kincal {
namespace {

/// Which sensors and targets samples tie together: nodes, first the sensors, then the targets. Two
/// are tied if one sees the other, or if both see the same free target in one sample.
struct Connections {
  int sensors = 0;
  std::vector<char> seen;   // by node: it takes part in some view
  std::vector<int> parent;  // by node; a root stands for all that are tied to it

  explicit Connections(const Recording& recording);

  int nodes() const { return static_cast<int>(parent.size()); }
  int root(int i) { return parent[i] == i ? i : parent[i] = root(parent[i]); }
};

Connections::Connections(const Recording& recording)
    : sensors(static_cast<int>(recording.rig.sensors.size())) {
  const Rig& rig = recording.rig;
  parent = indices(rig.sensors.size() + rig.targets.size());
  seen.assign(parent.size(), 0);
  for (const Sample& s : recording.samples) {
    std::map<int, int> hub;  // free target: a sensor that sees it in this sample
    for (const View& v : s.views) {
      seen[v.sensor] = 1;
      int other = sensors + v.target;
      if (rig.targets[v.target].link < 0) other = hub.insert({v.target, v.sensor}).first->second;
      seen[other] = 1;
      parent[root(v.sensor)] = root(other);
    }
  }
}

Finding disconnected(const std::vector<std::string>& where, const std::string& what,
                     const std::string& cure) {
  Finding f;
  f.id = "disconnected";
  f.where = where;
  f.text = what + " " + cure;
  return f;
}

/// By parameter: it places something.
std::vector<char> placing_parameters(const ParameterTable& table) {
  std::vector<char> places(table.all.size(), 0);
  for (size_t p = 0; p < table.all.size(); ++p) switch (table.all[p].kind) {
      case ParameterKind::joint_offset:
      case ParameterKind::joint_scale:
      case ParameterKind::joint_shape:
      case ParameterKind::joint_origin:
      case ParameterKind::sensor_pose:
      case ParameterKind::target_pose:
        places[p] = 1;
        break;
      default:
        break;
    }
  return places;
}

/// By parameter: some view of the chosen sensors depends on it.
std::vector<char> influencing(const Recording& recording, const Connections& connections,
                              const std::function<bool(int)>& wanted) {
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  for (int s = 0; s < connections.sensors; ++s)
    if (connections.seen[s] && wanted(s)) setup.sensors.push_back(s);
  const Estimation probe(recording, indices(recording.samples.size()), setup);
  return probe.groups().empty() ? std::vector<char>(recording.table.all.size(), 0)
                                : probe.influencing();
}

/// What to do for a sensor that alone sees free targets.
std::string mount_first(const Rig& rig, const std::vector<Sample>& samples, int sensor) {
  std::set<std::string> free;
  for (const Sample& s : samples)
    for (const View& v : s.views)
      if (v.sensor == sensor && rig.targets[v.target].link < 0)
        free.insert(rig.targets[v.target].name);
  if (free.empty()) return "";
  return "Mount " + joined({free.begin(), free.end()}) +
         " (`mount: {link: NAME}`) on the link that carries it, the base if it stands still: free, "
         "it has a pose of its own in every sample, which explains all that one sensor sees.";
}

/// Appends what is tied together, stands on one body and has nothing in it whose place is held.
void check_anchors(const Recording& recording, const FreedNames& freed, Connections& connections,
                   std::vector<Finding>& out) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  const int sensors = connections.sensors;
  std::map<int, std::vector<int>> components;
  for (int i = 0; i < connections.nodes(); ++i)
    if (connections.seen[i]) components[connections.root(i)].push_back(i);
  const std::vector<char> places = placing_parameters(table);
  for (const auto& component : components) {
    std::set<int> bodies;
    for (int i : component.second)
      bodies.insert(immobile_body(
          rig.tree, i < sensors ? rig.sensors[i].link : rig.targets[i - sensors].link));
    if (bodies.size() != 1) continue;
    const std::vector<char> inside = influencing(
        recording, connections, [&](int s) { return connections.root(s) == component.first; });
    const std::vector<char> elsewhere = influencing(
        recording, connections, [&](int s) { return connections.root(s) != component.first; });
    bool anchor = false;
    std::vector<std::string> names, parameters;
    for (int i : component.second) {
      names.push_back(i < sensors ? rig.sensors[i].name : rig.targets[i - sensors].name);
      bool open = false;
      if (i < sensors) {
        const std::vector<char> own =
            influencing(recording, connections, [&](int s) { return s == i; });
        for (size_t p = 0; p < table.all.size(); ++p) {
          const bool target = std::count(table.target_mount.begin(), table.target_mount.end(), p);
          if (!own[p] || !inside[p] || elsewhere[p] || !freed.parameter[p] || !places[p] || target)
            continue;
          open = true;
          if (!std::count(parameters.begin(), parameters.end(), table.all[p].name))
            parameters.push_back(table.all[p].name);
        }
      } else if (freed.parameter[table.target_mount[i - sensors]]) {
        open = true;
        parameters.push_back(table.all[table.target_mount[i - sensors]].name);
      }
      anchor = anchor || !open;
    }
    if (anchor) continue;
    if (components.size() == 1 && names.size() > 1) {
      out.push_back(disconnected(
          names,
          "Where " + joined(names) +
              " are together is a choice: they are tied to each other, but all that they see is "
              "free, and " +
              joined(parameters) + " are freed.",
          "Hold one of these, as " + parameters[0] +
              ": the others are found from it. Cameras and boards without a robot are calibrated "
              "by kincal intrinsics."));
      continue;
    }
    const std::string first = component.second.size() == 1 && component.second[0] < sensors
                                  ? mount_first(rig, recording.samples, component.second[0])
                                  : "";
    out.push_back(
        disconnected(names,
                     (names.size() == 1 ? "Sensor " : "") + joined(names) +
                         (names.size() == 1 ? " is" : " are") +
                         " tied to nothing else: no other sensor sees the same target in the same "
                         "sample, and no mounted target is in view from another "
                         "link, but the rig frees " +
                         joined(parameters) + ".",
                     (first.empty() ? "Take" : first + " Or take") +
                         " samples in which it and another sensor see one target, or hold these."));
  }
}

}  // namespace

std::vector<Finding> find_duplicates(const Rig& rig, const std::vector<Sample>& samples) {
  struct Key {
    std::vector<double> numbers;
    bool operator<(const Key& o) const { return numbers < o.numbers; }
  };
  std::map<Key, std::vector<std::string>> same;
  std::vector<const Key*> order;
  for (const Sample& s : samples) {
    Key key;
    bool measured = false;
    for (double q : s.readings) key.numbers.push_back(std::isnan(q) ? kInfinity : q);
    std::vector<std::vector<double>> views;
    for (const View& v : s.views) {
      std::vector<double> one = {static_cast<double>(v.sensor), static_cast<double>(v.target)};
      one.insert(one.end(), v.ids.begin(), v.ids.end());
      one.insert(one.end(), v.z.begin(), v.z.end());
      measured = measured || std::any_of(v.z.begin(), v.z.end(), [](double z) { return z != 0; });
      views.push_back(std::move(one));
    }
    if (!measured && std::any_of(s.views.begin(), s.views.end(), [&](const View& v) {
          return rig.sensors[v.sensor].model->measurement_kind() == MeasurementKind::chain;
        }))
      continue;
    if (s.views.empty()) continue;
    std::sort(views.begin(), views.end());
    for (const auto& v : views) key.numbers.insert(key.numbers.end(), v.begin(), v.end());
    const auto found = same.try_emplace(std::move(key)).first;
    if (found->second.empty()) order.push_back(&found->first);
    found->second.push_back(s.id);
  }
  Finding f;
  f.id = "duplicates";
  size_t measurements = 0;
  const std::vector<std::string>* worst = nullptr;
  for (const Key* key : order) {
    const std::vector<std::string>& ids = same[*key];
    if (ids.size() < 2) continue;
    ++measurements;
    f.where.insert(f.where.end(), ids.begin(), ids.end());
    if (!worst || ids.size() > worst->size()) worst = &ids;
  }
  if (!worst) return {};
  if (measurements > 1)
    f.text = std::to_string(f.where.size()) + " samples are " + std::to_string(measurements) +
             " measurements under several ids each, worst: ";
  f.text += "Samples " + joined(*worst) +
            " are the same: joint readings and measured numbers. They count as " +
            std::to_string(worst->size()) + " measurements but are one; leave out all but one" +
            (measurements > 1 ? " of each." : ".");
  return {f};
}

void check_still_joints(const Recording& recording, const FreedNames& freed,
                        std::vector<Finding>& out) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  const Survey survey = make_survey(rig, recording.samples);
  for (const auto& r : survey.ranges) {
    const int j = r.first;
    const size_t samples = survey.samples.at(j).size();
    if (samples < 2 || r.second.second - r.second.first > std::max(1e-6, 3 * rig.joints[j].sigma))
      continue;
    std::vector<std::string> names;
    for (int k = 0; table.joint_offset[j] >= 0 && k < rig.joints[j].model->size(); ++k)
      if (freed.parameter[table.joint_offset[j] + k])
        names.push_back(table.all[table.joint_offset[j] + k].name);
    if (freed.parameter[table.joint_origin[j]] && !freed.whole[table.joint_origin[j]])
      names.push_back(table.all[table.joint_origin[j]].name);
    if (names.empty()) continue;
    Finding f;
    f.id = "still-joint";
    f.where = {rig.tree.joints[j].name};
    f.text = "Joint " + quoted(rig.tree.joints[j].name) + " never moves" +
             text(" (it reads %.6g in all ", r.second.first) + std::to_string(samples) +
             " samples that need it), but the rig frees " + joined(names) +
             ". Take samples in which it moves, or hold " + (names.size() == 1 ? "it" : "them") +
             "; if it did move, the log is wrong.";
    out.push_back(std::move(f));
  }
}

void check_connections(const Recording& recording, const FreedNames& freed,
                       const std::vector<int>& sensors, std::vector<Finding>& out) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  Connections connections(recording);
  for (int s : sensors)
    if (!connections.seen[s] && freed.parameter[table.sensor_mount[s]])
      out.push_back(
          disconnected({rig.sensors[s].name},
                       "Sensor " + quoted(rig.sensors[s].name) +
                           " has no view in any sample, but the rig frees its pose.",
                       "Add views of it, or hold " + table.all[table.sensor_mount[s]].name + "."));
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (rig.targets[t].link >= 0 && !connections.seen[connections.sensors + t] &&
        freed.parameter[table.target_mount[t]])
      out.push_back(
          disconnected({rig.targets[t].name},
                       "Target " + quoted(rig.targets[t].name) +
                           " is seen in no sample, but the rig frees its pose.",
                       "Add views of it, or hold " + table.all[table.target_mount[t]].name + "."));
  check_anchors(recording, freed, connections, out);
}

}  // namespace kincal
