// models/report/{verdict,warnings}.h on reports made by hand: what is good, doubtful or of no use,
// and one warning a kind. Proves: the bounds of a mount, of chi2/dof with and without a finding and
// a loss; that a kind of warning counts its cases, words the worst and names all; that poses which
// the rig leaves open are warned of only where the run did not converge; that after a step that did
// not converge only the first cause is left. Does not prove: the words on real data
// (tests/program/verdict_test.py).
#include "../../../models/report/verdict.h"

#include <catch2/catch.hpp>
#include <memory>

#include "../../../models/report/parameter_warnings.h"
#include "../../../models/report/warnings.h"
#include "../../fixtures/rigs.h"

namespace verdict_test {

using namespace kincal;
using namespace kincal::fixture;
using Catch::Matchers::Contains;
using Catch::Matchers::StartsWith;

namespace {

/// A result that converged, with chi2/dof as given and nothing to say of it.
Report converged(double chi2_per_dof) {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "turn", "base", "tool", {0, 0, 1}, Pose{}, 0.001);
  finish_tree(rig.tree);
  Report out;
  out.solution.recording = make_recording(rig, {});
  out.solution.dof_data = 1000;
  out.solution.chi2_data = 1000 * chi2_per_dof;
  return out;
}

ParameterEstimate mount(const std::string& name, double metres, double radians) {
  ParameterEstimate out;
  out.name = name;
  out.components = {"x", "y", "z", "rx", "ry", "rz"};
  out.units = {"m", "m", "m", "rad", "rad", "rad"};
  out.initial = out.value = out.prior = std::vector<double>(6, 0.0);
  out.sigma = {metres, 1e-4, 1e-4, radians, 1e-4, 1e-4};
  out.pose = Pose{};
  return out;
}

Verdict judged(Report& report) {
  report.warnings = warnings(report);
  return verdict(report);
}

std::string words(const Report& report) { return sentences(verdict(report)); }

/// What is said of a model that does not explain the data; "": nothing.
std::string unexplained(const Report& report) {
  const std::optional<Notice> out = why_unexplained(report);
  return out ? sentences(*out) : "";
}

std::vector<std::string> ids(const Report& report) {
  std::vector<std::string> out;
  for (const Notice& w : report.warnings) out.emplace_back(id(w.kind));
  return out;
}

using Names = std::vector<std::string>;

}  // namespace

