// What a batch of calibrations writes of its sets: the record in each result directory
// (batch.json), from which a later run knows what is done, and the table over all sets
// (summary.csv, summary.json).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../../models/report/report.h"

namespace kincal {

/// A SensorRms is the rms of a sensor's residuals; a sensor that measures poses has a second one,
/// `NAME/rotation`. NaN: none.
struct SensorRms {
  std::string name, unit;
  double train = 0, test = 0;
};

/// A Change is that of a parameter component that a step freed. sigma NaN: not determined.
struct Change {
  std::string name, unit;
  double initial = 0, value = 0, sigma = 0;
};

/// An AbsolutePose is that of a pose parameter that a step freed, as the URDF writes it: it can be
/// compared with other sets, whose changes count from starts of their own.
struct AbsolutePose {
  std::string name;
  Vector3d xyz, rpy;
};

/// A SetSummary is one set of a batch.
struct SetSummary {
  std::string name;
  std::string status;   // as in result.json, or `failed`: there is no result
  int exit_code = 0;    // as of `kincal calibrate`; killed by a signal: 128 + its number
  std::string verdict;  // good, doubts, no; empty: there is no result
  std::string error;  // what is wrong where the verdict is not good, or which tolerance is not met
  double chi2 = 0, seconds = 0;
  long dof = 0;
  double chi2_data = 0, dof_data = 0;  // as of the solution
  std::vector<SensorRms> sensors;
  std::vector<Change> changes;
  std::vector<AbsolutePose> poses;
  std::vector<std::string> warnings;

  /// Returns chi2_data / dof_data; NaN where there are no degrees of freedom.
  double chi2_per_dof() const;
  bool fails() const { return exit_code != 0; }
};

/// A BatchRecord is what a result was made from, and its line of the summary.
struct BatchRecord {
  std::string version, options;    // of kincal; as a command line
  std::string rig, samples, urdf;  // SHA-256
  std::string robot;               // the URDF as the rig names it
  SetSummary set;
};

/// Summarises a finished calibration; name, exit code and seconds are the caller's.
SetSummary summarize(const Report& report);

std::string record_text(const BatchRecord& record);
/// Reads a record; nullopt if there is none, or it cannot be read.
std::optional<BatchRecord> read_record(const std::string& path);

/// Writes one line a set. Columns of sensors and parameters stand in the order in which the sets
/// name them first; parameters that no set changed are left out. Absolute poses stand last. Nothing
/// in it depends on time or on how many ran at once.
std::string summary_csv(const std::vector<SetSummary>& sets);
/// Writes everything; `ignored` counts the folders that are no set.
std::string summary_json(const std::vector<SetSummary>& sets, const std::string& version,
                         const std::string& options, size_t ignored);

}  // namespace kincal
