// A recording: what every calibration, analysis and trial is about. It has a robot with its sensors
// and targets, everything about it that could be estimated, and what was logged.
#pragma once

#include <cmath>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "parameters.h"
#include "samples.h"

namespace kincal {

/// A Recording holds a rig, its table of parameters and the samples. To change one of them, make
/// another recording.
struct Recording {
  Rig rig;
  ParameterTable table;
  std::vector<Sample> samples;

  Recording(Rig r, std::vector<Sample> s) : rig(std::move(r)), table(rig), samples(std::move(s)) {}

  /// Returns the indices of the samples that are in training (true), or held out.
  std::vector<int> split(bool train) const {
    std::vector<int> out;
    for (size_t i = 0; i < samples.size(); ++i)
      if (samples[i].train == train) out.push_back(static_cast<int>(i));
    return out;
  }
  std::vector<int> training() const { return split(true); }
};

/// Returns the sigma of a joint's reading in a sample, rad or m.
inline double joint_sigma(const Rig& rig, const Sample& sample, int joint) {
  return rig.joints[joint].sigma * (sample.noise.empty() ? 1 : sample.noise[joint]);
}

inline std::shared_ptr<const Recording> make_recording(Rig rig, std::vector<Sample> samples) {
  return std::make_shared<const Recording>(std::move(rig), std::move(samples));
}

/// Returns the same recording with other steps.
inline std::shared_ptr<const Recording> with_steps(const Recording& recording,
                                                   std::vector<Step> steps) {
  Rig rig = recording.rig;
  rig.steps = std::move(steps);
  return make_recording(std::move(rig), recording.samples);
}

/// Returns how many different readings the training samples have.
inline size_t count_postures(const Recording& recording) {
  std::set<std::vector<double>> readings;
  for (const int i : recording.training()) {
    std::vector<double> one = recording.samples[i].readings;
    for (double& reading : one)
      if (std::isnan(reading)) reading = 0;  // absent; NaN has no order
    readings.insert(std::move(one));
  }
  return readings.size();
}

/// Poses of which fewer are there do not tell how noisy they are; what is assumed then, m and rad.
constexpr int kFewPoses = 8;
constexpr double kFewPosesNoise = 1e-3;
inline bool has_few_poses(const Recording& recording) {
  return count_postures(recording) < static_cast<size_t>(kFewPoses);
}

}  // namespace kincal
