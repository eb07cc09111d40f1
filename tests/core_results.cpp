// What the library core finds, with all digits: to compare processors (tests/core_results.py).
//
// The nasty robot of rigs.h (cameras, tracker, depth camera, scanning laser, flange poses; every
// kind of joint) calibrated in each noise mode, a monitor of it that sees other samples, and a
// robot like the PR2. A line is a name, a value and what a difference is measured in: the value's
// standard deviation, or for chi2 and sigmas the value itself. The samples are made here, too:
// rounding of all of the library and of the fixtures is in it.
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "../benchmarks/pr2_like.h"
#include "../models/calibration/calibration.h"
#include "../models/monitor/monitor.h"
#include "../solver/kernels.h"
#include "fixtures/problem.h"

using namespace kincal;
using namespace kincal::fixture;

namespace {

void print(const std::string& name, double value, double scale) {
  std::printf("%s %.17g %.17g\n", name.c_str(), value, scale);
}

void print(const std::string& run, const Solution& found) {
  if (!found.usable()) throw std::runtime_error(run + ": " + found.message);
  print(run + "/chi2", found.chi2, found.chi2);
  for (const ParameterEstimate& p : found.parameters)
    for (size_t i = 0; i < p.value.size(); ++i) {
      if (!(p.sigma[i] > 0)) continue;  // held
      const std::string name = run + "/" + p.component_name(i);
      print(name, p.value[i], p.sigma[i]);
      print(name + "/sigma", p.sigma[i], p.sigma[i]);
    }
}

Solution calibrated(const OpenRecording& of, Step step, NoiseMode noise) {
  Rig rig = of.rig;
  step.name = "all";
  for (size_t s = 0; s < rig.sensors.size(); ++s) step.sensors.push_back(static_cast<int>(s));
  rig.steps = {step};
  CalibrationOptions options;
  options.noise = noise;
  return calibrate(make_recording(std::move(rig), of.samples), options);
}

void watch(const Solution& found, const std::vector<Sample>& samples) {
  Monitor monitor({found.rig(), found.values.shared, found.columns, found.covariance, {}, {}});
  for (const Sample& sample : samples) {
    const Innovation seen = monitor.add(sample);
    if (seen.dof > 0) print("monitor/" + sample.id + "/chi2", seen.chi2, seen.chi2);
  }
  for (Eigen::Index i = 0; i < monitor.difference().size(); ++i) {
    const double variance = monitor.covariance()(i, i);
    if (variance > 0)  // not held
      print("monitor/difference/" + std::to_string(i), monitor.difference()[i],
            std::sqrt(variance));
  }
}

}  // namespace

int main() try {
  std::fprintf(stderr, "instruction set: %s\n", kernels().name);
  const NoiseMode modes[] = {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point,
                             NoiseMode::none};
  const char* const names[] = {"latent", "marginal", "point", "none"};
  Step nasty_step, pr2_step;
  nasty_step.free = kDetermined;
  const Setting robot = nasty(40, 7, true, kDetermined, 0.005);
  for (int mode = 0; mode < 4; ++mode) {
    const Solution found = calibrated(robot, nasty_step, modes[mode]);
    print(names[mode], found);
    if (mode == 0) watch(found, nasty(30, 8, true, kDetermined, 0).samples);
  }
  pr2_step.free = {"joint/*/offset", "joint/*/scale", "sensor/*/pose", "sensor/*/intrinsics"};
  for (const std::string& pattern : pr2_step.free)
    pr2_step.priors.push_back({pattern, 0.1, 0.1, false, ""});
  print("pr2", calibrated(benchmarks::pr2_like(30), pr2_step, NoiseMode::latent));
  return 0;
} catch (const std::exception& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return 1;
}
