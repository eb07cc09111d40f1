#include "reasons.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include "../../solver/decompositions.h"
#include "../estimation/estimation.h"
#include "../rig/geometry.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "hand_eye.h"

namespace kincal {
namespace {

constexpr double kCancel = 0.03;  // what is left of the parts, relative: they cancel

/// How far the readings of a joint reach over the training samples.
std::pair<double, double> joint_range(const Scene& scene, int joint) {
  double low = kInfinity, high = -low;
  for (int s : scene.recording().training()) {
    const double reading = scene.recording().samples[s].readings[joint];
    if (!std::isfinite(reading)) continue;
    low = std::min(low, reading);
    high = std::max(high, reading);
  }
  return {low, high};
}

bool slides(const Scene& scene, int joint) {
  return scene.rig().tree.joints[joint].type == JointType::prismatic;
}

std::string spread_text(const Scene& scene, int joint) {
  const auto range = joint_range(scene, joint);
  const double span = range.second - range.first;
  const std::string name = scene.rig().tree.joints[joint].name;
  if (!(span > 1e-3))
    return name + text(" never moved: its reading is %.4g in all samples", range.first);
  return name + " moved within " + (slides(scene, joint) ? length_text(span) : angle_text(span)) +
         " only";
}

/// Joints whose motion would break a cancellation of `a` with `b` as the seen points show it, the
/// best first.
std::vector<int> breaking_joints(const Scene& scene, const VectorXd& a, const VectorXd& b,
                                 double now) {
  std::set<int> joints;
  for (const Scene::Seen& s : scene.seen())
    for (const PathStep& step : s.path)
      if (const Joint& moving = scene.rig().tree.joints[step.joint];
          moving.moves() && moving.axis_of_pose != PoseAxis::error) {
        const int j = driver(scene.rig().tree, step.joint).joint;
        if (j != scene.rig().sensors[s.view->sensor].scanning_joint) joints.insert(j);
      }
  std::vector<std::pair<double, int>> found;
  for (int j : joints) {
    double worst = 0;
    for (double sign : {-1.0, 1.0}) {
      const double by = sign * (slides(scene, j) ? 0.1 : 0.4);
      const std::vector<ViewMotion> first = motions(scene, a, j, by),
                                    second = motions(scene, b, j, by);
      const double parts = squared_points(first) + squared_points(second);
      if (parts > 0) worst = std::max(worst, std::sqrt(squared_points(first, &second) / parts));
    }
    if (worst > std::max(2 * kCancel, 5 * now)) found.push_back({-worst, j});
  }
  std::sort(found.begin(), found.end());
  std::vector<int> out;
  for (const auto& f : found)
    if (f.first < 0.3 * found[0].first) out.push_back(f.second);
  return out;
}

enum class Kind { turn, shift, screw };

/// Whether motions are turns about an axis or shifts; felt at the target.
Kind kind_of(const Scene& scene, const std::vector<ViewMotion>& motion) {
  double turning = 0, shifting = 0, along = 0;
  for (size_t v = 0; v < motion.size(); ++v) {
    const Vector3d w = motion[v].twist.tail<3>();
    const Vector3d origin = scene.sensor_T_target(scene.solution(), scene.seen()[v]).translation;
    const Vector3d shift = motion[v].twist.head<3>() + w.cross(origin);
    turning += 0.04 * w.squaredNorm();
    shifting += shift.squaredNorm();
    if (w.norm() > 0) along += std::pow(shift.dot(w.normalized()), 2);
  }
  if (turning < kCancel * kCancel * shifting) return Kind::shift;
  return along < kCancel * (turning + shifting) ? Kind::turn : Kind::screw;
}

/// Largest distance of what is seen from the axis of a joint, and the smallest one from its origin.
std::pair<double, double> distance_from_axis(const Scene& scene, int joint) {
  double off = 0, far = kInfinity;
  const VectorXd& values = scene.solution();
  for (const Scene::Seen& s : scene.seen()) {
    Path before;
    bool on_path = false;
    for (const PathStep& step : s.path) {
      before.push_back(step);
      if (step.joint == joint) {
        on_path = true;
        break;
      }
    }
    if (!on_path) continue;
    Pose link_T_joint = scene.along(before, values, s, -1,
                                    0);  // behind the joint (down), or in front of its origin (up)
    if (before.back().direction < 0)
      link_T_joint = link_T_joint *
                     get_pose(values, scene.table().all[scene.table().joint_origin[joint]].start);
    const Pose link_T_target =
        get_pose(values, scene.table().all[scene.table().sensor_pose[s.view->sensor]].start) *
        scene.sensor_T_target(values, s);
    for (const Vector3d& p : s.points) {
      const Vector3d q = inverse(link_T_joint) * (link_T_target * p);
      const Vector3d& axis = scene.rig().tree.joints[joint].axis;
      off = std::max(off, (q - axis * axis.dot(q)).norm());
      far = std::min(far, q.norm());
    }
  }
  return {off, far};
}

/// How far targets turn before the sensors.
Turns orientations(const Scene& scene, const std::vector<char>& sensors) {
  Turns out;
  for (size_t s = 0; s < sensors.size(); ++s) {
    if (!sensors[s]) continue;
    std::vector<Matrix3d> rotations;
    for (const Scene::Seen& v : scene.seen())
      if (v.view->sensor == static_cast<int>(s))
        rotations.push_back(scene.sensor_T_target(scene.solution(), v).rotation);
    const Turns turns = turns_of(rotations);
    out = {std::max(out.most, turns.most), std::max(out.others, turns.others)};
  }
  return out;
}

/// Finds the reason of one direction.
class ReasonFinder {
 public:
  ReasonFinder(const Scene& scene, const WeakColumns& direction, const Effects& effects)
      : scene_(scene),
        columns_(direction.columns),
        d_(direction.coefficients),
        determined_(direction.determined),
        effects_(effects) {}

