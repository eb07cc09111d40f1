// Poses that a rig leaves away and that the automatic path holds, in the rig that it writes.
//
// Proves, with the cameras of a rectified pair, which the joint above them moves: the result's
// rig.yaml gives their poses, the identity, so that they are not estimated again from data that are
// to judge them; of what no sample shows it gives none. Does not prove: where the joint is
// (tests/models/automatic/).
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "../../../io/results/results.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/study.h"

namespace held_poses_test {

using namespace kincal;
using namespace kincal::fixture;
using Catch::Matchers::Contains;
namespace fs = std::filesystem;

namespace {

const char* kRobot =
    R"(<robot name="head"><link name="base"/><link name="neck"/><link name="head"/><link name="optical"/>
<joint name="pan" type="revolute"><parent link="base"/><child link="neck"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint>
<joint name="tilt" type="revolute"><parent link="neck"/><child link="head"/><origin xyz="0.05 0 0.1"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint>
<joint name="rig_joint" type="fixed"><parent link="head"/><child link="optical"/>
<origin xyz="0.1 0.05 0.02" rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint></robot>
)";
const char* kRig = R"(format: kincal/1
robot: robot.urdf
joints: {"*": {sigma: 0.0001}}
targets:
  near: {type: chessboard, rows: 6, columns: 8, square: 0.04, mount: {link: base, pose: {xyz: [1.2, 0.1, 0.4], rpy: [1.5, 0.3, 1.5]}}}
  far: {type: chessboard, rows: 6, columns: 8, square: 0.05, mount: {link: base, pose: {xyz: [1.5, -0.4, 0.9], rpy: [1.5, -0.4, 1.5]}}}
sensors:
  left: {type: camera, model: pinhole, link: optical, intrinsics: [500, 500, 320, 240], image_size: [640, 480], sigma: 0.2}
  right: {type: camera, model: pinhole, link: optical, intrinsics: [500, 500, 320, 240], baseline: 0.1, image_size: [640, 480], sigma: 0.2}
  spare: {type: camera, model: pinhole, link: neck, intrinsics: [500, 500, 320, 240], image_size: [640, 480], sigma: 0.2}
)";

/// What both cameras see of the boards, the joint above them moved by so much along x.
std::vector<Sample> seen(const Rig& rig, double moved, int count, unsigned seed) {
  const ParameterTable table(rig);
  VectorXd truth = table.initial;
  truth(table.all[table.joint_origin[rig.tree.find_joint("rig_joint")]].start + 9) += moved;
  SimulationOptions options;
  options.samples = count;
  options.seed = seed;
  options.pairs = {{0, 0}, {1, 0}, {0, 1}, {1, 1}};
  return simulate(rig, table, truth, options).samples;
}

}  // namespace

TEST_CASE("held poses: the cameras of a rectified pair have theirs in the rig that is written") {
  const fs::path folder =
      fs::temp_directory_path() / ("kincal_held_poses_test_" + std::to_string(getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "robot.urdf") << kRobot;
  std::ofstream(folder / "rig.yaml") << kRig;
  const RigFile rig = read_rig((folder / "rig.yaml").string());
  const Report report = study_of(rig.rig, seen(rig.rig, 0.004, 30, 1));
  REQUIRE(report.solution.status == Status::converged);
  const ResultFiles files = make_results(rig, report, {});
  std::ofstream(folder / "robot.urdf") << files.robot_urdf;
  std::ofstream(folder / "calibrated.yaml") << files.rig_yaml;
  const Rig written = read_rig((folder / "calibrated.yaml").string()).rig;
  fs::remove_all(folder);

  INFO(files.rig_yaml);
  CHECK(written.sensors[0].pose_given);
  CHECK(written.sensors[1].pose_given);
  CHECK_FALSE(written.sensors[2].pose_given);  // nobody knows where it is
  const auto judged = [&](double moved) {
    return evaluate(Recording(written, seen(rig.rig, moved, 15, 2)), NoiseMode::latent, {});
  };
  const Evaluation same = judged(0.004), another = judged(0.009);
  CHECK(same.open.empty());
  CHECK(same.chi2 < 1.3 * static_cast<double>(same.dof));
  CHECK(another.chi2 > 3 * static_cast<double>(another.dof));  // 5 mm, mostly along the view
}

}  // namespace held_poses_test
