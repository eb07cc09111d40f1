#include "edit_mjcf.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>
#include <stdexcept>
#include <utility>

#include "../../models/rig/random_stream.h"
#include "../document/error.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "mjcf.h"
#include "splices.h"
#include "urdf.h"

namespace kincal {
namespace {

constexpr double kRoundedModel = 2e-3;  // m and rad: how far a model's rounded numbers are off
constexpr double kToldRounding = 1e-5;  // m and rad: farther off is told
constexpr double kProvedModel = 1e-9;   // m and rad
constexpr double kSameNumber = 1e-12;   // m and rad: not written again

double angle_of(const Matrix3d& r) { return log_so3(r).norm(); }
double difference_of(const Pose& a, const Pose& b) {
  return std::max((a.translation - b.translation).norm(),
                  angle_of(a.rotation.transpose() * b.rotation));
}

/// A line in a body's frame about which a joint turns, or along which it slides.
struct JointLine {
  Vector3d axis, point;
};

/// The robot from one link to another, all joints at the model's `ref`.
struct Section {
  Pose from_T_to;
  std::vector<JointLine> lines;  // of the moving joints, in the frame of `to`
};

/// What turns and moves a body's frame so that the line of its joint is the one that it has in the
/// model.
Pose onto(const MjcfJoint& joint, const JointLine& line) {
  const Matrix3d turn = rotation_between(joint.axis, line.axis);
  Vector3d off = Vector3d::Zero();
  if (joint.type == "hinge") off = turn.transpose() * line.point - joint.pos;
  return {turn, turn * (off - joint.axis.dot(off) * joint.axis)};
}

/// How a body goes with the robot.
struct BodyPlace {
  int link = -1;            // of its name; -1: none
  bool placed = false;      // it stands where the robot has it by `joints`, on what is above
  int above = -1;           // the next body above that has a link; -1: the world
  Pose above_T_here;        // the fixed path between
  Path joints;              // of the robot, from the link above; those that lead up are rigid
  std::vector<int> moving;  // those of them that move: the body's, in their order
  Pose link_T_body;         // mostly the identity
};

class ModelEditor {
 public:
  ModelEditor(const Xml& xml, const Mjcf& model, const CalibratedTree& robot)
      : xml_(xml),
        model_(model),
        robot_(robot),
        tree_(robot.tree),
        changed_(tree_.joints.size()),
        covered_(tree_.joints.size()) {
    for (size_t j = 0; j < changed_.size(); ++j)
      changed_[j] = difference_of(robot.before[j], robot.after[j]) > 0;
  }

  EditedMjcf edit();
  /// Compares a model with the same elements with the robot. @throws InputError
  void prove(const Mjcf& written) const;

 private:
  Section section(const Path& joints, const std::vector<Pose>& origins,
                  const std::vector<double>& refs, const Pose& link_T_body) const;
  std::string missing_prefix() const;
  int link_of(const std::string& name) const {
    return name.empty() ? -1 : tree_.find_link(prefix_ + name);
  }
  bool find_above(size_t b);
  std::string mismatch(const MjcfBody& body, const BodyPlace& place) const;
  void place(size_t b);
  void check_line(const MjcfJoint& joint, const JointLine& line, int tree_joint) const;
  void write_pose(const pugi::xml_node& element, const Pose& is, const Pose& shall);
  void write_joint(const MjcfJoint& joint, const JointLine& line);
  void write_marks();
  /// link_T_frame, by the origins given, of a frame that is fixed on another link; none: it moves.
  std::optional<Pose> between(int link, int other, const std::vector<Pose>& origins) const;
  void note_what_is_missing();
  /// The body above, or the world, in the frame of its link.
  Pose start_of(const BodyPlace& p) const {
    return p.above >= 0 ? places_[p.above].link_T_body : root_T_world_.value_or(Pose());
  }

