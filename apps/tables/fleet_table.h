// What `kincal fleet` prints.
#pragma once

#include <string>

#include "../../io/results/fleet_files.h"

namespace kincal {

/// Returns the tables of robots that are out of family and of those that drift, at most `most`
/// lines each.
std::string fleet_table(const Fleet& fleet, const FleetFindings& findings,
                        const FleetOptions& options, size_t most);

}  // namespace kincal
