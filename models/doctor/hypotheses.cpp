#include "hypotheses.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "../../solver/decompositions.h"
#include "../sensors/sensors.h"

namespace kincal {
namespace {

using Samples = std::vector<Sample>;
using Eigen::Matrix2d;


bool is_camera(const Sensor& sensor) { return sensor.model->sight() == Sight::rays; }

/// Replaces a joint's readings, also those that a scanner has of it in its rays.
void change_readings(const Rig& rig, Samples& samples, int joint, const std::function<double(double)>& change) {
  for (Sample& s : samples) {
    s.readings[joint] = change(s.readings[joint]);
    for (View& v : s.views)
      if (rig.sensors[v.sensor].scanning_joint == joint)
        for (size_t i = 0; i + 2 < v.z.size(); i += 3) v.z[i] = change(v.z[i]);
  }
}

Matrix2d matrix(double a, double b, double c, double d) { return (Matrix2d() << a, b, c, d).finished(); }

/// What is there: which sensor sees which target, which joints matter and how they move.
struct Survey {
  std::set<std::pair<int, int>> pairs;  // (sensor, target) with a view
  std::set<int> sensors, targets;
  std::map<int, std::pair<double, double>> ranges;  // joint that some view needs: least and greatest reading
};

Survey survey(const Rig& rig, const Samples& samples) {
  Survey out;
  std::map<std::pair<int, int>, std::vector<int>> joints;
  for (const Sample& s : samples)
    for (const View& v : s.views) {
      const std::pair<int, int> pair(v.sensor, v.target);
      if (out.pairs.insert(pair).second) joints[pair] = joints_between(rig, v);
      out.sensors.insert(v.sensor);
      out.targets.insert(v.target);
      const auto add = [&](int joint, double reading) {
        const auto range = out.ranges.insert({joint, {reading, reading}}).first;
        range->second = {std::min(range->second.first, reading), std::max(range->second.second, reading)};
      };
      for (int joint : joints[pair]) {
        if (rig.sensors[v.sensor].scanning_joint != joint)
          add(joint, s.readings[joint]);
        else
          for (size_t i = 0; i + 2 < v.z.size(); i += 3) add(joint, v.z[i]);
      }
    }
  return out;
}

// ------------------------------------------------------------------------------------------------ targets
void add_squares(const Rig& rig, const ParameterTable& table, const Survey& there, const FreedNames& freed, std::vector<Hypothesis>& out) {
  std::vector<std::vector<int>> groups;
  for (int t : there.targets) {
    const Target& target = rig.targets[t];
    const int own = target.grid ? table.target_square[t] : table.target_points[t];
    const bool seen = std::any_of(there.pairs.begin(), there.pairs.end(),
                                  [&](const auto& pair) { return pair.second == t && !rig.sensors[pair.first].model->whole_pose(); });
    if (own >= 0 && !freed.parameter[own] && target.count() >= 2 && seen) groups.push_back({t});
  }
  if (groups.size() > 1) {  // all in the same wrong unit; many placements of one block: only so
    std::vector<int> all;
    for (const auto& g : groups) all.push_back(g[0]);
    if (groups.size() > 3) groups.clear();
    groups.push_back(all);
  }
  for (const std::vector<int>& group : groups)
    for (double factor : {1.0, 0.001, 1000.0, 0.01, 100.0}) {
      Hypothesis h;
      h.id = "square";
      for (int t : group) h.where.push_back(rig.targets[t].name);
      h.squares = group;
      h.undo = [group, factor](Rig& r, Samples&) {
        for (int t : group) {
          Target& wrong = r.targets[t];
          if (!wrong.grid) wrong.layout = wrong.points, wrong.grid = true, wrong.square = 1;
          wrong.square *= factor;
        }
      };
      out.push_back(h);
    }
}

/// Layouts of a regular grid (of single points, or of tags of four) with rows and columns exchanged: the same points numbered row by row of
/// the other shape, and column by column.
std::vector<Eigen::Matrix3Xd> exchanged_layouts(const Target& target) {
  const Eigen::Matrix3Xd& old = target.layout;
  const int block = target.type == "apriltag_grid" ? 4 : 1, n = static_cast<int>(old.cols()) / block;
  int columns = 1;
  while (columns < n && std::abs(old(1, columns * block) - old(1, 0)) < 1e-9) ++columns;
  const int rows = columns ? n / columns : 0;
  if (rows < 2 || columns < 2 || rows * columns != n) return {};
  const bool asymmetric = std::abs(old(0, columns * block) - old(0, 0)) > 1e-9;
  const double pitch = old(1, columns * block) - old(1, 0);
  std::vector<Eigen::Matrix3Xd> out;
  for (bool by_column : {false, true}) {
    if (!by_column && rows == columns) continue;
    if (by_column && asymmetric) continue;
    Eigen::Matrix3Xd layout = old;
    for (int i = 0; i < n; ++i) {
      const int r = by_column ? i % rows : i / rows, c = by_column ? i / rows : i % rows;
      const Vector3d corner = old.col(0) + Vector3d(asymmetric ? 2 * c + r % 2 : pitch * c, pitch * r, 0);
      for (int k = 0; k < block; ++k) layout.col(i * block + k) = corner + Vector3d(old.col(k) - old.col(0));
    }
    out.push_back(layout);
  }
  return out;
}

void add_boards(const Rig& rig, const Survey& there, std::vector<Hypothesis>& out) {
  struct Relabeling {
    const char* id;
    Matrix2d m;
    std::string what, cure;
  };
  const std::string renumber = "Number the points of these views from the corner where the rig has point 0: row by row, x along the row.";
  const std::vector<Relabeling> relabelings = {
      {"numbering", matrix(-1, 0, 0, -1), "from the opposite corner (half a turn)", renumber},
      {"numbering", matrix(0, -1, 1, 0), "from a neighbouring corner (a quarter turn)", renumber},
      {"numbering", matrix(0, 1, -1, 0), "from the other neighbouring corner (a quarter turn)", renumber},
      {"mirrored", matrix(-1, 0, 0, 1), "mirrored: each row backwards", "Reverse the order of the points within each row of these views."},
      {"mirrored", matrix(1, 0, 0, -1), "mirrored: the last row first", "Reverse the order of the rows of points in these views."}};
  const auto add = [&](const Relabeling& r, const std::vector<std::string>& where, const std::string& whose,
                       const std::map<int, std::vector<int>>& places, int sensor) {
    Hypothesis h;
    h.id = r.id;
    h.where = where;
    h.what = whose + " " + r.what;
    h.cure = r.cure;
    h.marked = true;
    for (const auto& p : places)  // markers tell which point is which
      if (rig.targets[p.first].type != "charuco" && rig.targets[p.first].type != "apriltag_grid") h.marked = false;
    h.undo = [places, sensor](Rig& changed, Samples& samples) {
      for (Sample& sample : samples)
        for (View& v : sample.views)
          if (places.count(v.target) && (sensor < 0 || v.sensor == sensor) && !changed.sensors[v.sensor].model->whole_pose())
            relabel(v, changed.targets[v.target], places.at(v.target));
    };
    out.push_back(std::move(h));
  };
  std::map<int, std::set<int>> seen, seers;  // grids by sensor, and the other way round
  for (const auto& pair : there.pairs)
    if (rig.targets[pair.second].grid && !rig.sensors[pair.first].model->whole_pose())
      seen[pair.first].insert(pair.second), seers[pair.second].insert(pair.first);
  for (const auto& t : seers) {
    const Target& target = rig.targets[t.first];
    const auto layouts = exchanged_layouts(target);
    for (size_t i = 0; i < layouts.size(); ++i) {
      Hypothesis h;
      h.id = "rows-columns";
      h.where = {target.name};
      h.what = "rows and columns of target " + quoted(target.name) + " are exchanged: its points are numbered " +
               (i + 1 == layouts.size() && layouts.size() > 1 ? "column by column" : "in rows of another length");
      h.cure = "Exchange targets." + target.name + ".rows and .columns in the rig, or number the points row by row.";
      h.undo = [target_index = t.first, layout = layouts[i]](Rig& r, Samples&) { r.targets[target_index].layout = layout; };
      out.push_back(h);
    }
    for (const Relabeling& r : relabelings) {
      const std::vector<int> places = relabeling(target, r.m);
      if (!places.empty()) add(r, {target.name}, "the points of target " + quoted(target.name) + " are numbered", {{t.first, places}}, -1);
    }
  }
  for (const auto& s : seen)
    for (const Relabeling& r : relabelings) {
      std::map<int, std::vector<int>> places;
      for (int t : s.second)
        if (std::vector<int> found = relabeling(rig.targets[t], r.m); !found.empty()) places[t] = std::move(found);
      const bool same = places.size() == 1 && seers[places.begin()->first].size() == 1;  // as all views of that target
      if (places.empty() || same) continue;
      std::vector<std::string> where = {rig.sensors[s.first].name};
      for (const auto& p : places) where.push_back(rig.targets[p.first].name);
      add(r, where, "sensor " + quoted(rig.sensors[s.first].name) + " numbers the points of what it sees", places, s.first);
      if (places.size() > 1 && &r == &relabelings.front())  // one of them only: what detectors do with boards of even symmetry
        for (const auto& p : places)
          add(r, {rig.sensors[s.first].name, rig.targets[p.first].name},
              "sensor " + quoted(rig.sensors[s.first].name) + " numbers the points of target " + quoted(rig.targets[p.first].name), {p},
              s.first);
    }
}

// ------------------------------------------------------------------------------------------------ sensors
void add_mirrors(const Rig& rig, const Survey& there, std::vector<Hypothesis>& out) {
  for (int s : there.sensors) {
    const Sensor& sensor = rig.sensors[s];
    const Sight sight = sensor.model->sight();
    if (sight == Sight::rays) {
      const std::vector<double>& k = sensor.parameters.front().values;
      if (k.size() < 4) continue;
      for (int axis : {0, 1}) {
        const int size = axis == 0 ? sensor.image_width : sensor.image_height;
        const double sum = size > 0 ? size - 1 : 2 * k[2 + axis];
        Hypothesis h;
        h.id = "mirrored";
        h.where = {sensor.name};
        h.what = "the images of camera " + quoted(sensor.name) + " are mirrored " + (axis == 0 ? "left to right" : "top to bottom");
        h.cure = std::string("Detect in the image as the camera gave it, or replace ") +
                 (axis == 0 ? "u by width - 1 - u" : "v by height - 1 - v") + " in its views.";
        h.undo = [s, axis, sum](Rig&, Samples& samples) {
          for (Sample& sample : samples)
            for (View& v : sample.views)
              if (v.sensor == s)
                for (size_t i = axis; i < v.z.size(); i += 2) v.z[i] = sum - v.z[i];
        };
        out.push_back(h);
      }
    } else if (sight == Sight::points) {
      const auto somewhere = [](const View& v) { return std::any_of(v.z.begin(), v.z.end(), [](double z) { return z != 0; }); };
      for (int axis : {0, 1, 2}) {
        Hypothesis h;
        h.id = "mirrored";
        h.where = {sensor.name};
        h.what =
            "the points that sensor " + quoted(sensor.name) + " measures are mirrored: its axes are left-handed, or one has the wrong sign";
        h.cure =
            std::string("Change the sign of ") + "xyz"[axis] + " (or of another one, and turn the sensor's pose accordingly) in its views.";
        h.undo = [s, axis, somewhere](Rig&, Samples& samples) {
          for (Sample& sample : samples)
            for (View& v : sample.views)
              if (v.sensor == s && somewhere(v))
                for (size_t i = axis; i < v.z.size(); i += 3) v.z[i] = -v.z[i];
        };
        out.push_back(h);
      }
    }
  }
}

/// Logs in millimetres.
void add_units(const Rig& rig, const Survey& there, std::vector<Hypothesis>& out) {
  for (int s : there.sensors) {
    const Sensor& sensor = rig.sensors[s];
    const bool pose = sensor.model->sight() == Sight::pose;
    if (!pose && sensor.model->sight() != Sight::points) continue;
    Hypothesis h;
    h.id = "square";
    h.where = {sensor.name};
    h.what = std::string(pose ? "the positions" : "the points") + " that sensor " + quoted(sensor.name) + " measures are in millimetres";
    h.cure = "Write metres into its views: divide by 1000.";
    h.new_poses = true;
    h.undo = [s, pose](Rig&, Samples& samples) {
      for (Sample& sample : samples)
        for (View& v : sample.views)
          if (v.sensor == s)
            for (size_t i = 0; i < (pose ? 3 : v.z.size()); ++i) v.z[i] *= 0.001;
    };
    out.push_back(h);
  }
}

/// Points that are no grid and not in a plane: their mirror image is another target.
void add_mirrored_points(const Rig& rig, const Survey& there, std::vector<Hypothesis>& out) {
  for (int t : there.targets) {
    const Target& target = rig.targets[t];
    if (target.grid || target.count() < 4) continue;
    const Eigen::Matrix3Xd centred = target.points.colwise() - Vector3d(target.points.rowwise().mean());
    const Vector3d extents = symmetric_eigenvalues(centred * centred.transpose());
    if (extents(0) < 1e-6 * extents(2)) continue;
    for (int axis : {0, 1, 2}) {
      Hypothesis h;
      h.id = "mirrored";
      h.where = {target.name};
      h.what =
          "the points of target " + quoted(target.name) + " are mirrored in the rig: its axes are left-handed, or one has the wrong sign";
      h.cure = std::string("Change the sign of ") + "xyz"[axis] +
               " (or of another one, and turn the target's pose accordingly) in targets." + target.name + ".points.";
      h.undo = [t, axis](Rig& r, Samples&) { r.targets[t].points.row(axis) *= -1; };
      out.push_back(h);
    }
  }
}

void add_poses(const Rig& rig, const Survey& there, std::vector<Hypothesis>& out) {
  for (int s : there.sensors) {
    const Sensor& sensor = rig.sensors[s];
    if (!sensor.pose_given || log_se3(sensor.link_T_sensor).norm() < 1e-6) continue;
    Hypothesis h;
    h.id = "inverted-pose";
    h.where = {sensor.name};
    h.what = "the pose of sensor " + quoted(sensor.name) + " is given the wrong way round, as sensor_T_link";
    h.cure = "Replace sensors." + sensor.name + ".pose by its inverse: it maps coordinates of the sensor" +
             (sensor.model->sight() == Sight::chain ? "'s target" : "") + " to the link's.";
    h.undo = [s](Rig& r, Samples&) { r.sensors[s].link_T_sensor = inverse(r.sensors[s].link_T_sensor); };
    out.push_back(h);
  }
  for (int t : there.targets) {
    const Target& target = rig.targets[t];
    if (target.link < 0 || !target.pose_given || log_se3(target.link_T_target).norm() < 1e-6) continue;
    Hypothesis h;
    h.id = "inverted-pose";
    h.where = {target.name};
    h.what = "the pose of target " + quoted(target.name) + " is given the wrong way round, as target_T_link";
    h.cure = "Replace targets." + target.name + ".mount.pose by its inverse: it maps coordinates of the target to the link's.";
    h.undo = [t](Rig& r, Samples&) { r.targets[t].link_T_target = inverse(r.targets[t].link_T_target); };
    out.push_back(h);
  }
}

void add_sides(const Rig& rig, const Survey& there, std::vector<Hypothesis>& out) {
  for (const auto& pair : there.pairs) {
    const int s = pair.first, t = pair.second;
    const Sensor& sensor = rig.sensors[s];
    const Target& target = rig.targets[t];
    if (sensor.model->sight() == Sight::chain || sensor.model->scans()) continue;
    if (target.link >= 0) {
      if (target.link == sensor.link) continue;
      for (bool poses : {false, true}) {
        Hypothesis h;
        h.id = "eye-in-hand";
        h.where = {sensor.name, target.name};
        h.what = "sensor " + quoted(sensor.name) + " and target " + quoted(target.name) +
                 " are on the wrong sides: the sensor sits on link " + quoted(rig.tree.links[target.link]) + " and the target on " +
                 quoted(rig.tree.links[sensor.link]);
        h.cure = "Exchange sensors." + sensor.name + ".link and targets." + target.name + ".mount.link" + (poses ? ", poses too." : ".");
        h.undo = [s, t, poses](Rig& r, Samples&) {
          std::swap(r.sensors[s].link, r.targets[t].link);
          if (poses) std::swap(r.sensors[s].link_T_sensor, r.targets[t].link_T_target);
        };
        h.new_poses = true;
        out.push_back(h);
      }
      continue;
    }
    for (const auto& other : there.pairs) {  // a free target in a hand
      if (other.second != t || rig.sensors[other.first].model->sight() != Sight::chain || rig.sensors[other.first].link == sensor.link)
        continue;
      const int c = other.first;
      Hypothesis h;
      h.id = "eye-in-hand";
      h.where = {sensor.name, rig.sensors[c].name};
      h.what = "sensor " + quoted(sensor.name) + " and the hand " + quoted(rig.sensors[c].name) + " are on the wrong sides";
      h.cure = "Exchange sensors." + sensor.name + ".link and sensors." + rig.sensors[c].name + ".link, poses too.";
      h.undo = [s, c](Rig& r, Samples&) {
        std::swap(r.sensors[s].link, r.sensors[c].link);
        std::swap(r.sensors[s].link_T_sensor, r.sensors[c].link_T_sensor);
      };
      h.new_poses = true;
      out.push_back(h);
    }
  }
}

void add_exchanges(const Rig& rig, const Survey& there, std::vector<Hypothesis>& out) {
  for (int a : there.sensors)
    for (int b : there.sensors) {
      if (a >= b || !is_camera(rig.sensors[a]) || !is_camera(rig.sensors[b])) continue;
      Hypothesis h;
      h.id = "swapped-cameras";
      h.where = {rig.sensors[a].name, rig.sensors[b].name};
      h.what = "cameras " + quoted(rig.sensors[a].name) + " and " + quoted(rig.sensors[b].name) + " are exchanged";
      h.cure = "Exchange the two names, in the rig or in the views.";
      h.undo = [a, b](Rig&, Samples& samples) {
        for (Sample& s : samples)
          for (View& v : s.views)
            if (v.sensor == a || v.sensor == b) v.sensor = a + b - v.sensor;
      };
      out.push_back(h);
    }
}

void add_lenses(const Rig& rig, const ParameterTable& table, const Survey& there, const FreedNames& freed, std::vector<Hypothesis>& out) {
  std::map<std::pair<bool, int>, std::vector<int>> on_link;  // (distorts, link): cameras
  std::map<bool, std::vector<int>> all;
  for (int s : there.sensors) {
    const Sensor& sensor = rig.sensors[s];
    if (sensor.type != "camera" || sensor.parameters.size() < 2) continue;
    const bool has = sensor.parameters.size() == 3;
    if (has && freed.parameter[table.sensor_block[s] + 1]) continue;
    const std::vector<double> lens = has ? sensor.parameters[1].values : std::vector<double>();
    const bool distorts = std::any_of(lens.begin(), lens.end(), [](double k) { return k != 0; });
    on_link[{distorts, sensor.link}].push_back(s);
    all[distorts].push_back(s);
  }
  std::set<std::pair<bool, std::vector<int>>> groups;  // each alone, those of one link, all
  for (const auto& g : on_link) groups.insert({g.first.first, g.second});
  for (const auto& g : all) {
    groups.insert(g);
    for (int s : g.second) groups.insert({g.first, {s}});
  }
  for (const auto& group : groups) {
    Hypothesis h;
    h.id = "rectified";
    std::string names;
    for (int s : group.second) {
      h.where.push_back(rig.sensors[s].name);
      names += (names.empty() ? "" : ", ") + quoted(rig.sensors[s].name);
      if (!group.first) h.free.push_back("sensor/" + rig.sensors[s].name + "/distortion");
    }
    if (group.first) {
      h.what = "the rig corrects the lens of camera " + names + ", but the images are rectified already";
      h.cure = "Take model: pinhole without distortion (and the intrinsics of the rectified image), or detect in the raw images.";
    } else {
      h.what = "the images of camera " + names + " are raw, but the rig gives no distortion";
      h.cure =
          "Take a model with distortion (brown_conrady, or kannala_brandt for a fisheye) and free sensor/NAME/distortion, or detect in "
          "rectified images.";
    }
    h.undo = [group](Rig& r, Samples&) {
      for (int s : group.second) {
        const std::vector<double> intrinsics = r.sensors[s].parameters.front().values;
        const double baseline = r.sensors[s].parameters.back().values[0];
        const std::vector<double> lens(group.first ? 0 : 5, 0.0);
        r.sensors[s].model = make_camera(group.first ? Lens::pinhole : Lens::brown_conrady, static_cast<int>(lens.size()));
        r.sensors[s].parameters = camera_parameters(group.first ? Lens::pinhole : Lens::brown_conrady, intrinsics, lens, baseline);
      }
    };
    out.push_back(h);
  }
}

// ------------------------------------------------------------------------------------------------ joints
void add_joints(const Rig& rig, const Samples& samples, const Survey& there, std::vector<Hypothesis>& out) {
  std::vector<int> too_far;
  for (const auto& range : there.ranges) {
    const int j = range.first;
    const Joint& joint = rig.tree.joints[j];
    const double low = range.second.first, high = range.second.second;
    if (high - low > 1e-9) {
      Hypothesis h;
      h.id = "joint-sign";
      h.where = {joint.name};
      h.what = "joint " + quoted(joint.name) + " turns the other way: its readings, or its axis in the URDF, have the wrong sign";
      if (joint.type == JointType::prismatic)
        h.what = "joint " + quoted(joint.name) + " moves the other way: its readings, or its axis in the URDF, have the wrong sign";
      h.cure = "Change the sign of its readings, or of its <axis> in the URDF.";
      h.undo = [j](Rig& r, Samples& s) { change_readings(r, s, j, [](double q) { return -q; }); };
      out.push_back(h);
    } else if (samples.size() > 1) {
      Hypothesis h;
      h.id = "still-joint";
      h.where = {joint.name};
      h.what = "joint " + quoted(joint.name) + " has the same reading in all samples, but it moved";
      h.cure = "Record its readings: what was logged is a constant.";
      h.excused = j;
      h.undo = [](Rig&, Samples&) {};
      out.push_back(h);
    }
    if (joint.type == JointType::prismatic) continue;
    const double most = std::max(std::abs(low), std::abs(high));
    const bool limited = joint.type == JointType::revolute && joint.upper > joint.lower;
    const double reach = limited ? std::max(std::abs(joint.lower), std::abs(joint.upper)) : 2 * M_PI;
    if (most > 2 * M_PI + 0.1 || most > reach + 1) too_far.push_back(j);
  }
  if (too_far.empty()) return;
  std::vector<int> turning;
  for (const auto& range : there.ranges)
    if (rig.tree.joints[range.first].type != JointType::prismatic) turning.push_back(range.first);
  std::vector<std::vector<int>> groups = {turning};
  if (too_far.size() < turning.size()) groups.push_back(too_far);
  if (too_far.size() > 1)
    for (int j : too_far) groups.push_back({j});
  for (const std::vector<int>& group : groups) {
    Hypothesis h;
    h.id = "degrees";
    for (int j : group) h.where.push_back(rig.tree.joints[j].name);
    std::string names;
    for (const std::string& name : h.where) names += (names.empty() ? "" : ", ") + quoted(name);
    h.what = std::string("the readings of joint") + (group.size() > 1 ? "s " : " ") + names + " are degrees";
    h.cure = "Write radians: multiply them by pi / 180.";
    h.undo = [group](Rig& r, Samples& s) {
      for (int j : group) change_readings(r, s, j, [](double q) { return q * M_PI / 180; });
    };
    out.push_back(h);
  }
}

void add_bearings(const Rig& rig, const Samples& samples, const Survey& there, std::vector<Hypothesis>& out) {
  for (int s : there.sensors) {
    const Sensor& sensor = rig.sensors[s];
    if (!sensor.model->scans()) continue;
    double most = 0;
    for (const Sample& sample : samples)
      for (const View& v : sample.views)
        if (v.sensor == s)
          for (size_t i = 1; i < v.z.size(); i += 3) most = std::max(most, std::abs(v.z[i]));
    const auto bearings = [s](double factor) {
      return [s, factor](Rig&, Samples& all) {
        for (Sample& sample : all)
          for (View& v : sample.views)
            if (v.sensor == s)
              for (size_t i = 1; i < v.z.size(); i += 3) v.z[i] *= factor;
      };
    };
    Hypothesis h;
    h.where = {sensor.name};
    if (most > M_PI + 0.1) {
      h.id = "degrees";
      h.what = "the bearings of sensor " + quoted(sensor.name) + " are degrees";
      h.cure = "Write radians: multiply them by pi / 180.";
      h.undo = bearings(M_PI / 180);
    } else {
      h.id = "mirrored";
      h.what = "the rays of sensor " + quoted(sensor.name) + " are mirrored: their bearings have the wrong sign";
      h.cure = "Change the sign of its bearings: they count from x towards y.";
      h.undo = bearings(-1);
    }
    out.push_back(h);
  }
}

}  // namespace

std::vector<int> relabeling(const Target& target, const Matrix2d& m) {
  const Eigen::Matrix3Xd& layout = target.layout;
  if (!target.grid || layout.cols() < 3) return {};
  const Eigen::Vector2d centre = layout.topRows<2>().rowwise().mean();
  std::vector<int> out;
  for (Eigen::Index i = 0; i < layout.cols(); ++i) {
    const Eigen::Vector2d at = centre + m * (layout.col(i).head<2>() - centre);
    Eigen::Index place = 0;
    if ((layout.topRows<2>().colwise() - at).colwise().norm().minCoeff(&place) > 1e-6) return {};
    out.push_back(static_cast<int>(place));
  }
  return out;
}

void relabel(View& view, const Target& target, const std::vector<int>& places) {
  if (view.ids.empty())
    for (int i = 0; i < target.count(); ++i) view.ids.push_back(i);
  for (int& id : view.ids) id = places[id];
}

std::vector<Hypothesis> hypotheses(const Rig& rig, const ParameterTable& table, const Samples& samples, const FreedNames& freed) {
  const Survey there = survey(rig, samples);
  std::vector<Hypothesis> out;
  add_joints(rig, samples, there, out);
  add_bearings(rig, samples, there, out);
  add_squares(rig, table, there, freed, out);
  add_boards(rig, there, out);
  add_mirrors(rig, there, out);
  add_mirrored_points(rig, there, out);
  add_units(rig, there, out);
  add_poses(rig, there, out);
  add_sides(rig, there, out);
  add_exchanges(rig, there, out);
  add_lenses(rig, table, there, freed, out);
  return out;
}

}  // namespace kincal
