// Samples and views that fit much worse than the others, of a finished calibration.
//
// A view's mean squared whitened residual is compared with the median over the views of its sensor
// (held out: with the larger of the medians of both splits), so that a wrongly stated sigma flags
// nothing. For that median a view counts with what a free target leaves of it: three points before
// two cameras have half the noise as residuals, before one none, and what is usual of them would
// make outliers of views that have all of it. Likewise a sample's mean squared joint error in
// sigmas with the median over samples. It sticks out above nine times the usual (three times in
// size) and above what chance allows, chi2_bound(n) / n. A sample with more than half of its views
// sticking out, or its joint errors, is named as a sample. Only samples are looked at whose
// squares, joint errors included, are larger than chance makes the largest in one of a hundred
// recordings: where joint errors take up most of what is seen, some views keep all of theirs. After
// a plain fit that gross outliers have ruined the names may be wrong: calibrate_without_outliers()
// finds the right ones.
#pragma once

#include <vector>

#include "residuals.h"

namespace kincal {

/// A Misfit is something that sticks out: a sample, or a view of one.
struct Misfit {
  double ratio;      // its mean square over the usual one
  std::string name;  // quoted, for messages
};
struct Misfits {
  std::vector<Misfit> samples, views;  // the worst first
};
Misfits misfits(const Solution& solution, const Residuals& residuals);

}  // namespace kincal
