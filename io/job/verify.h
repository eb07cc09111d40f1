// Is a calibrated robot as accurate as is claimed? Samples that its calibration has not seen, as
// `kincal verify` judges them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../../models/rig/numbers.h"
#include "../../models/verify/verification.h"
#include "../results/read_calibrated.h"
#include "job.h"

namespace kincal {

/// Returns why views of a target by a sensor do not show a robot's accuracy; "" if they do.
std::string why_no_instrument(const Rig& rig, int sensor, int target);

struct VerifySettings {
  std::string tolerance;  // "frame/NAME<LIMIT", "max frame/NAME<LIMIT"; empty: none is asked for
  std::string standard = "distances";  // or iso9283
  std::string sensor;                  // the instrument; empty: the only one
  bool refit_base = false;             // the instrument was set up anew since the calibration
  std::string instrument, environment, serial, measured;  // words for the certificate
  std::string command;                                    // the command line, for the record
  Words words = Words::switches;
};

/// VerifiedFigures are those of one robot: calibrated, or nominal.
struct VerifiedFigures {
  AccuracyFigure position, distance, rotation;  // rotation: without postures where none is measured
};

/// A VerifiedResult is what the files of a calibration say of it besides the robot.
struct VerifiedResult {
  CalibratedFiles files;
  std::string result_json, samples_csv;  // texts; the second may be empty
};
/// Reads a result directory, or its result.json. @throws InputError
VerifiedResult read_verified_result(const std::string& path);

struct Verification {
  std::string robot, sensor, target, frame;  // names; what the figures are about
  bool distances = true, refitted = false;
  VerifiedFigures before, after;
  double sensor_sigma = 0;   // m, of one measured position (root of the trace, rms over views)
  double base_sigma = kNan;  // m, of where the calibration places the instrument, rms over the
                             // measured positions, k = 1; NaN: fitted, or not known
  Scatter scatter;
  std::vector<RepeatedPosture> repeated;
  std::vector<std::string> postures;    // ids, of repeated ones that of the first view
  std::vector<double> errors, nominal;  // m, length of the position error of each posture
  int views = 0;
  std::optional<Requirement> tolerance;
  bool largest = false;                  // the tolerance is on the largest error, not on the rms
  Conformity answer = Conformity::pass;  // without a tolerance it means nothing
  long needed = 0;                       // postures; -1: no number of them, or of the largest
  std::vector<std::string> notes;

  /// Returns the figure that the tolerance is on.
  const AccuracyFigure& judged() const {
    return tolerance && tolerance->rotation ? after.rotation
           : distances                      ? after.distance
                                            : after.position;
  }
};

/// Verifies a result. @throws InputError: samples that the calibration has seen, too few postures
/// or all in one place, an instrument that moves or measures no positions, a tolerance that cannot
/// be judged
Verification verify(const VerifiedResult& result, const SampleSet& samples,
                    const VerifySettings& settings);

}  // namespace kincal
