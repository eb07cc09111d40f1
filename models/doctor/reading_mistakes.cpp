#include "reading_mistakes.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kFarSlide = 3;    // m: a sliding joint without limits hardly moves as far
constexpr double kLongLink = 2;    // m: hardly a link of a robot is as long
constexpr int kNearOnes = 3;       // joints are exchanged with one of the next so many
constexpr size_t kFewTargets = 6;  // of more, no two are exchanged by name
constexpr size_t kFewPairs = 64;   // of more, two signs in two arms are not tried
constexpr double kParallel = 0.99;

bool turns(const Joint& joint) {
  return joint.type == JointType::revolute || joint.type == JointType::continuous;
}

/// The next joint with a reading on the way to the root; -1: none.
int moving_joint_above(const Tree& tree, int joint) {
  int j = tree.joint_above[tree.joints[joint].parent];
  while (j >= 0 && !tree.joints[j].has_reading()) j = tree.joint_above[tree.joints[j].parent];
  return j;
}

/// A joint's axis in the frame of a joint above it, all between at position zero.
Vector3d axis_seen_from(const Tree& tree, int above, int joint) {
  Vector3d axis = tree.joints[joint].axis;
  for (int j = joint; j >= 0 && j != above; j = tree.joint_above[tree.joints[j].parent])
    axis = pose_at_zero(tree.joints[j]).rotation * axis;
  return axis;
}

void add_zeros(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (const auto& range : observations.ranges) {
    const int j = range.first;
    if (!turns(rig.tree.joints[j])) continue;
    const std::string name = quoted(rig.tree.joints[j].name);
    for (const double turn : {kPi / 2, -kPi / 2, kPi}) {
      const std::string more = turn > 3 ? "pi" : turn > 0 ? "pi/2" : "-pi/2";
      out.push_back({NoticeKind::home_position,
                     {Subject::joint(rig.tree.joints[j].name)},
                     "the readings of joint " + name +
                         " do not count from the URDF's zero: " + more + " has to be added to them",
                     "add " + more +
                         " to its readings, or turn its <origin> in the URDF by as much about "
                         "its axis (or joints." +
                         rig.tree.joints[j].name + ".offset: " + text("%.5f", turn) +
                         " in the rig)",
                     of_readings({j}, [turn](double q) { return q + turn; })});
    }
  }
}

/// Axes of turning joints: another of their frame's axes, either way round.
void add_axes(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (const auto& range : observations.ranges) {
    const Joint& joint = rig.tree.joints[range.first];
    if (!turns(joint) || range.second.second - range.second.first < 0.1) continue;
    for (int axis = 0; axis < 3; ++axis)
      for (const double sign : {1.0, -1.0}) {
        const Vector3d other = sign * Vector3d::Unit(axis);
        if (std::abs(other.dot(joint.axis)) > 0.1) continue;
        const std::string xyz = text("%g %g %g", other(0) + 0, other(1) + 0, other(2) + 0);
        out.push_back({NoticeKind::joint_axis,
                       {Subject::joint(joint.name)},
                       "joint " + quoted(joint.name) + " turns about another axis than in the URDF",
                       "write <axis xyz=\"" + xyz +
                           "\"/>, in the joint's own frame (or turn its <origin>, and the next "
                           "one's back)",
                       [j = range.first, other](Rig& r) { r.tree.joints[j].axis = other; }});
      }
  }
}

/// Whether all samples have readings of both joints or of none.
bool have_both(const std::vector<Sample>& samples, int a, int b) {
  return std::all_of(samples.begin(), samples.end(), [&](const Sample& s) {
    return std::isfinite(s.readings[a]) == std::isfinite(s.readings[b]);
  });
}

Undo exchange(const std::vector<std::pair<int, int>>& pairs) {
  return [pairs](Rig&, std::vector<Sample>& samples) {
    for (Sample& s : samples)
      for (const auto& p : pairs) std::swap(s.readings[p.first], s.readings[p.second]);
  };
}

