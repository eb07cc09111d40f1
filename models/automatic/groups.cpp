#include "groups.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>

#include "../../solver/decompositions.h"
#include "../estimation/estimation.h"
#include "../rig/configuration.h"
#include "../rig/elasticity.h"
#include "../rig/geometry.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/targets.h"
#include "../rig/words.h"
#include "../sensors/surface.h"

namespace kincal {
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

namespace {

/// The fixed joint that carries the link of a pair and nothing that moves against it: its origin
/// can stand for the pair's pose. -1: there is none.
int joint_of_pair(const Rig& rig, size_t sensor) {
  const Tree& tree = rig.tree;
  const int above = tree.joint_above[rig.sensors[sensor].link];
  if (above < 0 || tree.joints[above].type != JointType::fixed) return -1;
  const auto hangs_there = [&](int link) {
    while (tree.joint_above[link] >= 0 && tree.joint_above[link] != above)
      link = tree.joints[tree.joint_above[link]].parent;
    return tree.joint_above[link] == above;
  };
  const auto moves = [&](const Joint& joint) {
    return !joint.is_rigid() && hangs_there(joint.parent);
  };
  return std::any_of(tree.joints.begin(), tree.joints.end(), moves) ? -1 : above;
}

/// How points spread: their moments, and what their noise adds to these.
struct PointSpread {
  double count = 0, noise = 0;  // noise: sum of variances of the least certain coordinate, m^2
  Vector3d sum = Vector3d::Zero();
  Matrix3d squares = Matrix3d::Zero();

  void add(const Vector3d& p, double sigma) {
    ++count;
    noise += sigma * sigma;
    sum += p;
    squares += p * p.transpose();
  }
};

class GroupMaker {
 public:
  GroupMaker(const Recording& recording, const std::vector<std::string>& frames);
  const std::vector<char>& used() const { return used_; }
  AutomaticGroups make() {
    make_mounts();
    make_joints();
    make_geometry();
    make_targets_and_sensors();
    make_bending();
    make_conditions();
    return std::move(out_);
  }

 private:
  void make_mounts();
  int shared_joint(size_t sensor, const std::vector<size_t>& others) const;
  void fix_rotations(int mount, int pose, const PointSpread& seen);
  void make_joints();
  void make_geometry();
  void make_targets_and_sensors();
  void make_bending();
  void make_conditions();
  void add_single(int joint, const std::vector<char>& scans);
  std::vector<Chain> chains() const;
  std::map<int, std::string> runs() const;
  std::map<int, std::string> runs_of(const std::vector<char>& member) const;
  bool is_mount(int parameter) const { return find_freed(out_.mounts, parameter) != nullptr; }
  void add(const std::string& group, int parameter, int component);
  void add(const std::string& group, int parameter, int component, double start, bool seen = true);

