// A joint model that no URDF can express, through the files: from a rig.yaml that names it to the
// result and back.
//
// Proves, with a quadratic model of the test's own: simulated samples of a robot with a planted
// bend are calibrated to it; the result's rig.yaml has the number and reads back; changes.yaml and
// result.json have it; the URDF is proved to hold the rest, its gear's reduction is left alone, and
// a warning says what it lacks; applying the result says so too; a rig without such a joint says
// nothing of models. The automatic path has a group for the numbers, and a joint that never moves
// is named with them. Does not prove: the estimate's sigma
// (tests/models/joints/joint_model_test.cpp), nor what the program prints.
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "../../../io/document/files.h"
#include "../../../io/results/apply.h"
#include "../../../io/results/results.h"
#include "../../../io/rig/samples_file.h"
#include "../../../models/automatic/groups.h"
#include "../../../models/doctor/doctor.h"
#include "../../../models/rig/scales.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/quadratic_joint.h"
#include "../../fixtures/study.h"

namespace joint_model_test {

using namespace kincal;
using namespace kincal::fixture;
using Catch::Matchers::Contains;
namespace fs = std::filesystem;

namespace {

const char* kRobot =
    R"(<robot name="arm"><link name="base"/><link name="upper"/><link name="fore"/><link name="tool"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0.1 0 0.3"/><axis xyz="0 0 1"/>
<limit lower="-1.2" upper="1.2" effort="1" velocity="1"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1.2" upper="1.2" effort="1" velocity="1"/></joint>
<joint name="wrist" type="revolute"><parent link="fore"/><child link="tool"/><origin xyz="0.3 0 0.02"/><axis xyz="1 0 0"/>
<limit lower="-1.2" upper="1.2" effort="1" velocity="1"/></joint>
<transmission name="gear"><type>transmission_interface/SimpleTransmission</type><joint name="elbow"/>
<actuator name="motor"><mechanicalReduction>100</mechanicalReduction></actuator></transmission></robot>
)";

const char* kRig = R"(format: kincal/1
robot: robot.urdf
joints:
  "*": {sigma: 0.0005}
  elbow: {model: quadratic, bend: 0.01}
targets:
  marks: {type: points, points: [[0.1, 0, 0.05], [-0.05, 0, 0.1], [-0.1, 0.05, 0]], mount: {link: tool, pose: {}}}
sensors:
  tracker: {type: point, link: base, sigma: 0.0002, pose: {xyz: [1.5, 0.8, 1], rpy: [0.2, 0.3, 2]}}
estimate:
  - step: all
    free: [joint/elbow/offset, joint/elbow/scale, joint/elbow/bend, sensor/tracker/pose]
)";

struct Place {
  fs::path directory =
      fs::temp_directory_path() / ("kincal_joint_model_test_" + std::to_string(getpid()));
  Place() { fs::create_directories(directory); }
  ~Place() { fs::remove_all(directory); }
  std::string path(const std::string& name) const { return (directory / name).string(); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(directory / name, std::ios::binary) << text;
    return path(name);
  }
};

std::string without_bend(std::string text) {
  for (const std::string part : {"  elbow: {model: quadratic, bend: 0.01}\n", " joint/elbow/bend,"})
    text.erase(text.find(part), part.size());
  return text;
}

/// The rig's samples with a truth of its own.
std::vector<Sample> samples_of(const Rig& rig, double bend) {
  const ParameterTable table(rig);
  VectorXd truth = table.initial;
  const int offset = table.joint_offset[joint_index(rig, "elbow")];
  truth(table.all[offset].start) = 0.02;
  truth(table.all[offset].start + 1) = 1.01;
  if (rig.joints[joint_index(rig, "elbow")].model->size() > 2)
    truth(table.all[offset].start + 2) = bend;
  SimulationOptions options;
  options.samples = 30;
  options.seed = 3;
  return simulate(rig, table, truth, options).samples;
}

const Notice* warning(const Report& report, const std::string& id) {
  for (const Notice& w : report.warnings)
    if (kincal::id(w.kind) == id) return &w;
  return nullptr;
}

}  // namespace

