#include "sweep.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <utility>

#include "../../models/rig/configuration.h"
#include "../../models/rig/numbers.h"
#include "../document/error.h"
#include "beam_target.h"

namespace kincal {
namespace {

// --------------------------------------------------------------------------------------- the joint

/// The reading at a time, between two readings; NaN outside of all of them.
double reading_at(const std::vector<TiltReading>& tilt, double time) {
  const auto after = std::lower_bound(tilt.begin(), tilt.end(), time,
                                      [](const TiltReading& r, double t) { return r.time < t; });
  if (after == tilt.end() || (after == tilt.begin() && after->time > time)) return kNan;
  if (after->time == time) return after->reading;
  const TiltReading &a = *(after - 1), &b = *after;
  return a.reading + (time - a.time) / (b.time - a.time) * (b.reading - a.reading);
}

/// Noise of one reading, seen in third differences, which see no speed and no steady change of it.
double reading_noise(const std::vector<TiltReading>& tilt) {
  double sum = 0, n = 0;
  for (size_t i = 3; i < tilt.size(); ++i, ++n)
    sum += std::pow(
        tilt[i].reading - 3 * tilt[i - 1].reading + 3 * tilt[i - 2].reading - tilt[i - 3].reading,
        2);
  return n > 0 ? std::sqrt(sum / (20 * n)) : 0;
}

/// The readings without their noise: of each the parabola through those around it, if it is what
/// they scatter about; else as they are.
std::vector<TiltReading> smoothed(const std::vector<TiltReading>& tilt) {
  constexpr size_t kAround = 5;
  std::vector<TiltReading> out = tilt;
  double squares = 0;
  for (size_t i = 0; i < tilt.size(); ++i) {
    const size_t first = i < kAround ? 0 : i - kAround,
                 last = std::min(tilt.size(), i + kAround + 1);
    const double scale = tilt[last - 1].time - tilt[first].time;
    Matrix3d jtj = Matrix3d::Zero();
    Vector3d jtr = Vector3d::Zero();
    for (size_t k = first; k < last; ++k) {
      const double t = (tilt[k].time - tilt[i].time) / scale;
      const Vector3d j(1, t, t * t);
      jtj += j * j.transpose();
      jtr += (tilt[k].reading - tilt[i].reading) * j;
    }
    out[i].reading += jtj.ldlt().solve(jtr)(0);
    squares += std::pow(out[i].reading - tilt[i].reading, 2);
  }
  const double scatter = std::sqrt(squares / static_cast<double>(tilt.size()));
  return std::isfinite(scatter) && scatter < 1.2 * reading_noise(tilt) ? out : tilt;
}

/// A Scanner is a laser on its joint, as the rig says it is.
class Scanner {
 public:
  Scanner(const Rig& rig, int sensor)
      : rig_(rig), table_(rig), sensor_(sensor), readings_(rig.joints.size(), kNan) {}

  /// The laser in the frame that its joint moves in.
  Pose still_T_sensor(double reading) const {
    const Sensor& laser = rig_.sensors[static_cast<size_t>(sensor_)];
    const Configuration robot =
        Configuration(rig_, table_, table_.initial, readings_).with(laser.scanning_joint, reading);
    const int still = rig_.tree.joints[static_cast<size_t>(laser.scanning_joint)].parent;
    return robot.a_T_b(still, laser.link) * robot.link_T_sensor(sensor_);
  }

  /// How far a beam moves out of the scan plane, upwards, for each rad (or m) of the joint; in rad,
  /// or m.
  double rise(double reading, double bearing) const {
    constexpr double kStep = 1e-3;
    const Pose moved = inverse(still_T_sensor(reading)) * still_T_sensor(reading + kStep);
    const Vector3d beam(std::cos(bearing), std::sin(bearing), 0);
    return (moved.rotation * beam + moved.translation).z() / kStep;
  }

