#include "time_offset.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <optional>
#include <set>

#include "../../models/rig/configuration.h"
#include "../../models/rig/numbers.h"
#include "../../models/rig/targets.h"

namespace kincal {
namespace {

constexpr double kGrid = 0.02;           // s
constexpr double kDifference = 0.5e-3;   // s, of differences
constexpr double kHuber = 1.5;           // in scales
constexpr double kInterpolation = 5e-5;  // s, see the header
constexpr int kLeastWays = 3;
constexpr double kLeastOfWays = 1.2;                      // as many as have an equal share
constexpr double kLeastSpeed = 10, kLeastShare = 0.1;     // px / s; of the usual speed
constexpr double kSamePlace = 0.003, kSameAngle = 0.006;  // m, rad: a target that did not move
constexpr size_t kStretches = 8;
constexpr double kLeastChange = 1e-3;            // s
constexpr double kFar = 5;                       // px
constexpr double kMostWrong = 0.25;              // of the images
constexpr double kUnclear = 2e-3;                // s: a sigma that is no result
constexpr double kAlike = 9, kLeastScale = 0.1;  // of costs; px
constexpr double kClear = 0.3e-3;                // s: a sigma that tells that such a clock is right
constexpr double kFarSigma =
    0.5e-3;  // s, of a stretch of two ways, where the clock changes by more

Pose on_the_way(const Pose& a, const Pose& b, double share) {
  return a * exp_se3(share * log_se3(inverse(a) * b));
}

/// Predicts what cameras see between rests.
class Predictor {
 public:
  explicit Predictor(const OffsetInput& input) : in_(input), rig_(input.recording.rig) {
    for (size_t t = 0; t < rig_.targets.size(); ++t)
      points_.push_back(
          target_points(rig_, in_.recording.table, in_.values.shared, static_cast<int>(t)));
  }

  /// Residuals of a sighting if the stamps are late by `offset`; none where nothing is known.
  std::optional<VectorXd> residuals(const WaySighting& seen, double offset) const {
    std::vector<double> readings = in_.readings(seen.time - offset);
    const View& view = seen.view;
    for (const int j : view_readings(rig_, view.sensor, view.target))
      if (std::isnan(readings[static_cast<size_t>(j)])) return std::nullopt;
    const double share = share_of_way(seen, readings);
    for (size_t j = 0; j < readings.size(); ++j)
      readings[j] += (1 - share) * error(seen.before, static_cast<int>(j)) +
                     share * error(seen.after, static_cast<int>(j));
    readings = completed(std::move(readings));
    const Configuration robot(rig_, in_.recording.table, in_.values.shared, readings);
    const std::optional<Pose> base_T_target = target_pose(seen, robot, share);
    if (!base_T_target) return std::nullopt;
    ViewInput input;
    input.sensor_T_target = inverse(robot.base_T_sensor(view.sensor)) * *base_T_target;
    const int block = in_.recording.table.sensor_block[static_cast<size_t>(view.sensor)];
    input.parameters =
        in_.values.shared.data() + in_.recording.table.all[static_cast<size_t>(block)].start;
    input.points = &points_[static_cast<size_t>(view.target)];
    input.ids = view.ids.data();
    input.count = static_cast<int>(view.ids.size());
    input.z = view.z.data();
    const SensorModel& model = *rig_.sensors[static_cast<size_t>(view.sensor)].model;
    VectorXd r(input.count * model.rows());
    if (!model.evaluate(input, Columns(), r.data(), nullptr) || !r.allFinite()) return std::nullopt;
    return r;
  }

 private:
  double error(int sample, int joint) const {
    const auto found = in_.values.errors.find({sample, joint});
    return found == in_.values.errors.end() ? 0 : found->second;
  }
  const Sample& sample(int i) const { return in_.recording.samples[static_cast<size_t>(i)]; }

