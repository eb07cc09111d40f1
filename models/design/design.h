// Which postures to record: chooses those candidates that minimise the calibration's error for a
// goal.
//
// Information. The unknowns d of a calibration have the information
//     H = H_0 + sum over samples of R_i' R_i;
// R_i are the whitened derivatives of a sample after elimination of its private unknowns (the pose
// of a free target, errors of joint readings): solver/observability.h, reduced_rows(). They depend
// on the posture and the visible points, not on the measured values. H_0 are the priors (without
// one, a component's usual error, rig/scales.h) and the information of existing samples.
//
// Goal. The mean square error of positions over postures is
//     E |J d|^2 + noise of the readings = tr(W C) + q,   W = mean of J'J,  C = H^-1,
// J that of a frame relative to the base, or of one frame relative to another: with the twists of
// both (analysis/frames.h)  dp_B - dp_A - w_A x (p_B - p_A),  which no common motion changes.
//
// Choice. Adding R lowers tr(W C) by  |S^-1/2 R C L|^2,  S = 1 + R C R', W = L L'. The best posture
// is added repeatedly. Gains fall as postures are added, so candidates with a smaller earlier gain
// need no evaluation (Minoux 1978; nearly exact for tr(W C)). Then each chosen posture is exchanged
// for a better one while there is one (Fedorov 1972).
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/progress.h"
#include "../analysis/frames.h"
#include "../analysis/linearisation.h"
#include "../estimation/setup.h"
#include "../rig/samples.h"

namespace kincal {

/// A DesignGoal is the quantity whose error is minimised: mean squares over postures.
struct DesignGoal {
  std::string name, unit;
  MatrixXd weight;      // W, by the unknowns: the calibration's mean square error is tr(W C)
  double readings = 0;  // q: mean square by the noise of one reading of each joint
};

/// Returns the goal for the position of a frame relative to the base, over postures.
DesignGoal frame_goal(const CalibratedRobot& robot, const Frame& frame,
                      const std::vector<Readings>& postures);
/// Returns the goal for positions relative to sensors, with equal weight for each view of the
/// samples. A view of a mounted target counts the position of that target; a view of a free target
/// counts that of the chain that holds it, or else of the first sensor that sees it.
DesignGoal sight_goal(const CalibratedRobot& robot, const std::vector<Sample>& samples);
/// Returns the goal for some components, each in yardsticks (rig/scales.h).
DesignGoal component_goal(const CalibratedRobot& robot, const std::vector<Component>& components);

/// SampleRows are the derivatives R of a sample by the unknowns on which it depends.
struct SampleRows {
  std::vector<int> columns;
  MatrixXd rows;
};
/// Returns the rows of samples at the robot's values, in the order of the samples; no rows for a
/// sample without information. `targets` are base_T_target of free targets by (sample, target).
/// @throws Cancelled
std::vector<SampleRows> sample_rows(const CalibratedRobot& robot, const EstimationSetup& setup,
                                    std::vector<Sample> samples,
                                    const std::map<std::pair<int, int>, Pose>& targets,
                                    const Progress& progress);

/// Returns H_0: priors; without a prior, usual errors.
MatrixXd known_before(const CalibratedRobot& robot, const EstimationSetup& setup);
/// Returns H_0 after a calibration: the inverse of its covariance; for what it did not determine,
/// that of known_before().
MatrixXd known_after(const CalibratedRobot& robot, const EstimationSetup& setup,
                     const Unknowns& calibration);
/// Adds the information of samples to `information`.
void add_information(const std::vector<SampleRows>& samples, MatrixXd& information);

struct DesignOptions {
  int count = 20;
  int exchanges = 2;  // rounds over all chosen postures
  /// Called before a candidate is chosen; false excludes it. Empty: all candidates are permitted.
  std::function<bool(int)> allowed;
  Progress progress;
};

struct Design {
  std::vector<int> chosen;     // candidates, most useful first
  std::vector<double> errors;  // root of tr(W C): before any, and after each of these
};

/// Chooses candidates. It ends early if none remains. @throws Cancelled
Design choose_postures(const MatrixXd& known, const std::vector<SampleRows>& candidates,
                       const DesignGoal& goal, const DesignOptions& options);

/// Returns the errors if these candidates are recorded in this order, as in Design::errors.
std::vector<double> errors_of(const MatrixXd& known, const std::vector<SampleRows>& candidates,
                              const DesignGoal& goal, const std::vector<int>& order);

/// A DesignFloor is the error that remains for any number of recordings of the candidates.
struct DesignFloor {
  double error = 0;
  std::vector<std::pair<int, double>> direction;  // columns with the larger coefficients, of the
                                                  // direction that contributes most
};
/// Returns the floor. `data` is the information of all candidates together.
DesignFloor floor_of(const MatrixXd& known, const MatrixXd& data, const DesignGoal& goal);

/// Returns the smallest number of postures from which three times as many would lower the error,
/// with the readings' noise, by less than a tenth; -1: more than `errors` covers.
int enough_postures(const std::vector<double>& errors, double floor, const DesignGoal& goal);

/// A MoreData is the predicted benefit of three times as many samples like the present ones.
struct MoreData {
  double now = 0, thrice = 0,
         readings = 0;            // m: predicted error of sight_goal(); of one reading's noise
  bool worth = false;             // the error, with the readings' noise, falls by a tenth or more
  std::vector<std::string> open;  // if not `worth`: components that these samples hardly determine,
                                  // if most of the error comes from them
};
/// `data` are the equations of the samples' solution. The errors are those that the solution
/// predicts at postures like the samples', each without its own information, including those by
/// parameters that the automatic path holds. Returns nullopt if no estimated parameter affects the
/// positions relative to the sensors.
std::optional<MoreData> more_data(const Linearisation& at, const DataEquations& data);

}  // namespace kincal
