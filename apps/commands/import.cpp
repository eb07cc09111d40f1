// `kincal import`: files of other programs as kincal's.
#include <algorithm>
#include <filesystem>
#include <iostream>

#include "../../io/document/error.h"
#include "../../io/document/files.h"
#include "../../io/document/names.h"
#include "../../io/exchange/atom.h"
#include "../../io/exchange/guess.h"
#include "../../io/exchange/kalibr_target.h"
#include "../../io/exchange/measured.h"
#include "../../io/exchange/read_lens.h"
#include "../../io/exchange/read_table.h"
#include "../../io/recordings/bag_files.h"
#include "../../io/recordings/record_command.h"
#include "../../io/rig/types.h"
#include "../bag_options.h"
#include "../job.h"
#include "../sibling.h"
#include "../signals.h"
#include "command.h"

namespace kincal {
namespace {

struct ImportArguments {
  std::vector<std::string> files;
  std::string file, rig, out, sensor, target;
  std::vector<std::string> target_poses, map;
  std::string pose_format, unit, target_format, target_unit, setup, angles;  // of tables
  LensChoice lens;
  SettlingArguments settling;
  std::vector<CLI::Option*> settling_options;
  bool force = false, list = false, quiet = false, record_command = false;
};

using Notes = std::vector<std::string>;

void print_notes(const Notes& notes) {
  for (const std::string& note : notes) std::cerr << "kincal: warning: " << note << "\n";
}

/// The rig's robot as seen from the folder of the rig that is written.
std::string robot_from(const ImportArguments& a, const RigFile& rig) {
  namespace fs = std::filesystem;
  const std::string robot = rig.node.find("robot")->text;
  const auto folder = [](const std::string& path) {
    return fs::absolute(path).parent_path().lexically_normal();
  };
  if (fs::path(robot).is_absolute() || folder(a.rig) == folder(a.out)) return robot;
  return (folder(a.rig) / robot).lexically_normal().lexically_proximate(folder(a.out)).string();
}

/// The entry that the file is about: the named one, or the only one that fits.
std::string entry_name(const std::string& given, const Names& names, const std::string& option) {
  if (given.empty() && names.size() == 1) return names[0];
  const std::string valid = "; valid: " + comma_separated(names);
  if (given.empty())
    throw InputError(
        option + " is required: the sensor or target of the rig that this file describes" + valid);
  for (const std::string& name : names)
    if (name == given) return given;
  throw InputError(option + ": there is no '" + given + "' in the rig" +
                   nearest_names(given, names) + valid);
}

/// Writes keys into the rig, or shows them where no rig is given.
int put_into_rig(const ImportArguments& a, const std::string& section, const std::string& name,
                 const RigFile& rig, const RigKeys& keys) {
  const EditedRig edited = edited_rig(rig, section, name, keys, robot_from(a, rig));
  if (!edited.comments_kept)
    std::cerr << "kincal: warning: " << a.rig << " is rewritten; its comments are lost\n";
  begin_writing();
  write_file(a.out, edited.text, a.force);
  read_rig(a.out);
  std::cout << "Written to " << a.out << ", " << section << "." << name << ":\n" << keys_text(keys);
  return kConverged;
}

int import_target(const ImportArguments& a) {
  Notes notes;
  const RigKeys keys = read_kalibr_target(a.file, notes);
  print_notes(notes);
  if (a.rig.empty()) {
    std::cout << keys_text(keys);
    return kConverged;
  }
  const RigFile rig = read_rig(a.rig);
  const std::string name = entry_name(a.target, names_of(rig.rig.targets), "--target");
  return put_into_rig(a, "targets", name, rig, keys);
}

int import_camera(const ImportArguments& a) {
  Notes notes;
  LensNumbers lens = read_lens(a.file, a.lens, notes);
  print_notes(notes);
  if (a.rig.empty()) {
    std::cout << keys_text(lens_keys(lens));
    return kConverged;
  }
  const RigFile rig = read_rig(a.rig);
  Names cameras;
  for (const Sensor* camera : cameras_of(rig.rig, {})) cameras.push_back(camera->name);
  const std::string name = entry_name(a.sensor, cameras, "--sensor");
  const LensNumbers old = lens_of(*cameras_of(rig.rig, {name})[0]);
  if (lens.width > 0 && old.width > 0 && (lens.width != old.width || lens.height != old.height))
    std::cerr << "kincal: warning: " << a.file << " is for images of " << lens.width << " x "
              << lens.height << ", the rig said " << old.width << " x " << old.height << "\n";
  const bool straight =
      std::all_of(lens.distortion.begin(), lens.distortion.end(), [](double k) { return k == 0; });
  if (old.model == "pinhole" && straight) {  // nothing to say of a lens that bends nothing
    lens.model = old.model;
    lens.distortion.clear();
  }
  return put_into_rig(a, "sensors", name, rig, lens_keys(lens));
}

/// A table of the flange's poses as samples, or as readings for `kincal detect`.
int import_poses(const ImportArguments& a) {
  if (a.sensor.empty() != a.target.empty())
    throw InputError(std::string(a.sensor.empty() ? "--sensor" : "--target") +
                     ": give both --sensor and --target, or neither");
  const std::vector<FlangePose> poses =
      read_flange_poses(a.file, pose_format(a.pose_format), pose_unit(a.unit));
  for (const FlangePose& one : poses)
    if (!a.sensor.empty() && one.image.empty())
      throw InputError(one.where +
                       ": no image: with --sensor and --target each row names the image to search "
                       "for the target; without them the rows are readings for `kincal detect RIG "
                       "IMAGES --joints`; other measured columns need --rig");
  std::vector<Pose> all;
  for (const FlangePose& one : poses) all.push_back(one.pose);
  if (const std::string doubt = doubt_of_unit(a.file, all); !doubt.empty())
    std::cerr << "kincal: warning: " << doubt << "\n";
  const std::string text = flange_lines(poses, a.sensor, a.target);
  if (a.out.empty()) {
    std::cout << text;
    return kConverged;
  }
  begin_writing();
  write_file(a.out, text, a.force);
  std::cout << "Written to " << a.out << ": " << poses.size() << " poses\n";
  return kConverged;
}

/// Whether the camera is on the flange. @throws InputError
bool camera_in_hand(const ImportArguments& a) {
  const Names hand = {"eye_in_hand", "eye_on_hand"},
              world = {"eye_to_hand", "eye_on_base", "eye_to_base"};
  const bool in_hand = std::count(hand.begin(), hand.end(), a.setup) > 0;
  if (!in_hand && !std::count(world.begin(), world.end(), a.setup))
    throw InputError(
        (a.setup.empty() ? "--setup is missing: these samples of hand-eye poses do not include the "
                           "position of the camera. Give "
                         : "--setup: '" + a.setup + "' is neither ") +
        std::string("--setup eye_in_hand (the camera is on the flange, the board stands still) or "
                    "--setup eye_to_hand (the camera stands beside the robot, the board is on the "
                    "flange), such as: kincal import ") +
        a.file + " --setup eye_in_hand --out " + (a.out.empty() ? "hand_eye" : a.out));
  return in_hand;
}

/// Pairs of poses as a folder with a rig and samples: of a hand-eye program's file, of one file
/// that has both, or of the flange's files and the measured ones.
int import_pairs(const ImportArguments& a, bool hand_eye) {
  const bool in_hand = camera_in_hand(a);
  if (a.out.empty())
    throw InputError(
        "--out is missing: the folder for rig.yaml and samples.jsonl, such as --out "
        "hand_eye");
  if (!a.rig.empty())
    throw InputError("--rig: pairs of poses get their own rig, in the folder --out");
  const PoseWords flange{a.pose_format, a.unit},
      measured{a.target_format.empty() && a.target_poses.empty() ? a.pose_format : a.target_format,
               a.target_unit.empty() && a.target_format.empty() ? a.unit : a.target_unit};
  std::vector<PosePair> pairs;
  Notes notes;
  std::string note;
  if (hand_eye) {
    pairs = read_hand_eye(a.file, in_hand);
  } else if (a.target_poses.empty()) {
    const std::vector<Table> tables = read_tables(a.file);
    if (a.files.size() > 1 || !has_pairs(tables))
      throw InputError(a.file + ": one pose in each row; the measured poses are expected in " +
                       "separate files: --target-poses FILE...");
    pairs = pairs_of(tables, flange, measured, note);
  } else {
    const PoseWords other =
        a.target_format.empty() ? PoseWords{a.pose_format, measured.unit} : measured;
    const std::vector<FlangePose> poses = read_poses(a.files, flange, "--pose-format");
    pairs = pair_poses(poses, read_poses(a.target_poses, other, "--target-format"), note);
  }
  if (!note.empty()) std::cerr << "kincal: note: " << note << "\n";
  std::vector<Pose> all;
  for (const PosePair& pair : pairs) {
    all.push_back(pair.base_T_flange);
    all.push_back(pair.sensor_T_target);
  }
  if (const std::string doubt = doubt_of_unit(a.file, all); !doubt.empty()) print_notes({doubt});
  const HandEyeFiles files = hand_eye_files(a.file, pairs, in_hand);
  begin_writing();
  write_directory(a.out, {{"rig.yaml", files.rig_yaml}, {"samples.jsonl", files.samples_jsonl}},
                  a.force, nullptr);
  std::cout << "Written to " << a.out << ": rig.yaml and " << pairs.size()
            << " samples; next: kincal calibrate " << a.out << "/rig.yaml " << a.out
            << "/samples.jsonl --out result\n";
  return kConverged;
}

/// A table of measurements, or a data set of ATOM, as samples of a rig.
int import_measured(const ImportArguments& a, bool atom) {
  const RigFile rig = read_rig(a.rig);
  Notes notes;
  const std::string text =
      atom ? atom_lines(a.file, rig.rig, notes)
           : measured_lines(a.file, rig.rig,
                            {a.sensor,
                             a.target,
                             {joint_names(a.map), angles_in_degrees(a.angles)},
                             {a.pose_format, a.unit},
                             {a.target_format, a.target_unit.empty() ? a.unit : a.target_unit}},
                            notes);
  for (const std::string& note : notes) std::cerr << "kincal: note: " << note << "\n";
  if (a.out.empty()) {
    std::cout << text;
    return kConverged;
  }
  begin_writing();
  write_file(a.out, text, a.force);
  std::cout << "Written to " << a.out << ": " << std::count(text.begin(), text.end(), '\n')
            << " samples\n";
  return kConverged;
}

/// Recordings are read by a program of its own, which has the libraries for that.
[[noreturn]] void import_bags(const ImportArguments& a, std::vector<std::string> arguments) {
  bool others = a.lens.rectified || a.lens.fisheye;
  for (const std::string* option : {&a.sensor, &a.target, &a.pose_format, &a.unit, &a.setup,
                                    &a.lens.camera, &a.angles, &a.target_format, &a.target_unit})
    others = others || !option->empty();
  others = others || !a.map.empty() || !a.target_poses.empty();
  if (others)
    throw InputError(*std::find_if(a.files.begin(), a.files.end(), is_bag) +
                     " is a recording: it takes only --rig, --out, --list, --force, --quiet and "
                     "the options for recordings");
  arguments.erase(arguments.begin() + 1, arguments.end());
  const auto give = [&](const std::string& option, const std::string& value) {
    if (!value.empty()) arguments.insert(arguments.end(), {option, value});
  };
  give("--rig", a.rig);
  give("--out", a.out);
  for (const auto& [option, given] :
       {std::pair{"--list", a.list}, {"--force", a.force}, {"--quiet", a.quiet}})
    if (given) arguments.push_back(option);
  for (const std::string& word : words_of(a.settling)) arguments.push_back(word);
  arguments.push_back("--");
  arguments.insert(arguments.end(), a.files.begin(), a.files.end());
  become(find_sibling(
             "kincal-bags", "`kincal import` of recordings",
             "where SQLite, lz4, zstd, bz2 and zlib are installed: apt-get install libsqlite3-dev "
             "liblz4-dev libzstd-dev libbz2-dev zlib1g-dev, then build kincal again (CMake "
             "option KINCAL_BAGS)"),
         arguments);
}

/// How to record what a rig needs.
int print_record_command(const ImportArguments& a) {
  if (a.files.size() > 1 || !a.rig.empty() || !a.out.empty())
    throw InputError("--record-command takes only a rig: kincal import --record-command " +
                     (a.rig.empty() ? a.files[0] : a.rig));
  const RecordCommand command = record_command(read_rig(rig_path(a.files[0])));
  print_notes(command.notes);
  std::cout << "# ROS 1\n" << command.ros1 << "\n# ROS 2\n" << command.ros2 << "\n";
  return kConverged;
}

/// Says of what is no recording why, where it looks as if it should be one. @throws InputError
void refuse_broken_bag(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code status;
  if (!fs::exists(path, status)) throw InputError(path + ": no such file or folder");
  if (fs::is_directory(path, status))
    throw InputError(path +
                     ": a folder without metadata.yaml, .mcap, .db3 or .bag is not a recording");
  const std::string ending = fs::path(path).extension().string();
  if (ending == ".bag" || ending == ".mcap" || ending == ".db3")
    throw InputError(path +
                     (fs::is_regular_file(path, status) && fs::file_size(path, status) == 0
                          ? ": the file is empty"
                          : ": neither a ROS 1 bag (#ROSBAG V2.0), nor MCAP, nor an SQLite file of "
                            "rosbag2"));
}

int import_file(ImportArguments a, const std::vector<std::string>& arguments) {
  if (a.record_command) return print_record_command(a);
  a.rig = rig_path(a.rig);
  if (std::any_of(a.files.begin(), a.files.end(), is_bag)) {
    if (!a.out.empty()) say_cleared(clear_leftovers(a.out));
    import_bags(a, arguments);
  }
  for (const std::string& file : a.files) refuse_broken_bag(file);
  a.file = a.files[0];
  if (a.list) throw InputError(a.file + ": --list is for recordings (bags)");
  for (const CLI::Option* option : a.settling_options)
    if (option->count() > 0)
      throw InputError(a.file + ": " + option->get_name() + " is for recordings (bags)");
  const bool alone = a.rig.empty() && a.out.empty() && a.setup.empty() && a.pose_format.empty() &&
                     a.target_poses.empty();
  if (alone && (a.files.size() > 1 || is_table(a.file))) {
    std::cout << guess_text(a.files);
    return kConverged;
  }
  if (a.files.size() > 1 && a.target_poses.empty())
    throw InputError(a.file +
                     ": several files that are not recordings must each contain one pose of the "
                     "flange, and the measured poses are needed too: --target-poses FILE...");
  if (!a.out.empty()) say_cleared(clear_leftovers(a.out));
  const bool hand_eye = a.pose_format.empty() && a.target_poses.empty() && is_hand_eye(a.file);
  if (hand_eye || !a.target_poses.empty() || !a.setup.empty()) {
    if (!a.out.empty()) check_output(a.out, a.force);
    return import_pairs(a, hand_eye);
  }
  const bool atom = is_atom(a.file);
  if (atom && a.rig.empty())
    throw InputError(a.file +
                     " is a data set of ATOM: a rig with the same names of sensors and "
                     "patterns is needed: --rig RIG");
  if (!a.rig.empty() && (atom || is_table(a.file))) {
    if (!a.out.empty()) check_output_file(a.out, a.force);
    return import_measured(a, atom);
  }
  if (!a.pose_format.empty()) {
    if (!a.out.empty()) check_output_file(a.out, a.force);
    return import_poses(a);
  }
  if (a.rig.empty() != a.out.empty())
    throw InputError(a.rig.empty() ? "--out also requires --rig RIG, the rig to change. Without "
                                     "both options the keys are printed"
                                   : "--out is required: the file for the changed rig; it may be "
                                     "the same as --rig, with --force");
  if (!a.out.empty()) check_output_file(a.out, a.force);
  if (!a.target.empty() || is_kalibr_target(a.file)) return import_target(a);
  return import_camera(a);
}

/// How each pose format has its numbers, a line each.
std::string format_lines() {
  std::string formats;
  for (const PoseFormat& format : pose_formats()) {
    std::string line = "\n  " + format.name;
    line.resize(14, ' ');
    for (const std::string& column : format.columns)
      if (format.columns.size() < 12) line += column + " ";
    line.resize(std::max<size_t>(line.size(), 36), ' ');
    formats += line + format.about;
  }
  return formats;
}

void add_table_options(CLI::App& command, ImportArguments& a) {
  command
      .add_option(
          "--pose-format", a.pose_format,
          "FILE is a table of flange poses in this format (see below); with --sensor and --target "
          "it becomes samples with images, without them readings for `kincal detect --joints`")
      ->type_name("FORMAT");
  command.add_option("--unit", a.unit,
                     "unit of lengths, m or mm, if it differs from the format's (see below)");
  command
      .add_option("--target-poses", a.target_poses,
                  "files of the poses of the board in the camera (or the reflector in the "
                  "tracker), one for each pose of the flange")
      ->type_name("FILE");
  command
      .add_option("--target-format", a.target_format,
                  "format of the measured poses, if it differs from --pose-format")
      ->type_name("FORMAT");
  command.add_option("--target-unit", a.target_unit, "unit of the measured poses: m or mm");
  command
      .add_option(
          "--map", a.map,
          "tables: a column whose name differs from its joint (or from x, y, z, image, time, id)")
      ->type_name("COLUMN=JOINT");
  command.add_option("--angles", a.angles, "tables: unit of joint readings, rad or deg");
  command
      .add_option("--setup", a.setup,
                  "samples of poses: eye_in_hand (the camera is on the flange) or eye_to_hand (the "
                  "camera is beside the robot)")
      ->type_name("WHERE");
}

}  // namespace

Command import_command(CLI::App& app, const std::vector<std::string>& arguments) {
  auto a = std::make_shared<ImportArguments>();
  CLI::App* command = app.add_subcommand(
      "import",
      "Read recordings and files of other programs: ROS, OpenCV, Kalibr, VINS, Basalt, mrcal, "
      "easy_handeye, MoveIt");
  command
      ->add_option("FILE", a->files,
                   "recordings (ROS 1 bags, MCAP, SQLite files and folders of rosbag2); or one of: "
                   "camera_info YAML or message or ost.txt (ROS), camera YAML or XML (OpenCV), "
                   "camchain or target YAML (Kalibr), cameras of VINS, Basalt, mrcal, MC-Calib and "
                   "rs-enumerate-devices, samples of poses (easy_handeye, MoveIt), a data set of "
                   "ATOM, flange poses or joint readings (tables, numpy arrays, matrices, lists in "
                   "YAML or JSON; without other options the command reports the format it detects)")
      ->required();
  command->add_option("--rig", a->rig,
                      "the rig that receives the values; without it they are printed");
  command
      ->add_option("--sensor", a->sensor, "the camera of the rig; optional if the rig has only one")
      ->type_name("NAME");
  command
      ->add_option(
          "--target", a->target,
          "the target of the rig, for a file of a target; optional if the rig has only one")
      ->type_name("NAME");
  command
      ->add_option(
          "--camera", a->lens.camera,
          "which camera of the file: cam0, cam1, ... (Kalibr, Basalt); 1 or 2 (M1, M2 of OpenCV)")
      ->type_name("NAME");
  command->add_flag(
      "--rectified", a->lens.rectified,
      "the images are rectified: use P of camera_info, with the baseline, instead of K and D");
  command->add_flag("--fisheye", a->lens.fisheye,
                    "four distortion coefficients are those of OpenCV's fisheye model");
  add_table_options(*command, *a);
  command->add_option(
      "--out", a->out,
      "file for the rig or the samples; for samples of poses a new folder for both");
  command->add_flag("--force", a->force, "replace an existing file");
  command->add_flag("--list", a->list, "recordings: show their contents and write nothing");
  command->add_flag("--quiet", a->quiet, "recordings: no progress");
  command->add_flag("--record-command", a->record_command,
                    "FILE is a rig: print the commands that record its topics, for ROS 1 and 2");
  a->settling_options = add_settling_options(*command, a->settling);
  command->footer(
      "Examples:\n"
      "  kincal import camera_info.yaml                                   prints the keys for "
      "rig.yaml\n"
      "  kincal import camera_info.yaml --rig rig.yaml --sensor camera --out new_rig.yaml\n"
      "  kincal import camchain.yaml --camera cam1 --rig rig.yaml --sensor right --out "
      "new_rig.yaml\n"
      "  kincal import april_6x6.yaml --rig rig.yaml --target board --out new_rig.yaml\n"
      "  kincal import poses.csv --pose-format kuka --sensor camera --target board --out "
      "samples.jsonl\n"
      "  kincal import poses.csv                                          reports the detected "
      "format\n"
      "  kincal import flange.csv --pose-format kuka --target-poses board.csv --target-format "
      "rotvec \\\n"
      "      --setup eye_in_hand --out hand_eye\n"
      "  kincal import log.csv --rig rig.yaml --sensor tracker --target ball --map A1=joint_1 "
      "--angles deg --out samples.jsonl\n"
      "  kincal import my_calibration.samples --setup eye_in_hand --out hand_eye\n"
      "  kincal import recording.bag --list                               topics, rates, gaps\n"
      "  kincal import recording.bag --rig rig.yaml --out samples.jsonl   one sample per rest\n"
      "Pose formats (the columns in this order, or as the header names them):" +
      format_lines() +
      "\nOnly these keys of the rig change; its other text and comments are kept. `kincal export` "
      "writes the same formats. Exit codes: 0 written;\n"
      "1 bad input or usage, nothing written.");
  return {command, [a, arguments] { return import_file(*a, arguments); }};
}

}  // namespace kincal
