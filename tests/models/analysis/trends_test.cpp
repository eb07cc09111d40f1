// analysis/trends.h: errors of readings that go with the posture.
//
// Proves, of robots that are known by the poses of their flange (with Eigen alone): errors that are
// smooth in the pose are a trend, from 30 samples on, and make the verdict doubtful where they
// contradict stated noise; noise of the same size is none, and no jump in time, in 20 draws of
// each; a flange that is moved by 10 sigmas from some sample on is, there. Not proved: joints
// (tests/program/newcomer_test.py), how clear smaller trends are.
#include <algorithm>
#include <catch2/catch.hpp>

#include "../../../models/analysis/trends.h"
#include "../../fixtures/flange.h"

namespace trends_test {

using namespace kincal;
using Eigen::Isometry3d;
using Eigen::Vector3d;

namespace {

/// What a robot with wrong zeros says of its flange: off by what depends on where it is.
Isometry3d by_wrong_zeros(const Isometry3d& pose) {
  const Eigen::Matrix3d r = pose.linear();
  const Vector3d t = pose.translation();
  Isometry3d out =
      Eigen::Translation3d(0.004 * Vector3d(r(0, 1) * t.x(), r(2, 0) - t.y(), r(1, 1))) * pose;
  const Vector3d w = 0.006 * Vector3d(r(0, 2) + t.x(), r(1, 0), r(2, 1) * t.z());
  out.rotate(Eigen::AngleAxisd(w.norm(), w.normalized()));
  return out;
}

Report study_of(fixture::FlangeTruth& truth, int samples, bool wrong) {
  fixture::FlangeInput input = fixture::read(truth, samples, [&](const Isometry3d& pose) {
    return fixture::xyz_quat(wrong ? by_wrong_zeros(pose) : pose);
  });
  input.rig.steps.clear();
  return fixture::study_of(std::move(input.rig), std::move(input.samples));
}

}  // namespace

TEST_CASE("trends: errors of a flange that go with its pose are told from noise") {
  for (const bool in_hand : {true, false})
    for (const bool stated : {true, false})
      for (const int samples : {30, 45}) {
        INFO("in hand " << in_hand << ", stated " << stated << ", samples " << samples);
        fixture::FlangeTruth truth({in_hand, 2e-3, 3e-3, stated}, 5);
        fixture::FlangeTruth exact({in_hand, 2e-4, 4e-4, stated}, 5);
        const Report noisy = study_of(truth, samples, false), off = study_of(exact, samples, true);
        CHECK(noisy.trends.empty());
        REQUIRE(off.trends.size() == 1);
        CHECK(off.solution.rig().tree.joints[off.trends[0].joint].name == "flange");
        CHECK(off.trends[0].turn > 5e-4);
        // Predicted errors allow for this, and only noise that was stated otherwise is in doubt.
        const auto said =
            std::find_if(off.warnings.begin(), off.warnings.end(),
                         [](const Notice& w) { return w.kind == NoticeKind::systematic; });
        REQUIRE(said != off.warnings.end());
        CHECK(sentences(*said).find("Predicted errors allow for this") != std::string::npos);
        CHECK(off.verdict.use == (stated ? "doubts" : "good"));
        CHECK((sentences(off.verdict).find("depend on its position") != std::string::npos) ==
              stated);
      }
}

TEST_CASE("trends: noise is none, whatever its size") {
  for (unsigned seed = 0; seed < 20; ++seed)
    for (const int samples : {17, 30}) {
      INFO("seed " << seed << ", samples " << samples);
      fixture::FlangeTruth truth({seed % 2 == 0, 5e-4, 1e-3}, 100 + seed);
      fixture::FlangeInput input = fixture::read(truth, samples);
      const Solution solution =
          fixture::solution_of(std::move(input.rig), std::move(input.samples));
      CHECK(trends(solution).empty());
      CHECK(jumps(solution).empty());
    }
}

TEST_CASE("jumps: a flange that says otherwise from some sample on") {
  for (unsigned seed = 0; seed < 4; ++seed) {
    INFO("seed " << seed);
    fixture::FlangeTruth truth({true, 5e-4, 1e-3}, 100 + seed);
    int sample = 0;
    fixture::FlangeInput input = fixture::read(truth, 30, [&](const Isometry3d& pose) {
      return fixture::xyz_quat(sample++ < 12 ? pose
                                             : Isometry3d(Eigen::Translation3d(0.02, 0, 0) * pose));
    });
    const Solution solution = fixture::solution_of(std::move(input.rig), std::move(input.samples));
    const std::vector<Jump> found = jumps(solution);
    REQUIRE(!found.empty());
    CHECK(found[0].sample == 12);
  }
}

}  // namespace trends_test
