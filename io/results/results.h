// The result directory of a calibration: the calibrated robot, the rig and all figures about them.
// apply.h applies it to another copy of the robot.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "../../models/report/report.h"
#include "../document/node.h"
#include "../rig/rig_file.h"
#include "mount_texts.h"

namespace kincal {

/// A Reduction is a gear scale expressed as the mechanical reduction (old / scale) of the joint's
/// <transmission>.
struct Reduction {
  std::string joint, transmission;
  double scale = 1, before = 1, after = 1;
};

/// ResultFiles are the texts of all result files before any is written.
struct ResultFiles {
  std::string robot_urdf, rig_yaml, result_json, changes_yaml, covariance_csv;
  // Where joints have errors that a URDF cannot express, robot_urdf is the best robot without them,
  // with the mounts of rig_rigid; the rig has them, and the robot that goes with them. Else empty.
  std::string unbent_urdf, rig_rigid;
  std::string information_csv, samples_csv, residuals_csv,
      loops_csv;               // the last two: empty, not written
  std::string report_html;     // made of these (io/report); empty: not written
  std::string batch_json;      // left to a batch (summary_file.h); empty: not written
  std::function<Node()> told;  // makes the content of result_json without samples and scene,
                               // for tables
  std::string rig_hash, samples_hash, urdf_hash;  // SHA-256 of the inputs, as in result.json
  std::vector<Reduction> reductions;     // of every calibrated scale whose joint has a transmission
  std::vector<MountText> mounts;         // estimated mounts that are in no joint; in changes.yaml
  std::vector<std::string> not_in_urdf;  // estimated parameters that a URDF cannot express; they
                                         // are in rig.yaml and result.json
};

struct ResultOptions {
  std::string command;       // the command line, for the record
  std::string date;          // and when it ran
  std::string samples_hash;  // SHA-256 of the text that the samples were read from, in hex
  std::string version;
  bool residuals = true;         // residuals.csv, loops.csv
  bool write_reduction = false;  // reductions into robot.urdf, scales in rig.yaml to 1
};

/// Makes all texts and verifies the URDF (prove_urdf). @throws std::runtime_error if this fails.
ResultFiles make_results(const RigFile& rig_file, const Report& report,
                         const ResultOptions& options);

/// Returns the names of the result files and their texts. Empty texts are not written: robot.urdf
/// if the robot has no URDF, residuals.csv, loops.csv, batch.json.
const std::vector<std::pair<const char*, std::string ResultFiles::*>>& result_file_names();

/// Writes the files of a result like write_directory (document/files.h).
bool write_results(const std::string& directory, const ResultFiles& files, bool force,
                   bool (*go_on)(), const std::string& scratch = "");

}  // namespace kincal
