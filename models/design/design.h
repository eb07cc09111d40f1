// Which postures to record: the choice, of many candidates, that makes the calibration's error at a
// goal smallest.
//
// Information. The unknowns d of a calibration have the information
//     H = H_0 + sum over samples of R_i' R_i;
// R_i are the whitened derivatives of a sample after the elimination of its own unknowns (the pose
// of a free target, errors of the joints' readings): solver/observability.h, reduced_rows(). They
// depend on the posture and on which points are seen, not on the measured values. H_0 are the
// priors; a component without one is known to its usual error (rig/scales.h), and the samples there
// are already add theirs.
//
// Goal. The mean square error of positions over postures is
//     E |J d|^2 + noise of the readings = tr(W C) + q,   W = mean of J'J,  C = H^-1,
// J that of a frame relative to the base, or of what one frame sees of another: with the twists of
// both (analysis/frames.h)  dp_B - dp_A - w_A x (p_B - p_A),  which no common motion changes.
//
// Choice. Adding R lowers tr(W C) by  |S^-1/2 R C L|^2,  S = 1 + R C R', W = L L'. The best posture
// is taken again and again; gains fall as postures are added, so that one whose gain was smaller
// before need not be looked at again (Minoux 1978; not exact for tr(W C), but nearly). Then each
// chosen one is exchanged for a better one as long as there is any (Fedorov 1972).
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/progress.h"
#include "../analysis/frames.h"
#include "../estimation/setup.h"
#include "../rig/samples.h"

namespace kincal {

/// A DesignGoal is the quantity whose error is minimised: mean squares are taken over postures.
struct DesignGoal {
  std::string name, unit;
  MatrixXd weight;      // W, by the unknowns: the calibration's mean square error is tr(W C)
  double readings = 0;  // q: that of one reading of each joint
};

/// The position of a frame relative to the base, over postures.
DesignGoal frame_goal(const CalibratedRobot& robot, const Frame& frame,
                      const std::vector<Readings>& postures);
/// What sensors see, over the samples: for each sensor and what it sees, or the chain that holds
/// that, where the one is for the other; all pairs count alike.
DesignGoal sight_goal(const CalibratedRobot& robot, const std::vector<Sample>& samples);
/// Some components, each in yardsticks (rig/scales.h).
DesignGoal component_goal(const CalibratedRobot& robot, const std::vector<Component>& components);

/// A SampleRows has the derivatives R of a sample, by the unknowns that it depends on.
struct SampleRows {
  std::vector<int> columns;
  MatrixXd rows;
};
/// Returns the rows of samples at the robot's values, in the order of the samples; no rows for a
/// sample without information. `targets`: base_T_target of free targets by (sample, target).
/// @throws Cancelled
std::vector<SampleRows> sample_rows(const CalibratedRobot& robot, const EstimationSetup& setup,
                                    std::vector<Sample> samples,
                                    const std::map<std::pair<int, int>, Pose>& targets,
                                    const Progress& progress);

/// Returns H_0: priors, else usual errors.
MatrixXd known_before(const CalibratedRobot& robot, const EstimationSetup& setup);
/// Adds the information of samples.
void add_information(const std::vector<SampleRows>& samples, MatrixXd& information);

struct DesignOptions {
  int count = 20;
  int exchanges = 2;  // rounds over all that were chosen
  /// Asked before a candidate is chosen; false: it cannot be. Empty: all can.
  std::function<bool(int)> allowed;
  Progress progress;
};

struct Design {
  std::vector<int> chosen;     // candidates, those that help most first
  std::vector<double> errors;  // root of tr(W C): before any, and after each of these
};

/// Chooses candidates. It ends early where none is left. @throws Cancelled
Design choose_postures(const MatrixXd& known, const std::vector<SampleRows>& candidates,
                       const DesignGoal& goal, const DesignOptions& options);

/// Returns the errors of these candidates taken in this order, as Design::errors.
std::vector<double> errors_of(const MatrixXd& known, const std::vector<SampleRows>& candidates,
                              const DesignGoal& goal, const std::vector<int>& order);

/// A DesignFloor is the error that remains however many of the candidates are recorded.
struct DesignFloor {
  double error = 0;
  std::vector<std::pair<int, double>> direction;  // columns with the larger coefficients, of the
                                                  // direction that contributes most
};
/// `data`: their information together.
DesignFloor floor_of(const MatrixXd& known, const MatrixXd& data, const DesignGoal& goal);

/// Returns the number of postures from which on three times as many lower the error, with the noise
/// of the readings in it, by less than a tenth; -1: more than `errors` has.
int enough_postures(const std::vector<double>& errors, double floor, const DesignGoal& goal);

/// A MoreData is what three times as many samples like those there are would bring.
struct MoreData {
  double now = 0, thrice = 0, readings = 0;  // m: what sensors see, predicted; one reading's noise
  bool worth = false;  // it lowers the error, with the readings' noise in it, by a tenth or more
  std::vector<std::string> open;  // where it is not: components that such samples hardly tell, if
                                  // most of the error comes from them
};
/// `data` are the equations of the samples' solution. nullopt: nothing that is estimated changes
/// what the sensors see.
std::optional<MoreData> more_data(const Solution& solution, const DataEquations& data);

}  // namespace kincal
