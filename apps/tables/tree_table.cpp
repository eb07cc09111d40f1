#include "tree_table.h"

#include <vector>

#include "../../io/urdf/urdf.h"
#include "../../models/rig/words.h"
#include "table.h"

namespace kincal {
namespace {

std::string limits_text(const Joint& joint) {
  if (!joint.has_axis()) return "";
  if (joint.lower == joint.upper) return "no limits";
  return text("%.4g to %.4g ", joint.lower, joint.upper) +
         (joint.type == JointType::prismatic ? "m" : "rad");
}

std::string mimic_text(const Tree& tree, const Joint& joint) {
  if (!joint.mimic) return "";
  return "mimics " + tree.joints[joint.mimic->master].name +
         text(" (times %.4g, plus %.4g)", joint.mimic->multiplier, joint.mimic->offset) +
         (joint.stands_at ? ": stands still" : "");
}

}  // namespace

std::string tree_table(const Tree& tree) {
  std::vector<std::vector<std::string>> rows = {{"link", "joint above", "type", "limits", "", ""}};
  std::vector<std::vector<int>> below(tree.links.size());
  for (size_t j = 0; j < tree.joints.size(); ++j)
    below[tree.joints[j].parent].push_back(static_cast<int>(j));
  struct Place {
    int link;
    size_t depth;
  };
  std::vector<Place> open = {{tree.root, 0}};
  while (!open.empty()) {
    const Place here = open.back();
    open.pop_back();
    const int above = tree.joint_above[here.link];
    std::vector<std::string> row = {std::string(2 * here.depth, ' ') + tree.links[here.link]};
    if (above >= 0) {
      const Joint& joint = tree.joints[above];
      const Vector3d& a = joint.axis;
      row.insert(row.end(), {joint.name, type_name(joint.type), limits_text(joint),
                             joint.has_axis() ? text("axis %.3g", a.x() + 0.0) +
                                                    text(" %.3g %.3g", a.y() + 0.0, a.z() + 0.0)
                                              : "",
                             mimic_text(tree, joint)});
    }
    row.resize(rows[0].size());
    rows.push_back(std::move(row));
    for (auto j = below[here.link].rbegin(); j != below[here.link].rend(); ++j)
      open.push_back({tree.joints[*j].child, here.depth + 1});
  }
  return align(rows, static_cast<int>(rows[0].size()));
}

}  // namespace kincal
