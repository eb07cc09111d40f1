// A fleet: results of many robots, or of some over months, judged together. Each robot's latest
// result is judged within the family (family.h), several results also over time (drift.h).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "drift.h"
#include "family.h"

namespace kincal {

/// A FleetNumber is a component that results of a fleet estimate. Components of poses are
/// increments from a result's pose, in its frame: for the family from the first result's pose, for
/// a robot over time from that of its own first result. (Equations are linear at their estimate.
/// With increments from a distant pose, the linearisations of a robot's results would differ as
/// soon as their poorly determined components differ.)
struct FleetNumber {
  std::string name, unit;
  double scale = 0;  // its usual error
};

/// A FleetResult is the information of one result's data, as equations in the components of the
/// fleet.
struct FleetResult {
  std::string path, serial;
  double time = 0;     // years since 1970
  std::string date;    // the same, as 2026-03-01 or 2026-03-01T12:00:00Z
  Evidence evidence;   // in the family's components
  Evidence over_time;  // in the robot's own components; empty if it has one result
};

struct FleetOptions {
  double level = 0.01;    // share of healthy robots that are named by chance
  std::vector<int> anew;  // components that are new in every result, so not tested for drift
};

struct FleetRobot {
  std::string serial;
  std::vector<int> results;            // by time
  std::optional<FamilyMember> member;  // if the family was judged
  bool out_of_family = false;          // member's p is below the level
  std::optional<Drift> drift;          // of robots with several results
  double p = 1;                        // the smaller of both

  bool drifts() const { return drift && !drift->causes.empty(); }
};

struct FleetFindings {
  std::vector<FleetRobot> robots;  // worst first
  Family family;                   // its members are the robots'
  int out_of_family = 0, drifting = 0;
};

/// Judges all robots of a fleet.
FleetFindings study_fleet(const std::vector<FleetNumber>& numbers,
                          const std::vector<FleetResult>& results, const FleetOptions& options);

}  // namespace kincal
