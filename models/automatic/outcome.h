// Results and options of the automatic path (automatic.h).
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../analysis/gauges.h"
#include "../calibration/calibration.h"
#include "../rig/numbers.h"
#include "groups.h"
#include "other_models.h"
#include "pose_errors.h"

namespace kincal {

/// An AutomaticNumber is the result of one member of a group.
struct AutomaticNumber {
  std::string name, unit;
  double value = 0, sigma = 0;  // change from the nominal value; predicted sigma
  double width = 0;             // of its prior
  double told = 0;              // share that the data determine, 1 - C_ii / t_i^2
  bool held = false;            // reset to nominal: value is 0

  bool undetermined() const { return told < 0.1; }
};

struct AutomaticGroup {
  std::string name;
  std::vector<AutomaticNumber> numbers, unseen;
  double factor = 1;  // of the starting widths
  double widest = 1;  // of the member predicted with the largest: above `factor` if lengths may be
                      // those of another robot (other_robot.h)
  double gamma = 0;   // effective number of components that the data determine
  double gain = 0;    // log evidence against all of them being nominal
  bool held = false;  // all of them are fixed
};

/// A TriedGroup is a group of further models (further.h) that was tried, with the outcome.
struct TriedGroup {
  enum class Outcome {
    kept,
    no_evidence,         // of the data of the fit
    no_better_held_out,  // held-out samples do not fit better with it
    too_few_samples,     // to hold some out
    lost                 // its evidence, when everything was calibrated with it
  };
  std::string name;
  double gain = kNan;  // log evidence when it was tried; NaN: not defined
  Outcome outcome = Outcome::no_evidence;
};

/// A Stage is the calibration before the next further model was added.
struct Stage {
  std::vector<std::string> further;  // groups that it has
  std::shared_ptr<const Solution> solution;
};

struct AutomaticCalibration {
  Solution solution;                   // its recording has the steps that were run
  VectorXd mounts;                     // shared values with the mounts alone estimated, as `groups`
  std::vector<AutomaticGroup> groups;  // empty if it could not start, or was cancelled
  std::vector<UncheckedScale> unchecked;
  std::vector<Gauge> gauges;  // of mounts; their components are fixed
  std::vector<OtherModel> other_models;
  std::vector<PoseErrors> pose_errors;  // of flanges
  double noise_factor = 1;              // of all stated sigmas, with StatedNoise::scaled
  bool noise_at_rest = true;            // false: noise still changed in the last round
  std::vector<TriedGroup> tried;
  std::vector<Stage> stages;  // before each further model that was kept and that `begin` lacked;
                              // without such a model none
};

/// The start of a calibration that was made before with other noise.
struct Begin {
  std::vector<std::string> further;      // groups of further models that were kept (further.h)
  std::map<std::string, double> factor;  // of groups' widths; else 1
  std::optional<Values> start;           // start of the fit of everything; none: the mounts alone
  double noise_factor = 1;  // of stated sigmas, by which the recording's are multiplied
};

/// How far the stated sigmas are right: as they are, but for one factor of all, or each by its own.
/// Unknown factors, of at most ten, are estimated.
enum class StatedNoise { right, scaled, wrong };

struct AutomaticOptions : CalibrationOptions {
  GroupChoice groups;
  Begin begin;
  StatedNoise noise_is = StatedNoise::right;
};

}  // namespace kincal
