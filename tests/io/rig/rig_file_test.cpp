// Rigs and samples: what is read, what is refused and with which words, and that what is written
// reads back as the same numbers. Proven for the grammar of rig.yaml and samples.jsonl and, where
// present, for the real data. Not proven: that the numbers are used rightly afterwards (tests of
// the models), and names of parameters (resolved there, too).
#include "../../../io/rig/rig_file.h"
#include "../../../io/document/json.h"
#include "../../../io/document/yaml.h"
#include "../../../io/rig/rig_text.h"
#include "../../../io/rig/samples_file.h"
#include "../../../kinematics/floating.h"
#include "../../../models/rig/parameters.h"
#include "../../../models/rig/recording.h"
#include "../../../models/rig/targets.h"
#include "../../fixtures/height_sensor.h"
#include "../../fixtures/quadratic_joint.h"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <locale>

namespace rig_file_test {

using namespace kincal;
using Catch::Matchers::Contains;
namespace fs = std::filesystem;

namespace {

const char* kRobot = R"(<robot name="test">
  <link name="base_link"/><link name="shoulder_link"/><link name="elbow_link"/><link name="hand_link"/><link name="tool0"/>
  <link name="finger_link"/><link name="finger2_link"/><link name="tilt_link"/><link name="cart_link"/>
  <joint name="shoulder_pan_joint" type="revolute"><parent link="base_link"/><child link="shoulder_link"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="elbow_flex_joint" type="revolute"><parent link="shoulder_link"/><child link="elbow_link"/><origin xyz="0.3 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="slide_joint" type="prismatic"><parent link="elbow_link"/><child link="hand_link"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="tool_joint" type="fixed"><parent link="hand_link"/><child link="tool0"/><origin xyz="0 0 0.1"/></joint>
  <joint name="finger_joint" type="revolute"><parent link="hand_link"/><child link="finger_link"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="finger2_joint" type="revolute"><parent link="hand_link"/><child link="finger2_link"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="finger_joint" multiplier="-1"/></joint>
  <joint name="tilt_joint" type="continuous"><parent link="base_link"/><child link="tilt_link"/><axis xyz="0 1 0"/></joint>
  <joint name="cart_joint" type="planar"><parent link="base_link"/><child link="cart_link"/></joint>
</robot>
)";

const char* kRig = R"(format: kincal/1
robot: robot.urdf
base: base_link
joints:
  "*_joint": {sigma: 0.001}
  elbow_flex_joint: {sigma: 0.002, offset: 0.01, scale: 1.5}
  "sl*": {sigma: 0.003}
targets:
  board:
    type: chessboard
    rows: 2
    columns: 3
    square: 0.05
    mount: free
  reflector:
    type: points
    points: [[0, 0, 0.125]]
    mount: {link: tool0, pose: {xyz: [0.1, 0.2, 0.3], rpy: [0.1, 0.2, 0.3]}}
  coded:
    type: charuco
    rows: 3
    columns: 4
    square: 0.03
    marker: 0.02
    dictionary: DICT_4X4_50
    mount: {link: finger2_link}
  dots:
    type: circles
    rows: 3
    columns: 2
    spacing: 0.02
    asymmetric: true
    mount: free
  tags:
    type: apriltag_grid
    rows: 2
    columns: 2
    tag: 0.08
    spacing: 0.25
    family: t36h11
    mount: free
sensors:
  wide_left:
    type: camera
    link: base_link
    pose: {xyz: [0, 0, 1], rpy: [-1.5, 0, 0.25]}
    model: brown_conrady
    image_size: [640, 480]
    intrinsics: [320.5, 321.5, 319.5, 239.5]
    distortion: [0.1, 0.01, 0, 0, 0]
    baseline: 0.09
    sigma: 0.125
  plain:
    type: camera
    link: tool0
    model: pinhole
    intrinsics: [320, 320, 320, 240]
    sigma: 0.25
  fish:
    type: camera
    link: base_link
    model: kannala_brandt
    intrinsics: [320, 320, 320, 240]
    sigma: 1
  laser:
    type: tilting_laser
    joint: tilt_joint
    link: tilt_link
    sigma: {joint: 0.0005, bearing: 0.001, range: 0.005}
  arm:
    type: chain
    link: hand_link
    pose: {xyz: [0.25, 0, 0], quat: [0, 0, 0.6, 0.8]}
    sigma: {translation: 0.0005, rotation: 0.002}
  tracker:
    type: point
    link: base_link
    sigma: [0.00001, 0.00002, 3e-5]
  mocap:
    type: pose
    link: base_link
    sigma: {translation: 0.0005, rotation: 0.002}
estimate:
  - step: first
    sensors: [tracker, "wide*", wide_left]
    free: ["joint/*/offset", sensor/tracker/pose]
    loss: {cauchy: 3}
    priors: {"joint/*/offset": 0.05, sensor/tracker/pose: {translation: 0.5, rotation: 0.25}}
  - step: second
    free: [target/board/square]
)";

const char* kSample =
    R"({"id": "a", "time": 12.25, "joints": {"shoulder_pan_joint": 0.5, "elbow_flex_joint": -0.25, "slide_joint": 0.1, )"
    R"("finger_joint": 0.2, "gripper_of_another_file": 1}, "views": [)"
    R"({"sensor": "wide_left", "target": "board", "ids": [5, 0], "pixels": [[1, 2], [3.5, 4]], "image": "a.png", "sigma": 0.5}, )"
    R"({"sensor": "arm", "target": "board"}, )"
    R"({"sensor": "laser", "target": "reflector", "rays": [[0.1, 0.2, 3]]}, )"
    R"({"sensor": "tracker", "target": "reflector", "points": [[1, 2, 3]], "covariance": [[2, 1, 0], [1, 2, 0], [0, 0, 1]]}, )"
    R"({"sensor": "mocap", "target": "coded", "pose": {"xyz": [1, 2, 3], "quat": [0, 0, -0.6, -0.8]}}], "split": "test"})";

std::string error_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

/// A directory of its own with a robot and a rig, removed at the end.
struct Place {
  fs::path directory = fs::temp_directory_path() / ("kincal_rig_test_" + std::to_string(getpid()));
  std::string rig = (directory / "rig.yaml").string(),
              samples = (directory / "samples.jsonl").string();
  Place() {
    fs::create_directories(directory);
    write("robot.urdf", kRobot);
    write("rig.yaml", kRig);
  }
  ~Place() { fs::remove_all(directory); }
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(directory / name, std::ios::binary) << text;
  }
};

struct Mistake {
  std::string from, to, message;  // '@' in the message: the line where `from` stands
};

std::string edited(std::string text, const Mistake& mistake, std::string& message) {
  const size_t at = text.find(mistake.from);
  REQUIRE(at != std::string::npos);
  const std::string line = std::to_string(
      1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n'));
  message = mistake.message;
  if (message.find('@') != std::string::npos) message.replace(message.find('@'), 1, line);
  return text.replace(at, mistake.from.size(), mistake.to);
}

bool same_pose(const std::optional<Pose>& a, const std::optional<Pose>& b, double tolerance) {
  if (!a || !b) return !a && !b;
  return a->translation == b->translation &&
         (a->rotation - b->rotation).cwiseAbs().maxCoeff() <= tolerance;
}

/// The numbers of two rigs: all bit for bit, rotations to `tolerance`.
void check_same(const Rig& a, const RigValues& values, double tolerance) {
  const RigValues got = values_of(a);
  for (size_t j = 0; j < a.joints.size(); ++j) {
    if (!a.tree.joints[j].has_reading()) continue;
    INFO(a.tree.joints[j].name);
    CHECK(got.joint_offsets[j] == values.joint_offsets[j]);
    CHECK(got.joint_scales[j] == values.joint_scales[j]);
  }
  for (size_t s = 0; s < a.sensors.size(); ++s) {
    INFO(a.sensors[s].name);
    CHECK(same_pose(got.sensor_poses[s], values.sensor_poses[s], tolerance));
    CHECK(got.sensor_parameters[s] == values.sensor_parameters[s]);
  }
  for (size_t t = 0; t < a.targets.size(); ++t) {
    INFO(a.targets[t].name);
    CHECK(same_pose(got.target_poses[t], values.target_poses[t], tolerance));
    if (a.targets[t].grid) CHECK(got.target_squares[t] == values.target_squares[t]);
    CHECK(got.target_points[t] == values.target_points[t]);
  }
}

/// Every real rig with its samples.
fs::path data_directory() {
  const char* given = std::getenv("KINCAL_DATA");
  return given ? fs::path(given) : fs::path(KINCAL_SOURCE_DIR) / "../shared/data";
}

}  // namespace