TEST_CASE("verdict: good, doubts, and no") {
  Report report = converged(1.01);
  CHECK(judged(report).use == "good");
  CHECK(words(report) == "converged; residuals as large as the noise (chi2/dof 1.01)");

  report = converged(2);
  CHECK(judged(report).use == "doubts");
  CHECK_THAT(words(report), StartsWith("chi2/dof is 2: "));

  report = converged(1);
  report.solution.parameters = {mount("sensor/eye/pose", 0.02, 0.001)};
  CHECK(judged(report).use == "doubts");
  CHECK(ids(report) == Names{"sigma"});
  report.solution.parameters.push_back(mount("sensor/ear/pose", 0.031, 0.001));
  CHECK(judged(report).use == "no");
  CHECK_THAT(words(report), Contains("worst sensor/ear/pose.x is known to 0.031 m only"));
  report.solution.parameters.push_back(mount("sensor/nose/pose", 0.001, 0.06));
  CHECK_THAT((judged(report), words(report)),
             Contains("worst sensor/nose/pose.rx is known to 3.44 degrees only"));

  // What was found, or a group far from usual, goes before poses that are loose because of it.
  const std::vector<ParameterEstimate> loose = report.solution.parameters;
  const std::string besides = "Only then consider that 3 parameters are known to no better";
  report = converged(1);
  report.solution.parameters = loose;
  report.automatic.resize(1);
  report.automatic[0].name = "offsets";
  report.automatic[0].factor = report.automatic[0].widest = 112;
  CHECK(judged(report).use == "no");
  CHECK_THAT(words(report), StartsWith("parameters of group 'offsets' are off by 112 times"));
  CHECK_THAT(words(report), Contains(besides));
  report.diagnosis.emplace();
  report.diagnosis->findings = {make_notice(NoticeKind::home_position, {Subject::joint("a")},
                                            "joint 'a' counts from elsewhere", "", "turn it")};
  report.solution.status = Status::unobservable;  // as of a pose that is open
  report.solution.message = sentences(*loose_parameters(report));
  CHECK(judged(report).use == "no");
  CHECK_THAT(words(report), StartsWith("a mistake was found, home-position: joint 'a' counts from "
                                       "elsewhere. The result may have absorbed it. "));
  CHECK_THAT(words(report), Contains(besides));

  report = converged(1);
  report.solution.parameters = {mount("sensor/eye/pose", kNan, 0.001)};  // of an earlier step
  CHECK(judged(report).use == "doubts");
  CHECK_THAT(words(report), Contains("not determined: sensor/eye/pose.x"));

  report = converged(1);
  report.automatic.resize(1);
  report.automatic[0].unseen.resize(2);
  report.automatic[0].unseen[0].name = "joint/a/offset";
  report.automatic[0].unseen[1].name = "joint/b/offset";
  CHECK(judged(report).use == "good");
  CHECK(judged(report).next.empty());
  CHECK(judged(report).reasons.empty());
  REQUIRE(notes(judged(report)).size() == 1);
  CHECK_THAT(notes(judged(report))[0], StartsWith("2 of 2 parameters kept at their"));
  CHECK_THAT(
      words(report),
      Contains("; 2 of 2 parameters kept at their nominal values are not determined by the "
               "data (predicted errors account for this): joint/a/offset and joint/b/offset"));
}

TEST_CASE("verdict: a model that does not explain the data") {
  Report report = converged(99);
  CHECK(unexplained(report).empty());
  report = converged(101);
  CHECK_THAT(unexplained(report), Contains("An understated noise is likelier"));
  report.misfits.samples = {{100, "'s3'"}};
  CHECK_THAT(unexplained(report), Contains("(far larger residuals than the others have 's3')"));
  report.diagnosis = Diagnosis{};
  report.diagnosis->readings = "Errors of the joint readings would.";
  CHECK_THAT(unexplained(report), Contains("Errors of the joint readings would."));

  report = converged(26);
  report.diagnosis = Diagnosis{};
  report.diagnosis->findings = {make_notice(NoticeKind::square, {}, "the size is wrong")};
  CHECK(unexplained(report).empty());  // no fit says that it explains anything
  report.diagnosis->findings[0].chi2_corrected = 1000;
  CHECK_THAT(unexplained(report),
             Contains("A mistake is likelier than an understated noise: square: the size"));
  report.solution.chi2_data = 24000;
  CHECK(unexplained(report).empty());
  report.solution.chi2_data = 1e6;
  report.solution.status = Status::not_converged;
  CHECK(unexplained(report).empty());
}

TEST_CASE("warnings: one of a kind, counted, the worst in words") {
  Report report = converged(1);
  for (int i = 0; i < 7; ++i) {
    ParameterEstimate e;
    e.name = "joint/j" + std::to_string(i) + "/offset";
    e.components = {""};
    e.units = {"rad"};
    e.initial = {0};
    e.value = {i == 4 ? -0.9 : 0.4};
    e.sigma = {0.001};
    e.prior = {0.1};
    report.solution.parameters.push_back(e);
  }
  judged(report);
  REQUIRE(ids(report) == Names{"prior"});
  CHECK(sentences(report.warnings[0]) ==
        "7 parameters are more than 3 prior sigmas from their priors, worst joint/j4/offset is "
        "-9.0 prior sigmas from its prior; then joint/j0/offset, joint/j1/offset, joint/j2/offset "
        "and 3 more. What to do: check which of the two is wrong, the prior or the data");
  CHECK(report.warnings[0].where.size() == 7);
  report.solution.parameters.resize(1);
  judged(report);
  CHECK(sentences(report.warnings[0]) ==
        "joint/j0/offset is 4.0 prior sigmas from its prior. What to do: check which of the two is "
        "wrong, the prior or the data");
}

