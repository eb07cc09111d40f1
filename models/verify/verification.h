// Is a robot as accurate as is claimed? Positions that an instrument measured, beside those that
// the robot's model predicts: accuracy, repeatability and distances after ISO 9283, each with its
// uncertainty, and the decision on a tolerance after ISO 14253-1.
//
// Views of one posture are taken together: its barycentre counts, with the noise of a mean. With
// the errors e_i = measured - predicted of n postures and the instrument's covariances C_i
//     rms^2 = f mean |e_i|^2 - mean trace C_i,      f = 3 n / (3 n - fitted numbers).
// Distances need no common frame: of each pair of postures d_ij = |m_i - m_j| - |p_i - p_j|, and
//     rms^2 = mean d_ij^2 - mean u_ij' (C_i + C_j) u_ij,      u_ij along m_i - m_j.
// The interval of such a mean square Q: as if freedom Q / E[Q] were chi-squared, freedom = 2 Q^2 /
// var Q; var Q is the jackknife's over postures (each stands in many pairs), never less than that
// of Gaussian errors of the same covariance, and enlarged by (n + 1) / (n - 3), for few postures
// tell little of it. The instrument's variance is itself uncertain (kInstrumentKnown). Both parts
// add as squares, above and below. Where errors are smaller than the instrument's noise alone, that
// is stated too large, and the upper limit is that of the errors as they are seen; so it is where
// nobody states it. All limits are
// for k = 2: a share of 2.3 % beyond each.
//
// Rotations are judged like positions, by the rotation vectors of predicted^-1 measured.
//
// The largest error is that of the measured postures (pairs) without the instrument's noise. With s
// the instrument's sigma (of a covariance the root of its largest eigenvalue) it is at most the
// largest |e_i| + k s_i, as the posture of the largest error is itself measured. It is at least the
// largest L_i, where an error of length L_i would be seen as |e_i| or more with probability 2.3 %
// / n, as each of n postures may have had the largest noise. Both as if kInstrumentKnown were
// Student's, with 1 / (2 kInstrumentKnown^2) degrees of freedom.
#pragma once

#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// How well an instrument's stated sigma is known, relative, k = 1.
constexpr double kInstrumentKnown = 0.1;
constexpr int kFewestPostures = 5;  // the test poses of ISO 9283

/// A VerifiedView is a target as it was measured and as it was predicted, in the instrument's
/// frame, m.
struct VerifiedView {
  int posture = 0;    // views of one posture have the same
  int approach = -1;  // which way the robot came; -1: not known
  Vector3d measured{0, 0, 0}, predicted{0, 0, 0};
  Matrix3d noise = Matrix3d::Zero();  // covariance of the measured position
  bool noise_known = true;  // stated for the instrument; else found from the robot's own errors
  bool turned = false;      // the instrument measures rotations, too
  Matrix3d measured_rotation = Matrix3d::Identity(), predicted_rotation = Matrix3d::Identity();
  Matrix3d rotation_noise = Matrix3d::Zero();  // covariance of the measured one, its axes, rad^2
};

/// Returns one view a posture, in the order of the postures: means of positions and rotations, with
/// the noise of a mean.
std::vector<VerifiedView> barycentres(const std::vector<VerifiedView>& views);

/// Moves all predictions by the rigid motion that brings their positions nearest to the measured
/// ones, and returns that motion. Six numbers are fitted.
Pose refit_base(std::vector<VerifiedView>& views);

/// An AccuracyFigure is a root mean square over postures, or pairs of them, m or rad.
struct AccuracyFigure {
  long postures = 0;
  double seen = 0;              // rms with the instrument's noise in it
  double instrument = 0;        // rms of that noise
  bool noise_known = true;      // else nothing is taken out of the figure and its upper limit
  double rms = 0;               // without it
  double max = 0;               // with it
  double lower = 0, upper = 0;  // of the rms, k = 2
  double freedom = 0;           // effective, of the mean square
  double max_lower = 0, max_upper = 0;  // of the largest error without the noise, k = 2
};
/// Returns the figure of positions. `views` has one view a posture, `fitted` is how many numbers
/// were fitted to them.
AccuracyFigure position_accuracy(const std::vector<VerifiedView>& views, int fitted = 0);
/// Returns the figure of distances between any two postures.
AccuracyFigure distance_accuracy(const std::vector<VerifiedView>& views);
/// Returns the figure of the rotations between measured and predicted ones, rad. `postures` is 0
/// where none is measured.
AccuracyFigure rotation_accuracy(const std::vector<VerifiedView>& views);

/// A RepeatedPosture is a posture that was taken several times, after ISO 9283.
struct RepeatedPosture {
  int posture = 0, count = 0;
  double ap = 0, ap_uncertainty = 0;  // m: barycentre from the prediction; k = 2
  double rp = 0, rp_uncertainty = 0;  // m: mean + 3 S of distances from the barycentre; k = 2
  bool turned = false;
  Vector3d rp_rotation{0, 0, 0};  // rad: 3 S of rotations from the mean one, about x, y, z
  int approaches = 0;             // with a view
  double vap = 0;                 // m: largest distance between the barycentres of two approaches
};
/// Returns what postures with at least two views say of repeatability.
std::vector<RepeatedPosture> repeated_postures(const std::vector<VerifiedView>& views);

/// A Scatter is how far views of one posture lie from its barycentre: instrument and robot
/// together.
struct Scatter {
  long freedom = 0;   // of 3-D points, without the barycentres; 0: no posture repeats
  double sigma = 0;   // m, of a position (root of the trace)
  double stated = 0;  // m, the instrument's alone
  bool less = false;  // significantly less than stated: the stated sigma is too large
};
Scatter scatter(const std::vector<VerifiedView>& views);

enum class Conformity { pass, fail, not_provable };
/// Compares the limits of a figure with a tolerance on its rms, or on its largest error.
Conformity conformity(const AccuracyFigure& figure, double tolerance, bool largest = false);
/// Returns the share of postures distributed like n measured ones that have an error below the
/// largest of these, in all but 2.3 % of cases.
double share_below_largest(long postures);
/// Returns about how many postures it takes to prove one or the other, if the rms stays as it is;
/// -1: no number of them does.
long postures_needed(const AccuracyFigure& figure, double tolerance);

}  // namespace kincal
