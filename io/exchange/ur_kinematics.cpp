#include "ur_kinematics.h"

#include <utility>

#include "../document/document.h"
#include "../document/files.h"
#include "../document/names.h"
#include "../document/yaml.h"
#include "lens.h"

namespace kincal {
namespace {

/// Parts of the file, and the joints whose origins they are.
constexpr std::pair<const char*, const char*> kUrParts[] = {
    {"shoulder", "shoulder_pan_joint"}, {"upper_arm", "shoulder_lift_joint"},
    {"forearm", "elbow_joint"},         {"wrist_1", "wrist_1_joint"},
    {"wrist_2", "wrist_2_joint"},       {"wrist_3", "wrist_3_joint"}};

}  // namespace

std::vector<int> ur_joints(const Tree& tree, const std::string& prefix) {
  std::string before = prefix;
  if (prefix.empty()) {  // the one before NAMEshoulder_pan_joint
    const std::string first = kUrParts[0].second;
    std::vector<std::string> found;
    for (const Joint& joint : tree.joints)
      if (joint.name.size() >= first.size() &&
          joint.name.compare(joint.name.size() - first.size(), first.size(), first) == 0)
        found.push_back(joint.name.substr(0, joint.name.size() - first.size()));
    if (found.empty())
      throw InputError("the robot has no joint '" + first +
                       "': joints named like those of Universal Robots are expected");
    if (found.size() > 1)
      throw InputError("the robot has several arms: take --prefix with one of " +
                       comma_separated(found));
    before = found[0];
  }
  std::vector<int> out;
  for (const auto& [part, joint] : kUrParts) {
    out.push_back(tree.find_joint(before + joint));
    std::vector<std::string> names;
    for (const Joint& j : tree.joints) names.push_back(j.name);
    if (out.back() < 0)
      throw InputError("the robot has no joint '" + before + joint + "'" +
                       nearest_names(before + joint, names));
  }
  return out;
}

UrKinematics read_ur_kinematics(const std::string& path) {
  const Node node = parse_yaml(read_file(path), path);
  const Field all = top(node, path);
  if (!all.has("kinematics")) all.fail("'kinematics' is missing: is this a kinematics file?");
  const Field kinematics = all["kinematics"];
  std::vector<std::string> parts;
  for (const auto& [part, joint] : kUrParts) parts.push_back(part);
  kinematics.check_keys(parts, {"hash"});
  UrKinematics out;
  for (const std::string& part : parts) {
    const Field f = kinematics[part];
    f.check_keys({"x", "y", "z", "roll", "pitch", "yaw"});
    const auto number = [&](const char* key) { return f[key].number(); };
    out.origins.push_back({rotation_from_rpy({number("roll"), number("pitch"), number("yaw")}),
                           {number("x"), number("y"), number("z")}});
  }
  if (kinematics.has("hash")) out.hash = kinematics["hash"].string();
  return out;
}

std::string ur_kinematics_text(const UrKinematics& kinematics) {
  std::string out = "kinematics:\n";
  size_t i = 0;
  for (const auto& [part, joint] : kUrParts) {
    const Pose& pose = kinematics.origins[i++];
    const Vector3d rpy = rpy_from_rotation(pose.rotation);
    out += std::string("  ") + part + ":\n";
    const char* const keys[] = {"x", "y", "z", "roll", "pitch", "yaw"};
    for (int k = 0; k < 6; ++k)
      out += std::string("    ") + keys[k] + ": " +
             real_text(k < 3 ? pose.translation[k] : rpy[k - 3]) + "\n";
  }
  return out + "  hash: " + yaml_text(kinematics.hash) + "\n";
}

}  // namespace kincal
