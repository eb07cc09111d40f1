// One minimisation as the solver's Problem: which sensors, which freed parameters, which noise
// mode, which samples.
//
// A group is a sample. Its private unknowns are, in this order, the poses of its free targets (6
// each, increments on the right of base_T_target) and, in mode `latent`, the errors of its noisy
// joints (prior N(0, sigma^2)); then come the shared columns it touches. Each view contributes J =
// L M (models/sensors/sensor.h): L from the sensor, M from the path between sensor and target
// (kinematics/tree.h). A last group without private unknowns carries the priors of shared
// parameters.
//
// Noise modes (covariance of the whitened residuals of one view; Jq = L Mq: derivative by the
// joints' readings, S their variances):
//   latent, none: own noise only.
//   marginal:     own + Jq S Jq' for all residuals of the view together (the paper's equations
//   (11)-(14), (21)). With U = own^-1/2 Jq S^1/2
//                 = Q w^1/2 V' its root is applied to the few columns of U only:
//                 (1 + U U')^-1/2 = 1 - U K U',
//                 K = V ((1 - (1 + w)^-1/2) / w) V'
//                 (Woodbury's identity for the root: it never subtracts large Gram matrices).
//   point:        only the block of each point of that matrix, as the paper's code did.
// Covariances that depend on the parameters are held between calls of renew().
//
// Samples apart. Where nothing shared is estimated each sample is a problem of its own. With
// `apart` they are laid out together, for that takes longer than to solve one, and taken one at a
// time: one group, and a state of the shared values and of this sample's alone.
//
// Poses: a wholly freed one moves by T <- T exp(increment). Of a partly freed one the freed
// components of xi in T = T0 exp(xi) are the unknowns and the others keep their values; with chart
// = columns of J_r(xi), dT = T exp(chart d).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "../../solver/problem.h"
#include "../rig/recording.h"
#include "setup.h"

namespace kincal {

/// NoiseRows are rows of a group that are one kind of noise: of one part of a view (noise_parts()
/// of its model), one joint's error, or priors.
struct NoiseRows {
  const View* view = nullptr;  // else null
  int part = 0;
  int joint = -1;  // else -1
  int first = 0, count = 0;
  // Of a view: so many residuals the rows stand for, and so many of the rows, the first, hold all
  // that a motion of the target changes.
  int residuals = 0, motion = 0;
};

/// So many samples are laid out together to be solved apart: more take memory and gain nothing.
constexpr size_t kLaidOutTogether = 64;

class Estimation final : public Problem {
 public:
  /// `samples` are the indices of those that take part; samples without a view of the setup's
  /// sensors make no group.
  /// @throws std::invalid_argument where a path needs a floating joint or a joint that follows a
  /// scanning one.
  Estimation(const Recording& recording, const std::vector<int>& samples, EstimationSetup setup);
  ~Estimation() override;
  Estimation(const Estimation&) = delete;
  Estimation& operator=(const Estimation&) = delete;

  /// True if no sample shows anything to the setup's sensors.
  bool empty() const;
  const EstimationSetup& setup() const;
  /// Returns how many samples show something.
  int sample_count() const;
  /// Returns the sample behind a group, -1 for the group of priors.
  int sample_of(int group) const;
  /// Returns the shared values that priors and partly freed poses count from.
  const VectorXd& initial() const;
  /// Returns the name of a shared column, e.g. "joint/head_joint/origin.rz".
  std::string column_name(int column) const;
  /// Returns the component that every shared column is.
  const std::vector<Component>& columns() const;

  /// Makes the state of these values. Free targets whose pose `values` lacks stand at the identity;
  /// missing joint errors are 0.
  VectorXd pack(const Values& values) const;
  void unpack(const VectorXd& state, Values& values) const;
  /// Makes this the problem of one sample alone, with `apart`: of the i-th that shows something.
  /// Until then it is that of the first. A solver that was made before must not be used again.
  void take_alone(int i);
  /// Takes over measured numbers, sigmas or readings that have been replaced in the samples: the
  /// next solve() starts from them without new analysis. The views, their points and the number of
  /// sigmas must have stayed.
  void reload();
  void set_loss(const Loss& loss);
  /// Sets the units of the loss's scale, by sensor: the observed noise over the assumed
  /// (fitting/robust.h).
  void set_noise_ratios(const std::vector<double>& noise_ratios);
  /// Returns the residuals of all views that take part, sample by sample. Call renew() first:
  /// covariances are as it left them.
  std::vector<ViewResiduals> residuals(const VectorXd& state) const;
  /// Returns, by index, whether some view of this problem depends on a parameter by structure (the
  /// formats' rule for globs).
  std::vector<char> influencing() const;

  int shared_size() const override;
  const std::vector<GroupShape>& groups() const override;
  int prior_group() const override;
  void set_workers(int count) override;
  void prepare(const VectorXd& state) override;
  bool evaluate(int group, const VectorXd& state, int worker, Cost& cost) const override;
  bool linearise(int group, const VectorXd& state, int worker, const GroupEquations& to,
                 Cost& cost) const override;
  void begin_piece(int worker) const override;
  void end_piece(int worker, const GroupEquations& to) const override;
  bool square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const override;
  void retract(const VectorXd& state, const VectorXd& shared_step, const VectorXd& private_step,
               VectorXd& moved) const override;
  bool renew(const VectorXd& state) override;

  /// Computes a square root of the group's equations (see Problem::square_root) in which no row
  /// mixes two kinds of noise.
  bool noise_rows(int group, const VectorXd& state, MatrixXd& rows,
                  std::vector<NoiseRows>& kinds) const;
  /// Computes the explicit whitened rows [J_private J_touched r] of a group with the loss's slopes,
  /// one row a residual, for tests.
  bool explicit_rows(int group, const VectorXd& state, MatrixXd& rows) const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace kincal
