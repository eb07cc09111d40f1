#include "urdf.h"

#include <algorithm>
#include <cstring>
#include <locale>
#include <map>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/kinds.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "xml.h"

namespace kincal {
namespace {

constexpr double kMostTurned = 6.3;  // rad: a turn, however it was rounded

constexpr std::pair<const char*, JointType> kTypes[] = {
    {"fixed", JointType::fixed},           {"revolute", JointType::revolute},
    {"continuous", JointType::continuous}, {"prismatic", JointType::prismatic},
    {"floating", JointType::floating},     {"planar", JointType::planar}};

JointType read_type(const Xml& xml, const pugi::xml_node& element) {
  const std::string type = name_in(xml, element, "type");
  std::string valid;
  for (const auto& [name, value] : kTypes) {
    if (type == name) return value;
    valid += (valid.empty() ? "" : ", ") + std::string(name);
  }
  fail(xml, element, "type '" + type + "' is unknown; valid: " + valid);
}

Vector3d read_axis(const Xml& xml, const pugi::xml_node& joint) {
  const pugi::xml_node axis = only_child(xml, joint, "axis");
  if (!axis) return Vector3d::UnitX();  // URDF's default
  name_in(xml, axis, "xyz");
  const Vector3d direction = vector3(xml, axis, "xyz", Vector3d::Zero());
  if (direction.isZero(0)) fail(xml, axis, "the axis of a moving joint must not be zero");
  return direction.stableNormalized();
}

/// URDF 1.1 may say a rotation by quat_xyzw, which programs that read URDF 1.0 take for none.
[[noreturn]] void refuse_quaternion(const Xml& xml, const pugi::xml_node& origin) {
  std::istringstream in(origin.attribute("quat_xyzw").as_string());
  in.imbue(std::locale::classic());
  Eigen::Vector4d q;
  const bool read = static_cast<bool>(in >> q(0) >> q(1) >> q(2) >> q(3)) && q.norm() > 0;
  fail(xml, origin,
       "quat_xyzw belongs to URDF 1.1; only URDF 1.0 is supported, which has rpy" +
           (read ? ": write rpy=\"" + shortest(rpy_from_rotation(rotation_from_quaternion(q))) +
                       "\" in its place"
                 : std::string()));
}

/// Everything of a joint but its links and its mimic, which need all names.
Joint read_joint(const Xml& xml, const pugi::xml_node& element,
                 std::vector<std::string>& warnings) {
  Joint joint;
  joint.name = name_in(xml, element, "name");
  joint.type = read_type(xml, element);
  const pugi::xml_node origin = only_child(xml, element, "origin");
  joint.parent_T_joint.translation = vector3(xml, origin, "xyz", Vector3d::Zero());
  if (origin.attribute("quat_xyzw")) refuse_quaternion(xml, origin);
  const Vector3d rpy = vector3(xml, origin, "rpy", Vector3d::Zero());
  if (const double most = rpy.cwiseAbs().maxCoeff(); most > kMostTurned)
    warnings.push_back(where(xml, origin) + "an angle of rpy is " + shortest(most) +
                       ", more than a turn: radians are expected; degrees have to be multiplied by "
                       "pi / 180");
  joint.parent_T_joint.rotation = rotation_from_rpy(rpy);
  if (!joint.moves()) return joint;  // its axis and limits mean nothing, whatever stands there
  joint.axis = read_axis(xml, element);
  const pugi::xml_node limit = only_child(xml, element, "limit");
  const double lower = number(xml, limit, "lower", 0), upper = number(xml, limit, "upper", 0);
  if (lower > upper)
    warnings.push_back(where(xml, limit) + "lower is above upper; read as no limits");
  else if (limit.attribute("lower") && limit.attribute("upper"))
    joint.lower = lower, joint.upper = upper;
  return joint;
}

/// A link's mass, none where the file has none that can be read: it is a start for loads only, and
/// no reason to refuse a robot.
LinkMass read_mass(const Xml& xml, const pugi::xml_node& link) try {
  const pugi::xml_node inertial = link.child("inertial");
  LinkMass out;
  out.mass = std::max(0.0, number(xml, inertial.child("mass"), "value", 0));
  out.centre = vector3(xml, inertial.child("origin"), "xyz", Vector3d::Zero());
  return out;
} catch (const InputError&) {
  return {};
}

using Indices = std::map<std::string, int>;

/// Index by name. @throws InputError if a name stands twice or is too long.
Indices index_names(const Xml& xml, const Elements& elements) {
  Indices indices;
  for (size_t i = 0; i < elements.size(); ++i) {
    const std::string name = name_in(xml, elements[i], "name");
    if (name.size() > kLongestName)
      throw InputError(at_offset(xml, elements[i].offset_debug()) + ": <" + elements[i].name() +
                       ">: " + long_name(name));
    const auto [it, is_new] = indices.emplace(name, static_cast<int>(i));
    if (!is_new)
      fail(xml, elements[i],
           "the name is taken already, by the one at " +
               at_offset(xml, elements[static_cast<size_t>(it->second)].offset_debug()));
  }
  return indices;
}

std::vector<std::string> keys(const Indices& indices) {
  std::vector<std::string> names;
  for (const auto& entry : indices) names.push_back(entry.first);
  return names;
}

/// The <parent> or <child> element of a joint.
pugi::xml_node end_of(const Xml& xml, const pugi::xml_node& joint, const char* end) {
  const pugi::xml_node element = only_child(xml, joint, end);
  if (!element) fail(xml, joint, std::string("<") + end + " link=\"...\"/> is missing");
  return element;
}

/// Some files attach the robot to a `world` that they do not define. That is accepted if it can
/// only be meant so: one name, used as a parent alone, and every defined link has a joint above it.
/// It becomes a link, with a warning.
void accept_root(const Xml& xml, const Elements& joints, Tree& tree, Indices& links,
                 std::vector<std::string>& warnings) {
  pugi::xml_node undefined;
  size_t children_defined = 0;
  for (const pugi::xml_node& joint : joints) {
    const pugi::xml_node parent = end_of(xml, joint, "parent");
    children_defined += links.count(name_in(xml, end_of(xml, joint, "child"), "link"));
    if (!undefined && !links.count(name_in(xml, parent, "link"))) undefined = parent;
  }
  if (!undefined || tree.links.empty() || children_defined != joints.size() ||
      joints.size() != tree.links.size())
    return;
  const std::string name = name_in(xml, undefined, "link");
  links.emplace(name, static_cast<int>(tree.links.size()));
  tree.links.push_back(name);
  warnings.push_back(where(xml, undefined) + "link '" + name +
                     "' is not defined; taken as the root of the robot");
}

int find_link(const Xml& xml, const pugi::xml_node& end, const Indices& links) {
  const std::string name = name_in(xml, end, "link");
  const auto it = links.find(name);
  if (it == links.end())
    fail(xml, end, "link '" + name + "' is not defined" + nearest_names(name, keys(links)));
  return it->second;
}

Mimic read_mimic(const Xml& xml, const pugi::xml_node& element, const Indices& joints) {
  const std::string master = name_in(xml, element, "joint");
  const auto it = joints.find(master);
  if (it == joints.end())
    fail(xml, element,
         "joint '" + master + "' is not defined" + nearest_names(master, keys(joints)));
  return {it->second, number(xml, element, "multiplier", 1), number(xml, element, "offset", 0)};
}

/// The first element that xacro would have expanded, wherever it stands; none: null.
pugi::xml_node find_xacro(const pugi::xml_node& robot) {
  return robot.find_node(
      [](const pugi::xml_node& node) { return std::strncmp(node.name(), "xacro:", 6) == 0; });
}

/// Everything of the robot's tree, and its transmissions.
void read_robot(const Xml& xml, const pugi::xml_node& robot, Urdf& urdf) {
  const Elements link_elements = children(robot, "link"), joint_elements = children(robot, "joint");
  Indices links = index_names(xml, link_elements);
  const Indices joints = index_names(xml, joint_elements);

  urdf.robot = robot.attribute("name").value();
  Tree& tree = urdf.tree;
  for (const pugi::xml_node& link : link_elements) {
    tree.links.push_back(link.attribute("name").value());
    urdf.masses.push_back(read_mass(xml, link));
  }
  if (tree.links.empty())
    throw InputError(at_offset(xml, robot.offset_debug()) + ": the robot has no links");
  accept_root(xml, joint_elements, tree, links, urdf.warnings);
  urdf.masses.resize(tree.links.size());
  for (const pugi::xml_node& element : joint_elements) {
    Joint joint = read_joint(xml, element, urdf.warnings);
    joint.parent = find_link(xml, end_of(xml, element, "parent"), links);
    joint.child = find_link(xml, end_of(xml, element, "child"), links);
    const pugi::xml_node mimic = only_child(xml, element, "mimic");
    if (mimic && joint.moves()) joint.mimic = read_mimic(xml, mimic, joints);
    tree.joints.push_back(std::move(joint));
    const pugi::xml_node origin = element.child("origin");
    urdf.origins.push_back(
        {origin.attribute("xyz").as_string("0 0 0"), origin.attribute("rpy").as_string("0 0 0")});
  }
  try {
    finish_tree(tree);
  } catch (const std::invalid_argument& e) {
    throw InputError(xml.path + ": " + e.what());
  }
  for (const WrittenTransmission& reduction : find_reductions(xml.text, robot))
    urdf.transmissions.push_back(reduction.transmission);
}

}  // namespace

Urdf parse_urdf(std::string text, const std::string& path) {
  Urdf urdf;
  urdf.path = path;
  urdf.text = std::move(text);
  refuse_other_kinds(urdf.text, path, Wanted::urdf);
  Xml xml{urdf.text, path};
  const pugi::xml_node robot = load(xml);
  const pugi::xml_node xacro = find_xacro(robot);
  const std::string not_expanded =
      xacro ? std::string("<") + xacro.name() + "> is not expanded: run xacro first" : "";
  try {
    read_robot(xml, robot, urdf);
  } catch (const InputError& error) {
    throw InputError(error.what() + (xacro ? "; " + not_expanded : ""));
  }
  if (xacro) throw InputError(at_offset(xml, xacro.offset_debug()) + ": " + not_expanded);
  urdf.document = std::move(xml.document);
  return urdf;
}

Urdf read_urdf(const std::string& path) { return parse_urdf(read_file(path), path); }

const char* type_name(JointType type) {
  for (const auto& [name, value] : kTypes)
    if (type == value) return name;
  return "";
}

}  // namespace kincal