void add_exchanged_joints(const Rig& rig, const std::vector<Sample>& samples,
                          const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  const Tree& tree = rig.tree;
  for (const auto& range : observations.ranges) {
    const int b = range.first;
    int a = b;
    for (int k = 0; k < kNearOnes; ++k) {
      a = moving_joint_above(tree, a);
      if (a < 0) break;
      if (!observations.ranges.count(a) || turns(tree.joints[a]) != turns(tree.joints[b]) ||
          !have_both(samples, a, b))
        continue;
      const std::string &above = tree.joints[a].name, &below = tree.joints[b].name;
      out.push_back(
          {NoticeKind::exchanged_joints,
           {Subject::joint(above), Subject::joint(below)},
           "the readings of joints " + quoted(above) + " and " + quoted(below) + " are exchanged",
           "exchange the two names in the samples: the log lists joints in another order",
           exchange({{a, b}})});
    }
  }
}

/// Numbers in the order of the arm under names in another, or the reverse: those of all joints.
void add_joint_orders(const Rig& rig, const std::vector<Sample>& samples,
                      const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  std::vector<int> along;
  for (const auto& range : observations.ranges) along.push_back(range.first);
  if (along.size() < 3) return;
  for (const int j : along) {
    if (!have_both(samples, along[0], j)) return;
    for (const int s : observations.sensors)
      if (rig.sensors[s].scanning_joint == j) return;
  }
  std::vector<int> by_name = along, reversed(along.rbegin(), along.rend());
  std::sort(by_name.begin(), by_name.end(),
            [&](int a, int b) { return rig.tree.joints[a].name < rig.tree.joints[b].name; });
  const std::string names = "the names' alphabetical order", back = "reversed order";
  struct Order {
    std::vector<int> from, to;  // the reading of to[k] is given as that of from[k]
    std::string mistake;
  };
  std::vector<Order> orders = {
      {along, by_name, "stand in " + names + ", but under the names in the order of the arm"},
      {by_name, along, "stand in the order of the arm, but under the names in alphabetical order"},
      {along, reversed, "stand in " + back}};
  for (size_t k = 1; k < along.size(); ++k) {  // columns that begin with another joint
    std::vector<int> rotated = along;
    std::rotate(rotated.begin(), rotated.begin() + static_cast<long>(k), rotated.end());
    orders.push_back({rotated, along,
                      "begin with that of another joint: the first, of " +
                          quoted(rig.tree.joints[along[0]].name) + ", is given as that of " +
                          quoted(rig.tree.joints[rotated[0]].name) + ", and so on"});
  }
  std::set<std::vector<std::pair<int, int>>> told;  // which reading goes where
  for (size_t i = 0; i < orders.size(); ++i) {
    std::vector<std::pair<int, int>> moves;
    for (size_t k = 0; k < along.size(); ++k) moves.push_back({orders[i].from[k], orders[i].to[k]});
    std::sort(moves.begin(), moves.end());
    if (orders[i].from == orders[i].to || !told.insert(moves).second) continue;
    Subjects where;
    for (const int j : along) where.push_back(Subject::joint(rig.tree.joints[j].name));
    out.push_back(
        {NoticeKind::exchanged_joints, where,
         "the readings of joints " + joined(names_of(where)) + " " + orders[i].mistake,
         "give each joint the reading that belongs to its name: /joint_states is often in "
         "alphabetical order, and columns of a log may begin with another joint",
         [from = orders[i].from, to = orders[i].to](Rig&, std::vector<Sample>& all) {
           for (Sample& s : all) {
             const std::vector<double> given = s.readings;
             for (size_t k = 0; k < from.size(); ++k) s.readings[to[k]] = given[from[k]];
           }
         }});
  }
}

/// The joint whose name has the other side in one place; -1: there is none.
int other_side(const Tree& tree, const std::string& name) {
  static const std::pair<std::string, std::string> sides[] = {
      {"left", "right"}, {"Left", "Right"}, {"LEFT", "RIGHT"}, {"l", "r"}, {"L", "R"}};
  for (const auto& side : sides)
    for (const auto& [here, there] : {side, std::pair(side.second, side.first)})
      for (size_t at = name.find(here); at != std::string::npos; at = name.find(here, at + 1))
        if (const int found = tree.find_joint(std::string(name).replace(at, here.size(), there));
            found >= 0)
          return found;
  return -1;
}