TEST_CASE("a rig's values", "[rig]") {
  const Place place;
  const Rig rig = read_rig(place.rig).rig;
  CHECK(rig.tree.links[rig.base] == "base_link");
  const auto joint = [&](const char* name) { return rig.joints.at(rig.tree.find_joint(name)); };
  CHECK(joint("shoulder_pan_joint").sigma == 0.001);
  CHECK(joint("shoulder_pan_joint").scale == 1);
  CHECK(joint("elbow_flex_joint").sigma == 0.002);  // later entries win
  CHECK(joint("elbow_flex_joint").offset == 0.01);
  CHECK(joint("elbow_flex_joint").scale == 1.5);
  CHECK(joint("slide_joint").sigma == 0.003);
  CHECK(joint("tool_joint").sigma == 0);  // a glob skips fixed and mimic joints
  CHECK(joint("finger2_joint").sigma == 0);

  REQUIRE(rig.targets.size() == 5);
  const Target &board = rig.targets[0], &reflector = rig.targets[1], &coded = rig.targets[2];
  const Target &dots = rig.targets[3], &tags = rig.targets[4];
  CHECK(board.link == -1);
  CHECK(board.count() == 6);
  CHECK(board.square == 0.05);
  CHECK(board.layout.col(5) == Vector3d(2, 1, 0));  // point r * columns + c at (c, r)
  CHECK_FALSE(reflector.grid);
  CHECK(reflector.points.col(0) == Vector3d(0, 0, 0.125));
  CHECK(reflector.pose_given);
  CHECK(reflector.link_T_target.rotation == rotation_from_rpy({0.1, 0.2, 0.3}));
  CHECK(coded.count() == 6);
  CHECK(coded.layout.col(0) ==
        Vector3d(1, 1, 0));  // charuco: rows x columns squares, inner corners
  CHECK(coded.layout.col(4) == Vector3d(2, 2, 0));
  CHECK_FALSE(coded.pose_given);
  CHECK(rig.tree.links[coded.link] == "finger2_link");
  CHECK(dots.layout.col(3) == Vector3d(3, 1, 0));  // asymmetric: (2c + r % 2, r)
  CHECK(dots.square == 0.02);
  CHECK(tags.count() == 16);
  CHECK(tags.square == 0.08);
  CHECK(tags.layout.col(7) == Vector3d(1.25, 1, 0));   // tag 1, corner 3: upper left
  CHECK(tags.layout.col(10) == Vector3d(1, 2.25, 0));  // tag 2, corner 2: upper right

  REQUIRE(rig.sensors.size() == 7);
  const Sensor &left = rig.sensors[0], &plain = rig.sensors[1], &fish = rig.sensors[2];
  const Sensor &laser = rig.sensors[3], &arm = rig.sensors[4];
  REQUIRE(left.parameters.size() == 3);
  CHECK(left.parameters[0].values == std::vector<double>{320.5, 321.5, 319.5, 239.5});
  CHECK(left.parameters[1].values == std::vector<double>{0.1, 0.01, 0, 0, 0});
  CHECK(left.parameters[2].values == std::vector<double>{0.09});
  CHECK(left.image_width == 640);
  CHECK(left.image_height == 480);
  CHECK(left.sigma == std::vector<double>{0.125, 0.125});
  CHECK_FALSE(plain.pose_given);
  CHECK(plain.parameters.size() == 2);  // pinhole: no distortion
  CHECK(fish.parameters[1].values == std::vector<double>(4, 0.0));
  CHECK(rig.tree.joints[laser.scanning_joint].name == "tilt_joint");
  CHECK(laser.sigma == std::vector<double>{0.0005, 0.001, 0.005});
  CHECK(laser.model->scans());
  CHECK(arm.model->measures_pose());
  CHECK(arm.sigma == std::vector<double>{0.0005, 0.0005, 0.0005, 0.002, 0.002, 0.002});
  CHECK((arm.link_T_sensor.rotation * Vector3d::UnitX() - Vector3d(0.28, 0.96, 0)).norm() < 1e-15);
  CHECK(rig.sensors[5].sigma == std::vector<double>{0.00001, 0.00002, 3e-5});

  REQUIRE(rig.steps.size() == 2);
  CHECK(rig.steps[0].sensors == std::vector<int>{0, 5});  // the rig's order, each once
  CHECK(rig.steps[0].free == std::vector<std::string>{"joint/*/offset", "sensor/tracker/pose"});
  CHECK_THAT(rig.steps[0].free_where[1], Contains("rig.yaml:86: estimate[0].free[1]"));
  CHECK(rig.steps[0].loss->kind == LossKind::cauchy);
  CHECK(rig.steps[0].loss->scale == 3);
  REQUIRE(rig.steps[0].priors.size() == 2);
  CHECK(rig.steps[0].priors[0].pattern == "joint/*/offset");
  CHECK_FALSE(rig.steps[0].priors[0].split);
  CHECK(rig.steps[0].priors[1].rotation == 0.25);
  CHECK(rig.steps[0].priors[1].split);
  CHECK(rig.steps[1].sensors.size() == 7);
  CHECK_FALSE(rig.steps[1].loss);
}

