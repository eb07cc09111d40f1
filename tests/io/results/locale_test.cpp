// What a host program's locale does to what is written and said: nothing.
// Proven: all files of a result, warnings, judgements and the doctor's words are the same under a
// decimal comma. Not proven: the tables, which only the program prints; it keeps the C locale.
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <regex>

#include "../../../io/results/results.h"
#include "../../../models/doctor/doctor.h"
#include "../../../models/rig/words.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/decimal_comma.h"
#include "../../fixtures/study.h"

namespace locale_test {

using namespace kincal;
using namespace kincal::fixture;
namespace fs = std::filesystem;

namespace {

const char* kSwivel =
    R"(<robot name="swivel"><link name="base"/><link name="arm"/><link name="tool"/>
<joint name="pan" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0.1 0 0.3"/><axis xyz="0 0 1"/>
<limit lower="-1.2" upper="1.2" effort="1" velocity="1"/></joint>
<joint name="tilt" type="revolute"><parent link="arm"/><child link="tool"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1.2" upper="1.2" effort="1" velocity="1"/></joint></robot>
)";
const char* kSwivelRig = R"(format: kincal/1
robot: robot.urdf
joints: {"*": {sigma: 0.0005}}
targets:
  marks: {type: points, points: [[0.1, 0, 0.05], [-0.05, 0, 0.1], [-0.1, 0.05, 0]], mount: {link: tool, pose: {}}}
sensors:
  tracker: {type: point, link: base, sigma: 0.0001, pose: {xyz: [1.5, 0.8, 1], rpy: [0.2, 0.3, 2]}}
)";

/// Everything that is written and said of the rig's calibration with these samples.
std::string everything(const RigFile& rig, const std::vector<Sample>& samples) {
  StudyOptions options;
  Requirement required;
  required.text = "sensor/tracker<0.1um";
  required.quantity = Requirement::Quantity::sensor;
  required.name = "tracker";
  required.limit = 1e-7;
  required.factor = 1e-6;
  required.unit = "um";
  options.requirements = {required};
  const std::optional<Report> report = study(make_recording(rig.rig, samples), options);
  REQUIRE(report);
  const ResultFiles files = make_results(rig, *report, {});
  std::string out = files.robot_urdf + files.rig_yaml + files.changes_yaml + files.covariance_csv +
                    files.residuals_csv;
  out += std::regex_replace(files.result_json, std::regex("\"seconds\": [^\n]*"), "");
  for (const Notice& w : report->warnings) out += with_id(w) + "\n";
  for (const Judgement& j : report->validation.requirements) out += judgement_text(j) + "\n";
  const std::optional<Diagnosis> found = diagnose(rig.rig, samples, {});
  REQUIRE(found);
  for (const Notice& f : found->findings) out += sentences(f) + "\n";
  return out + found->verdict + "\n";
}

}  // namespace

TEST_CASE("locale: a decimal comma of a host program is in no file and no message") {
  const fs::path folder =
      fs::temp_directory_path() / ("kincal_locale_test_" + std::to_string(getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "robot.urdf") << kSwivel;
  std::ofstream(folder / "rig.yaml") << kSwivelRig;
  const RigFile rig = read_rig((folder / "rig.yaml").string());
  const ParameterTable table(rig.rig);
  SimulationOptions options;
  options.samples = 20;
  options.seed = 3;
  VectorXd truth = table.initial;
  truth(table.all[table.joint_offset[1]].start) = 0.02;
  std::vector<Sample> samples = simulate(rig.rig, table, truth, options).samples;
  for (Sample& s : samples) s.readings[0] = -s.readings[0];  // so that the doctor has much to say
  const std::string plain = everything(rig, samples);
  CHECK(text("%.2f", 1234.5) == "1234.50");
  {
    const DecimalComma comma;
    if (!comma.c_too)
      WARN("no locale with a decimal comma for C on this machine: C++ streams only");
    CHECK(text("%.2f", 1234.5) == "1234.50");
    CHECK(everything(rig, samples) == plain);
  }
  fs::remove_all(folder);
}

}  // namespace locale_test
