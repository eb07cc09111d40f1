// Two calibrations of one robot compared: parameter by parameter, and by where they put frames of the robot.
//
// A calibration is a result directory, its result.json, or a rig.yaml. With a result.json beside the rig, the joint offsets that were
// folded into the written robot are taken out of its origins again, so that offsets stand against offsets; sigmas and covariance come from
// there too. A rig.yaml alone has neither.
//
// Poses are compared as poses, E = a^-1 b, whatever they were started from: translation of E and Log of its rotation, in the frame itself.
// Their sigmas belong to increments there (of partly freed poses: to xi, the same while that is small).
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "../../models/analysis/frames.h"
#include "../rig/rig_file.h"

namespace kincal {

/// A calibration as its files have it.
struct CalibratedFiles {
  std::string path;  // as given
  RigFile rig_file;
  ParameterTable table;
  VectorXd values;                                   // ParameterTable's layout; offsets taken out of the origins where they are known
  std::string status;                                // as in result.json; empty: there is none
  std::map<std::string, std::vector<double>> sigma;  // parameter that a step freed -> by component; NaN: not determined, 0: held
  std::optional<Unknowns> unknowns;

  CalibratedRobot robot() const { return {&rig_file.rig, &table, values, unknowns}; }
};
/// @throws InputError
CalibratedFiles read_calibrated(const std::string& path);

struct ParameterDifference {
  std::string name;
  std::vector<std::string> components, units;
  std::vector<double> a, b;        // poses: xyz and rpy
  std::vector<double> difference;  // b - a; poses: E
  std::vector<double> sigma;       // of the difference; NaN: unknown, not determined, or held in both
};

struct Comparison {
  std::string base;
  std::vector<ParameterDifference> parameters;  // that either freed, or that differ
  std::vector<FrameDifference> frames;
  std::vector<std::string> only_in_a, only_in_b;  // parameters
  std::string workspace;                          // `samples` or `limits`
  std::vector<std::string> notes;                 // what to keep in mind
};
/// `frames`: names (find_frame); empty: every link that carries a sensor or mounted target, and their own frames. `samples`: a file whose
/// readings are the workspace; empty: random postures within the joints' limits. @throws InputError: the robots differ, a frame is unknown.
Comparison compare(const CalibratedFiles& a, const CalibratedFiles& b, const std::vector<std::string>& frames, const std::string& samples);

std::string comparison_json(const CalibratedFiles& a, const CalibratedFiles& b, const Comparison& comparison);

/// The frame of this name. @throws InputError with the nearest ones; `where` comes first in the message.
Frame frame_named(const Rig& rig, const ParameterTable& table, const std::string& name, const std::string& where);

}  // namespace kincal