void add_exchanged_arms(const Rig& rig, const std::vector<Sample>& samples,
                        const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  std::vector<std::pair<int, int>> pairs;
  Subjects where;
  for (const auto& range : observations.ranges) {
    const int a = range.first;
    const int b = other_side(rig.tree, rig.tree.joints[a].name);
    if (b <= a || !observations.ranges.count(b)) continue;
    // (A sample that has one arm only gets the other's readings.)
    pairs.push_back({a, b});
    for (const int j : {a, b}) where.push_back(Subject::joint(rig.tree.joints[j].name));
  }
  if (pairs.size() < 2) return;
  if (!std::all_of(pairs.begin(), pairs.end(),
                   [&](const auto& p) { return have_both(samples, p.first, p.second); }))
    return;
  out.push_back({NoticeKind::exchanged_joints, std::move(where),
                 "the readings of the left and the right arm are exchanged",
                 "exchange left and right in the samples: in the joints' names, or in the views",
                 exchange(pairs)});
}

void add_exchanged_targets(const Rig& rig, const ObservationIndex& observations,
                           std::vector<Hypothesis>& out) {
  std::vector<int> mounted;
  for (int t : observations.targets)
    if (rig.targets[t].link >= 0) mounted.push_back(t);
  if (mounted.size() > kFewTargets) return;
  for (int a : mounted)
    for (int b : mounted) {
      if (a >= b || rig.targets[a].count() != rig.targets[b].count() ||
          immobile_body(rig.tree, rig.targets[a].link) ==
              immobile_body(rig.tree, rig.targets[b].link))
        continue;
      out.push_back({NoticeKind::exchanged_targets,
                     {Subject::target(rig.targets[a].name), Subject::target(rig.targets[b].name)},
                     "targets " + quoted(rig.targets[a].name) + " and " +
                         quoted(rig.targets[b].name) + " are exchanged",
                     "exchange the two names, in the rig or in the views",
                     of_views(-1, [a, b](const Rig&, View& v) {
                       if (v.target == a || v.target == b) v.target = a + b - v.target;
                     })});
    }
}

void add_absolute_angles(const Rig& rig, const std::vector<Sample>& samples,
                         const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  const Tree& tree = rig.tree;
  for (const auto& range : observations.ranges) {
    const int b = range.first;
    int a = moving_joint_above(tree, b);
    while (a >= 0 && !turns(tree.joints[a])) a = moving_joint_above(tree, a);  // past a slide
    if (a < 0 || !observations.ranges.count(a) || !turns(tree.joints[a]) ||
        !turns(tree.joints[b]) || !have_both(samples, a, b) ||
        std::abs(tree.joints[a].axis.dot(axis_seen_from(tree, a, b))) < kParallel)
      continue;
    for (const double sign : {1.0, -1.0}) {
      const std::string of = quoted(tree.joints[a].name), name = quoted(tree.joints[b].name),
                        given = sign > 0 ? "sum" : "difference";
      out.push_back({NoticeKind::absolute_angle,
                     {Subject::joint(tree.joints[b].name), Subject::joint(tree.joints[a].name)},
                     "the readings of joint " + name + " are not its own angle but its " + given +
                         (sign > 0 ? " with" : " to") + " that of " + of +
                         ", as in an arm whose motors turn its links relative to the base",
                     std::string(sign > 0 ? "subtract" : "add") + " the reading of " + of +
                         (sign > 0 ? " from" : " to") + " that of " + name + " in every sample",
                     [a, b, sign](Rig&, std::vector<Sample>& all) {
                       for (Sample& s : all) s.readings[b] -= sign * s.readings[a];
                     }});
    }
  }
}

/// Whether a joint moves another.
bool is_above(const Tree& tree, int above, int joint) {
  int a = joint;
  while (a >= 0 && a != above) a = moving_joint_above(tree, a);
  return a >= 0;
}

