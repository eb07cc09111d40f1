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
                     "; --force exports it anyway");
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
      "Export a result for other programs: ROS, URDF, OpenCV, Kalibr, easy_handeye, LeRobot");
  command->add_option("RESULT", a->result, "result directory, its result.json, or a rig.yaml")
      ->required();
  command->add_option("--as", a->options.format, "one of " + comma_separated(export_formats()))
      ->required()
      ->type_name("FORMAT");
  command
      ->add_option("--sensor", a->options.sensors,
                   "a sensor to write; may be repeated; default: all (camera_info, opencv, "
                   "easy_handeye and easy_handeye2 take only one)")
      ->allow_extra_args(false)
      ->type_name("NAME");
  command
      ->add_option("--child", a->options.child,
                   "static_transforms, urdf, xacro, poses: the frame of the sensor's driver that "
                   "is placed, for example camera_link")
      ->type_name("LINK");
  command
      ->add_option("--known", a->options.known,
                   "pose of the sensor's frame in that link, as its driver publishes it: \"x y z "
                   "roll pitch yaw\" or \"x y z qx qy qz qw\" (m, rad), or a link of the robot; "
                   "default: the sensor's link if it is below LINK")
      ->type_name("POSE");
  command
      ->add_option(
          "--pose-format", a->options.pose_format,
          "poses: a convention of `kincal import`, for example kuka, fanuc, abb, rotvec, xyzw")
      ->type_name("FORMAT");
  command
      ->add_option("--tip", a->options.tip,
                   "dh, modified_dh: the last link of the chain that begins at the base")
      ->type_name("LINK");
  command
      ->add_option("--from", a->options.from,
                   "lerobot: its calibration file, whose homing offsets are replaced; "
                   "ur_kinematics: the robot's own file, whose hash is kept")
      ->type_name("FILE");
  command
      ->add_option("--prefix", a->options.prefix,
                   "ur_kinematics of a robot with several arms: the text before shoulder_pan_joint")
      ->type_name("TEXT");
  command
      ->add_option(
          "--motors", a->options.motors,
          "lerobot: feetech (default) or dynamixel (homing offsets with the opposite sign)")
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
      "  static_transforms   a shell command for every sensor and mounted target\n"
      "  urdf, xacro         the same as links and joints; with --child for a driver's frame\n"
      "  easy_handeye, easy_handeye2   their calibration file (.yaml; .calib), eye on hand or on "
      "base\n"
      "  poses               the same as a table, in a controller's convention (--pose-format)\n"
      "  xacro_properties    origins of the joints: JOINT_xyz, JOINT_rpy\n"
      "  ros2_control        transmissions with the joint offsets\n"
      "  ur_kinematics       kinematics file of ur_description, for Universal Robots\n"
      "  lerobot             LeRobot's motor calibration (JSON) with new homing offsets\n"
      "  dh, modified_dh     a Denavit-Hartenberg table, and the remainder it cannot express\n"
      "Examples:\n"
      "  kincal export result --as camera_info --sensor camera --out camera.yaml\n"
      "  kincal export result --as static_transforms > transforms.sh\n"
      "  kincal export result --as xacro --child camera_link --known \"0 0.0175 0 -1.5708 0 "
      "-1.5708\"\n`kincal import` reads such files. Exit codes: 0 written; 1 bad input or usage, "
      "nothing "
      "written.");
  return {command, [a] { return export_result(*a); }};
}

}  // namespace kincal
