#include "render.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "../../models/fitting/view_poses.h"

namespace kincal {
namespace {

constexpr int kFine = 2;  // pixels are seen in parts, so many by so many
struct Lattice {          // of rays in a part: Fibonacci numbers, the second before
  int rays, step;
};
constexpr Lattice kFew{8, 5}, kMany{233, 144};
constexpr double kInk = 30, kPaper = 220;  // grey levels
constexpr double kBack = 0.5;              // of a sheet, between ink and paper

/// The plane of a sheet as a camera's directions see it: h * direction = (x, y, 1) times a factor.
struct Plane {
  const Sheet* sheet;
  Matrix3d h;
  double height;  // of the eye above the plane, along the print's z
  bool front;
};

using PixelCorners =
    std::array<Vector3d, 4>;  // of a pixel: upper left, upper right, lower left, right

Plane plane_of(const Sheet& sheet, const Vector3d& eye) {
  const Matrix3d r = sheet.camera_T_print.rotation.transpose();
  const Vector3d e = r * (eye - sheet.camera_T_print.translation);  // the eye as the print sees it
  Plane out;
  out.sheet = &sheet;
  out.height = e.z();
  out.front = sheet.y_up ? e.z() > 0 : e.z() < 0;
  out.h.row(0) = (e.x() * r.row(2) - e.z() * r.row(0)) / sheet.unit;
  out.h.row(1) = (e.y() * r.row(2) - e.z() * r.row(1)) / sheet.unit;
  out.h.row(2) = r.row(2);
  return out;
}

/// How far along a direction the plane is; negative: behind.
double reach(const Plane& plane, const Vector3d& seen) { return -plane.height / seen.z(); }

/// Can the sheet be in the pixel? `corners` are of the pixel, as the plane has them.
bool may_show(const Plane& plane, const PixelCorners& corners) {
  const cv::Rect2d& sheet = plane.sheet->print->sheet;
  double low_x = 1e300, high_x = -1e300, low_y = 1e300, high_y = -1e300;
  for (const Vector3d& c : corners) {
    if (!(reach(plane, c) > 0)) return false;
    low_x = std::min(low_x, c.x() / c.z()), high_x = std::max(high_x, c.x() / c.z());
    low_y = std::min(low_y, c.y() / c.z()), high_y = std::max(high_y, c.y() / c.z());
  }
  return high_x >= sheet.x && low_x <= sheet.x + sheet.width && high_y >= sheet.y &&
         low_y <= sheet.y + sheet.height;
}

double between(double a, double b, double t) { return a + (b - a) * t; }

/// Random numbers of a lattice of places, -1 to 1, smooth between them.
double lattice_noise(std::uint64_t seed, double x, double y) {
  const auto at = [&](int i, int j) {
    std::uint64_t h = seed + 0x9e3779b97f4a7c15u * static_cast<std::uint64_t>(i + 70000) +
                      0xc2b2ae3d27d4eb4fu * static_cast<std::uint64_t>(j + 70000);
    h = (h ^ (h >> 29)) * 0xbf58476d1ce4e5b9u;
    h = (h ^ (h >> 32)) * 0x94d049bb133111ebu;
    return static_cast<double>(h >> 11) * 0x1p-52 - 1;
  };
  const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
  const double u = x - i, v = y - j, a = u * u * (3 - 2 * u), b = v * v * (3 - 2 * v);
  return between(between(at(i, j), at(i + 1, j), a), between(at(i, j + 1), at(i + 1, j + 1), a), b);
}

/// What is behind all sheets, between ink and paper.
double background(const Look& look, std::uint64_t seed, double u, double v) {
  if (look.background == "grey") return 0.45;
  const double slope = static_cast<double>(seed % 7) / 6 - 0.5;
  const double plain = 0.45 + 0.25 * (u - 0.5) + 0.3 * slope * (v - 0.5);
  if (look.background == "gradient") return plain;
  return plain + 0.15 * lattice_noise(seed, 6 * u, 6 * v) +
         0.1 * lattice_noise(seed + 1, 40 * u, 40 * v) +
         0.05 * lattice_noise(seed + 2, 160 * u, 160 * v);
}

/// What a ray through a pixel sees, at (a, b) of it, 0 to 1. `planes` may show in it, `seen` are
/// the pixel's corners as they have them; the first that the ray hits is what it sees.
double ray_sees(const std::vector<const Plane*>& planes, const std::vector<PixelCorners>& seen,
                double behind, double a, double b) {
  double value = behind, nearest = 1e300;
  for (size_t k = 0; k < planes.size(); ++k) {
    const PixelCorners& c = seen[k];
    const Vector3d at = (1 - b) * ((1 - a) * c[0] + a * c[1]) + b * ((1 - a) * c[2] + a * c[3]);
    const double distance = reach(*planes[k], at);
    const cv::Point2d place(at.x() / at.z(), at.y() / at.z());
    const Print& print = *planes[k]->sheet->print;
    if (distance >= nearest || !print.sheet.contains(place)) continue;
    nearest = distance;
    value = planes[k]->front ? print.brightness(place.x, place.y) : kBack;
  }
  return value;
}

/// The parts of a pixel: the mean of a few rays where these and its corners see the same (a
/// straight edge leaves no pixel without a corner on either side of it), else of many.
std::array<double, kFine * kFine> parts_of(const std::vector<const Plane*>& planes,
                                           const std::vector<PixelCorners>& seen, double behind,
                                           RandomStream& draws) {
  std::array<double, kFine * kFine> out;
  out.fill(behind);
  if (planes.empty()) return out;
  double low = 1e300, high = -1e300;
  const auto sees = [&](double a, double b) {
    const double value = ray_sees(planes, seen, behind, a, b);
    low = std::min(low, value), high = std::max(high, value);
    return value;
  };
  for (const double a : {0, 1})
    for (const double b : {0, 1}) sees(a, b);
  for (const Lattice& lattice : {kFew, kMany}) {
    for (size_t i = 0; i < out.size(); ++i) {
      const double shift_x = draws.uniform(), shift_y = draws.uniform();
      double sum = 0;
      for (int ray = 0; ray < lattice.rays; ++ray) {
        const double a = static_cast<double>(ray) / lattice.rays + shift_x;
        const double b =
            static_cast<double>(ray * lattice.step % lattice.rays) / lattice.rays + shift_y;
        sum += sees((static_cast<double>(i % kFine) + a - std::floor(a)) / kFine,
                    (static_cast<double>(i / kFine) + b - std::floor(b)) / kFine);
      }
      out[i] = sum / lattice.rays;
    }
    if (low == high) break;
  }
  return out;
}

/// Blur, pixels out of their parts, and darker corners.
cv::Mat gathered(const cv::Mat& fine, const Look& look) {
  cv::Mat picture;
  if (look.blur > 0) cv::GaussianBlur(fine, fine, {0, 0}, kFine * look.blur);
  cv::resize(fine, picture, {fine.cols / kFine, fine.rows / kFine}, 0, 0, cv::INTER_AREA);
  const double middle_x = 0.5 * (picture.cols - 1), middle_y = 0.5 * (picture.rows - 1);
  const double corner = std::max(1.0, middle_x * middle_x + middle_y * middle_y);
  for (int row = 0; row < picture.rows; ++row)
    for (int column = 0; column < picture.cols; ++column) {
      const double x = column - middle_x, y = row - middle_y;
      picture.at<double>(row, column) *= 1 - look.vignetting * (x * x + y * y) / corner;
    }
  return picture;
}

}  // namespace

CameraRays camera_rays(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                       int sensor) {
  const Sensor& camera = rig.sensors[sensor];
  CameraRays out;
  out.width = camera.image_width;
  out.height = camera.image_height;
  out.directions.assign(static_cast<size_t>(out.width + 1) * static_cast<size_t>(out.height + 1),
                        Vector3d::Constant(kNan));
  for (int row = 0; row <= out.height; ++row) {
    View view;
    view.sensor = sensor;
    for (int column = 0; column <= out.width; ++column)
      view.z.insert(view.z.end(), {column - 0.5, row - 0.5});
    std::vector<int> keep;
    const Matrix3Xd found = seen_directions(rig, table, values, view, out.width + 1, keep);
    for (size_t i = 0; i < keep.size(); ++i)
      out.directions[static_cast<size_t>(row) * static_cast<size_t>(out.width + 1) +
                     static_cast<size_t>(keep[i])] = found.col(static_cast<Eigen::Index>(i));
  }
  const int first = table.sensor_block[sensor];
  for (size_t b = 0; b < camera.parameters.size(); ++b) {
    const Parameter& block = table.all[first + static_cast<int>(b)];
    if (block.kind == ParameterKind::baseline) out.eye.x() = values(block.start);
  }
  return out;
}

cv::Mat expose(const CameraRays& rays, const std::vector<Sheet>& sheets, const Look& look,
               RandomStream& draws) {
  std::vector<Plane> planes;
  for (const Sheet& sheet : sheets) planes.push_back(plane_of(sheet, rays.eye));
  const std::uint64_t seed = draws.bits();
  cv::Mat fine(kFine * rays.height, kFine * rays.width, CV_64F);
  const size_t stride = static_cast<size_t>(rays.width) + 1;
  std::vector<const Plane*> near;
  std::vector<PixelCorners> seen;
  for (int row = 0; row < rays.height; ++row)
    for (int column = 0; column < rays.width; ++column) {
      const Vector3d* d =
          &rays.directions[static_cast<size_t>(row) * stride + static_cast<size_t>(column)];
      cv::Mat parts = fine(cv::Rect(kFine * column, kFine * row, kFine, kFine));
      if (!(d[0] + d[1] + d[stride] + d[stride + 1]).allFinite()) {
        parts.setTo(0);
        continue;
      }
      near.clear();
      seen.clear();
      for (const Plane& plane : planes) {
        const PixelCorners corners = {plane.h * d[0], plane.h * d[1], plane.h * d[stride],
                                      plane.h * d[stride + 1]};
        if (!may_show(plane, corners)) continue;
        near.push_back(&plane);
        seen.push_back(corners);
      }
      const double behind =
          background(look, seed, (column + 0.5) / rays.width, (row + 0.5) / rays.width);
      const std::array<double, kFine* kFine> shares = parts_of(near, seen, behind, draws);
      for (int i = 0; i < kFine * kFine; ++i)
        parts.at<double>(i / kFine, i % kFine) = kInk + (kPaper - kInk) * shares[i];
    }
  return gathered(fine, look);
}

cv::Mat develop(const cv::Mat& light, double noise, RandomStream& draws) {
  cv::Mat out(light.size(), CV_8U);
  for (int row = 0; row < light.rows; ++row)
    for (int column = 0; column < light.cols; ++column) {
      double grey = light.at<double>(row, column);
      if (noise > 0) grey += noise * draws.normal();
      out.at<uchar>(row, column) = cv::saturate_cast<uchar>(grey);
    }
  return out;
}

cv::Mat take_picture(const CameraRays& rays, const std::vector<Sheet>& sheets, const Look& look,
                     RandomStream draws) {
  const cv::Mat light = expose(rays, sheets, look, draws);
  return develop(light, look.noise, draws);
}

}  // namespace kincal