  const Xml& xml_;
  const Mjcf& model_;
  const CalibratedTree& robot_;
  const Tree& tree_;
  std::vector<bool> changed_, covered_;  // by joint of the robot
  std::vector<BodyPlace> places_;
  std::optional<Pose> root_T_world_;  // where the model's world stands in the robot's root
  std::vector<Splice> splices_;
  EditedMjcf out_;
  std::vector<std::string> turned_, kept_;  // names, for notes
  std::string prefix_;                      // of the robot's names, which the model's lack
  double rounded_ = 0;                      // how far the model was off at most, m or rad
};

Section ModelEditor::section(const Path& joints, const std::vector<Pose>& origins,
                             const std::vector<double>& refs, const Pose& link_T_body) const {
  Section out;
  Pose tail = link_T_body;  // from behind the joint to the body
  size_t moving = refs.size();
  for (size_t i = joints.size(); i-- > 0;) {
    const Joint& joint = tree_.joints[joints[i].joint];
    if (joint.moves())
      out.lines.insert(out.lines.begin(),
                       {tail.rotation.transpose() * joint.axis, inverse(tail).translation});
    const Pose pose =
        origins[joints[i].joint] * joint_motion(joint, joint.moves() ? refs[--moving] : 0);
    tail = (joints[i].direction > 0 ? pose : inverse(pose)) * tail;
  }
  out.from_T_to = tail;
  return out;
}

/// Finds what the body hangs on; false if a joint that is none of the robot's lies between.
bool ModelEditor::find_above(size_t b) {
  BodyPlace& p = places_[b];
  bool still = true;
  p.above_T_here = model_.bodies[b].above_T_here;
  for (p.above = model_.bodies[b].above; p.above >= 0 && places_[p.above].link < 0;) {
    const MjcfBody& between = model_.bodies[p.above];
    still = still && between.joints.empty();
    p.above_T_here = between.above_T_here * between.pose * p.above_T_here;
    p.above = between.above;
  }
  return still;
}

/// Says why the body's joints are not those of the robot; "": they are.
std::string ModelEditor::mismatch(const MjcfBody& body, const BodyPlace& p) const {
  std::vector<std::string> names;
  for (const int j : p.moving) names.push_back(tree_.joints[j].name);
  const std::string has = names.empty() ? "no joint" : "joint " + comma_separated(names);
  const std::string wants = "; the robot has " + has + " there";
  for (size_t i = 0; i < std::max(body.joints.size(), p.moving.size()); ++i) {
    if (i >= body.joints.size()) return "has no joint '" + names[i] + "'" + wants;
    const MjcfJoint& joint = body.joints[i];
    if (i >= p.moving.size() ||
        (!joint.name.empty() && joint.name != names[i] && prefix_ + joint.name != names[i]))
      return "joint '" + joint.name + "' is not a joint of the robot" + wants;
    const bool slides = tree_.joints[p.moving[i]].type == JointType::prismatic;
    if (joint.type != (slides ? "slide" : "hinge"))
      return "joint '" + names[i] + "' is a " + joint.type + wants;
  }
  return "";
}

void ModelEditor::check_line(const MjcfJoint& joint, const JointLine& line, int tree_joint) const {
  const std::string name = "joint '" + tree_.joints[tree_joint].name + "' of the robot";
  if ((joint.axis + line.axis).norm() < kRoundedModel)
    fail(xml_, joint.element,
         "turns the other way than " + name +
             "; or does its body have the name of another link, which is turned?");
  if (!((joint.axis - line.axis).norm() < kRoundedModel))
    fail(xml_, joint.element,
         "its axis is " + rounded((joint.axis - line.axis).norm(), 3) + " rad from that of " +
             name + ": the model is of another robot");
  const Vector3d off = joint.pos - line.point;
  const double metres = (off - line.axis.dot(off) * line.axis).norm();
  if (joint.type == "hinge" && !(metres < kRoundedModel))
    fail(xml_, joint.element,
         "its axis is " + rounded(metres, 3) + " m from that of " + name +
             ": the model is of another robot");
}

void ModelEditor::write_pose(const pugi::xml_node& element, const Pose& is, const Pose& shall) {
  std::vector<std::pair<std::string, std::string>> attributes;
  if ((is.translation - shall.translation).norm() > kSameNumber)
    attributes.emplace_back("pos", shortest(shall.translation));
  if (angle_of(is.rotation.transpose() * shall.rotation) > kSameNumber) {
    const Eigen::Vector4d q = quaternion_from_rotation(shall.rotation);
    const std::string quat =
        shortest(q[3]) + " " + shortest(q[0]) + " " + shortest(q[1]) + " " + shortest(q[2]);
    const Tag tag = scan_tag(xml_.text, element);
    std::string other;
    for (const std::string& name : kMjcfRotations)
      if (name != "quat" && tag.attributes.count(name)) other = name;
    if (other.empty()) {
      attributes.emplace_back("quat", quat);
    } else {
      const AttributePlace& at = tag.attributes.at(other);
      splices_.push_back({at.name, at.name + other.size(), "quat"});
      splices_.push_back({at.begin, at.end, quat});
      turned_.push_back(element.attribute("name").value());
    }
  }
  if (!attributes.empty()) set_attributes(xml_.text, element, attributes, splices_);
}

void ModelEditor::write_joint(const MjcfJoint& joint, const JointLine& line) {
  std::vector<std::pair<std::string, std::string>> attributes;
  const Vector3d off = joint.pos - line.point;
  const Vector3d near = line.point + line.axis.dot(off) * line.axis;  // the old point's foot
  if (joint.type == "hinge" && (near - joint.pos).norm() > kSameNumber)
    attributes.emplace_back("pos", shortest(near));
  if ((joint.axis - line.axis).norm() > kSameNumber)
    attributes.emplace_back("axis", shortest(line.axis));
  if (!attributes.empty()) set_attributes(xml_.text, joint.element, attributes, splices_);
}

void ModelEditor::place(size_t b) {
  const MjcfBody& body = model_.bodies[b];
  BodyPlace& p = places_[b];
  const bool still = find_above(b);
  const int from = p.above >= 0 ? places_[p.above].link : tree_.root;
  std::string why = still ? "" : "hangs on a joint that the robot does not have";
  try {
    p.joints = find_path(tree_, from, p.link);
  } catch (const std::invalid_argument&) {
    why = "a floating or planar joint of the robot is above it";
  }
  for (const PathStep& step : p.joints) {
    if (!tree_.joints[step.joint].moves()) continue;
    p.moving.push_back(step.joint);
    if (step.direction < 0)
      fail(xml_, body.element,
           "hangs on body '" + model_.bodies[p.above].name + "', but link '" + tree_.links[p.link] +
               "' of the robot does not hang on '" + tree_.links[from] + "'");
  }
  if (why.empty()) why = mismatch(body, p);
  if (!why.empty()) {  // it stays, and what hangs on it is placed on it
    for (const PathStep& step : p.joints)
      if (changed_[step.joint] && p.above >= 0)
        fail(xml_, body.element,
             why + ", and the result changes joint '" + tree_.joints[step.joint].name + "'");
    return;
  }
  std::vector<double> refs;
  for (const MjcfJoint& joint : body.joints) refs.push_back(joint.ref);
  const Pose above_T_body = p.above_T_here * body.pose;
  const Pose before = section(p.joints, robot_.before, refs, Pose()).from_T_to,
             after = section(p.joints, robot_.after, refs, Pose()).from_T_to;
  if (p.above < 0 && !root_T_world_) root_T_world_ = before * inverse(above_T_body);
  const Pose start = start_of(p);
  p.link_T_body = inverse(before) * start * above_T_body;
  const double off = difference_of(p.link_T_body, Pose()),
               off_after = difference_of(inverse(after) * start * above_T_body, Pose());
  if (off_after <= kProvedModel && off_after < off)
    fail(xml_, body.element, "already has the changes of the result");
  if (off <= kRoundedModel) {
    p.link_T_body = Pose();
    rounded_ = std::max(rounded_, off);
  } else {
    if (p.moving.empty() && p.link_T_body.translation.norm() > kRoundedModel)
      fail(xml_, body.element,
           "is " + rounded(p.link_T_body.translation.norm(), 3) + " m from link '" +
               tree_.links[p.link] + "' of the robot: the model is of another robot");
    kept_.push_back(body.name);
  }
  const Section was = section(p.joints, robot_.before, refs, p.link_T_body);
  for (size_t i = 0; i < p.moving.size(); ++i)
    check_line(body.joints[i], was.lines[i], p.moving[i]);
  if (off > kRoundedModel && !p.moving.empty())
    p.link_T_body = p.link_T_body * onto(body.joints.back(), was.lines.back());
  const Section is = section(p.joints, robot_.after, refs, p.link_T_body);
  write_pose(body.element, body.pose, inverse(start * p.above_T_here) * is.from_T_to);
  for (size_t i = 0; i < p.moving.size(); ++i) write_joint(body.joints[i], is.lines[i]);
  for (const PathStep& step : p.joints) covered_[step.joint] = true;
  p.placed = true;
}

std::optional<Pose> ModelEditor::between(int link, int other,
                                         const std::vector<Pose>& origins) const {
  Pose out;
  Path path;
  try {
    path = find_path(tree_, link, other);
  } catch (const std::invalid_argument&) {  // a floating or planar joint
    return std::nullopt;
  }
  for (const PathStep& step : path) {
    const Joint& joint = tree_.joints[step.joint];
    if (!joint.is_rigid()) return std::nullopt;
    const Pose pose = origins[step.joint] * joint_motion(joint, 0);
    out = out * (step.direction > 0 ? pose : inverse(pose));
  }
  return out;
}

void ModelEditor::write_marks() {
  // The body that a mark hangs on, as one of the robot's links: link_T_here; none: no such body.
  const auto holder = [&](const MjcfMark& mark, Pose& link_T_here) {
    int b = mark.body;
    Pose body_T_here = mark.body_T_here;
    for (; b >= 0 && places_[b].link < 0; b = model_.bodies[b].above) {
      if (!model_.bodies[b].joints.empty()) return -1;
      body_T_here = model_.bodies[b].above_T_here * model_.bodies[b].pose * body_T_here;
    }
    if (b >= 0)
      link_T_here = places_[b].link_T_body * body_T_here;
    else if (root_T_world_)
      link_T_here = *root_T_world_ * body_T_here;
    return b >= 0 ? places_[b].link : root_T_world_ ? tree_.root : -1;
  };
  const auto cover = [&](int link, int other) {
    for (const PathStep& step : find_path(tree_, link, other)) covered_[step.joint] = true;
  };
  Pose flipped;  // MuJoCo's cameras look along -z, y is up
  flipped.rotation = Vector3d(1, -1, -1).asDiagonal();
  for (const PlacedCamera& camera : robot_.cameras) {
    bool found = false;
    for (const MjcfMark& mark : model_.cameras) {
      Pose link_T_here;
      if (mark.name != camera.name && link_of(mark.name) != camera.link) continue;
      const int link = holder(mark, link_T_here);
      const std::optional<Pose> pose =
          link < 0 ? std::nullopt : between(link, camera.link, robot_.after);
      if (!pose || !mark.still)
        fail(xml_, mark.element,
             !mark.still
                 ? "follows something (mode): a fixed one is expected"
                 : "moves relative to link '" + tree_.links[camera.link] + "' of the sensor");
      found = true;
      cover(link, camera.link);
      write_pose(mark.element, mark.pose,
                 inverse(link_T_here) * *pose * camera.link_T_camera * flipped);
    }
    if (!found)
      out_.notes.push_back("sensor '" + camera.name +
                           "' is left out: the model has no <camera name=\"" + camera.name + "\">");
  }
  for (const MjcfMark& mark : model_.sites) {
    Pose link_T_here;
    const int other = link_of(mark.name), link = other < 0 ? -1 : holder(mark, link_T_here);
    if (link < 0) continue;
    const std::optional<Pose> was = between(link, other, robot_.before);
    if (!was) continue;
    Pose link_T_site = inverse(*was) * link_T_here * mark.pose;
    if (difference_of(link_T_site, Pose()) <= kRoundedModel) link_T_site = Pose();
    cover(link, other);
    write_pose(mark.element, mark.pose,
               inverse(link_T_here) * *between(link, other, robot_.after) * link_T_site);
  }
}

void ModelEditor::note_what_is_missing() {
  std::vector<std::string> missing;
  bool any = false;
  for (size_t j = 0; j < changed_.size(); ++j) {
    any = any || (changed_[j] && covered_[j]);
    if (!changed_[j] || covered_[j]) continue;
    missing.push_back(tree_.joints[j].name);
    for (const MjcfBody& body : model_.bodies)
      for (const MjcfJoint& joint : body.joints)
        if (joint.name == missing.back() ||
            (!joint.name.empty() && prefix_ + joint.name == missing.back()))
          fail(xml_, joint.element,
               "the result changes it, but body '" + body.name +
                   "' is not called as the link that it moves, '" +
                   tree_.links[tree_.joints[j].child] + "'");
  }
  if (!any && !missing.empty())
    throw InputError(xml_.path + ": no body has the name of a link that the result moves: " +
                     comma_separated(missing) + " are not in it");
  if (!missing.empty())
    out_.notes.push_back("not in the model, their changes are left out: joints " +
                         comma_separated(missing));
  if (!prefix_.empty())
    out_.notes.push_back("its names are the robot's names without '" + prefix_ + "'");
  if (rounded_ > kToldRounding)
    out_.notes.push_back(
        "its bodies were up to " + rounded(rounded_, 2) +
        " m or rad from the robot before the calibration: rounded values, which are exact now");
  if (!turned_.empty())
    out_.notes.push_back("orientations are written as `quat` now: " + comma_separated(turned_));
  if (!kept_.empty())
    out_.notes.push_back("bodies whose frames are not those of the links stay so on them: " +
                         comma_separated(kept_));
}

/// What stands before the names of most links and is missing in those of the bodies; "": nothing,
/// or there are bodies of the links' own names.
std::string ModelEditor::missing_prefix() const {
  std::map<std::string, int> found;
  for (const MjcfBody& body : model_.bodies)
    for (const std::string& link : tree_.links)
      if (!body.name.empty() && link.size() >= body.name.size() &&
          link.compare(link.size() - body.name.size(), body.name.size(), body.name) == 0)
        ++found[link.substr(0, link.size() - body.name.size())];
  const auto most = std::max_element(
      found.begin(), found.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == found.end() || most->second < 2 || found.count("") ? "" : most->first;
}

EditedMjcf ModelEditor::edit() {
  places_.resize(model_.bodies.size());
  prefix_ = missing_prefix();
  for (size_t b = 0; b < places_.size(); ++b) {
    places_[b].link = link_of(model_.bodies[b].name);
    if (places_[b].link >= 0) place(b);
  }
  write_marks();
  note_what_is_missing();
  out_.text = spliced(xml_.text, splices_);
  return out_;
}

void ModelEditor::prove(const Mjcf& written) const {
  RandomStream draws(20240229);
  std::vector<double> positions(tree_.joints.size(), 0.0);
  for (int posture = 0; posture < 20; ++posture) {
    for (size_t j = 0; j < positions.size(); ++j) {
      const auto [lower, upper] = usual_range(tree_.joints[j]);
      positions[j] = tree_.joints[j].has_reading() ? draws.uniform(lower, upper) : 0;
    }
    follow_mimics(tree_, positions);
    const std::vector<Pose> links = link_poses(tree_, robot_.after, positions);
    std::vector<Pose> bodies(places_.size());
    for (size_t b = 0; b < places_.size(); ++b) {
      const BodyPlace& p = places_[b];
      if (p.link < 0) continue;
      const Pose shall = links[p.link] * p.link_T_body;
      bodies[b] = shall;
      if (!p.placed) continue;
      bodies[b] = (p.above >= 0 ? bodies[p.above] : links[tree_.root] * start_of(p)) *
                  p.above_T_here * written.bodies[b].pose;
      for (size_t i = 0; i < p.moving.size(); ++i)
        bodies[b] = bodies[b] * written.bodies[b].joints[i].motion(positions[p.moving[i]]);
      if (!(difference_of(bodies[b], shall) <= kProvedModel))
        throw InputError(xml_.path +
                         ": the written model would not describe the calibrated robot: body '" +
                         written.bodies[b].name + "' would be off by " +
                         rounded(difference_of(bodies[b], shall), 3) + " m or rad");
    }
  }
}

}  // namespace

bool is_mjcf(const std::string& text) {
  pugi::xml_document document;
  return document.load_buffer(text.data(), text.size(), pugi::parse_default, pugi::encoding_utf8) &&
         std::strcmp(document.document_element().name(), "mujoco") == 0;
}

EditedMjcf edit_mjcf(const std::string& text, const std::string& path,
                     const CalibratedTree& robot) {
  Xml xml{text, path};
  const Mjcf model = read_mjcf(xml);
  ModelEditor editor(xml, model, robot);
  EditedMjcf out = editor.edit();
  Xml again{out.text, path + " (written)"};
  editor.prove(read_mjcf(again));
  return out;
}

}  // namespace kincal