  Reason find() {
    search();
    return out_;
  }

 private:
  void search() {
    const double parts = effects_.parts();
    if (!(parts > 0)) return nothing();
    if (const MotionLack lack = places_only() ? motion_lack(scene_.recording()) : MotionLack();
        !lack.why.empty()) {
      out_.kind = "hand_eye";
      out_.why = lack.why;
      out_.cure = lack.cure + (lack.otherwise.empty() ? "" : "; " + lack.otherwise);
      return;
    }
    const double together = std::sqrt(effects_.together / parts),
                 left = std::sqrt(effects_.left / parts);
    if (together < kCancel) return cancelling(together);
    if (left < kCancel) return lens() ? trade_off() : free_targets();
    out_.kind = "unknown";
    out_.why = "no single reason was found: " + names() +
               " change the measurements, but in nearly the same way in these postures";
    out_.cure = "record more and more varied postures, or fix " + first() + " or give it a prior";
  }

  std::string first() const { return scene_.table().name(scene_.columns()[columns_[0]]); }

  /// What to do with the first: a pose that the rig does not give has nothing to be held at.
  std::string hold_first() const {
    const Parameter& p = scene_.table().all[scene_.columns()[columns_[0]].parameter];
    return (!is_given(scene_.rig(), p) ? "give " + p.name + " in the rig, and fix " : "fix ") +
           first();
  }

  /// Components, those of one parameter together: "joint/a/origin (x, ry)".
  std::vector<std::string> grouped(bool with_first) const {
    const ParameterTable& table = scene_.table();
    const std::vector<Component>& columns = scene_.columns();
    std::vector<std::pair<int, std::string>> out;
    for (int c : columns_) {
      const Parameter& p = table.all[columns[c].parameter];
      const std::string component = p.components[columns[c].index];
      const auto it = std::find_if(out.begin(), out.end(),
                                   [&](const auto& o) { return o.first == columns[c].parameter; });
      if (it == out.end())
        out.push_back({columns[c].parameter, component});
      else
        it->second += ", " + component;
    }
    std::vector<std::string> names;
    for (size_t i = with_first ? 0 : 1; i < out.size(); ++i)
      names.push_back(table.all[out[i].first].name +
                      (out[i].second.empty() ? "" : " (" + out[i].second + ")"));
    return names;
  }
  std::string names() const { return listed(grouped(true)); }

  /// The direction's part of the first parameter, or the rest.
  VectorXd part(bool of_first) const {
    const int p = first_parameter();
    VectorXd out = d_;
    for (Eigen::Index c = 0; c < out.size(); ++c)
      if ((scene_.columns()[c].parameter == p) != of_first) out(c) = 0;
    return out;
  }
  int first_parameter() const { return scene_.columns()[columns_[0]].parameter; }

