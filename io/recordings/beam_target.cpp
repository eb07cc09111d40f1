#include "beam_target.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <opencv2/core.hpp>

#include "../../models/rig/numbers.h"
#include "../../models/rig/random_stream.h"
#include "../images/detect.h"
#include "../images/plane_view.h"
#include "beam_corner.h"
#include "beam_picture.h"

namespace kincal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Matrix23d = Eigen::Matrix<double, 2, 3>;

constexpr double kUnlike = 0.4;       // of the contrast: residuals of what is no chessboard
constexpr double kMostPixels = 12e6;  // of a picture

// ------------------------------------------------------------------------------------- the corners

/// How a board lies in its picture.
PlaneView view_of(const BeamPicture& picture, const ImageTarget& target, const Detection& found) {
  std::vector<cv::Point2d> plane;
  for (const int id : found.ids) plane.push_back(target.points[static_cast<size_t>(id)]);
  return fit_plane_view(plane, found.pixels, picture.level.size());
}

/// A corner where the picture shows the point p of a board's plane.
BeamCorner corner_at(const BeamPicture& picture, const PlaneView& view, const cv::Point2d& p) {
  const cv::Point2d at = view(p);
  const cv::Point2d x = view(p + cv::Point2d(0.4, 0)) - view(p - cv::Point2d(0.4, 0)),
                    y = view(p + cv::Point2d(0, 0.4)) - view(p - cv::Point2d(0, 0.4));
  BeamCorner c;
  c.at = {picture.left + picture.pitch * at.x, picture.top + picture.pitch * at.y};
  c.sides << x.x, y.x, x.y, y.y;
  c.sides *= picture.pitch / 0.8;
  return c;
}

/// The corners of a board as its picture shows them.
std::vector<BeamCorner> corners_of(const BeamPicture& picture, const PlaneView& view,
                                   const ImageTarget& target, const Detection& found) {
  std::vector<int> ids = found.ids;
  if (target.kind == ImageTarget::Kind::chessboard) {  // it is seen whole
    ids.resize(target.points.size());
    std::iota(ids.begin(), ids.end(), 0);
  }
  std::vector<BeamCorner> out;
  for (const int id : ids) {
    out.push_back(corner_at(picture, view, target.points[static_cast<size_t>(id)]));
    out.back().id = id;
    if (target.kind == ImageTarget::Kind::charuco) out.back().strip = 0.45 * (1 - target.marker);
  }
  return out;
}

/// The beams in the box around all corners and their windows.
std::vector<const Beam*> beams_near(const Beams& beams, const std::vector<BeamCorner>& corners) {
  BeamBox box;
  for (const BeamCorner& c : corners) {
    const Vector2d half = c.sides.cwiseAbs().rowwise().sum();
    box.take(c.at - half), box.take(c.at + half);
  }
  std::vector<const Beam*> out;
  for (const Beam& b : beams.all)
    if ((b.place() - box.low).minCoeff() > 0 && (box.high - b.place()).minCoeff() > 0)
      out.push_back(&b);
  return out;
}

