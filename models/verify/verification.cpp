#include "verification.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../../solver/decompositions.h"
#include "../fitting/closed_form.h"
#include "../rig/distributions.h"

namespace kincal {
namespace {

constexpr double kCoverage = 2;  // k

std::map<int, std::vector<int>> views_by_posture(const std::vector<VerifiedView>& views) {
  std::map<int, std::vector<int>> out;
  for (size_t i = 0; i < views.size(); ++i) out[views[i].posture].push_back(static_cast<int>(i));
  return out;
}

/// The rotation nearest to the sum of rotations.
Matrix3d mean_rotation(const Matrix3d& sum) {
  const Pose turn = fit_points(Matrix3d::Identity(), sum);
  return turn.rotation;
}

/// Positions in columns.
Matrix3Xd positions(const std::vector<VerifiedView>& views, Vector3d VerifiedView::*which) {
  Matrix3Xd out(3, static_cast<Eigen::Index>(views.size()));
  for (size_t i = 0; i < views.size(); ++i) out.col(static_cast<Eigen::Index>(i)) = views[i].*which;
  return out;
}

/// Sets the limits of a figure from its mean squares and its freedom.
void set_limits(AccuracyFigure& figure) {
  const double tail = normal_tail(kCoverage), seen = figure.seen * figure.seen,
               noise = figure.instrument * figure.instrument, square = figure.rms * figure.rms,
               above = seen * (figure.freedom / chi2_quantile(1 - tail, figure.freedom) - 1),
               below = seen * (1 - figure.freedom / chi2_quantile(tail, figure.freedom)),
               known = kCoverage * 2 * kInstrumentKnown * noise;
  figure.upper = noise > seen || !figure.noise_known ? std::sqrt(seen + above)
                                                     : std::sqrt(square + std::hypot(above, known));
  figure.lower = std::sqrt(std::max(0.0, seen - noise - std::hypot(below, known)));
}

/// Student's sigmas for the normal ones of a share beyond: the instrument's own are not known
/// exactly.
double known_sigmas(double tail) {
  return student_quantile(tail, 1 / (2 * kInstrumentKnown * kInstrumentKnown));
}

/// The share of measurements of an error of this length that are longer than `seen`; noise of 1 or
/// 3 dimensions.
double share_longer(double length, double seen, double sigma, int dimensions) {
  const double near = (seen - length) / sigma, far = (seen + length) / sigma;
  double out = normal_tail(near) + normal_tail(far);
  if (dimensions == 3) {
    const double density = 1 / std::sqrt(2 * kPi);
    out += length > 1e-6 * sigma
               ? density * sigma / length * (std::exp(-near * near / 2) - std::exp(-far * far / 2))
               : 2 * density * seen / sigma * std::exp(-near * near / 2);
  }
  return out;
}

/// Takes errors into the largest of a figure.
class LargestError {
 public:
  /// Of `count` errors of 1 or 3 dimensions.
  LargestError(AccuracyFigure& figure, int dimensions, long count)
      : figure_(figure),
        dimensions_(dimensions),
        sigmas_(known_sigmas(normal_tail(kCoverage))),
        tail_(normal_tail(kCoverage) / static_cast<double>(count)),
        wider_(known_sigmas(tail_) / std::sqrt(chi2_quantile(2 * tail_, 1))) {}
  /// One that was seen with this length, along which the noise has this sigma.
  void add(double seen, double sigma) {
    figure_.max = std::max(figure_.max, seen);
    figure_.max_upper = std::max(figure_.max_upper, seen + sigmas_ * sigma);
    if (seen > figure_.max_lower)
      figure_.max_lower = std::max(figure_.max_lower, shortest(seen, wider_ * sigma));
  }

 private:
  /// The length of an error that would be seen longer with this probability; 0: any would.
  double shortest(double seen, double sigma) const {
    if (!(sigma > 0)) return seen;
    double low = 0, high = seen;
    if (share_longer(low, seen, sigma, dimensions_) >= tail_) return 0;
    while (high - low > 1e-6 * seen) {
      const double middle = (low + high) / 2;
      (share_longer(middle, seen, sigma, dimensions_) < tail_ ? low : high) = middle;
    }
    return low;
  }

