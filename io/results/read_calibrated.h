// A calibration read from its files: a result directory, its result.json, or a rig.yaml. With a
// result.json beside the rig, the joint offsets that were folded into the written robot are removed
// from its origins again, so that offsets can be compared; sigmas and covariance come from
// there too. A rig.yaml alone has neither.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "../../models/analysis/frames.h"
#include "../../models/monitor/monitor.h"
#include "../rig/rig_file.h"
#include "results.h"

namespace kincal {

/// CalibratedFiles are a calibration read from its files.
struct CalibratedFiles {
  std::string path;  // as given
  RigFile rig_file;
  ParameterTable table;
  VectorXd values;          // ParameterTable's layout; known offsets are removed from the origins
  std::string status = {};  // as in result.json; empty: none
  std::string lens_status = {};          // as in intrinsics.json; likewise
  std::vector<std::string> doubts = {};  // their reasons against use
  std::map<std::string, std::vector<double>> sigma =
      {};  // estimated parameter -> by component; NaN: not determined, 0: fixed
  std::optional<Unknowns> unknowns = {};
  VectorXd nominal = {};  // the values that the calibration counts from; a pose that its rig did
                          // not have: the identity
  bool exact = false;     // the true values of a simulated robot

  CalibratedRobot robot() const { return {&rig_file.rig, &table, values, unknowns}; }
};
/// Reads a calibration. `rigid`: for software in which joints neither bend nor have error curves.
/// If the result has either, returns the best robot without them (rig_rigid.yaml), without sigmas
/// and covariance. @throws InputError
CalibratedFiles read_calibrated(const std::string& path, bool rigid = false);

/// Reads a calibration from the texts of a result: rig.yaml, result.json, the robot
/// (robot_unbent.urdf if present) and covariance.csv if present. Reads no file; `folder` is for
/// messages. @throws InputError
CalibratedFiles parse_calibrated(const ResultFiles& files, const std::string& folder = "");

/// Returns the initial state of a monitor. @throws InputError: the files have no covariance
CalibratedState state_of(const CalibratedFiles& files);

/// TrainingReadings are the readings of a calibration's training samples, with their ids.
struct TrainingReadings {
  std::vector<std::string> ids;
  std::vector<Readings> readings;
};
/// Reads a samples.csv of the result at `path`. @throws InputError
TrainingReadings training_readings(const std::string& samples_csv, const std::string& path,
                                   const Tree& tree);

/// Returns the reason in a result.json not to use the result: its verdict, or "" if the verdict is
/// good.
std::string verdict_doubt(const Field& result);

/// Returns the index of the parameter with this name; -1 if there is none.
int find_parameter(const ParameterTable& table, const std::string& name);

}  // namespace kincal