TEST_CASE("every mistake in a rig is refused with file, line, field and what is near", "[rig]") {
  const Place place;
  const std::vector<Mistake> mistakes = {
      // the file
      {"rows: 2", "rows: [2", "rig.yaml:"},
      {"base: base_link", "base: base_link\nbase: base_link",
       "rig.yaml:4:7: key 'base' occurs twice"},
      {"    rows: 2", "    rows: 2\n    rows: 3", "rig.yaml:12:11: key 'rows' occurs twice"},
      {"base: base_link", "bases: base_link", "rig.yaml:@: unknown key 'bases'; nearest: base"},
      {"format: kincal/1", "format: kincal/2", "rig.yaml:@: format: 'kincal/2' is not kincal/1"},
      {"format: kincal/1\n", "", "rig.yaml:1: key 'format' is missing"},
      {"robot: robot.urdf", "robot: robo.urdf", "rig.yaml:@: robot: file '"},
      {"base: base_link", "base: base_lnk",
       "rig.yaml:@: base: unknown link 'base_lnk'; nearest: base_link"},
      {"base: base_link", "base: [base_link]", "rig.yaml:@: base: a text is expected, not a list"},
      // joints
      {"elbow_flex_joint:", "elbow_flx_joint:",
       "rig.yaml:@: joints.elbow_flx_joint: 'elbow_flx_joint' matches nothing; nearest: "
       "elbow_flex_joint"},
      {"\"sl*\"", "\"slode_*\"",
       "rig.yaml:@: joints.slode_*: 'slode_*' matches nothing; nearest: slide_joint"},
      {"\"sl*\"", "tool_joint",
       "rig.yaml:@: joints.tool_joint: a fixed joint has no reading of its own"},
      {"\"sl*\"", "finger2_joint",
       "rig.yaml:@: joints.finger2_joint: a mimic joint has no reading of its own"},
      {"scale: 1.5", "scael: 1.5",
       "rig.yaml:@: joints.elbow_flex_joint: unknown key 'scael'; nearest: scale"},
      {"sigma: 0.002", "sigma: -0.002",
       "rig.yaml:@: joints.elbow_flex_joint.sigma: a number of at least 0 is expected, not "
       "'-0.002'"},
      {"offset: 0.01", "offset: .inf",
       "rig.yaml:@: joints.elbow_flex_joint.offset: a finite number is expected, not '.inf'"},
      {"offset: 0.01", "offset: nan",
       "rig.yaml:@: joints.elbow_flex_joint.offset: a finite number is expected, not 'nan'"},
      {"scale: 1.5", "scale: 0", "rig.yaml:@: joints.elbow_flex_joint.scale: a scale is not 0"},
      // targets
      {"type: chessboard", "type: chesboard",
       "rig.yaml:@: targets.board.type: unknown type 'chesboard'; nearest: chessboard"},
      {"    type: chessboard\n", "", "targets.board: key 'type' is missing"},
      {"rows: 2", "rows: 2.5",
       "rig.yaml:@: targets.board.rows: an integer in 1 .. 10000 is expected, not '2.5'"},
      {"rows: 2", "rows: 0",
       "rig.yaml:@: targets.board.rows: an integer in 1 .. 10000 is expected, not '0'"},
      {"square: 0.05", "sqare: 0.05",
       "rig.yaml:@: targets.board: unknown key 'sqare'; nearest: square"},
      {"square: 0.05", "square: 0",
       "rig.yaml:@: targets.board.square: a number greater than 0 is expected, not '0'"},
      {"    square: 0.05\n", "", "rig.yaml:9: targets.board: key 'square' is missing"},
      {"mount: free", "mount: fre",
       "rig.yaml:@: targets.board.mount: 'free' or {link, pose} is expected, not 'fre'"},
      {"{link: finger2_link}", "{lnk: finger2_link}",
       "rig.yaml:@: targets.coded.mount: unknown key 'lnk'; nearest: link"},
      {"{link: finger2_link}", "{link: finger3_link}",
       "rig.yaml:@: targets.coded.mount.link: unknown link 'finger3_link'; nearest: finger"},
      {"{link: finger2_link}", "{link: cart_link}",
       "rig.yaml:@: targets.coded.mount.link: joint 'cart_joint' between"},
      {"[[0, 0, 0.125]]", "[[0, 0]]",
       "rig.yaml:@: targets.reflector.points[0]: a list of 3 numbers is expected, not a list of 2"},
      {"[[0, 0, 0.125]]", "[]", "rig.yaml:@: targets.reflector.points: at least one point"},
      {"xyz: [0.1, 0.2, 0.3]", "xyz: [0.1, 0.2]",
       "rig.yaml:@: targets.reflector.mount.pose.xyz: a list of 3 numbers"},
      {"marker: 0.02", "marker: -1",
       "rig.yaml:@: targets.coded.marker: a number greater than 0 is expected, not '-1'"},
      {"asymmetric: true", "asymmetric: 1",
       "rig.yaml:@: targets.dots.asymmetric: true or false is expected, not '1'"},
      {"spacing: 0.25", "spacing: -1", "rig.yaml:@: targets.tags.spacing: a number of at least 0"},
      // sensors
      {"link: tool0\n    model", "link: tol0\n    model",
       "rig.yaml:@: sensors.plain.link: unknown link 'tol0'; nearest: tool0"},
      {"link: tool0\n    model", "link: cart_link\n    model",
       "rig.yaml:@: sensors.plain.link: joint 'cart_joint' between"},
      {"type: tilting_laser", "type: tiltinglaser",
       "rig.yaml:@: sensors.laser.type: unknown type 'tiltinglaser'; nearest: tilting_laser"},
      {"model: pinhole", "model: pinhol",
       "rig.yaml:@: sensors.plain.model: unknown model 'pinhol'; nearest: pinhole"},
      {"intrinsics: [320.5, ", "intrinsics: [",
       "rig.yaml:@: sensors.wide_left.intrinsics: a list of 4 numbers is expected, not a list of "
       "3"},
      {"intrinsics: [320.5, ", "intrinsics: [0, ",
       "rig.yaml:@: sensors.wide_left.intrinsics[0]: a number greater than 0"},
      {"distortion: [0.1, ", "distortion: [",
       "rig.yaml:@: sensors.wide_left.distortion: brown_conrady: "},
      {"model: pinhole", "model: pinhole\n    distortion: [0, 1]",
       "sensors.plain.distortion: pinhole: no distortion"},
      {"distortion: [0.1, 0.01", "distortion: [0.1, \"0.01\"",
       "sensors.wide_left.distortion[1]: a finite number is expected, not '0.01' (a string)"},
      {"image_size: [640, 480]", "image_size: [640, 480, 3]",
       "rig.yaml:@: sensors.wide_left.image_size: a list of 2 numbers"},
      {"baseline: 0.09", "baselin: 0.09",
       "rig.yaml:@: sensors.wide_left: unknown key 'baselin'; nearest: baseline"},
      {"    sigma: 0.125\n", "", "sensors.wide_left: key 'sigma' is missing"},
      {"sigma: 0.125", "sigma: 0",
       "rig.yaml:@: sensors.wide_left.sigma: a number greater than 0 is expected, not '0'"},
      {"sigma: 0.125", "sigma: [1, 1]",
       "rig.yaml:@: sensors.wide_left.sigma: a finite number is expected, not a list"},
      {"sigma: [0.00001, ", "sigma: [", "rig.yaml:@: sensors.tracker.sigma: a list of 3 numbers"},
      {"sigma: [0.00001, ", "sigma: [0, ",
       "rig.yaml:@: sensors.tracker.sigma[0]: a number greater than 0"},
      {"sigma: {joint: 0.0005, ", "sigma: {",
       "rig.yaml:@: sensors.laser.sigma: key 'joint' is missing"},
      {"sigma: {translation: 0.0005, rotation: 0.002}", "sigma: 0.1",
       "rig.yaml:@: sensors.arm.sigma: a chain takes {translation, rotation}"},
      {"joint: tilt_joint", "joint: tlt_joint",
       "rig.yaml:@: sensors.laser.joint: unknown joint 'tlt_joint'; nearest: tilt_joint"},
      {"joint: tilt_joint", "joint: tool_joint",
       "rig.yaml:@: sensors.laser.joint: joint 'tool_joint' has no reading of its own"},
      {"joint: tilt_joint", "joint: slide_joint",
       "rig.yaml:@: sensors.laser.joint: joint 'slide_joint' is not between the base 'base_link' "
       "and link 'tilt_link'; "
       "valid: tilt_joint"},
      {"quat: [0, 0, 0.6, 0.8]", "quat: [0, 0, 0.6, 0.9]",
       "rig.yaml:@: sensors.arm.pose.quat: a unit quaternion"},
      {"quat: [0, 0, 0.6, 0.8]", "quat: [0, 0, 0.6, 0.8], rpy: [0, 0, 0]",
       "rig.yaml:@: sensors.arm.pose: either rpy or quat"},
      {"rpy: [-1.5, 0, 0.25]", "rpy: [-1.5, 0, 90]",
       "rpy: 90 rad is more than a turn: radians are expected"},
      {"pose: {xyz: [0, 0, 1]", "pose: {xyz: [0, 0, a]",
       "rig.yaml:@: sensors.wide_left.pose.xyz[2]: a finite number is expected, not 'a'"},
      // steps
      {"free: [target/board/square]", "free: []",
       "rig.yaml:@: estimate[1].free: the step frees nothing"},
      {"    free: [target/board/square]\n", "", "estimate[1]: key 'free' is missing"},
      {"free: [target/board/square]", "free: target/board/square",
       "rig.yaml:@: estimate[1].free: a list of texts is expected"},
      {"step: second", "step: first",
       "rig.yaml:@: estimate[1].step: a step 'first' is already above"},
      {"[tracker, \"wide*\"", "[trackr, \"wide*\"",
       "rig.yaml:@: estimate[0].sensors[0]: 'trackr' matches nothing; nearest: tracker"},
      {"[tracker, \"wide*\", wide_left]", "[]",
       "rig.yaml:@: estimate[0].sensors: the step uses no sensor"},
      {"{cauchy: 3}", "{cauchi: 3}",
       "rig.yaml:@: estimate[0].loss: unknown key 'cauchi'; nearest: cauchy"},
      {"{cauchy: 3}", "{cauchy: 3, huber: 1}", "rig.yaml:@: estimate[0].loss: one of {"},
      {"{cauchy: 3}", "{cauchy: 0}",
       "rig.yaml:@: estimate[0].loss.cauchy: a number greater than 0"},
      {"offset\": 0.05", "offset\": -0.05",
       "rig.yaml:@: estimate[0].priors.joint/*/offset: a number greater than 0"},
      {"rotation: 0.25}", "rotaton: 0.25}",
       "rig.yaml:@: estimate[0].priors.sensor/tracker/pose: unknown key 'rotaton'; nearest: "
       "rotation"},
  };
  for (const Mistake& mistake : mistakes) {
    std::string message;
    place.write("rig.yaml", edited(kRig, mistake, message));
    INFO(mistake.from << " -> " << mistake.to);
    const std::string error = error_of([&] { read_rig(place.rig); });
    CHECK_THAT(error, Contains(message) && Catch::StartsWith(place.directory.string()));
  }
  CHECK_THAT(error_of([] { read_rig("no/rig.yaml"); }),
             Contains("no/rig.yaml: cannot be read: No such file"));
  place.write("rig.yaml", "");
  CHECK_THAT(error_of([&] { read_rig(place.rig); }),
             Contains("rig.yaml:1: a mapping is expected, not nothing"));
  place.write("rig.yaml", "format: kincal/1\nrobot: robot.urdf\nsensors: {}\ntargets:\n");
  CHECK_THAT(error_of([&] { read_rig(place.rig); }),
             Contains("rig.yaml:4: targets: a mapping of targets is expected, at least one"));
}

TEST_CASE("another file where a rig is wanted is called what it is", "[rig]") {
  const Place place;
  const auto said = [&](const std::string& text) {
    place.write("rig.yaml", text);
    return error_of([&] { read_rig(place.rig); });
  };
  const std::string sample = R"({"id": "a", "joints": {}, "views": []})";
  for (const std::string& samples : {sample, sample + "\n" + sample + "\n", "\n" + sample})
    CHECK_THAT(said(samples), Contains("rig.yaml: these are samples, no rig; the rig comes first"));
  for (const char* before : {"", "\xEF\xBB\xBF", "<?xml version=\"1.0\"?>\n", "\r\n <!-- x -->"})
    CHECK_THAT(said(std::string(before) + kRobot),
               Contains("rig.yaml: this is XML, no rig; a rig names its "
                        "robot's URDF"));
  CHECK_THAT(said("{format: kincal/1, robots: robot.urdf}"), Contains("unknown key 'robots'"));
}

TEST_CASE("what a rig may leave away", "[rig]") {
  const Place place;
  place.write("rig.yaml",
              "format: kincal/1\nrobot: robot.urdf\ntargets: {p: {type: points, points: [[0, 0, "
              "0]], mount: free}}\n"
              "sensors: {t: {type: point, link: base_link, sigma: 1}}\njoints:\nestimate:\n");
  const Rig rig = read_rig(place.rig).rig;
  CHECK(rig.base == rig.tree.root);
  CHECK(rig.joints.size() == rig.tree.joints.size());
  CHECK(rig.steps.empty());
  CHECK_FALSE(rig.sensors[0].pose_given);
}

