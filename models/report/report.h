// Everything that is known after a study: a solution, and each analysis and trial that was made of
// it. What of it a user should know before using the result stands in warnings() (warnings.h), in
// one place, after everything is known.
#pragma once

#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../analysis/deflections.h"
#include "../analysis/leverage.h"
#include "../analysis/loops.h"
#include "../analysis/misfits.h"
#include "../analysis/noise_levels.h"
#include "../analysis/residuals.h"
#include "../analysis/trends.h"
#include "../analysis/weak_directions.h"
#include "../automatic/automatic.h"
#include "../calibration/solution.h"
#include "../design/design.h"
#include "../doctor/doctor.h"
#include "../trials/outliers.h"
#include "../trials/restarts.h"
#include "validation.h"

namespace kincal {

constexpr size_t kNamed = 5;  // so many names stand in the text of a warning

/// A Verdict states whether to use a result, in two lines: `use` (good, doubts or no) and why (a
/// clause); and the first of `next`, the actions (clauses; none: nothing to do). All other texts
/// follow these.
struct Verdict {
  std::string use, why;
  std::vector<std::string> next = {};
  std::vector<std::string> reasons = {};  // what `why` rests on, or holds under: sentences without
                                          // the last full stop
  std::vector<NoticeKind> about = {};     // the finding or warning that decided, and its cause
  std::vector<NoticeKind> see = {};       // other warnings
  std::vector<std::string> held = {};     // parameters fixed because the data do not determine them
  std::vector<std::string> unmet = {};    // requirements
};
/// Returns the reasons of a verdict about fixed parameters and tolerances that are not met.
std::vector<std::string> notes(const Verdict& verdict);
/// Returns a verdict as one paragraph.
std::string sentences(const Verdict& verdict);

/// NoiseRounds are how the estimation of the noise went.
struct NoiseRounds {
  int count = 0;           // calibrations that estimated the noise
  bool converged = false;  // the last of them moved no sigma by more than 1 %
  double stated = std::numeric_limits<double>::quiet_NaN();  // automatic path: chi2/dof of the data
                                                             // with the stated sigmas
};

struct Report {
  Notices input;  // what rig and samples show by themselves, before any fit
  Solution solution;
  Residuals residuals;
  std::vector<NoiseLevel> noise_levels;        // of the last step's sensors and joints
  std::optional<NoiseRounds> noise_estimated;  // else the sigmas are the rig's
  std::optional<MoreData> more;                // what more of them would bring
  DataEquations data;                          // what they alone say of the last step's unknowns
  Explanation explanation;                     // weakly determined directions of the last step
  std::vector<Leverage> leverage;              // above 1 sigma, largest first
  Misfits misfits;                 // samples and views that fit much worse than the others
  std::vector<Trend> trends;       // joints whose errors go with where they stand
  std::vector<Jump> jumps;         // joints whose errors change from some sample on
  std::vector<Rejected> rejected;  // taken out before the fit
  std::string no_consensus;        // why nothing was taken out although it was asked for
  std::vector<Rejected>
      outliers;  // after a plain fit that ended badly: what a robust one would take out
  std::optional<Restarts> restarts;
  std::vector<AutomaticGroup> automatic;  // of a rig without steps
  std::shared_ptr<const Solution> rigid;  // the same without further models; null: none was kept
  VectorXd mounts;                        // of these, shared values with the mounts alone estimated
  std::vector<OtherModel> other_models;   // of the data of such a rig, with their odds
  std::vector<UncheckedScale> unchecked;  // lengths of such a rig that nothing checks
  std::vector<Gauge> gauges;              // of mounts, that the automatic path fixed
  std::optional<Diagnosis> diagnosis;     // of a calibration that ended badly
  std::vector<Deflection> deflections;    // where joints bend
  std::vector<Loop> loops;
  std::map<int, Matrix3d> position_covariances;  // of sensors and mounted targets (frames.h)
  std::vector<LoopView> loop_views;              // what these are the root mean squares of
  Validation validation;
  std::optional<Notice> unexplained;  // why the model does not explain the data
  Notices warnings;                   // one of a kind
  Verdict verdict;
  std::shared_ptr<const struct GaugeFreedoms> gauge_freedoms;  // gauge_freedoms.h; null: nothing
};

}  // namespace kincal
