#include "measured.h"

#include <algorithm>
#include <filesystem>

#include "../document/error.h"
#include "../document/names.h"
#include "../results/json_values.h"
#include "read_table.h"

namespace kincal {
namespace {

/// The named one of sensors or targets, or the only one. @throws InputError
template <class Thing>
const Thing& only(const std::vector<Thing>& all, const std::string& name, const char* option) {
  std::vector<std::string> names;
  for (const Thing& one : all) {
    if (one.name == name || (name.empty() && all.size() == 1)) return one;
    names.push_back(one.name);
  }
  throw InputError(std::string(option) +
                   (name.empty()
                        ? " is missing: name the one of the rig that this table describes"
                        : ": there is no '" + name + "' in the rig" + nearest_names(name, names)) +
                   "; valid: " + comma_separated(names));
}

bool has_flange(const Rig& rig) {
  return std::any_of(rig.tree.joints.begin(), rig.tree.joints.end(), [](const Joint& joint) {
    return joint.type == JointType::floating && joint.name == "flange";
  });
}

std::vector<int> point_columns(const Table& table) {
  std::vector<int> out;
  for (const char* name : {"x", "y", "z"}) {
    out.push_back(column_of(table, name));
    if (out.back() < 0)
      throw InputError(table.where +
                       ": a `point` sensor needs the columns x, y and z (--map COLUMN=x where one "
                       "is called differently); there are " +
                       comma_separated(table.header));
  }
  return out;
}

/// The first columns of a pose that a header has, beginning with `prefix`; of a robot with a flange
/// the measured pose has something in front.
std::vector<FlangePose> measured_poses(const Table& table, const MeasuredWords& words,
                                       bool beside_flange) {
  std::vector<std::string> names;
  for (const PoseFormat& format : pose_formats()) {
    names.push_back(format.name);
    if (!words.measured.format.empty() && words.measured.format != format.name) continue;
    std::string prefix;
    if (beside_flange) {
      for (const std::string& name : table.header)
        if (prefix.empty() && !pose_columns(table, format, lower_case(name.substr(0, 1))).empty())
          prefix = lower_case(name.substr(0, 1));
      if (prefix.empty()) continue;
    }
    const std::vector<int> columns = pose_columns(table, format, prefix);
    if (columns.empty()) continue;
    if (words.measured.format.empty() && format.turn == PoseFormat::Turn::angles) break;
    return poses_of_columns(table, format, pose_unit(words.measured.unit), columns);
  }
  if (!words.measured.format.empty()) pose_format(words.measured.format);  // names the valid ones
  throw InputError(table.where + ": a `pose` sensor needs the columns of a pose" +
                   (beside_flange ? ", with a letter in front (mx, my, ...)" : "") +
                   ", in one of the formats (--target-format): " + comma_separated(names) +
                   "; there are " + comma_separated(table.header));
}

struct Measured {
  const Sensor* sensor;
  std::vector<int> point;                          // columns
  std::vector<FlangePose> poses;                   // of the rows
  int image = -1, id = -1, time = -1, which = -1;  // columns
  double length = 1;
};

Json view_of(const Measured& m, const TableRow& row, size_t i, const std::string& target) {
  Json view = {{"sensor", m.sensor->name}, {"target", target}};
  if (m.sensor->type == "camera") {
    view["image"] = row.cells[static_cast<size_t>(m.image)];
  } else if (m.sensor->type == "pose") {
    view["pose"] = pose(m.poses[i].pose);
  } else {
    if (m.which >= 0) {
      const double which = number_of(row, m.which, "point");
      if (which < 0 || which > 1e6 || which != static_cast<int>(which))
        throw InputError(row.where + ": point: the index of a point of target '" + target +
                         "' is expected, from 0");
      view["ids"] = Json::array({static_cast<int>(which)});
    }
    Json point = Json::array();
    for (size_t k = 0; k < m.point.size(); ++k)
      point.push_back(m.length * number_of(row, m.point[k], std::string(1, "xyz"[k])));
    view["points"] = Json::array({point});
  }
  return view;
}

/// Looks up the columns of a sensor's measurements. @throws InputError
Measured measured_columns(const Table& table, const Rig& rig, const MeasuredWords& words,
                          bool beside_flange) {
  Measured m;
  m.sensor = &only(rig.sensors, words.sensor, "--sensor");
  m.image = column_of(table, "image") >= 0 ? column_of(table, "image") : column_of(table, "file");
  m.id = column_of(table, "id");
  m.time = column_of(table, "time");
  m.which = column_of(table, "point");
  if (const double unit = pose_unit(words.measured.unit); unit > 0) m.length = unit;
  const std::string& type = m.sensor->type;
  if (type == "point")
    m.point = point_columns(table);
  else if (type == "pose")
    m.poses = measured_poses(table, words, beside_flange);
  else if (type != "camera" || m.image < 0)
    throw InputError(
        table.where + ": sensor '" + m.sensor->name + "' is of the type " + type +
        (type == "camera"
             ? ": a column `image` is expected (`kincal detect` then finds the points in the "
               "images)"
             : ", whose measurements cannot be given in a table; valid: point, pose, and "
               "camera with a column `image`"));
  return m;
}

}  // namespace

std::string measured_lines(const std::string& path, const Rig& rig, const MeasuredWords& words,
                           std::vector<std::string>& notes) {
  Table table = read_table(path);
  rename_columns(table, words.joints.names, joints_with_readings(rig));
  if (table.header.empty())
    throw InputError(table.where +
                     ": a header is expected with the names of the joints and of the measured "
                     "columns (x, y, z; or image; or the columns of a pose)");
  const std::string target = only(rig.targets, words.target, "--target").name;
  const bool flange = has_flange(rig);
  const Measured m = measured_columns(table, rig, words, flange);
  const std::vector<std::string> joints = joints_of_columns(table, rig, words.joints, notes);
  const bool none = std::all_of(joints.begin(), joints.end(),
                                [](const std::string& name) { return name.empty(); });
  if (none && !flange && !joints_with_readings(rig).empty())
    throw InputError(table.where + ": no column is a joint with a reading; the robot has: " +
                     comma_separated(joints_with_readings(rig)) +
                     " (--map COLUMN=JOINT where a column is called differently)");
  std::vector<FlangePose> flange_poses;
  if (flange)
    flange_poses = poses_of(table, format_of_file(table, words.flange, "--pose-format"),
                            pose_unit(words.flange.unit));
  JointWords units = words.joints;
  units.length = m.length;
  std::string out;
  for (size_t i = 0; i < table.rows.size(); ++i) {
    const TableRow& row = table.rows[i];
    Json line;
    line["id"] = m.id >= 0      ? row.cells[m.id]
                 : m.image >= 0 ? std::filesystem::path(row.cells[m.image]).stem().string()
                                : "row_" + std::to_string(i + 1);
    if (m.time >= 0) line["time"] = number_of(row, m.time, "time");
    line["joints"] = Json::object();
    for (const auto& [joint, value] : readings_of(row, joints, rig, units))
      line["joints"][joint] = value;
    if (flange) line["joints"]["flange"] = pose(flange_poses[i].pose);
    line["views"] = Json::array({view_of(m, row, i, target)});
    out += line.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  }
  return out;
}

}  // namespace kincal