TEST_CASE("another robot in place of the rig's: offsets are folded into it", "[rig]") {
  const Place place;
  place.write("other.urdf", kRobot);
  fs::remove(place.directory / "robot.urdf");
  const RigFile rig = read_rig(place.rig, (place.directory / "other.urdf").string());
  const int elbow = rig.rig.tree.find_joint("elbow_flex_joint");
  CHECK(rig.rig.joints[elbow].offset == 0);
  CHECK(rig.rig.joints[elbow].scale == 1.5);
  place.write("written.yaml", rig_text(rig, values_of(rig.rig), "other.urdf"));
  const RigFile written = read_rig((place.directory / "written.yaml").string());
  CHECK(written.rig.joints[elbow].offset == 0);
  CHECK(written.rig.joints[elbow].scale == 1.5);
}

TEST_CASE("a rig written unchanged says the same", "[rig]") {
  const Place place;
  const RigFile rig = read_rig(place.rig);
  const std::string text = rig_text(rig, values_of(rig.rig), "robot.urdf");
  CHECK(text == to_yaml(rig.node));
  place.write("written.yaml", text);
  const RigFile written = read_rig((place.directory / "written.yaml").string());
  check_same(written.rig, values_of(rig.rig), 0);
}

TEST_CASE("a rig written with new values has them when read back", "[rig]") {
  const Place place;
  const RigFile rig = read_rig(place.rig);
  const Tree& tree = rig.rig.tree;
  RigValues values = values_of(rig.rig);
  const int elbow = tree.find_joint("elbow_flex_joint"), slide = tree.find_joint("slide_joint");
  const int pan = tree.find_joint("shoulder_pan_joint");
  values.joint_offsets[elbow] = 0;  // folded
  values.joint_offsets[slide] = 1 / 3.0;
  values.joint_scales[pan] = 1.0000000000000002;
  for (size_t s = 0; s < rig.rig.sensors.size(); ++s) {
    if (s == 2) continue;  // one without a pose stays so
    Vector6d xi;
    xi << 0.1, -1e-7, 1 / 7.0, 0.3 * static_cast<double>(s), -3, 1e-6;
    values.sensor_poses[s] = rig.rig.sensors[s].link_T_sensor * exp_se3(xi);
  }
  values.sensor_poses[0] = rig.rig.sensors[0].link_T_sensor;
  values.sensor_poses[0]->translation.y() = 1e-17;  // only moved
  values.sensor_poses[6] = Pose();                  // held where the rig has none
  for (auto& blocks : values.sensor_parameters)
    for (auto& block : blocks)
      for (double& value : block) value += 0.1 / 3;
  for (size_t t = 0; t < rig.rig.targets.size(); ++t) {
    values.target_squares[t] *= 1.0001;
    if (rig.rig.targets[t].link >= 0)
      values.target_poses[t] = rig.rig.targets[t].link_T_target * exp_se3(Vector6d::Constant(0.01));
  }
  values.target_points[1](0, 0) = -0.0;
  values.target_points[1](1, 0) = 1e-300;
  const std::string text = rig_text(rig, values, "new robot.urdf");
  INFO(text);
  place.write("new robot.urdf", kRobot);
  place.write("written.yaml", text);
  const RigFile written = read_rig((place.directory / "written.yaml").string());
  check_same(written.rig, values, 1e-15);
  CHECK(written.rig.joints[slide].sigma == 0.003);
  CHECK(written.rig.joints[pan].sigma == 0.001);
  CHECK_FALSE(written.rig.sensors[2].pose_given);
  CHECK(written.rig.sensors[1].pose_given);
  CHECK(written.rig.sensors[6].pose_given);
  CHECK_THAT(text, Contains("  mocap:\n    type: pose\n    link: base_link\n"
                            "    pose: {xyz: [0, 0, 0]}\n"));
  CHECK_THAT(
      text,
      Contains("robot: new robot.urdf\n") &&
          Contains("elbow_flex_joint: {sigma: 0.002, offset: 0, scale: 1.5}") &&
          Contains("  sl*: {sigma: 0.003}\n  shoulder_pan_joint: {scale: 1.0000000000000002}\n") &&
          Contains("rpy: [-1.5, 0, 0.25]") && Contains("type: chessboard"));
  // a second writing of the same values changes nothing but rotations' last digits
  const std::string again = rig_text(written, values_of(written.rig), "new robot.urdf");
  CHECK(again == text);
}

TEST_CASE("a marker is a board of one field, whose size is written and read", "[rig]") {
  const Place place;
  std::string text = kRig;
  const std::string marker =
      "  tag: {type: marker, dictionary: DICT_4X4_50, id: 3, size: 0.02, mount: free}\n";
  place.write("rig.yaml", text.insert(text.find("sensors:\n"), marker));
  const RigFile rig = read_rig(place.rig);
  const Eigen::Matrix3Xd corners = target_points(rig.rig.targets.back());
  CHECK(corners.col(0) == Vector3d(-0.01, 0.01, 0));  // clockwise from the upper left, y up
  CHECK(corners.col(1) == Vector3d(0.01, 0.01, 0));
  CHECK(corners.col(2) == Vector3d(0.01, -0.01, 0));
  CHECK(corners.col(3) == Vector3d(-0.01, -0.01, 0));
  RigValues values = values_of(rig.rig);
  CHECK(rig_text(rig, values, "robot.urdf") == to_yaml(rig.node));
  values.target_squares.back() = 0.018;
  values.target_prints.back() = Eigen::Vector2d(0.001, 0);
  place.write("written.yaml", rig_text(rig, values, "robot.urdf"));
  const Target written = read_rig((place.directory / "written.yaml").string()).rig.targets.back();
  CHECK(written.type == "marker");
  CHECK(written.square == 0.018);
  CHECK(written.print == Eigen::Vector2d(0.001, 0));
}

TEST_CASE("joint values win over every glob when written", "[rig]") {
  const Place place;
  std::string text = kRig;  // the glob behind the joint's own entry sets the same
  text.replace(text.find("\"sl*\": {sigma: 0.003}"), 21,
               "\"*_flex_*\": {offset: 0.5, sigma: 0.004}");
  place.write("rig.yaml", text);
  const RigFile rig = read_rig(place.rig);
  const int elbow = rig.rig.tree.find_joint("elbow_flex_joint");
  REQUIRE(rig.rig.joints[elbow].offset == 0.5);
  RigValues values = values_of(rig.rig);
  CHECK(rig_text(rig, values, "robot.urdf") == to_yaml(rig.node));
  values.joint_offsets[elbow] = 0;
  place.write("written.yaml", rig_text(rig, values, "robot.urdf"));
  const Rig written = read_rig((place.directory / "written.yaml").string()).rig;
  CHECK(written.joints[elbow].offset == 0);
  CHECK(written.joints[elbow].scale == 1.5);
  CHECK(written.joints[elbow].sigma == 0.004);
}

TEST_CASE("a rig without joints gets them only when needed", "[rig]") {
  const Place place;
  std::string text = kRig;
  const size_t at = text.find("joints:"), end = text.find("targets:");
  text.erase(at, end - at);
  place.write("rig.yaml", text);
  const RigFile rig = read_rig(place.rig);
  RigValues values = values_of(rig.rig);
  CHECK_THAT(rig_text(rig, values, "robot.urdf"), !Contains("joints:"));
  values.joint_scales[rig.rig.tree.find_joint("slide_joint")] = 0.5;
  CHECK_THAT(rig_text(rig, values, "robot.urdf"),
             Contains("base: base_link\njoints:\n  slide_joint: {scale: 0.5}\ntargets:"));
}