  /// How much of the way the joints have gone.
  double share_of_way(const WaySighting& seen, const std::vector<double>& readings) const {
    const std::vector<double>&a = sample(seen.before).readings, &b = sample(seen.after).readings;
    double along = 0, all = 0;
    for (size_t j = 0; j < readings.size(); ++j) {
      const double way = b[j] - a[j], gone = readings[j] - a[j];
      if (!std::isfinite(way) || !std::isfinite(gone)) continue;
      along += way * gone;
      all += way * way;
    }
    return all > 0 ? std::min(1., std::max(0., along / all)) : 0;
  }

  /// The robot as it was in a sample.
  Pose base_T_hand(int i, int hand) const {
    std::vector<double> readings = sample(i).readings;
    for (size_t j = 0; j < readings.size(); ++j) readings[j] += error(i, static_cast<int>(j));
    readings = completed(std::move(readings));
    return Configuration(rig_, in_.recording.table, in_.values.shared, readings)
        .base_T_sensor(hand);
  }

  int holder(int i, int target) const {
    for (const View& view : sample(i).views)
      if (view.target == target &&
          rig_.sensors[static_cast<size_t>(view.sensor)].model->measurement_kind() ==
              MeasurementKind::chain)
        return view.sensor;
    return -1;
  }

  std::optional<Pose> target_pose(const WaySighting& seen, const Configuration& robot,
                                  double share) const {
    const int target = seen.view.target;
    if (rig_.targets[static_cast<size_t>(target)].link >= 0) return robot.base_T_target(target);
    const auto a = in_.values.targets.find({seen.before, target}),
               b = in_.values.targets.find({seen.after, target});
    if (a == in_.values.targets.end() || b == in_.values.targets.end()) return std::nullopt;
    const int hand = holder(seen.before, target);
    if (hand != holder(seen.after, target)) return std::nullopt;
    if (hand >= 0)
      return robot.base_T_sensor(hand) *
             on_the_way(inverse(base_T_hand(seen.before, hand)) * a->second,
                        inverse(base_T_hand(seen.after, hand)) * b->second, share);
    const Vector6d moved = log_se3(inverse(a->second) * b->second);
    if (moved.head<3>().norm() > kSamePlace || moved.tail<3>().norm() > kSameAngle)
      return std::nullopt;
    return on_the_way(a->second, b->second, share);
  }

  const OffsetInput& in_;
  const Rig& rig_;
  std::vector<Matrix3Xd> points_;
};

double rms(const VectorXd& r) { return r.norm() / std::sqrt(static_cast<double>(r.size())); }

/// What one image says alone.
struct OneOffset {
  int way = 0;
  double time = 0, offset = 0, speed = 0;  // speed: u, px / s
  double weight = 1;                       // w
};

std::vector<OneOffset> one_by_one(const Predictor& predictor,
                                  const std::vector<WaySighting>& sightings, double offset) {
  std::vector<OneOffset> out;
  double squares = 0;
  const auto change = [&](const WaySighting& seen, double by) -> std::optional<VectorXd> {
    const auto later = predictor.residuals(seen, offset + by),
               sooner = predictor.residuals(seen, offset - by);
    if (!later || !sooner) return std::nullopt;
    return (*later - *sooner) / (2 * by);
  };
  for (const WaySighting& seen : sightings) {
    const auto r = predictor.residuals(seen, offset);
    const auto g = change(seen, kDifference), wide = change(seen, kGrid);
    // (The noise of single readings seems to move what stands still, from one to the next.)
    if (!r || !g || !wide || !(rms(*wide) > kLeastSpeed)) continue;
    const double speed = rms(*g);
    out.push_back({seen.before, seen.time, offset - g->dot(*r) / g->squaredNorm(), speed, 1});
    squares += speed * speed;
  }
  const double least = kLeastShare * std::sqrt(squares / static_cast<double>(out.size()));
  out.erase(std::remove_if(out.begin(), out.end(),
                           [&](const OneOffset& one) { return !(one.speed > least); }),
            out.end());
  return out;
}

/// A bounded mean of what the images say.
struct MeanOffset {
  double offset = 0, independent = 0, by_way = 0;  // sigmas of images apart, and of ways
  double information = 0;                          // sum w u^2
  int ways = 0;

