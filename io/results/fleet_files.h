// Results of a fleet read (`kincal fleet`), and what was found written.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../../models/fleet/fleet.h"
#include "../../solver/progress.h"

namespace kincal {

/// A Fleet is the information of result directories on their robots.
struct Fleet {
  std::vector<FleetNumber> numbers;
  std::vector<FleetResult> results;
  std::string reference;  // the result whose poses those of all count from
  std::vector<std::pair<std::string, std::string>> left_out;  // result, why
  /// Results made with another rig than most, and the differences. Poorly determined parameters of
  /// these results may differ for this reason alone.
  std::vector<std::pair<std::string, std::string>> other_rigs;
};

/// Returns the result directories that these paths are or contain (up to three levels down), in the
/// order of their names. @throws InputError where a path is or has none
std::vector<std::string> find_results(const std::vector<std::string>& paths);

/// Reads results. @throws InputError; also where none can be used; Cancelled
Fleet read_fleet(const std::vector<std::string>& results, const Progress& progress = {});

/// Reads a time as people write it: 2026-03, 2026-03-01, 2026-03-01T12:30, with seconds, a zone
/// (`Z`, `+02:00`; none: UTC) and `_` or a blank in place of T. Returns seconds since 1970.
/// @throws std::invalid_argument
double seconds_of_date(const std::string& text);

/// Returns the parameters that names or patterns match. @throws InputError: one matches none
std::vector<int> fleet_numbers(const Fleet& fleet, const std::vector<std::string>& patterns,
                               const std::string& where);

std::string fleet_json(const Fleet& fleet, const FleetFindings& findings,
                       const FleetOptions& options, const std::string& version);
/// One line a robot, worst first.
std::string robots_csv(const Fleet& fleet, const FleetFindings& findings);
/// One line a robot and number: by how much it would be off, if it alone were.
std::string family_csv(const Fleet& fleet, const FleetFindings& findings);
/// One line a robot of several results and number: its line and its best change.
std::string drift_csv(const Fleet& fleet, const FleetFindings& findings);

}  // namespace kincal
