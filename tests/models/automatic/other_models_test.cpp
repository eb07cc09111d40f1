// models/automatic/other_models: what is told of other models of the same data.
//
// Proves: a model is told from odds of 99 on, unless one of another kind is likelier by more than
// 9; a length in place of sizes is told where it is as likely as they are.
// Does not prove: that the evidence of the models is right (newcomer_test.py, mistakes_test.py and
// automatic_test.py plant each of them and find it).
#include "../../../models/automatic/other_models.h"

#include <catch2/catch.hpp>
#include <cmath>

namespace other_models_test {

using namespace kincal;

namespace {

OtherModel model(NoticeKind kind, double odds, size_t about = 1) {
  OtherModel out;
  out.kind = kind;
  out.log_odds = std::log(odds);
  for (size_t i = 0; i < about; ++i) out.where.push_back(Subject::parameter(std::to_string(i)));
  return out;
}

}  // namespace

TEST_CASE("other models: told by their odds") {
  const OtherModel scale = model(NoticeKind::arm_scale, 100);
  CHECK(told_models({scale}, NoticeKind::arm_scale).size() == 1);
  CHECK(told_models({model(NoticeKind::arm_scale, 98)}, NoticeKind::arm_scale).empty());
  CHECK(told_models({scale}, NoticeKind::intrinsics).empty());
  SECTION("not where another kind is likelier by far") {
    CHECK(told_models({scale, model(NoticeKind::link_length, 800)}, NoticeKind::arm_scale).size() ==
          1);
    CHECK(
        told_models({scale, model(NoticeKind::link_length, 1000)}, NoticeKind::arm_scale).empty());
    CHECK(told_models({scale, model(NoticeKind::arm_scale, 1e6)}, NoticeKind::arm_scale).size() ==
          2);
  }
  SECTION("a length in place of sizes: where it is as likely") {
    CHECK(told_models({model(NoticeKind::link_length, 0.12, 2)}, NoticeKind::link_length).size() ==
          1);
    CHECK(told_models({model(NoticeKind::link_length, 0.1, 2)}, NoticeKind::link_length).empty());
    CHECK(told_models({model(NoticeKind::link_length, 0.12)}, NoticeKind::link_length).empty());
  }
}

TEST_CASE("other models: probabilities") {
  CHECK(model(NoticeKind::link_length, 3).probability() == Approx(0.75));
}

}  // namespace other_models_test