  void nothing() {
    const std::vector<ViewMotion> motion = motions(scene_, d_);
    if (squared_wholes(scene_, motion) > 0 && kind_of(scene_, motion) == Kind::turn) {
      out_.kind = "on_axis";
      out_.why = "all points seen lie on the axis about which " + names() +
                 " turns: one point, or points on a line";
      out_.cure =
          "fix " + first() + ", or add points beside this axis (three that are not on a line)";
      return;
    }
    out_.kind = "nothing_depends";
    out_.why = "no measurement depends on " + names();
    const Parameter& parameter = scene_.table().all[first_parameter()];
    if (parameter.kind == ParameterKind::temperature) {
      out_.why += " (no sample states a temperature other than 20)";
      out_.cure = "state `temperature` in the samples, or fix " + first();
      return;
    }
    const bool backlash = parameter.kind == ParameterKind::backlash;
    if (backlash || parameter.kind == ParameterKind::time_offset ||
        parameter.kind == ParameterKind::line_time) {
      const std::string& owner = backlash ? scene_.rig().tree.joints[parameter.owner].name
                                          : scene_.rig().sensors[parameter.owner].name;
      out_.why += backlash ? " (no sample states the approach of joint '" + owner + "')"
                           : " (no sample states rates of joints that move what sensor '" + owner +
                                 "' sees)";
      out_.cure = std::string("state `") + (backlash ? "approach" : "rates") +
                  "` in the samples, or fix " + first();
      return;
    }
    if (parameter.kind == ParameterKind::joint_scale ||
        parameter.kind == ParameterKind::joint_shape) {
      const auto range = joint_range(scene_, parameter.owner);
      if (std::max(std::abs(range.first), std::abs(range.second)) < 1e-9) {
        const std::string& joint = scene_.rig().tree.joints[parameter.owner].name;
        out_.why += " (" + joint + " reads 0 in all samples)";
        out_.joints = {joint};
        out_.cure = "record postures that move " + joint + ", or fix " + first();
        return;
      }
    }
    out_.cure = "fix " + first() + " (do not estimate it), or add a sensor or target that it moves";
  }

  /// The parts cancel in the residuals, without anything private going along.
  void cancelling(double now) {
    const bool one = grouped(true).size() < 2;
    VectorXd a = part(true), b = part(false);
    if (one) {  // components of one parameter among themselves
      a.setZero();
      a(columns_[0]) = d_(columns_[0]);
      b = d_ - a;
    }
    const std::vector<ViewMotion> left = motions(scene_, a), right = motions(scene_, b);
    const auto share = [](double together, double l, double r) {
      return std::sqrt(together / std::max(1e-300, l + r));
    };
    const double whole = share(squared_wholes(scene_, left, &right), squared_wholes(scene_, left),
                               squared_wholes(scene_, right)),
                 points = share(squared_points(left, &right), squared_points(left),
                                squared_points(right));
    if (points > 3 * kCancel) return trade_off();
    const std::string sides = names();
    const std::vector<int> joints = breaking_joints(scene_, a, b, std::max(points, now));
    if (whole < 3 * kCancel) {
      const Kind kind = kind_of(scene_, left);
      const bool many = grouped(true).size() > 3;
      out_.kind = kind == Kind::shift ? "same_shift" : "same_axis";
      if (many) {
        out_.why = "gauge: moving " + grouped(true)[0] + " is the same as moving " +
                   listed(grouped(false)) + " together the other way";
      } else {
        out_.why =
            sides + (kind == Kind::shift  ? " shift the measured points along the same direction"
                     : kind == Kind::turn ? " turn the measured points about the same axis"
                                          : " move the measured points in the same way");
      }
    } else {
      out_.kind = "same_points";
      out_.why = sides + " are different motions, but move all measured points in the same way";
      if (on_axis()) return;
    }
    finish(joints);
  }

  /// What is seen lies on the axis of the joint whose origin is freed: shifting the axis sideways
  /// and tilting it are one.
  bool on_axis() {
    const Parameter& parameter = scene_.table().all[first_parameter()];
    if (parameter.kind != ParameterKind::joint_origin ||
        !scene_.rig().tree.joints[parameter.owner].moves())
      return false;
    const auto distance = distance_from_axis(scene_, parameter.owner);
    if (!(distance.first < 0.03 * distance.second)) return false;
    const std::string& name = scene_.rig().tree.joints[parameter.owner].name;
    out_.kind = "on_axis";
    out_.why = "all points seen lie on the axis of " + name + " (within " +
               length_text(distance.first) + ", " + length_text(distance.second) +
               " from its origin): shifting the axis sideways and tilting it (" + names() +
               ") move them alike";
    out_.cure = "no posture helps: fix " + first() +
                " or give it a prior, or mount the target beside this axis";
    return true;
  }

