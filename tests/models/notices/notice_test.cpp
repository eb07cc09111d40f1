// models/notices: the one table of kinds, and how notices become sentences and an order. Proves:
// each kind stands at its own row, ids are unique among mistakes and among warnings, mistakes have
// dashes and warnings underscores; what the doctor looks for; the order of a verdict; sentences of
// both sorts. Does not prove: what is said of data (verdict_test.cpp, doctor_test.cpp,
// tests/program/).
#include "../../../models/notices/notice.h"

#include <catch2/catch.hpp>
#include <set>

namespace notice_test {

using namespace kincal;

namespace {

constexpr auto kLast = static_cast<int>(NoticeKind::undefined_before);

}  // namespace

TEST_CASE("notices: one row a kind, in the order of the kinds") {
  std::set<std::string> mistakes, warnings;
  for (int i = 0; i <= kLast; ++i) {
    const auto kind = static_cast<NoticeKind>(i);
    const std::string name = id(kind);
    CAPTURE(name);
    CHECK(kind_of_row(i) == kind);
    CHECK(name.find(is_mistake(kind) ? '_' : '-') == std::string::npos);
    CHECK((is_mistake(kind) ? mistakes : warnings).insert(name).second);
  }
  CHECK(mistakes.size() == 42);
  CHECK(tested_mistakes().size() == 40);
  CHECK(tested_mistakes().front() == "square");
}

TEST_CASE("notices: severe ones first, then by rank") {
  Notice noise = make_notice(NoticeKind::noise, {}, "noise"),
         width = make_notice(NoticeKind::width, {}, "width"),
         chi2 = make_notice(NoticeKind::chi2, {}, "chi2");
  CHECK(noise.severity == Severity::remark);
  CHECK(before(width, chi2));
  CHECK(before(chi2, noise));
  noise.severity = Severity::doubt;
  CHECK(before(noise, chi2));
  chi2.severity = Severity::fault;
  CHECK(before(chi2, width));
}

TEST_CASE("notices: what explains what") {
  CHECK(explains(NoticeKind::resolution, NoticeKind::points_outside));
  CHECK_FALSE(explains(NoticeKind::points_outside, NoticeKind::resolution));
  CHECK(explains(NoticeKind::joint_sign, NoticeKind::sigma));  // any mistake may
  CHECK_FALSE(explains(NoticeKind::same_samples, NoticeKind::sigma));
  CHECK_FALSE(can_spoil_the_fit(NoticeKind::wrong_sigma));
}

TEST_CASE("notices: sentences of a mistake and of a warning") {
  const Notice mistake =
      make_notice(NoticeKind::joint_sign, {Subject::joint("a")}, "joint 'a' turns the other way",
                  "chi2 is 9 as it is and 1 without this mistake", "change its sign");
  CHECK(sentences(mistake) ==
        "Joint 'a' turns the other way. chi2 is 9 as it is and 1 without this "
        "mistake. Change its sign.");
  CHECK(with_id(mistake).rfind("joint-sign: Joint", 0) == 0);
  Notice warning =
      make_notice(NoticeKind::sigma, {Subject::parameter("sensor/a/pose.x")},
                  "sensor/a/pose.x is known to 2 cm only", "too few turns", "record more");
  CHECK(sentences(warning) ==
        "sensor/a/pose.x is known to 2 cm only. Too few turns. What to do: record more");
  warning.otherwise = "or hold it";
  CHECK(sentences(warning) ==
        "sensor/a/pose.x is known to 2 cm only. Too few turns. What to do: record more; or hold "
        "it");
  CHECK(capital("sensor/a is") == "sensor/a is");
  CHECK(capital("no posture tells it") == "No posture tells it");
  CHECK(names_of(subjects(Subject::Kind::joint, {"b", "a"})) == std::vector<std::string>{"b", "a"});
}

}  // namespace notice_test