  AccuracyFigure& figure_;
  int dimensions_;
  double sigmas_, tail_, wider_;  // wider: as Student's at this tail
};

double largest_sigma(const Matrix3d& covariance) {
  return std::sqrt(std::max(0.0, symmetric_eigen(covariance).values(2)));
}

/// Completes a figure: mean squares with the noise and of it, and the relative variance of the
/// first.
void complete(AccuracyFigure& figure, double seen, double noise, double variance) {
  const double n = static_cast<double>(figure.postures);
  figure.seen = std::sqrt(seen);
  figure.instrument = std::sqrt(noise);
  figure.rms = std::sqrt(figure.noise_known ? std::max(0.0, seen - noise) : seen);
  figure.freedom = 2 / (variance * (n + 1) / (n - 3));
  set_limits(figure);
}

/// The relative variance of the mean of n squares of Gaussian vectors with this second moment.
double gaussian_variance(const Matrix3d& moment, long n) {
  const double trace = moment.trace();
  return trace > 0 ? 2 * moment.squaredNorm() / (trace * trace) / static_cast<double>(n) : 1;
}

/// An error as an instrument sees it, m or rad, and the covariance of its noise.
struct MeasuredError {
  Vector3d e;
  Matrix3d noise;
  bool noise_known;
};

/// The figure of one error a posture.
AccuracyFigure accuracy(const std::vector<MeasuredError>& errors, int fitted) {
  AccuracyFigure out;
  out.postures = static_cast<long>(errors.size());
  const double n = static_cast<double>(errors.size()), free = (3 * n - fitted) / (3 * n);
  double sum = 0, squares = 0, noise = 0;
  Matrix3d moment = Matrix3d::Zero();
  LargestError largest(out, 3, out.postures);
  for (const MeasuredError& one : errors) {
    const double q = one.e.squaredNorm();
    sum += q;
    squares += q * q;
    noise += one.noise.trace() / n;
    out.noise_known = out.noise_known && one.noise_known;
    moment += one.e * one.e.transpose();
    largest.add(std::sqrt(q), largest_sigma(one.noise));
  }
  const double mean = sum / n, spread = std::max(0.0, (squares - n * mean * mean) / (n - 1));
  const double jackknife = mean > 0 ? spread / n / (mean * mean) : 0;
  complete(out, mean / free, noise,
           std::max(jackknife, gaussian_variance(moment, out.postures)) / free);
  return out;
}

}  // namespace

std::vector<VerifiedView> barycentres(const std::vector<VerifiedView>& views) {
  std::vector<VerifiedView> out;
  for (const auto& [posture, members] : views_by_posture(views)) {
    VerifiedView mean;
    mean.posture = posture;
    mean.turned = true;
    Matrix3d measured = Matrix3d::Zero(), predicted = Matrix3d::Zero();
    const double n = static_cast<double>(members.size());
    for (const int i : members) {
      mean.measured += views[i].measured / n;
      mean.predicted += views[i].predicted / n;
      mean.noise += views[i].noise / (n * n);
      mean.rotation_noise += views[i].rotation_noise / (n * n);
      mean.turned = mean.turned && views[i].turned;
      mean.noise_known = mean.noise_known && views[i].noise_known;
      measured += views[i].measured_rotation;
      predicted += views[i].predicted_rotation;
    }
    mean.measured_rotation = mean_rotation(measured);
    mean.predicted_rotation = mean_rotation(predicted);
    out.push_back(mean);
  }
  return out;
}

Pose refit_base(std::vector<VerifiedView>& views) {
  const Pose motion = fit_points(positions(views, &VerifiedView::predicted),
                                 positions(views, &VerifiedView::measured));
  for (VerifiedView& view : views) {
    view.predicted = motion * view.predicted;
    view.predicted_rotation = motion.rotation * view.predicted_rotation;
  }
  return motion;
}

AccuracyFigure position_accuracy(const std::vector<VerifiedView>& views, int fitted) {
  std::vector<MeasuredError> errors;
  for (const VerifiedView& view : views)
    errors.push_back({view.measured - view.predicted, view.noise, view.noise_known});
  return accuracy(errors, fitted);
}

AccuracyFigure distance_accuracy(const std::vector<VerifiedView>& views) {
  AccuracyFigure out;
  const size_t count = views.size();
  out.postures = static_cast<long>(count);
  const double n = static_cast<double>(count), pairs = n * (n - 1) / 2;
  std::vector<double> of_posture(count, 0.0);
  double sum = 0, noise = 0;
  LargestError largest(out, 1, static_cast<long>(pairs));
  for (size_t i = 0; i < count; ++i)
    for (size_t j = i + 1; j < count; ++j) {
      const Vector3d between = views[i].measured - views[j].measured;
      const double measured = between.norm(),
                   d = measured - (views[i].predicted - views[j].predicted).norm();
      const Vector3d u = measured > 0 ? Vector3d(between / measured) : Vector3d(0, 0, 0);
      sum += d * d;
      of_posture[i] += d * d;
      of_posture[j] += d * d;
      const double along = u.dot((views[i].noise + views[j].noise) * u);
      noise += along / pairs;
      largest.add(std::abs(d), std::sqrt(along));
    }
  const double mean = sum / pairs, fewer = (n - 1) * (n - 2) / 2;
  double jackknife = 0;
  for (const double own : of_posture) {
    const double without = (sum - own) / fewer - mean;
    jackknife += (n - 1) / n * without * without;
  }
  // Of Gaussian errors: those that a rigid motion leaves, which distances do not see.
  std::vector<VerifiedView> fitted = views;
  refit_base(fitted);
  Matrix3d moment = Matrix3d::Zero();
  for (const VerifiedView& view : fitted) {
    out.noise_known = out.noise_known && view.noise_known;
    const Vector3d e = view.measured - view.predicted;
    moment += e * e.transpose();
  }
  const double relative = mean > 0 ? jackknife / (mean * mean) : 0;
  complete(out, mean, noise, std::max(relative, gaussian_variance(moment, out.postures)));
  return out;
}

AccuracyFigure rotation_accuracy(const std::vector<VerifiedView>& views) {
  std::vector<MeasuredError> errors;
  for (const VerifiedView& view : views)
    if (view.turned)
      errors.push_back({log_so3(view.predicted_rotation.transpose() * view.measured_rotation),
                        view.rotation_noise, view.noise_known});
  return errors.empty() ? AccuracyFigure() : accuracy(errors, 0);
}

std::vector<RepeatedPosture> repeated_postures(const std::vector<VerifiedView>& views) {
  std::vector<RepeatedPosture> out;
  const std::vector<VerifiedView> means = barycentres(views);
  size_t k = 0;
  for (const auto& [posture, members] : views_by_posture(views)) {
    const VerifiedView& mean = means[k++];
    if (members.size() < 2) continue;
    RepeatedPosture one;
    one.posture = posture;
    one.count = static_cast<int>(members.size());
    one.turned = mean.turned;
    const double n = one.count;
    const Vector3d e = mean.measured - mean.predicted;
    one.ap = e.norm();
    double sum = 0, squares = 0;
    Vector3d turns{0, 0, 0};
    std::map<int, std::pair<Vector3d, double>> ways;
    for (const int i : members) {
      const double l = (views[i].measured - mean.measured).norm();
      sum += l;
      squares += l * l;
      if (one.turned)
        turns +=
            log_so3(mean.measured_rotation.transpose() * views[i].measured_rotation).cwiseAbs2();
      if (views[i].approach < 0) continue;
      auto& way = ways.insert({views[i].approach, {Vector3d(0, 0, 0), 0}}).first->second;
      way.first += views[i].measured;
      way.second += 1;
    }
    const double mean_l = sum / n,
                 s = std::sqrt(std::max(0.0, squares - n * mean_l * mean_l) / (n - 1));
    one.rp = mean_l + 3 * s;
    one.rp_rotation = 3 * (turns / (n - 1)).cwiseSqrt();
    // The barycentre is a mean of n; a standard deviation of n is known to 1 / sqrt(2 (n - 1)).
    const Vector3d along = one.ap > 0 ? Vector3d(e / one.ap) : Vector3d(0, 0, 0);
    const double own = along.dot(mean.noise * along), repeat = squares / (3 * (n - 1)) / n;
    one.ap_uncertainty = kCoverage * std::sqrt(std::max(own, repeat));
    one.rp_uncertainty = kCoverage * std::sqrt(s * s / n + 9 * s * s / (2 * (n - 1)));
    one.approaches = static_cast<int>(ways.size());
    for (const auto& a : ways)
      for (const auto& b : ways)
        one.vap = std::max(
            one.vap, (a.second.first / a.second.second - b.second.first / b.second.second).norm());
    out.push_back(one);
  }
  return out;
}

Scatter scatter(const std::vector<VerifiedView>& views) {
  Scatter out;
  const std::vector<VerifiedView> means = barycentres(views);
  double squares = 0, stated = 0, in_sigmas = 0;
  size_t k = 0;
  for (const auto& [posture, members] : views_by_posture(views)) {
    const VerifiedView& mean = means[k++];
    if (members.size() < 2) continue;
    out.freedom += static_cast<long>(members.size()) - 1;
    for (const int i : members) {
      const double square = (views[i].measured - mean.measured).squaredNorm(),
                   trace = views[i].noise.trace();
      squares += square;
      if (trace > 0) in_sigmas += 3 * square / trace;
      stated += trace * (1 - 1 / static_cast<double>(members.size()));
    }
  }
  if (out.freedom == 0) return out;
  const double freedom = static_cast<double>(out.freedom);
  out.sigma = std::sqrt(squares / freedom);
  out.stated = std::sqrt(stated / freedom);
  out.less = stated > 0 && chi2_tail(in_sigmas, 3 * freedom) > 1 - normal_tail(kCoverage);
  return out;
}

Conformity conformity(const AccuracyFigure& figure, double tolerance, bool largest) {
  return (largest ? figure.max_upper : figure.upper) < tolerance   ? Conformity::pass
         : (largest ? figure.max_lower : figure.lower) > tolerance ? Conformity::fail
                                                                   : Conformity::not_provable;
}

double share_below_largest(long postures) {
  return std::pow(normal_tail(kCoverage), 1 / static_cast<double>(postures));
}

long postures_needed(const AccuracyFigure& figure, double tolerance) {
  constexpr long kMost = 1000000;
  const auto proves = [&](long postures) {
    AccuracyFigure more = figure;
    more.freedom *= static_cast<double>(postures) / static_cast<double>(figure.postures);
    set_limits(more);
    return conformity(more, tolerance) != Conformity::not_provable;
  };
  if (proves(figure.postures)) return figure.postures;
  if (!proves(kMost)) return -1;
  long low = figure.postures, high = kMost;
  while (high - low > 1) {
    const long middle = low + (high - low) / 2;
    (proves(middle) ? high : low) = middle;
  }
  return high;
}

}  // namespace kincal