TEST_CASE("joint models are named in a rig, and written again", "[rig]") {
  const Place place;
  const JointModels models = {linear_joint(), std::make_shared<fixture::QuadraticJoint>(0.125)};
  const auto with = [](const std::string& joints) {
    std::string text = kRig;
    const size_t at = text.find("  elbow_flex_joint: {sigma");
    return text.replace(at, text.find("targets:") - at, joints);
  };
  const auto read = [&](const std::string& joints) {
    place.write("rig.yaml", with(joints));
    return read_rig(place.rig, "", models);
  };
  const std::string elbow_joint = "elbow_flex_joint", pan_joint = "shoulder_pan_joint";

  // The model may stand behind the numbers, in a glob, and be taken back.
  const RigFile rig = read(
      "  elbow_flex_joint: {bend: -0.5, offset: 0.01}\n  \"*_flex_joint\": {model: quadratic}\n"
      "  shoulder_pan_joint: {model: quadratic}\n  slide_joint: {model: quadratic}\n  sl*: {model: "
      "linear}\n");
  const Tree& tree = rig.rig.tree;
  const int elbow = tree.find_joint(elbow_joint), pan = tree.find_joint(pan_joint),
            slide = tree.find_joint("slide_joint");
  CHECK(rig.rig.joints[elbow].model == models[1]);
  CHECK(rig.rig.joints[elbow].further == std::vector<double>{-0.5});
  CHECK(rig.rig.joints[pan].further == std::vector<double>{0.125});
  CHECK(rig.rig.joints[slide].model == linear_joint());
  const ParameterTable table(rig.rig);
  CHECK(table.select("joint/*/bend").size() == 2);

  RigValues values = values_of(rig.rig);
  CHECK(rig_text(rig, values, "robot.urdf") == to_yaml(rig.node));
  values.joint_offsets[elbow] = 0;
  values.joint_further[elbow] = {1 / 3.0};
  values.joint_further[pan] = {0.75};
  values.joint_models[slide] = models[1];
  values.joint_further[slide] = {2};
  place.write("written.yaml", rig_text(rig, values, "robot.urdf"));
  const RigFile written = read_rig((place.directory / "written.yaml").string(), "", models);
  for (int j : {elbow, pan, slide}) CHECK(written.rig.joints[j].model == models[1]);
  CHECK(written.rig.joints[elbow].further[0] == 1 / 3.0);
  CHECK(written.rig.joints[elbow].offset == 0);
  CHECK(written.rig.joints[pan].further[0] == 0.75);
  CHECK(written.rig.joints[slide].further[0] == 2);

  // Its own entry says linear before a glob of the others' numbers: it stays so when it moves
  // behind the glob.
  const RigFile kept = read(
      "  \"*\": {model: quadratic}\n  elbow_flex_joint: {model: linear}\n  \"*_flex_*\": {offset: "
      "0.5}\n");
  RigValues moved = values_of(kept.rig);
  moved.joint_offsets[elbow] = 0;
  place.write("written.yaml", rig_text(kept, moved, "robot.urdf"));
  const RigFile again = read_rig((place.directory / "written.yaml").string(), "", models);
  CHECK(again.rig.joints[elbow].model == linear_joint());
  CHECK(again.rig.joints[elbow].offset == 0);
  CHECK(again.rig.joints[pan].model == models[1]);
  moved.joint_models[pan] = linear_joint();
  moved.joint_further[pan].clear();
  place.write("written.yaml", rig_text(kept, moved, "robot.urdf"));
  CHECK(read_rig((place.directory / "written.yaml").string(), "", models).rig.joints[pan].model ==
        linear_joint());

  const auto refused = [&](const std::string& joints) { return error_of([&] { read(joints); }); };
  CHECK_THAT(refused("  elbow_flex_joint: {model: quadratc}\n"),
             Contains("rig.yaml:6: joints.elbow_flex_joint.model: unknown joint model 'quadratc'; "
                      "nearest: quadratic; valid: linear, quadratic"));
  CHECK_THAT(refused("  elbow_flex_joint: {bend: 1}\n"),
             Contains("joints.elbow_flex_joint.bend: joint 'elbow_flex_joint' has the model "
                      "linear, which has no 'bend'"));
  CHECK_THAT(refused("  elbow_flex_joint: {model: quadratic, bend: much}\n"),
             Contains("joints.elbow_flex_joint.bend: a finite number"));
  place.write("rig.yaml", with("  elbow_flex_joint: {model: quadratic}\n"));
  CHECK_THAT(error_of([&] { read_rig(place.rig); }),
             Contains("unknown joint model 'quadratic'") && Contains("valid: linear"));
  place.write("rig.yaml", with("  elbow_flex_joint: {model: linear, scale: 2}\n"));
  RigFile plain = read_rig(place.rig);
  CHECK(plain.rig.joints[elbow].scale == 2);

  // A model that a program has set and the rig cannot name is not lost in silence.
  plain.rig.joints[elbow].model = models[1];
  CHECK_THAT(error_of([&] { rig_text(plain, values_of(plain.rig), "robot.urdf"); }),
             Contains("joints.elbow_flex_joint: has a joint model"));
}

TEST_CASE("a sensor of one number a point is read and written as a plain list", "[samples]") {
  const Place place;
  Rig rig = read_rig(place.rig).rig;
  Sensor gauge;
  gauge.name = "gauge";
  gauge.type = "height";
  gauge.link = rig.tree.root;
  gauge.model = std::make_shared<PointwiseSensor<fixture::Height>>();
  gauge.sigma = {0.001};
  rig.sensors.push_back(gauge);
  place.write(
      "samples.jsonl",
      R"({"id": "a", "joints": {}, "views": [)"
      R"({"sensor": "gauge", "target": "board", "ids": [2, 0], "points": [0.5, 0.25], "sigma": 0.002}]})");
  const std::vector<Sample> samples = read_samples(place.samples, rig);
  CHECK(samples[0].views[0].z == std::vector<double>{0.5, 0.25});
  CHECK(samples[0].views[0].sigma == std::vector<double>{0.002});
  const std::string text = samples_text(rig, samples);
  CHECK_THAT(text, Contains("\"points\": [0.5, 0.25], \"sigma\": 0.002"));
  place.write("samples.jsonl", text);
  CHECK(samples_text(rig, read_samples(place.samples, rig)) == text);
}

TEST_CASE("a sample's values", "[samples]") {
  const Place place;
  const Rig rig = read_rig(place.rig).rig;
  place.write("samples.jsonl",
              std::string("\n") + kSample +
                  "\r\n  \n{\"id\": \"1593701755\", \"joints\": {}, \"views\": []}");
  const std::vector<Sample> samples = read_samples(place.samples, rig);
  REQUIRE(samples.size() == 2);
  const Sample& a = samples[0];
  CHECK(a.id == "a");
  CHECK(a.time == 12.25);
  CHECK_FALSE(a.train);
  CHECK(a.readings[rig.tree.find_joint("elbow_flex_joint")] == -0.25);
  CHECK(std::isnan(a.readings[rig.tree.find_joint("tilt_joint")]));  // differs from ray to ray
  REQUIRE(a.views.size() == 5);
  CHECK(a.views[0].sensor == 0);
  CHECK(a.views[0].ids == std::vector<int>{5, 0});
  CHECK(a.views[0].z == std::vector<double>{1, 2, 3.5, 4});
  CHECK(a.views[0].sigma == std::vector<double>{0.5, 0.5});
  CHECK(a.views[1].ids.empty());
  CHECK(a.views[1].z.empty());
  CHECK(a.views[1].sigma == rig.sensors[4].sigma);
  CHECK(a.views[2].ids == std::vector<int>{0});
  CHECK(a.views[2].z.size() == 3);
  REQUIRE(a.views[3].covariance.size() == 1);
  CHECK(a.views[3].covariance[0](0, 1) == 1);
  CHECK(a.views[4].z == std::vector<double>{1, 2, 3, 0, 0, -0.6, -0.8});
  CHECK(samples[1].train);
  CHECK_FALSE(samples[1].time);
  CHECK(samples[1].views.empty());
}

