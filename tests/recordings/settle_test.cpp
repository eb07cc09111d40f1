// When something is still, and what it is then: io/recordings/settle.h and settled_view.h.
//
// Proves: the scatter at rest is found within 15 % although the robot moves for two thirds of the
// time; rests are found where they are, whole, and no motion is taken for one; encoders that count,
// readings that are exact or repeated bit by bit in some rests, gaps and single values; averages
// have the sigma that they state (1000 series); interpolation is right for cubics and stops at
// gaps; corners: motion and wrong corners in single frames are left out, averages have the sigma
// that they state. Does not prove: that real encoders and real motions look like these.
#include "../../io/recordings/settle.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../io/recordings/settled_view.h"
#include "../../models/rig/random_stream.h"

namespace settle_test {

using namespace kincal;

namespace {

/// 0 to 1 with rest at both ends.
double smooth(double u) { return u <= 0 ? 0 : u >= 1 ? 1 : u * u * u * (10 + u * (-15 + u * 6)); }

/// Rests of 1 s and ways of 2 s between them, of 0.4 rad each, at 100 Hz.
Series stops_and_ways(int stops, double scatter, RandomStream& draws, double step = 0) {
  Series out;
  for (int i = 0; i <= 300 * stops - 200; ++i) {
    const double t = 0.01 * i, at = std::floor(t / 3);
    double value = 0.4 * (at + smooth((t - 3 * at - 1) / 2)) + scatter * draws.normal();
    if (step > 0) value = step * std::round(value / step);
    out.times.push_back(t);
    out.values.push_back(value);
  }
  return out;
}

Intervals of_length(const Intervals& all, double length) {
  Intervals out;
  for (const TimeInterval& one : all)
    if (one.length() >= length) out.push_back(one);
  return out;
}

/// `held`: the scatter of readings that are repeated throughout a rest.
void check_stops(const Series& series, int stops, double held = 0) {
  const Intervals rests =
      of_length(still_intervals(series, still_tolerance(series), longest_gap(series.times)), 0.5);
  REQUIRE(rests.size() == static_cast<size_t>(stops));
  for (int k = 0; k < stops; ++k) {
    const auto i = static_cast<size_t>(k);
    CHECK(rests[i].begin <= 3 * k + 0.03);  // the whole rest, ...
    CHECK(rests[i].end >= 3 * k + 0.97);
    CHECK(rests[i].begin >= 3 * k - 0.35);  // ... and little of the ways, which begin slowly
    CHECK(rests[i].end <= 3 * k + 1.35);
    const TimeInterval cut = without_slow_ends(series, rests[i], scatter_at_rest(series));
    CHECK(cut.begin <= 3 * k + 0.1);  // a block more, at most, ...
    CHECK(cut.end >= 3 * k + 0.9);
    const Average mean = average(series, {cut.begin + 0.1, cut.end - 0.1});
    const double sigma = std::max(mean.scatter, 3e-4) / std::sqrt(static_cast<double>(mean.count));
    CHECK(std::abs(mean.mean - 0.4 * k) <
          5 * sigma + 4 * held + smallest_step(series));  // ... and no bias
  }
}

}  // namespace

TEST_CASE("settle: the scatter at rest, with motion around it") {
  RandomStream draws(1);
  for (const double scatter : {1e-5, 1e-4, 1e-3})
    CHECK(scatter_at_rest(stops_and_ways(60, scatter, draws)) == Approx(scatter).epsilon(0.15));
  Series never = stops_and_ways(1, 0, draws);  // slow motion all the time is no noise
  for (size_t i = 0; i < never.size(); ++i) never.values[i] = std::sin(never.times[i]);
  CHECK(scatter_at_rest(never) < 1e-4);
  CHECK(scatter_at_rest(stops_and_ways(5, 0, draws)) == 0);
  CHECK(scatter_at_rest(Series()) == 0);
  CHECK(scatter_at_rest({{1}, {2}}) == 0);
}

TEST_CASE("settle: rests are found whole") {
  RandomStream draws(2);
  check_stops(stops_and_ways(20, 1e-4, draws), 20);
  check_stops(stops_and_ways(20, 1e-3, draws), 20);
  SECTION("exact readings") { check_stops(stops_and_ways(5, 0, draws), 5); }
  SECTION("encoders that count, and flicker between two counts") {
    check_stops(stops_and_ways(20, 0, draws, 1e-3), 20);
    check_stops(stops_and_ways(20, 2e-4, draws, 1e-3), 20);
  }
}

TEST_CASE("settle: some rests repeat one reading bit by bit, others jitter") {
  RandomStream draws(6);
  for (const int every : {2, 3}) {  // every second or third rest jitters, brakes hold the others
    Series series = stops_and_ways(24, 1e-4, draws);
    double held = 0;
    for (size_t i = 0; i < series.size(); ++i) {
      const double t = series.times[i], at = std::floor(t / 3);
      const bool braked = static_cast<int>(at) % every > 0 && t - 3 * at > 0.1 && t - 3 * at < 1;
      if (braked && held != 0) series.values[i] = held;
      held = braked ? series.values[i] : 0;
    }
    CHECK(scatter_at_rest(series) == Approx(1e-4).epsilon(0.25));
    check_stops(series, 24, 1e-4);
  }
}

TEST_CASE("settle: gaps end a rest, single values are none") {
  Series series;
  for (int i = 0; i < 100; ++i) {
    series.times.push_back(0.01 * i + (i < 50 ? 0 : 3));
    series.values.push_back(1);
  }
  const Intervals rests = still_intervals(series, 1e-9, longest_gap(series.times));
  REQUIRE(rests.size() == 2);
  CHECK(rests[0].end == Approx(0.49));
  CHECK(rests[1].begin == Approx(3.5));
  CHECK(still_intervals({{1}, {5}}, 1, 1).empty());
  CHECK(still_intervals({}, 1, 1).empty());
  CHECK(quietest(series, 0.3, 0.1) == 0);
  CHECK(quietest(series, 2, 0.1) == kInfinity);
}

TEST_CASE("settle: what the quietest time moves by") {
  Series series;  // 1 rad/s, but 0.1 rad/s for a second
  for (int i = 0; i <= 300; ++i) {
    const double t = 0.01 * i;
    series.times.push_back(t);
    series.values.push_back(t < 1 ? t : t < 2 ? 1 + 0.1 * (t - 1) : 1.1 + (t - 2));
  }
  CHECK(quietest(series, 0.5, 0.1) == Approx(0.025).epsilon(0.05));
}

TEST_CASE("settle: sets of intervals") {
  const Intervals a{{0, 2}, {3, 5}, {7, 9}}, b{{1, 4}, {4.5, 8}};
  const auto equal = [](const Intervals& x, const Intervals& y) {
    REQUIRE(x.size() == y.size());
    for (size_t i = 0; i < x.size(); ++i) CHECK((x[i].begin == y[i].begin && x[i].end == y[i].end));
  };
  equal(intersected(a, b), {{1, 2}, {3, 4}, {4.5, 5}, {7, 8}});
  equal(intersected(a, {}), {});
  equal(united(a, b), {{0, 9}});
  equal(united(a, {}), a);
  equal(complement(a, -1, 10), {{-1, 0}, {2, 3}, {5, 7}, {9, 10}});
  equal(complement({}, 1, 2), {{1, 2}});
  equal(coverage({0, 1, 2, 5, 6}, 1.5), {{0, 2}, {5, 6}});
}

TEST_CASE("settle: averages have the sigma that they state") {
  RandomStream draws(3);
  const double scatter = 3e-4, systematic = 1e-4;
  double squares = 0;
  const int runs = 1000;
  for (int run = 0; run < runs; ++run) {
    const double truth = draws.uniform(-3, 3), bias = systematic * draws.normal();
    Series series;
    for (int i = 0; i < 40; ++i) {
      series.times.push_back(0.01 * i);
      series.values.push_back(truth + bias + scatter * draws.normal());
    }
    const Average mean = average(series, {0.05, 0.3});
    CHECK(mean.count == 26);
    squares += std::pow((mean.mean - truth) / mean.sigma(systematic), 2);
  }
  // chi2 of 1000 degrees of freedom: 99.9 % of draws are within 0.15 of 1. The scatter is an
  // estimate from 26 values, which adds about 0.02.
  CHECK(squares / runs == Approx(1.0).margin(0.16));
  CHECK(average(Series(), {0, 1}).count == 0);
  CHECK(Average{1, 5, 0}.sigma(2) == 2);
}

TEST_CASE("settle: values between readings") {
  Series series;
  const auto cubic = [](double t) { return 1 + t - 2 * t * t + 0.5 * t * t * t; };
  for (int i = 0; i < 30; ++i) {
    const double t = 0.05 * i + 0.01 * (i % 3);  // not quite regular
    series.times.push_back(t);
    series.values.push_back(cubic(t));
  }
  CHECK(value_at(series, series.times[7], 0.2) == series.values[7]);
  for (double t = 0.1; t < 1.3; t += 0.013)
    CHECK(value_at(series, t, 0.2) == Approx(cubic(t)).margin(2e-4));
  CHECK(std::isnan(value_at(series, -0.1, 0.2)));
  CHECK(std::isnan(value_at(series, 2, 0.2)));
  CHECK(std::isnan(value_at(series, 0.52, 0.01)));
}

namespace {

CornerFrame corners_at(double time, double shift, double noise, RandomStream& draws) {
  CornerFrame out;
  out.time = time;
  for (int id = 0; id < 20; ++id) {
    out.ids.push_back(id);
    out.pixels.push_back(30 * (id % 5) + shift + noise * draws.normal());
    out.pixels.push_back(30 * (id / 5) + noise * draws.normal());
  }
  return out;
}

}  // namespace

TEST_CASE("settle: corners are averaged over still frames") {
  RandomStream draws(4);
  const double noise = 0.03;
  std::vector<std::vector<CornerFrame>> rests;
  for (int rest = 0; rest < 30; ++rest) {
    rests.emplace_back();
    for (int i = 0; i < 10; ++i) rests.back().push_back(corners_at(0.1 * i, 0, noise, draws));
  }
  CHECK(corner_scatter(rests) == Approx(noise).epsilon(0.03));
  SECTION("rests that are none do not make noise of motion") {
    for (int rest = 0; rest < 12; ++rest)
      for (size_t i = 0; i < 10; ++i)
        rests[static_cast<size_t>(rest)][i] =
            corners_at(0.1 * i, 0.5 * static_cast<double>(i), noise, draws);
    CHECK(corner_scatter(rests) == Approx(noise).epsilon(0.08));
    CHECK(view_rest(rests[0], 3 * noise).frames < 5);
    CHECK(view_rest(rests[0], 3 * noise).motion > 1);
  }
  SECTION("the run that is still") {
    std::vector<CornerFrame> frames = rests[0];
    frames[0] = corners_at(0, 1.5, noise, draws);
    frames[1] = corners_at(0.1, 0.3, noise, draws);
    frames[9] = corners_at(0.9, 0.2, noise, draws);
    const ViewRest rest = view_rest(frames, 3 * noise);
    CHECK(rest.frames == 7);
    CHECK(rest.still.begin == Approx(0.2));
    CHECK(rest.still.end == Approx(0.8));
    CHECK(rest.motion > 0.9 * 1.5 / std::sqrt(2.));
    CHECK(average_corners(frames, rest.still).frames == Approx(7).margin(0.1));
  }
  SECTION("a corner that is wrong in one frame") {
    rests[0][3].pixels[10] += 4;
    const SettledCorners mean = average_corners(rests[0], {0, 1});
    CHECK(mean.pixels[10] == Approx(0).margin(5 * noise / 3));
    CHECK(mean.scatter == Approx(noise).epsilon(0.2));
  }
  SECTION("a corner that few frames show") {
    for (size_t i = 0; i < 6; ++i) {
      rests[0][i].ids.pop_back();
      rests[0][i].pixels.resize(38);
    }
    CHECK(average_corners(rests[0], {0, 1}).ids.size() == 19);
  }
  SECTION("one frame has no scatter") {
    const SettledCorners one = average_corners({rests[0][0]}, {0, 1});
    CHECK(!one.scatter_known);
    CHECK(one.sigma(0.1) == 0.1);
    CHECK(view_rest({rests[0][0]}, 0.1).frames == 1);
    CHECK(view_rest({}, 0.1).frames == 0);
  }
}

TEST_CASE("settle: averaged corners have the sigma that they state") {
  RandomStream draws(5);
  const double noise = 0.05, systematic = 0.02;
  double squares = 0;
  long count = 0;
  for (int run = 0; run < 200; ++run) {
    std::vector<CornerFrame> frames;
    std::vector<double> bias;
    for (int k = 0; k < 40; ++k) bias.push_back(systematic * draws.normal());
    for (int i = 0; i < 8; ++i) {
      frames.push_back(corners_at(0.1 * i, 0, noise, draws));
      for (size_t k = 0; k < 40; ++k) frames.back().pixels[k] += bias[k];
      frames.back().floor = 0.6 * systematic;  // and 0.8 of it the rig states
    }
    const SettledCorners mean = average_corners(frames, {0, 1});
    for (int id = 0; id < 20; ++id) {
      const double truth[2] = {30. * (id % 5), 30. * (id / 5)};
      for (size_t k = 0; k < 2; ++k, ++count)
        squares += std::pow((mean.pixels[2 * static_cast<size_t>(id) + k] - truth[k]) /
                                mean.sigma(0.8 * systematic),
                            2);
    }
  }
  CHECK(squares / static_cast<double>(count) == Approx(1.0).margin(0.06));  // 8000: 99.9 %: 0.052
}

}  // namespace settle_test
