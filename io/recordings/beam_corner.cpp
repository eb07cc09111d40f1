#include "beam_corner.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "../../models/rig/numbers.h"

namespace kincal {
namespace {

using Eigen::Matrix2d;
using Eigen::Matrix4d;
using Eigen::Vector2d;
using Eigen::Vector4d;

constexpr size_t kFewest = 24;  // beams of a corner; with fewer residuals do not know its error

/// The residual of a beam, and the model's derivative by u, v, mean, half.
double residual(const BeamCorner& c, const BeamEdge& ea, const BeamEdge& eb, const Beam& beam,
                Vector4d& j) {
  const Vector2d away = c.away(beam);
  const double a = ea.place(away), b = eb.place(away);
  const double sa = ea.step(a), sb = eb.step(b), da = ea.slope(a), db = eb.slope(b);
  j.head<2>() = -c.half * (da * sb * ea.gradient + sa * db * eb.gradient);
  j(2) = 1;
  j(3) = sa * sb;
  return beam.intensity - (c.mean + c.half * sa * sb);
}

/// One step of least squares. Returns how long it is, in squares; NaN: the beams do not determine
/// it.
double step(BeamCorner& c) {
  const BeamEdge ea(c, 0), eb(c, 1);
  Matrix4d jtj = Matrix4d::Zero();
  Vector4d jtr = Vector4d::Zero(), j;
  c.squares = 0;
  for (const Beam* beam : c.beams) {
    const double r = residual(c, ea, eb, *beam, j);
    jtj += j * j.transpose();
    jtr += r * j;
    c.squares += r * r;
  }
  const Eigen::LDLT<Matrix4d> solver(jtj);
  const Vector4d d = solver.solve(jtr);
  if (!d.allFinite() || !(solver.vectorD().minCoeff() > 0)) return kNan;
  const double length = (c.sides.inverse() * d.head<2>()).norm();
  c.at += std::min(1., 0.2 / length) * d.head<2>();
  c.mean += d(2);
  c.half += d(3);
  return length;
}

/// Variance of where an edge is in the gap between the two beams beside it, squares^2.
double unseen(const BeamCorner& c, const BeamEdge& edge) {
  double before = -kReach, after = kReach;
  for (const Beam* beam : c.beams) {
    const double a = edge.place(c.away(*beam));
    (a < 0 ? before : after) = a < 0 ? std::max(before, a) : std::min(after, a);
  }
  const double gap = std::max(0., after - before - 3 * edge.sigma);
  return gap * gap * gap / (12 * std::max(1e-12, after - before));
}

/// What rounding adds to the middle of the covariance.
Matrix4d rounding(const BeamCorner& c, const BeamGrain& grain) {
  constexpr int kWaves = 3;
  const BeamEdge ea(c, 0), eb(c, 1);
  Matrix4d out = Matrix4d::Zero();
  for (int k = 1; k <= kWaves && grain.wave(k) > 0; ++k) {
    Vector4d cosines = Vector4d::Zero(), sines = cosines, j;
    for (const Beam* beam : c.beams) {
      const double seen = beam->intensity - residual(c, ea, eb, *beam, j);
      const double phase = 2 * kPi * k * seen / grain.step;
      cosines += std::cos(phase) * j, sines += std::sin(phase) * j;
    }
    out += grain.wave(k) * (cosines * cosines.transpose() + sines * sines.transpose());
  }
  return out;
}

}  // namespace

void take_beams(const std::vector<const Beam*>& near, BeamCorner& corner) {
  const Matrix2d units = corner.sides.inverse();
  corner.beams.clear();
  for (const Beam* b : near) {
    const Vector2d ab = (units * corner.away(*b)).cwiseAbs();
    if (ab.maxCoeff() < kReach && ab.minCoeff() < corner.strip) corner.beams.push_back(b);
  }
}

bool fit_corner(const std::vector<const Beam*>& near, BeamCorner& corner) {
  const Vector2d start = corner.at;
  for (int pass = 0; pass < 2; ++pass) {  // with the window where the corner was, then where it is
    take_beams(near, corner);
    if (corner.beams.size() < kFewest) return false;
    for (int k = 0; k < 20; ++k) {
      const double length = step(corner);
      if (!((corner.sides.inverse() * (corner.at - start)).norm() < 0.4)) return false;
      if (!(length > 1e-6)) break;
    }
  }
  return true;
}

BeamGrain grain_of(const std::vector<const Beam*>& beams, double squares) {
  std::vector<double> levels;
  for (const Beam* b : beams) levels.push_back(b->intensity);
  std::sort(levels.begin(), levels.end());
  levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
  BeamGrain out;
  for (size_t i = 1; i < levels.size(); ++i) {
    const double step = levels[i] - levels[i - 1];
    out.step = i == 1 ? step : std::min(out.step, step);
  }
  out.noise = std::sqrt(std::max(0., squares - out.step * out.step / 12));
  return out;
}

Matrix2d covariance_of(const BeamCorner& c, const BeamGrain& grain) {
  const BeamEdge ea(c, 0), eb(c, 1);
  Matrix4d jtj = Matrix4d::Zero(), middle = rounding(c, grain);
  Vector4d j;
  for (const Beam* beam : c.beams) {
    residual(c, ea, eb, *beam, j);
    jtj += j * j.transpose();
  }
  const Matrix4d inverse = jtj.inverse();
  for (const Beam* beam : c.beams) {
    const double r = residual(c, ea, eb, *beam, j);
    const double leverage = j.dot(inverse * j);
    const double own = std::max(0., r * r - grain.waves());  // what it does not share
    middle += own / std::max(0.05, 1 - leverage) * j * j.transpose();
  }
  const Matrix2d gaps = Vector2d(unseen(c, ea), unseen(c, eb)).asDiagonal();
  return (inverse * middle * inverse).topLeftCorner<2, 2>() + c.sides * gaps * c.sides.transpose();
}

}  // namespace kincal
