#include "data_checks.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <tuple>

#include "../../kinematics/floating.h"
#include "../estimation/estimation.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "observation_index.h"

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

/// By parameter: it places something.
std::vector<char> placing_parameters(const ParameterTable& table) {
  std::vector<char> places(table.all.size(), 0);
  for (size_t p = 0; p < table.all.size(); ++p) switch (table.all[p].kind) {
      case ParameterKind::joint_offset:
      case ParameterKind::joint_scale:
      case ParameterKind::joint_shape:
      case ParameterKind::backlash:
      case ParameterKind::temperature:
      case ParameterKind::ripple:
      case ParameterKind::coupling:
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
  return "mount " + joined({free.begin(), free.end()}) +
         " (`mount: {link: NAME}`) on the link that carries it, the base if it stands still: a "
         "free target has its own pose in every sample, which explains all views of one sensor";
}

/// Appends what is tied together, stands on one body and has nothing in it whose place is held.
void check_anchors(const Recording& recording, const FreedNames& freed, Connections& connections,
                   std::vector<Notice>& out) {
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
    Subjects where;
    std::vector<std::string> parameters;
    for (int i : component.second) {
      where.push_back(i < sensors ? Subject::sensor(rig.sensors[i].name)
                                  : Subject::target(rig.targets[i - sensors].name));
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
    const std::string all = joined(names_of(where));
    if (components.size() == 1 && where.size() > 1) {
      out.push_back(make_notice(
          NoticeKind::disconnected, std::move(where),
          "where " + all +
              " are together is not determined: they are connected to each other, but all their "
              "targets are free, and " +
              joined(parameters) + " are estimated",
          "",
          "fix one of these, as " + parameters[0] +
              ": the others are found from it. Cameras and boards without a robot are calibrated "
              "by kincal intrinsics"));
      continue;
    }
    const std::string first = component.second.size() == 1 && component.second[0] < sensors
                                  ? mount_first(rig, recording.samples, component.second[0])
                                  : "";
    out.push_back(make_notice(
        NoticeKind::disconnected, where,
        (where.size() == 1 ? "sensor " : "") + all + (where.size() == 1 ? " is" : " are") +
            " connected to nothing else: no other sensor sees the same target in the same sample, "
            "and no mounted target is in view from another link, but the rig estimates " +
            joined(parameters),
        "",
        (first.empty() ? "take" : first + ". Or take") +
            " samples in which it and another sensor see one target, or fix these"));
  }
}

/// One sample in so many has another one that is the same.
constexpr size_t kMuchTwice = 3;

/// Whether two samples have the same readings of all that places a view, but for noise.
bool placed_alike(const Rig& rig, const View& view, const Sample& a, const Sample& b) {
  const Sensor& sensor = rig.sensors[view.sensor];
  const Target& target = rig.targets[view.target];
  for (const int j : joints_between(rig, sensor.link, target.link < 0 ? rig.base : target.link,
                                    sensor.scanning_joint))
    if (std::abs(a.readings[j] - b.readings[j]) > std::max(1e-6, 3 * rig.joints[j].sigma))
      return false;
  return true;
}

/// Views that are there twice number for number: in one sample, or in samples whose joints stand
/// elsewhere, where a picture was paired twice.
void find_repeated_views(const Rig& rig, const std::vector<Sample>& samples,
                         std::vector<Notice>& out) {
  using Numbers = std::tuple<int, int, const std::vector<int>&, const std::vector<double>&>;
  const auto less = [](const View* a, const View* b) {
    return Numbers(a->sensor, a->target, a->ids, a->z) <
           Numbers(b->sensor, b->target, b->ids, b->z);
  };
  std::map<const View*, const Sample*, decltype(less)> seen(less);
  std::vector<std::string> twice, paired, with;
  for (const Sample& s : samples)
    for (const View& v : s.views) {
      if (v.z.size() <= kPoseAxes) continue;  // a point may be seen at one place all the time
      const auto [before, fresh] = seen.try_emplace(&v, &s);
      if (fresh) continue;
      if (before->second == &s) {
        twice.push_back(s.id);
      } else if (!placed_alike(rig, v, *before->second, s)) {
        paired.push_back(s.id);
        with.push_back(before->second->id);
      }
    }
  if (!twice.empty())
    out.push_back(
        make_notice(NoticeKind::same_samples, subjects(Subject::Kind::sample, twice),
                    "views occur twice, with identical values, in " +
                        std::string(twice.size() > 1 ? "samples " : "sample ") + listed(twice),
                    "they count as two measurements but are one", "leave one of them out"));
  if (!twice.empty() && kMuchTwice * twice.size() <= samples.size())
    out.back().severity = Severity::remark;
  if (!paired.empty())
    out.push_back(make_notice(
        NoticeKind::same_samples, subjects(Subject::Kind::sample, paired),
        "views of " + std::to_string(paired.size()) +
            (paired.size() > 1 ? " samples are" : " sample is") +
            " identical to that of another sample, though the joint readings differ: first " +
            quoted(paired[0]) + " has that of " + quoted(with[0]),
        "an image was paired twice, and at most one of the two postures is its own",
        "pair each image with the readings of its own time"));
}

}  // namespace

