// `kincal compensate`: readings for a robot with errors that a URDF cannot express.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <optional>

#include "../../io/document/error.h"
#include "../../io/document/files.h"
#include "../../io/document/json.h"
#include "../../io/document/names.h"
#include "../../io/document/numbers.h"
#include "../../io/exchange/compensation_texts.h"
#include "../../io/exchange/joint_table.h"
#include "../../io/exchange/poses.h"
#include "../../io/rig/conditions_entry.h"
#include "../../io/rig/rig_file.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/numbers.h"
#include "../../models/rig/random_stream.h"
#include "../../models/rig/words.h"
#include "../job.h"
#include "../signals.h"
#include "command.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

struct CompensateArguments {
  std::string result, postures, tip, from, out, header, module, data, pose_format, unit;
  std::string payload;
  std::optional<double> temperature;
  bool position = false, force = false;
};

std::vector<std::string> names_of(const std::vector<Frame>& frames) {
  std::vector<std::string> out;
  for (const Frame& f : frames) out.push_back(f.name);
  return out;
}

/// The reference frame of poses: as asked, else the only sensor or target that stands still, else
/// the base link.
Frame seen_from(const RigFile& file, const ParameterTable& table, const std::string& asked) {
  const Rig& rig = file.rig;
  const Frame base = {rig.tree.links[rig.base], rig.base, -1};
  const std::vector<Frame> still = still_frames(rig, table);
  std::vector<std::string> valid = names_of(still);
  valid.push_back(base.name);
  if (asked.empty() && still.size() > 1)
    throw InputError(
        "--from is required: the reference frame of the tip's pose, because two calibrations may "
        "place the base link differently; one of " +
        comma_separated(valid));
  if (asked.empty()) return still.empty() ? base : still[0];
  if (asked == base.name) return base;
  for (const Frame& frame : still)
    if (frame.name == asked) return frame;
  throw InputError("--from: '" + asked + "' does not stand still; one of " +
                   comma_separated(valid) + " is expected");
}

/// A robot as a rig file has it, and the frames that are meant.
RobotTip robot_tip(const RigFile& file, const ParameterTable& table, const CompensateArguments& a) {
  const std::optional<Frame> tip = find_frame(file.rig, table, a.tip);
  const Frame from = seen_from(file, table, a.from);
  Conditions conditions;
  conditions.temperature = a.temperature;
  if (!a.payload.empty()) conditions.payload = find_payload(file.rig, a.payload, "--payload");
  if (tip) return {{&file.rig, &table, table.initial, {}}, *tip, from, conditions};
  throw InputError("--tip: there is no frame '" + a.tip + "'; one of " +
                   comma_separated(names_of(all_frames(file.rig, table))) + " is expected");
}

/// Postures of the rigid robot with those of the real one, and the joints that were asked for.
struct Planned {
  struct Row {
    std::string where;
    Readings readings;
    Pose wanted;
    Compensated found;
  };
  std::vector<Row> rows;
  std::vector<int> columns;
};

/// Reads a table of readings.
Planned planned_readings(const CompensateArguments& a, const RobotTip& real,
                         const RobotTip& planned) {
  const Rig& rig = *planned.robot.rig;
  const JointTable table = read_joint_table(a.postures, rig, {});
  for (const std::string& note : table.notes) std::cerr << "kincal: note: " << note << "\n";
  Planned out;
  for (size_t j = 0; j < rig.tree.joints.size(); ++j)
    if (!table.rows.empty() && table.rows[0].joints.count(rig.tree.joints[j].name))
      out.columns.push_back(static_cast<int>(j));
  for (const JointRow& row : table.rows) {
    Readings readings(rig.tree.joints.size(), kNan);
    for (const auto& [name, value] : row.joints) readings[rig.tree.find_joint(name)] = value;
    for (const int j : joints_between(rig, rig.base, planned.tip.link))
      if (std::isnan(readings[j]))
        throw InputError(row.where + ": there is no reading of joint '" + rig.tree.joints[j].name +
                         "', which moves '" + planned.tip.name + "'");
    readings = completed(std::move(readings));
    out.rows.push_back({row.where, readings, planned.at(readings),
                        compensate(real, planned, readings, a.position)});
  }
  return out;
}

