// `kincal init`: a first rig.yaml.
#include <filesystem>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/document/yaml.h"
#include "../../io/rig/new_rig.h"
#include "../../io/rig/rig_file.h"
#include "../job.h"
#include "../signals.h"
#include "../tables/tree_table.h"
#include "command.h"

namespace kincal {
namespace {

struct InitArguments {
  std::string urdf, flange, out;
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

int init(const InitArguments& a) {
  if (!a.out.empty()) {
    say_cleared(clear_leftovers(a.out));
    check_output_file(a.out, a.force);
  }
  if (a.urdf.empty() == a.flange.empty())
    throw InputError(a.urdf.empty()
                         ? "a URDF is expected, or --flange LINK for a robot that is known by "
                           "the poses of its flange only"
                         : "--flange: for a robot without URDF; of one with a URDF name its links");
  const Urdf urdf = a.flange.empty() ? read_urdf(a.urdf) : robot_of_flange(a.flange);
  for (const std::string& warning : urdf.warnings)
    std::fprintf(stderr, "kincal: warning: %s\n", warning.c_str());
  if (a.sensors.empty() && a.targets.empty() && a.out.empty()) {
    std::cout << tree_table(urdf.tree) << "\nSay what looks at what, and the first rig.yaml is "
              << "written:\n--sensor " << sensor_form() << "\n--target " << kTargetForm << "\n";
    return kConverged;
  }
  NewRig rig;
  rig.robot = a.urdf;
  if (!a.out.empty() && a.flange.empty()) {  // as seen from the rig's folder
    const std::filesystem::path folder = std::filesystem::absolute(a.out).parent_path();
    rig.robot = std::filesystem::absolute(a.urdf)
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
  write_file(a.out, text, a.force);
  read_rig(a.out);
  std::cout << "Written to " << a.out << ": look for GUESS in it\n";
  return kConverged;
}

}  // namespace

Command init_command(CLI::App& app) {
  auto a = std::make_shared<InitArguments>();
  CLI::App* command = app.add_subcommand("init", "Write a first, commented rig.yaml for a robot");
  command->add_option("URDF", a->urdf, "the robot");
  command
      ->add_option("--flange", a->flange,
                   "in place of a URDF: the robot is known by the poses of this link in the base "
                   "only; [BASE:]LINK")
      ->type_name("LINK");
  command->add_option("--sensor", a->sensors, sensor_form() + "; may be repeated")
      ->allow_extra_args(false)
      ->type_name("SENSOR");
  command->add_option("--target", a->targets, std::string(kTargetForm) + "; may be repeated")
      ->allow_extra_args(false)
      ->type_name("TARGET");
  command
      ->add_option(
          "--intrinsics", a->intrinsics,
          "FX,FY,CX,CY of the cameras in px; once for all, or once for each in their order")
      ->allow_extra_args(false)
      ->type_name("NUMBERS");
  command
      ->add_option("--image-size", a->image_sizes,
                   "WIDTHxHEIGHT of the cameras in px, likewise; without --intrinsics a guess is "
                   "made from it and marked")
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
      "Without a URDF, from poses of the flange (a target without @LINK is mounted where the "
      "camera "
      "is not):\n"
      "  kincal init --flange tool0 --sensor camera:tool0:cam --image-size 1280x960 --target "
      "chessboard:8x11:0.015:board --out rig.yaml\n"
      "Without --sensor, --target and --out only the robot's links and joints are shown.\n"
      "The rig has no steps: `kincal calibrate rig.yaml samples.jsonl --out result` "
      "frees all that could be wrong.");
  return {command, [a] { return init(*a); }};
}

}  // namespace kincal
