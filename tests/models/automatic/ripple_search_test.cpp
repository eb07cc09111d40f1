// models/automatic/ripple_search: find_ripple() on errors of joints that are drawn.
//
// Proves: a ripple of any number of cycles is found with joint and cycles, also if it was taken for
// noise; few samples of a joint hide no ripple of others; errors that are noise,
// also if they are clustered or of unequal size, give none. Does not prove: what is made of it on
// the automatic path (tests/program/conditions_test.py), nor how often real arms get a false one.
#include "../../../models/automatic/ripple_search.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../fixtures/random.h"

namespace ripple_search_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

constexpr int kSamples = 150;

/// Errors of noise `sigma`, readings within a turn, some of them ten times noisier; in runs of
/// `cluster` samples with the same error.
std::vector<JointErrors> noise(Random& random, double sigma, int cluster) {
  std::vector<JointErrors> out(6);
  for (size_t j = 0; j < out.size(); ++j) {
    out[j].joint = static_cast<int>(j);
    double error = 0;
    for (int s = 0; s < kSamples; ++s) {
      const double reading = random.uniform(-2.5, 2.5), drawn = random.normal();
      if (s % cluster == 0) error = drawn;
      const double size = s % 7 == 0 ? 10 * sigma : sigma;
      out[j].reading.push_back(reading);
      out[j].curvature.push_back(1 / (sigma * sigma));
      out[j].slope.push_back(-size * error / (sigma * sigma));
    }
  }
  return out;
}

}  // namespace

TEST_CASE("ripple search: a ripple is found with its joint and its cycles") {
  Random random(1);
  for (const int cycles : {5, 80, 399}) {
    std::vector<JointErrors> errors = noise(random, 1e-4, 1);
    for (int s = 0; s < kSamples; ++s)
      errors[3].slope[s] -= 6e-4 * std::sin(cycles * errors[3].reading[s] + 0.4) / (1e-4 * 1e-4);
    const std::optional<FoundRipple> found = find_ripple(errors);
    REQUIRE(found);
    CHECK(found->joint == 3);
    CHECK(found->cycles == cycles);
  }
}

TEST_CASE("ripple search: what is taken for noise is found") {
  Random random(3);
  std::vector<JointErrors> errors = noise(random, 1e-4, 1);
  for (int s = 0; s < kSamples; ++s) {
    errors[3].slope[s] -= 6e-4 * std::sin(80 * errors[3].reading[s]) / (1e-4 * 1e-4);
    errors[3].slope[s] /= 1000;  // noise 32 times as large
    errors[3].curvature[s] /= 1000;
  }
  const std::optional<FoundRipple> found = find_ripple(errors);
  REQUIRE(found);
  CHECK(found->joint == 3);
  // (A seventh of the samples have ten times the noise.)
  CHECK(found->left * 1000 == Approx(6.0 / 7 + 100.0 / 7).epsilon(0.3));
}

TEST_CASE("ripple search: a joint that few samples depend on hides no ripple of others") {
  Random random(4);
  std::vector<JointErrors> errors = noise(random, 1e-4, 1);
  for (int s = 0; s < kSamples; ++s) {
    errors[3].slope[s] -= 6e-4 * std::sin(80 * errors[3].reading[s]) / (1e-4 * 1e-4);
    if (s > 4) errors[0].slope[s] = errors[0].curvature[s] = 0;
  }
  REQUIRE(find_ripple(errors));
  CHECK(find_ripple(errors)->joint == 3);
}

TEST_CASE("ripple search: noise gives none") {
  Random random(2);
  for (int trial = 0; trial < 6; ++trial)
    CHECK_FALSE(find_ripple(noise(random, 1e-4, trial % 3 == 0 ? 5 : 1)));
  CHECK_FALSE(find_ripple({}));
}

}  // namespace ripple_search_test
