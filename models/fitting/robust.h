// Robust fits whose scale comes from the data, and what size residuals may have.
//
// Noise ratio of a sensor: the noise that the data show over the one that the rig states, as the
// robust standard deviation of its whitened residuals, 1.4826 median |r| (MAD about 0; Hampel et
// al., Robust Statistics, 1986). It is 1 where the stated sigmas hold. A chain's residuals are all
// but absorbed by the free target it holds: its noise ratio is never below 1.
//
// Graduated fit (graduated non-convexity, Blake and Zisserman 1987; here of Cauchy-like losses):
// with a redescending loss at its final scale, a fit from a rough start gives up whatever is far
// off, be it right or wrong. So all sensors begin with one scale, the largest noise ratio that the
// start shows, and each falls by at most a factor 4 a round down to its own noise ratio of the
// round before. As long as a majority is right, the ratios fall with the fit, and what is wrong
// stays behind.
#pragma once

#include <vector>

#include "../../solver/levenberg_marquardt.h"
#include "../estimation/estimation.h"

namespace kincal {

constexpr double kLeastNoiseRatio = 0.05;  // residuals of nothing (noise-free data) leave no scale

/// Returns the estimated noise over the assumed noise of each sensor; 1 where a sensor has no
/// residuals.
std::vector<double> robust_noise_ratios(const Rig& rig,
                                        const std::vector<ViewResiduals>& residuals);

/// Solves from `state`, in place, with the problem's loss. Its scales fall to the noise ratios of
/// the data, or to `noise_ratios` where given, and stay there (EstimationSetup::noise_ratios). Each
/// round goes as far as steps lower the cost by a thousandth: another solve() is to converge.
/// @throws Cancelled
SolveSummary solve_graduated(Estimation& problem, const Rig& rig, SolverOptions options,
                             VectorXd& state, const std::vector<double>* noise_ratios = nullptr);

/// Returns the bound of chi2 with n degrees of freedom that chance exceeds as often as a normal
/// number exceeds six sigmas: once in 1e9.
double chi2_bound(long n);

}  // namespace kincal