/// Two joints of one arm, or of two arms that are not too many, and all joints.
void add_sign_groups(const Rig& rig, const ObservationIndex& observations,
                     std::vector<Hypothesis>& out) {
  std::vector<int> moving;
  for (const auto& range : observations.ranges)
    if (range.second.second - range.second.first > 1e-9) moving.push_back(range.first);
  for (int b : moving)
    for (int a = moving_joint_above(rig.tree, b); a >= 0; a = moving_joint_above(rig.tree, a))
      if (std::count(moving.begin(), moving.end(), a)) out.push_back(wrong_signs(rig, {a, b}));
  std::vector<std::vector<int>> apart;
  for (int a : moving)
    for (int b : moving)
      if (a < b && !is_above(rig.tree, a, b) && !is_above(rig.tree, b, a)) apart.push_back({a, b});
  if (apart.size() <= kFewPairs)
    for (const std::vector<int>& pair : apart) out.push_back(wrong_signs(rig, pair));
  if (moving.size() > 2) out.push_back(wrong_signs(rig, moving));
}

/// Sensors that measure lengths by a scale of their own.
std::string sensors_of_lengths(const Rig& rig, const ObservationIndex& observations) {
  std::vector<std::string> names;
  for (const int s : observations.sensors) {
    const MeasurementKind kind = rig.sensors[s].model->measurement_kind();
    if (kind == MeasurementKind::points || kind == MeasurementKind::pose ||
        kind == MeasurementKind::scan)
      names.push_back(rig.sensors[s].name);
  }
  return joined(names);
}

void add_gears(const Rig& rig, const ParameterTable& table, const ObservationIndex& observations,
               const FreedNames& freed, std::vector<Hypothesis>& out) {
  for (const auto& range : observations.ranges) {
    const int j = range.first, scale = table.joint_scale[j];
    if (scale < 0 || freed.parameter[scale] || range.second.second - range.second.first < 0.1)
      continue;
    Hypothesis h{NoticeKind::gear, {Subject::joint(rig.tree.joints[j].name)}};
    h.free = {table.all[scale].name};
    h.rarer = true;
    const std::string lengths = rig.tree.joints[j].type == JointType::prismatic
                                    ? sensors_of_lengths(rig, observations)
                                    : std::string();
    h.told = [given = rig.joints[j].scale, joint = h.where[0].name, name = h.free[0],
              lengths](const std::vector<double>& found) {
      const double times = found[0] / given;
      const std::string mistake =
          "joint " + quoted(joint) +
          text(
              " moves %.5g times its readings: its gear ratio or encoder count is wrong by %.2g %%",
              times, 100 * std::abs(times - 1));
      const bool is_gear = times > 0.3 && times < 3 &&
                           std::abs(times - 1) > scales(ParameterKind::joint_scale, "").least;
      return std::pair(
          is_gear ? mistake : "",
          (lengths.empty() ? std::string("correct it")
                           : "or the instrument that measures lengths (" + lengths +
                                 ") has a wrong scale, which looks the same: measure a known "
                                 "distance with both first. If it is the joint, correct it") +
              " where the readings are computed (or state joints." + joint +
              text(".scale: %.5g", found[0]) + " in the rig, or free " + name + ")");
    };
    out.push_back(std::move(h));
  }
}

}  // namespace

Undo of_readings(const std::vector<int>& joints, std::function<double(double)> change) {
  return [joints, change = std::move(change)](Rig& rig, std::vector<Sample>& samples) {
    for (Sample& s : samples)
      for (const int j : joints) {
        s.readings[j] = change(s.readings[j]);
        for (View& v : s.views)
          if (rig.sensors[v.sensor].scanning_joint == j)
            for (size_t i = 0; i + 2 < v.z.size(); i += 3) v.z[i] = change(v.z[i]);
      }
  };
}