  const Rig& rig_;
  const ParameterTable& table_;
  const std::vector<Sample>& recorded_;
  std::vector<const Sample*> samples_;  // of the training: held-out ones decide nothing
  std::vector<char> used_;              // by parameter: some measurement depends on it
  std::vector<char> carries_;  // by joint: 1 between the base and a sensor or target, 2 only
                               // between the base and a requested frame
  AutomaticGroups out_;
};

GroupMaker::GroupMaker(const Recording& recording, const std::vector<std::string>& frames)
    : rig_(recording.rig), table_(recording.table), recorded_(recording.samples) {
  for (const int i : recording.training()) samples_.push_back(&recording.samples[i]);
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  setup.sensors = indices(rig_.sensors.size());
  const Estimation probe(recording, recording.training(), setup);
  if (probe.groups().empty()) throw std::invalid_argument("no training sample has a view");
  used_ = probe.influencing();
  carries_.assign(rig_.tree.joints.size(), 0);
  const auto carry = [&](int link, char what) {
    try {
      for (const PathStep& step : find_path(rig_.tree, rig_.base, link))
        if (carries_[step.joint] == 0) carries_[step.joint] = what;
    } catch (const std::invalid_argument&) {  // a link that no path leads to
    }
  };
  for (size_t s = 0; s < rig_.sensors.size(); ++s)
    if (used_[table_.sensor_pose[s]]) carry(rig_.sensors[s].link, 1);
  for (size_t t = 0; t < rig_.targets.size(); ++t)
    if (table_.target_pose[t] >= 0 && used_[table_.target_pose[t]]) carry(rig_.targets[t].link, 1);
  for (const std::string& frame : frames)
    if (const int link = rig_.tree.find_link(frame); link >= 0) carry(link, 2);
}

/// The joint that moves a sensor and the others of its rectified pair: the one that the rig names
/// as a mount, else of a pair the fixed one that carries it alone; any other sensor on that link
/// moves along, and has a pose of its own. -1: the sensor's pose is its mount.
int GroupMaker::shared_joint(size_t sensor, const std::vector<size_t>& others) const {
  int named = rig_.sensors[sensor].mount_joint;
  for (const size_t t : others) named = named >= 0 ? named : rig_.sensors[t].mount_joint;
  if (named >= 0 || others.empty() || rig_.sensors[others[0]].pose_of >= 0) return named;
  const int above = joint_of_pair(rig_, sensor);
  return above >= 0 && used_[table_.joint_origin[above]] ? above : -1;
}

/// Fixes the rotations of a mount that move none of the points seen, in the frame of `pose`, which
/// it carries: about a single point all, about a line the one about it. Points spread no further
/// than that where twice their noise explains it: beyond, the rotation is estimated. A mount that
/// two things share turns one about the other.
void GroupMaker::fix_rotations(int mount, int pose, const PointSpread& seen) {
  const auto shares = std::count(table_.sensor_mount.begin(), table_.sensor_mount.end(), mount) +
                      std::count(table_.target_mount.begin(), table_.target_mount.end(), mount);
  if (shares != 1 || seen.count == 0) return;
  const Vector3d mean = seen.sum / seen.count;
  const SymmetricEigen spread =
      symmetric_eigen(Matrix3d(seen.squares / seen.count - mean * mean.transpose()));
  const double none = (2 * seen.noise + 1e-12 * seen.squares.trace()) / seen.count;
  if (!(spread.values(2) > none)) {
    out_.pointing.push_back({mount, {3, 4, 5}});
    if (mount == pose) out_.pivots[pose] = mean;
  } else if (!(spread.values(1) > none) && mount == pose) {
    int axis = 0;
    spread.vectors.col(2).cwiseAbs().maxCoeff(&axis);
    out_.pointing.push_back({mount, {3 + axis}});
  }
}

void GroupMaker::make_mounts() {
  std::vector<char> done(rig_.sensors.size(), 0);
  std::vector<PointSpread> measured(rig_.sensors.size());  // of sensors of points, in their frames
  std::vector<PointSpread> seen(rig_.targets.size());      // in targets' frames
  std::vector<char> turned(rig_.targets.size(), 0);        // a sensor measures how
  std::vector<Eigen::Matrix3Xd> points;
  for (const Target& target : rig_.targets) points.push_back(target_points(target));
  for (const Sample* sample : samples_)
    for (const View& v : sample->views) {
      const SensorModel& model = *rig_.sensors[v.sensor].model;
      if (model.measurement_kind() == MeasurementKind::points || sees_surfaces(model))
        for (size_t k = 0; k + 3 <= v.z.size(); k += 3)
          measured[v.sensor].add(Eigen::Map<const Vector3d>(&v.z[k]),
                                 v.covariance.empty()
                                     ? *std::max_element(v.sigma.begin(), v.sigma.end())
                                     : std::sqrt(v.covariance[k / 3].diagonal().maxCoeff()));
      for (const int k : view_ids(v, rig_.targets[v.target]))
        seen[v.target].add(points[v.target].col(k), 0);
      if (model.measures_pose()) turned[v.target] = 1;
    }
  for (size_t s = 0; s < rig_.sensors.size(); ++s) {
    if (done[s] || !used_[table_.sensor_pose[s]]) continue;
    std::vector<size_t> others;
    for (size_t t = s + 1; t < rig_.sensors.size(); ++t)
      if (used_[table_.sensor_pose[t]] && is_pair(rig_, static_cast<int>(s), static_cast<int>(t)))
        others.push_back(t);
    const int joint = shared_joint(s, others);
    if (joint >= 0)
      for (const size_t t : others) done[t] = 1;
    const int mount = joint >= 0 ? table_.joint_origin[joint] : table_.sensor_pose[s];
    if (used_[mount]) merge(out_.mounts, {whole(table_, mount)});
    if (mount == table_.sensor_mount[s]) fix_rotations(mount, table_.sensor_pose[s], measured[s]);
  }
  for (size_t t = 0; t < rig_.targets.size(); ++t)
    if (table_.target_pose[t] >= 0 && used_[table_.target_mount[t]])
      merge(out_.mounts, {whole(table_, table_.target_mount[t])});
  for (size_t t = 0; t < rig_.targets.size(); ++t)
    if (table_.target_pose[t] >= 0 && used_[table_.target_pose[t]] &&
        rig_.targets[t].type == "plane")
      out_.pointing.push_back({table_.target_mount[t], {0, 1, 5}});  // these move it in itself
    else if (table_.target_pose[t] >= 0 && used_[table_.target_pose[t]] && !turned[t])
      fix_rotations(table_.target_mount[t], table_.target_pose[t], seen[t]);
}

void GroupMaker::add(const std::string& group, int parameter, int component) {
  add(group, parameter, component, scales(table_, {parameter, component}, table_.initial).width);
}

void GroupMaker::add(const std::string& group, int parameter, int component, double start,
                     bool seen) {
  auto found = std::find_if(out_.groups.begin(), out_.groups.end(),
                            [&](const WidthGroup& g) { return g.name == group; });
  if (found == out_.groups.end()) found = out_.groups.insert(found, {group, {}, {}});
  (used_[parameter] && seen ? found->members : found->unseen)
      .push_back({{parameter, component}, start});
}

void GroupMaker::make_joints() {
  std::vector<char> scans(rig_.tree.joints.size(), 0);
  for (size_t s = 0; s < rig_.sensors.size(); ++s)
    if (rig_.sensors[s].scanning_joint >= 0 && used_[table_.sensor_pose[s]])
      scans[rig_.sensors[s].scanning_joint] = 1;
  const std::vector<int> approached = joints_with_backlash(rig_, recorded_);
  for (size_t j = 0; j < rig_.tree.joints.size(); ++j) {
    const int offset = table_.joint_offset[j], scale = table_.joint_scale[j];
    if (offset < 0 || table_.all[offset].hidden() || !(used_[offset] || carries_[j])) continue;
    const bool slides = rig_.tree.joints[j].type == JointType::prismatic;
    if (scans[j]) {
      add("scan offsets", offset, 0, kScanningOffset);
      add("scan scales", scale, 0,
          kScanningScale * std::abs(table_.initial(table_.all[scale].start)));
    } else {
      add(slides ? "slides" : "offsets", offset, 0);
      add(kGears, scale, 0);
    }
    if (!slides && !scans[j] && used_[offset]) add_single(static_cast<int>(j), scans);
    if (const int backlash = table_.index_of(ParameterKind::backlash, static_cast<int>(j));
        backlash >= 0 && std::count(approached.begin(), approached.end(), j))
      add(kBacklash, backlash, 0);
    const std::vector<char> seen =
        numbers_seen(recorded_, static_cast<int>(j), *rig_.joints[j].model);
    size_t number = 2;
    for (int p = offset + 2; p < table_.joint_origin[j]; ++p)
      for (int c = 0; table_.all[p].kind == ParameterKind::joint_shape && c < table_.all[p].size();
           ++c, ++number)
        if (used_[p])
          add(table_.all[p].size() == 1 ? "shapes" : kCurve + rig_.tree.joints[j].name, p, c,
              table_.all[p].usual_error, seen[number]);
  }
}

/// Groups of one joint that turns: its ripple, curve and coupling, without members where the rig
/// does not have them yet.
void GroupMaker::add_single(int joint, const std::vector<char>& scans) {
  const JointSettings& settings = rig_.joints[joint];
  const std::string& name = rig_.tree.joints[joint].name;
  const auto add_all = [&](const std::string& group, ParameterKind kind) {
    const int p = table_.index_of(kind, joint);
    for (int c = 0; p >= 0 && c < table_.all[p].size(); ++c) add(group, p, c);
    if (p < 0) out_.groups.push_back({group, {}, {}});
  };
  add_all(kRippleOf + name, ParameterKind::ripple);
  if (settings.model == linear_joint()) out_.groups.push_back({kCurve + name, {}, {}});
  const std::vector<int> next = next_joints(rig_, joint);
  if (!next.empty() && std::none_of(next.begin(), next.end(), [&](int j) { return scans[j]; }))
    add_all(kCouplingOf + name, ParameterKind::coupling);
}

/// Groups of the samples' conditions: time offsets, and models that the rig does not have yet.
void GroupMaker::make_conditions() {
  if (!table_.has(ParameterKind::backlash) && !joints_with_backlash(rig_, recorded_).empty())
    out_.groups.push_back({kBacklash, {}, {}});
  if (temperature_varies(recorded_)) {
    if (!table_.has(ParameterKind::temperature)) out_.groups.push_back({kTemperature, {}, {}});
    for (size_t p = 0; p < table_.all.size(); ++p)
      if (table_.all[p].kind == ParameterKind::temperature && used_[p])
        add(kTemperature, static_cast<int>(p), 0);
  }
  const std::vector<int> moving = sensors_with_rates(rig_, recorded_);
  if (!table_.has(ParameterKind::time_offset) && !moving.empty())
    out_.groups.push_back({kTimeOffsets, {}, {}});
  for (const int s : moving)
    for (const int time : {table_.time_offset[s], table_.line_time[s]})
      if (time >= 0) add(kTimeOffsets, time, 0);
}

/// Chains between sensors and what they see, the longest first.
std::vector<Chain> GroupMaker::chains() const {
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
  for (const Sample* s : samples_)
    for (const View& v : s->views) {
      if (rig_.targets[v.target].link >= 0) {
        add(rig_.sensors[v.sensor].link, rig_.targets[v.target].link);
      } else {
        for (const View& w : s->views)
          if (w.target == v.target) add(rig_.sensors[v.sensor].link, rig_.sensors[w.sensor].link);
      }
    }
  std::sort(chains.begin(), chains.end(), [&](const Chain& a, const Chain& b) {
    const auto m = moving(a), n = moving(b);
    return m != n ? m > n : a.base != b.base ? a.base < b.base : a.tip < b.tip;
  });
  return chains;
}

/// By joint of a path between sensors and targets or from the base to one of them, or to a
/// requested frame: the run that it is in, by its first joint and its last.
std::map<int, std::string> GroupMaker::runs() const {
  std::vector<char> member(rig_.tree.joints.size(), 0), requested = member;
  for (const Chain& chain : chains())
    for (const PathStep& step : find_path(rig_.tree, chain.base, chain.tip)) member[step.joint] = 1;
  for (size_t j = 0; j < member.size(); ++j) {
    member[j] = member[j] || carries_[j] == 1;
    requested[j] = !member[j] && carries_[j] == 2;
  }
  std::map<int, std::string> out = runs_of(member);
  out.merge(runs_of(requested));
  return out;
}

std::map<int, std::string> GroupMaker::runs_of(const std::vector<char>& member) const {
  std::vector<int> children(rig_.tree.links.size(), 0), first(rig_.tree.joints.size(), -1);
  for (size_t j = 0; j < member.size(); ++j)
    if (member[j]) ++children[rig_.tree.joints[j].parent];
  const auto begin_of = [&](int j) {
    for (;;) {
      const int link = rig_.tree.joints[j].parent, above = rig_.tree.joint_above[link];
      if (above < 0 || !member[above] || children[link] != 1) return j;
      j = above;
    }
  };
  std::map<int, int> last;  // by the run's first joint
  for (size_t j = 0; j < member.size(); ++j) {
    if (!member[j]) continue;
    first[j] = begin_of(static_cast<int>(j));
    const auto below = [&](int k) {  // whether joint k stands somewhere below j
      for (int i = k; i >= 0; i = rig_.tree.joint_above[rig_.tree.joints[i].parent])
        if (i == static_cast<int>(j)) return true;
      return false;
    };
    const auto found = last.emplace(first[j], static_cast<int>(j)).first;
    if (!below(found->second)) found->second = static_cast<int>(j);
  }
  std::map<int, std::string> out;
  for (size_t j = 0; j < member.size(); ++j)
    if (member[j])
      out[static_cast<int>(j)] =
          rig_.tree.joints[first[j]].name + ".." + rig_.tree.joints[last[first[j]]].name;
  return out;
}

void GroupMaker::make_geometry() {
  const std::map<int, std::string> run = runs();
  std::vector<char> moves_on(rig_.tree.joints.size(), 0);  // it moves, or one below it does
  for (const auto& entry : run)
    if (rig_.tree.joints[entry.first].moves())
      for (int j = entry.first; j >= 0; j = rig_.tree.joint_above[rig_.tree.joints[j].parent])
        moves_on[j] = 1;
  for (const auto& entry : run) {
    const Joint& joint = rig_.tree.joints[entry.first];
    const int origin = table_.joint_origin[entry.first];
    // A pose that is measured is where it is: what stands in front of it has no error of its own.
    if (joint.type == JointType::floating || table_.all[origin].hidden()) continue;
    if (!moves_on[entry.first] || is_mount(origin) || !(used_[origin] || carries_[entry.first]))
      continue;
    for (int c = 0; c < 6; ++c) {
      const bool own = joint.moves() && (c < 3) == (joint.type == JointType::prismatic) &&
                       c % 3 == component_along(joint.axis);  // the offset has it
      if (!own) add((c < 3 ? "lengths/" : "angles/") + entry.second, origin, c);
    }
  }
}

void GroupMaker::make_targets_and_sensors() {
  std::set<std::string> possible;
  for (size_t t = 0; t < rig_.targets.size(); ++t) {
    const int square = table_.target_square[t];
    if (square >= 0 && used_[square]) add("sizes", square, 0);
    const int warp = table_.target_warp[t];
    for (int c = 0; warp >= 0 && c < 2; ++c)
      if (used_[warp]) add(kWarps, warp, c);
    const int print = table_.target_print[t];
    for (int c = 0; print >= 0 && c < 2; ++c)
      if (used_[print]) add(kPrints, print, c);
    if (square >= 0 && used_[square]) possible.insert({kPrints, kWarps});
    const int points = table_.target_points[t];
    for (int c = 0; points >= 0 && c < table_.all[points].size(); ++c)
      if (used_[points] && rig_.targets[t].count() > 1) add(kMarkers, points, c);
  }
  for (const std::string& name : possible)
    if (std::none_of(out_.groups.begin(), out_.groups.end(),
                     [&](const WidthGroup& g) { return g.name == name; }))
      out_.groups.push_back({name, {}, {}});
  for (size_t s = 0; s < rig_.sensors.size(); ++s)
    for (size_t b = 0; b < rig_.sensors[s].parameters.size(); ++b) {
      const int p = table_.sensor_block[s] + static_cast<int>(b);
      const Parameter& parameter = table_.all[p];
      if (!used_[p]) continue;
      if (parameter.kind == ParameterKind::baseline && table_.initial(parameter.start) != 0)
        add("baselines", p, 0);
      if (parameter.kind == ParameterKind::range_scale ||
          parameter.kind == ParameterKind::range_offset)
        add("ranges", p, 0);
      for (int c = 0; c < parameter.size(); ++c) {
        if (parameter.kind == ParameterKind::intrinsics)
          add(c < 2 ? "focal lengths" : "centres", p, c);
        if (parameter.kind == ParameterKind::distortion) add("distortion", p, c);
      }
    }
}

/// Starting widths. Of compliances: the joint with the largest moments bends by 1 mrad about its
/// axis and 0.3 mrad across it, as drives and bearings of measured arms do; joints with less than a
/// hundredth of its moments bend by nothing to speak of, and are left as they are. Of loads: their
/// own size, which rods miss by about as much, or a tenth of the largest where that is near 0. That
/// is not learned: only products of loads and compliances count, so wider loads would stand in for
/// compliances.
void GroupMaker::make_bending() {
  constexpr double kAbout = 1e-3, kAcross = 3e-4;  // rad
  constexpr double kLeast = 0.1;                   // of the largest load
  constexpr double kAnyMoment = 0.01;              // of the largest: bends by 10 urad
  const std::string names[] = {kCompliance, kComplianceAcross, kLoads};
  if (!rig_.elasticity && !can_bend(rig_)) return;
  for (const std::string& name : names) out_.groups.push_back({name, {}, {}, name == kLoads});
  if (!rig_.elasticity || !(rig_.elasticity->added || bends(*rig_.elasticity))) return;
  const Elasticity& elasticity = *rig_.elasticity;
  const Skeleton& skeleton = *elasticity.skeleton;
  MatrixXd squares = MatrixXd::Zero(2, skeleton.size());
  double seen = 0;
  const size_t stride = std::max<size_t>(1, samples_.size() / 100);
  for (size_t s = 0; s < samples_.size(); s += stride, ++seen) {
    const Configuration robot(rig_, table_, table_.initial, samples_[s]->readings);
    for (int i = 0; i < skeleton.size(); ++i) {
      const Vector3d torque = skeleton.basis[i].transpose() * robot.bent()->torque[i];
      if (!torque.allFinite()) continue;
      squares(0, i) += torque.x() * torque.x();
      squares(1, i) += torque.tail<2>().squaredNorm() / 2;
    }
  }
  const Eigen::Vector2d largest = squares.rowwise().maxCoeff(), rms = (largest / seen).cwiseSqrt();
  double heaviest = 0;
  for (const Vector3d& load : elasticity.load) heaviest = std::max(heaviest, load.norm());
  for (size_t j = 0; j < rig_.tree.joints.size(); ++j) {
    const int compliance = table_.compliance[j], load = table_.load[j], i = skeleton.index[j];
    for (int c = 0; c < 3; ++c) {
      if (compliance >= 0 && used_[compliance] &&
          squares(c > 0, i) > kAnyMoment * kAnyMoment * largest(c > 0))
        add(names[c > 0], compliance, c, (c == 0 ? kAbout : kAcross) / rms(c > 0));
      if (load >= 0 && heaviest > 0 && used_[load])
        add(names[2], load, c, std::max(elasticity.load[j].norm(), kLeast * heaviest));
    }
  }
}

/// Marks the groups that names and globs mean.
std::vector<char> chosen(const std::vector<WidthGroup>& groups,
                         const std::vector<std::string>& names, const char* list) {
  std::vector<char> out(groups.size(), 0);
  for (size_t i = 0; i < names.size(); ++i) {
    bool found = false;
    std::vector<std::string> valid;
    for (size_t g = 0; g < groups.size(); ++g) {
      valid.push_back(groups[g].name);
      if (groups[g].name != names[i] && !glob_matches(names[i], groups[g].name)) continue;
      out[g] = 1;
      found = true;
    }
    if (!found)
      throw NameError::group(std::string(list) + "[" + std::to_string(i) + "]", names[i],
                             std::move(valid));
  }
  return out;
}

/// Takes parameters that the rig's own priors name out of the groups: whatever the data depend on
/// (`used`, by parameter) is estimated with its prior.
void place_stated(const Recording& recording, const std::vector<char>& used, AutomaticGroups& out) {
  for (const PriorSetting& prior : recording.rig.priors)
    for (const Freed& f : recording.table.find(prior.pattern, prior.where))
      for (int c : f.components) {
        const Component component{f.parameter, c};
        const auto is = [&](const Member& m) { return m.component == component; };
        const auto drop = [&](std::vector<Member>& members) {
          members.erase(std::remove_if(members.begin(), members.end(), is), members.end());
        };
        drop(out.stated);
        for (WidthGroup& g : out.groups) drop(g.members);
        if (used[f.parameter])
          out.stated.push_back(
              {component, prior.split && c >= 3 ? prior.rotation : prior.translation});
      }
  out.groups.erase(
      std::remove_if(out.groups.begin(), out.groups.end(),
                     [](const WidthGroup& g) { return g.members.empty() && g.unseen.empty(); }),
      out.groups.end());
}

}  // namespace

std::vector<char> numbers_seen(const std::vector<Sample>& samples, int joint,
                               const JointModel& model) {
  std::set<int> pieces;
  for (const Sample& s : samples)
    if (s.train && !std::isnan(s.readings[joint])) pieces.insert(model.piece(s.readings[joint]));
  std::vector<char> out(model.size(), 0);
  for (int k = 0; k < model.size(); ++k)
    out[k] = std::any_of(pieces.begin(), pieces.end(),
                         [&](int piece) { return model.depends(k, piece); });
  return out;
}

std::vector<int> joints_with_backlash(const Rig& rig, const std::vector<Sample>& samples) {
  std::vector<int> out;
  for (int j = 0; j < static_cast<int>(rig.tree.joints.size()); ++j)
    if (std::none_of(rig.sensors.begin(), rig.sensors.end(),
                     [&](const Sensor& s) { return s.scanning_joint == j; }) &&
        std::any_of(samples.begin(), samples.end(), [&](const Sample& s) {
          return s.train && stated(s.conditions.approach, j) != 0;
        }))
      out.push_back(j);
  return out;
}

bool temperature_varies(const std::vector<Sample>& samples) {
  std::set<double> stated;
  for (const Sample& s : samples)
    if (s.train && s.conditions.temperature) stated.insert(*s.conditions.temperature);
  return stated.size() > 1;
}

std::vector<int> next_joints(const Rig& rig, int joint) {
  const Tree& tree = rig.tree;
  const auto above = [&](int j) {  // the next one that moves; -1: none
    do j = tree.joint_above[tree.joints[j].parent];
    while (j >= 0 && !tree.joints[j].moves());
    return j;
  };
  std::vector<int> out;
  const int before = above(joint);
  for (int j = 0; j < static_cast<int>(tree.joints.size()); ++j)
    if (tree.joints[j].has_reading() && tree.joints[j].first_axis < 0 &&
        tree.joints[j].axis_of_pose == PoseAxis::none &&
        tree.joints[j].type != JointType::prismatic && (j == before || above(j) == joint))
      out.push_back(j);
  return out;
}

std::vector<int> sensors_with_rates(const Rig& rig, const std::vector<Sample>& samples) {
  std::set<int> out;
  for (const Sample& s : samples) {
    const std::vector<double>& rates = s.conditions.rates;
    if (!s.train || std::all_of(rates.begin(), rates.end(), [](double r) { return r == 0; }))
      continue;
    for (const View& v : s.views)
      if (rig.sensors[v.sensor].model->measurement_kind() != MeasurementKind::chain)
        out.insert(v.sensor);
  }
  return {out.begin(), out.end()};
}

Rig with_pair_poses(Rig rig) {
  std::set<int> taken;  // joints that stand for a pair's pose
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    std::vector<size_t> others;
    bool named = rig.sensors[s].mount_joint >= 0 || rig.sensors[s].pose_of >= 0;
    for (size_t t = s + 1; t < rig.sensors.size(); ++t)
      if (is_pair(rig, static_cast<int>(s), static_cast<int>(t))) {
        others.push_back(t);
        named = named || rig.sensors[t].mount_joint >= 0 || rig.sensors[t].pose_of >= 0;
      }
    if (others.empty() || named) continue;
    const int joint = joint_of_pair(rig, s);
    if (joint >= 0 && taken.insert(joint).second) continue;
    for (const size_t t : others) rig.sensors[t].pose_of = static_cast<int>(s);
  }
  return rig;
}

