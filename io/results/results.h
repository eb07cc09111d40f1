// What a calibration writes: a directory with the calibrated robot, the rig, and everything known about them; and the way back:
// the changes of a result put into another copy of the robot.
#pragma once

#include <string>
#include <vector>

#include "../../models/calibration/calibration.h"
#include "../rig/rig_file.h"

namespace kincal {

/// A gear scale as a mechanical reduction (old / scale) of the joint's <transmission>.
struct Reduction {
  std::string joint, transmission;
  double scale = 1, before = 1, after = 1;
};

/// A finished run in the terms of files, before anything is written.
struct ResultFiles {
  std::string robot_urdf, rig_yaml, result_json, changes_yaml, covariance_csv, residuals_csv;
  std::string batch_json;                         // left to a batch (summary_file.h); empty: not written
  std::string rig_hash, samples_hash, urdf_hash;  // SHA-256 of the inputs, as in result.json
  std::vector<Reduction> reductions;              // of every calibrated scale whose joint has a transmission
  std::vector<std::string> not_in_urdf;           // freed parameters that a URDF cannot express; they stand in rig.yaml and result.json
};

struct ResultOptions {
  std::string command;  // the command line, for the record
  std::string samples_path;
  std::string version;
  bool residuals = true;         // residuals.csv
  bool write_reduction = false;  // reductions into robot.urdf, scales in rig.yaml to 1
};

/// Makes all texts and proves the URDF (prove_urdf). @throws std::runtime_error where the proof fails.
ResultFiles make_results(const RigFile& rig_file, const Calibration& calibration, const CalibrationResult& result,
                         const ResultOptions& options);

/// SHA-256 in hex.
std::string sha256(const std::string& text);
/// As result.json has it.
std::string status_name(Status status);
/// Quoted where commas, quotes or line ends ask for it.
std::string csv_field(const std::string& text);

/// Refuses an existing path unless `force` and it is a result directory (has a result.json) or empty. @throws InputError
void check_output(const std::string& directory, bool force);

/// Writes the directory whole or not at all: under a temporary name beside it (or in `scratch`, a folder of the same file system), then
/// a rename. `go_on` is asked before the rename; false leaves nothing. Returns false if it did. @throws InputError where the file system
/// refuses.
bool write_results(const std::string& directory, const ResultFiles& files, bool force, bool (*go_on)(), const std::string& scratch = "");

/// The same for any files (name, text).
bool write_directory(const std::string& directory, const std::vector<std::pair<std::string, std::string>>& files, bool force,
                     bool (*go_on)(), const std::string& scratch = "");

/// Writes one file through a temporary name. @throws InputError
void write_file(const std::string& path, const std::string& text);

/// "sensors" of result.json as text; `before`: with rms_before.
std::string evaluation_json(const Evaluation& evaluation);

/// The text of `urdf` with the changes of a result (a result directory or its result.json).
/// @throws InputError if the robot differs from the calibrated one where the result changes it, or holds the changes already; if the
///         result's status is not `converged`, unless `force`.
std::string apply_result(const std::string& result_path, const Urdf& urdf, bool force);

}  // namespace kincal
