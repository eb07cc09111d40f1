// What to calibrate, chosen by the data: groups of parameters in the order of observability, each
// kept only if it lowers the error on samples that the fit has not seen.
//
// Groups (groups.h). Of a group, components that would not be observable beside those kept before
// are held (wrist roll against the board's roll): found by observe() without priors; of each
// direction the component with the largest coefficient.
//
// Folds. Up to five, of training samples: by sample, the same mixture of sensors and targets in
// each; or, where each sample sees one mounted target and some sensor several of them, by whole
// target, whose pose is then estimated from the fold's own samples when it is judged. For each fold
// everything is fitted to the others; then shared values are held, and free targets and joint
// errors estimated from the fold's samples. Its chi2, with the terms of the joint errors, is -2 log
// of the likelihood with the joint errors integrated out (linearised, up to a constant), so a model
// that needs large joint errors scores worse.
//
// Error. A unit is a held-out sample (or target) i, with n_i measured numbers: c_i = chi2_i / n_i.
// Then
//     error = sqrt(exp(mean_i log(1 + c_i)) - 1)
// is in sigmas: if all c_i are c, it is sqrt(c). The logarithm keeps a few samples that do not fit
// at all from deciding (a sample 1000 times as bad adds 14, not 10^6), and the 1 keeps those from
// deciding that fit perfectly by chance. A group stays if  d_i = log(1 + c_i) - log(1 + c_i')  has
// a mean above two of its standard errors, the error falls by 1 % at least, and more than half of
// the folds agree.
//
// Search. Forward in the order of groups.h, again while something new was kept (another group may
// have hidden it), then backward: each kept group is taken out, and stays out unless it stands the
// same test with everything else there. So what was kept only because something later was still
// missing goes again. Offsets of joints on a chain with freed geometry are contained in it and held
// at their values.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "../estimation/estimation.h"

namespace kincal {

struct StagingOptions {
  NoiseMode noise = NoiseMode::latent;
  int threads = 1;
  /// It is called with the name of the next trial; false cancels.
  std::function<bool(const std::string&)> progress;
};

struct StagingTrial {
  std::string group;
  bool removal = false;                      // of a kept group; else it was added
  bool kept = false;                         // it is among what is freed after this trial
  double error_before = 0, error_after = 0;  // without and with the group, sigmas; NaN: not defined
  std::vector<std::string> parameters;       // names of parameters and components
  int numbers = 0;                           // components
};

struct Staging {
  std::vector<StagingTrial> trials;
  std::vector<Step> steps;  // explicit: what was kept, step by step
  int folds = 0;
  bool by_target = false;  // else by sample
  int units = 0;           // samples or targets judged
};

/// Chooses the steps of a rig without `estimate`, from training samples only. nullopt: cancelled.
/// @throws std::invalid_argument where nothing can be freed; std::runtime_error where a sample
/// cannot start.
std::optional<Staging> stage(const Rig& rig, const std::vector<Sample>& samples,
                             const StagingOptions& options);

}  // namespace kincal
