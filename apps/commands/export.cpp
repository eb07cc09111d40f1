// `kincal export`: a calibrated rig in the files of other programs.
#include <iostream>

#include "../../io/document/error.h"
#include "../../io/document/files.h"
#include "../../io/document/names.h"
#include "../../io/exchange/exports.h"
#include "../../io/results/read_calibrated.h"
#include "../job.h"
#include "../signals.h"
#include "command.h"

namespace kincal {
namespace {

struct ExportArguments {
  std::string result, out;
  ExportOptions options;
  bool force = false;
};

int export_result(const ExportArguments& a) {
  if (!a.out.empty()) {
    say_cleared(clear_leftovers(a.out));
    check_output_file(a.out, a.force);
  }
  const CalibratedFiles files = read_calibrated(a.result, true);
  const std::string status = files.status.empty() ? files.lens_status : files.status;
  if (!status.empty() && status != "converged" && !a.force)
    throw InputError(a.result + ": its status is '" + status + "', not 'converged'" +
                     (files.doubts.empty() ? "" : ": " + files.doubts[0]) +
                     "; --force exports it all the same");
  for (const std::string& doubt : files.doubts)
    std::cerr << "kincal: warning: " << a.result << ": " << doubt << "\n";
  const ExportedFile exported = export_calibrated(files, a.options);
  for (const std::string& note : exported.notes) std::cerr << "kincal: warning: " << note << "\n";
  if (a.out.empty()) {
    std::cout << exported.text;
    return kConverged;
  }
  begin_writing();
  write_file(a.out, exported.text, a.force);
  std::cout << "Written to " << a.out << "\n";
  return kConverged;
}

}  // namespace

Command export_command(CLI::App& app) {
  auto a = std::make_shared<ExportArguments>();
  CLI::App* command = app.add_subcommand(
      "export",
      "Write a result for other programs: ROS, URDF, OpenCV, Kalibr, easy_handeye, LeRobot");
  command->add_option("RESULT", a->result, "result directory, its result.json, or a rig.yaml")
      ->required();
  command->add_option("--as", a->options.format, "one of " + comma_separated(export_formats()))
      ->required()
      ->type_name("FORMAT");
  command
      ->add_option("--sensor", a->options.sensors,
                   "repeatable: the sensors to write; default: all, which camera_info, opencv, "
                   "easy_handeye and easy_handeye2 take only if it is one")
      ->allow_extra_args(false)
      ->type_name("NAME");
  command
      ->add_option(
          "--child", a->options.child,
          "of static_transforms, urdf, xacro and poses: the frame of the sensor's driver that is "
          "to be placed, as camera_link")
      ->type_name("LINK");
  command
      ->add_option("--known", a->options.known,
                   "where the sensor's frame is in that link, as its driver publishes it: \"x y z "
                   "roll pitch yaw\" or \"x y z qx qy qz qw\" (m, rad), or a link of the robot; "
                   "default: the sensor's link, where it hangs on LINK")
      ->type_name("POSE");
  command
      ->add_option("--pose-format", a->options.pose_format,
                   "of poses: a convention of `kincal import`, as kuka, fanuc, abb, rotvec, xyzw")
      ->type_name("FORMAT");
  command
      ->add_option(
          "--tip", a->options.tip,
          "of dh and modified_dh: the link at the end of the chain that begins at the base")
      ->type_name("LINK");
  command
      ->add_option("--from", a->options.from,
                   "of lerobot: its calibration file, which gets other homing offsets; of "
                   "ur_kinematics: the robot's own file, whose hash is kept")
      ->type_name("FILE");
  command
      ->add_option("--prefix", a->options.prefix,
                   "of ur_kinematics, where the robot has several arms: what stands before "
                   "shoulder_pan_joint")
      ->type_name("TEXT");
  command
      ->add_option("--motors", a->options.motors,
                   "of lerobot: feetech (default) or dynamixel, whose homing offsets count the "
                   "other way")
      ->type_name("MAKE");
  command->add_option("--out", a->out, "file to write; default: standard output");
  command->add_flag("--force", a->force,
                    "replace an existing file; export a result that is not converged");
  command->footer(
      "Formats:\n"
      "  camera_info         ROS 1 and 2: K, D, R, P of one camera, as camera_info_manager reads "
      "it\n"
      "  opencv              OpenCV's FileStorage (YAML): camera_matrix, distortion_coefficients\n"
      "  kalibr              camchain.yaml: all cameras, with T_cn_cnm1\n"
      "  static_transforms   a line for a shell for every sensor and mounted target\n"
      "  urdf, xacro         the same as links and joints; with --child that of a driver's frame\n"
      "  easy_handeye, easy_handeye2   their calibration file (.yaml; .calib), eye on hand or on "
      "base\n"
      "  poses               the same as a table, in a controller's convention (--pose-format)\n"
      "  xacro_properties    origins of the joints: JOINT_xyz, JOINT_rpy\n"
      "  ros2_control        transmissions with the joints' offsets\n"
      "  ur_kinematics       kinematics of ur_description, for a robot of Universal Robots\n"
      "  lerobot             LeRobot's calibration of motors (JSON): other homing offsets\n"
      "  dh, modified_dh     a table of Denavit and Hartenberg, and what it cannot express\n"
      "Examples:\n"
      "  kincal export result --as camera_info --sensor camera --out camera.yaml\n"
      "  kincal export result --as static_transforms > transforms.sh\n"
      "  kincal export result --as xacro --child camera_link --known \"0 0.0175 0 -1.5708 0 "
      "-1.5708\"\n"
      "`kincal import` reads such files. Exit codes: 0 written; 1 bad input or usage, nothing "
      "written.");
  return {command, [a] { return export_result(*a); }};
}

}  // namespace kincal
