#include "dh.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../../models/rig/random_stream.h"
#include "../document/error.h"
#include "../document/files.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "../results/mount_texts.h"

namespace kincal {
namespace {

constexpr double kParallel = 0.03;    // rad: axes that are nearer to it are meant to be parallel
constexpr double kCoincident = 1e-6;  // m
constexpr double kCrossing = 1e-3;    // m: axes that are meant to cross; a may be negative there

Pose turned(const Vector3d& axis, double angle) {
  return {rotation_about(axis, angle), Vector3d::Zero()};
}
Pose moved(double x, double z) { return {Matrix3d::Identity(), {x, 0, z}}; }

/// The part of a row along and about z, and that along and about x.
Pose about_z(const DhRow& row, double reading) {
  return turned(Vector3d::UnitZ(), row.theta + (row.slides ? 0 : reading)) *
         moved(0, row.d + (row.slides ? reading : 0));
}
Pose about_x(const DhRow& row) { return moved(row.a, 0) * turned(Vector3d::UnitX(), row.alpha); }

/// A line: z of the frames on it.
struct AxisLine {
  Vector3d point, z;
};

Vector3d across(const Vector3d& x, const Vector3d& z) {
  const Vector3d out = x - z.dot(x) * z;
  return out.norm() > 1e-9 ? Vector3d(out.normalized()) : Vector3d(z.unitOrthogonal());
}

Pose frame_of(const Vector3d& origin, const Vector3d& x, const Vector3d& z) {
  Pose out;
  out.rotation.col(0) = across(x, z);
  out.rotation.col(2) = z;
  out.rotation.col(1) = z.cross(out.rotation.col(0));
  out.translation = origin;
  return out;
}

/// A frame on a line with z along it, as near to another frame as may be.
Pose frame_on(const AxisLine& line, const Pose& near) {
  return frame_of(line.point + line.z.dot(near.translation - line.point) * line.z,
                  near.rotation.col(0), line.z);
}

bool nearly_parallel(const Vector3d& a, const Vector3d& b) { return a.cross(b).norm() < kParallel; }

/// `z` itself, or where it goes with another axis that one, in its direction.
Vector3d made_parallel(const Vector3d& z, const Vector3d& axis) {
  return !nearly_parallel(z, axis) ? z : z.dot(axis) > 0 ? axis : Vector3d(-axis);
}

/// The perpendicular from the line of a frame to the next line: `from` and `to` are frames at its
/// ends, with x along it.
struct Perpendicular {
  Pose from, to;
};

Perpendicular perpendicular(const Pose& frame, const AxisLine& next) {
  const Vector3d z = frame.rotation.col(2), p = frame.translation;
  const Vector3d normal = z.cross(next.z), between = next.point - p;
  Vector3d foot = p, end, x;
  if (nearly_parallel(z, next.z)) {  // from where the frame is
    end = next.point - next.z * (between.dot(z) / next.z.dot(z));
    x = (end - foot).norm() > kCoincident ? across(end - foot, z) : Vector3d(frame.rotation.col(0));
  } else {
    const double c = z.dot(next.z), along = between.dot(z), along_next = between.dot(next.z);
    const double s2 = normal.squaredNorm();
    foot = p + z * ((along - c * along_next) / s2);
    end = next.point + next.z * ((c * along - along_next) / s2);
    x = normal.normalized();
    const double a = (end - foot).dot(x);
    if (std::abs(a) > kCrossing ? a < 0 : x.dot(frame.rotation.col(0)) < -1e-9) x = -x;
  }
  return {frame_of(foot, x, z), frame_of(end, x, next.z)};
}

/// Numbers of the step from a frame to another one on the same line.
void set_about_z(const Pose& from, const Pose& to, DhRow& row) {
  const Vector3d x = from.rotation.transpose() * to.rotation.col(0);
  row.theta = std::atan2(x.y(), x.x());
  row.d = from.rotation.col(2).dot(to.translation - from.translation);
}
/// Numbers of the step along a perpendicular.
void set_about_x(const Perpendicular& p, DhRow& row) {
  const Vector3d z = p.from.rotation.transpose() * p.to.rotation.col(2);
  row.a = p.from.rotation.col(0).dot(p.to.translation - p.from.translation);
  row.alpha = std::atan2(-z.y(), z.z());
}

std::vector<int> chain(const Tree& tree, int base, int tip) {
  std::vector<int> out;
  for (int link = tip; link != base; link = tree.joints[out.back()].parent) {
    if (tree.joint_above[link] < 0)
      throw InputError("--tip: link '" + tree.links[tip] + "' is not below '" + tree.links[base] +
                       "'");
    out.push_back(tree.joint_above[link]);
  }
  std::reverse(out.begin(), out.end());
  for (const int j : out) {
    const Joint& joint = tree.joints[j];
    if (joint.is_rigid() || joint.has_reading()) continue;
    throw InputError("--tip: joint '" + joint.name +
                     "' has no reading of its own: it has no place in a table");
  }
  return out;
}

std::string pose_comment(const std::string& what, const Pose& pose) {
  const Vector3d rpy = rpy_from_rotation(pose.rotation);
  if (pose.translation.norm() < 1e-9 && log_so3(pose.rotation).norm() < 1e-9) return "";
  return "# " + what + ": xyz " + shortest(pose.translation) + ", rpy " + shortest(rpy) + " (" +
         rounded(1e3 * pose.translation.norm(), 4) + " mm, " +
         rounded(1e3 * log_so3(pose.rotation).norm(), 4) + " mrad)\n";
}

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> out(1);
  for (const char c : line) {
    if (c == ',' || c == ';' || c == '\t')
      out.emplace_back();
    else if (c != ' ' && c != '\r')
      out.back() += c;
  }
  return out;
}

}  // namespace

