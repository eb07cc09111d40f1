// io/job. Proves: a rig, its robot and its samples as texts make the job and the result that files
// make; the words of messages are those of a program (--no-group) or of keywords (no_group);
// settings that no program checked are refused by name. Does not prove: that the program's results
// are the same as before (scripts/same-results), nor anything of calibrations.
#include <catch2/catch.hpp>
#include <functional>
#include <string>

#include "../../../io/document/files.h"
#include "../../../io/job/check.h"
#include "../../../io/job/job.h"

namespace job_test {

using namespace kincal;

namespace {

std::string pr2(const char* file) {
  return std::string(KINCAL_SOURCE_DIR) + "/examples/pr2/" + file;
}

std::string job_error(const std::function<void()>& work) {
  try {
    work();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

ResultFiles calibrated(const RigFile& rig, const SampleSet& samples) {
  CalibrateSettings settings;
  settings.step = "arms";
  Job job = make_job(rig, samples, settings);
  const Report report = run(job, settings, false, {});
  return make_texts(job, report, settings);
}

}  // namespace

TEST_CASE("a job of texts is that of the files") {
  const std::string text = read_file(pr2("samples.jsonl"));
  const RigFile by_path = read_rig(pr2("rig.yaml"));
  const Urdf robot = parse_urdf(read_file(pr2("robot.urdf")), "elsewhere.urdf");
  const RigFile by_text = parse_rig(read_file(pr2("rig.yaml")), "nowhere/rig.yaml", &robot);
  CHECK(by_text.path == "nowhere/rig.yaml");
  CHECK(by_text.urdf.path == "elsewhere.urdf");
  const SampleSet a = parse_sample_set(text, pr2("samples.jsonl"), by_path.rig),
                  b = parse_sample_set(text, "b", by_text.rig);
  CHECK(a.hash == sha256(text));
  const ResultFiles one = calibrated(by_path, a), other = calibrated(by_text, b);
  CHECK(one.robot_urdf == other.robot_urdf);
  CHECK(one.rig_yaml == other.rig_yaml);
  CHECK(one.covariance_csv == other.covariance_csv);
  CHECK(one.residuals_csv == other.residuals_csv);
  CHECK(make_page(one).find("kincal-report-data") != std::string::npos);
}

TEST_CASE("a rig of a text without its robot's looks for the file that it names") {
  CHECK(job_error([] {
          parse_rig(read_file(pr2("rig.yaml")), "nowhere/rig.yaml");
        }).find("robot: file 'nowhere/robot.urdf' does not exist") != std::string::npos);
  // Of a robot that is known by its flange only another one is not looked at.
  const Urdf robot = parse_urdf(read_file(pr2("robot.urdf")), "robot.urdf");
  const RigFile flange = parse_rig(
      "{format: kincal/1, robot: {base: b, flange: f}, targets: {t: {type: points, points: [[0, 0, "
      "0]], mount: {link: b}}}, sensors: {s: {type: point, link: f, sigma: 0.001}}}",
      "rig", &robot);
  CHECK(flange.flange_only);
  CHECK(flange.urdf.robot == "f");
}

TEST_CASE("messages name options in the words of who asks") {
  CHECK(option_name("no_group", Words::switches) == "--no-group");
  CHECK(option_name("no_group", Words::keywords) == "no_group");
  CHECK(in_words("free[2]: 'x' matches no parameter", Words::switches) ==
        "--free: 'x' matches no parameter");
  CHECK(in_words("free[2]: 'x' matches no parameter", Words::keywords) ==
        "free[2]: 'x' matches no parameter");
  CHECK(in_words("last_step: nothing", Words::switches) == "--step: nothing");
  CHECK(in_words("last_step: nothing", Words::keywords) == "step: nothing");
  CHECK(in_words("see `check`, `no_group` and `free`", Words::switches) ==
        "see kincal check, --no-group and --free");
  CHECK(in_words("see `check`, `no_group` and `free`", Words::keywords) ==
        "see kincal.check(), no_group and free");

  const RigFile rig = read_rig(pr2("rig.yaml"));
  const SampleSet samples = parse_sample_set(read_file(pr2("samples.jsonl")), "s", rig.rig);
  CalibrateSettings settings;
  settings.require = {"wide_left<1"};
  for (const Words words : {Words::switches, Words::keywords}) {
    settings.words = words;
    const std::string want = words == Words::switches ? "--require 'wide" : "require 'wide";
    CHECK(job_error([&] {
            Job job = make_job(rig, samples, settings);
            run(job, settings, false, {});
          }).rfind(want, 0) == 0);
  }
}

TEST_CASE("settings that no program has checked are refused by name") {
  CalibrateSettings settings;
  check_settings(settings);
  settings.noise = "late";
  CHECK(job_error([&] { check_settings(settings); }) ==
        "noise: unknown value 'late'; valid: latent, marginal, none, point");
  settings.noise = "point";
  settings.holdout = 1;
  CHECK(job_error([&] { check_settings(settings); }) == "holdout: 1 is not in 2 .. 1000");
}

TEST_CASE("a job that is cancelled ends there") {
  const RigFile rig = read_rig(pr2("rig.yaml"));
  const SampleSet samples = parse_sample_set(read_file(pr2("samples.jsonl")), "s", rig.rig);
  int told = 0;
  const Progress third([&](const Progress::News&) { return ++told < 3; });
  CalibrateSettings settings;
  Job job = make_job(rig, samples, settings);
  CHECK_THROWS_AS(run(job, settings, true, third), Cancelled);
  told = 0;
  DoctorOptions options;
  options.progress = third;
  CHECK_THROWS_AS(check_samples(rig, samples, options, Words::keywords), Cancelled);
}

}  // namespace job_test
