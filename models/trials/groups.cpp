#include "groups.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>
#include <stdexcept>

#include "../rig/geometry.h"
#include "../rig/numbers.h"
#include "../rig/selection.h"

namespace kincal {
namespace {

// Sigmas of the priors.
constexpr double kOffset = 0.05, kSlide = 0.01;   // rad, m
constexpr double kPlace = 0.01, kTurn = 0.01;     // m, rad: geometry
constexpr double kScale = 0.01, kSquare = 0.005;  // shares
constexpr double kBaseline = 0.002;               // m
constexpr double kIntrinsics = 0.1,
                 kDistortion = 0.5;  // share of the focal length; as the numbers are

/// To two digits: as a sigma is written.
double rounded(double v) {
  const double unit = std::pow(10.0, std::floor(std::log10(v)) - 1), whole = std::round(v / unit);
  return unit < 1 ? whole / std::round(1 / unit) : whole * unit;
}

/// Two cameras that are one thing: on the same link, in the same place, one with a baseline (a
/// rectified pair).
bool is_pair(const Rig& rig, int a, int b) {
  const auto baseline = [&](const Sensor& s) {
    for (const ParameterBlock& block : s.parameters)
      if (block.name == "baseline") return block.values[0];
    return 0.0;
  };
  const Sensor &s = rig.sensors[a], &t = rig.sensors[b];
  const Vector6d apart = log_se3(inverse(s.link_T_sensor) * t.link_T_sensor);
  return s.type == "camera" && t.type == "camera" && s.link == t.link && apart.norm() < 1e-9 &&
         baseline(s) != baseline(t);
}

class GroupMaker {
 public:
  explicit GroupMaker(const Recording& recording);
  std::vector<Group> make() {
    make_mounts();
    make_groups();
    return std::move(groups_);
  }

 private:
  void make_mounts();
  void make_groups();
  void make_geometry();
  void add_group(const std::string& name, const std::vector<Freed>& free,
                 const std::function<double(const Parameter&, int)>& sigma);

