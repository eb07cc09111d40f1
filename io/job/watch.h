// A calibrated robot watched: a monitor with what it was shown and what it found, in words and as
// JSON, as the command monitor and other languages have it.
#pragma once

#include <string>
#include <vector>

#include "../../models/monitor/monitor.h"
#include "../results/json_values.h"
#include "../results/read_calibrated.h"

namespace kincal {

class StateBytes;

class Watch {
 public:
  /// @throws InputError: the files have no covariance
  Watch(const CalibratedFiles& files, const MonitorOptions& options);

  struct Told {
    std::string json;   // {sample, state, chi2, dof, probability, unexplained, sensors, drift}
    std::string words;  // empty: it fits, and nothing is new
  };
  /// Shows it a sample. @throws std::invalid_argument as Monitor::add()
  Told show(const Sample& sample);
  /// Returns what was learnt and found, as bytes, and takes it over again. Nothing changes where
  /// load() throws. @throws std::invalid_argument as Monitor::load()
  std::string save() const;
  void load(const std::string& bytes);

  /// Calibrates again by these samples and what the calibration knew, but for what the groups named
  /// may have moved by; no groups: those that were named as moved. Returns {samples, values}: how
  /// many of the samples count, and by name of each component of the groups {change, sigma, unit,
  /// determined}. @throws std::invalid_argument: no such group, none, samples as Monitor::add()
  Json recalibrated(const std::vector<Sample>& samples, std::vector<std::string> groups) const;

  /// Names what moved so shortly before the end that it was not yet.
  void end();

  bool moved() const { return !found_.empty(); }
  /// Returns how often samples in a row did not fit, and nothing that moved explained them.
  long unexplained() const { return unexplained_; }
  /// Returns what was named, in order: a list of groups (as `drift` of a sample has them) for each.
  Json found() const;
  /// Returns the factors of the noise over the stated one, by name.
  Json noise() const;
  /// Returns counts, what has moved and what noise is not as stated, in a few lines.
  std::string summary() const;
  const Rig& rig() const { return monitor_.rig(); }

 private:
  using Groups = std::vector<Moved>;  // those that explain an alarm, the likeliest first
  void tell(Json& json, std::string& words, bool named);
  void transfer(StateBytes& bytes);

  Monitor monitor_;
  double every_;
  std::vector<std::string> ids_;
  std::vector<Groups> found_;
  long unexplained_ = 0;
  long name_at_ = 0;  // number of samples; 0: nothing to be named
};

}  // namespace kincal
