// Outliers of a finished calibration: samples and views that fit much worse than the others.
//
// A view's mean squared whitened residual is compared with the median over the views of its sensor
// (held out: with the larger of the medians of both splits), so that a wrongly stated sigma flags
// nothing. For that median a view counts with the share of its noise that a free target leaves in
// its residuals: half for three points before two cameras, none before one camera. Otherwise views
// that keep all their noise would appear as outliers. Likewise a sample's mean squared joint error
// in sigmas is compared with the median over samples. An outlier is above nine times the median
// (three times in size) and above the limit of chance, chi2_bound(n) / n. If more than half of a
// sample's views are outliers, or its joint errors, the sample itself is named. Only samples are
// tested whose squares, joint errors included, are larger than the largest by chance in one of a
// hundred recordings: where joint errors absorb most residuals, some views keep all of theirs.
// After a plain fit that gross outliers have corrupted, the names may be wrong:
// calibrate_without_outliers() finds the right ones.
#pragma once

#include <vector>

#include "residuals.h"

namespace kincal {

/// A Misfit is an outlier: a sample, or a view of one.
struct Misfit {
  double ratio;      // its mean square over the usual one
  std::string name;  // quoted, for messages
};
struct Misfits {
  std::vector<Misfit> samples, views;  // the worst first
};
Misfits misfits(const Solution& solution, const Residuals& residuals);

}  // namespace kincal
