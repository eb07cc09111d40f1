// The result of a study: a solution with its analyses and trials. warnings() (warnings.h) then
// collects the facts that a user needs before using the result.
#pragma once

#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../analysis/deflections.h"
#include "../analysis/joint_curves.h"
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

constexpr size_t kNamed = 5;  // number of names in the text of a warning

/// A Verdict states whether to use a result, in two lines: `use` (good, doubts or no) with the
/// reason `why` (a clause); and the first of `next`, the actions (clauses; none: nothing to do).
/// All other texts follow these.
struct Verdict {
  std::string use, why;
  std::vector<std::string> next = {};
  std::vector<std::string> reasons = {};  // evidence or conditions of `why`: sentences without
                                          // the last full stop
  std::vector<NoticeKind> about = {};     // the finding or warning that decided, and its cause
  std::vector<NoticeKind> see = {};       // other warnings
  std::vector<std::string> held = {};     // parameters fixed because the data do not determine them
  size_t kept = 0;                        // all that were fixed at nominal values, with these
  std::vector<std::string> unmet = {};    // requirements
};
/// Returns the reasons of a verdict about fixed parameters and unmet tolerances.
std::vector<std::string> notes(const Verdict& verdict);
/// Returns a verdict as one paragraph.
std::string sentences(const Verdict& verdict);

/// NoiseRounds describe the estimation of the noise.
struct NoiseRounds {
  int count = 0;           // calibrations that estimated the noise
  bool converged = false;  // the last of them moved no sigma by more than 1 %
  double stated = std::numeric_limits<double>::quiet_NaN();  // automatic path: chi2/dof of the data
                                                             // with the stated sigmas
};

struct Report {
  Notices input;  // found in rig and samples before any fit
  Solution solution;
  Residuals residuals;
  std::vector<NoiseLevel> noise_levels;        // of the last step's sensors and joints
  std::optional<NoiseRounds> noise_estimated;  // else the sigmas are the rig's
  std::optional<MoreData> more;                // benefit of more samples
  DataEquations data;              // information of the data alone on the last step's unknowns
  Explanation explanation;         // weakly determined directions of the last step
  std::vector<Leverage> leverage;  // above 1 sigma, largest first
  Misfits misfits;                 // samples and views that fit much worse than the others
  std::vector<Trend> trends;       // joints whose errors depend on their position
  std::vector<Jump> jumps;         // joints whose errors change from some sample on
  std::vector<Rejected> rejected;  // removed before the fit
  std::string no_consensus;        // reason why nothing was removed although requested
  std::vector<Rejected>
      outliers;  // after a plain fit that ended badly: those that a robust fit would remove
  std::optional<Restarts> restarts;
  std::vector<AutomaticGroup> automatic;  // if the rig has no steps
  std::vector<TriedGroup> tried;          // automatic path: bending and error curves
  std::vector<Stage> stages;              // calibrations before each of these that was kept
  std::shared_ptr<const Solution> rigid;  // the first stage; null: nothing of these was kept
  VectorXd mounts;  // automatic path: shared values with only the mounts estimated
  std::vector<OtherModel>
      other_models;                     // automatic path: other models of the data, with their odds
  std::vector<PoseErrors> pose_errors;  // automatic path: of flanges; predicted errors have them
  std::vector<UncheckedScale> unchecked;  // automatic path: lengths that no measurement checks
  std::vector<Gauge> gauges;              // automatic path: of mounts, with fixed components
  std::optional<Diagnosis> diagnosis;     // of a calibration that ended badly
  std::vector<Deflection> deflections;    // if joints bend
  std::vector<JointCurve> curves;         // of joints with error curves
  std::vector<Loop> loops;
  std::map<int, Matrix3d> position_covariances;  // of sensors and mounted targets (frames.h)
  std::vector<LoopView> loop_views;              // the residuals of `loops`
  Validation validation;
  std::optional<Notice> unexplained;  // why the model does not explain the data
  Notices warnings;                   // one per kind
  Verdict verdict;
  std::shared_ptr<const struct GaugeFreedoms> gauge_freedoms;  // gauge_freedoms.h; null: none
};

}  // namespace kincal