TEST_CASE("joint models through the files: what a URDF cannot express is not lost") {
  const Place place;
  const JointModels models = {linear_joint(), std::make_shared<QuadraticJoint>(0)};
  place.write("robot.urdf", kRobot);
  const RigFile rig = read_rig(place.write("rig.yaml", kRig), "", models);
  REQUIRE(rig.urdf.transmissions.size() == 1);
  const std::vector<Sample> samples = samples_of(rig.rig, 0.04);
  ResultOptions options;
  options.samples_hash = sha256(samples_text(rig.rig, samples));
  options.write_reduction = true;
  const Report report = study_of(rig.rig, samples);
  REQUIRE(report.solution.status == Status::converged);
  const ResultFiles files = make_results(rig, report, options);

  const Notice* lost = warning(report, "joint_model");
  REQUIRE(lost);
  CHECK_THAT(
      sentences(*lost),
      Contains("joint 'elbow': a URDF cannot express its joint model (joint/elbow/bend = 0.0") &&
          Contains("off by up to 0.0") && Contains(" rad in these samples"));
  CHECK(files.reductions.empty());
  CHECK(files.not_in_urdf ==
        std::vector<std::string>{"joint/elbow/scale", "joint/elbow/bend", "sensor/tracker/pose"});
  CHECK_THAT(files.changes_yaml, Contains("joint_models:  # robot.urdf has their offsets only\n") &&
                                     Contains("elbow\": {model: quadratic, scale: 1.0") &&
                                     Contains(", bend: 0.0"));
  CHECK_THAT(files.result_json,
             Contains("\"joint_models\"") && Contains("\"model\": \"quadratic\""));

  place.write("robot.urdf", files.robot_urdf);
  const RigFile calibrated = read_rig(place.write("calibrated.yaml", files.rig_yaml), "", models);
  const JointSettings& elbow = calibrated.rig.joints[joint_index(calibrated.rig, "elbow")];
  const int offset = report.solution.table().joint_offset[joint_index(rig.rig, "elbow")];
  const double* own =
      report.solution.values.shared.data() + report.solution.table().all[offset].start;
  CHECK(elbow.model == models[1]);
  CHECK(elbow.offset == 0);
  CHECK(elbow.scale == own[1]);
  CHECK(elbow.further == std::vector<double>{own[2]});
  CHECK(own[2] == Approx(0.04).margin(0.002));
  for (const SensorResult& sensor : study_of(calibrated.rig, samples).residuals.sensors)
    CHECK(sensor.train.rms_before ==
          Approx(report.residuals.sensors[0].train.rms_as_read).epsilon(1e-9));

  const AppliedResult applied = apply_result(place.write("result.json", files.result_json),
                                             parse_urdf(kRobot, "copy.urdf"), false);
  CHECK(applied.text == files.robot_urdf);
  REQUIRE(applied.notes.size() == 1);
  CHECK_THAT(applied.notes[0], Contains("joint 'elbow'") && Contains("(quadratic, scale = 1.0") &&
                                   Contains(", bend = 0.0"));
}

TEST_CASE("joint models through the files: nothing is said where all joints are linear") {
  const Place place;
  place.write("robot.urdf", kRobot);
  const RigFile rig = read_rig(place.write("rig.yaml", without_bend(kRig)));
  const std::vector<Sample> samples = samples_of(rig.rig, 0);
  ResultOptions options;
  options.samples_hash = sha256(samples_text(rig.rig, samples));
  const Report report = study_of(rig.rig, samples);
  const ResultFiles files = make_results(rig, report, options);
  CHECK_FALSE(warning(report, "joint_model"));
  CHECK(files.reductions.size() == 1);
  CHECK_THAT(files.changes_yaml + files.result_json + files.rig_yaml,
             !Contains("joint_models") && !Contains("model"));
  CHECK(apply_result(place.write("result.json", files.result_json), parse_urdf(kRobot, "copy.urdf"),
                     false)
            .notes.empty());
}

TEST_CASE(
    "joint models: the automatic path has a group for their numbers, and a still joint is named") {
  const Place place;
  const JointModels models = {linear_joint(), std::make_shared<QuadraticJoint>(0)};
  place.write("robot.urdf", kRobot);
  const RigFile rig = read_rig(place.write("rig.yaml", kRig), "", models);
  std::vector<Sample> samples = samples_of(rig.rig, 0.04);
  const Recording recording(rig.rig, samples);
  const AutomaticGroups groups = make_groups(recording, {});
  const auto shapes = std::find_if(groups.groups.begin(), groups.groups.end(),
                                   [](const WidthGroup& group) { return group.name == "shapes"; });
  REQUIRE(shapes != groups.groups.end());
  REQUIRE(shapes->members.size() == 1);
  CHECK(recording.table.name(shapes->members[0].component) == "joint/elbow/bend");
  CHECK(shapes->members[0].start ==
        scales(recording.table, shapes->members[0].component, recording.table.initial).usual);
  CHECK(shapes->unseen.empty());

  for (Sample& sample : samples) sample.readings[joint_index(rig.rig, "elbow")] = 0.3;
  bool named = false;
  const std::optional<Diagnosis> diagnosis = diagnose(rig.rig, samples, {});
  REQUIRE(diagnosis);
  for (const Notice& finding : diagnosis->findings)
    named = named || (finding.kind == NoticeKind::still_joint &&
                      sentences(finding).find("joint/elbow/bend") != std::string::npos);
  CHECK(named);
}

}  // namespace joint_model_test
