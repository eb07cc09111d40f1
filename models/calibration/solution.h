// The outcome of a calibration: values, their uncertainty, and the course of the steps. From it,
// models/analysis and models/report compute residuals, noise levels, weak directions and warnings.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/observability.h"
#include "../../solver/progress.h"
#include "../estimation/setup.h"
#include "../rig/recording.h"
#include "../rig/selection.h"

namespace kincal {

class Estimation;

/// A Direction of the parameters: names of components with coefficients, in real units.
using Direction = std::vector<std::pair<std::string, double>>;

struct StepResult {
  std::string name;
  bool converged = false;
  bool repeated = false;  // as in the step's plan: it need not converge
  int iterations = 0;
  double chi2_initial = 0, chi2 = 0, cost = 0, seconds = 0;
  long dof = 0;
  double chi2_data = 0, dof_data = 0;  // as the solution's
  const char* linear_solver = "";
  std::vector<std::pair<double, double>>
      history;  // chi2 and damping: at the start and after each iteration
  std::vector<std::string> unused, held_out;  // as in the step's plan
  std::vector<Direction> unobservable;
};

struct ParameterEstimate {
  std::string name;
  std::vector<std::string> components, units;
  std::vector<double> initial, value;  // poses: increments from the initial pose
  std::vector<double> sigma;           // NaN: unobservable; 0: fixed
  std::vector<char> freed;             // components that some step estimated
  std::vector<double> prior;           // sigmas of the last step's priors, 0: none
  std::string step;                    // the last that estimated it
  std::optional<Pose> pose;            // absolute, of poses
  int parameter = -1;                  // index in the table

  std::string component_name(size_t c) const {
    return components[c].empty() ? name : name + "." + components[c];
  }
};

/// With `undefined_start` the first state of a step cannot be evaluated (a point behind its
/// camera); `message` names the sample and its views. `unexplained`: everything converged, but the
/// model does not explain the data; study() decides this (report/verdict.h).
enum class Status {
  converged,
  unobservable,
  not_converged,
  undefined_start,
  cancelled,
  unexplained
};

/// A ReplacedStart is a pose in the rig that the data contradict, and from which the calibration
/// therefore did not start (calibration/start_poses.h).
struct ReplacedStart {
  std::string name;
  double moved = 0, turned = 0;  // from the given pose to the estimate: m, rad
  double cost_per_dof = 0;       // where the run from the given pose ended; 0: it could not start
};

/// LastProblem is the last step's problem at the solution with its observability, the input of
/// analyses. Only analysis/linearisation uses it.
struct LastProblem {
  std::shared_ptr<Estimation> problem;
  VectorXd state;
  Observability observability;
  std::vector<MatrixXd> kept_rows;  // as observe() gives them
};

/// A Prediction is the basis of predicted errors where the last step's covariance is not
/// sufficient: it includes the second moment of fixed components (automatic/automatic.h).
struct Prediction {
  std::vector<Component> columns;
  MatrixXd covariance;
  MatrixXd lasting = {};  // part of it that more samples leave (automatic/pose_errors.h); empty:
                          // none. Of the first columns
};

/// DataEquations are the information of the data alone at a solution, without the priors of shared
/// unknowns: N d = pull for an increment d of its values. N is the information matrix; its null
/// space are the directions that the data do not determine.
struct DataEquations {
  std::vector<Component> columns;
  MatrixXd normal;
  VectorXd pull;
};

struct Solution {
  std::shared_ptr<const Recording> recording;
  Status status = Status::converged;
  std::string message;  // reason why it is not usable, a sentence; else empty
  NoiseMode noise = NoiseMode::latent;
  double chi2 = 0, cost = 0;
  long dof = 0;
  // Measurements and joint errors only: without the terms of priors of shared parameters, and with
  // the effective number of parameters, tr(H_data H^-1), in place of that of the unknowns.
  // Components that priors determine take no degrees of freedom from the data; so chi2_data /
  // dof_data is near 1 if the noise is as stated, independent of the number of priors. (chi2 / dof
  // is not: a prior wider than the actual error adds a degree of freedom and almost nothing to
  // chi2.)
  double chi2_data = 0;
  double dof_data = 0;
  std::vector<StepResult> steps;
  std::vector<Component> columns;  // unknowns of the last step, in the order of the covariance
  VectorXd initial;  // shared values that estimates count from: the rig's, or the closed form
                     // for its open poses
  EstimationSetup
      setup;      // of the last step: Estimation(*recording, training(), setup) at pack(values)
  Values values;  // shared parameters; poses and joint errors of the training samples
  std::vector<Freed>
      seen_held_out;  // parameters that the steps estimate and only held-out samples see
  std::vector<std::string>
      computed_starts;  // poses absent from the rig whose initial value comes from the data
  std::vector<std::string> identity_starts;  // poses absent from the rig, and estimated in part or
                                             // with a prior: they start at the identity
  std::vector<std::string>
      lost_starts;  // those of computed_starts that no measurement connects to a known pose
  std::vector<AmbiguousStart> ambiguous_starts;  // those with several solutions
  std::vector<ReplacedStart> replaced_starts;    // given poses that the data contradict
  std::vector<std::string> without_effect;       // as in the last step's plan
  std::optional<Prediction> prediction;
  std::optional<DataEquations> data;  // if the last step fixed some of the requested parameters
                                      // (analysis/data_equations.h)
  std::shared_ptr<LastProblem> last;  // null: to be computed again (analysis/linearisation.h)

