// Reads the results of a fleet (`kincal fleet`) and writes the findings.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../../models/fleet/fleet.h"
#include "../../solver/progress.h"

namespace kincal {

/// A Fleet is the data read from result directories of many robots.
struct Fleet {
  std::vector<FleetNumber> numbers;
  std::vector<FleetResult> results;
  std::string reference;  // the result whose poses are the reference of all others
  std::vector<std::pair<std::string, std::string>> left_out;  // result, reason
  /// Results made with another rig than the majority, each with the differences. Their poorly
  /// determined parameters may differ for this reason alone.
  std::vector<std::pair<std::string, std::string>> other_rigs;
};

/// Returns the result directories among these paths and up to three levels below them, sorted by
/// name. @throws InputError: a path neither is nor contains a result
std::vector<std::string> find_results(const std::vector<std::string>& paths);

/// Reads results. @throws InputError: a result cannot be read, or none can be used; Cancelled
Fleet read_fleet(const std::vector<std::string>& results, const Progress& progress = {});

/// Parses a date such as 2026-03, 2026-03-01 or 2026-03-01T12:30, with optional seconds and zone
/// (`Z`, `+02:00`; default UTC); `_` or a blank may replace T. Returns seconds since 1970. @throws
/// std::invalid_argument
double seconds_of_date(const std::string& text);

/// Returns the indices of the parameters that match the names or patterns. @throws InputError: a
/// pattern matches none
std::vector<int> fleet_numbers(const Fleet& fleet, const std::vector<std::string>& patterns,
                               const std::string& where);

std::string fleet_json(const Fleet& fleet, const FleetFindings& findings,
                       const FleetOptions& options, const std::string& version);
/// Returns one line per robot, worst first.
std::string robots_csv(const Fleet& fleet, const FleetFindings& findings);
/// Returns one line per robot and component: the deviation if this component alone were wrong.
std::string family_csv(const Fleet& fleet, const FleetFindings& findings);
/// Returns one line per component of each robot with several results: its linear trend and its
/// best-fitting change.
std::string drift_csv(const Fleet& fleet, const FleetFindings& findings);

}  // namespace kincal
