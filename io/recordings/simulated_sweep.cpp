#include "simulated_sweep.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace kincal {
namespace {

constexpr size_t kRays = 32;                                 // of a spot
constexpr double kInkIntensity = 0.12, kPaperIntensity = 1;  // light that comes back
constexpr double kBackOfSheet = 0.5;                         // of a sheet, between ink and paper

/// What a ray sees.
struct Sight {
  double range, light, brightness;
};

/// A texture of the wall: waves across each other.
double wall_light(const Vector3d& d, std::uint64_t seed) {
  const auto phase = static_cast<double>(seed % 97);
  return 0.45 + 0.08 * std::sin(9 * d.x() + 5 * d.z() + phase) * std::sin(7 * d.y() + 2 * phase) +
         0.05 * std::sin(31 * d.z() + 17 * d.y() + phase);
}

/// The sheets that a beam may see.
std::vector<const Sheet*> sheets_in(const LaserScene& scene, const Ray& ray, double spot) {
  std::vector<const Sheet*> out;
  for (const Sheet& sheet : scene.sheets) {
    const cv::Rect2d& box = sheet.print->sheet;
    const Vector3d middle =
        sheet.camera_T_print * Vector3d(sheet.unit * (box.x + 0.5 * box.width),
                                        sheet.unit * (box.y + 0.5 * box.height), 0);
    const Vector3d to = middle - ray.origin, beside = to - to.dot(ray.direction) * ray.direction;
    if (beside.norm() < 0.5 * sheet.unit * std::hypot(box.width, box.height) + 4 * spot * to.norm())
      out.push_back(&sheet);
  }
  return out;
}

Sight look_along(const LaserScene& scene, const std::vector<const Sheet*>& sheets, const Ray& ray,
                 const LaserLook& look) {
  const Vector3d from = ray.origin - scene.middle;  // where the wall, a sphere, is hit
  const double b = from.dot(ray.direction);
  const double wall = -b + std::sqrt(b * b - from.squaredNorm() + look.wall * look.wall);
  const Vector3d there = (from + wall * ray.direction) / look.wall;
  Sight out{wall, wall_light(there, scene.seed), 1};
  for (const Sheet* at_all : sheets) {
    const Sheet& sheet = *at_all;
    const Pose& print = sheet.camera_T_print;
    const double slope = print.rotation.col(2).dot(ray.direction);
    const double height = print.rotation.col(2).dot(print.translation - ray.origin);
    const double range = height / slope;
    if (!(range > 0.05) || range > out.range) continue;
    const Vector3d at = inverse(print) * Vector3d(ray.origin + range * ray.direction) / sheet.unit;
    if (!sheet.print->sheet.contains(cv::Point2d(at.x(), at.y()))) continue;
    const bool front = (slope > 0) != sheet.y_up;
    const double brightness = front ? sheet.print->brightness(at.x(), at.y()) : kBackOfSheet;
    out = {range, kInkIntensity + (kPaperIntensity - kInkIntensity) * brightness, brightness};
  }
  return out;
}

/// The directions of a spot, as slopes beside its own, for a sigma of 1: each for as much light.
const std::array<std::array<double, 2>, kRays>& spot() {
  static const auto made = [] {
    std::array<std::array<double, 2>, kRays> out;
    for (size_t i = 0; i < kRays; ++i) {
      const double share = (static_cast<double>(i) + 0.5) / kRays,
                   radius = std::sqrt(-2 * std::log(1 - share)),
                   angle = static_cast<double>(i) * kPi * (3 - std::sqrt(5.));
      out[i] = {radius * std::cos(angle), radius * std::sin(angle)};
    }
    return out;
  }();
  return made;
}

}  // namespace

Beam shoot(const LaserScene& scene, const Pose& scene_T_beam, const LaserLook& look,
           RandomStream& draws) {
  Beam out;
  const Ray middle{scene_T_beam.translation, scene_T_beam.rotation.col(0)};
  const std::vector<const Sheet*> sheets = sheets_in(scene, middle, look.spot);
  double light = 0, range = 0, brightness = 0;
  const auto add = [&](const Ray& ray, double share) {
    const Sight seen = look_along(scene, sheets, ray, look);
    light += share * seen.light;
    range += share * seen.light * seen.range;
    brightness += share * seen.brightness;
  };
  const double turn = draws.uniform(0, 2 * kPi), c = std::cos(turn), s = std::sin(turn);
  if (sheets.empty()) add(middle, 1);
  for (size_t i = 0; i < kRays && !sheets.empty(); ++i) {
    const auto [a, b] = spot()[i];
    const Vector3d d(1, look.spot * (c * a - s * b), look.spot * (s * a + c * b));
    add({middle.origin, scene_T_beam.rotation * d.normalized()}, 1. / kRays);
  }
  range /= light;
  out.range = range + look.ink_range * (1 - brightness) +
              look.range_noise / std::sqrt(light) * draws.normal();
  const double level = 4000 * light * 2 / (1 + range) + look.intensity_noise * draws.normal();
  out.intensity = std::max(0., look.step * std::round(level / look.step));
  return out;
}

LaserScan simulate_scan(const LaserScene& scene, const std::function<Pose(double)>& scene_T_sensor,
                        double time, const LaserLook& look, RandomStream& draws) {
  LaserScan out;
  out.time = time;
  out.angle_min = -look.half_angle;
  out.angle_increment = look.increment;
  out.time_increment = look.turn * look.increment / (2 * kPi);
  const auto n = static_cast<size_t>(2 * look.half_angle / look.increment + 1.5);
  for (size_t i = 0; i < n; ++i) {
    const auto k = static_cast<double>(i);
    Pose turned;
    turned.rotation = rotation_about(Vector3d::UnitZ(), out.angle_min + k * out.angle_increment);
    const Beam beam =
        shoot(scene, scene_T_sensor(time + k * out.time_increment) * turned, look, draws);
    out.ranges.push_back(static_cast<float>(beam.range));
    out.intensities.push_back(static_cast<float>(beam.intensity));
  }
  return out;
}

}  // namespace kincal
