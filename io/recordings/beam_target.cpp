#include "beam_target.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include <Eigen/Eigenvalues>

#include "../../models/rig/draws.h"
#include "../../models/rig/numbers.h"
#include "../images/detect.h"
#include "../images/plane_view.h"

namespace kincal {
namespace {

using Eigen::Matrix2d;
using Eigen::Matrix4d;
using Eigen::Vector2d;
using Eigen::Vector4d;
using Matrix23d = Eigen::Matrix<double, 2, 3>;

constexpr size_t kFewest = 24;   // beams of a corner; with fewer residuals do not know its error
constexpr double kReach = 0.45;  // squares: half of a corner's window
constexpr double kUnlike = 0.4;  // of the contrast: residuals of what is no chessboard
constexpr double kMostPixels = 12e6;  // of a picture
constexpr double kSeen = 1e-6;        // weight of a pixel that a beam has seen

// ------------------------------------------------------------------------------------- the picture

/// A BeamPicture is the intensities with square pixels; the pixel (x, y) is at u = left + pitch x,
/// v = top + pitch y.
struct BeamPicture {
  cv::Mat level;                // CV_32F, from `dark` to `bright`
  double dark = 0, bright = 0;  // nearly all beams are between them
  double left = 0, top = 0, pitch = 1;

  cv::Mat grey() const {
    cv::Mat out;
    const double scale = 255 / std::max(1e-12, bright - dark);
    level.convertTo(out, CV_8U, scale, -scale * dark);
    return out;
  }
};

/// What no beam has seen gets the mean of what is around it, from near to far.
void fill_gaps(cv::Mat& sum, cv::Mat& weight) {
  for (int size = 5; size < 130; size = 2 * size + 1) {
    cv::Mat wide, count;
    cv::blur(sum, wide, {size, size});
    cv::blur(weight, count, {size, size});
    const cv::Mat gaps = (weight <= kSeen) & (count > kSeen);
    wide.copyTo(sum, gaps);
    count.copyTo(weight, gaps);
  }
}

/// A Box is where beams are.
struct Box {
  Vector2d low = Vector2d(1e300, 1e300), high = -low;

  void take(const Vector2d& p) { low = low.cwiseMin(p), high = high.cwiseMax(p); }
};

Vector2d place_of(const Beam& b) { return {b.u, b.v}; }

BeamPicture picture_of(const std::vector<const Beam*>& beams, const Vector2d& step, double pitch) {
  BeamPicture out;
  Box box;
  std::vector<double> levels;
  for (const Beam* b : beams) box.take(place_of(*b)), levels.push_back(b->intensity);
  out.left = box.low(0), out.top = box.low(1), out.pitch = pitch;
  out.dark = quantile(levels, 0.02), out.bright = quantile(levels, 0.98);
  const Vector2d size = (box.high - box.low) / pitch;
  const int width = static_cast<int>(size(0)) + 2, height = static_cast<int>(size(1)) + 2;
  cv::Mat sum = cv::Mat::zeros(height, width, CV_32F), weight = sum.clone();
  const double reach_x = std::max(1., step(0) / pitch), reach_y = std::max(1., step(1) / pitch);
  for (const Beam* b : beams) {
    const double x = (b->u - out.left) / pitch, y = (b->v - out.top) / pitch;
    const double level = std::clamp(b->intensity, out.dark, out.bright);
    const int first_x = std::max(0, static_cast<int>(std::ceil(x - reach_x))),
              last_x = std::min(width - 1, static_cast<int>(std::floor(x + reach_x)));
    const int first_y = std::max(0, static_cast<int>(std::ceil(y - reach_y))),
              last_y = std::min(height - 1, static_cast<int>(std::floor(y + reach_y)));
    for (int row = first_y; row <= last_y; ++row)
      for (int column = first_x; column <= last_x; ++column) {
        const double w = (1 - std::abs(column - x) / reach_x) * (1 - std::abs(row - y) / reach_y);
        sum.at<float>(row, column) += static_cast<float>(w * level);
        weight.at<float>(row, column) += static_cast<float>(w);
      }
  }
  fill_gaps(sum, weight);
  out.level = cv::Mat(height, width, CV_32F, cv::Scalar(0.5 * (out.dark + out.bright)));
  cv::divide(sum, weight, sum);
  sum.copyTo(out.level, weight > kSeen);
  return out;
}

// ------------------------------------------------------------------------------------- the corners

/// A Window is a corner and the beams around it.
struct Corner {
  int id = 0;
  Vector2d at;                             // u, v
  Matrix2d sides;                          // ways of one square along rows and columns, as columns
  Matrix23d bend = Matrix23d::Zero();      // of straight lines: times (du^2, du dv, dv^2)
  double strip = kReach;                   // squares beside an edge that are plain
  double mean = 0, half = 0;               // m and h
  Vector2d spot;                           // w_u, w_v
  std::vector<const Beam*> beams;          // in the window
  double squares = 0;                      // sum of squared residuals
  Matrix2d covariance = Matrix2d::Zero();  // of `at`

