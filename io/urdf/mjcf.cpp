#include "mjcf.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <utility>

#include "../document/error.h"

namespace kincal {

const std::vector<std::string> kMjcfRotations = {"quat", "axisangle", "xyaxes", "zaxis", "euler"};

namespace {

/// What <compiler> says of the numbers.
struct Compiler {
  double angle = kPi / 180;  // one unit, rad
  std::string eulerseq = "xyz";
};

/// The model while it is read.
struct Reader {
  const Xml& xml;
  Compiler compiler;
  std::map<std::string, pugi::xml_node> classes;  // <default> elements by class
  std::vector<pugi::xml_node> main;               // those at the top
  Mjcf model;

  void read_compiler(const pugi::xml_node& root);
  void read_defaults(const pugi::xml_node& above);
  /// The element that has an attribute: this one, or the <default> that stands for it; none: null.
  pugi::xml_node holder(const pugi::xml_node& element, const char* attribute) const;
  pugi::xml_node inherited(const pugi::xml_node& element, const char* attribute) const;
  Matrix3d rotation(const pugi::xml_node& element) const;
  Pose pose(const pugi::xml_node& element) const;
  MjcfJoint joint(const pugi::xml_node& element) const;
  MjcfMark mark(const pugi::xml_node& element, int body, const Pose& body_T_here) const;
  /// Reads what stands in a body, frame or world.
  void read_children(const pugi::xml_node& element, int body, const Pose& body_T_here);
};

void Reader::read_compiler(const pugi::xml_node& root) {
  for (const pugi::xml_node& element : root.children("compiler")) {
    const std::string angle = element.attribute("angle").as_string();
    if (angle == "radian")
      compiler.angle = 1;
    else if (angle == "degree")
      compiler.angle = kPi / 180;
    else if (!angle.empty())
      fail(xml, element, "angle=\"" + angle + "\": degree or radian is expected");
    if (std::strcmp(element.attribute("coordinate").as_string("local"), "local") != 0)
      fail(xml, element,
           "coordinate=\"global\": poses in the world frame are not supported; let an older MuJoCo "
           "save the model with local ones");
    if (!element.attribute("eulerseq")) continue;
    compiler.eulerseq = element.attribute("eulerseq").value();
    if (compiler.eulerseq.size() != 3 ||
        compiler.eulerseq.find_first_not_of("xyzXYZ") != std::string::npos)
      fail(xml, element, "eulerseq=\"" + compiler.eulerseq + "\": three of xyzXYZ are expected");
  }
}

void Reader::read_defaults(const pugi::xml_node& above) {
  for (const pugi::xml_node& element : above.children("default")) {
    if (std::strcmp(above.name(), "default") != 0) main.push_back(element);
    const std::string name = element.attribute("class").value();
    if (!name.empty()) classes[name] = element;
    read_defaults(element);
  }
}

pugi::xml_node Reader::inherited(const pugi::xml_node& element, const char* attribute) const {
  std::string name = element.attribute("class").value();
  for (pugi::xml_node n = element.parent(); n && name.empty(); n = n.parent())
    name = n.attribute("childclass").value();
  if (!name.empty()) {
    const auto it = classes.find(name);
    if (it == classes.end() && name != "main")
      fail(xml, element, "class '" + name + "' is not defined");
    if (it != classes.end())
      for (pugi::xml_node n = it->second; std::strcmp(n.name(), "default") == 0; n = n.parent())
        if (const pugi::xml_node found = n.child(element.name()); found.attribute(attribute))
          return found;
  }
  for (const pugi::xml_node& n : main)
    if (const pugi::xml_node found = n.child(element.name()); found.attribute(attribute))
      return found;
  return {};
}

pugi::xml_node Reader::holder(const pugi::xml_node& element, const char* attribute) const {
  return element.attribute(attribute) ? element : inherited(element, attribute);
}

Matrix3d Reader::rotation(const pugi::xml_node& element) const {
  std::string kind;
  for (const std::string& name : kMjcfRotations) {
    if (!element.attribute(name.c_str())) continue;
    if (!kind.empty()) fail(xml, element, kind + " and " + name + ": one of them is expected");
    kind = name;
  }
  if (kind.empty()) return Matrix3d::Identity();
  const size_t count = kind == "xyaxes" ? 6 : kind == "quat" || kind == "axisangle" ? 4 : 3;
  const std::vector<double> n = numbers_of(xml, element, kind.c_str(), count);
  if (kind == "euler") {
    Matrix3d r = Matrix3d::Identity();
    for (int i = 0; i < 3; ++i) {
      const char axis = compiler.eulerseq[i];  // small: about the axes that turned along
      const Matrix3d turn =
          rotation_about(Vector3d::Unit((axis | 0x20) - 'x'), n[i] * compiler.angle);
      r = axis >= 'x' ? Matrix3d(r * turn) : Matrix3d(turn * r);
    }
    return r;
  }
  const auto unit = [&](const Vector3d& v) {
    if (!(v.norm() > 1e-10)) fail(xml, element, kind + ": an axis is zero");
    return Vector3d(v.normalized());
  };
  if (kind == "quat") {
    const Eigen::Vector4d q(n[1], n[2], n[3], n[0]);
    if (!(q.norm() > 1e-10)) fail(xml, element, "quat is zero");
    return rotation_from_quaternion(q);
  }
  if (kind == "axisangle") return rotation_about(unit({n[0], n[1], n[2]}), n[3] * compiler.angle);
  if (kind == "zaxis") return rotation_between(Vector3d::UnitZ(), unit({n[0], n[1], n[2]}));
  Matrix3d r;
  r.col(0) = unit({n[0], n[1], n[2]});
  const Vector3d y(n[3], n[4], n[5]);
  r.col(1) = unit(y - r.col(0).dot(y) * r.col(0));
  r.col(2) = r.col(0).cross(r.col(1));
  return r;
}

Pose Reader::pose(const pugi::xml_node& element) const {
  return {rotation(element), vector3(xml, element, "pos", Vector3d::Zero())};
}

MjcfJoint Reader::joint(const pugi::xml_node& element) const {
  MjcfJoint out;
  out.element = element;
  out.name = element.attribute("name").value();
  if (std::strcmp(element.name(), "freejoint") == 0) {
    out.type = "free";
    return out;
  }
  out.type = holder(element, "type").attribute("type").as_string("hinge");
  if (out.type != "hinge" && out.type != "slide") return out;
  out.axis = vector3(xml, holder(element, "axis"), "axis", Vector3d::UnitZ());
  if (!(out.axis.norm() > 1e-10)) fail(xml, element, "its axis is zero");
  out.axis.normalize();
  out.pos = vector3(xml, holder(element, "pos"), "pos", Vector3d::Zero());
  out.ref = number(xml, holder(element, "ref"), "ref", 0);
  if (out.type == "hinge") out.ref *= compiler.angle;
  return out;
}

MjcfMark Reader::mark(const pugi::xml_node& element, int body, const Pose& body_T_here) const {
  for (const std::string& name : kMjcfRotations)
    if (const pugi::xml_node by = inherited(element, name.c_str()))
      fail(xml, by,
           name +
               " of a class: the orientation of a camera or site must be given in its own element");
  const pugi::xml_node at = holder(element, "pos");
  return {element,
          element.attribute("name").value(),
          body,
          body_T_here,
          {rotation(element), vector3(xml, at, "pos", Vector3d::Zero())},
          std::strcmp(holder(element, "mode").attribute("mode").as_string("fixed"), "fixed") == 0};
}

void Reader::read_children(const pugi::xml_node& element, int body, const Pose& body_T_here) {
  for (const pugi::xml_node& child : element.children()) {
    const std::string kind = child.name();
    if (kind == "frame") {
      read_children(child, body, body_T_here * pose(child));
    } else if (kind == "body") {
      model.bodies.push_back(
          {child, child.attribute("name").value(), body, body_T_here, pose(child), {}});
      read_children(child, static_cast<int>(model.bodies.size()) - 1, Pose());
    } else if (kind == "joint" || kind == "freejoint") {
      if (std::strcmp(element.name(), "body") != 0)
        fail(xml, child,
             "a joint in a <" + std::string(element.name()) + ">: a <body> is expected");
      model.bodies[body].joints.push_back(joint(child));
    } else if (kind == "camera") {
      model.cameras.push_back(mark(child, body, body_T_here));
    } else if (kind == "site") {
      model.sites.push_back(mark(child, body, body_T_here));
    } else if (kind == "replicate") {
      fail(xml, child, "replicated bodies are not supported: let MuJoCo save the model");
    }
  }
}

}  // namespace

Pose MjcfJoint::motion(double reading) const {
  const double by = reading - ref;
  if (type == "slide") return {Matrix3d::Identity(), by * axis};
  const Matrix3d r = rotation_about(axis, by);
  return {r, pos - r * pos};
}

Mjcf read_mjcf(Xml& xml) {
  const pugi::xml_node root = load_document(xml);
  if (std::strcmp(root.name(), "mujoco") != 0)
    throw InputError(at_offset(xml, root.offset_debug()) + ": <" + root.name() +
                     "> is not a MuJoCo model; the top element must be <mujoco>");
  for (pugi::xml_node n = root; n; n = next_node(n))
    if (std::strcmp(n.name(), "include") == 0)
      fail(xml, n,
           "included files are not read: use the file that has the bodies, or let MuJoCo save the "
           "whole model");
  Reader reader{xml, {}, {}, {}, {}};
  reader.read_compiler(root);
  reader.read_defaults(root);
  for (const pugi::xml_node& world : root.children("worldbody"))
    reader.read_children(world, -1, Pose());
  return std::move(reader.model);
}

}  // namespace kincal
