// Bundle Adjustment in the Large: files, a synthetic street, and kincal's side of the comparison.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "../models/bundle_adjustment/bundle_adjustment.h"
#include "../solver/reduced_system.h"
#include "run.h"

namespace kincal::benchmarks {

/// Reads `cameras points observations`, `camera point x y` an observation, then the numbers of
/// cameras and points, one a line. A name that ends in .xz is unpacked by the program xz.
/// @throws std::runtime_error naming the file.
BundleAdjustmentData read_bal(const std::string& path);

/// Cameras stand in a ring, 1.25 m apart, and look outwards at a facade about 10 m away. Each point
/// is seen by 3 to 10 cameras in a row, 6.24 on average, so that the reduced camera matrix is a
/// band. Image noise 0.5 px; the start is off by a few cm and mrad.
BundleAdjustmentData synthetic_bal(int cameras, int points, std::uint64_t seed = 1);

/// "500 cameras, 100000 points, 624000 observations"
std::string describe(const BundleAdjustmentData& data);

struct KincalBalOptions {
  int threads = 1;
  int max_iterations = 200;
  double relative_decrease = 1e-6;
  LinearSolver linear_solver = LinearSolver::automatic;
};
struct KincalBalRun : Run {
  std::string linear_solver;
  std::vector<double> costs;  // at the start and after each iteration
};
KincalBalRun solve_with_kincal(const BundleAdjustmentData& data, const KincalBalOptions& options);

}  // namespace kincal::benchmarks
