// The noise over the stated one, learned from samples: of each part of a sensor
// (SensorModel::noise_parts()) and of each joint's readings.
//
// A factor is the root mean square of all residuals so far; it begins at 1, as if kNoiseKnown
// residuals had been seen.
//
// A sensor's noise differs from sample to sample: in sample i its variance is f_i v, with f_i
// distributed as nu / chi2_nu. n residuals that no parameter changes, of the sum of squares S v,
// leave f_i = (nu + S) / (nu + n), as from nu + n residuals; chi2/n over v is F(n, nu). Its
// logarithm has the variance 2/n + 2/nu, and 2/m if m residuals determined v (Smyth, Statistical
// Applications in Genetics and Molecular Biology 3 (2004)). nu is 4, 8 ... 4096, equally likely at
// first; in use is the one with the mean of 2/nu.
//
// The drift watch has f_i by all residuals of the sensor: with S and R of them as predicted, and
// S' with a change, 1/2 (S - S') / f_i is never more than the evidence of Student's distribution,
// (nu + R)/2 log((nu + S) / (nu + S')), so that false alarms do not become more frequent.
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "../rig/rig.h"
#include "innovation.h"
#include "sample_fit.h"

namespace kincal {

class StateBytes;

/// A NoiseScatter is how much a sensor's noise differs from sample to sample.
class NoiseScatter {
 public:
  NoiseScatter();
  /// Learns from a chi2 of `dof` residuals over v, which `known` residuals determined.
  void add(double chi2, double dof, double known);
  double nu() const { return nu_; }
  void transfer(StateBytes& bytes);

 private:
  void find_nu();

  std::array<double, 11> log_odds_ = {};  // of nu = 4, 8 ..., over the most likely one
  double nu_ = 0;
};

class NoiseFactors {
 public:
  explicit NoiseFactors(const Rig& rig);

  size_t kinds() const { return kinds_.size(); }
  int kind_of_joint(int joint) const { return joint; }
  int kind_of(int sensor, int part) const { return first_[sensor] + part; }

  /// Finds the noise of this sample by what no parameter changes.
  void find_own(const Equations& e);
  /// The same by all that it shows, as judged, for the drift watch.
  void find_own(const Innovation& judged);
  /// Returns it: variances over the stated ones, by kind.
  const std::vector<double>& own() const { return own_; }
  /// Sets chi2 and probabilities from the innovations with the noise of this sample.
  void judge(const Equations& e, const Innovations& innovations, Innovation& out) const;
  /// Returns the largest chi2/dof of the noise alone that is an outlier; 0 if there is none.
  double misfit(const Equations& e) const;
  /// Learns from a sample that fits, as judged.
  void learn(const Innovations& innovations, const Innovation& judged);

  std::vector<NoiseSeen> seen() const;
  void transfer(StateBytes& bytes);

 private:
  struct Factor {
    double squares = 0, residuals = 0;
    double variance() const;
    double known() const { return kNoiseKnown + residuals; }
  };
  void set_own(int sensor, double chi2, double dof);
  double tail_alone(const Equations& e, int sensor, int kind) const;
  double known_of(int sensor, const Innovations& innovations) const;
  SensorInnovation judge(const Innovations::OfSensor& rows, const Equations& e, double known,
                         int& parts) const;

  std::vector<std::pair<int, int>> kinds_;  // joints (sensor -1), then parts of the sensors
  std::vector<int> first_;                  // kind, by sensor; then their number
  std::vector<Factor> factors_;             // by kind
  std::vector<NoiseScatter> scatter_;       // by sensor
  std::vector<double> own_, own_factor_;    // by kind; f, by sensor
};

}  // namespace kincal
