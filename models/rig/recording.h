// A recording: the input of every calibration, analysis and trial. It has a robot with its sensors
// and targets, the table of its parameters, and the logged samples.
#pragma once

#include <cmath>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "parameters.h"
#include "samples.h"

namespace kincal {

/// A Recording has a rig, its parameter table and the samples. It does not change. A recording with
/// another rig or other samples is a new one that shares the rest; copies share everything.
class Recording {
  std::shared_ptr<const Rig> rig_;  // (before the references, which it makes)
  std::shared_ptr<const ParameterTable> table_;
  std::shared_ptr<const std::vector<Sample>> samples_;

 public:
  const Rig& rig;
  const ParameterTable& table;
  const std::vector<Sample>& samples;

  Recording(Rig r, std::vector<Sample> s)
      : Recording(std::make_shared<const Rig>(std::move(r)), nullptr,
                  std::make_shared<const std::vector<Sample>>(std::move(s))) {}
  /// Shares its arguments. If the table is null, it is made from the rig.
  Recording(std::shared_ptr<const Rig> r, std::shared_ptr<const ParameterTable> t,
            std::shared_ptr<const std::vector<Sample>> s)
      : rig_(std::move(r)),
        table_(t ? std::move(t) : std::make_shared<const ParameterTable>(*rig_)),
        samples_(std::move(s)),
        rig(*rig_),
        table(*table_),
        samples(*samples_) {}
  Recording(const Recording&) = default;  // no move: it would leave references to nothing behind

  /// Returns the recording with another rig, without copying samples.
  Recording with_rig(Rig other) const {
    return {std::make_shared<const Rig>(std::move(other)), nullptr, samples_};
  }
  /// Returns the recording with other samples, without copying the rig.
  Recording with_samples(std::shared_ptr<const std::vector<Sample>> others) const {
    return {rig_, table_, std::move(others)};
  }
  Recording with_samples(std::vector<Sample> others) const {
    return with_samples(std::make_shared<const std::vector<Sample>>(std::move(others)));
  }

  /// Returns the indices of the training samples (true) or of the held-out samples.
  std::vector<int> split(bool train) const {
    std::vector<int> out;
    for (size_t i = 0; i < samples.size(); ++i)
      if (samples[i].train == train) out.push_back(static_cast<int>(i));
    return out;
  }
  std::vector<int> training() const { return split(true); }
  /// Returns the recording without held-out samples.
  Recording training_only() const {
    const std::vector<int> kept = training();
    if (kept.size() == samples.size()) return *this;
    std::vector<Sample> out;
    for (const int i : kept) out.push_back(samples[i]);
    return with_samples(std::move(out));
  }
};

/// Returns the sigma of a joint's reading in a sample, rad or m.
inline double joint_sigma(const Rig& rig, const Sample& sample, int joint) {
  return rig.joints[joint].sigma * (sample.noise.empty() ? 1 : sample.noise[joint]);
}

inline std::shared_ptr<const Recording> make_recording(Rig rig, std::vector<Sample> samples) {
  return std::make_shared<const Recording>(std::move(rig), std::move(samples));
}
inline std::shared_ptr<const Recording> make_recording(const Recording& recording) {
  return std::make_shared<const Recording>(recording);
}

/// Returns the same recording with other steps.
inline std::shared_ptr<const Recording> with_steps(const Recording& recording,
                                                   std::vector<Step> steps) {
  Rig rig = recording.rig;
  rig.steps = std::move(steps);
  return make_recording(recording.with_rig(std::move(rig)));
}

/// Returns the number of distinct postures (readings) among the training samples.
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

}  // namespace kincal