 private:
  const Rig& rig_;
  ParameterTable table_;
  int sensor_;
  std::vector<double> readings_;
};

// --------------------------------------------------------------------------------------- the beams

/// Typical differences of what follows one another: the 90th percentile of their sizes.
double usual_step(std::vector<double> steps) {
  steps.erase(std::remove_if(steps.begin(), steps.end(), [](double s) { return !(s > 0); }),
              steps.end());
  if (steps.empty()) return 0;
  const size_t smaller = 9 * (steps.size() - 1) / 10;
  return nth_smallest(std::move(steps), smaller);
}

/// The beams whose place in the picture goes down (`side` 1) or up (-1) with the reading. Behind a
/// laser that tilts about an axis across its beams they go the other way than before it.
Beams beams_of(const Sweep& sweep, const Scanner& scanner, int side, double middle) {
  Beams out;
  std::vector<double> steps;
  double before = kNan;
  for (const LaserScan& scan : sweep.scans) {
    const size_t n = std::min(scan.ranges.size(), scan.intensities.size());
    const double reading =
        reading_at(sweep.tilt, scan.time + 0.5 * static_cast<double>(n) * scan.time_increment);
    steps.push_back(std::abs(reading - before));
    before = reading;
    out.step_u = std::abs(scan.angle_increment);
  }
  out.step_v = usual_step(steps);
  std::vector<char> sides;
  for (const LaserScan& scan : sweep.scans) {
    const size_t n = std::min(scan.ranges.size(), scan.intensities.size());
    if (sides.size() != n) {
      sides.clear();
      for (size_t i = 0; i < n; ++i) {
        const double rise =
            scanner.rise(middle, scan.angle_min + static_cast<double>(i) * scan.angle_increment);
        sides.push_back(static_cast<char>(std::abs(rise) < 0.2 ? 0 : rise < 0 ? 1 : -1));
      }
    }
    for (size_t i = 0; i < n; ++i) {
      if (sides[i] != side || !std::isfinite(scan.intensities[i])) continue;
      Beam b;
      b.time = scan.time + static_cast<double>(i) * scan.time_increment;
      b.u = -(scan.angle_min + static_cast<double>(i) * scan.angle_increment);
      b.v = side * reading_at(sweep.tilt, b.time);
      if (!std::isfinite(b.v)) continue;
      b.range = std::isfinite(scan.ranges[i]) && scan.ranges[i] > 0 ? scan.ranges[i] : 0;
      b.intensity = scan.intensities[i];
      out.all.push_back(b);
    }
  }
  out.ray = [&scanner, side](double u, double v) {
    const Pose still_T_sensor = scanner.still_T_sensor(side * v);
    return Ray{still_T_sensor.translation,
               still_T_sensor.rotation * Vector3d(std::cos(u), -std::sin(u), 0)};
  };
  return out;
}

/// The distance of neighbouring points of a cloud: the smallest size of cells that leaves no gaps
/// between them.
double cloud_step(const std::vector<Beam>& beams) {
  for (double size = 5e-4; size < 0.1; size *= 1.3) {
    std::set<std::pair<long, long>> cells;
    for (const Beam& b : beams) cells.emplace(std::lround(b.u / size), std::lround(b.v / size));
    size_t gaps = 0;
    for (const auto& [x, y] : cells) gaps += cells.count({x, y + 1}) + cells.count({x + 1, y}) < 2;
    if (static_cast<double>(gaps) < 0.2 * static_cast<double>(cells.size())) return size;
  }
  return 0;
}

/// The beams of a cloud, to the right and down from a direction `ahead` of its x axis.
Beams beams_of(const Cloud& cloud, double ahead) {
  Beams out;
  for (size_t i = 0; i < std::min(cloud.points.size(), cloud.intensities.size()); ++i) {
    const Vector3d p = rotation_about(Vector3d::UnitZ(), -ahead) * cloud.points[i];
    Beam b;
    b.range = p.norm();
    b.intensity = cloud.intensities[i];
    if (!(b.range > 1e-6) || !std::isfinite(b.range) || !std::isfinite(b.intensity)) continue;
    b.u = -std::atan2(p.y(), p.x());
    b.v = -std::atan2(p.z(), std::hypot(p.x(), p.y()));
    b.time = cloud.time;
    out.all.push_back(b);
  }
  out.step_u = out.step_v = cloud_step(out.all);
  out.ray = [ahead](double u, double v) {
    return Ray{
        Vector3d::Zero(),
        {std::cos(v) * std::cos(u - ahead), -std::cos(v) * std::sin(u - ahead), -std::sin(v)}};
  };
  return out;
}

const Target& target_for(const RigFile& rig, int target) {
  const Target& out = rig.rig.targets[static_cast<size_t>(target)];
  if (out.type == "chessboard" || out.type == "charuco") return out;
  if (out.type == "points" && out.count() == 1) return out;
  throw InputError(rig.path + ": target '" + out.name + "' (" + out.type +
                   ") is not found in what a laser sees; chessboard, charuco, and points with one "
                   "point (a reflector) are");
}

BeamTarget find(const RigFile& rig, const Target& target, const Beams& beams) {
  return target.type == "points" ? find_reflector(beams)
                                 : find_board(beams, image_target(rig, target));
}

/// Root of the mean of squares.
double together(const std::vector<double>& sigmas) {
  double sum = 0;
  for (const double s : sigmas) sum += s * s;
  return std::sqrt(sum / std::max<double>(1, static_cast<double>(sigmas.size())));
}

/// What the noise of the joint's readings does to a ray: a corner's tilt is as noisy as the mean of
/// those that are smoothed together, while the joint passes the edges of the squares. All corners
/// of a row share it, so that the whole row is known no better than one of them.
double joint_share(const Sweep& sweep, const BeamTarget& found) {
  if (found.points.empty() || sweep.tilt.size() < 5) return 0;
  const double sharing = std::sqrt(static_cast<double>(found.points.size()));
  constexpr double kTogether = 6;
  return reading_noise(sweep.tilt) * std::sqrt(sharing / kTogether);
}

BeamView nothing(int sensor, int target, const std::string& reason) {
  BeamView out;
  out.view.sensor = sensor;
  out.view.target = target;
  out.reason = reason;
  return out;
}

}  // namespace

std::string BeamView::words() const {
  if (view.ids.empty()) return "NOT FOUND: " + reason;
  char text[160];
  std::string out = std::to_string(view.ids.size()) + (view.ids.size() == 1 ? " point" : " points");
  if (view.sigma.size() == 3) {
    std::snprintf(text, sizeof text, ", sigma %.2g of the joint, %.2g mrad, %.2g mm", view.sigma[0],
                  1e3 * view.sigma[1], 1e3 * view.sigma[2]);
    out += text;
  }
  for (const std::string& note : notes) out += "; " + note;
  return out;
}

std::vector<Sweep> one_way_sweeps(const Sweep& recorded, double least) {
  std::vector<Sweep> out;
  const std::vector<TiltReading>& tilt = recorded.tilt;
  size_t first = 0, last = 0;  // of the way so far: where it began, and its farthest reading
  const auto end = [&] {
    if (std::abs(tilt[last].reading - tilt[first].reading) < least) return;
    Sweep one;
    one.tilt.assign(tilt.begin() + static_cast<std::ptrdiff_t>(first),
                    tilt.begin() + static_cast<std::ptrdiff_t>(last) + 1);
    for (const LaserScan& scan : recorded.scans) {
      const auto beams = static_cast<double>(scan.ranges.size());
      const double until = scan.time + beams * scan.time_increment;
      if (std::min(scan.time, until) >= tilt[first].time &&
          std::max(scan.time, until) <= tilt[last].time)
        one.scans.push_back(scan);
    }
    if (one.scans.size() > 1) out.push_back(std::move(one));
  };
  const double back = 0.1 * least;  // so far it has to come back
  for (size_t i = 1; i < tilt.size(); ++i) {
    const double way = tilt[last].reading - tilt[first].reading;
    const double ahead = (way < 0 ? -1 : 1) * (tilt[i].reading - tilt[last].reading);
    if (way == 0 || ahead >= 0) {
      if (way == 0 && tilt[i].reading == tilt[first].reading) first = i;  // it rests
      last = i;
    } else if (-ahead > back) {
      end();
      first = last;
      last = i;
    }
  }
  if (!tilt.empty()) end();
  return out;
}

BeamView find_in_sweep(const RigFile& rig, int sensor, int target, const Sweep& recorded) {
  Sweep sweep = recorded;
  sweep.tilt = smoothed(sweep.tilt);
  const Target& wanted = target_for(rig, target);
  size_t beams = 0, dim = 0;
  for (const LaserScan& scan : sweep.scans) {
    beams += scan.ranges.size();
    dim += scan.intensities.size() < scan.ranges.size();
  }
  if (sweep.scans.size() < 10 || sweep.tilt.size() < 2)
    return nothing(sensor, target,
                   "the sweep has only " + std::to_string(sweep.scans.size()) + " scans and " +
                       std::to_string(sweep.tilt.size()) + " readings of its joint");
  if (beams == 0 || dim == sweep.scans.size())
    return nothing(sensor, target, "the scans have no intensities: switch them on in the driver");
  const Scanner scanner(rig.rig, sensor);
  const double middle = 0.5 * (sweep.tilt.front().reading + sweep.tilt.back().reading);
  BeamView out = nothing(sensor, target, "");
  for (const int side : {1, -1}) {
    const Beams all = beams_of(sweep, scanner, side, middle);
    if (all.all.empty() || !(all.step_u > 0) || !(all.step_v > 0)) continue;
    const BeamTarget found = find(rig, wanted, all);
    if (out.reason.empty()) out.reason = found.reason;
    if (found.points.empty()) continue;
    std::vector<double> tilts, bearings, ranges;
    for (const BeamPoint& p : found.points) {
      out.view.ids.push_back(p.id);
      out.view.z.insert(out.view.z.end(), {side * p.v, -p.u, p.range});
      out.times.push_back(p.time);
      tilts.push_back(std::sqrt(p.covariance(1, 1)));
      bearings.push_back(std::sqrt(p.covariance(0, 0)));
      ranges.push_back(p.range_sigma);
    }
    out.view.sigma = {std::hypot(together(tilts), joint_share(recorded, found)), together(bearings),
                      together(ranges)};
    out.notes = found.notes;
    out.reason.clear();
    break;
  }
  if (out.view.ids.empty() && out.reason.empty())
    out.reason = "no beam has a range, an intensity and a reading of its joint";
  return out;
}

BeamView find_in_cloud(const RigFile& rig, int sensor, int target, const Cloud& cloud) {
  const Target& wanted = target_for(rig, target);
  if (cloud.intensities.size() < cloud.points.size())
    return nothing(sensor, target, "the cloud has no intensities");
  BeamView out = nothing(sensor, target, "");
  for (const double ahead : {0., kPi}) {  // what is behind is cut in two
    const Beams all = beams_of(cloud, ahead);
    if (all.all.empty() || !(all.step_u > 0)) break;
    const BeamTarget found = find(rig, wanted, all);
    if (out.reason.empty()) out.reason = found.reason;
    const auto cut = [](const BeamPoint& p) { return std::abs(p.u) > kPi - 0.3; };
    if (found.points.empty() ||
        (ahead == 0 && std::any_of(found.points.begin(), found.points.end(), cut)))
      continue;
    for (const BeamPoint& p : found.points) {
      const Vector3d along = all.ray(p.u, p.v).direction, right(along.y(), -along.x(), 0),
                     down = along.cross(right.normalized());
      Eigen::Matrix<double, 3, 2> across;
      across << right, down;
      out.view.ids.push_back(p.id);
      for (int k = 0; k < 3; ++k) out.view.z.push_back(p.range * along(k));
      out.times.push_back(p.time);
      out.view.covariance.push_back(p.range * p.range * across * p.covariance * across.transpose() +
                                    std::pow(p.range_sigma, 2) * along * along.transpose());
    }
    out.notes = found.notes;
    out.reason.clear();
    break;
  }
  if (out.view.ids.empty() && out.reason.empty())
    out.reason = "the cloud has no points with an intensity";
  return out;
}

}  // namespace kincal
