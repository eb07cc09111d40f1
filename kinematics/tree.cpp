#include "tree.h"

#include <algorithm>
#include <stdexcept>

namespace kincal {
namespace {

int find_name(const std::vector<std::string>& names, const std::string& name) {
  const auto it = std::find(names.begin(), names.end(), name);
  return it == names.end() ? -1 : static_cast<int>(it - names.begin());
}

}  // namespace

int Tree::find_link(const std::string& name) const { return find_name(links, name); }

int Tree::find_joint(const std::string& name) const {
  for (size_t i = 0; i < joints.size(); ++i)
    if (joints[i].name == name) return static_cast<int>(i);
  return -1;
}

void finish_tree(Tree& tree) {
  const int links = static_cast<int>(tree.links.size()),
            joints = static_cast<int>(tree.joints.size());
  if (links == 0) throw std::invalid_argument("the robot has no links");
  tree.joint_above.assign(links, -1);
  for (int j = 0; j < joints; ++j) {
    int& above = tree.joint_above[tree.joints[j].child];
    if (above >= 0)
      throw std::invalid_argument("link '" + tree.links[tree.joints[j].child] +
                                  "' has two parents: joints '" + tree.joints[above].name +
                                  "' and '" + tree.joints[j].name + "'");
    above = j;
  }
  tree.root = -1;
  std::string roots;
  int root_count = 0;
  for (int l = 0; l < links; ++l)
    if (tree.joint_above[l] < 0) {
      tree.root = l;
      ++root_count;
      roots += (roots.empty() ? "'" : ", '") + tree.links[l] + "'";
    }
  for (int l = 0; l < links; ++l) {  // every walk up must end at a root after at most `links` steps
    int at = l, steps = 0;
    while (tree.joint_above[at] >= 0 && steps <= links)
      at = tree.joints[tree.joint_above[at]].parent, ++steps;
    if (steps > links)
      throw std::invalid_argument("the joints above link '" + tree.links[l] + "' form a loop");
  }
  if (root_count > 1)
    throw std::invalid_argument("the links form several trees, with the roots " + roots);
  for (int j = 0; j < joints; ++j) {
    Joint& joint = tree.joints[j];
    const Joint* at = &joint;
    for (int steps = 0; at->mimic; ++steps) {
      if (steps > joints)
        throw std::invalid_argument("joint '" + joint.name + "' mimics itself, by way of others");
      at = &tree.joints[at->mimic->master];
    }
    joint.stands_at.reset();
    if (joint.mimic && !at->has_axis()) joint.stands_at = driver(tree, j).offset;
  }
}

Driver driver(const Tree& tree, int joint) {
  Driver out{joint, 1, 0};
  while (tree.joints[out.joint].mimic) {
    const Mimic& m = *tree.joints[out.joint].mimic;
    out = {m.master, out.factor * m.multiplier, out.offset + out.factor * m.offset};
  }
  return out;
}

void follow_mimics(const Tree& tree, std::vector<double>& positions) {
  for (size_t j = 0; j < tree.joints.size(); ++j)
    if (tree.joints[j].mimic) {
      const Driver d = driver(tree, static_cast<int>(j));
      positions[j] = d.factor * positions[d.joint] + d.offset;
    }
}

Path find_path(const Tree& tree, int from, int to) {
  const auto upward = [&](int link) {
    std::vector<int> joints;
    joints.reserve(32);
    for (int j = tree.joint_above[link]; j >= 0; j = tree.joint_above[tree.joints[j].parent])
      joints.push_back(j);
    return joints;
  };
  std::vector<int> up = upward(from), down = upward(to);
  while (!up.empty() && !down.empty() && up.back() == down.back()) up.pop_back(), down.pop_back();
  Path path;
  path.reserve(up.size() + down.size());
  for (int j : up) path.push_back({j, -1});
  for (auto j = down.rbegin(); j != down.rend(); ++j) path.push_back({*j, +1});
  for (const PathStep& step : path) {
    const Joint& joint = tree.joints[step.joint];
    if ((joint.type == JointType::floating && joint.first_axis < 0) ||
        joint.type == JointType::planar)
      throw std::invalid_argument(
          "joint '" + joint.name + "' between links '" + tree.links[from] + "' and '" +
          tree.links[to] + "' is " + (joint.type == JointType::floating ? "floating" : "planar") +
          "; only fixed, revolute, continuous and prismatic joints can be calibrated");
  }
  return path;
}

std::pair<double, double> usual_range(const Joint& joint) {
  if (joint.axis_of_pose == PoseAxis::error) return {0, 0};
  const double without = joint.type == JointType::prismatic ? 0.5 : kPi;
  if (joint.type == JointType::continuous || !(joint.lower < joint.upper))
    return {-without, without};
  return {joint.lower, joint.upper};
}

Pose joint_motion(const Joint& joint, double position) {
  Pose motion;
  const double q = joint.stands_at.value_or(position);
  if (joint.type == JointType::prismatic)
    motion.translation = q * joint.axis;
  else if (joint.has_axis())
    motion.rotation = rotation_about(joint.axis, q);
  return motion;
}

std::vector<Pose> link_poses(const Tree& tree, const std::vector<Pose>& origins,
                             const std::vector<double>& positions) {
  std::vector<Pose> poses(tree.links.size());
  std::vector<char> done(tree.links.size(), 0);
  done[tree.root] = 1;
  std::vector<int> chain;
  for (size_t l = 0; l < tree.links.size(); ++l) {
    chain.clear();
    int at = static_cast<int>(l);
    for (; !done[at]; at = tree.joints[tree.joint_above[at]].parent)
      chain.push_back(tree.joint_above[at]);
    for (auto j = chain.rbegin(); j != chain.rend(); ++j) {
      const Joint& joint = tree.joints[*j];
      poses[joint.child] = poses[joint.parent] * origins[*j] * joint_motion(joint, positions[*j]);
      done[joint.child] = 1;
    }
  }
  return poses;
}

std::vector<Pose> fold_offsets(const Tree& tree, const std::vector<Pose>& origins,
                               const std::vector<double>& offsets) {
  std::vector<Pose> folded = origins;
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    const Driver d = driver(tree, static_cast<int>(j));
    const double offset = tree.joints[d.joint].moves() ? d.factor * offsets[d.joint] : 0;
    if (offset != 0) folded[j] = origins[j] * joint_motion(tree.joints[j], offset);
  }
  return folded;
}

}  // namespace kincal
