// What is estimated, from which sensors, with which noise: what one minimisation is asked for, and
// what it finds.
#pragma once

#include <map>
#include <utility>
#include <vector>

#include "../../solver/loss.h"
#include "../rig/parameters.h"
#include "../rig/selection.h"

namespace kincal {

struct Prior {
  int parameter, component;
  double sigma;
};

struct EstimationSetup {
  NoiseMode noise = NoiseMode::latent;
  Loss loss;
  std::vector<double> noise_ratios;  // by sensor: unit of the loss's scale in sigmas; empty: 1
  std::vector<int> sensors;          // indices; views of others do not take part
  std::vector<Freed> free;
  std::vector<Prior> priors;  // of freed components only
  int only_target = -1;       // views of this target only (to start it)
  bool apart = false;  // samples are solved one at a time, Estimation::take_alone() says which;
                       // nothing shared is freed
  VectorXd
      initial;  // shared values that priors and partly freed poses count from; empty: the rig's
};

/// Values are everything that is estimated: shared parameters (ParameterTable's layout), poses of
/// free targets by (sample, target), joint errors by (sample, joint).
struct Values {
  VectorXd shared;
  std::map<std::pair<int, int>, Pose> targets;
  std::map<std::pair<int, int>, double> errors;
};

}  // namespace kincal
