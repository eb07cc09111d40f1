// A robot that watches itself: kincal embedded by one header, without files. The class is the
// library's promise to embedders: what it needs is one include and thirty lines. Usage:
// head_calibrator
#include <kincal/kincal.h>

#include <cmath>
#include <cstdio>

class HeadCalibrator {
 public:
  HeadCalibrator(kincal::Rig rig, std::vector<kincal::Sample> samples)  // throws: wrong input
      : calibration_(kincal::make_recording(std::move(rig), std::move(samples)), options()) {}
  void saw(int slot, const kincal::Sample& sample) {
    calibration_.replace(slot, sample);
  }  // same shape: no allocation
  bool recalibrate(kincal::Tree& robot) {
    const kincal::Solution& solution =
        calibration_.solve();  // warm: starts where the last one ended
    if (!solution.usable())
      return say(solution.message), false;  // undefined start, not converged, cancelled
    const kincal::ParameterEstimate& elbow =
        calibration_.last()["joint/elbow/offset"];  // its sigma is made when it is asked for
    if (elbow.sigma[0] > 1e-3) return say("the elbow is weakly determined"), false;
    robot = solution.tree();  // offsets folded into the origins
    camera_ = solution.pose("sensor/head_camera/pose");
    return true;
  }
  std::string doubts() {  // slow path, when somebody asks
    const kincal::Linearisation at = kincal::linearise(calibration_.last());
    const kincal::Explanation weak = kincal::explain(at);
    return weak.text() + kincal::noise_levels(at).text();
  }
  const kincal::Pose& camera() const { return camera_; }

 private:
  static kincal::CalibrationOptions options() {
    kincal::CalibrationOptions o;
    o.threads = 1;
    return o;
  }
  static void say(const std::string& why) { std::fprintf(stderr, "%s\n", why.c_str()); }
  kincal::Calibration calibration_;
  kincal::Pose camera_;
};

namespace {

/// base -shoulder(z)- upper -elbow(z)- hand with a board in it, and a camera on the base that looks
/// at it.
kincal::Rig robot() {
  kincal::Rig rig;
  rig.tree.links = {"base", "upper", "hand"};
  const auto add = [&](const char* name, int parent, int child, const kincal::Vector3d& xyz) {
    kincal::Joint joint;
    joint.name = name;
    joint.type = kincal::JointType::revolute;
    joint.parent = parent;
    joint.child = child;
    joint.axis = kincal::Vector3d::UnitZ();
    joint.parent_T_joint.translation = xyz;
    joint.lower = -0.6;
    joint.upper = 0.6;
    rig.tree.joints.push_back(joint);
  };
  add("shoulder", 0, 1, {0, 0, 0});
  add("elbow", 1, 2, {0.4, 0, 0});
  kincal::finish_tree(rig.tree);
  rig.joints.resize(2);
  for (kincal::JointSettings& joint : rig.joints) joint.sigma = 2e-5;

  kincal::Target board;
  board.name = "board";
  board.type = "chessboard";
  board.layout = kincal::grid_layout({kincal::GridLayout::Kind::corners, 5, 7});
  board.square = 0.02;
  board.link = 2;
  board.link_T_target.translation = {0.3, -0.06, 0};
  board.pose_given = true;
  rig.targets = {board};

  kincal::Sensor camera;
  camera.name = "head_camera";
  camera.type = "camera";
  camera.link = 0;
  camera.link_T_sensor.rotation = kincal::exp_so3({0, 0, 0.1});
  camera.link_T_sensor.translation = {0.6, 0, -0.9};
  camera.pose_given = true;
  camera.model = kincal::make_camera(kincal::Lens::pinhole, 0);
  camera.parameters = kincal::camera_parameters(kincal::Lens::pinhole, {500, 500, 400, 300}, {}, 0);
  camera.sigma = {0.1, 0.1};
  camera.image_width = 800;
  camera.image_height = 600;
  rig.sensors = {camera};

  kincal::Step step;
  step.name = "head";
  step.sensors = {0};
  step.free = {"sensor/head_camera/pose", "joint/elbow/offset"};
  rig.steps = {step};
  return rig;
}

std::vector<kincal::Sample> seen_by(const kincal::Rig& rig, double elbow, std::uint64_t seed) {
  const kincal::ParameterTable table(rig);
  kincal::VectorXd truth = table.initial;
  truth(table.all[table.joint_offset[1]].start) = elbow;
  kincal::SimulationOptions options;
  options.seed = seed;
  options.samples = 20;
  return kincal::simulate(rig, table, truth, options).samples;
}

bool near(double a, double b, double tolerance) { return std::abs(a - b) < tolerance; }

}  // namespace

int main() {
  const kincal::Rig rig = robot();
  const std::vector<kincal::Sample> before = seen_by(rig, 0.02, 1), after = seen_by(rig, -0.01, 2);
  HeadCalibrator head(rig, before);
  kincal::Tree calibrated;
  if (!head.recalibrate(calibrated)) return 1;
  const auto folded = [&] {
    return kincal::log_so3(calibrated.joints[1].parent_T_joint.rotation).z();
  };
  if (!near(folded(), 0.02, 1e-3)) return std::fprintf(stderr, "elbow %.6f\n", folded()), 1;
  for (size_t i = 0; i < after.size(); ++i)
    head.saw(static_cast<int>(i), after[i]);  // the elbow was bent by 30 mrad
  if (!head.recalibrate(calibrated)) return 1;
  if (!near(folded(), -0.01, 1e-3)) return std::fprintf(stderr, "elbow %.6f\n", folded()), 1;
  HeadCalibrator fresh(rig, after);  // a warm start ends where one from the rig's values does
  kincal::Tree other;
  if (!fresh.recalibrate(other)) return 1;
  const double apart =
      (calibrated.joints[1].parent_T_joint.rotation - other.joints[1].parent_T_joint.rotation)
          .norm();
  if (!(apart < 1e-9)) return std::fprintf(stderr, "warm and fresh are %.3g apart\n", apart), 1;
  std::printf("elbow %.6f rad, camera %.4f m above the base; doubts: %s\n", folded(),
              head.camera().translation.z(), head.doubts().c_str());
  return 0;
}