  /// Where things sit, and nothing of lenses, sizes and zeros.
  bool places_only() const {
    return std::all_of(columns_.begin(), columns_.end(), [&](int c) {
      const ParameterKind kind = scene_.table().all[scene_.columns()[c].parameter].kind;
      return kind == ParameterKind::sensor_pose || kind == ParameterKind::target_pose ||
             kind == ParameterKind::joint_origin;
    });
  }

  bool lens() const {
    return std::any_of(columns_.begin(), columns_.end(), [&](int c) {
      const ParameterKind kind = scene_.table().all[scene_.columns()[c].parameter].kind;
      return kind == ParameterKind::intrinsics || kind == ParameterKind::distortion;
    });
  }

  /// Different motions and the sensors' own numbers or sizes cancel in what is measured.
  void trade_off() {
    out_.kind = "size";
    bool angles = true;
    for (size_t s = 0; s < effects_.sensors.size(); ++s)
      if (effects_.sensors[s] &&
          scene_.rig().sensors[s].model->measurement_kind() != MeasurementKind::rays)
        angles = false;
    const auto turned = orientations(scene_, effects_.sensors);
    if (lens() && turned.others < 10 * kPi / 180) {
      out_.kind = "one_orientation";
      out_.why = names() + (grouped(true).size() > 1 ? " trade off" : " is weakly determined") +
                 ": the lens against the poses; targets turn by no more than " +
                 angle_text(turned.others) +
                 (turned.most < 10 * kPi / 180 ? " before the camera (one orientation)"
                                               : " about a second axis before the camera");
      out_.cure =
          "record views with the target tilted by 20 to 40 degrees about different axes, or fix " +
          first();
    } else if (lens()) {
      out_.kind = "lens";
      out_.why = names() + (grouped(true).size() > 1 ? " trade off" : " is weakly determined") +
                 ": the lens against the positions";
      out_.cure = "record views over the whole image and at different distances, or fix " + first();
    } else if (angles) {
      out_.why = names() +
                 " trade off: cameras measure angles and no fixed parameter is a length, so all "
                 "sizes and distances can scale together";
      out_.cure = "fix a length (" + first() +
                  " or the size of a target or a baseline), or add a sensor that measures lengths";
    } else {
      out_.kind = "unknown";
      out_.why = "no reason was found: " + names() +
                 " trade off in all samples, but move things differently";
      out_.cure = "fix " + first() + " or give it a prior";
    }
  }

  void free_targets() {
    std::set<std::string> targets;
    std::set<int> sensors;
    for (const Scene::Seen& s : scene_.seen())
      if (scene_.rig().targets[s.view->target].link < 0) {
        targets.insert(scene_.rig().targets[s.view->target].name);
        sensors.insert(s.view->sensor);
      }
    const std::string free = listed({targets.begin(), targets.end()});
    out_.kind = "free_targets";
    const bool one = columns_.size() == 1;
    const bool nearly = determined_;
    out_.why = (nearly ? "nearly a gauge: " : "gauge: ") + names() +
               (one ? " moves" : " move together") + " the sensors or links of the free " +
               (targets.size() == 1 ? "target " : "targets ") + free +
               (targets.size() == 1 ? ", which goes" : ", which go") +
               " along: " + (nearly ? "hardly anything" : "nothing") +
               " that is fixed connects this to the base";
    out_.cure =
        "fix " + first() + ", or add a fixed sensor or a mounted target to the same samples";
    if (sensors.size() == 1)
      out_.cure = "mount " + free + " on the link that carries " +
                  (targets.size() == 1 ? "it" : "them") +
                  " (the base, if nothing moves), or let a second sensor see " +
                  (targets.size() == 1 ? "it" : "them") + " in the same samples: to one sensor " +
                  "alone its own pose in every sample explains everything; or fix " + first();
  }