/// The level between dark and bright around a corner, and which way round they are.
void start_levels(const std::vector<const Beam*>& near, BeamCorner& c) {
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
std::vector<BeamCorner> fitted(const std::vector<const Beam*>& near,
                               std::vector<BeamCorner> corners, const Vector2d& spot,
                               double& squares) {
  std::vector<BeamCorner> out;
  squares = 0;
  double beams = 0;
  for (BeamCorner& c : corners) {
    c.spot = spot;
    if (!fit_corner(near, c)) continue;
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
             const ImageTarget& target, const std::vector<BeamCorner>& corners) {
  std::vector<double> contrasts;
  for (const BeamCorner& c : corners) contrasts.push_back(std::abs(c.half));
  const double whole = median(contrasts, 0);
  for (int side = 0; side < 4; ++side) {
    const bool across = side < 2;  // beyond the first or last column, else row
    const double beyond = side % 2 == 0 ? -1 : across ? target.columns : target.rows;
    std::vector<BeamCorner> rim;
    for (int i = 0; i < (across ? target.rows : target.columns); ++i)
      rim.push_back(
          corner_at(picture, view, across ? cv::Point2d(beyond, i) : cv::Point2d(i, beyond)));
    const std::vector<const Beam*> near = beams_near(beams, rim);
    size_t such = 0;
    for (BeamCorner& c : rim) {
      c.spot = corners[0].spot;
      take_beams(near, c);
      const BeamEdge ea(c, 0), eb(c, 1);
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

std::vector<RangedBeam> bright_beams(const Beams& beams, const std::vector<BeamCorner>& corners) {
  std::vector<RangedBeam> out;
  for (size_t i = 0; i < corners.size(); ++i) {
    const BeamCorner& c = corners[i];
    const BeamEdge ea(c, 0), eb(c, 1);
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
  RandomStream draws(1);
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
void straighten(const Beams& beams, std::vector<BeamCorner>& corners) {
  constexpr double kStep = 1e-3;
  std::vector<RangedBeam> paper = bright_beams(beams, corners);
  RangePlane plane;
  if (!fit_plane(paper, plane)) return;
  for (BeamCorner& c : corners) {
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
bool fit_all(const Beams& beams, std::vector<BeamCorner>& corners) {
  const std::vector<const Beam*> near = beams_near(beams, corners);
  for (BeamCorner& c : corners) start_levels(near, c);
  const Vector2d pitch(beams.step_u, beams.step_v);
  Vector2d spot = 0.5 * pitch;
  double best = 0;
  std::vector<BeamCorner> kept = fitted(near, corners, spot, best);
  for (const double factor : {1.6, 1.25, 1.1})
    for (int k = 0; k < 2; ++k)
      for (const double way : {factor, 1 / factor})
        for (;;) {
          Vector2d other = spot;
          other(k) *= way;
          if (other(k) < 0.2 * pitch(k) || other(k) > 8 * pitch(k)) break;
          double squares = 0;
          std::vector<BeamCorner> with = fitted(near, corners, other, squares);
          if (with.size() < kept.size() || squares >= best) break;
          best = squares, spot = other, kept = with;
        }
  straighten(beams, kept);
  kept = fitted(near, kept, spot, best);
  std::vector<double> contrasts, errors;
  for (const BeamCorner& c : kept) {
    contrasts.push_back(std::abs(c.half));
    errors.push_back(c.squares / static_cast<double>(c.beams.size()));
  }
  const double contrast = median(contrasts, 0), error = median(errors, 0);
  corners.clear();
  if (std::sqrt(error) > kUnlike * contrast) return false;
  const BeamGrain grain = grain_of(near, error);
  for (BeamCorner& c : kept)
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

std::vector<BeamPoint> points_of(const Beams& beams, const std::vector<BeamCorner>& corners,
                                 BeamTarget& out) {
  std::vector<RangedBeam> paper = bright_beams(beams, corners);
  RangePlane plane;
  if (!fit_plane(paper, plane)) {
    out.reason = "the ranges of its bright squares are not on a plane";
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
    const BeamCorner& c = corners[i];
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
  BeamBox box;
  for (const Beam* b : heap) box.take(b->place());
  const Vector2d step(beams.step_u, beams.step_v), rim = 2 * step + 0.2 * (box.high - box.low);
  std::vector<const Beam*> near;
  std::vector<double> around, inside, deviations;
  for (const Beam& b : beams.all) {
    const Vector2d out = (box.low - b.place()).cwiseMax(b.place() - box.high);
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
    variance += (b->place() - at).cwiseAbs2() * std::pow(noise / of_beams, 2);
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
  BeamBox box;
  for (const Beam& b : beams.all) all.push_back(&b), box.take(b.place());
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
  std::vector<BeamCorner> corners = corners_of(picture, view, target, found);
  const size_t wanted = corners.size();
  if (!fit_all(beams, corners)) {
    out.reason = "an object that resembles it was found, but it has no squares";
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
    out.reason = "no bright spot covers four beams";
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