DhTable dh_table(const Tree& tree, const std::vector<Pose>& origins, int base, int tip,
                 bool modified) {
  DhTable out;
  out.modified = modified;
  std::vector<AxisLine> lines;
  Pose at;
  for (const int j : chain(tree, base, tip)) {
    const Joint& joint = tree.joints[j];
    at = at * origins[j];
    if (joint.has_reading()) {
      lines.push_back({at.translation, at.rotation * joint.axis});
      out.rows.push_back({joint.name, 0, 0, 0, 0, joint.type == JointType::prismatic});
    }
    at = at * joint_motion(joint, 0);
  }
  if (lines.empty()) throw InputError("--tip: no joint moves it relative to the base");
  const size_t n = lines.size();
  if (modified) {
    Pose here;  // on z of the base, or along the first axis; from there on a frame on each axis
    here.rotation =
        rotation_between(Vector3d::UnitZ(), made_parallel(Vector3d::UnitZ(), lines[0].z));
    Perpendicular p = perpendicular(here, lines[0]);
    out.base_T_first = p.from;
    for (size_t i = 0; i < n; ++i) {
      set_about_x(p, out.rows[i]);
      here = p.to;
      if (i + 1 < n) p = perpendicular(here, lines[i + 1]);
      const Pose end = i + 1 < n ? p.from : frame_on(lines[i], at);
      set_about_z(here, end, out.rows[i]);
      here = end;
    }
    out.last_T_tip = inverse(here) * at;
  } else {
    Pose here = frame_on(lines[0], Pose());
    out.base_T_first = here;
    for (size_t i = 0; i < n; ++i) {
      const AxisLine next =
          i + 1 < n ? lines[i + 1]
                    : AxisLine{at.translation, made_parallel(at.rotation.col(2), lines[i].z)};
      // The last perpendicular may stand where the tip is, where its z goes with the axis.
      const Pose from = i + 1 < n ? here : frame_on(lines[i], at);
      const bool along = nearly_parallel(lines[i].z, next.z);
      const Perpendicular p = perpendicular(along ? from : here, next);
      set_about_z(here, p.from, out.rows[i]);
      set_about_x(p, out.rows[i]);
      here = p.to;
    }
    out.last_T_tip = inverse(here) * at;
  }
  return out;
}

Pose dh_pose(const DhTable& table, const std::vector<double>& readings) {
  Pose out = table.base_T_first;
  for (size_t i = 0; i < table.rows.size(); ++i) {
    const Pose z = about_z(table.rows[i], readings[i]), x = about_x(table.rows[i]);
    out = out * (table.modified ? x * z : z * x);
  }
  return out * table.last_T_tip;
}

DhMisfit dh_misfit(const DhTable& table, const Tree& tree, const std::vector<Pose>& origins,
                   int base, int tip) {
  DhMisfit out;
  RandomStream draws(20240229);
  for (int posture = 0; posture < 100; ++posture) {
    std::vector<double> readings, positions(tree.joints.size(), 0.0);
    for (const DhRow& row : table.rows) {
      const int j = tree.find_joint(row.joint);
      const auto [lower, upper] = usual_range(tree.joints[j]);
      readings.push_back(draws.uniform(lower, upper));
      positions[j] = readings.back();
    }
    const std::vector<Pose> links = link_poses(tree, origins, positions);
    const Pose off = inverse(dh_pose(table, readings)) * (inverse(links[base]) * links[tip]);
    out.metres = std::max(out.metres, off.translation.norm());
    out.radians = std::max(out.radians, log_so3(off.rotation).norm());
  }
  return out;
}