  double sigma() const { return std::max(independent, by_way); }
};

MeanOffset bounded_mean(std::vector<OneOffset>& all, double start) {
  MeanOffset out;
  out.offset = start;
  for (int round = 0; round < 20; ++round) {
    std::vector<double> sizes;
    for (const OneOffset& one : all)
      sizes.push_back(std::abs(one.speed * (one.offset - out.offset)));
    const double scale = std::max(1e-6, 1.4826 * median(sizes, 0));
    double sum = 0;
    out.information = 0;
    for (OneOffset& one : all) {
      const double e = std::abs(one.speed * (one.offset - out.offset)) / scale;
      one.weight = e > kHuber ? kHuber / e : 1;
      out.information += one.weight * one.speed * one.speed;
      sum += one.weight * one.speed * one.speed * one.offset;
    }
    if (out.information == 0) return out;
    const double before = out.offset;
    out.offset = sum / out.information;
    if (std::abs(out.offset - before) < 1e-9) break;
  }
  std::map<int, double> scores;
  double squares = 0;
  for (const OneOffset& one : all) {
    const double score = one.weight * one.speed * one.speed * (one.offset - out.offset);
    scores[one.way] += score;
    squares += score * score;
  }
  double by_way = 0;
  for (const auto& [way, score] : scores) by_way += score * score;
  std::map<int, double> informations;
  double information_squares = 0;
  for (const OneOffset& one : all) informations[one.way] += one.weight * one.speed * one.speed;
  for (const auto& [way, information] : informations)
    information_squares += information * information;
  const double n = static_cast<double>(all.size()),
               c = out.information * out.information / information_squares;
  out.ways = static_cast<int>(scores.size());
  out.independent = std::sqrt(squares * n / std::max(1., n - 1)) / out.information;
  out.by_way =
      c > kLeastOfWays ? std::sqrt(by_way * (c + 1) / (c - 1)) / out.information : kInfinity;
  return out;
}

/// How large residuals are with an offset, px, by sighting.
std::vector<double> sizes_at(const Predictor& predictor, const std::vector<WaySighting>& sightings,
                             double offset) {
  std::vector<double> out;
  for (const WaySighting& seen : sightings) {
    const auto r = predictor.residuals(seen, offset);
    out.push_back(r ? rms(*r) : 100);
  }
  return out;
}

double cost_of(const std::vector<double>& sizes, double scale) {
  double cost = 0;
  for (const double size : sizes) cost += std::log1p(size * size / (scale * scale));
  return cost;
}

std::vector<double> grid() {
  std::vector<double> out;
  for (int i = 0; i <= static_cast<int>(2 * kFarthestOffset / kGrid); ++i)
    out.push_back(i * kGrid - kFarthestOffset);
  return out;
}

/// The offset on the grid with which most images agree.
double coarse_offset(const Predictor& predictor, const std::vector<WaySighting>& sightings) {
  double best = 0, least = kInfinity;
  for (const double offset : grid()) {
    const double cost = cost_of(sizes_at(predictor, sightings, offset), 1);
    if (cost < least) least = cost, best = offset;
  }
  return best;
}

/// Offsets on the grid, away from one that was found, that fit nearly as well.
std::vector<double> others_alike(const Predictor& predictor,
                                 const std::vector<WaySighting>& sightings, double found) {
  const std::vector<double> sizes = sizes_at(predictor, sightings, found);
  const double scale = std::max(kLeastScale, 1.4826 * median(sizes, 0));
  std::vector<double> out;
  for (const double offset : grid())
    if (std::abs(offset - found) > 1.5 * kGrid &&
        cost_of(sizes_at(predictor, sightings, offset), scale) < cost_of(sizes, scale) + kAlike)
      out.push_back(offset);
  return out;
}

/// Numbers each sighting of a target that looks alike from several sides as it fits best.
void number(const OffsetInput& input, const Predictor& predictor,
            std::vector<WaySighting>& sightings) {
  for (WaySighting& seen : sightings) {
    const auto open = input.open_turns.find(seen.view.target);
    if (open == input.open_turns.end()) continue;
    const Target& target = input.recording.rig.targets[static_cast<size_t>(seen.view.target)];
    WaySighting best = seen;
    double least = kInfinity;
    for (const int quarters : open->second) {
      static const int cosines[] = {1, 0, -1, 0};
      Eigen::Matrix2d turn;
      turn << cosines[quarters], -cosines[(quarters + 3) % 4], cosines[(quarters + 3) % 4],
          cosines[quarters];
      WaySighting turned = seen;
      const std::vector<int> places = relabeling(target, turn);
      if (places.empty()) continue;
      relabel(turned.view, target, places);
      const auto r = predictor.residuals(turned, 0);
      if (r && rms(*r) < least) least = rms(*r), best = turned;
    }
    seen = best;
  }
}

struct ClockStretch {
  double time = 0, offset = 0, sigma = 0;
};

/// The offset that some sightings agree on, from one near it.
MeanOffset refined(const Predictor& predictor, const std::vector<WaySighting>& sightings,
                   double offset, std::vector<OneOffset>& all) {
  MeanOffset mean;
  for (int round = 0; round < 10; ++round) {
    all = one_by_one(predictor, sightings, offset);
    mean = bounded_mean(all, offset);
    const double step = mean.offset - offset;
    offset = std::min(kFarthestOffset, std::max(-kFarthestOffset, mean.offset));
    if (std::abs(step) < 1e-7) break;
  }
  return mean;
}

/// Offsets of stretches of the recording, each of `least` ways at least: `mean_of` gives that of
/// the images on the ways from a first to a last one. A few ways do not tell their own noise, so
/// that of all stretches, for the information that each has, is taken where it is more; or `floor`
/// (s) where that is given, since stretches in which a clock changes would make all of them bad.
std::vector<ClockStretch> stretches_of(
    const std::vector<OneOffset>& all, size_t least, double floor,
    const std::function<MeanOffset(const std::vector<OneOffset>&, int, int)>& mean_of) {
  std::set<int> ways;
  for (const OneOffset& one : all) ways.insert(one.way);
  const std::vector<int> order(ways.begin(), ways.end());
  const size_t count = std::min(kStretches, order.size() / least);
  std::vector<ClockStretch> out;
  std::vector<double> information;
  double noise = 0, sum = 0;
  for (size_t k = 0; k < count; ++k) {
    const int first = order[k * order.size() / count],
              last = order[(k + 1) * order.size() / count - 1];
    std::vector<OneOffset> some;
    double time = 0;
    for (const OneOffset& one : all)
      if (one.way >= first && one.way <= last) some.push_back(one), time += one.time;
    const MeanOffset mean = mean_of(some, first, last);
    if (mean.information == 0 || !std::isfinite(mean.sigma())) continue;
    out.push_back({time / static_cast<double>(some.size()), mean.offset, mean.sigma()});
    information.push_back(mean.information);
    noise += std::pow(mean.sigma() * mean.information, 2);
    sum += mean.information;
  }
  for (size_t k = 0; k < out.size(); ++k)
    out[k].sigma =
        std::max(out[k].sigma, floor > 0 ? floor : std::sqrt(noise / sum / information[k]));
  return out;
}

/// The same about an offset that they are all near.
std::vector<ClockStretch> near_stretches(const std::vector<OneOffset>& all, double offset) {
  return stretches_of(all, 3, 0, [&](const std::vector<OneOffset>& some, int, int) {
    std::vector<OneOffset> weighed = some;
    return bounded_mean(weighed, offset);
  });
}

/// Sum of squares, in sigmas, about a level of some stretches; the level and its sigma.
double about_level(const std::vector<ClockStretch>& all, size_t first, size_t end, double& level,
                   double& sigma) {
  double sum = 0, weights = 0, squares = 0;
  for (size_t i = first; i < end; ++i) {
    const double w = 1 / (all[i].sigma * all[i].sigma);
    sum += w * all[i].offset;
    weights += w;
  }
  level = sum / weights;
  sigma = 1 / std::sqrt(weights);
  for (size_t i = first; i < end; ++i)
    squares += std::pow((all[i].offset - level) / all[i].sigma, 2);
  return squares;
}

/// Looks for drift and jumps.
void judge_clock(const std::vector<ClockStretch>& all, TimeOffset& out) {
  if (all.size() < 4) return;  // few ways do not tell their own noise
  double level = 0, sigma = 0, w = 0, wt = 0;
  for (const ClockStretch& s : all)
    w += 1 / (s.sigma * s.sigma), wt += s.time / (s.sigma * s.sigma);
  const double middle = wt / w;
  about_level(all, 0, all.size(), level, sigma);
  double tt = 0, ty = 0, line = 0;
  for (const ClockStretch& s : all) {
    const double weight = 1 / (s.sigma * s.sigma);
    tt += weight * (s.time - middle) * (s.time - middle);
    ty += weight * (s.time - middle) * (s.offset - level);
  }
  const double slope = ty / tt, slope_sigma = 1 / std::sqrt(tt);
  for (const ClockStretch& s : all)
    line += std::pow((s.offset - level - slope * (s.time - middle)) / s.sigma, 2);
  const double span = all.back().time - all.front().time;
  double best = kInfinity;
  TimeOffset jumping = out;
  for (size_t at = 2; at + 2 <= all.size(); ++at) {
    double before = 0, after = 0, s1 = 0, s2 = 0;
    const double squares =
        about_level(all, 0, at, before, s1) + about_level(all, at, all.size(), after, s2);
    if (squares >= best) continue;
    best = squares;
    jumping.offset = before;
    jumping.sigma = s1;
    jumping.jump = after - before;
    jumping.jump_sigma = std::hypot(s1, s2);
    jumping.jump_time = (all[at - 1].time + all[at].time) / 2;
  }
  const bool drifts = std::abs(slope) > 4 * slope_sigma && std::abs(slope) * span > kLeastChange;
  const bool jumps = std::abs(jumping.jump) > std::max(kLeastChange, 5 * jumping.jump_sigma) &&
                     best < (drifts ? line - 4 : kInfinity);
  if (jumps) {
    out = jumping;
    out.clock = TimeOffset::Clock::jumps;
  } else if (drifts) {
    out.clock = TimeOffset::Clock::drifts;
    out.drift = slope;
    out.drift_sigma = slope_sigma;
    out.middle = middle;
    out.offset = level;
    // Of the level, if a line explains the stretches.
    out.sigma = sigma * std::sqrt(std::max(1., line / static_cast<double>(all.size() - 2)));
  }
}

/// True if more images than may be wrong are far from what the others say.
bool many_disagree(const std::vector<OneOffset>& all, double offset) {
  const auto far = std::count_if(all.begin(), all.end(), [&](const OneOffset& one) {
    return one.weight < 0.1 || std::abs(one.speed * (one.offset - offset)) > kFar;
  });
  return static_cast<double>(far) > kMostWrong * static_cast<double>(all.size());
}

/// Looks for drift and jumps that are too large for one offset to be near them all.
void judge_far_clock(const Predictor& predictor, const std::vector<WaySighting>& sightings,
                     const std::vector<OneOffset>& all, TimeOffset& out) {
  const auto own = [&](const std::vector<OneOffset>&, int first, int last) {
    std::vector<WaySighting> some;
    for (const WaySighting& seen : sightings)
      if (seen.before >= first && seen.before <= last) some.push_back(seen);
    std::vector<OneOffset> ignored;
    return refined(predictor, some, coarse_offset(predictor, some), ignored);
  };
  judge_clock(stretches_of(all, 2, kFarSigma, own), out);
  const bool drifts = out.clock == TimeOffset::Clock::drifts;
  for (int round = 0; round < 8 && out.clock != TimeOffset::Clock::steady; ++round) {
    std::vector<WaySighting> corrected = sightings;  // what is left is near one offset
    for (WaySighting& seen : corrected) seen.time -= out.at(seen.time) - out.offset;
    std::vector<OneOffset> left;
    const MeanOffset mean = refined(predictor, corrected, out.offset, left);
    double w = 0, wt = 0, tt = 0, ty = 0, squares = 0;
    for (const OneOffset& one : left) {
      const double weight = one.weight * one.speed * one.speed;
      w += weight, wt += weight * one.time;
    }
    for (const OneOffset& one : left) {
      const double weight = one.weight * one.speed * one.speed, t = one.time - wt / w;
      tt += weight * t * t, ty += weight * t * (one.offset - mean.offset), squares += t * t;
    }
    const double slope = drifts && tt > 0 ? ty / tt : 0;
    out.drift += slope;
    out.offset = mean.offset + (drifts ? slope * (out.middle - wt / w) : 0);
    out.sigma = std::hypot(mean.sigma(), kInterpolation);
    if (drifts) out.drift_sigma = out.sigma / std::sqrt(squares / static_cast<double>(left.size()));
    if (many_disagree(left, mean.offset)) out.sigma = kInfinity;
  }
}

}  // namespace

TimeOffset time_offset(const OffsetInput& input, int sensor, std::vector<WaySighting> sightings) {
  TimeOffset out;
  out.sensor = sensor;
  const Predictor predictor(input);
  number(input, predictor, sightings);
  const auto unknown = [&](const WaySighting& seen) { return !predictor.residuals(seen, 0); };
  const size_t before = sightings.size();
  sightings.erase(std::remove_if(sightings.begin(), sightings.end(), unknown), sightings.end());
  std::set<int> ways;
  for (const WaySighting& seen : sightings) ways.insert(seen.before);
  if (static_cast<int>(ways.size()) < kLeastWays) {
    out.why_not = before == 0 ? "it saw nothing while the robot moved"
                              : "its views of the moving robot cover fewer than three moves "
                                "between rests with known targets";
    return out;
  }
  out.misfit = true;  // unless one is found
  const double offset = coarse_offset(predictor, sightings);
  if (std::abs(offset) > kFarthestOffset - kGrid / 2) {
    out.why_not = "the offset is more than 0.4 s, or the readings are not of this robot";
    return out;
  }
  std::vector<OneOffset> all;
  const MeanOffset mean = refined(predictor, sightings, offset, all);
  const bool few = mean.ways < kLeastWays;
  const double found = few ? offset : mean.offset;
  std::vector<double> others;
  if (few || !many_disagree(all, found)) others = others_alike(predictor, sightings, found);
  if (!others.empty()) {
    char text[200];
    std::snprintf(text, sizeof text,
                  "its images during moves fit offsets from %.0f to %.0f ms equally well: take "
                  "some in the middle of the motion (more images per second, slower moves)",
                  1e3 * std::min(found, others.front()), 1e3 * std::max(found, others.back()));
    out.why_not = text;
    return out;
  }
  if (few) {
    out.why_not = "its targets hardly moved in the images";
    return out;
  }
  out.offset = mean.offset;
  out.sigma = std::hypot(mean.sigma(), kInterpolation);
  out.images = static_cast<int>(all.size());
  out.ways = mean.ways;
  if (out.sigma <= kUnclear && !many_disagree(all, mean.offset)) {
    judge_clock(near_stretches(all, mean.offset), out);
    out.misfit = false;
    return out;
  }
  judge_far_clock(predictor, sightings, all, out);
  out.misfit = out.clock == TimeOffset::Clock::steady || out.sigma > kClear;
  if (!out.misfit) return out;
  out.clock = TimeOffset::Clock::steady;
  char text[240];
  std::snprintf(text, sizeof text,
                "the motion does not fit one offset within 0.4 s (the best: %.0f +- %.0f ms): the "
                "clock drifts or jumps, or is further off, or the readings are not of this robot",
                1e3 * mean.offset, 1e3 * std::max(mean.sigma(), kUnclear));
  out.why_not = text;
  return out;
}

}  // namespace kincal
