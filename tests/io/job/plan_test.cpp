// io/job/plan. Proves: a result without samples is planned from its covariance, as its rig is after
// its samples; what the result did not determine has its usual error, and what it knew exactly
// takes no part; ranges without a sample are those of the curve's values that no sample reaches; a
// rig without poses is refused with their names. Does not prove: that plans are good
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

namespace {

/// A point on a link that turns about z by `limits`, seen by a tracker on the base.
std::string turning(const std::string& sensor_pose) {
  return "{format: kincal/1, robot: robot.urdf, base: base, joints: {turn: {sigma: 0.0003, model: "
         "curve}}, targets: {points: {type: points, points: [[0, 0, 0], [0.1, 0, 0], [0, 0.1, "
         "0.1]], mount: {link: arm, pose: {xyz: [0.3, 0, 0]}}}}, sensors: {tracker: {type: point, "
         "link: base, sigma: 0.0001" +
         sensor_pose +
         "}}, estimate: [{step: all, free: [joint/turn/curve, sensor/tracker/pose], priors: "
         "{joint/turn/curve: 0.0003}}]}";
}

RigFile turning_rig(const std::string& sensor_pose) {
  const Urdf robot = parse_urdf(
      "<robot name='r'><link name='base'/><link name='arm'/><joint name='turn' type='revolute'>"
      "<parent link='base'/><child link='arm'/><axis xyz='0 0 1'/><limit lower='-1.5' upper='2' "
      "effort='1' velocity='1'/></joint></robot>",
      "robot.urdf");
  return parse_rig(turning(sensor_pose), "rig.yaml", &robot);
}

}  // namespace

TEST_CASE("a plan says which angles of an error curve stay without a sample") {
  const RigFile rig = turning_rig(", pose: {xyz: [0, 0, 1]}");
  PlanSettings settings = small_plan();
  const double piece = 2 * kPi / 96;
  std::string postures;  // in every piece from -0.5 to 1, but for a gap of four and one of three
  for (int i = -8; i < 15; ++i)
    if ((i < -2 || i > 1) && (i < 6 || i > 8))
      postures += "{\"id\": \"p" + std::to_string(i) +
                  "\", \"joints\": {\"turn\": " + std::to_string((i + 0.5) * piece) + "}}\n";
  settings.postures = NamedText{"postures", postures};
  settings.next = 100;
  const PosturePlan plan = plan_postures(rig, nullptr, settings, {});
  REQUIRE(plan.unvisited.size() == 1);
  CHECK(plan.unvisited[0].joint == "turn");
  const auto& ranges = plan.unvisited[0].ranges;
  REQUIRE(ranges.size() == 3);
  CHECK(ranges[0].first == -1.5);
  CHECK(ranges[0].second == Approx(-8 * piece));
  CHECK(ranges[1].first == Approx(-2 * piece));
  CHECK(ranges[1].second == Approx(2 * piece));
  CHECK(ranges[2].first == Approx(15 * piece));
  CHECK(ranges[2].second == 2);
  CHECK(plan_json(plan)["unvisited"]["turn"].size() == 3);
  CHECK(plan_text(plan).find("turn: -1.50 to -0.52, -0.13 to 0.13, 0.98 to 2.00") !=
        std::string::npos);
}

TEST_CASE("a plan of a rig without poses says which are missing") {
  CHECK_THROWS_WITH(plan_postures(turning_rig(""), nullptr, small_plan(), {}),
                    Catch::Contains("no value of sensor/tracker/pose") &&
                        Catch::Contains("record some samples first"));
}

}  // namespace plan_test