TEST_CASE("warnings: poses that the rig leaves open, and what is left where nothing converged") {
  Report report = converged(1);
  report.solution.parameters = {mount("sensor/eye/pose", 0.02, 0.001)};
  report.solution.parameters[0].value[0] = 0.5;
  report.solution.parameters[0].value[4] = 1;
  judged(report);
  CHECK(ids(report) == Names{"sigma", "moved"});
  CHECK_THAT(sentences(report.warnings[1]),
             StartsWith("sensor/eye/pose moved by 0.5 m and turned by 57.3 degrees from its"));
  report.solution.computed_starts = report.solution.lost_starts = {"sensor/eye/pose"};
  judged(report);
  CHECK(ids(report) == Names{"sigma"});

  report.solution.status = Status::not_converged;
  StepResult first, second;
  first.name = "first";
  second.name = "second";
  first.iterations = second.iterations = 200;
  report.solution.steps = {first, second};
  CHECK(judged(report).use == "no");
  CHECK(ids(report) == Names{"not_converged", "no_start"});
  CHECK_THAT(sentences(report.warnings[0]),
             StartsWith("step 'first' did not converge in 200 iterations. What to do: "));
  CHECK(words(report) == sentences(report.warnings[0]));
}

TEST_CASE("verdict: a joint homed anew or an effect of its angle goes before the noise it makes") {
  for (const NoticeKind cause : {NoticeKind::jump, NoticeKind::systematic}) {
    Report report = converged(1);
    report.warnings = {make_notice(cause, {}, "the errors of joint 'turn' are no noise")};
    report.diagnosis = Diagnosis();
    report.diagnosis->findings = {make_notice(NoticeKind::wrong_sigma, {}, "a sigma differs")};
    CHECK_THAT(words(report), StartsWith("the errors of joint 'turn' are no noise"));
    report.diagnosis->findings = {make_notice(NoticeKind::degrees, {}, "readings are degrees")};
    CHECK_THAT(words(report), StartsWith("a mistake was found, degrees"));
    report.diagnosis.reset();
    Notice unexplained = make_notice(NoticeKind::unexplained, {}, "the model does not explain");
    report.warnings.insert(report.warnings.begin(), unexplained);
    CHECK_THAT(words(report), StartsWith("the errors of joint 'turn' are no noise"));
    report.warnings.front().cause = NoticeKind::degrees;
    CHECK_THAT(words(report), StartsWith("the model does not explain"));
  }
}

TEST_CASE("verdict: a harmless finding does not hide a decisive warning") {
  Report report = converged(1);
  report.automatic.resize(1);
  report.automatic[0].name = "offsets";
  report.automatic[0].widest = 17;
  report.diagnosis.emplace();
  report.diagnosis->findings = {make_notice(NoticeKind::same_samples, {Subject::sample("again")},
                                            "samples '01' and 'again' are the same", "",
                                            "leave out all but one")};
  report.diagnosis->findings[0].severity = Severity::remark;  // one of many
  report.input = report.diagnosis->findings;
  const Verdict verdict = judged(report);
  CHECK(ids(report) == Names{"width", "duplicates"});
  CHECK(verdict.use == "doubts");
  CHECK(verdict.about == std::vector<NoticeKind>{NoticeKind::width});
  CHECK(verdict.why == "parameters of group 'offsets' are off by 17 times the usual amount");
  CHECK(verdict.reasons == Names{"they may absorb a mistake in the rig or the data"});
  REQUIRE(verdict.next.size() == 2);
  CHECK_THAT(verdict.next[0], StartsWith("compare the rig's values of these parameters"));
  CHECK(verdict.see == std::vector<NoticeKind>{NoticeKind::duplicates});

  report.diagnosis->findings[0].severity = Severity::doubt;  // much of the data
  CHECK(judged(report).about == std::vector<NoticeKind>{NoticeKind::same_samples});
}

}  // namespace verdict_test