  /// The number of the first joint that is the same as where the base frame is, where a pose of
  /// something at the base goes along with it; else "".
  std::string base_choice() const {
    const Tree& tree = scene_.rig().tree;
    const int base = body_of(tree, scene_.rig().base);
    std::string number;
    bool at_base = false;
    for (const int c : columns_) {
      const Component& component = scene_.columns()[c];
      const Parameter& p = scene_.table().all[component.parameter];
      const bool of_joint =
          p.kind == ParameterKind::joint_offset || p.kind == ParameterKind::joint_origin;
      if (of_joint && tree.joints[p.owner].moves() &&
          body_of(tree, tree.joints[p.owner].parent) == base)
        number = scene_.table().name(component);
      if (p.kind == ParameterKind::sensor_pose)
        at_base = at_base || body_of(tree, scene_.rig().sensors[p.owner].link) == base;
      if (p.kind == ParameterKind::target_pose)
        at_base = at_base || body_of(tree, scene_.rig().targets[p.owner].link) == base;
    }
    return at_base ? number : "";
  }

  void finish(const std::vector<int>& joints) {
    if (const std::string number = base_choice(); joints.empty() && !number.empty()) {
      out_.why += ", whatever the posture: the position of the base frame and " + number +
                  " are one unknown, and no measurement depends on it";
      out_.cure = "fix " + number + ", because the position of the base frame is a free choice";
      return;
    }
    if (joints.empty()) {
      out_.why += ", whatever the posture";
      out_.cure = "no posture distinguishes them: " + hold_first() +
                  (columns_.size() > 1 ? " (or another of them)" : "") + ", or give it a prior";
      return;
    }
    std::vector<std::string> why, names;
    std::vector<int> still_joints;
    for (int j : joints) {
      const auto range = joint_range(scene_, j);
      if (!(range.second - range.first > 1e-3)) still_joints.push_back(j);
    }
    const std::vector<int>& named = still_joints.empty() ? joints : still_joints;
    for (int j : named) {
      why.push_back(spread_text(scene_, j));
      names.push_back(scene_.rig().tree.joints[j].name);
    }
    out_.joints = names;
    out_.why += " in all samples: " + listed(why, 2);
    out_.cure = "record postures that move " + listed(names) +
                (still_joints.empty() ? " further" : "") + ", or fix " + first();
  }

  const Scene& scene_;
  const std::vector<int>& columns_;
  const VectorXd& d_;
  const bool determined_;
  const Effects& effects_;
  Reason out_;
};
}  // namespace

std::vector<Effects> effects_of(Scene& scene, const std::vector<VectorXd>& directions) {
  std::vector<Effects> out(directions.size());
  for (Effects& e : out) e.sensors.assign(scene.rig().sensors.size(), 0);
  MatrixXd rows;
  std::vector<NoiseRows> kinds;
  scene.problem().prepare(scene.state());
  for (size_t g = 0; g < scene.problem().groups().size(); ++g) {
    const GroupShape& shape = scene.problem().groups()[g];
    scene.problem().noise_rows(static_cast<int>(g), scene.state(), rows, kinds);
    const int k = shape.private_size;
    const int poses =
        k - static_cast<int>(std::count_if(kinds.begin(), kinds.end(),
                                           [](const NoiseRows& w) { return w.joint >= 0; }));
    std::optional<Elimination> own;
    if (poses > 0) own.emplace(rows.leftCols(poses));
    for (size_t d = 0; d < directions.size(); ++d) {
      VectorXd all = VectorXd::Zero(rows.rows());
      for (size_t i = 0; i < shape.columns.size(); ++i) {
        const double c = directions[d](shape.columns[i]);
        if (c == 0) continue;
        const VectorXd column = c * rows.col(k + static_cast<Eigen::Index>(i));
        out[d].part[shape.columns[i]] += column.squaredNorm();
        for (const NoiseRows& w : kinds)
          if (w.view && !column.segment(w.first, w.count).isZero(0))
            out[d].sensors[w.view->sensor] = 1;
        all += column;
      }
      out[d].together += all.squaredNorm();
      if (own) {
        own->rotate(all);
        out[d].left += all.tail(all.size() - own->rank()).squaredNorm();
      } else {
        out[d].left += all.squaredNorm();
      }
    }
  }
  return out;
}

Reason find_reason(const Scene& scene, const WeakColumns& direction, const Effects& effects) {
  return ReasonFinder(scene, direction, effects).find();
}

}  // namespace kincal
