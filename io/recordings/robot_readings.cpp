#include "robot_readings.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "../../kinematics/floating.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/numbers.h"
#include "../../models/rig/words.h"

namespace kincal {
namespace {

constexpr double kPause = 1;  // s without any readings: two recordings

/// Joints that some sensor or target stands on.
std::set<int> joints_that_matter(const Rig& rig) {
  std::set<int> out;
  for (int s = 0; s < static_cast<int>(rig.sensors.size()); ++s)
    for (const int j : needed_readings(rig, s, -1)) out.insert(j);
  for (int t = 0; t < static_cast<int>(rig.targets.size()); ++t)
    for (const int j : needed_readings(rig, -1, t)) out.insert(j);
  return out;
}

/// Readings of a joint that turns on and on jump by whole turns.
void without_turns(Series& series) {
  double turns = 0;
  for (size_t i = 1; i < series.size(); ++i) {
    const double step = series.values[i] + turns - series.values[i - 1];
    turns -= 2 * kPi * std::round(step / (2 * kPi));
    series.values[i] += turns;
  }
}

/// The poses of a floating joint as one stream, at the times of the busiest of those that they are
/// made of.
PoseStream poses_of(const RecordedStreams& streams, const PoseSource& source) {
  if (source.stream >= 0) return streams.poses[source.stream];
  const PoseStream* busiest = nullptr;
  for (const PoseStream& s : streams.poses)
    if (!s.fixed && (!busiest || s.times.size() > busiest->times.size())) busiest = &s;
  PoseStream out;
  out.topic = "/tf";
  if (!busiest) return out;
  for (const double time : busiest->times) {
    Pose pose;
    if (!transform_at(streams.poses, source.frame, source.child, time, 1, pose)) continue;
    out.times.push_back(time);
    out.poses.push_back(pose);
  }
  return out;
}

double tolerance_of(const Series& series, double given) {
  return std::isnan(given) ? std::max(1e-9, still_tolerance(series)) : given;
}

/// When a series is still, or has no values. A time without values between two postures is apart
/// from both.
Intervals still_or_absent(const Series& series, double given, double gap,
                          const TimeInterval& during) {
  const double tolerance = tolerance_of(series, given);
  const Intervals absent = complement(coverage(series.times, gap), during.begin, during.end);
  Intervals parts;
  double begin = during.begin;
  const auto part = [&](double end) {
    if (end > begin) parts.push_back({begin, end});
    begin = end;
  };
  for (const TimeInterval& one : absent) {
    const auto after = static_cast<size_t>(
        std::lower_bound(series.times.begin(), series.times.end(), one.end) - series.times.begin());
    if (after == 0 || after == series.size() ||
        std::abs(series.values[after] - series.values[after - 1]) <= 2 * tolerance)
      continue;
    part(one.begin);
    part(one.end);
  }
  part(during.end);
  return intersected(united(still_intervals(series, tolerance, gap), absent), parts);
}

}  // namespace

std::vector<Series> pose_series(const PoseStream& poses) {
  std::vector<Series> out(7);
  for (Series& s : out) s.times = poses.times;
  Eigen::Vector4d before(0, 0, 0, 1);
  for (const Pose& pose : poses.poses) {
    Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
    if (q.dot(before) < 0) q = -q;
    before = q;
    for (int i = 0; i < 3; ++i) out[i].values.push_back(pose.translation[i]);
    for (int i = 0; i < 4; ++i) out[3 + i].values.push_back(q[i]);
  }
  return out;
}

AveragePose average_pose(const PoseStream& poses, const TimeInterval& over) {
  AveragePose out;
  std::vector<Pose> inside;
  for (size_t i = 0; i < poses.times.size(); ++i)
    if (over.contains(poses.times[i])) inside.push_back(poses.poses[i]);
  out.count = static_cast<long>(inside.size());
  if (inside.empty()) return out;
  out.mean = inside[inside.size() / 2];
  const auto n = static_cast<double>(inside.size());
  for (int round = 0; round < 3; ++round) {  // of the middle's tangent space
    Vector6d sum = Vector6d::Zero();
    for (const Pose& pose : inside) sum += log_se3(inverse(out.mean) * pose);
    out.mean = out.mean * exp_se3(sum / n);
  }
  if (inside.size() < 2) return out;
  double translation = 0, rotation = 0;
  for (const Pose& pose : inside) {
    const Vector6d off = log_se3(inverse(out.mean) * pose);
    translation += off.head<3>().squaredNorm();
    rotation += off.tail<3>().squaredNorm();
  }
  out.translation = std::sqrt(translation / (3 * (n - 1)));
  out.rotation = std::sqrt(rotation / (3 * (n - 1)));
  return out;
}

RobotReadings::RobotReadings(const Rig& rig, RecordedStreams& streams, const TopicMap& topics)
    : rig_(rig),
      series_(rig.tree.joints.size()),
      gaps_(rig.tree.joints.size(), 0),
      scatter_(rig.tree.joints.size(), 0),
      smallest_step_(rig.tree.joints.size(), 0) {
  const std::set<int> matter = joints_that_matter(rig);
  TimeInterval span{kInfinity, -kInfinity};
  const auto widen = [&](const std::vector<double>& times) {
    if (times.empty()) return;
    span.begin = std::min(span.begin, times.front());
    span.end = std::max(span.end, times.back());
  };
  for (size_t j = 0; j < series_.size(); ++j) {
    const int stream = topics.joints[j];
    if (stream < 0) continue;
    series_[j] = std::move(streams.joints[stream].readings);
    if (rig.tree.joints[j].type == JointType::continuous) without_turns(series_[j]);
    gaps_[j] = longest_gap(series_[j].times);
    widen(series_[j].times);
    if (!matter.count(static_cast<int>(j))) continue;
    watched_.push_back(static_cast<int>(j));
    scatter_[j] = scatter_at_rest(series_[j]);
    smallest_step_[j] = smallest_step(series_[j]);
  }
  streams.joints.clear();
  for (size_t j = 0; j < topics.floating.size(); ++j) {
    if (!topics.floating[j].known()) continue;
    Floating one{static_cast<int>(j), poses_of(streams, topics.floating[j]), 0, {}, {}};
    if (one.poses.times.empty()) continue;
    one.gap = longest_gap(one.poses.times);
    one.series = pose_series(one.poses);
    for (const Series& s : one.series) one.scatter.push_back(scatter_at_rest(s));
    widen(one.poses.times);
    floating_.push_back(std::move(one));
  }
  if (span.begin <= span.end) span_ = span;
}

std::vector<double> RobotReadings::at(double time) const {
  std::vector<double> out(series_.size(), kNan);
  for (size_t j = 0; j < series_.size(); ++j)
    if (series_[j].size() > 0) out[j] = value_at(series_[j], time, gaps_[j]);
  for (const Floating& f : floating_) {
    Pose pose;
    if (pose_at(f.poses, time, f.gap, pose)) set_pose_reading(rig_.tree, f.joint, pose, out);
  }
  return out;
}

Intervals RobotReadings::logged() const {
  Intervals out;
  for (const int j : watched_) {
    const auto i = static_cast<size_t>(j);
    out = united(out, coverage(series_[i].times, std::max(kPause, gaps_[i])));
  }
  for (const Floating& f : floating_)
    out = united(out, coverage(f.poses.times, std::max(kPause, f.gap)));
  return out;
}

std::vector<std::string> RobotReadings::absences() const {
  std::vector<std::string> out;
  const Intervals all = logged();
  for (const int j : watched_) {
    const Intervals absent =
        intersected(all, complement(coverage(series_[j].times, gaps_[j]), span_.begin, span_.end));
    double longest = 0, begin = 0;
    for (const TimeInterval& one : absent)
      if (one.length() > longest) longest = one.length(), begin = one.begin;
    if (longest < kPause) continue;
    out.push_back(text(
        "joint '%s' has no readings for %.1f s, starting at %.1f s, although other joints have",
        rig_.tree.joints[j].name.c_str(), longest, begin));
  }
  return out;
}

Intervals RobotReadings::still(const TimeInterval& during, double tolerance) const {
  Intervals out = intersected({during}, logged());
  for (const int j : watched_)
    out = intersected(out, still_or_absent(series_[j], tolerance, gaps_[j], during));
  for (const Floating& f : floating_)
    for (const Series& s : f.series)
      out = intersected(out, still_or_absent(s, tolerance, f.gap, during));
  return out;
}

TimeInterval RobotReadings::without_slow_ends(TimeInterval rest, double tolerance) const {
  const double given = std::isnan(tolerance) ? 0 : tolerance;
  for (const int j : watched_)
    rest = kincal::without_slow_ends(series_[j], rest, std::max(scatter_[j], given));
  for (const Floating& f : floating_)
    for (size_t k = 0; k < f.series.size(); ++k)
      rest = kincal::without_slow_ends(f.series[k], rest, std::max(f.scatter[k], given));
  return rest;
}

std::string RobotReadings::restless(double length, double tolerance) const {
  double most = 0, allowed = 0;
  std::string name;
  const auto look = [&](const Series& series, double gap, const std::string& joint) {
    const double motion = quietest(series, length, gap), limit = tolerance_of(series, tolerance);
    if (!std::isfinite(motion) || !(motion / limit > most)) return;
    most = motion / limit;
    allowed = limit;
    name = joint;
  };
  for (const int j : watched_) look(series_[j], gaps_[j], rig_.tree.joints[j].name);
  for (const Floating& f : floating_)
    for (const Series& s : f.series) look(s, f.gap, rig_.tree.joints[f.joint].name);
  if (most <= 1) return text("each joint rests for %.3g s at times, but never all at once", length);
  return text(
      "joint '%s' is never still for %.3g s: it moves by %.3g mrad (mm) at least in that time; "
      "%.3g counts as rest",
      name.c_str(), length, 2e3 * most * allowed, 2e3 * allowed);
}

void RobotReadings::average(const TimeInterval& over, Sample& sample) const {
  sample.readings.assign(series_.size(), kNan);
  sample.noise.assign(series_.size(), 1);
  const std::vector<double> middle = at((over.begin + over.end) / 2);
  for (size_t j = 0; j < series_.size(); ++j) {
    if (series_[j].size() == 0) continue;
    const Average mean = kincal::average(series_[j], over);
    sample.readings[j] = mean.count > 0 ? mean.mean : middle[j];
    const double sigma = rig_.joints[j].sigma;
    if (!(sigma > 0) || mean.count < 2) continue;
    // Encoders that count repeat themselves as well; that is in the rig's sigma.
    const bool counts = smallest_step_[j] > scatter_[j] / 2;
    const double n = independent(series_[j], over), scatter = std::max(mean.scatter, scatter_[j]);
    const bool repeats = !counts && n < 0.5 * static_cast<double>(mean.count);
    sample.noise[j] =
        (repeats ? std::hypot(sigma, scatter / std::sqrt(n)) : mean.sigma(sigma)) / sigma;
  }
  for (const Floating& f : floating_) {
    const AveragePose mean = average_pose(f.poses, over);
    Pose pose;
    if (mean.count > 0)
      set_pose_reading(rig_.tree, f.joint, mean.mean, sample.readings);
    else if (pose_at(f.poses, (over.begin + over.end) / 2, f.gap, pose))
      set_pose_reading(rig_.tree, f.joint, pose, sample.readings);
    if (mean.count < 2) continue;
    const int first = rig_.tree.joints[f.joint].first_axis + kPoseAxes;
    for (int k = 0; k < kPoseAxes; ++k) {
      const double sigma = rig_.joints[first + k].sigma;
      const Average one{0, k < 3 ? mean.translation : mean.rotation, mean.count};
      if (sigma > 0) sample.noise[first + k] = one.sigma(sigma) / sigma;
    }
  }
}

}  // namespace kincal
