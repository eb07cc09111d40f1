#include "joint_mistakes.h"

#include <algorithm>
#include <cmath>

#include "../rig/numbers.h"
#include "../rig/words.h"

namespace kincal {
namespace {

/// Replaces a joint's readings, also those that a scanner has of it in its rays.
void change_readings(const Rig& rig, std::vector<Sample>& samples, int joint,
                     const std::function<double(double)>& change) {
  for (Sample& s : samples) {
    s.readings[joint] = change(s.readings[joint]);
    for (View& v : s.views)
      if (rig.sensors[v.sensor].scanning_joint == joint)
        for (size_t i = 0; i + 2 < v.z.size(); i += 3) v.z[i] = change(v.z[i]);
  }
}

}  // namespace

void add_joints(const Rig& rig, const std::vector<Sample>& samples, const Survey& survey,
                std::vector<Hypothesis>& out) {
  std::vector<int> too_far;
  for (const auto& range : survey.ranges) {
    const int j = range.first;
    const Joint& joint = rig.tree.joints[j];
    const double low = range.second.first, high = range.second.second;
    if (high - low > 1e-9) {
      Hypothesis h;
      h.id = "joint-sign";
      h.where = {joint.name};
      h.mistake =
          "joint " + quoted(joint.name) +
          " turns the other way: its readings, or its axis in the URDF, have the wrong sign";
      if (joint.type == JointType::prismatic)
        h.mistake =
            "joint " + quoted(joint.name) +
            " moves the other way: its readings, or its axis in the URDF, have the wrong sign";
      h.cure = "Change the sign of its readings, or of its <axis> in the URDF.";
      h.undo = [j](Rig& r, std::vector<Sample>& s) {
        change_readings(r, s, j, [](double q) { return -q; });
      };
      out.push_back(h);
    } else if (samples.size() > 1) {
      Hypothesis h;
      h.id = "still-joint";
      h.where = {joint.name};
      h.mistake =
          "joint " + quoted(joint.name) + " has the same reading in all samples, but it moved";
      h.cure = "Record its readings: what was logged is a constant.";
      h.ignored_joint = j;
      h.undo = [](Rig&, std::vector<Sample>&) {};
      out.push_back(h);
    }
    if (joint.type == JointType::prismatic) continue;
    const double most = std::max(std::abs(low), std::abs(high));
    const bool limited = joint.type == JointType::revolute && joint.upper > joint.lower;
    const double reach = limited ? std::max(std::abs(joint.lower), std::abs(joint.upper)) : 2 * kPi;
    if (most > 2 * kPi + 0.1 || most > reach + 1) too_far.push_back(j);
  }
  if (too_far.empty()) return;
  std::vector<int> turning;
  for (const auto& range : survey.ranges)
    if (rig.tree.joints[range.first].type != JointType::prismatic) turning.push_back(range.first);
  std::vector<std::vector<int>> groups = {turning};
  if (too_far.size() < turning.size()) groups.push_back(too_far);
  if (too_far.size() > 1)
    for (int j : too_far) groups.push_back({j});
  for (const std::vector<int>& group : groups) {
    Hypothesis h;
    h.id = "degrees";
    for (int j : group) h.where.push_back(rig.tree.joints[j].name);
    std::string names;
    for (const std::string& name : h.where) names += (names.empty() ? "" : ", ") + quoted(name);
    h.mistake = std::string("the readings of joint") + (group.size() > 1 ? "s " : " ") + names +
                " are degrees";
    h.cure = "Write radians: multiply them by pi / 180.";
    h.undo = [group](Rig& r, std::vector<Sample>& s) {
      for (int j : group) change_readings(r, s, j, [](double q) { return q * kPi / 180; });
    };
    out.push_back(h);
  }
}

}  // namespace kincal