AutomaticGroups make_groups(const Recording& recording, const GroupChoice& choice) {
  GroupMaker maker(recording, choice.frames);
  AutomaticGroups out = maker.make();
  const std::vector<char> with = chosen(out.groups, choice.with, "group"),
                          without = chosen(out.groups, choice.without, "no_group");
  std::vector<WidthGroup> kept;
  for (size_t g = 0; g < out.groups.size(); ++g) {
    WidthGroup& group = out.groups[g];
    if (without[g]) continue;
    if (group.members.empty() && group.unseen.empty()) {  // not there yet
      out.further.push_back(group.name);
    } else if (with[g] || group.name != kGears) {
      kept.push_back(std::move(group));
    } else {
      out.gears = std::move(group.members);
    }
  }
  out.groups = std::move(kept);
  place_stated(recording, maker.used(), out);
  return out;
}

std::string nothing_free(const Recording& recording, bool on_demand, bool no_evidence) {
  std::string out = "nothing can be estimated";
  if (!no_evidence && on_demand) return out + ": everything that may be wrong is fixed by options";
  std::map<int, std::set<int>> sensors;  // that see a free target
  for (const Sample& s : recording.samples)
    for (const View& v : s.views)
      if (s.train && recording.rig.targets[v.target].link < 0) sensors[v.target].insert(v.sensor);
  for (const auto& seen : sensors)
    if (seen.second.size() == 1)
      out += "; target " + quoted(recording.rig.targets[seen.first].name) +
             " is free and seen by sensor " +
             quoted(recording.rig.sensors[*seen.second.begin()].name) +
             " alone: its own pose in every sample explains all views of this sensor. Mount it "
             "(`mount: {link: NAME}`) on the link that carries it, or let a second sensor see it";
  return out + (no_evidence ? "; no mount is estimated, and there is no evidence that another "
                              "parameter is off its nominal value"
                            : "; no measurement depends on a mount, joint, lens or size");
}

}  // namespace kincal