/// Reads a table of poses. Of several postures that reach a pose: one near that of the row before.
Planned planned_poses(const CompensateArguments& a, const RobotTip& real, const RobotTip& planned) {
  constexpr int kStarts = 100;
  const Rig& rig = *real.robot.rig;
  Planned out;
  out.columns = joints_between(rig, rig.base, real.tip.link);
  if (out.columns.empty()) throw std::invalid_argument("no joint moves '" + real.tip.name + "'");
  RandomStream random(1);
  Readings start = completed(Readings(rig.tree.joints.size(), kNan));
  for (const FlangePose& row :
       read_flange_poses(a.postures, pose_format(a.pose_format), pose_unit(a.unit))) {
    std::optional<Readings> found;
    for (int trial = 0; trial < kStarts && !found; ++trial) {
      for (const int j : out.columns) {
        const auto [low, high] = usual_range(rig.tree.joints[j]);
        if (trial == 1) start[j] = (low + high) / 2;
        if (trial > 1) start[j] = random.uniform(low, high);
      }
      found = reach_pose(real, row.pose, start, a.position);
    }
    if (!found)
      throw InputError(
          row.where + ": no posture within the joints' limits was found in which '" +
          planned.tip.name + "' stands at this pose relative to '" + planned.from.name + "'" +
          (a.position || out.columns.size() >= 6 ? ""
                                                 : "; with fewer than six joints use --position"));
    start = *found;
    out.rows.push_back({row.where, compensate(planned, row.pose, start, a.position).readings,
                        row.pose, compensate(real, row.pose, start, a.position)});
  }
  return out;
}

/// The rows with the readings that reach the planned poses, as text, and a summary.
struct CompensatedTable {
  std::string text, summary;
};

CompensatedTable compensated_table(const Planned& all, const RobotTip& real, bool position,
                                   bool json) {
  const Rig& rig = *real.robot.rig;
  const std::vector<int> needed = joints_between(rig, rig.base, real.tip.link);
  const std::vector<int>& columns = all.columns;
  CompensatedTable out;
  double largest = 0, off = 0, most_off = 0, left = 0, left_turn = 0;
  int of = -1;
  if (!json)
    for (const int j : columns) out.text += (out.text.empty() ? "" : ",") + rig.tree.joints[j].name;
  if (!json) out.text += "\n";
  for (const Planned::Row& row : all.rows) {
    const Readings& readings = row.readings;
    const Compensated& found = row.found;
    if (!std::isfinite(found.position))
      throw InputError(row.where + ": the robot has no equilibrium in this posture");
    const double error = (real.at(readings).translation - row.wanted.translation).norm();
    off += error * error;
    most_off = std::max(most_off, error);
    left = std::max(left, found.position);
    left_turn = std::max(left_turn, found.rotation);
    for (const int j : needed)
      if (const double change = std::abs(found.readings[j] - readings[j]); change > largest) {
        largest = change;
        of = j;
      }
    std::string line;
    for (const int j : columns)
      line += std::string(line.empty() ? ""
                          : json       ? ", "
                                       : ",") +
              (json ? json_string(rig.tree.joints[j].name) + ": " : "") +
              shortest(found.readings[j]);
    out.text += (json ? "{\"joints\": {" + line + "}}" : line) + "\n";
  }
  if (all.rows.empty()) return out;
  out.summary = text(
      "%zu postures: without this the tip is off by %.3g mm (rms), at most %.3g mm; ",
      all.rows.size(), 1e3 * std::sqrt(off / static_cast<double>(all.rows.size())), 1e3 * most_off);
  if (of >= 0) {
    const bool slides = rig.tree.joints[of].type == JointType::prismatic;
    out.summary +=
        text("readings change by at most %.3g %s (", 1e3 * largest, slides ? "mm" : "mrad") +
        rig.tree.joints[of].name + "); ";
  }
  out.summary +=
      text("left: %.2g mm", 1e3 * left) + (position ? "" : text(", %.2g mrad", 1e3 * left_turn));
  return out;
}

