// Input and output of one minimisation: the estimated components, the sensors, the noise; ambiguous
// starts; the values and residuals found.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/loss.h"
#include "../rig/parameters.h"
#include "../rig/selection.h"

namespace kincal {

struct View;

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
  std::vector<Prior> priors;  // of estimated components only
  int only_target = -1;       // views of this target only (to start it)
  bool apart = false;  // samples are solved one at a time, selected by Estimation::take_alone();
                       // no shared parameter is estimated
  VectorXd initial;    // reference of priors and partly estimated poses; empty: the rig's values
};

/// An AmbiguousStart is a pair of poses for which the data give several solutions that fit equally
/// well.
struct AmbiguousStart {
  std::string first, second;  // names of the parameters
  double turned = 0;          // rad, the first pose from one solution to the next
};

/// Values are all estimated quantities: shared parameters (ParameterTable's layout), poses of free
/// targets by (sample, target), joint errors by (sample, joint).
struct Values {
  VectorXd shared;
  std::map<std::pair<int, int>, Pose> targets;
  std::map<std::pair<int, int>, double> errors;
};

/// ViewResiduals are the residuals of one view at a state.
struct ViewResiduals {
  const View* view = nullptr;
  int sample = -1;
  VectorXd raw;  // blocks * rows of the sensor's own model, unwhitened
  VectorXd
      whitened;  // whitened, without the loss; in mode `point` a chain has 3 a target point here
};

}  // namespace kincal
