// Local offsets: additional joint offsets that are valid only around one posture (the paper's
// section 5.5, the plug-in task).
//
// A calibrated robot still has errors that a rigid model cannot express: belts that stretch, links
// that bend, gears with runout. These vary slowly with the posture, so near one posture they are a
// constant error of each joint's position, delta. It is estimated from the samples near the
// posture, with everything else fixed.
//
// One sample. With its free targets and joint errors eliminated (an orthogonal factorisation, as in
// solver/observability.h) and its rows compressed by a singular value decomposition, sample i gives
//     z_i = F_i delta + noise,  noise ~ N(0, s^2 1),   F_i: at most p rows for p joints,
//     |z_i - F_i delta|^2: its chi2 in these rows.
// F and z are computed again at the estimate, three times in all; offsets are small, so that the
// last two agree.
//
// Estimate. d_i is the sample's distance from the posture: the largest difference of a named
// joint's position (rad; m of a prismatic joint count as rad: an arm is about a metre long;
// continuous joints the short way round). It is the distance that a user can check joint by joint:
// "no joint is further than this". With w_i = (1 - (d_i / h)^2)^2 within the bandwidth h, 0 beyond
// (biweight kernel), and a prior N(0, t^2) on every offset,
//     delta = A^-1 g,   A = W + s^2 / t^2,   W = sum w_i F_i'F_i,   g = sum w_i F_i'z_i.
// A direction that the samples near do not determine stays at 0. t (0.01 to 30 mrad, mm) is that of
// the largest evidence
//     g'A^-1 g / s^2 - log |1 + W t^2 / s^2|.
// h (from twice the distance of the nearest kLocalSamples samples, in steps of 1.3, to all that are
// looked at) is that of the least weighted sum of |z_i - F_i delta_-i|^2 over the nearest samples
// (weights of the smallest h); delta_-i is the estimate without sample i. So an error that bends
// takes few samples and a constant one many.
//
// Noise as seen: s^2 = sum w_i |z_i - F_i delta|^2 over its expectation for s = 1, which is (for t
// = infinity)
//     sum w_i rows_i - 2 tr(W^-1 B) + tr(W^-1 B),   B = sum w_i^2 F_i'F_i.
// It is the scatter of whole samples about each other in the directions that matter (Birge's
// ratio), not that of 100 corners of one view.
//
// Sigma. Weights are no noise: a distant sample is not noisier, it only counts less. And scatter
// beyond the rig's noise is not averaged away: the offset itself varies within the bandwidth, or
// the robot does not repeat. So the offset of sample i is delta + gamma_i, gamma_i ~ N(0, G), G
// diagonal, noise s0 = min(1, s); G by expectation and maximisation,
//     P_i = (F_i'F_i / s0^2 + G^-1)^-1,  m_i = P_i F_i'(z_i - F_i delta) / s0^2,
//     G_j = sum w_i (m_ij^2 + P_i,jj) / sum w_i,
// and the variance of the right offset at one posture near here is
//     A^-1 (s0^2 B + s^4 / t^2 + sum w_i^2 F_i'F_i G F_i'F_i) A^-1 + G.
// The mean alone is more certain if the samples lie evenly around the posture, which is unknown.
//
// Radius of validity. g_i = |z_i|^2 - |z_i - F_i delta_-i|^2 is the gain by the offsets at sample
// i, which took no part in their estimate. With growing distance, the sum of g_i grows while they
// predict better than the plain calibration; the radius is where it is largest. A gain is claimed
// if that sum is at least two of its standard errors and if the offsets are no accident: under the
// hypothesis that there are none g ~ N(0, s^2 B), so that (g'B^-1 g / p) / s^2 has an F
// distribution; as a standard normal number it must be above 3.5. The margin is for having chosen h
// and the radius.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "../../solver/progress.h"
#include "../analysis/residuals.h"

namespace kincal {

/// A posture needs at least this many samples near it.
constexpr int kLocalSamples = 8;

/// A LocalPosture has positions (rad, m) by joint index, of the joints that define the distance and
/// whose offsets are estimated.
using LocalPosture = std::map<int, double>;

struct LocalOptions {
  NoiseMode noise = NoiseMode::latent;
  double within = 1;  // rad, m: more distant samples take no part
  Progress progress;
};

struct LocalOffset {
  int joint = -1;
  /// rad, m: position = scale * reading + the rig's offset + this. NaN: unknown, because no sample
  /// within the bandwidth depends on the joint; `sigma` and `variation` are then NaN as well.
  double offset = 0;
  double sigma = 0;  // of the right offset at a posture near this one; NaN if no gain is claimed
  double variation =
      0;  // part of sigma: scatter from posture to posture beyond the noise as stated; NaN likewise
  bool determined = false;  // by the samples; else by the prior (sigma above 0.9 of the prior's)
};

struct LocalCalibration {
  std::vector<std::string>
      not_converged;              // samples whose targets and joint errors did not converge
  std::vector<std::string> open;  // poses absent from the rig, estimated from all training samples
  std::vector<double> distances;  // of all training samples that have the joints, ascending
  int near = 0;         // of these within the limit with a view that depends on the joints
  bool enough = false;  // near >= kLocalSamples; else nothing below is set
  bool gain = false;    // else the offsets are 0: the plain calibration is as good here
  bool ends =
      true;  // the gain ends within the tested samples; else the radius is that of the furthest
  double radius = 0;  // rad, m; without gain: the bandwidth, to which the errors below apply
  int samples = 0;    // training samples within the radius
  double bandwidth = 0, prior = 0;  // the chosen h and t
  double noise = 0;                 // s, estimated
  double chi2_before = 0,
         chi2 = 0;  // within the radius, in the directions of the offsets; left out one by one
  double gain_sigma = 0;    // standard error of chi2_before - chi2
  double significance = 0;  // of the offsets, as a standard normal number
  std::vector<LocalOffset>
      offsets;  // in the order of joint indices, of joints that some view near depends on
  /// Errors within the radius: rms_before and rotation_before without the offsets, rms_as_read and
  /// rotation_as_read with them. Readings count as exact, free targets are estimated, training
  /// samples are left out one by one. The other members are not set.
  std::vector<SensorResult> sensors;
};

/// Returns the positions of the joints that the sample's views depend on.
LocalPosture posture_of(const Rig& rig, const Sample& sample);

/// Estimates the offsets around a posture of a calibrated `rig`. Its steps only define which absent
/// poses are open; these are estimated first. Samples with split `test` take no part in the
/// estimate and only judge it.
/// @throws std::invalid_argument: a posture without joints, or a joint that no sample has;
/// std::runtime_error: an open pose that the samples do not determine; Cancelled.
LocalCalibration calibrate_locally(const Rig& rig, const std::vector<Sample>& samples,
                                   const LocalPosture& posture, const LocalOptions& options);

}  // namespace kincal