  // Computed from the values at the end of calibrate(). A repeated Calibration::solve() leaves them
  // empty, and dof_data NaN; Calibration::last() computes them.
  std::vector<ParameterEstimate>
      parameters;                       // all that any step estimated, in the order of the steps
  std::vector<Direction> unobservable;  // of the last step
  MatrixXd covariance;

  const Rig& rig() const { return recording->rig; }
  const ParameterTable& table() const { return recording->table; }
  const std::vector<Sample>& samples() const { return recording->samples; }
  std::vector<int> training() const { return recording->training(); }
  /// Returns chi2_data / dof_data; NaN without degrees of freedom.
  double chi2_per_dof() const;

  /// True if the values can be used: every step converged, and no study found that the model does
  /// not explain the data. (Unobservable directions keep their initial values, and their sigmas are
  /// NaN.)
  bool usable() const { return status == Status::converged || status == Status::unobservable; }
  /// Returns the estimate of a parameter. @throws std::out_of_range if no step estimated it, or if
  /// Calibration::last() has yet to compute the estimates.
  const ParameterEstimate& operator[](const std::string& name) const;
  /// Returns the value of a pose parameter, estimated or not: "sensor/head_camera/pose" is
  /// link_T_sensor. @throws std::out_of_range: no such pose.
  Pose pose(const std::string& name) const;
  /// Returns the robot with calibrated origins and offsets folded in: its positions are scale *
  /// reading.
  Tree tree() const;
};

/// Returns the solution. @throws Cancelled if it was cancelled
Solution uncancelled(Solution solution);

/// A RobotModel has the estimated parent_T_joint and offset of every joint. An unchanged origin is
/// the rig's to the last bit.
struct RobotModel {
  std::vector<Pose> origins;
  std::vector<double> offsets;
};
RobotModel robot_model(const Solution& solution);

// How calibrate() fills in a solution, step by step.
/// Returns the unobservable directions with the names of their components.
std::vector<Direction> named_directions(const ParameterTable& table,
                                        const std::vector<Component>& columns,
                                        const Observability& observability);
/// Sets the sigmas, priors and step of the estimates in `columns` at the end of a step.
void set_sigmas(const Observability& observability, const std::string& step,
                const std::vector<Prior>& priors, Solution& solution);
/// Sets the values of all estimates from those of the shared parameters.
void set_values(Solution& solution);
/// Recomputes dof_data, the last step's estimates, the covariance and the unobservable directions
/// at the current values of a repeated last step.
void complete(Solution& solution);

}  // namespace kincal