TEST_CASE("every mistake in samples is refused with file, line, field and what is near",
          "[samples]") {
  const Place place;
  const Rig rig = read_rig(place.rig).rig;
  const std::vector<Mistake> mistakes = {
      {"\"time\": 12.25", "\"time\": ", "samples.jsonl:2:21: syntax error"},
      {"0.5, \"elbow", "NaN, \"elbow", "finite numbers only"},
      {"[3.5, 4]", "[3.5, 1e999]", "number overflow parsing '1e999'"},
      {"\"time\": 12.25", "\"id\": \"b\"", "samples.jsonl:2:19: key 'id' occurs twice"},
      {"\"time\"", "\"tiem\"", "samples.jsonl:2: unknown key 'tiem'; nearest: time"},
      {"\"id\": \"a\"", "\"id\": 7", "samples.jsonl:2: id: a string is expected"},
      {"\"id\": \"a\", ", "", "samples.jsonl:2: key 'id' is missing"},
      {"\"id\": \"a\"", "\"id\": \"b\"", "samples.jsonl:3: id: 'b' is already in line 2"},
      {"12.25", "\"12\"",
       "samples.jsonl:2: time: a finite number is expected, not '12' (a string)"},
      {"\"test\"", "\"tset\"", "samples.jsonl:2: split: 'train' or 'test' is expected, not 'tset'"},
      {"-0.25", "null",
       "samples.jsonl:2: joints.elbow_flex_joint: a finite number is expected, not nothing"},
      {"\"elbow_flex_joint\"", "\"elbow_flx_joint\"",
       "samples.jsonl:2: views[1]: sensor 'arm' needs joint 'elbow_flex_joint', which the sample "
       "lacks; "
       "the sample has 'elbow_flx_joint'"},
      {"\"slide_joint\": 0.1, ", "",
       "samples.jsonl:2: views[1]: sensor 'arm' needs joint 'slide_joint', which the sample lacks"},
      // the target on the finger that mimics another: that one's reading is needed
      {"\"finger_joint\": 0.2, ", "",
       "samples.jsonl:2: views[4]: target 'coded' needs joint 'finger_joint', which the sample "
       "lacks"},
      {"\"wide_left\"", "\"wide_lef\"",
       "samples.jsonl:2: views[0].sensor: unknown sensor 'wide_lef'; nearest: wide_left"},
      {"\"wide_left\"", "\"x\"", "unknown sensor 'x'; the rig has: wide_left, plain"},
      {"\"target\": \"board\"", "\"target\": \"bord\"",
       "samples.jsonl:2: views[0].target: unknown target 'bord'; nearest: board"},
      {"\"ids\": [5, 0]", "\"ids\": [6, 0]",
       "samples.jsonl:2: views[0].ids[0]: an integer in 0 .. 5 is expected, not '6'"},
      {"\"ids\": [5, 0]", "\"ids\": [-1, 0]",
       "samples.jsonl:2: views[0].ids[0]: an integer in 0 .. 5 is expected, not '-1'"},
      {"\"ids\": [5, 0]", "\"ids\": [5, 5]",
       "samples.jsonl:2: views[0].ids[1]: point 5 occurs twice"},
      {"\"ids\": [5, 0]", "\"ids\": [5, 0.5]", "samples.jsonl:2: views[0].ids[1]: an integer"},
      {"\"ids\": [5, 0]", "\"ids\": [5]", "samples.jsonl:2: views[0].ids: 1 ids for 2 points"},
      {"\"ids\": [5, 0], \"pixels\": [[1, 2], [3.5, 4]]", "\"ids\": [], \"pixels\": []",
       "samples.jsonl:2: views[0].pixels: at least one point"},
      {"\"rays\": [[0.1, 0.2, 3]]", "\"rays\": [[0.1, 0.2, 3], [0.1, 0.2, 3]]",
       "samples.jsonl:2: views[2].rays: 2 points, but target 'reflector' has 1"},
      {"[3.5, 4]", "[3.5]",
       "samples.jsonl:2: views[0].pixels[1]: a list of 2 numbers is expected, not a list of 1"},
      {"[3.5, 4]", "[3.5, \"4\"]",
       "samples.jsonl:2: views[0].pixels[1][1]: a finite number is expected, not '4' (a string)"},
      {"\"pixels\": [[1, 2], [3.5, 4]]", "\"points\": [[1, 2], [3.5, 4]]",
       "samples.jsonl:2: views[0].points: a camera view has no 'points'; it needs 'pixels'"},
      {", \"rays\": [[0.1, 0.2, 3]]", "",
       "samples.jsonl:2: views[2]: a tilting_laser view needs 'rays'"},
      {"\"arm\", \"target\": \"board\"", "\"arm\", \"target\": \"board\", \"pose\": {}",
       "samples.jsonl:2: views[1].pose: a chain view has no 'pose'; the joint readings are its "
       "measurement"},
      {"\"arm\", \"target\": \"board\"", "\"arm\", \"target\": \"board\", \"ids\": [0]",
       "samples.jsonl:2: views[1].ids: a chain view has no 'ids'"},
      {"\"arm\", \"target\": \"board\"", "\"arm\", \"target\": \"reflector\"",
       "samples.jsonl:2: views[1]: a chain needs a target with three points not on a line, "
       "'reflector' has none; "
       "for a single point use a sensor of type point on link 'hand_link'"},
      {"\"image\"", "\"img\"", "samples.jsonl:2: views[0]: unknown key 'img'; nearest: image"},
      {"\"sigma\": 0.5", "\"sigma\": 0",
       "samples.jsonl:2: views[0].sigma: a number greater than 0"},
      {"\"sigma\": 0.5", "\"covariance\": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
       "samples.jsonl:2: views[0].covariance: a camera view has no"},
      {"\"covariance\": [[2", "\"sigma\": 1, \"covariance\": [[2",
       "samples.jsonl:2: views[3].covariance: either sigma or covariance"},
      {"[[2, 1, 0], [1, 2, 0]", "[[2, 1, 0], [1.1, 2, 0]",
       "samples.jsonl:2: views[3].covariance: a covariance is symmetric"},
      {"[[2, 1, 0], [1, 2, 0]", "[[1, 2, 0], [2, 1, 0]",
       "samples.jsonl:2: views[3].covariance: a covariance is positive definite"},
      {"[[2, 1, 0], [1, 2, 0], ", "[[2, 1, 0], ",
       "samples.jsonl:2: views[3].covariance: 3 rows of 3 numbers"},
      {"[[2, 1, 0], [1, 2, 0], [0, 0, 1]]",
       "[[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]]]",
       "samples.jsonl:2: views[3].covariance: one 3 x 3 matrix, or one for each of the 1 points"},
      {"[0, 0, -0.6, -0.8]", "[0, 0, -0.6, -0.7]",
       "samples.jsonl:2: views[4].pose.quat: a unit quaternion"},
      {"\"views\": [", "\"views\": [3, ",
       "samples.jsonl:2: views[0]: a mapping is expected, not '3'"},
  };
  for (const Mistake& mistake : mistakes) {
    std::string message;
    place.write("samples.jsonl", "\n" + edited(kSample, mistake, message) +
                                     "\n{\"id\": \"b\", \"joints\": {}, \"views\": []}\n");
    INFO(mistake.from << " -> " << mistake.to);
    const std::string error = error_of([&] { read_samples(place.samples, rig); });
    CHECK_THAT(error, Contains(message) && Catch::StartsWith(place.samples + ":"));
  }
  place.write("samples.jsonl", " \n\n");
  CHECK_THAT(error_of([&] { read_samples(place.samples, rig); }),
             Contains("samples.jsonl: no samples"));
  CHECK_THAT(error_of([&] { read_samples("no/samples.jsonl", rig); }),
             Contains("no/samples.jsonl: cannot be read: No such file"));
}

TEST_CASE("a line with something rare in it is read with the same result and the same words",
          "[samples]") {
  const Place place;
  const Rig rig = read_rig(place.rig).rig;
  const auto read = [&](const std::string& line) {
    place.write("samples.jsonl", line + "\n");
    return read_samples(place.samples, rig);
  };
  const auto rare =
      [](std::string line) {  // an escape: parse_plain_json() leaves the line to parse_json()
        return line.replace(line.find("\"id\""), 4, "\"\\u0069d\"");
      };
  const std::string line = kSample;
  const std::vector<std::pair<std::string, std::string>> edits = {
      {"\"a\"", "\"a\""},
      {"12.25", "1e-3"},
      {"12.25", "\"x\""},
      {"-0.25", "-0.0"},
      {"-0.25", "-0"},
      {"-0.25", "12345678901234567890123"},
      {"-0.25", "[1]"},
      {"[5, 0]", "[5.0, 0e0]"},
      {"[5, 0]", "[5, 0, 1]"},
      {"[5, 0]", "[[5, 0]]"},
      {"[5, 0]", "[[5], [0]]"},
      {"[5, 0]", "[5, 5]"},
      {"[5, 0]", "[5, 1e20]"},
      {"[5, 0]", "3"},
      {"[5, 0]", "[]"},
      {"[[1, 2], [3.5, 4]]", "[1, 2]"},
      {"[[1, 2], [3.5, 4]]", "[[1, 2, 3], [3.5, 4, 5]]"},
      {"[[1, 2], [3.5, 4]]", "[[[1, 2], [3.5, 4]]]"},
      {"[[1, 2], [3.5, 4]]", "[[]]"},
      {"[[1, 2], [3.5, 4]]", "[]"},
      {"[[1, 2], [3.5, 4]]", "7"},
      {"[[1, 2], [3.5, 4]]", "{\"a\": 1}"},
      {"\"a.png\"", "7"},
      {"\"a.png\"", "true"},
      {"0.5, \"elbow", "null, \"elbow"},
      {"\"sigma\": 0.5", "\"sigma\": [0.5]"},
      {"\"wide_left\"", "5"},
      {"\"wide_left\"", "[5]"},
      {"\"test\"", "1"},
      {"[[2, 1, 0], [1, 2, 0], [0, 0, 1]]", "[[[2, 1, 0], [1, 2, 0], [0, 0, 1]]]"},
      {"[[2, 1, 0], [1, 2, 0], [0, 0, 1]]", "[[[2, 1], [1, 2]]]"},
      {"[[2, 1, 0], [1, 2, 0], [0, 0, 1]]", "[2, 1, 0, 1, 2, 0, 0, 0, 1]"},
      {"\"quat\": [0, 0, -0.6, -0.8]", "\"quat\": [[0, 0, -0.6, -0.8]]"},
      {"\"xyz\": [1, 2, 3]", "\"xyz\": 1"},
      {"\"pose\": {", "\"sigma\": [1, 2, 3], \"pose\": {"},
      {"\"points\": [[1, 2, 3]], \"covariance\": [[2, 1, 0], [1, 2, 0], [0, 0, 1]]",
       "\"points\": [[1, 2, 3]], \"sigma\": [1, 2, 3]"}};
  for (const auto& [from, to] : edits) {
    std::string plain = line;
    REQUIRE(plain.find(from) != std::string::npos);
    plain.replace(plain.find(from), from.size(), to);
    INFO(from << " -> " << to);
    const std::string error = error_of([&] { read(plain); });
    CHECK(error == error_of([&] { read(rare(plain)); }));
    if (!error.empty()) continue;
    const std::vector<Sample> a = read(plain), b = read(rare(plain));
    CHECK(
        samples_text(rig, a) ==
        samples_text(rig, b));  // all that a sample has, in digits that tell any two numbers apart
    for (size_t j = 0; j < rig.joints.size(); ++j)
      CHECK(std::signbit(a[0].readings[j]) == std::signbit(b[0].readings[j]));
  }
}

