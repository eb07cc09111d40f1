#include "robot_entry.h"

#include <filesystem>
#include <stdexcept>

namespace kincal {
namespace {

/// The robot that the rig names, relative to the rig's own file.
std::string robot_path(const Field& field, const std::string& rig_path) {
  const std::filesystem::path path = std::filesystem::path(rig_path).parent_path() / field.string();
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored))
    field.fail("file '" + path.string() + "' does not exist");
  return path.string();
}

Urdf read_flange_robot(const Field& robot, const std::string& path) {
  robot.check_keys({"base", "flange"});
  try {
    return flange_robot(robot["base"].string(), robot["flange"].string(), path);
  } catch (const std::invalid_argument& e) {
    robot.fail(e.what());
  }
}

}  // namespace

Urdf flange_robot(const std::string& base, const std::string& flange, const std::string& path) {
  if (base == flange) throw std::invalid_argument("base and flange are two links, with two names");
  for (const std::string& name : {base, flange})
    if (name.empty() || name.find_first_of("<>&\"") != std::string::npos)
      throw std::invalid_argument("the name of a link has no < > & \" and is not empty");
  return parse_urdf("<robot name=\"" + flange + "\"><link name=\"" + base + "\"/><link name=\"" +
                        flange + "\"/><joint name=\"" + kFlangeJoint +
                        "\" type=\"floating\"><parent link=\"" + base + "\"/><child link=\"" +
                        flange + "\"/></joint></robot>\n",
                    path);
}

Urdf read_robot_entry(const Field& robot, const std::string& rig_path) {
  return robot.node->kind == Node::Kind::mapping ? read_flange_robot(robot, rig_path)
                                                 : read_urdf(robot_path(robot, rig_path));
}

}  // namespace kincal
