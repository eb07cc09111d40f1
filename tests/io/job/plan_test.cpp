// io/job/plan. Proves: a result without samples is planned from its covariance, as its rig is after
// its samples; what the result did not determine has its usual error, and what it knew exactly
// takes no part. Does not prove: that plans are good
// (tests/models/design, program/plan_test.py).
#include <catch2/catch.hpp>
#include <string>

#include "../../../io/document/files.h"
#include "../../../io/job/plan.h"

namespace plan_test {

using namespace kincal;

namespace {

std::string pr2(const char* file) {
  return std::string(KINCAL_SOURCE_DIR) + "/examples/pr2/" + file;
}

PlanSettings small_plan() {
  PlanSettings settings;
  settings.next = 5;
  settings.candidates = 100;
  settings.clearance = -1;
  return settings;
}

PosturePlan planned(const RigFile& rig, const SampleSet* samples,
                    const std::optional<KnownRobot>& known, const std::string& goal) {
  PlanSettings settings = small_plan();
  settings.known = known;
  settings.goal = goal;
  return plan_postures(rig, samples, settings, {});
}

}  // namespace

TEST_CASE("a result is planned from its covariance") {
  const RigFile rig = read_rig(pr2("rig.yaml"));
  const SampleSet samples = parse_sample_set(read_file(pr2("samples.jsonl")), "s", rig.rig);
  const CalibrateSettings calibrate;
  Job job = make_job(rig, samples, calibrate);
  const Report report = run(job, calibrate, false, {});
  const ResultFiles texts = make_texts(job, report, calibrate);
  const CalibratedFiles files = parse_calibrated(texts, "result");
  std::optional<KnownRobot> known = known_robot(files, texts.samples_csv);
  REQUIRE(known);
  CHECK(known->stood.size() == report.solution.training().size());

  const std::string goal = "parameters";
  const PosturePlan after_samples = planned(rig, &samples, {}, goal);
  const PosturePlan after_result = planned(files.rig_file, nullptr, known, goal);
  CHECK(after_result.postures.size() == 5);
  CHECK(after_result.forecast.front().planned ==
        Approx(after_samples.forecast.front().planned).epsilon(0.02));
  CHECK(after_result.forecast.back().planned ==
        Approx(after_samples.forecast.back().planned).epsilon(0.02));
  CHECK(planned(rig, nullptr, {}, goal).forecast.front().planned >
        10 * after_result.forecast.front().planned);

  Unknowns& unknowns = *known->robot.unknowns;
  const std::string name = files.table.name(unknowns.columns[0]);
  const double error = planned(files.rig_file, nullptr, known, name).forecast.front().planned;
  unknowns.covariance.row(0).setZero();
  unknowns.covariance.col(0).setZero();
  CHECK_THROWS_WITH(planned(files.rig_file, nullptr, known, name),
                    Catch::Contains("matches no") ||
                        Catch::Contains("nothing that this calibration estimates changes it"));
  unknowns.undetermined.setZero(unknowns.covariance.rows(), 1);
  unknowns.undetermined(0, 0) = 1;
  CHECK(planned(files.rig_file, nullptr, known, name).forecast.front().planned > 10 * error);
}

}  // namespace plan_test
