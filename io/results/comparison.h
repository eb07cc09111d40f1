// Compares two calibrations of one robot: parameter by parameter, and by the poses of its frames.
//
// Poses are compared by E = a^-1 b, independent of their starting values: translation of E and Log
// of its rotation, in the frame itself. Their sigmas are those of increments there (for partly
// estimated poses: of xi, the same while that is small).
#pragma once

#include <string>
#include <vector>

#include "read_calibrated.h"

namespace kincal {

struct ParameterDifference {
  std::string name;
  std::vector<std::string> components, units;
  bool pose = false;
  std::vector<double> a, b;        // poses: xyz and rpy
  std::vector<double> difference;  // b - a; poses: E
  std::vector<double> sigma;  // of the difference; NaN: unknown, not determined, or fixed in both
  std::vector<char> undetermined;  // by component, in a or b
};

struct Comparison {
  std::string base;
  bool errors = false;                          // a is the truth: differences are errors of b
  std::vector<ParameterDifference> parameters;  // those that either estimated, or that differ
  std::vector<FrameDifference> frames;
  bool sigmas = true;  // both have sigmas: a frame without one is not determined
  std::vector<std::string> only_in_a, only_in_b;  // parameters
  std::vector<std::string> open_in_a, open_in_b;  // poses open in one of them: not compared
  std::string workspace;                          // `samples` or `limits`
  std::vector<std::string> notes;                 // remarks
};
/// Compares two calibrations. `frames` are names (find_frame); if empty, the links with a sensor or
/// mounted target and the frames of these are compared. `samples` is a file whose readings are the
/// workspace; if empty, random postures within the joint limits are used. @throws InputError: the
/// robots differ, or a frame is unknown.
Comparison compare(const CalibratedFiles& a, const CalibratedFiles& b,
                   const std::vector<std::string>& frames, const std::string& samples);

/// Reads the truth file of a simulated robot (io/rig/simulation_file.h). Returns the true values in
/// the form of a calibration, the argument b of compare(); a is `result`. @throws InputError
CalibratedFiles read_true_values(const std::string& path, const CalibratedFiles& result);
/// True for a JSON file with true parameters in place of a result.
bool is_truth_file(const std::string& path);

/// The errors of components in units of their sigmas; those without a sigma are left out.
struct ErrorsInSigmas {
  int components = 0;
  double rms = 0, worst = 0;
};
/// Returns those of the components that b estimated, else of those that it held at nominal values.
ErrorsInSigmas errors_in_sigmas(const CalibratedFiles& b, const Comparison& comparison,
                                bool estimated);

std::string comparison_json(const CalibratedFiles& a, const CalibratedFiles& b,
                            const Comparison& comparison);

/// Returns the frame of this name. @throws InputError with the nearest names; its message begins
/// with `where`.
Frame frame_named(const Rig& rig, const ParameterTable& table, const std::string& name,
                  const std::string& where);

}  // namespace kincal