  const Rig& rig_;
  const ParameterTable& table_;
  const std::vector<Sample>& samples_;
  std::vector<char> used_;  // by parameter: some measurement depends on it
  std::vector<Group> groups_;
};

GroupMaker::GroupMaker(const Recording& recording)
    : rig_(recording.rig), table_(recording.table), samples_(recording.samples) {
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  setup.sensors = indices(rig_.sensors.size());
  used_ = Estimation(recording, indices(samples_.size()), setup).influencing();
}

void GroupMaker::make_mounts() {
  Group mounts;
  mounts.name = "mounts";
  std::vector<char> done(rig_.sensors.size(), 0), away(rig_.sensors.size(), 0);
  for (const Sample& sample : samples_)
    for (const View& v : sample.views)
      if (rig_.sensors[v.sensor].model->measurement_kind() != MeasurementKind::points ||
          std::any_of(v.z.begin(), v.z.end(), [](double z) { return z != 0; }))
        away[v.sensor] = 1;
  for (size_t s = 0; s < rig_.sensors.size(); ++s) {
    if (done[s] || !used_[table_.sensor_pose[s]]) continue;
    bool pair = false;
    for (size_t t = s + 1; t < rig_.sensors.size(); ++t)
      if (used_[table_.sensor_pose[t]] && is_pair(rig_, static_cast<int>(s), static_cast<int>(t))) {
        pair = true;
        done[t] = 1;
      }
    // A pair is moved by the fixed joint above its link; any other sensor on that link moves along,
    // and has a pose of its own.
    const int above = rig_.tree.joint_above[rig_.sensors[s].link];
    const bool shared = pair && above >= 0 && rig_.tree.joints[above].type == JointType::fixed &&
                        used_[table_.joint_origin[above]];
    if (pair && !shared) done.assign(done.size(), 0);
    merge(mounts.free,
          {whole(table_, shared ? table_.joint_origin[above] : table_.sensor_pose[s])});
    if (!away[s])
      mounts.free.back().components = {
          0, 1, 2};  // it sees points at its own origin only: turning it does nothing
  }
  for (size_t t = 0; t < rig_.targets.size(); ++t)
    if (table_.target_pose[t] >= 0 && used_[table_.target_pose[t]])
      merge(mounts.free, {whole(table_, table_.target_pose[t])});
  groups_.push_back(mounts);
}

/// Keeps what some measurement depends on; an empty group is left out.
void GroupMaker::add_group(const std::string& name, const std::vector<Freed>& free,
                           const std::function<double(const Parameter&, int)>& sigma) {
  Group group;
  group.name = name;
  for (const Freed& f : free)
    if (used_[f.parameter]) group.free.push_back(f);
  for (const Freed& f : group.free)
    for (int c : f.components)
      group.priors.push_back({f.parameter, c, rounded(sigma(table_.all[f.parameter], c))});
  if (!group.free.empty()) groups_.push_back(std::move(group));
}

void GroupMaker::make_groups() {
  std::vector<Freed> offsets, scales, shapes, squares, baselines, intrinsics, distortion;
  for (size_t j = 0; j < rig_.tree.joints.size(); ++j) {
    if (table_.joint_offset[j] < 0) continue;
    offsets.push_back(whole(table_, table_.joint_offset[j]));
    scales.push_back(whole(table_, table_.joint_scale[j]));
    for (int k = 2; k < rig_.joints[j].model->size(); ++k)
      shapes.push_back(whole(table_, table_.joint_offset[j] + k));
  }
  for (size_t t = 0; t < rig_.targets.size(); ++t)
    if (table_.target_square[t] >= 0) squares.push_back(whole(table_, table_.target_square[t]));
  for (size_t s = 0; s < rig_.sensors.size(); ++s)
    for (size_t b = 0; b < rig_.sensors[s].parameters.size(); ++b) {
      const ParameterBlock& block = rig_.sensors[s].parameters[b];
      const Freed f = whole(table_, table_.sensor_block[s] + static_cast<int>(b));
      if (block.name == "intrinsics") intrinsics.push_back(f);
      if (block.name == "distortion") distortion.push_back(f);
      if (block.name == "baseline" && block.values[0] != 0) baselines.push_back(f);
    }
  add_group("joint offsets", offsets,
            [](const Parameter& p, int) { return p.units[0] == "m" ? kSlide : kOffset; });
  make_geometry();
  add_group("gear scales", scales, [](const Parameter&, int) { return kScale; });
  add_group("joint shapes", shapes, [](const Parameter& p, int) { return p.usual_error; });
  add_group("board sizes", squares,
            [&](const Parameter& p, int) { return kSquare * table_.initial(p.start); });
  add_group("baselines", baselines, [](const Parameter&, int) { return kBaseline; });
  add_group("intrinsics", intrinsics, [&](const Parameter& p, int) {
    return kIntrinsics * std::abs(table_.initial(p.start));
  });
  add_group("distortion", distortion, [](const Parameter&, int) { return kDistortion; });
}

/// A group a chain, the longest first; of the numbers that are independent in all chains together
/// those of its joints that no chain before has.
void GroupMaker::make_geometry() {
  std::vector<Chain> chains;
  const auto depth = [&](int link) {
    int n = 0;
    for (int j = rig_.tree.joint_above[link]; j >= 0;
         j = rig_.tree.joint_above[rig_.tree.joints[j].parent])
      ++n;
    return n;
  };
  const auto moving = [&](const Chain& c) {
    const Path path = find_path(rig_.tree, c.base, c.tip);
    return std::count_if(path.begin(), path.end(),
                         [&](const PathStep& s) { return rig_.tree.joints[s.joint].moves(); });
  };
  const auto add = [&](int a, int b) {
    if (depth(b) < depth(a) || (depth(a) == depth(b) && b < a)) std::swap(a, b);
    const int body = body_of(rig_.tree, a), other = body_of(rig_.tree, b);
    if (body != other && std::none_of(chains.begin(), chains.end(), [&](const Chain& c) {
          const int x = body_of(rig_.tree, c.base), y = body_of(rig_.tree, c.tip);
          return (x == body && y == other) || (x == other && y == body);
        }))
      chains.push_back({a, b});
  };
  for (const Sample& s : samples_)
    for (const View& v : s.views) {
      if (rig_.targets[v.target].link >= 0) {
        add(rig_.sensors[v.sensor].link, rig_.targets[v.target].link);
      } else {
        for (const View& w : s.views)
          if (w.target == v.target) add(rig_.sensors[v.sensor].link, rig_.sensors[w.sensor].link);
      }
    }
  std::sort(chains.begin(), chains.end(), [&](const Chain& a, const Chain& b) {
    const auto m = moving(a), n = moving(b);
    return m != n ? m > n : a.base != b.base ? a.base < b.base : a.tip < b.tip;
  });
  std::vector<char> has_pose(rig_.tree.links.size(), 0);
  for (const Chain& c : chains) has_pose[c.base] = has_pose[c.tip] = 1;
  const std::vector<OriginComponents> all = independent_geometry(rig_.tree, chains, has_pose);
  std::set<int> taken;
  for (const Chain& chain : chains) {
    std::vector<Freed> free;
    std::vector<int> offsets;
    for (const PathStep& step : find_path(rig_.tree, chain.base, chain.tip)) {
      if (!taken.insert(step.joint).second) continue;
      for (const OriginComponents& o : all)
        if (o.joint == step.joint) free.push_back({table_.joint_origin[o.joint], o.components});
      if (table_.joint_offset[step.joint] >= 0) offsets.push_back(table_.joint_offset[step.joint]);
    }
    const size_t before = groups_.size();
    const std::string name =
        "geometry/" + rig_.tree.links[chain.base] + ".." + rig_.tree.links[chain.tip];
    add_group(name, free, [](const Parameter&, int c) { return c < 3 ? kPlace : kTurn; });
    if (groups_.size() > before) groups_.back().contained_offsets = offsets;
  }
}

Rig without_steps(Rig rig) {
  rig.steps.clear();
  return rig;
}

/// Training samples with views, by id.
std::vector<Sample> in_order(const std::vector<Sample>& samples) {
  std::vector<Sample> out;
  for (const Sample& s : samples)
    if (s.train && !s.views.empty()) out.push_back(s);
  std::sort(out.begin(), out.end(), [](const Sample& a, const Sample& b) { return a.id < b.id; });
  return out;
}

}  // namespace

Recording staging_recording(const Rig& rig, const std::vector<Sample>& samples) {
  Recording out(without_steps(rig), in_order(samples));
  if (out.samples.empty())
    throw std::invalid_argument("automatic staging: no training sample has a view");
  return out;
}

std::vector<Group> make_groups(const Recording& recording) { return GroupMaker(recording).make(); }

std::vector<std::pair<std::string, std::vector<std::string>>> staging_groups(
    const Rig& rig, const std::vector<Sample>& samples) {
  const Recording recording = staging_recording(rig, samples);
  std::vector<std::pair<std::string, std::vector<std::string>>> out;
  for (const Group& g : make_groups(recording))
    out.push_back({g.name, names_of(recording.table, g.free)});
  return out;
}

std::vector<Freed> without(const std::vector<Freed>& a, const std::vector<Freed>& b) {
  std::vector<Freed> out;
  for (const Freed& f : a) {
    Freed left{f.parameter, {}};
    for (int c : f.components)
      if (std::none_of(b.begin(), b.end(), [&](const Freed& g) {
            return g.parameter == f.parameter &&
                   std::count(g.components.begin(), g.components.end(), c);
          }))
        left.components.push_back(c);
    if (!left.components.empty()) out.push_back(left);
  }
  return out;
}

bool has(const std::vector<Freed>& all, int parameter, int component) {
  return std::any_of(all.begin(), all.end(), [&](const Freed& f) {
    return f.parameter == parameter &&
           std::count(f.components.begin(), f.components.end(), component);
  });
}

std::vector<std::string> names_of(const ParameterTable& table, const std::vector<Freed>& free) {
  std::vector<std::string> out;
  for (const Freed& f : free) {
    const Parameter& p = table.all[f.parameter];
    if (f.whole(p)) {
      out.push_back(p.name);
    } else {
      for (int c : f.components) out.push_back(p.component_name(c));
    }
  }
  return out;
}

}  // namespace kincal
