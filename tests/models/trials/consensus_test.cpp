// models/trials/consensus.h: one sample judged at the values of a fit.
//
// Proves, at the true values of simulated robots: a right sample is left as it is; points that lie
// off are named, these and no others; a view that does not belong to the sample's others is named
// where the others can prove it wrong, else the sample is out; wrong readings put the sample out,
// with a reason; a level above 1 forgives what it should; what a verdict leaves of a sample is what
// it says. Does not prove: the bounds themselves (outliers_test.cpp), nor the Newton step for
// samples that took no part in the fit.
#include "../../../models/trials/consensus.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../fixtures/example.h"

namespace consensus_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// A laboratory with a reference at the truth.
struct Judge {
  Laboratory lab;
  ReferenceFit reference;

  explicit Judge(int seed)
      : lab(seed), reference{Recording(lab.rig, {}), {}, lab.truth, {}, {}, {}, {}} {
    for (size_t s = 0; s < lab.rig.sensors.size(); ++s) {
      reference.sensors.push_back(static_cast<int>(s));
      reference.noise_ratios.push_back(1);
    }
  }
  SampleVerdict of(const Sample& sample) {
    return judge_sample(reference, sample, nothing_rejected(lab.rig, sample), Values());
  }
  /// The first sample whose views, the second and third of cameras, are four and more of one
  /// target: the others can prove one wrong.
  Sample& seen_often() {
    for (Sample& sample : lab.samples) {
      const std::vector<View>& views = sample.views;
      if (views.size() < 4 || !lab.camera(views[1]) || !lab.camera(views[2])) continue;
      if (std::all_of(views.begin(), views.end(),
                      [&](const View& v) { return v.target == views[0].target; }))
        return sample;
    }
    FAIL("no sample with four views of one target");
    return lab.samples[0];
  }
};

}  // namespace

TEST_CASE("consensus: a right sample is left as it is") {
  Judge judge(11);
  for (const Sample& sample : judge.lab.samples) {
    INFO(sample.id);
    const SampleVerdict verdict = judge.of(sample);
    CHECK(verdict.clean());
    CHECK(verdict.took_part());
    CHECK(verdict == nothing_rejected(judge.lab.rig, sample));
    CHECK(without_rejected(judge.lab.rig, sample, verdict).views.size() == sample.views.size());
  }
}

TEST_CASE("consensus: points that lie off are named, these and no others") {
  Judge judge(12);
  Sample& sample = judge.lab.samples[judge.lab.seen_twice()[2]];
  View& view = judge.lab.first_camera(judge.lab.seen_twice()[2]);
  const size_t v = static_cast<size_t>(&view - sample.views.data()), count = view.z.size() / 2;
  REQUIRE(count >= 12);
  view.z[2 * 1] += 15;
  view.z[2 * 4 + 1] -= 12;
  view.z[2 * 9] -= 25;
  const SampleVerdict verdict = judge.of(sample);
  CHECK_FALSE(verdict.out);
  CHECK(verdict.took_part());
  CHECK_FALSE(verdict.clean());
  for (size_t w = 0; w < sample.views.size(); ++w)
    for (size_t p = 0; p < verdict.point[w].size(); ++p) {
      INFO("view " << w << ", point " << p);
      CHECK((verdict.point[w][p] == 1) == (w == v && (p == 1 || p == 4 || p == 9)));
    }
  const Sample left = without_rejected(judge.lab.rig, sample, verdict);
  REQUIRE(left.views.size() == sample.views.size());
  CHECK(left.views[v].ids.size() == count - 3);
  CHECK(left.views[v].z.size() == 2 * (count - 3));
  CHECK(left.views[v].z[0] == view.z[0]);
  CHECK(left.views[v].z[2] == view.z[4]);
  CHECK(judge.of(left).clean());
}

TEST_CASE("consensus: a view that the sample's others prove wrong is named") {
  Judge judge(13);
  Sample& sample = judge.seen_often();
  turn_round(sample.views[1]);
  const SampleVerdict verdict = judge.of(sample);
  CHECK_FALSE(verdict.out);
  CHECK_FALSE(verdict.took_part());
  for (size_t v = 0; v < sample.views.size(); ++v) CHECK((verdict.view[v] == 1) == (v == 1));
  CHECK(verdict.view_reason[1].find("does not belong to the sample's other views") == 0);
  const Sample left = without_rejected(judge.lab.rig, sample, verdict);
  CHECK(left.views.size() == sample.views.size() - 1);
  CHECK(judge.of(left).clean());
}

TEST_CASE(
    "consensus: of two views that contradict each other neither is named, the sample is out") {
  Judge judge(14);
  Sample& sample = judge.seen_often();
  sample.views = {sample.views[1], sample.views[2]};
  REQUIRE(judge.of(sample).clean());
  turn_round(sample.views[0]);
  const SampleVerdict verdict = judge.of(sample);
  CHECK(verdict.out);
  CHECK_FALSE(verdict.took_part());
  CHECK(verdict.reason.find("its joint readings and its views do not belong together") == 0);
}

TEST_CASE("consensus: readings of another posture put the sample out") {
  Judge judge(15);
  Sample& sample = judge.seen_often();
  for (double& reading : sample.readings)
    if (std::isfinite(reading)) reading = -reading - 0.3;
  const SampleVerdict verdict = judge.of(sample);
  CHECK(verdict.out);
  CHECK_FALSE(verdict.reason.empty());
}

TEST_CASE("consensus: a sensor's level says what is usual") {
  Judge judge(16);
  const size_t index = judge.lab.seen_twice()[0];
  View& view = judge.lab.first_camera(index);
  for (size_t i = 0; i < view.z.size(); ++i)
    view.z[i] += (i % 4 < 2 ? 10 : -10) * view.sigma[i % 2];
  CHECK_FALSE(judge.of(judge.lab.samples[index]).clean());
  judge.reference.noise_ratios.assign(judge.reference.noise_ratios.size(), 10);
  CHECK(judge.of(judge.lab.samples[index]).clean());
}

}  // namespace consensus_test
