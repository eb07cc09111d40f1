// `kincal init`: a first rig.yaml.
#include <filesystem>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/document/yaml.h"
#include "../../io/exchange/dh.h"
#include "../../io/exchange/ur_kinematics.h"
#include "../../io/rig/new_rig.h"
#include "../../io/rig/rig_file.h"
#include "../../io/urdf/edit.h"
#include "../job.h"
#include "../signals.h"
#include "../tables/tree_table.h"
#include "command.h"

namespace kincal {
namespace {

struct InitArguments {
  std::string urdf, flange, out;
  std::string kinematics, prefix, dh, modified_dh;  // robots that are made of other files
  std::vector<std::string> sensors, targets, intrinsics, image_sizes;
  bool force = false;
};

/// Numbers with `separator` between.
std::vector<double> numbers(const std::string& option, std::string text, char separator,
                            int count) {
  for (char& c : text)
    if (c == separator) c = ',';
  const Node node = parse_yaml("[" + text + "]", option);
  return Field{&node, &option, text}.vector(count);
}

/// "LINK" or "BASE:LINK".
Urdf robot_of_flange(const std::string& text) {
  const size_t colon = text.find(':');
  try {
    return colon == std::string::npos
               ? flange_robot("base", text, "--flange")
               : flange_robot(text.substr(0, colon), text.substr(colon + 1), "--flange");
  } catch (const std::invalid_argument& e) {
    throw InputError("--flange " + text + ": " + e.what());
  }
}

/// The robot, and its file: `text` is to be written there where it is new.
struct FirstRobot {
  Urdf urdf;
  std::string path, text;
};

/// Where a robot that is made of another file stands: beside the rig.
std::string beside_rig(const InitArguments& a, const std::string& file, const std::string& end) {
  const std::filesystem::path out(a.out.empty() ? "rig.yaml" : a.out);
  return (out.parent_path() / (std::filesystem::path(file).stem().string() + end)).string();
}

FirstRobot first_robot(const InitArguments& a) {
  const int given = !a.urdf.empty() + !a.flange.empty() + !a.dh.empty() + !a.modified_dh.empty();
  if (given != 1)
    throw InputError(
        given == 0 ? "a URDF is expected, or --flange LINK for a robot that reports only the poses "
                     "of its flange, or a Denavit-Hartenberg table (--dh, --modified-dh)"
                   : "exactly one robot is expected: a URDF, --flange (for a robot without URDF; "
                     "with a URDF use its link names instead), --dh or --modified-dh");
  if (!a.kinematics.empty() && a.urdf.empty())
    throw InputError("--kinematics needs the URDF whose joint origins it replaces");
  if (a.kinematics.empty() && !a.prefix.empty()) throw InputError("--prefix needs --kinematics");
  FirstRobot out;
  if (!a.flange.empty()) {
    out.urdf = robot_of_flange(a.flange);
  } else if (!a.urdf.empty() && a.kinematics.empty()) {
    out.urdf = read_urdf(out.path = a.urdf);
  } else {
    if (a.kinematics.empty()) {
      const std::string file = a.dh.empty() ? a.modified_dh : a.dh;
      out.path = beside_rig(a, file, ".urdf");
      out.text = dh_urdf(read_dh(file, a.dh.empty()), std::filesystem::path(file).stem().string());
    } else {
      const Urdf nominal = read_urdf(a.urdf);
      const UrKinematics kinematics = read_ur_kinematics(a.kinematics);
      const std::vector<int> joints = ur_joints(nominal.tree, a.prefix);
      UrdfChanges changes;
      for (size_t i = 0; i < joints.size(); ++i) changes.origins[joints[i]] = kinematics.origins[i];
      out.path = beside_rig(a, a.urdf, "_kinematics.urdf");
      out.text = edit_urdf(nominal, changes);
    }
    out.urdf = parse_urdf(out.text, out.path);
  }
  return out;
}

int init(const InitArguments& a) {
  if (!a.out.empty()) {
    say_cleared(clear_leftovers(a.out));
    check_output_file(a.out, a.force);
  }
  const FirstRobot robot = first_robot(a);
  const Urdf& urdf = robot.urdf;
  for (const std::string& warning : urdf.warnings)
    std::fprintf(stderr, "kincal: warning: %s\n", warning.c_str());
  if (a.sensors.empty() && a.targets.empty() && a.out.empty()) {
    std::cout << tree_table(urdf.tree) << "\nGive sensors and targets, and the first rig.yaml is "
              << "written:\n--sensor " << sensor_form() << "\n--target " << kTargetForm << "\n";
    return kConverged;
  }
  if (!robot.text.empty() && a.out.empty())
    throw InputError("--out is required: the robot is written beside the rig");
  if (!robot.text.empty()) check_output_file(robot.path, a.force);
  NewRig rig;
  rig.robot = robot.path;
  if (!a.out.empty() && a.flange.empty()) {  // as seen from the rig's folder
    const std::filesystem::path folder = std::filesystem::absolute(a.out).parent_path();
    rig.robot = std::filesystem::absolute(robot.path)
                    .lexically_normal()
                    .lexically_proximate(folder.lexically_normal())
                    .string();
  }
  for (const std::string& text : a.sensors)
    rig.sensors.push_back(parse_new_sensor(text, urdf.tree));
  for (const std::string& text : a.targets)
    rig.targets.push_back(parse_new_target(text, urdf.tree));
  for (const std::string& text : a.intrinsics) {
    rig.intrinsics.push_back(numbers("--intrinsics", text, ',', 4));
    if (!(rig.intrinsics.back()[0] > 0 && rig.intrinsics.back()[1] > 0))
      throw InputError("--intrinsics " + text +
                       ": FX,FY,CX,CY is expected, fx and fy greater than 0");
  }
  for (const std::string& text : a.image_sizes) {
    const std::vector<double> size = numbers("--image-size", text, 'x', 2);
    for (double v : size)
      if (!(v >= 1 && v <= 1e6) || v != static_cast<int>(v))
        throw InputError("--image-size " + text + ": WIDTHxHEIGHT in px is expected");
    rig.image_sizes.push_back({static_cast<int>(size[0]), static_cast<int>(size[1])});
  }
  const std::string text = new_rig_text(urdf, rig);
  if (a.out.empty()) {
    std::cout << text;
    return kConverged;
  }
  begin_writing();
  if (!robot.text.empty()) write_file(robot.path, robot.text, a.force);
  write_file(a.out, text, a.force);
  read_rig(a.out);
  if (!robot.text.empty()) std::cout << "Written to " << robot.path << ": the robot\n";
  std::cout << "Written to " << a.out
            << (text.find("GUESS") == std::string::npos ? "\n" : ": look for GUESS in it\n");
  return kConverged;
}

}  // namespace

Command init_command(CLI::App& app) {
  auto a = std::make_shared<InitArguments>();
  CLI::App* command = app.add_subcommand("init", "Write a first, commented rig.yaml for a robot");
  command->add_option("URDF", a->urdf, "the robot");
  command
      ->add_option("--flange", a->flange,
                   "instead of a URDF: the robot reports only the poses of this link in the base; "
                   "[BASE:]LINK")
      ->type_name("LINK");
  command
      ->add_option("--kinematics", a->kinematics,
                   "for Universal Robots: the kinematics file of ur_calibration replaces the "
                   "URDF's values, in a copy beside the rig")
      ->type_name("FILE");
  command
      ->add_option("--prefix", a->prefix,
                   "with --kinematics and several arms: the text before shoulder_pan_joint")
      ->type_name("TEXT");
  command
      ->add_option("--dh", a->dh,
                   "instead of a URDF: a Denavit-Hartenberg table (CSV: a, alpha, d, theta_offset, "
                   "type; m, rad); a URDF is written beside the rig")
      ->type_name("FILE");
  command->add_option("--modified-dh", a->modified_dh, "the same for a modified table (Craig)")
      ->type_name("FILE");
  command->add_option("--sensor", a->sensors, sensor_form() + "; may be repeated")
      ->allow_extra_args(false)
      ->type_name("SENSOR");
  command->add_option("--target", a->targets, std::string(kTargetForm) + "; may be repeated")
      ->allow_extra_args(false)
      ->type_name("TARGET");
  command
      ->add_option("--intrinsics", a->intrinsics,
                   "FX,FY,CX,CY of the cameras in px; once for all cameras, or once per camera in "
                   "their order")
      ->allow_extra_args(false)
      ->type_name("NUMBERS");
  command
      ->add_option("--image-size", a->image_sizes,
                   "WIDTHxHEIGHT of the cameras in px, likewise; without --intrinsics the "
                   "intrinsics are guessed from it and marked")
      ->allow_extra_args(false)
      ->type_name("SIZE");
  command->add_option("--out", a->out, "file to write; default: standard output");
  command->add_flag("--force", a->force, "replace an existing file");
  command->footer(
      "Example:\n"
      "  kincal init robot.urdf --sensor camera:camera_optical_frame --image-size 640x480 --sensor "
      "point:base_link:tracker \\\n"
      "    --target chessboard:8x11:0.01@base_link --target points:0,0,0@flange:reflector --out "
      "rig.yaml\n"
      "Without a URDF, from poses of the flange (a target without @LINK is mounted on the side "
      "without the camera):\n"
      "  kincal init --flange tool0 --sensor camera:tool0:cam --image-size 1280x960 --target "
      "chessboard:8x11:0.015:board --out rig.yaml\n"
      "Without --sensor, --target and --out the command only shows the robot's links and joints.\n"
      "The rig has no steps: `kincal calibrate rig.yaml samples.jsonl --out result` then estimates "
      "every parameter that may be wrong.");
  return {command, [a] { return init(*a); }};
}

}  // namespace kincal