  /// Returns where a beam is, seen from the corner, in a picture in which straight lines are
  /// straight.
  Vector2d away(const Beam& beam) const {
    const Vector2d d = place_of(beam) - at;
    return d + bend * Vector3d(d(0) * d(0), d(0) * d(1), d(1) * d(1));
  }
};

/// An Edge is a step edge through the corner, blurred.
struct Edge {
  Vector2d gradient;  // of a or b, per rad
  double sigma;       // of its blur, in squares

  Edge(const Corner& c, int k) {
    gradient = c.sides.inverse().row(k).transpose();
    sigma = gradient.cwiseProduct(c.spot).norm();
  }
  double place(const Vector2d& away) const { return gradient.dot(away); }
  double step(double a) const { return std::erf(a / (std::sqrt(2.) * sigma)); }
  double slope(double a) const {
    return std::sqrt(2 / kPi) / sigma * std::exp(-0.5 * a * a / (sigma * sigma));
  }
};

void take_beams(const std::vector<const Beam*>& near, Corner& corner) {
  const Matrix2d units = corner.sides.inverse();
  corner.beams.clear();
  for (const Beam* b : near) {
    const Vector2d ab = (units * corner.away(*b)).cwiseAbs();
    if (ab.maxCoeff() < kReach && ab.minCoeff() < corner.strip) corner.beams.push_back(b);
  }
}

/// The residual of a beam, and the model's derivative by u, v, mean, half.
double residual(const Corner& c, const Edge& ea, const Edge& eb, const Beam& beam, Vector4d& j) {
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
double step(Corner& c) {
  const Edge ea(c, 0), eb(c, 1);
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
double unseen(const Corner& c, const Edge& edge) {
  double before = -kReach, after = kReach;
  for (const Beam* beam : c.beams) {
    const double a = edge.place(c.away(*beam));
    (a < 0 ? before : after) = a < 0 ? std::max(before, a) : std::min(after, a);
  }
  const double gap = std::max(0., after - before - 3 * edge.sigma);
  return gap * gap * gap / (12 * std::max(1e-12, after - before));
}

/// A Grain is how coarse intensities are.
struct Grain {
  double step = 0, noise = 0;  // of levels; before they were rounded

  /// Returns how large a wave of the error of rounding is, squared, mean: of a sawtooth, as far as
  /// noise does not smear it.
  double wave(int k) const {
    const double smear = 2 * kPi * k * noise / step;
    return step > 0 ? std::pow(step / (kPi * k), 2) / 2 * std::exp(-smear * smear) : 0;
  }
  double waves() const { return wave(1) + wave(2) + wave(3); }
};

/// `squares`: mean square of the residuals.
Grain grain_of(const std::vector<const Beam*>& beams, double squares) {
  std::vector<double> levels;
  for (const Beam* b : beams) levels.push_back(b->intensity);
  std::sort(levels.begin(), levels.end());
  levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
  Grain out;
  for (size_t i = 1; i < levels.size(); ++i) {
    const double step = levels[i] - levels[i - 1];
    out.step = i == 1 ? step : std::min(out.step, step);
  }
  out.noise = std::sqrt(std::max(0., squares - out.step * out.step / 12));
  return out;
}

/// What rounding adds to the middle of the covariance.
Matrix4d rounding(const Corner& c, const Grain& grain) {
  constexpr int kWaves = 3;
  const Edge ea(c, 0), eb(c, 1);
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

/// The covariance of a corner that is fitted.
Matrix2d covariance_of(const Corner& c, const Grain& grain) {
  const Edge ea(c, 0), eb(c, 1);
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

/// Fits a corner to the beams around it. Returns false where there is none.
bool fit(const std::vector<const Beam*>& near, Corner& corner) {
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

/// How a board lies in its picture.
PlaneView view_of(const BeamPicture& picture, const ImageTarget& target, const Detection& found) {
  std::vector<cv::Point2d> plane;
  for (const int id : found.ids) plane.push_back(target.points[static_cast<size_t>(id)]);
  return fit_plane_view(plane, found.pixels, picture.level.size());
}

/// A corner where the picture shows the point p of a board's plane.
Corner corner_at(const BeamPicture& picture, const PlaneView& view, const cv::Point2d& p) {
  const cv::Point2d at = view(p);
  const cv::Point2d x = view(p + cv::Point2d(0.4, 0)) - view(p - cv::Point2d(0.4, 0)),
                    y = view(p + cv::Point2d(0, 0.4)) - view(p - cv::Point2d(0, 0.4));
  Corner c;
  c.at = {picture.left + picture.pitch * at.x, picture.top + picture.pitch * at.y};
  c.sides << x.x, y.x, x.y, y.y;
  c.sides *= picture.pitch / 0.8;
  return c;
}

/// The corners of a board as its picture shows them.
std::vector<Corner> corners_of(const BeamPicture& picture, const PlaneView& view,
                               const ImageTarget& target, const Detection& found) {
  std::vector<int> ids = found.ids;
  if (target.kind == ImageTarget::Kind::chessboard) {  // it is seen whole
    ids.resize(target.points.size());
    std::iota(ids.begin(), ids.end(), 0);
  }
  std::vector<Corner> out;
  for (const int id : ids) {
    out.push_back(corner_at(picture, view, target.points[static_cast<size_t>(id)]));
    out.back().id = id;
    if (target.kind == ImageTarget::Kind::charuco) out.back().strip = 0.45 * (1 - target.marker);
  }
  return out;
}

/// The beams in the box around all corners and their windows.
std::vector<const Beam*> beams_near(const Beams& beams, const std::vector<Corner>& corners) {
  Box box;
  for (const Corner& c : corners) {
    const Vector2d half = c.sides.cwiseAbs().rowwise().sum();
    box.take(c.at - half), box.take(c.at + half);
  }
  std::vector<const Beam*> out;
  for (const Beam& b : beams.all)
    if ((place_of(b) - box.low).minCoeff() > 0 && (box.high - place_of(b)).minCoeff() > 0)
      out.push_back(&b);
  return out;
}

/// The level between dark and bright around a corner, and which way round they are.
void start_levels(const std::vector<const Beam*>& near, Corner& c) {
  take_beams(near, c);
  if (c.beams.empty()) return;
  std::vector<double> levels;
  for (const Beam* b : c.beams) levels.push_back(b->intensity);
  const double low = quantile(levels, 0.1), high = quantile(levels, 0.9);
  double turn = 0;
  c.mean = 0.5 * (low + high);
  for (const Beam* b : c.beams) {
    const Vector2d ab = c.sides.inverse() * c.away(*b);
    turn += (ab(0) * ab(1) > 0 ? 1 : -1) * (b->intensity - c.mean);
  }
  c.half = std::copysign(0.5 * (high - low), turn);
}

/// Fits the corners with a spot; returns those that could be, and the mean of their squares.
std::vector<Corner> fitted(const std::vector<const Beam*>& near, std::vector<Corner> corners,
                           const Vector2d& spot, double& squares) {
  std::vector<Corner> out;
  squares = 0;
  double beams = 0;
  for (Corner& c : corners) {
    c.spot = spot;
    if (!fit(near, c)) continue;
    squares += c.squares, beams += static_cast<double>(c.beams.size());
    out.push_back(c);
  }
  squares /= std::max(1., beams);
  return out;
}

/// Whether a chessboard goes on beyond one of its sides: the corners there, which are none if it is
/// the whole board, have four fields as the others have. (At the rim of a board two fields meet the
/// paper around: half of that.)
bool goes_on(const Beams& beams, const BeamPicture& picture, const PlaneView& view,
             const ImageTarget& target, const std::vector<Corner>& corners) {
  std::vector<double> contrasts;
  for (const Corner& c : corners) contrasts.push_back(std::abs(c.half));
  const double whole = median(contrasts, 0);
  for (int side = 0; side < 4; ++side) {
    const bool across = side < 2;  // beyond the first or last column, else row
    const double beyond = side % 2 == 0 ? -1 : across ? target.columns : target.rows;
    std::vector<Corner> rim;
    for (int i = 0; i < (across ? target.rows : target.columns); ++i)
      rim.push_back(
          corner_at(picture, view, across ? cv::Point2d(beyond, i) : cv::Point2d(i, beyond)));
    const std::vector<const Beam*> near = beams_near(beams, rim);
    size_t such = 0;
    for (Corner& c : rim) {
      c.spot = corners[0].spot;
      take_beams(near, c);
      const Edge ea(c, 0), eb(c, 1);
      double n = 0, x = 0, y = 0, xx = 0, xy = 0;  // of the line: intensity by A B
      for (const Beam* b : c.beams) {
        const Vector2d away = c.away(*b);
        const double ab = ea.step(ea.place(away)) * eb.step(eb.place(away));
        n += 1, x += ab, y += b->intensity, xx += ab * ab, xy += ab * b->intensity;
      }
      such += std::abs(n * xy - x * y) > 0.75 * whole * (n * xx - x * x) && n >= 12;
    }
    if (10 * such > 7 * rim.size()) return true;
  }
  return false;
}

// -------------------------------------------------------------------------------------- the ranges

/// A Plane is normal . p = distance.
struct RangePlane {
  Vector3d normal = Vector3d::Zero();
  double distance = 0;

  double expected(const Ray& ray) const {
    return (distance - normal.dot(ray.origin)) / normal.dot(ray.direction);
  }
};

RangePlane plane_through(const std::vector<Vector3d>& points) {
  Vector3d middle = Vector3d::Zero();
  for (const Vector3d& p : points) middle += p / static_cast<double>(points.size());
  Matrix3d spread = Matrix3d::Zero();
  for (const Vector3d& p : points) spread += (p - middle) * (p - middle).transpose();
  RangePlane out;
  out.normal = Eigen::SelfAdjointEigenSolver<Matrix3d>(spread).eigenvectors().col(0);
  out.distance = out.normal.dot(middle);
  return out;
}

/// A RangedBeam is a beam that sees nothing but paper.
struct RangedBeam {
  const Beam* beam;
  size_t corner;
  Ray ray;
  Vector3d point;
  double error = 0;  // m, range minus expected
};

std::vector<RangedBeam> bright_beams(const Beams& beams, const std::vector<Corner>& corners) {
  std::vector<RangedBeam> out;
  for (size_t i = 0; i < corners.size(); ++i) {
    const Corner& c = corners[i];
    const Edge ea(c, 0), eb(c, 1);
    for (const Beam* b : c.beams) {
      const Vector2d away = c.away(*b);
      const double bright =
          std::copysign(1., c.half) * ea.step(ea.place(away)) * eb.step(eb.place(away));
      if (bright < 0.9 || !(b->range > 0)) continue;
      const Ray ray = beams.ray(b->u, b->v);
      out.push_back({b, i, ray, ray.origin + b->range * ray.direction});
    }
  }
  return out;
}

/// The plane of the board, and which beams are on it: the others are taken away. Returns whether
/// there is one.
bool fit_plane(std::vector<RangedBeam>& beams, RangePlane& plane) {
  if (beams.size() < 12) return false;
  Draws draws(1);
  double best = 1e300;
  const auto look = [&](const RangePlane& p) {
    std::vector<double> errors;
    for (RangedBeam& b : beams) {
      b.error = b.beam->range - p.expected(b.ray);
      errors.push_back(std::abs(b.error));
    }
    return median(errors, 0);
  };
  for (int trial = 0; trial < 60; ++trial) {
    std::vector<Vector3d> three;
    for (int k = 0; k < 3; ++k) three.push_back(beams[draws.index(beams.size())].point);
    const RangePlane p = plane_through(three);
    const double spread = look(p);
    if (spread < best) best = spread, plane = p;
  }
  std::vector<RangedBeam> on;
  for (int pass = 0; pass < 5; ++pass) {
    const double most = 4 * 1.4826 * std::max(1e-6, look(plane));
    std::vector<Vector3d> points;
    on.clear();
    for (const RangedBeam& b : beams)
      if (std::abs(b.error) < most) points.push_back(b.point), on.push_back(b);
    if (points.size() < 12) return false;
    plane = plane_through(points);
  }
  beams = on;
  for (RangedBeam& b : beams) b.error = b.beam->range - plane.expected(b.ray);
  return true;
}

/// How straight lines on the board are bent around the corners. Where nothing has ranges, they stay
/// as they are.
void straighten(const Beams& beams, std::vector<Corner>& corners) {
  constexpr double kStep = 1e-3;
  std::vector<RangedBeam> paper = bright_beams(beams, corners);
  RangePlane plane;
  if (!fit_plane(paper, plane)) return;
  for (Corner& c : corners) {
    const auto on_board = [&](double du, double dv) {
      const Ray ray = beams.ray(c.at(0) + kStep * du, c.at(1) + kStep * dv);
      return Vector3d(ray.origin + plane.expected(ray) * ray.direction);
    };
    Eigen::Matrix<double, 3, 2> first;
    Matrix3d second;
    first << on_board(1, 0) - on_board(-1, 0), on_board(0, 1) - on_board(0, -1);
    second << on_board(1, 0) - 2 * on_board(0, 0) + on_board(-1, 0),
        0.5 * (on_board(1, 1) - on_board(1, -1) - on_board(-1, 1) + on_board(-1, -1)),
        on_board(0, 1) - 2 * on_board(0, 0) + on_board(0, -1);
    const Matrix23d bend = first.colPivHouseholderQr().solve(second) / kStep;
    if (bend.allFinite()) c.bend = bend;
  }
}

/// Fits all corners with the spot that suits them best together, from a fifth of the beams'
/// distance on. Keeps those that are as good as the others. Returns whether the squares are there
/// that were taken for a board.
bool fit_all(const Beams& beams, std::vector<Corner>& corners) {
  const std::vector<const Beam*> near = beams_near(beams, corners);
  for (Corner& c : corners) start_levels(near, c);
  const Vector2d pitch(beams.step_u, beams.step_v);
  Vector2d spot = 0.5 * pitch;
  double best = 0;
  std::vector<Corner> kept = fitted(near, corners, spot, best);
  for (const double factor : {1.6, 1.25, 1.1})
    for (int k = 0; k < 2; ++k)
      for (const double way : {factor, 1 / factor})
        for (;;) {
          Vector2d other = spot;
          other(k) *= way;
          if (other(k) < 0.2 * pitch(k) || other(k) > 8 * pitch(k)) break;
          double squares = 0;
          std::vector<Corner> with = fitted(near, corners, other, squares);
          if (with.size() < kept.size() || squares >= best) break;
          best = squares, spot = other, kept = with;
        }
  straighten(beams, kept);
  kept = fitted(near, kept, spot, best);
  std::vector<double> contrasts, errors;
  for (const Corner& c : kept) {
    contrasts.push_back(std::abs(c.half));
    errors.push_back(c.squares / static_cast<double>(c.beams.size()));
  }
  const double contrast = median(contrasts, 0), error = median(errors, 0);
  corners.clear();
  if (std::sqrt(error) > kUnlike * contrast) return false;
  const Grain grain = grain_of(near, error);
  for (Corner& c : kept)
    if (std::abs(c.half) > 0.4 * contrast &&
        c.squares / static_cast<double>(c.beams.size()) < 6 * error + 1e-12) {
      c.covariance = covariance_of(c, grain);
      corners.push_back(c);
    }
  return true;
}

// -------------------------------------------------------------------------------------- the points

/// When beams at a place were measured, if time goes along with it: by least squares.
double time_at(const std::vector<const Beam*>& beams, const Vector2d& at, double& span) {
  Matrix3d jtj = 1e-12 * Matrix3d::Identity();
  Vector3d jtr = Vector3d::Zero();
  double first = 1e300, last = -1e300;
  for (const Beam* b : beams) first = std::min(first, b->time), last = std::max(last, b->time);
  for (const Beam* b : beams) {
    const Vector3d j(1, b->u - at(0), b->v - at(1));
    jtj += j * j.transpose();
    jtr += (b->time - first) * j;
  }
  span = last - first;
  return first + std::clamp(jtj.ldlt().solve(jtr)(0), 0., span);
}

std::vector<BeamPoint> points_of(const Beams& beams, const std::vector<Corner>& corners,
                                 BeamTarget& out) {
  std::vector<RangedBeam> paper = bright_beams(beams, corners);
  RangePlane plane;
  if (!fit_plane(paper, plane)) {
    out.reason = "its bright squares have no ranges of a plane";
    return {};
  }
  std::vector<double> sum(corners.size()), squares(corners.size()), count(corners.size());
  for (const RangedBeam& b : paper) sum[b.corner] += b.error, ++count[b.corner];
  double scatter = 0, freedom = 0;
  for (const RangedBeam& b : paper) {
    scatter += std::pow(b.error - sum[b.corner] / count[b.corner], 2);
    ++freedom;
  }
  std::vector<BeamPoint> points;
  for (size_t i = 0; i < corners.size(); ++i) {
    if (count[i] > 0) --freedom;
    if (count[i] < 4) continue;
    const Corner& c = corners[i];
    BeamPoint p;
    p.id = c.id;
    p.u = c.at(0), p.v = c.at(1);
    p.range = plane.expected(beams.ray(p.u, p.v)) + sum[i] / count[i];
    p.covariance = c.covariance;
    p.range_sigma = 1 / std::sqrt(count[i]);
    p.time = time_at(c.beams, c.at, p.span);
    points.push_back(p);
  }
  scatter = std::sqrt(scatter / std::max(1., freedom));
  for (BeamPoint& p : points) p.range_sigma *= scatter;
  return points;
}

std::string several(size_t n, const std::string& of) { return std::to_string(n) + " " + of; }

// ----------------------------------------------------------------------------------- the reflector

/// The beams that are bright, in heaps of neighbours, the largest first.
std::vector<std::vector<const Beam*>> heaps(const Beams& beams, double level) {
  std::map<std::pair<long, long>, std::vector<const Beam*>> cells;
  const auto cell = [](double x, double step) { return std::lround(x / (1.5 * step)); };
  for (const Beam& b : beams.all)
    if (b.intensity > level)
      cells[{cell(b.u, beams.step_u), cell(b.v, beams.step_v)}].push_back(&b);
  std::vector<std::vector<const Beam*>> out;
  while (!cells.empty()) {
    std::vector<std::pair<long, long>> open = {cells.begin()->first};
    out.emplace_back();
    while (!open.empty()) {
      const auto at = cells.find(open.back());
      const auto [x, y] = open.back();
      open.pop_back();
      if (at == cells.end()) continue;
      out.back().insert(out.back().end(), at->second.begin(), at->second.end());
      cells.erase(at);
      for (long i = -1; i <= 1; ++i)
        for (long j = -1; j <= 1; ++j) open.emplace_back(x + i, y + j);
    }
  }
  std::sort(out.begin(), out.end(),
            [](const auto& a, const auto& b) { return a.size() > b.size(); });
  return out;
}

/// The range of a patch at a place, from beams that see nothing else, and how it changes from there
/// with u and v.
Vector2d range_of(const std::vector<const Beam*>& beams, BeamPoint& p) {
  std::vector<const Beam*> kept = beams;
  Vector3d line = Vector3d::Zero();
  double scatter = 0;
  Matrix3d jtj;
  for (int pass = 0; pass < 4; ++pass) {
    jtj = 1e-9 * Matrix3d::Identity();
    Vector3d jtr = Vector3d::Zero();
    for (const Beam* b : kept) {
      const Vector3d j(1, b->u - p.u, b->v - p.v);
      jtj += j * j.transpose();
      jtr += b->range * j;
    }
    line = jtj.ldlt().solve(jtr);
    const auto error = [&](const Beam* b) {
      return b->range - line.dot(Vector3d(1, b->u - p.u, b->v - p.v));
    };
    std::vector<double> errors;
    for (const Beam* b : kept) errors.push_back(std::abs(error(b)));
    scatter = 0;
    for (const Beam* b : kept) scatter += std::pow(error(b), 2);
    scatter = std::sqrt(scatter / std::max(1., static_cast<double>(kept.size()) - 3));
    std::vector<const Beam*> better;
    const double most = 4 * 1.4826 * median(errors, 0) + 1e-9;
    for (const Beam* b : kept)
      if (std::abs(error(b)) < most) better.push_back(b);
    if (better.size() == kept.size() || better.size() < 6) break;
    kept = better;
  }
  p.range = line(0);
  p.range_sigma = scatter * std::sqrt(jtj.inverse()(0, 0));
  return line.tail<2>();
}

/// The middle of the light of a heap of bright beams, above what is around it.
BeamPoint middle_of(const Beams& beams, const std::vector<const Beam*>& heap) {
  Box box;
  for (const Beam* b : heap) box.take(place_of(*b));
  const Vector2d step(beams.step_u, beams.step_v), rim = 2 * step + 0.2 * (box.high - box.low);
  std::vector<const Beam*> near;
  std::vector<double> around, inside, deviations;
  for (const Beam& b : beams.all) {
    const Vector2d out = (box.low - place_of(b)).cwiseMax(place_of(b) - box.high);
    if ((out - rim).maxCoeff() > 0) continue;
    near.push_back(&b);
    if ((out - step).maxCoeff() > 0) around.push_back(b.intensity);
  }
  for (const Beam* b : heap) inside.push_back(b->intensity);
  const double ground = median(around, 0), top = quantile(inside, 0.8);
  for (const double level : around) deviations.push_back(std::abs(level - ground));
  const double noise = 1.4826 * median(deviations, 0);
  const BeamPicture picture = picture_of(near, step, 0.5 * step.minCoeff());
  Vector2d slope = Vector2d::Zero(), variance = slope;  // of the range, relative to it
  BeamPoint out;
  const auto centre = [&] {
    double light = 0;
    Vector2d sum = Vector2d::Zero();
    for (int y = 0; y < picture.level.rows; ++y)
      for (int x = 0; x < picture.level.cols; ++x) {
        const Vector2d place(picture.left + picture.pitch * x, picture.top + picture.pitch * y);
        const double farther = 1 + slope.dot(place - Vector2d(out.u, out.v));
        const double share = std::pow(farther, 4) * (picture.level.at<float>(y, x) - ground);
        light += share;
        sum += share * place;
      }
    out.u = sum(0) / light, out.v = sum(1) / light;
  };
  centre();
  std::vector<const Beam*> whole, any;  // those that see nothing else
  for (const Beam* b : heap)
    if (b->range > 0) {
      any.push_back(b);
      if (b->intensity > ground + 0.8 * (top - ground)) whole.push_back(b);
    }
  if (any.empty()) return out;
  const std::vector<const Beam*>& ranged = whole.size() >= 6 ? whole : any;
  slope = range_of(ranged, out) / out.range;
  centre();
  range_of(ranged, out);
  const Vector2d at(out.u, out.v);
  double of_beams = 0;
  for (const Beam* b : near) of_beams += b->intensity - ground;
  for (const Beam* b : near)
    variance += (place_of(*b) - at).cwiseAbs2() * std::pow(noise / of_beams, 2);
  const double radius = std::sqrt(static_cast<double>(heap.size()) / kPi);
  variance += step.cwiseAbs2() / (12 * kPi * radius);
  out.covariance = variance.asDiagonal();
  out.time = time_at(heap, at, out.span);
  return out;
}

}  // namespace

BeamTarget find_board(const Beams& beams, const ImageTarget& target) {
  BeamTarget out;
  if (beams.all.size() < 100) {
    out.reason = "only " + several(beams.all.size(), "beams have an intensity");
    return out;
  }
  Detection found;
  BeamPicture picture;
  std::vector<const Beam*> all;
  Box box;
  for (const Beam& b : beams.all) all.push_back(&b), box.take(place_of(b));
  const Vector2d step(beams.step_u, beams.step_v);
  const double finest =
      std::max(0.5 * step.minCoeff(), std::sqrt((box.high - box.low).prod() / kMostPixels));
  for (double pitch = std::max(step.maxCoeff(), finest); pitch >= finest && found.ids.empty();
       pitch *= 0.5) {
    picture = picture_of(all, step, pitch);
    found = detect(picture.grey(), target);
  }
  if (found.ids.empty()) {
    out.reason = found.reason;
    return out;
  }
  if (found.ids.size() < 4) {
    out.reason = "only " + several(found.ids.size(), "of its corners were found");
    return out;
  }
  const PlaneView view = view_of(picture, target, found);
  std::vector<Corner> corners = corners_of(picture, view, target, found);
  const size_t wanted = corners.size();
  if (!fit_all(beams, corners)) {
    out.reason = "something looks like it, but its squares are not there";
    return out;
  }
  if (corners.size() < 4) {
    out.reason =
        "it is there, but too few beams see its squares: nearer, larger or slower is better";
    return out;
  }
  if (target.kind == ImageTarget::Kind::chessboard &&
      goes_on(beams, picture, view, target, corners)) {
    out.reason = "a part of a larger chessboard looks like it";
    return out;
  }
  out.points = points_of(beams, corners, out);
  if (!out.points.empty() && out.points.size() < wanted)
    out.notes.push_back(
        several(wanted - out.points.size(), "corners are hidden, or have no range"));
  return out;
}

BeamTarget find_reflector(const Beams& beams) {
  BeamTarget out;
  std::vector<double> levels;
  for (const Beam& b : beams.all) levels.push_back(b.intensity);
  if (levels.size() < 20) {
    out.reason = "only " + several(levels.size(), "beams have an intensity");
    return out;
  }
  const double usual = quantile(levels, 0.5);
  const double peak = quantile(levels, 1 - 2.5 / static_cast<double>(levels.size()));  // the third
  const double level = 0.5 * (usual + peak);
  std::vector<std::vector<const Beam*>> bright = heaps(beams, level);
  if (bright.empty() || bright[0].size() < 4) {
    out.reason = "nothing bright is as large as four beams";
    return out;
  }
  double all = 0;
  for (const auto& heap : bright) all += static_cast<double>(heap.size());
  if (all > 0.1 * static_cast<double>(beams.all.size())) {
    out.reason = "nothing stands out: a tenth of all beams are half as bright as the brightest";
    return out;
  }
  if (bright.size() > 1 &&
      static_cast<double>(bright[1].size()) > 0.3 * static_cast<double>(bright[0].size())) {
    out.reason = "several things are as bright";
    return out;
  }
  out.points.push_back(middle_of(beams, bright[0]));
  if (!(out.points[0].range > 0)) {
    out.points.clear();
    out.reason = "the brightest thing has no range";
  }
  return out;
}

}  // namespace kincal
