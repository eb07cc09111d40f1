// models/analysis/misfits.h: what sticks out of a plain calibration.
//
// Proves: on right data nothing is named; a view whose points jitter, a sample whose readings are
// wrong and a held-out sample that fits nothing are named, each as what it is and alone; a sensor
// whose stated sigma is wrong as a whole names nothing; what is stated to be noisy is not named.
// Does not prove: names after a fit that gross outliers have ruined (outliers_test.cpp), nor where
// exactly the bounds lie.
#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/calibration/calibration.h"
#include "../../../models/report/warnings.h"
#include "../../fixtures/example.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/study.h"
#include "../../fixtures/three_points.h"

namespace misfits_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// What a calibration of the laboratory's samples says of misfits.
Notices misfits_in(const Laboratory& lab) {
  Report report;
  report.solution = solution_of(lab.rig, lab.samples);
  report.residuals = residuals_of(report.solution);
  report.misfits = misfits(report.solution, report.residuals);
  Notices out;
  for (const Notice& w : warnings(report))
    if (std::string(id(w.kind)).rfind("outlier", 0) == 0) out.push_back(w);
  return out;
}

bool names(const Notice& warning, const std::string& what) {
  return sentences(warning).find("'" + what) != std::string::npos;
}

}  // namespace

TEST_CASE("outliers: what sticks out of a plain fit is named, and nothing else") {
  Laboratory lab(4);
  const std::vector<size_t> two = lab.seen_twice();
  const auto warnings = [&] { return misfits_in(lab); };
  CHECK(warnings().empty());
  View& view = lab.first_camera(two[0]);
  for (size_t i = 0; i < view.z.size(); ++i)
    view.z[i] += (i % 4 < 2 ? 3 : -3);  // corners that jitter by 3 px
  Notices found = warnings();
  REQUIRE(found.size() == 1);
  CHECK(found[0].kind == NoticeKind::outlier_view);
  CHECK(sentences(found[0]).find("'" + lab.samples[two[0]].id + "' " +
                                 lab.rig.sensors[view.sensor].name) != std::string::npos);
  CHECK(sentences(found[0]).rfind("1 view ", 0) == 0);
  for (double& sigma : view.sigma.own()) sigma *= 20;  // said so: nothing wrong
  CHECK(warnings().empty());
}

TEST_CASE("misfits: readings that do not belong to their sample name it, and no view of it") {
  Laboratory lab(6);
  Sample& wrong = lab.samples[lab.seen_twice()[1]];
  // Twelve sigmas in each joint: the fit leaves them as joint errors, not as residuals.
  for (size_t j = 0; j < wrong.readings.size(); ++j)
    if (std::isfinite(wrong.readings[j]))
      wrong.readings[j] += (j % 2 ? 12 : -12) * lab.rig.joints[j].sigma;
  const Notices found = misfits_in(lab);
  REQUIRE(found.size() == 1);
  CHECK(found[0].kind == NoticeKind::outlier_sample);
  CHECK(sentences(found[0]).rfind("1 sample ", 0) == 0);
  CHECK(names(found[0], wrong.id + "'"));
}

TEST_CASE("misfits: a held-out sample is judged as well, and called so") {
  Laboratory lab(7);
  const std::vector<size_t> two = lab.seen_twice();
  for (size_t i = 0; i < 6; ++i) lab.samples[two[i]].train = false;
  CHECK(misfits_in(lab).empty());
  Sample& wrong = lab.samples[two[2]];
  for (View& view : wrong.views)
    if (lab.camera(view))
      for (size_t i = 0; i < view.z.size(); ++i) view.z[i] += (i % 4 < 2 ? 4 : -4);
  const Notices found = misfits_in(lab);
  REQUIRE(found.size() == 1);
  CHECK(found[0].kind == NoticeKind::outlier_sample);
  CHECK(names(found[0], wrong.id + "' (held out)"));
}

TEST_CASE("misfits: a sigma that is wrong for a whole sensor names nothing") {
  Laboratory lab(8);
  const int sensor = lab.first_camera(lab.seen_twice()[0]).sensor;
  for (Sample& sample : lab.samples)
    for (View& view : sample.views)
      if (view.sensor == sensor)
        for (double& sigma : view.sigma.own()) sigma /= 6;
  CHECK(misfits_in(lab).empty());
}

TEST_CASE("misfits: views of which a free target takes up the noise make no outliers of the rest") {
  // Three points before two cameras (6 of 12 residuals are left), before one (none is), and boards.
  int named = 0;
  for (int seed = 0; seed < 40; ++seed) {
    ThreePoints of;
    Rig& rig = of.rig;
    const int body = 0, board = 1;
    Random random(200 + seed);
    std::vector<Sample> samples;
    while (samples.size() < 60) {
      const size_t i = samples.size();
      const int target = i % 5 == 0 ? board : body;
      TruePosture p = empty_posture(rig);
      p.boards[target] = in_front(rig, 0, target, p, random.uniform(0.7, 1.3), 1.2, random);
      Sample sample = make_sample(rig, p, "s" + std::to_string(i));
      if (add_view(sample, rig, 0, target, p, &random) &&
          (i % 5 > 2 || add_view(sample, rig, 1, target, p, &random)))
        samples.push_back(sample);
    }
    Report report;
    report.solution = calibrate(make_recording(rig, samples), {});
    REQUIRE(report.solution.status == Status::converged);
    report.residuals = residuals_of(report.solution);
    const Misfits found = misfits(report.solution, report.residuals);
    named += !found.samples.empty() || !found.views.empty();
  }
  CHECK(named == 0);
}

}  // namespace misfits_test
