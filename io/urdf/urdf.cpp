#include "urdf.h"

#include <console_bridge/console.h>
#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <pugixml.hpp>
#include <random>
#include <stdexcept>
#include <utility>

#include "../document/document.h"

namespace kincal {
namespace {

constexpr double kPi = 3.14159265358979323846;

// ---------------------------------------------------------------- the XML and its places

/// The parsed XML with the bytes it came from. pugixml keeps the offset of every element's name in them.
struct Xml {
  const std::string& text;
  const std::string& path;
  pugi::xml_document document;
};

std::string at_offset(const Xml& xml, std::ptrdiff_t offset) {
  const auto end = xml.text.begin() + std::clamp<std::ptrdiff_t>(offset, 0, static_cast<std::ptrdiff_t>(xml.text.size()));
  return xml.path + ":" + std::to_string(1 + std::count(xml.text.begin(), end, '\n'));
}

std::string own_title(const pugi::xml_node& element) {
  const pugi::xml_attribute name = element.attribute("name");
  return name ? std::string(element.name()) + " '" + name.value() + "'" : std::string("<") + element.name() + ">";
}

/// "joint 'elbow': <origin>" for the origin of a joint: the child of <robot> that holds the element, and the element.
std::string title(const pugi::xml_node& element) {
  pugi::xml_node holder = element;
  while (holder.parent().parent().parent()) holder = holder.parent();  // below <robot>, that below the document
  return (holder == element ? "" : own_title(holder) + ": ") + own_title(element);
}

std::string where(const Xml& xml, const pugi::xml_node& element) {
  return at_offset(xml, element.offset_debug()) + ": " + title(element) + ": ";
}

[[noreturn]] void fail(const Xml& xml, const pugi::xml_node& element, const std::string& what) {
  throw InputError(where(xml, element) + what);
}

/// Whether a name has no prefix, a built-in one, or one declared (xmlns:prefix) on the element or above it.
bool is_bound(const pugi::xml_node& element, const std::string& name) {
  const size_t colon = name.find(':');
  if (colon == std::string::npos) return true;
  const std::string prefix = name.substr(0, colon);
  if (prefix == "xml" || prefix == "xmlns") return true;
  for (pugi::xml_node n = element; n; n = n.parent())
    if (n.attribute(("xmlns:" + prefix).c_str())) return true;
  return false;
}

/// What XML demands and pugixml does not look at: one top element, declared prefixes, no attribute twice.
void check_element(const Xml& xml, const pugi::xml_node& element) {
  const auto check_prefix = [&](const std::string& name) {
    if (!is_bound(element, name))
      throw InputError(at_offset(xml, element.offset_debug()) + ": not well-formed XML: unbound prefix in '" + name +
                       "'; declare xmlns:" + name.substr(0, name.find(':')) + " in <robot>");
  };
  check_prefix(element.name());
  for (const pugi::xml_attribute& attribute : element.attributes()) {
    check_prefix(attribute.name());
    for (pugi::xml_attribute other = attribute.next_attribute(); other; other = other.next_attribute())
      if (std::strcmp(attribute.name(), other.name()) == 0)
        throw InputError(where(xml, element) + "not well-formed XML: attribute '" + other.name() + "' stands twice");
  }
}

/// The node after this one in the order of the text; null at the end. Without recursion: depth is the file's choice.
pugi::xml_node next_node(pugi::xml_node node) {
  if (node.first_child()) return node.first_child();
  while (node && !node.next_sibling()) node = node.parent();
  return node.next_sibling();
}

/// Parses and returns <robot>. The bytes are taken as they are (UTF-8 or anything that contains ASCII): pugixml converts nothing.
pugi::xml_node load(Xml& xml) {
  if (xml.text.compare(0, 2, "\xFF\xFE") == 0 || xml.text.compare(0, 2, "\xFE\xFF") == 0)
    throw InputError(xml.path + ":1: the text is UTF-16; save it as UTF-8");
  const pugi::xml_parse_result result =
      xml.document.load_buffer(xml.text.data(), xml.text.size(), pugi::parse_default, pugi::encoding_utf8);
  if (!result) throw InputError(at_offset(xml, result.offset) + ": not well-formed XML: " + result.description());
  const pugi::xml_node robot = xml.document.document_element();
  for (pugi::xml_node n = xml.document.first_child(); n; n = next_node(n))
    if (n.type() == pugi::node_element) {
      if (n.parent() == xml.document && n != robot)
        throw InputError(at_offset(xml, n.offset_debug()) + ": not well-formed XML: <" + n.name() + "> after the end of <" + robot.name() +
                         ">; a file has one element at the top");
      check_element(xml, n);
    }
  if (std::strcmp(robot.name(), "robot") != 0)
    throw InputError(at_offset(xml, robot.offset_debug()) + ": <" + robot.name() + "> is no URDF; the top element must be <robot>");
  return robot;
}

// ---------------------------------------------------------------- attributes

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

/// Reads all of [begin, end) as one finite number.
bool to_number(const char* begin, const char* end, double& value) {
  if (end - begin > 1 && *begin == '+' && begin[1] != '-') ++begin;
  const auto result = std::from_chars(begin, end, value);
  return result.ec == std::errc() && result.ptr == end && std::isfinite(value);
}

std::vector<double> numbers(const Xml& xml, const pugi::xml_node& element, const char* attribute, size_t count) {
  const std::string text = element.attribute(attribute).value();
  std::vector<double> values;
  const char *at = text.data(), *const end = at + text.size();
  for (;;) {
    while (at != end && is_blank(*at)) ++at;
    if (at == end) break;
    const char* const begin = at;
    while (at != end && !is_blank(*at)) ++at;
    values.push_back(0);
    if (!to_number(begin, at, values.back()))
      fail(xml, element,
           std::string(attribute) + "=\"" + text + "\": '" + std::string(begin, at) + "' is not a finite number" +
               (text.find("${") != std::string::npos ? "; expand the xacro first" : ""));
  }
  if (values.size() != count)
    fail(xml, element,
         std::string(attribute) + "=\"" + text + "\" has " + std::to_string(values.size()) + " numbers, " + std::to_string(count) +
             (count == 1 ? " is" : " are") + " needed");
  return values;
}

Vector3d vector3(const Xml& xml, const pugi::xml_node& element, const char* attribute, const Vector3d& absent) {
  if (!element.attribute(attribute)) return absent;
  return Vector3d(numbers(xml, element, attribute, 3).data());
}

double number(const Xml& xml, const pugi::xml_node& element, const char* attribute, double absent) {
  return element.attribute(attribute) ? numbers(xml, element, attribute, 1)[0] : absent;
}

std::string name_in(const Xml& xml, const pugi::xml_node& element, const char* attribute) {
  const std::string name = element.attribute(attribute).value();
  if (name.empty()) fail(xml, element, std::string("the attribute '") + attribute + "' is missing or empty");
  return name;
}

/// The child of this name; null if there is none, an error if there are two.
pugi::xml_node only_child(const Xml& xml, const pugi::xml_node& element, const char* name) {
  const pugi::xml_node child = element.child(name), second = child.next_sibling(name);
  if (second) fail(xml, second, "stands twice; one is allowed");
  return child;
}

// ---------------------------------------------------------------- reading

constexpr std::pair<const char*, JointType> kTypes[] = {{"fixed", JointType::fixed},           {"revolute", JointType::revolute},
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

/// Everything of a joint but its links and its mimic, which need all names.
Joint read_joint(const Xml& xml, const pugi::xml_node& element, std::vector<std::string>& warnings) {
  Joint joint;
  joint.name = name_in(xml, element, "name");
  joint.type = read_type(xml, element);
  const pugi::xml_node origin = only_child(xml, element, "origin");
  joint.parent_T_joint.translation = vector3(xml, origin, "xyz", Vector3d::Zero());
  joint.parent_T_joint.rotation = rotation_from_rpy(vector3(xml, origin, "rpy", Vector3d::Zero()));
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

using Elements = std::vector<pugi::xml_node>;  // in the order of the tree's links or joints

Elements children(const pugi::xml_node& robot, const char* name) {
  Elements elements;
  for (const pugi::xml_node& child : robot.children(name)) elements.push_back(child);
  return elements;
}

using Indices = std::map<std::string, int>;

/// Index by name. @throws InputError if a name stands twice.
Indices index_names(const Xml& xml, const Elements& elements) {
  Indices indices;
  for (size_t i = 0; i < elements.size(); ++i) {
    const auto [it, is_new] = indices.emplace(name_in(xml, elements[i], "name"), static_cast<int>(i));
    if (!is_new)
      fail(xml, elements[i],
           "the name is taken already, by the one at " + at_offset(xml, elements[static_cast<size_t>(it->second)].offset_debug()));
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

/// Some files attach the robot to a `world` that they do not define. That is accepted if it can only be meant so: one name, used as
/// a parent alone, and every defined link has a joint above it. It becomes a link, with a warning.
void accept_root(const Xml& xml, const Elements& joints, Tree& tree, Indices& links, std::vector<std::string>& warnings) {
  pugi::xml_node undefined;
  size_t children_defined = 0;
  for (const pugi::xml_node& joint : joints) {
    const pugi::xml_node parent = end_of(xml, joint, "parent");
    children_defined += links.count(name_in(xml, end_of(xml, joint, "child"), "link"));
    if (!undefined && !links.count(name_in(xml, parent, "link"))) undefined = parent;
  }
  if (!undefined || tree.links.empty() || children_defined != joints.size() || joints.size() != tree.links.size()) return;
  const std::string name = name_in(xml, undefined, "link");
  links.emplace(name, static_cast<int>(tree.links.size()));
  tree.links.push_back(name);
  warnings.push_back(where(xml, undefined) + "link '" + name + "' is not defined; taken as the root of the robot");
}

int find_link(const Xml& xml, const pugi::xml_node& end, const Indices& links) {
  const std::string name = name_in(xml, end, "link");
  const auto it = links.find(name);
  if (it == links.end()) fail(xml, end, "link '" + name + "' is not defined" + nearest_names(name, keys(links)));
  return it->second;
}

Mimic read_mimic(const Xml& xml, const pugi::xml_node& element, const Indices& joints) {
  const std::string master = name_in(xml, element, "joint");
  const auto it = joints.find(master);
  if (it == joints.end()) fail(xml, element, "joint '" + master + "' is not defined" + nearest_names(master, keys(joints)));
  return {it->second, number(xml, element, "multiplier", 1), number(xml, element, "offset", 0)};
}

/// A number between tags, e.g. of <mechanicalReduction>, and its bytes.
struct NumberText {
  double value;
  size_t begin, end;
};

/// Adds the element's number, if its text is one, straight from the file's bytes.
void add_number(const std::string& text, const pugi::xml_node& element, std::vector<NumberText>& found) {
  const std::ptrdiff_t offset = element.first_child().offset_debug();
  if (offset < 0) return;
  size_t begin = static_cast<size_t>(offset), end = text.find('<', begin);
  if (end == std::string::npos) return;
  while (begin < end && is_blank(text[begin])) ++begin;
  while (begin < end && is_blank(text[end - 1])) --end;
  double value;
  if (to_number(text.data() + begin, text.data() + end, value)) found.push_back({value, begin, end});
}

struct Reduction {
  Transmission transmission;
  NumberText number;
};

/// The mechanical reductions that belong to one joint beyond doubt: a single number in the transmission that can mean it. A number
/// outside <joint> counts only if the transmission has no second joint.
std::vector<Reduction> find_reductions(const std::string& text, const pugi::xml_node& robot) {
  const char* const kName = "mechanicalReduction";
  std::vector<Reduction> reductions;
  for (const pugi::xml_node& transmission : robot.children("transmission")) {
    std::vector<NumberText> shared;
    for (const pugi::xml_node& e : transmission.children(kName)) add_number(text, e, shared);
    for (const pugi::xml_node& actuator : transmission.children("actuator"))
      for (const pugi::xml_node& e : actuator.children(kName)) add_number(text, e, shared);
    const bool single = !transmission.child("joint").next_sibling("joint");
    for (const pugi::xml_node& joint : transmission.children("joint")) {
      std::vector<NumberText> found;
      if (single) found = shared;
      for (const pugi::xml_node& e : joint.children(kName)) add_number(text, e, found);
      const std::string name = joint.attribute("name").value();
      if (found.size() == 1 && !name.empty())
        reductions.push_back({{transmission.attribute("name").value(), name, found[0].value}, found[0]});
    }
  }
  return reductions;
}

/// A hint for files that xacro has not expanded.
std::string xacro_hint(const pugi::xml_node& robot) {
  for (const pugi::xml_node& child : robot.children())
    if (std::strncmp(child.name(), "xacro:", 6) == 0) return std::string("; <") + child.name() + "> is not expanded: run xacro first";
  return "";
}

}  // namespace

Urdf parse_urdf(const std::string& text, const std::string& path) {
  Urdf urdf;
  urdf.path = path;
  urdf.text = text;
  Xml xml{text, path, {}};
  const pugi::xml_node robot = load(xml);
  const Elements link_elements = children(robot, "link"), joint_elements = children(robot, "joint");
  Indices links = index_names(xml, link_elements);
  const Indices joints = index_names(xml, joint_elements);

  Tree& tree = urdf.tree;
  for (const pugi::xml_node& link : link_elements) tree.links.push_back(link.attribute("name").value());
  if (tree.links.empty()) throw InputError(at_offset(xml, robot.offset_debug()) + ": the robot has no links" + xacro_hint(robot));
  accept_root(xml, joint_elements, tree, links, urdf.warnings);
  for (const pugi::xml_node& element : joint_elements) {
    Joint joint = read_joint(xml, element, urdf.warnings);
    joint.parent = find_link(xml, end_of(xml, element, "parent"), links);
    joint.child = find_link(xml, end_of(xml, element, "child"), links);
    const pugi::xml_node mimic = only_child(xml, element, "mimic");
    if (mimic && joint.moves()) joint.mimic = read_mimic(xml, mimic, joints);
    tree.joints.push_back(std::move(joint));
    const pugi::xml_node origin = element.child("origin");
    urdf.origins.push_back({origin.attribute("xyz").as_string("0 0 0"), origin.attribute("rpy").as_string("0 0 0")});
  }
  try {
    finish_tree(tree);
  } catch (const std::invalid_argument& e) {
    throw InputError(path + ": " + e.what() + xacro_hint(robot));
  }
  for (const Reduction& reduction : find_reductions(text, robot)) urdf.transmissions.push_back(reduction.transmission);
  return urdf;
}

Urdf read_urdf(const std::string& path) { return parse_urdf(read_file(path), path); }

// ---------------------------------------------------------------- writing

namespace {

/// Bytes [begin, end) of the input to be replaced.
struct Splice {
  size_t begin, end;
  std::string text;
};

std::string apply(const std::string& text, std::vector<Splice> splices) {
  std::sort(splices.begin(), splices.end(), [](const Splice& a, const Splice& b) { return a.begin < b.begin; });
  std::string result;
  size_t at = 0;
  for (const Splice& splice : splices) {
    result.append(text, at, splice.begin - at).append(splice.text);
    at = splice.end;
  }
  return result.append(text, at, std::string::npos);
}

/// Byte places in a start tag.
struct Tag {
  size_t name_end;                                          // just behind the element's name
  size_t end;                                               // just behind '>'
  std::map<std::string, std::pair<size_t, size_t>> values;  // by attribute, without the quotes
};

/// Scans an element's start tag, which pugixml has found well-formed; pugixml does not tell the places of attributes.
Tag scan_tag(const std::string& text, const pugi::xml_node& element) {
  const auto broken = [&]() -> Tag { throw std::logic_error(title(element) + ": start tag not found again"); };
  const auto skip_blanks = [&](size_t& i) {
    while (i < text.size() && is_blank(text[i])) ++i;
  };
  Tag tag;
  size_t i = tag.name_end = static_cast<size_t>(element.offset_debug()) + std::strlen(element.name());
  for (;;) {
    skip_blanks(i);
    if (i < text.size() && text[i] == '/') ++i;
    if (i >= text.size()) return broken();
    if (text[i] == '>') break;
    const size_t name = i;
    while (i < text.size() && text[i] != '=' && !is_blank(text[i])) ++i;
    const std::string attribute = text.substr(name, i - name);
    skip_blanks(i);
    if (i >= text.size() || text[i] != '=') return broken();
    skip_blanks(++i);
    if (i >= text.size() || (text[i] != '"' && text[i] != '\'')) return broken();
    const size_t close = text.find(text[i], i + 1);
    if (close == std::string::npos) return broken();
    tag.values[attribute] = {i + 1, close};
    i = close + 1;
  }
  tag.end = i + 1;
  return tag;
}

std::string to_text(double value) { return value == 0 ? "0" : shortest(value); }  // never "-0"

std::string to_text(const Vector3d& v) { return to_text(v.x()) + " " + to_text(v.y()) + " " + to_text(v.z()); }

void edit_origin(const std::string& text, const pugi::xml_node& joint, const Pose& from, const Pose& to, std::vector<Splice>& splices) {
  const bool moved = to.translation != from.translation, turned = to.rotation != from.rotation;
  if (!moved && !turned) return;
  if (!to.translation.allFinite() || !to.rotation.allFinite()) throw std::invalid_argument(title(joint) + ": the new origin is not finite");
  const std::string xyz = to_text(to.translation), rpy = to_text(rpy_from_rotation(to.rotation));
  const pugi::xml_node origin = joint.child("origin");
  if (!origin) {
    const size_t place = scan_tag(text, joint).end;
    splices.push_back({place, place, "<origin xyz=\"" + xyz + "\" rpy=\"" + rpy + "\"/>"});
    return;
  }
  const Tag tag = scan_tag(text, origin);
  std::string added;
  const auto set = [&](const char* attribute, const std::string& value) {
    const auto it = tag.values.find(attribute);
    if (it != tag.values.end())
      splices.push_back({it->second.first, it->second.second, value});
    else
      added += std::string(" ") + attribute + "=\"" + value + "\"";
  };
  if (moved) set("xyz", xyz);
  if (turned) set("rpy", rpy);
  if (!added.empty()) splices.push_back({tag.name_end, tag.name_end, added});
}

}  // namespace

std::string edit_urdf(const Urdf& urdf, const UrdfChanges& changes) {
  Xml xml{urdf.text, urdf.path, {}};
  const pugi::xml_node robot = load(xml);
  const Elements joints = children(robot, "joint");
  std::vector<Splice> splices;
  for (const auto& [joint, origin] : changes.origins)
    edit_origin(urdf.text, joints.at(joint), urdf.tree.joints.at(joint).parent_T_joint, origin, splices);
  const std::vector<Reduction> reductions = find_reductions(urdf.text, robot);
  for (const auto& [joint, value] : changes.reductions) {
    if (!std::isfinite(value)) throw std::invalid_argument("joint '" + joint + "': the new mechanicalReduction is not finite");
    bool found = false;
    for (const Reduction& r : reductions)
      if (r.transmission.joint == joint) {
        found = true;
        if (r.number.value != value) splices.push_back({r.number.begin, r.number.end, to_text(value)});
      }
    if (!found) throw std::invalid_argument(urdf.path + ": joint '" + joint + "' has no <transmission> with one mechanicalReduction");
  }
  return apply(urdf.text, std::move(splices));
}

std::vector<Pose> fold_offsets(const Tree& tree, const std::vector<Pose>& origins, const std::vector<double>& offsets) {
  std::vector<Pose> folded = origins;
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    const Driver d = driver(tree, static_cast<int>(j));
    const double offset = tree.joints[d.joint].moves() ? d.factor * offsets[d.joint] : 0;
    if (offset != 0) folded[j] = origins[j] * joint_motion(tree.joints[j], offset);
  }
  return folded;
}

// ---------------------------------------------------------------- proof

namespace {

/// Keeps urdfdom's messages instead of printing them, as long as it lives.
class Messages : public console_bridge::OutputHandler {
 public:
  Messages() { console_bridge::useOutputHandler(this); }
  ~Messages() override { console_bridge::restorePreviousOutputHandler(); }
  void log(const std::string& message, console_bridge::LogLevel level, const char*, int) override {
    if (level >= console_bridge::CONSOLE_BRIDGE_LOG_ERROR) text += (text.empty() ? "" : "; ") + message;
  }
  std::string text;
};

/// A joint as another reader sees it; nothing here comes from kinematics/tree.cpp.
struct WrittenJoint {
  std::string name, parent, master;  // master: empty if it mimics nothing
  JointType type = JointType::fixed;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Vector3d translation = Vector3d::Zero(), axis = Vector3d::UnitX();
  double multiplier = 1, offset = 0;
};
using Written = std::map<std::string, WrittenJoint>;  // by child link

JointType type_of(const urdf::Joint& joint) {
  switch (joint.type) {
    case urdf::Joint::REVOLUTE:
      return JointType::revolute;
    case urdf::Joint::CONTINUOUS:
      return JointType::continuous;
    case urdf::Joint::PRISMATIC:
      return JointType::prismatic;
    case urdf::Joint::FLOATING:
      return JointType::floating;
    case urdf::Joint::PLANAR:
      return JointType::planar;
    default:
      return JointType::fixed;
  }
}

Written joints_of(const urdf::ModelInterface& model) {
  Written written;
  for (const auto& entry : model.joints_) {
    const urdf::Joint& from = *entry.second;
    WrittenJoint joint;
    joint.name = from.name;
    joint.parent = from.parent_link_name;
    joint.type = type_of(from);
    const urdf::Pose& pose = from.parent_to_joint_origin_transform;
    joint.rotation = Eigen::Quaterniond(pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z);
    joint.translation = {pose.position.x, pose.position.y, pose.position.z};
    joint.axis = Vector3d(from.axis.x, from.axis.y, from.axis.z).stableNormalized();
    if (from.mimic) {
      joint.master = from.mimic->joint_name;
      joint.multiplier = from.mimic->multiplier;
      joint.offset = from.mimic->offset;
    }
    written[from.child_link_name] = joint;
  }
  return written;
}

Written joints_of(const Tree& tree) {
  Written written;
  for (const Joint& from : tree.joints) {
    WrittenJoint joint;
    joint.name = from.name;
    joint.parent = tree.links[from.parent];
    joint.type = from.type;
    joint.rotation = Eigen::Quaterniond(from.parent_T_joint.rotation);
    joint.translation = from.parent_T_joint.translation;
    joint.axis = from.axis;
    if (from.mimic) {
      joint.master = tree.joints[from.mimic->master].name;
      joint.multiplier = from.mimic->multiplier;
      joint.offset = from.mimic->offset;
    }
    written[tree.links[from.child]] = joint;
  }
  return written;
}

/// The written text as urdfdom reads it, or as we do where urdfdom takes exception to what stood in the input already.
Written read_written(const std::string& text, const Urdf& input) {
  Messages messages;
  if (const auto model = urdf::parseURDF(text)) return joints_of(*model);
  const std::string why = messages.text;
  if (urdf::parseURDF(input.text)) throw std::runtime_error(input.path + ": the written URDF is refused by urdfdom: " + why);
  return joints_of(parse_urdf(text, input.path + " (written)").tree);
}

/// The written robot, each joint beside the same joint of the input. Parents and masters are checked, so walking up ends.
class WrittenRobot {
 public:
  WrittenRobot(const Written& written, const Tree& tree) : tree_(tree), joints_(tree.joints.size()) {
    if (written.size() != tree.joints.size()) fail("another number of joints");
    for (size_t j = 0; j < joints_.size(); ++j) {
      const Joint& joint = tree.joints[j];
      const auto it = written.find(tree.links[joint.child]);
      if (it == written.end() || it->second.name != joint.name || it->second.parent != tree.links[joint.parent] ||
          it->second.type != joint.type)
        fail("another joint in place of '" + joint.name + "'");
      joints_[j] = it->second;
      if (joint.moves() && joints_[j].master != (joint.mimic ? tree.joints[joint.mimic->master].name : ""))
        fail("another mimic in joint '" + joint.name + "'");
    }
  }

  /// root_T_link for readings of all joints; followers and joints that do not move have none.
  Eigen::Isometry3d pose(int link, const std::vector<double>& readings) const {
    Eigen::Isometry3d root_T_link = Eigen::Isometry3d::Identity();
    for (int j = tree_.joint_above[link]; j >= 0; j = tree_.joint_above[tree_.joints[j].parent])
      root_T_link = parent_T_child(j, readings) * root_T_link;
    return root_T_link;
  }

 private:
  double position(int j, const std::vector<double>& readings) const {
    if (!tree_.joints[j].moves()) return 0;
    if (!tree_.joints[j].mimic) return readings[j];
    return joints_[j].multiplier * position(tree_.joints[j].mimic->master, readings) + joints_[j].offset;
  }

  Eigen::Isometry3d parent_T_child(int j, const std::vector<double>& readings) const {
    const WrittenJoint& joint = joints_[j];
    Eigen::Isometry3d pose = Eigen::Translation3d(joint.translation) * joint.rotation;
    if (joint.type == JointType::prismatic)
      pose = pose * Eigen::Translation3d(position(j, readings) * joint.axis);
    else if (joint.type == JointType::revolute || joint.type == JointType::continuous)
      pose = pose * Eigen::AngleAxisd(position(j, readings), joint.axis);
    return pose;
  }

  [[noreturn]] static void fail(const std::string& what) { throw std::runtime_error("the written URDF has " + what); }

  const Tree& tree_;
  std::vector<WrittenJoint> joints_;  // as in the tree
};

/// Uniform in the joint's limits; +-pi without limits, or where they span turns upon turns (1e16 occurs: all digits would be lost).
/// Not std::uniform_real_distribution, whose numbers differ between standard libraries.
double random_reading(const Joint& joint, std::mt19937_64& random) {
  const bool usable = joint.lower < joint.upper && joint.lower > -4 * kPi && joint.upper < 4 * kPi;
  const double low = usable ? joint.lower : -kPi, high = usable ? joint.upper : kPi;
  return low + (high - low) * (static_cast<double>(random() >> 11) * 0x1p-53);
}

/// How far two poses are apart.
struct Difference {
  double metres, radians;
  bool matters() const { return !(metres <= 1e-9 && radians <= 1e-9); }  // NaN matters
};

Difference difference(const Pose& a, const Eigen::Isometry3d& b) {
  const Matrix3d r = a.rotation.transpose() * b.linear();
  const Vector3d twice_sine(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1));
  return {(a.translation - b.translation()).norm(), std::atan2(twice_sine.norm(), r.trace() - 1)};
}

}  // namespace

void prove_urdf(const std::string& text, const Urdf& input, const std::vector<Pose>& origins, const std::vector<double>& offsets,
                int postures) {
  const Tree& tree = input.tree;
  const WrittenRobot written(read_written(text, input), tree);
  std::mt19937_64 random(20240229);
  std::vector<double> readings(tree.joints.size(), 0), positions(tree.joints.size(), 0);
  for (int posture = 0; posture < postures; ++posture) {
    for (size_t j = 0; j < tree.joints.size(); ++j) {
      const bool reads = tree.joints[j].has_reading();
      readings[j] = reads ? random_reading(tree.joints[j], random) : 0;
      positions[j] = reads ? readings[j] + offsets[j] : 0;
    }
    follow_mimics(tree, positions);
    const std::vector<Pose> poses = link_poses(tree, origins, positions);
    const auto compare = [&](int link) { return difference(poses[link], written.pose(link, readings)); };
    for (size_t l = 0; l < tree.links.size(); ++l) {
      int link = static_cast<int>(l);
      if (!compare(link).matters()) continue;
      for (int j; (j = tree.joint_above[link]) >= 0 && compare(tree.joints[j].parent).matters();) link = tree.joints[j].parent;
      const Difference d = compare(link);
      char numbers_text[80];
      std::snprintf(numbers_text, sizeof numbers_text, "%.3g m and %.3g rad", d.metres, d.radians);
      throw std::runtime_error("the written URDF does not mean the calibrated robot: link '" + tree.links[link] + "' is off by " +
                               numbers_text);
    }
  }
}

}  // namespace kincal