int compensate_postures(const CompensateArguments& a) {
  const std::vector<std::string> outputs = {a.out, a.header, a.module, a.data};
  if (a.pose_format.empty() && !a.unit.empty())
    throw InputError("--unit requires --pose-format: readings are in rad and m");
  if (a.postures.empty() && a.header.empty() && a.module.empty() && a.data.empty())
    throw InputError("compensate: nothing to do: give POSTURES, --c-header, --python or --json");
  for (const std::string& output : outputs)
    if (!output.empty()) {
      say_cleared(clear_leftovers(output));
      check_output_file(output, a.force);
    }
  const std::string rig = rig_path(a.result);
  const fs::path rigid = fs::path(rig).parent_path() / "rig_rigid.yaml";
  const RigFile real_file = read_rig(rig);
  std::error_code ignored;
  if (!fs::exists(rigid, ignored))
    throw InputError(
        a.result +
        ": nothing to compensate: there is no rig_rigid.yaml, which `calibrate` writes only if "
        "joints have errors that a URDF cannot express; robot.urdf has the whole calibration");
  const RigFile planned_file = read_rig(rigid.string());
  const ParameterTable real_table(real_file.rig), planned_table(planned_file.rig);
  const RobotTip real = robot_tip(real_file, real_table, a),
                 planned = robot_tip(planned_file, planned_table, a);
  if (!a.postures.empty() && !a.temperature && real_table.has(ParameterKind::temperature))
    throw InputError("--temperature is required: joints of this robot depend on it");
  std::vector<std::pair<std::string, std::string>> files;
  try {
    if (!a.header.empty() || !a.module.empty() || !a.data.empty()) {
      const Compensation data = make_compensation(real, planned);
      if (!a.header.empty()) files.emplace_back(a.header, compensation_header(data));
      if (!a.module.empty()) files.emplace_back(a.module, compensation_module(data));
      if (!a.data.empty()) files.emplace_back(a.data, compensation_json(data));
    }
    if (!a.postures.empty()) {
      const bool json = fs::path(a.out.empty() ? a.postures : a.out).extension() == ".jsonl";
      const Planned rows = a.pose_format.empty() ? planned_readings(a, real, planned)
                                                 : planned_poses(a, real, planned);
      const CompensatedTable found = compensated_table(rows, real, a.position, json);
      std::cerr << found.summary << "\n";
      if (a.out.empty())
        std::cout << found.text;
      else
        files.emplace_back(a.out, found.text);
    }
  } catch (const std::invalid_argument& e) {
    throw InputError(a.result + ": " + e.what());
  }
  begin_writing();
  for (const auto& [path, text] : files) {
    write_file(path, text, a.force);
    std::cerr << "Written to " << path << "\n";
  }
  return kConverged;
}

}  // namespace

Command compensate_command(CLI::App& app) {
  auto a = std::make_shared<CompensateArguments>();
  CLI::App* command = app.add_subcommand(
      "compensate", "Correct planned readings for errors that a URDF cannot express");
  command
      ->add_option("RESULT", a->result,
                   "result directory of a robot with errors that a URDF cannot express")
      ->required();
  command->add_option("POSTURES", a->postures,
                      "readings planned with robot.urdf: a table (CSV with a header of joint "
                      "names; rad, m) or JSON lines {\"joints\": {...}}; or, with "
                      "--pose-format, poses of the tip");
  command
      ->add_option("--tip", a->tip,
                   "the frame that must reach its planned pose: a link, sensor/NAME or target/NAME")
      ->required()
      ->type_name("FRAME");
  command
      ->add_option("--from", a->from,
                   "reference frame of that pose: a sensor/NAME or target/NAME that stands still, "
                   "or the base link; default: the only one that stands still")
      ->type_name("FRAME");
  command
      ->add_option("--pose-format", a->pose_format,
                   "POSTURES is a table of poses of the tip relative to --from, in a convention of "
                   "`kincal import`, for example xyzw, kuka, fanuc, abb, rotvec")
      ->type_name("FORMAT");
  command->add_option("--unit", a->unit,
                      "unit of their lengths, m or mm, if it differs from the format's");
  command
      ->add_option("--temperature", a->temperature,
                   "of the robot, degrees Celsius; required if joints depend on it")
      ->type_name("CELSIUS");
  command
      ->add_option("--payload", a->payload,
                   "that the robot carries, of the rig's `payloads`; default: none")
      ->type_name("NAME");
  command->add_flag("--position", a->position, "ignore the orientation of the tip");
  command->add_option("--out", a->out,
                      "file for the readings (.jsonl: JSON lines; else a table); "
                      "default: standard output, as POSTURES");
  command->add_option(
      "--c-header", a->header,
      "write a C99 header with forward kinematics and compensation, without heap use");
  command->add_option("--python", a->module,
                      "write a Python module with the same functions (numpy)");
  command->add_option("--json", a->data, "write the data of both: compensation.json");
  command->add_flag("--force", a->force, "replace existing files");
  command->footer(
      "A URDF cannot express joints that bend under weight, nor error curves of encoders and "
      "gears. Plan with robot.urdf of the result and\n"
      "send the readings that this command computes from the plan: the tip then is where "
      "robot.urdf places it. A robot with fewer than six joints\n"
      "comes as near as it can (1 rad counts as 1 m; --position: position only). For a pose, the "
      "posture found is near that of the row before.\n"
      "Exit codes: 0 done; 1 bad input, nothing written.");
  return {command, [a] { return compensate_postures(*a); }};
}

}  // namespace kincal
