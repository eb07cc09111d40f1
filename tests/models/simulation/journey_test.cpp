// models/simulation/journey.h: how a simulated robot moves between its postures.
//
// Proves: at rest it stands as the posture says, halfway joints are in the middle, and position,
// speed and acceleration are continuous; readings are the sample's plus scatter of the stated size,
// and go over into the next sample's with the joints; a target in a chain's hand goes with the
// hand, another through base, and one that is not there before and after is gone in between. Does
// not prove: that a real robot moves so.
#include "../../../models/simulation/journey.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/rig/configuration.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/rigs.h"

namespace journey_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

struct Place {
  Rig rig = nasty_robot();
  ParameterTable table{rig};
  VectorXd truth = table.initial;
  int chain = -1, held = -1, placed = -1;
  std::vector<Stop> stops;

  /// Three stops; in the first two a chain holds one free target, another stands in base.
  Place() {
    for (size_t s = 0; s < rig.sensors.size(); ++s)
      if (rig.sensors[s].model->measurement_kind() == MeasurementKind::chain)
        chain = static_cast<int>(s);
    for (size_t t = 0; t < rig.targets.size(); ++t)
      if (rig.targets[t].link < 0) (held < 0 ? held : placed) = static_cast<int>(t);
    REQUIRE((chain >= 0 && held >= 0));
    if (placed < 0) placed = held + 1000;  // the journey does not look at the rig's targets
    RandomStream draws(3);
    for (int k = 0; k < 3; ++k) {
      Stop stop;
      stop.truth.id = std::to_string(k);
      for (size_t j = 0; j < rig.joints.size(); ++j) {
        stop.truth.readings.push_back(draws.uniform(-0.5, 0.5));
        stop.logged.push_back(stop.truth.readings.back() + 0.01 * draws.normal());
      }
      const Configuration robot(rig, table, truth, stop.truth.readings);
      stop.truth.targets[held] = robot.base_T_sensor(chain) * grip;
      if (k < 2) stop.truth.targets[placed] = {draws.rotation(), draws.normals()};
      stop.holders[held] = chain;
      stops.push_back(stop);
    }
  }
  Pose grip{exp_so3(Vector3d(0.1, 0.2, 0.3)), Vector3d(0.01, 0.02, 0.03)};
};

double apart(const Pose& a, const Pose& b) { return log_se3(inverse(a) * b).norm(); }

}  // namespace

TEST_CASE("journey: rests, moves and what is carried along") {
  const Place place;
  const Journey journey(place.rig, place.table, place.truth, place.stops, {2, 1, 0});
  CHECK(journey.duration() == 8);
  for (const auto& [time, stop] : std::vector<std::pair<double, int>>{
           {-1, 0}, {0, 0}, {2, 0}, {2.5, -1}, {3, 1}, {4.9, 1}, {5.5, -1}, {6, 2}, {9, 2}}) {
    INFO(time);
    CHECK(journey.resting(time) == stop);
    if (stop < 0) continue;
    CHECK(journey.at(time).readings == place.stops[stop].truth.readings);
    CHECK(journey.at(time).targets.size() == place.stops[stop].truth.targets.size());
  }
  const std::vector<double>&a = place.stops[0].truth.readings, &b = place.stops[1].truth.readings;
  const Posture half = journey.at(2.5);
  for (size_t j = 0; j < a.size(); ++j)
    CHECK(half.readings[j] == Approx((a[j] + b[j]) / 2).margin(1e-14));
  // Speed and acceleration: none where it starts and ends, and no jump on the way.
  const auto reading = [&](double time) { return journey.at(time).readings[1]; };
  constexpr double h = 1e-4;
  const double way = std::abs(b[1] - a[1]);
  for (const double time : {2., 3., 5., 6.}) {
    CHECK(std::abs(reading(time + h) - reading(time - h)) / (2 * h) < 1e-6);
    CHECK(std::abs(reading(time + h) - 2 * reading(time) + reading(time - h)) / (h * h) < 0.1);
  }
  CHECK((reading(2.5 + h) - reading(2.5 - h)) / (2 * h) ==
        Approx(1.875 * (b[1] - a[1])).margin(1e-6 * way));  // 30/16 of the mean speed

  for (const double time : {2.1, 2.5, 2.9, 5.3}) {
    const Posture at = journey.at(time);
    const Configuration robot(place.rig, place.table, place.truth, at.readings);
    CHECK(apart(at.targets.at(place.held), robot.base_T_sensor(place.chain) * place.grip) < 1e-12);
  }
  const Pose from = place.stops[0].truth.targets.at(place.placed),
             to = place.stops[1].truth.targets.at(place.placed);
  CHECK(apart(from, half.targets.at(place.placed)) == Approx(apart(from, to) / 2));
  CHECK(journey.at(5.1).targets.count(place.placed) == 0);  // not there at the third stop
}

TEST_CASE("journey: readings have the stop's errors and scatter of their own") {
  const Place place;
  const double scatter = 0.4;
  const Journey journey(place.rig, place.table, place.truth, place.stops, {2, 1, scatter});
  RandomStream draws(5);
  constexpr int n = 20000;
  std::vector<double> sum(place.rig.joints.size(), 0), squares = sum;
  for (int i = 0; i < n; ++i) {
    const std::vector<double> logged = journey.logged(2.5, draws);
    for (size_t j = 0; j < sum.size(); ++j) {
      const double e = logged[j] - (place.stops[0].logged[j] + place.stops[1].logged[j]) / 2;
      sum[j] += e, squares[j] += e * e;
    }
  }
  for (size_t j = 0; j < sum.size(); ++j) {
    const double sigma = scatter * place.rig.joints[j].sigma;
    CHECK(std::abs(sum[j] / n) <= 4 * sigma / std::sqrt(n) + 1e-14);
    CHECK(std::sqrt(squares[j] / n) == Approx(sigma).epsilon(0.03).margin(1e-12));
  }
}

}  // namespace journey_test