TEST_CASE("samples written and read again are the same", "[samples]") {
  const Place place;
  const Rig rig = read_rig(place.rig).rig;
  place.write("samples.jsonl", kSample);
  std::vector<Sample> samples = read_samples(place.samples, rig);
  samples[0].id = "odd \"id\"\n\x01 \xc3\xa9";
  samples[0].views[0].z = {1 / 3.0, -1e-300, 1e300, 0.1};
  samples[0].views[4].sigma = {1, 1, 1, 2, 2, 2};
  samples[0].views[2].sigma = {0.1, 0.2, 0.3};
  const std::string path = (place.directory / "again.jsonl").string();
  struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
  };
  const std::locale before =
      std::locale::global(std::locale(std::locale(), new Comma));  // no locale may change a file
  std::ofstream(path) << samples_text(rig, samples);
  const std::vector<Sample> again = read_samples(path, rig);
  std::locale::global(before);
  REQUIRE(again.size() == 1);
  CHECK(again[0].id == samples[0].id);
  CHECK(again[0].time == samples[0].time);
  CHECK(again[0].train == samples[0].train);
  for (size_t j = 0; j < rig.joints.size(); ++j)
    CHECK((again[0].readings[j] == samples[0].readings[j] || std::isnan(samples[0].readings[j])));
  REQUIRE(again[0].views.size() == samples[0].views.size());
  for (size_t v = 0; v < again[0].views.size(); ++v) {
    const View &a = again[0].views[v], &b = samples[0].views[v];
    CHECK(a.sensor == b.sensor);
    CHECK(a.target == b.target);
    CHECK(a.ids == b.ids);
    CHECK(a.z == b.z);
    CHECK(a.sigma == b.sigma);
    REQUIRE(a.covariance.size() == b.covariance.size());
    for (size_t i = 0; i < a.covariance.size(); ++i) CHECK(a.covariance[i] == b.covariance[i]);
  }
}

TEST_CASE("the real rigs and samples are read, and written the same", "[rig][samples][data]") {
  const fs::path data = data_directory();
  if (!fs::exists(data)) {
    WARN("skipped: no real data");
    return;
  }
  const Place place;
  int rigs = 0, files = 0;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(data)) {
    const std::string name = entry.path().filename().string();
    if (name.compare(0, 3, "rig") != 0 || entry.path().extension() != ".yaml") continue;
    INFO(entry.path().filename());
    ++rigs;
    const RigFile rig = read_rig(entry.path().string());
    place.write("written.yaml", rig_text(rig, values_of(rig.rig), rig.urdf.path));
    check_same(read_rig((place.directory / "written.yaml").string()).rig, values_of(rig.rig), 0);
    for (const fs::directory_entry& other : fs::directory_iterator(entry.path().parent_path())) {
      const std::string file = other.path().filename().string();
      if (file.compare(0, 7, "samples") != 0 || other.path().extension() != ".jsonl") continue;
      const std::string read_error = error_of([&] {
        const std::vector<Sample> samples = read_samples(other.path().string(), rig.rig);
        std::ofstream(place.samples) << samples_text(rig.rig, samples);
        const std::vector<Sample> again = read_samples(place.samples, rig.rig);
        REQUIRE(again.size() == samples.size());
        for (size_t s = 0; s < samples.size(); ++s) {
          REQUIRE(again[s].views.size() == samples[s].views.size());
          for (size_t v = 0; v < samples[s].views.size(); ++v)
            if (again[s].views[v].z != samples[s].views[v].z ||
                again[s].views[v].ids != samples[s].views[v].ids)
              FAIL(samples[s].id);
        }
        ++files;
      });
      // of the robots with several rigs, not every rig has the sensors of every file of samples, or
      // takes one for a sensor of poses and another for one of points
      if (!read_error.empty())
        CHECK_THAT(read_error, Contains("unknown sensor") || Contains("unknown target") ||
                                   Contains("view has no"));
    }
  }
  CHECK(rigs >= 11);
  CHECK(files >= 11);
}

TEST_CASE("lenses beyond the usual ones, and ranges of a depth camera", "[rig]") {
  const Place place;
  const auto read = [&](const std::string& sensor) {
    const bool stated = sensor.find("sigma") < sensor.size();
    place.write("rig.yaml", R"(format: kincal/1
robot: {base: base, flange: tool0}
targets: {dot: {type: points, points: [[0, 0, 0]], mount: {link: tool0}}}
sensors: {eye: {link: base, )" + std::string(stated ? "" : "sigma: 0.1, ") +
                                sensor + "}}\n");
    return read_rig(place.rig).rig.sensors[0];
  };
  const auto camera = [&](const std::string& rest) {
    return read("type: camera, intrinsics: [600, 601, 320, 240], model: " + rest);
  };
  const auto distortion = [&](const std::string& rest) {
    return camera(rest).parameters[1].values;
  };
  using Numbers = std::vector<double>;
  CHECK(distortion("unified, distortion: [1.5, 0.1, 0.2, 0.3, 0.4]") ==
        Numbers{1.5, 0.1, 0.2, 0.3, 0.4});
  CHECK(distortion("unified") == Numbers{1, 0, 0, 0, 0});
  CHECK(distortion("double_sphere, distortion: [-0.2, 0.6]") == Numbers{-0.2, 0.6});
  CHECK(distortion("double_sphere") == Numbers{0, 0.5});
  CHECK(distortion("rational_polynomial").size() == 8);
  CHECK(camera("brown_conrady, distortion: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14]")
            .parameters[1]
            .components.back() == "tau_y");
  CHECK_THAT(error_of([&] { camera("double_sphere, distortion: [1, 2, 3]"); }),
             Contains("sensors.eye.distortion") && Contains("double_sphere 2"));
  CHECK_THAT(error_of([&] { camera("brown_conrady, distortion: [1, 2, 3, 4, 5, 6]"); }),
             Contains("brown_conrady 5, 8, 12 or 14"));
  CHECK_THAT(error_of([&] { camera("mei"); }),
             Contains("unknown model 'mei'") && Contains("unified (xi k1 k2 p1 p2)"));
  const Sensor depth = read("type: point, range_scale: 1.01, range_offset: -0.02");
  REQUIRE(depth.parameters.size() == 2);
  CHECK((depth.parameters[0].name == "range_scale" && depth.parameters[0].values[0] == 1.01));
  CHECK((depth.parameters[1].name == "range_offset" && depth.parameters[1].values[0] == -0.02));
  CHECK(read("type: point, range_offset: 0").parameters[0].values[0] == 1);
  CHECK(read("type: point").parameters.empty());
  const Sensor marker =
      read("type: pose, range_scale: 1.1, sigma: {translation: 0.001, rotation: 0.002}");
  REQUIRE(marker.parameters.size() == 1);
  CHECK((marker.parameters[0].name == "range_scale" && marker.parameters[0].values[0] == 1.1));
  CHECK_THAT(error_of([&] { read("type: pose, range_offset: 0.1"); }),
             Contains("range_offset") && Contains("valid"));
  CHECK_THAT(error_of([&] { read("type: point, range_scale: 0"); }),
             Contains("sensors.eye.range_scale"));
}

TEST_CASE("a sample's own sigmas of readings, and back to text", "[samples]") {
  const Place place;
  place.write("rig.yaml", R"(format: kincal/1
robot: {base: base, flange: tool0}
joints: {flange: {sigma: {translation: 0.0001, rotation: 0.0002}}}
targets: {dot: {type: points, points: [[0, 0, 0]], mount: {link: tool0}}}
sensors: {tracker: {type: point, link: base, sigma: 0.0001}}
)");
  Rig rig = read_rig(place.rig).rig;
  const std::string flange = R"("flange": {"xyz": [1, 2, 3], "quat": [0, 0, 0, 1]})";
  const auto sample = [&](const std::string& joints, const std::string& sigmas) {
    return parse_samples(R"({"id": "a", "joints": {)" + joints + R"(}, "joint_sigma": )" + sigmas +
                             R"(, "views": []})",
                         "samples.jsonl", rig)[0];
  };
  const Sample both = sample(flange, R"({"flange": {"translation": 5e-5, "rotation": 0.0005}})");
  const int errors = rig.tree.joints[0].first_axis + kPoseAxes;
  for (int k = 0; k < kPoseAxes; ++k)
    CHECK(joint_sigma(rig, both, errors + k) == Approx(k < 3 ? 5e-5 : 0.0005).epsilon(1e-15));
  const std::string text = samples_text(rig, {both});
  CHECK_THAT(text, Contains(R"("joint_sigma": {"flange": {"translation": 5.0e-05, )"));
  CHECK(samples_text(rig, {parse_samples(text, "again.jsonl", rig)[0]}) == text);
  CHECK_THAT(error_of([&] { sample(flange, R"({"flange": 0.1})"); }),
             Contains("samples.jsonl:1: joint_sigma.flange"));
  CHECK_THAT(error_of([&] { sample(flange, R"({"flange": {"translation": 1}})"); }),
             Contains("'rotation' is missing"));

  const Place arm;
  rig = read_rig(arm.rig).rig;
  const int elbow = rig.tree.find_joint("elbow_flex_joint"),
            pan = rig.tree.find_joint("shoulder_pan_joint");
  REQUIRE(rig.joints[elbow].sigma > 0);
  const Sample one =
      sample(R"("elbow_flex_joint": 1, "gripper": 2)", R"({"elbow_flex_joint": 1, "gripper": 3})");
  CHECK(joint_sigma(rig, one, elbow) == Approx(1).epsilon(1e-15));
  CHECK(joint_sigma(rig, one, pan) == rig.joints[pan].sigma);
  rig.joints[elbow].sigma *= 3;  // noise that is estimated moves both
  CHECK(joint_sigma(rig, one, elbow) == Approx(3).epsilon(1e-15));
  const auto fails = [&](const std::string& sigmas) {
    return error_of([&] { sample(R"("elbow_flex_joint": 1)", sigmas); });
  };
  CHECK_THAT(fails(R"({"elbow_flx_joint": 1})"),
             Contains("samples.jsonl:1: joint_sigma.elbow_flx_joint: unknown joint") &&
                 Contains("nearest: elbow_flex_joint"));
  CHECK_THAT(fails(R"({"elbow_flex_joint": 0})"), Contains("joint_sigma.elbow_flex_joint"));
  CHECK_THAT(fails(R"({"elbow_flex_joint": -1})"), Contains("joint_sigma.elbow_flex_joint"));
  CHECK_THAT(fails(R"([1])"), Contains("joint_sigma: a mapping of joint names"));
  rig.joints[elbow].sigma = 0;
  CHECK_THAT(fails(R"({"elbow_flex_joint": 1})"), Contains("state its sigma there"));
}

TEST_CASE("rig: a robot known by the poses of its flange, and back to text") {
  const Place place;
  const std::string text = R"(format: kincal/1
robot: {base: base, flange: tool0}
joints: {flange: {sigma: {translation: 0.0001, rotation: 0.0002}}}
targets: {dot: {type: points, points: [[0, 0, 0]], mount: {link: tool0}}}
sensors: {tracker: {type: point, link: base, sigma: 0.0001}}
)";
  place.write("rig.yaml", text);
  const RigFile file = read_rig(place.rig);
  CHECK(file.flange_only);
  const Tree& tree = file.rig.tree;
  REQUIRE(tree.joints[0].first_axis == 1);
  CHECK(file.rig.joints[7].sigma == 0.0001);
  CHECK(file.rig.joints[10].sigma == 0.0002);
  CHECK(file.rig.joints[1].sigma == 0);
  CHECK(file.rig.joints[7].noise_guess == 0);
  // Nothing of it can be freed, and no name means its axes.
  for (const std::string& name : ParameterTable(file.rig).names())
    CHECK_THAT(name, !Contains("flange"));
  CHECK(ParameterTable(file.rig).select("joint/*").empty());

  const std::string line =
      R"({"id": "a", "joints": {"flange": {"xyz": [0.1, 0.2, 0.3], "quat": [0, 0, 0.6, 0.8]}}, )"
      R"("views": [{"sensor": "tracker", "target": "dot", "points": [[0.1, 0.2, 0.3]]}]})";
  const std::vector<Sample> samples = parse_samples(line, "samples.jsonl", file.rig);
  const std::string written = samples_text(file.rig, samples);
  CHECK_THAT(written, Contains(R"("joints": {"flange": {"xyz": [0.1, 0.2, 0.3], "quat": )"));
  CHECK_THAT(written, !Contains("flange."));
  const std::vector<Sample> again = parse_samples(written, "again.jsonl", file.rig);
  for (size_t j = 1; j < tree.joints.size(); ++j)
    CHECK(again[0].readings[j] == Approx(samples[0].readings[j]).margin(1e-15));

  RigValues values = values_of(file.rig);
  CHECK(rig_text(file, values, "robot.urdf") == rig_text(file, values, "another.urdf"));
  for (int k = 10; k < 13; ++k) values.joint_sigmas[k] = 0.0005;
  const std::string louder = rig_text(file, values, "robot.urdf");
  CHECK_THAT(louder, Contains("{base: base, flange: tool0}"));
  place.write("written.yaml", louder);
  const RigFile read = read_rig((place.directory / "written.yaml").string());
  CHECK(read.rig.joints[12].sigma == 0.0005);
  CHECK(read.rig.joints[9].sigma == 0.0001);

  std::string without = text;
  without.erase(without.find("joints:"), without.find("targets:") - without.find("joints:"));
  // No sigma: unknown, not exact.
  place.write("rig.yaml", without);
  const RigFile unknown = read_rig(place.rig);
  CHECK(unknown.rig.joints[7].noise_guess == kGuessedPoseNoise);
  CHECK(unknown.rig.joints[7].sigma == kGuessedPoseNoise);
}