std::vector<Notice> find_duplicates(const Rig& rig, const std::vector<Sample>& samples) {
  std::map<std::vector<double>, std::vector<size_t>> same;  // samples by all their numbers
  for (size_t i = 0; i < samples.size(); ++i) {
    const Sample& s = samples[i];
    std::vector<double> numbers;
    bool measured = false;
    for (double q : s.readings) numbers.push_back(std::isnan(q) ? kInfinity : q);
    std::vector<std::vector<double>> views;
    for (const View& v : s.views) {
      std::vector<double> one = {static_cast<double>(v.sensor), static_cast<double>(v.target)};
      one.insert(one.end(), v.ids.begin(), v.ids.end());
      one.insert(one.end(), v.z.begin(), v.z.end());
      measured = measured ||
                 rig.sensors[v.sensor].model->measurement_kind() != MeasurementKind::chain ||
                 std::any_of(v.z.begin(), v.z.end(), [](double z) { return z != 0; });
      views.push_back(std::move(one));
    }
    std::sort(views.begin(), views.end());
    for (const auto& v : views) numbers.insert(numbers.end(), v.begin(), v.end());
    if (measured) same[numbers].push_back(i);
  }
  std::vector<std::vector<size_t>> groups;  // in the order of their first samples
  for (auto& entry : same)
    if (entry.second.size() > 1) groups.push_back(std::move(entry.second));
  std::sort(groups.begin(), groups.end());
  std::vector<Notice> out;
  find_repeated_views(rig, samples, out);
  if (groups.empty()) return out;
  std::vector<std::string> all, worst;
  for (const std::vector<size_t>& group : groups) {
    std::vector<std::string> ids;
    for (const size_t i : group) ids.push_back(samples[i].id);
    all.insert(all.end(), ids.begin(), ids.end());
    if (ids.size() > worst.size()) worst = std::move(ids);
  }
  const bool more = groups.size() > 1;
  out.push_back(make_notice(
      NoticeKind::same_samples, subjects(Subject::Kind::sample, all),
      (more ? std::to_string(all.size()) + " samples are " + std::to_string(groups.size()) +
                  " measurements under several ids each, worst: "
            : "") +
          "samples " + joined(worst) + " are the same: joint readings and measured numbers",
      "they count as " + std::to_string(worst.size()) + " measurements but are one",
      std::string("leave out all but one") + (more ? " of each" : "")));
  if (kMuchTwice * all.size() <= samples.size()) out.back().severity = Severity::remark;
  return out;
}

void check_still_joints(const Recording& recording, const FreedNames& freed,
                        std::vector<Notice>& out) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  const ObservationIndex observations = make_observation_index(rig, recording.samples);
  for (const auto& r : observations.ranges) {
    const int j = r.first;
    const size_t samples = observations.samples.at(j).size();
    if (samples < 2 || r.second.second - r.second.first > std::max(1e-6, 3 * rig.joints[j].sigma))
      continue;
    std::vector<std::string> names;
    for (int p = table.joint_offset[j]; p >= 0 && p < table.joint_origin[j]; ++p)
      if (freed.parameter[p]) names.push_back(table.all[p].name);
    if (freed.parameter[table.joint_origin[j]] && !freed.whole[table.joint_origin[j]])
      names.push_back(table.all[table.joint_origin[j]].name);
    if (names.empty()) continue;
    out.push_back(make_notice(NoticeKind::still_joint, {Subject::joint(rig.tree.joints[j].name)},
                              "joint " + quoted(rig.tree.joints[j].name) + " never moves" +
                                  text(" (it reads %.6g in all ", r.second.first) +
                                  std::to_string(samples) +
                                  " samples that need it), but the rig estimates " + joined(names),
                              "",
                              std::string("take samples in which it moves, or fix ") +
                                  (names.size() == 1 ? "it" : "them") +
                                  "; if it did move, the recorded readings are wrong"));
  }
}

void check_connections(const Recording& recording, const FreedNames& freed,
                       const std::vector<int>& sensors, std::vector<Notice>& out) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  Connections connections(recording);
  for (int s : sensors)
    if (!connections.seen[s] && freed.parameter[table.sensor_mount[s]])
      out.push_back(
          make_notice(NoticeKind::disconnected, {Subject::sensor(rig.sensors[s].name)},
                      "sensor " + quoted(rig.sensors[s].name) +
                          " has no view in any sample, but the rig estimates its pose",
                      "", "add views of it, or fix " + table.all[table.sensor_mount[s]].name));
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (rig.targets[t].link >= 0 && !connections.seen[connections.sensors + t] &&
        freed.parameter[table.target_mount[t]])
      out.push_back(
          make_notice(NoticeKind::disconnected, {Subject::target(rig.targets[t].name)},
                      "target " + quoted(rig.targets[t].name) +
                          " is seen in no sample, but the rig estimates its pose",
                      "", "add views of it, or fix " + table.all[table.target_mount[t]].name));
  check_anchors(recording, freed, connections, out);
}

}  // namespace kincal
