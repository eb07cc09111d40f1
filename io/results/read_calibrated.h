// A calibration as its files have it: a result directory, its result.json, or a rig.yaml. With a
// result.json beside the rig, the joint offsets that were folded into the written robot are taken
// out of its origins again, so that offsets stand against offsets; sigmas and covariance come from
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

/// CalibratedFiles are a calibration as its files have it.
struct CalibratedFiles {
  std::string path;  // as given
  RigFile rig_file;
  ParameterTable table;
  VectorXd
      values;  // ParameterTable's layout; offsets taken out of the origins where they are known
  std::string status = {};               // as in result.json; empty: there is none
  std::string lens_status = {};          // as in intrinsics.json; likewise
  std::vector<std::string> doubts = {};  // what these say against using it
  std::map<std::string, std::vector<double>> sigma =
      {};  // parameter that a step freed -> by component; NaN: not determined, 0: held
  std::optional<Unknowns> unknowns = {};

  CalibratedRobot robot() const { return {&rig_file.rig, &table, values, unknowns}; }
};
/// Reads a calibration. `rigid`: for software in which joints cannot bend and have no error curves.
/// If the result has them, this is the best robot without them (rig_rigid.yaml), without sigmas and
/// covariance. @throws InputError
CalibratedFiles read_calibrated(const std::string& path, bool rigid = false);

/// Reads one from the texts of a result: rig.yaml, result.json, the robot (robot_unbent.urdf if
/// there is one), and covariance.csv if there is one. No file is looked at; `folder` is for
/// messages. @throws InputError
CalibratedFiles parse_calibrated(const ResultFiles& files, const std::string& folder = "");

/// Returns what a monitor begins with. @throws InputError: the files have no covariance
CalibratedState state_of(const CalibratedFiles& files);

/// Returns the reason in a result.json not to use the result: its verdict, unless it is good; else
/// "".
std::string verdict_doubt(const Field& result);

/// Returns the parameter's index, or -1 if the table has none of this name.
int find_parameter(const ParameterTable& table, const std::string& name);

}  // namespace kincal