TEST_CASE("rig: {guess: ...} states no noise, and what was found replaces it") {
  const Place place;
  const auto with = [&](const std::string& joints, const std::string& sigma) {
    place.write("rig.yaml", "format: kincal/1\nrobot: {base: base, flange: tool0}\n" + joints +
                                "targets: {dot: {type: points, points: [[0, 0, 0]], mount: {link: "
                                "base}}}\nsensors: {cam: {type: pose, link: tool0, sigma: " +
                                sigma + "}}\n");
    return read_rig(place.rig);
  };
  const std::string joints =
      "joints: {flange: {sigma: {guess: {translation: 0.0004, rotation: 0.0005}}}}\n";
  const RigFile file = with(joints, "{guess: {translation: 0.002, rotation: 0.003}}");
  CHECK(file.rig.joints[7].noise_guess == 0.0004);
  CHECK(file.rig.joints[10].sigma == 0.0005);
  CHECK(file.rig.sensors[0].sigma == file.rig.sensors[0].noise_guess);
  CHECK(file.rig.sensors[0].sigma[3] == 0.003);
  RigValues values = values_of(file.rig);
  CHECK_THAT(rig_text(file, values, ""), Contains("guess: {translation: 0.002"));
  for (int k = 7; k < 10; ++k) values.joint_sigmas[k] = 0.0006;
  values.sensor_sigmas[0] = {0.001, 0.001, 0.001, 0.003, 0.003, 0.003};
  place.write("written.yaml", rig_text(file, values, ""));
  const RigFile read = read_rig((place.directory / "written.yaml").string());
  CHECK(read.rig.joints[7].sigma == 0.0006);
  CHECK(read.rig.joints[10].sigma == 0.0005);
  CHECK(read.rig.joints[7].noise_guess == 0);
  CHECK(read.rig.sensors[0].sigma == values.sensor_sigmas[0]);
  CHECK(read.rig.sensors[0].noise_guess.empty());
  CHECK_THROWS_WITH(with(joints, "{guess: 0.002}"), Contains("sensors.cam.sigma.guess"));
  CHECK_THROWS_WITH(with(joints, "{guess: {translation: 0.002, rotation: 0.003}, translation: 1}"),
                    Contains("unknown key 'translation'"));
  CHECK_THROWS_WITH(with("joints: {flange: {sigma: {guess: -1}}}\n", "1"), Contains("guess"));
}

TEST_CASE("rig: mistakes with floating joints are named") {
  const Place place;
  const auto fails = [&](const std::string& robot, const std::string& joints) {
    place.write("rig.yaml", "format: kincal/1\nrobot: " + robot + "\njoints: " + joints +
                                "\ntargets: {dot: {type: points, points: [[0, 0, 0]], mount: "
                                "{link: tool0}}}\nsensors: {tracker: {type: point, link: base, "
                                "sigma: 0.0001}}\n");
    try {
      read_rig(place.rig);
    } catch (const std::exception& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  const std::string robot = "{base: base, flange: tool0}";
  CHECK(fails(robot, "{flange: {sigma: {translation: 1e-4, rotation: 0}}}").empty());
  CHECK_THAT(fails(robot, "{flange: {sigma: 0.001}}"),
             Contains("rig.yaml:3") && Contains("joints.flange.sigma"));
  CHECK_THAT(fails(robot, "{flange: {sigma: {translation: 1e-4}}}"), Contains("rotation"));
  CHECK_THAT(fails(robot, "{flange: {offset: 1}}"),
             Contains("joints.flange.offset") && Contains("a pose"));
  CHECK_THAT(fails("{base: base}", "{}"), Contains("flange"));
  CHECK_THAT(fails("{base: tool0, flange: tool0}", "{}"), Contains("two names"));
  CHECK_THAT(fails("{base: base, flange: \"a<b\"}", "{}"), Contains("no < > &"));
  CHECK(fails(robot, "{}").empty());
  const RigFile file = read_rig(place.rig);
  const auto sample = [&](const std::string& reading) {
    try {
      parse_samples("{\"id\": \"a\", \"joints\": {" + reading +
                        "}, \"views\": [{\"sensor\": \"tracker\", \"target\": \"dot\", "
                        "\"points\": [[0, 0, 0]]}]}",
                    "samples.jsonl", file.rig);
    } catch (const std::exception& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  CHECK(sample(R"("flange": {"xyz": [0, 0, 0], "rpy": [0, 0, 0]})").empty());
  CHECK_THAT(sample(R"("flange": 0.3)"),
             Contains("samples.jsonl:1: joints.flange") && Contains("a pose"));
  CHECK_THAT(sample(R"("flange": {"xyz": [0, 0, 0]})"), Contains("a pose"));
  CHECK_THAT(sample(R"("flange": {"xyz": [0, 0, 0], "quat": [1, 1, 0, 0]})"),
             Contains("unit quaternion"));
  CHECK_THAT(sample(""), Contains("needs joint 'flange'"));
  CHECK_THAT(sample(R"("flange.x": 1)"), Contains("needs joint 'flange'"));
}

}  // namespace rig_file_test
