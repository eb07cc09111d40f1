// A recording: what every calibration, analysis and trial is about. It has a robot with its sensors
// and targets, everything about it that could be estimated, and what was logged.
#pragma once

#include <memory>
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

inline std::shared_ptr<const Recording> make_recording(Rig rig, std::vector<Sample> samples) {
  return std::make_shared<const Recording>(std::move(rig), std::move(samples));
}

}  // namespace kincal
