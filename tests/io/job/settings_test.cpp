// io/job, what other languages need. Proves: settings as JSON are what the fields say, and what is
// wrong in them is named; the place of an error is read from every form of message, whatever else
// stands in it; a result from its texts is the one from its folder, and files are looked at by
// neither it nor a rig whose URDF is given; what cannot be compensated, because the numbers are too
// large, leaves the readings as they are. Does not prove: what settings do.
#include <catch2/catch.hpp>
#include <limits>
#include <string>

#include "../../../io/document/files.h"
#include "../../../io/job/robot.h"
#include "../../../io/job/settings.h"
#include "../../../io/results/read_calibrated.h"

namespace settings_test {

using namespace kincal;

namespace {

std::string example(const char* file) {
  return std::string(KINCAL_SOURCE_DIR) + "/examples/pr2/" + file;
}

std::string settings_error(const std::string& json, const std::vector<std::string>& names = {}) {
  try {
    parse_settings(json, names);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("settings are read from JSON and checked") {
  const CalibrateSettings read = parse_settings(
      R"({"noise": "point", "free": ["a", "b"], "fix": "c", "threads": 3, "reject": true})");
  CHECK(read.noise == "point");
  CHECK(read.free == std::vector<std::string>{"a", "b"});
  CHECK(read.fix == std::vector<std::string>{"c"});
  CHECK(read.threads == 3);
  CHECK(read.reject);
  CHECK(read.words == Words::keywords);
  CHECK(parse_settings("{}").noise == "latent");
  CHECK(settings_error(R"({"nose": 1})") ==
        "nose: there is no such option; nearest: noise, estimate_noise");
  CHECK(settings_error(R"({"free": "a"})", {"noise"}).rfind("free: there is no such option", 0) ==
        0);
  CHECK(settings_error(R"({"free": [["a"]]})") == "free: a list of names is expected");
  CHECK(settings_error(R"({"threads": "2"})") == "threads: an integer is expected");
  CHECK(settings_error(R"({"reject": 1})") == "reject: true or false is expected");
  CHECK(settings_error(R"({"holdout": 1})") == "holdout: 1 is not in 2 .. 1000");
  CHECK(settings_error(R"({"noise": "a", "noise": "b"})").find("occurs twice") !=
        std::string::npos);
}

TEST_CASE("the place of an error is read from its message") {
  const auto is = [](const std::string& message, const std::string& file, int line,
                     const std::string& name) {
    const Place place = place_of(message);
    return place.file == file && place.line == line && place.name == name;
  };
  CHECK(is("a/rig.yaml:12: sensors.camera.sigma: is wrong", "a/rig.yaml", 12,
           "sensors.camera.sigma"));
  CHECK(is("samples.jsonl:3: is wrong: so", "samples.jsonl", 3, ""));
  CHECK(is("rig.yaml:3:7: is wrong", "rig.yaml", 3, ""));
  CHECK(is("rig.yaml: is wrong", "rig.yaml", 0, ""));
  CHECK(is("free[0]: 'x' matches none", "", 0, "free"));
  CHECK(is("require 'a<1': is wrong", "", 0, "require"));
  CHECK(is("samples[2].joints.a: is wrong", "", 0, "samples[2].joints.a"));
  CHECK(is("views[0].z: is wrong", "", 0, "views[0].z"));
  CHECK(is("Nothing is said of places", "", 0, ""));
  CHECK(is(std::string(1 << 20, 'a') + ": is wrong", "", 0, ""));  // as long as no name is
  CHECK(is("a.b:99999999999: is wrong", "", 0, ""));
}

TEST_CASE("a result from its texts is the one from its folder") {
  const RigFile rig = read_rig(example("rig.yaml"));
  CalibrateSettings settings;
  settings.step = "arms";
  const SampleSet samples =
      parse_sample_set(read_file(example("samples.jsonl")), "samples.jsonl", rig.rig);
  const FinishedJob done = calibrate_job(rig, samples, settings, {});
  CHECK(why_no_start(done.report).empty());
  const std::string folder = std::string(KINCAL_BINARY_DIR) + "/settings_test_result";
  REQUIRE(write_results(folder, done.files, true, nullptr));
  const CalibratedFiles a = read_calibrated(folder), b = parse_calibrated(done.files);
  CHECK(a.status == b.status);
  CHECK(a.values == b.values);
  CHECK(a.sigma == b.sigma);
  REQUIRE(b.unknowns);
  CHECK(a.unknowns->columns == b.unknowns->columns);
  CHECK(a.unknowns->covariance == b.unknowns->covariance);

  ResultFiles fewer = done.files;
  fewer.robot_urdf.clear();
  CHECK_THROWS_WITH(parse_calibrated(fewer, "here"),
                    Catch::Contains("here/rig.yaml:") && Catch::Contains("robot: the text of"));
  fewer = done.files;
  fewer.covariance_csv.clear();
  CHECK_THROWS_WITH(state_of(parse_calibrated(fewer)), Catch::Contains("has no covariance"));
}

TEST_CASE("what cannot be compensated leaves the readings as they are") {
  const KnownRig rig(read_rig(example("rig.yaml")));
  Postures postures;
  postures.joints = joint_names(rig.file.rig);
  std::vector<double> values(postures.joints.size(), 1e300);
  postures.values = values.data();
  postures.rows = 1;
  const std::string tip = "l_wrist_roll_link", base = rig.file.rig.tree.links[rig.file.rig.base];
  const std::vector<Compensated> found = compensate_postures(rig, rig, postures, {tip, base});
  REQUIRE(found.size() == 1);
  REQUIRE(found[0].readings.size() == rig.file.rig.tree.joints.size());
  CHECK(found[0].readings[rig.file.rig.tree.find_joint(postures.joints[0])] == 1e300);
}

}  // namespace settings_test
