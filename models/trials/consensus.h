// Whether one sample agrees with a fit of all, and if not, what of it does not: points, a view, or
// the sample.
//
// Shared parameters are held at the fit; the sample's targets and joint errors are estimated (mode
// `latent`, whatever the mode of the calibration: a view may miss by what the joints' noise
// explains). A sample fits if no residual block is beyond chi2_bound() of its sensor's noise ratio
// and no joint error beyond six sigmas, as it is, or without at most a third of each view's blocks
// that a graduated fit (robust.h) shows to be far off: these are outlying points. If it does not,
// each view is left out in turn. If the others fit then, and are redundant (a target seen by two
// sensors, or one whose place is known), and this holds for one view only, that view is the
// outlier; unless it is a chain, whose measurement is the joint readings. Of five views and more
// several may be out, those that the graduated fit of all gives up, if they are fewer than the
// others. In all other cases it is the sample.
//
// A sample that took no part in the fit may miss because of that: it is judged by what one Newton
// step of all parameters, from their estimate and its covariance, would leave of its residuals.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "../../solver/progress.h"
#include "../estimation/estimation.h"

namespace kincal {

/// A SampleVerdict says what of a sample is out: the sample, views, points of views.
struct SampleVerdict {
  bool out = false;
  std::vector<char> view;                // by view
  std::vector<std::vector<char>> point;  // by view and block; of views that are out as well
  std::string reason;                    // of the sample
  std::vector<std::string> view_reason;

  bool operator==(const SampleVerdict& o) const {
    return out == o.out && (out || (view == o.view && point == o.point));
  }
  /// True if every view of the sample took part, but for points.
  bool took_part() const { return !out && std::count(view.begin(), view.end(), 1) == 0; }
  bool clean() const {
    if (out) return false;
    for (size_t v = 0; v < view.size(); ++v)
      if (view[v] || std::count(point[v].begin(), point[v].end(), 1)) return false;
    return true;
  }
};

/// A ReferenceFit is the fit of all samples that one sample is compared with.
struct ReferenceFit {
  Recording given;           // of which only the rig counts
  std::vector<int> sensors;  // of the last step
  VectorXd shared;
  std::vector<double> noise_ratios;
  // Of the parameters that the last step freed: covariance = root root', columns in their order.
  // Empty: not known (yet).
  std::vector<Freed> free;
  MatrixXd root;
  Progress progress;  // is asked now and then whether to go on
};

/// Returns the verdict that nothing of a sample is out.
SampleVerdict nothing_rejected(const Rig& rig, const Sample& sample);

/// Returns what the verdict leaves of a sample.
Sample without_rejected(const Rig& rig, const Sample& sample, const SampleVerdict& verdict);

/// Judges a sample by the reference. `before` is the verdict under which the reference's values
/// were estimated, and `start` has poses of free targets of sample 0 to start from. @throws
/// Cancelled
SampleVerdict judge_sample(ReferenceFit& reference, const Sample& sample,
                           const SampleVerdict& before, const Values& start);

}  // namespace kincal
