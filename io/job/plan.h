// Which postures to record next, as `kincal plan` says it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "../../models/design/clearance.h"
#include "../../models/design/design.h"
#include "../../models/simulation/posture.h"
#include "../results/json_values.h"
#include "../results/read_calibrated.h"
#include "../results/results.h"
#include "job.h"
#include "simulate.h"

namespace kincal {

/// A KnownRobot is a calibrated robot with its covariance, and the readings of its samples.
struct KnownRobot {
  CalibratedRobot robot;
  std::vector<Readings> stood;
};
/// Returns what a result says; nullopt if it has no covariance. `samples_csv` may be empty.
/// Refers to the files. @throws InputError
std::optional<KnownRobot> known_robot(const CalibratedFiles& files, const std::string& samples_csv);

struct PlanSettings {
  int next = 20, candidates = 2000;
  std::uint64_t seed = 1;
  std::string goal = "parameters";    // that, frame/NAME[<LIMIT], or names and globs
  std::optional<NamedText> postures;  // candidates that are known to be safe
  double clearance = 0.02;            // m between links; below 0: they are not looked at
  Words words = Words::switches;
  std::optional<KnownRobot> known;  // of a result; what counts if no samples are given
};

/// A PlanStep is a row of the forecast: predicted errors of the calibration after so many postures.
struct PlanStep {
  int postures = 0;
  double planned = 0, random = 0;
};

/// UnvisitedAngles are readings of a joint with an error curve, within its limits, of which no
/// sample will say anything: values of the curve there keep their prior.
struct UnvisitedAngles {
  std::string joint;
  std::vector<std::pair<double, double>> ranges;  // rad, ascending
};

struct PosturePlan {
  DesignGoal goal;
  std::optional<Requirement> tolerance;
  std::vector<Posture> postures;  // in the order in which they are short to drive
  std::vector<PlanStep> forecast;
  double floor = 0;                      // what no posture lowers
  std::vector<std::string> floor_names;  // components of the direction that it is due to
  int enough = -1;                       // postures; -1: more than were planned
  int needed = -1;                       // for the tolerance; -1: it is out of reach
  int candidates = 0, asked = 0;         // asked: postures to choose
  std::vector<std::pair<std::string, int>> left_out;  // why, and how many candidates
  std::vector<UnvisitedAngles> unvisited;             // after these postures
  std::vector<std::string> notes;
  Solution assumed;  // the robot as it is known before; its samples are `postures`, without points
};

/// Plans postures for a calibration of this rig, after these samples (null: there are none).
/// @throws InputError, std::exception, Cancelled
PosturePlan plan_postures(const RigFile& rig_file, const SampleSet* samples,
                          const PlanSettings& settings, const Progress& progress);

/// Returns the check for links within `margin` (m) of each other. Pairs that are near where the
/// robot `stood`, or as it is drawn, are not checked; `notes` get what else is not.
Clearance robot_clearance(const RigFile& rig_file, const CalibratedRobot& robot,
                          const std::vector<Readings>& stood, double margin,
                          std::vector<std::string>& notes);

/// One JSON line a posture, as --postures takes them.
std::string postures_text(const Rig& rig, const std::vector<Posture>& postures);
Json plan_json(const PosturePlan& plan);
/// The texts of the page of a plan: the forecast, and the robot in each posture.
ResultFiles plan_files(const RigFile& rig_file, const PosturePlan& plan,
                       const ResultOptions& record);
std::string plan_text(const PosturePlan& plan);

}  // namespace kincal