std::string dh_text(const DhTable& table, const DhMisfit& misfit, const std::string& base,
                    const std::string& tip) {
  std::string out = "# " + base + " to " + tip + ", " +
                    (table.modified ? "modified (Craig): Rx(alpha) Tx(a) Rz(theta_offset + q) Tz(d)"
                                    : "standard: Rz(theta_offset + q) Tz(d) Tx(a) Rx(alpha)") +
                    "; m, rad\n" + pose_comment("before the first row", table.base_T_first) +
                    pose_comment("behind the last row", table.last_T_tip);
  out +=
      "# not expressed" +
      (misfit.metres < 1e-9 && misfit.radians < 1e-9
           ? std::string(": nothing else\n")
           : " (nearly parallel axes are made parallel): up to " + rounded(1e3 * misfit.metres, 3) +
                 " mm and " + rounded(1e3 * misfit.radians, 3) + " mrad of " + tip + "\n");
  out += "joint,a,alpha,d,theta_offset,type\n";
  for (const DhRow& row : table.rows)
    out += row.joint + "," + shortest(row.a) + "," + shortest(row.alpha) + "," + shortest(row.d) +
           "," + shortest(row.theta) + "," + (row.slides ? "prismatic" : "revolute") + "\n";
  return out;
}

DhTable read_dh(const std::string& path, bool modified) {
  const std::string text = read_file(path);
  DhTable out;
  out.modified = modified;
  std::map<std::string, size_t> columns;
  int line = 0;
  for (size_t at = 0; at < text.size(); ++line) {
    const size_t end = std::min(text.find('\n', at), text.size());
    const std::string row_text = text.substr(at, end - at);
    at = end + 1;
    const std::vector<std::string> cells = cells_of(row_text);
    if (cells.size() == 1 && cells[0].empty()) continue;
    if (row_text[0] == '#') continue;
    const std::string where = path + ":" + std::to_string(line + 1) + ": ";
    if (columns.empty()) {
      for (size_t i = 0; i < cells.size(); ++i) columns[cells[i]] = i;
      for (const char* name : {"a", "alpha", "d", "theta_offset"})
        if (!columns.count(name))
          throw InputError(where +
                           "a header with a, alpha, d and theta_offset is expected (and, if "
                           "you like, joint and type)");
      continue;
    }
    if (cells.size() != columns.size())
      throw InputError(where + std::to_string(cells.size()) + " cells; the header has " +
                       std::to_string(columns.size()));
    const auto number = [&](const char* name, bool angle) {
      double value = 0;
      const std::string& cell = cells[columns[name]];
      if (!read_number(cell, value))
        throw InputError(where + name + ": '" + cell + "' is no number");
      if (angle && std::abs(value) > 6.3)
        throw InputError(where + name + ": " + cell + " is more than a turn: rad is expected");
      return value;
    };
    DhRow row;
    row.joint = columns.count("joint") ? cells[columns["joint"]]
                                       : "joint_" + std::to_string(out.rows.size() + 1);
    row.a = number("a", false), row.alpha = number("alpha", true);
    row.d = number("d", false), row.theta = number("theta_offset", true);
    const std::string type = columns.count("type") ? cells[columns["type"]] : "revolute";
    if (type != "revolute" && type != "prismatic")
      throw InputError(where + "type: '" + type + "'; valid: revolute, prismatic");
    row.slides = type == "prismatic";
    out.rows.push_back(row);
  }
  if (out.rows.empty()) throw InputError(path + ": contains no row of a Denavit-Hartenberg table");
  return out;
}

std::string dh_urdf(const DhTable& table, const std::string& robot) {
  std::string links = "  <link name=\"base\"/>\n", joints, parent = "base";
  const auto origin = [](const Pose& p) {
    return "    <origin xyz=\"" + shortest(p.translation) + "\" rpy=\"" +
           shortest(Vector3d(rpy_from_rotation(p.rotation))) + "\"/>\n";
  };
  const auto joint_text = [&](const std::string& name, const std::string& type,
                              const std::string& child, const Pose& pose) {
    links += "  <link name=\"" + xml_text(child) + "\"/>\n";
    joints += "  <joint name=\"" + xml_text(name) + "\" type=\"" + type + "\">\n" + origin(pose) +
              "    <parent link=\"" + xml_text(parent) + "\"/><child link=\"" + xml_text(child) +
              "\"/>\n" + (type == "fixed" ? "" : "    <axis xyz=\"0 0 1\"/>\n");
    if (type == "prismatic")
      joints += "    <limit lower=\"-0.5\" upper=\"0.5\" effort=\"1\" velocity=\"1\"/>\n";
    joints += "  </joint>\n";
    parent = child;
  };
  Pose before = table.base_T_first;
  for (size_t i = 0; i < table.rows.size(); ++i) {
    const DhRow& row = table.rows[i];
    if (table.modified) before = before * about_x(row);
    joint_text(row.joint, row.slides ? "prismatic" : "continuous", "link_" + std::to_string(i + 1),
               before * about_z(row, 0));
    before = table.modified ? Pose() : about_x(row);
  }
  joint_text("tip_joint", "fixed", "tip", before * table.last_T_tip);
  return "<?xml version=\"1.0\"?>\n<robot name=\"" + xml_text(robot) + "\">\n" + links + joints +
         "</robot>\n";
}

}  // namespace kincal