Hypothesis wrong_signs(const Rig& rig, const std::vector<int>& joints) {
  Subjects where;
  for (int j : joints) where.push_back(Subject::joint(rig.tree.joints[j].name));
  const bool one = joints.size() == 1,
             slides = one && rig.tree.joints[joints[0]].type == JointType::prismatic;
  return {NoticeKind::joint_sign, where,
          (one ? "joint " + quoted(where[0].name) : "joints " + joined(names_of(where))) +
              (slides ? " moves"
               : one  ? " turns"
                      : " turn") +
              " the other way: " +
              (one ? "its readings, or its axis in the URDF, have the wrong sign"
                   : "their readings, or their axes in the URDF, have the wrong sign"),
          one ? "change the sign of its readings, or of its <axis> in the URDF"
              : "change the signs of their readings, or of their <axis> in the URDF",
          of_readings(joints, [](double q) { return -q; })};
}

const std::vector<LengthUnit>& other_length_units() {
  static const std::vector<LengthUnit> all = {
      {"millimetres", "divide by 1000", 0.001},
      {"centimetres", "divide by 100", 0.01},
      {"inches", "multiply by 0.0254", 0.0254},
      {"feet", "multiply by 0.3048", 0.3048},
  };
  return all;
}

void add_length_units(const Rig& rig, const ObservationIndex& observations,
                      std::vector<Hypothesis>& out) {
  for (const auto& range : observations.ranges) {
    const Joint& joint = rig.tree.joints[range.first];
    if (joint.type != JointType::prismatic) continue;
    const double most = std::max(std::abs(range.second.first), std::abs(range.second.second)),
                 reach = joint.upper > joint.lower
                             ? 1.5 * std::max(std::abs(joint.lower), std::abs(joint.upper))
                             : kFarSlide;
    if (!(most > reach)) continue;
    for (const LengthUnit& unit : other_length_units()) {
      out.push_back(
          {NoticeKind::units,
           {Subject::joint(joint.name)},
           "the readings of sliding joint " + quoted(joint.name) + " are " + unit.name,
           std::string("write metres: ") + unit.cure,
           of_readings({range.first}, [factor = unit.metres](double q) { return q * factor; })});
    }
  }
  std::vector<int> far, long_ones;
  for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
    const double length = rig.tree.joints[j].parent_T_joint.translation.norm();
    if (length > 0) far.push_back(static_cast<int>(j));
    if (length > kLongLink) long_ones.push_back(static_cast<int>(j));
  }
  std::vector<std::vector<int>> groups;
  if (long_ones.size() <= 2)
    for (int j : long_ones) groups.push_back({j});
  if (long_ones.size() > 1) groups.push_back(far);
  for (const std::vector<int>& group : groups)
    for (const LengthUnit& unit : other_length_units()) {
      Hypothesis h{NoticeKind::units};
      for (int j : group) h.where.push_back(Subject::joint(rig.tree.joints[j].name));
      const bool one = group.size() == 1;
      const double length = rig.tree.joints[group[0]].parent_T_joint.translation.norm();
      h.mistake = std::string(one ? "the <origin> of joint " : "the <origin>s of joints ") +
                  joined(names_of(h.where)) + (one ? " is" : " are") + " given in " + unit.name +
                  " in the URDF" + (one ? text(" (%.4g)", length) : "");
      h.cure = std::string("write metres into the URDF: ") + unit.cure +
               (one ? text(" (%.4g)", length * unit.metres) : "");
      h.undo = [group, factor = unit.metres](Rig& r) {
        for (int j : group) r.tree.joints[j].parent_T_joint.translation *= factor;
      };
      out.push_back(std::move(h));
    }
}

void add_rarer_readings(const Rig& rig, const ParameterTable& table,
                        const std::vector<Sample>& samples, const FreedNames& freed,
                        std::vector<Hypothesis>& out) {
  const ObservationIndex observations = make_observation_index(rig, samples);
  add_zeros(rig, observations, out);
  add_axes(rig, observations, out);
  add_exchanged_joints(rig, samples, observations, out);
  add_joint_orders(rig, samples, observations, out);
  add_exchanged_arms(rig, samples, observations, out);
  add_exchanged_targets(rig, observations, out);
  add_absolute_angles(rig, samples, observations, out);
  add_sign_groups(rig, observations, out);
  add_gears(rig, table, observations, freed, out);
}

}  // namespace kincal
