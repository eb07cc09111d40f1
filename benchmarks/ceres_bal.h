// Bundle adjustment in Ceres: points eliminated first, automatic or analytic derivatives, dense or
// sparse reduced system.
#pragma once

#include <memory>

#include "../models/bundle_adjustment/bundle_adjustment.h"
#include "run.h"

namespace kincal::benchmarks {

class CeresBal {
 public:
  /// Copies the parameters; `data` must outlive this.
  CeresBal(const BundleAdjustmentData& data, bool analytic);
  ~CeresBal();
  /// From the start, whatever was solved before.
  Run solve(bool sparse, int threads = 1);

 private:
  struct Implementation;
  std::unique_ptr<Implementation> i_;
};

}  // namespace kincal::benchmarks
