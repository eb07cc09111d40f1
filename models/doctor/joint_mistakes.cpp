#include "joint_mistakes.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <set>

#include "../../kinematics/floating.h"
#include "../rig/numbers.h"
#include "../rig/samples.h"
#include "../rig/words.h"
#include "reading_mistakes.h"

namespace kincal {

void add_joints(const Rig& rig, const std::vector<Sample>& samples,
                const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  std::vector<int> too_far;
  for (const auto& range : observations.ranges) {
    const int j = range.first;
    const Joint& joint = rig.tree.joints[j];
    const double low = range.second.first, high = range.second.second;
    if (high - low > 1e-9) {
      out.push_back(wrong_signs(rig, {j}));
    } else if (samples.size() > 1) {
      out.push_back(
          {NoticeKind::still_joint,
           {Subject::joint(joint.name)},
           "joint " + quoted(joint.name) + " has the same reading in all samples, but it moved",
           "record its readings: the recorded value is constant"});
      out.back().ignored_joint = j;
    }
    if (joint.type == JointType::prismatic) continue;
    const double most = std::max(std::abs(low), std::abs(high));
    const bool limited = joint.type == JointType::revolute && joint.upper > joint.lower;
    const double reach = limited ? std::max(std::abs(joint.lower), std::abs(joint.upper)) : 2 * kPi;
    if (most > 2 * kPi + 0.1 || most > reach + 1) too_far.push_back(j);
  }
  if (too_far.empty()) return;
  std::vector<int> turning;
  for (const auto& range : observations.ranges)
    if (rig.tree.joints[range.first].type != JointType::prismatic) turning.push_back(range.first);
  std::vector<std::vector<int>> groups = {turning};
  if (too_far.size() < turning.size()) groups.push_back(too_far);
  if (too_far.size() > 1)
    for (int j : too_far) groups.push_back({j});
  for (const std::vector<int>& group : groups) {
    Hypothesis h{NoticeKind::degrees};
    for (int j : group) h.where.push_back(Subject::joint(rig.tree.joints[j].name));
    std::string names;
    for (const std::string& name : names_of(h.where))
      names += (names.empty() ? "" : ", ") + quoted(name);
    h.mistake = std::string("the readings of joint") + (group.size() > 1 ? "s " : " ") + names +
                " are degrees";
    h.cure = "write radians: multiply them by pi / 180";
    h.undo = of_readings(group, [](double q) { return q * kPi / 180; });
    out.push_back(h);
  }
}

// ------------------------------------------------------------------------------------------------
// readings and views of other samples
namespace {

/// A sample has at least this share of the views that it had, or a hypothesis is none.
constexpr double kKept = 0.8;
constexpr size_t kFewest = 4;          // samples to be shifted
constexpr double kOneMotion = 0.5;     // of second to first differences, squared: one motion
constexpr double kShortestLag = 0.01;  // of the time between samples

const char* const kEverySample = "the views of every sample";
const char* const kPairAgain =
    "pair readings and views of the same time: one of the two logs starts a sample too early or "
    "too "
    "late";

using ReadingsOf = std::map<std::string, std::vector<double>>;  // by sample

/// The number at the end of a sample's id, of its name without an extension ("img_12.png"); -1:
/// none.
long number_of(const std::string& id) {
  const size_t dot = id.rfind('.'), last = id.find_last_of("0123456789", dot);
  if (last == std::string::npos) return -1;
  const size_t before = id.find_last_not_of("0123456789", last);
  const size_t first = before == std::string::npos ? 0 : before + 1;
  return last - first < 9 ? std::stol(id.substr(first, last - first + 1)) : -1;
}

/// The numbers of all ids in logged order; empty where they do not grow.
std::vector<long> growing_numbers(const std::vector<Sample>& samples,
                                  const std::vector<int>& order) {
  std::vector<long> out;
  for (const int i : order) {
    const long number = number_of(samples[i].id);
    if (number < 0 || (!out.empty() && number <= out.back())) return {};
    out.push_back(number);
  }
  return out;
}

/// Readings moved by a share of the way to those of the sample after (or before) it.
ReadingsOf moved_by_share(const std::vector<Sample>& samples, const std::vector<int>& order, int by,
                          double share) {
  ReadingsOf out;
  for (size_t i = 0; i < order.size(); ++i) {
    const size_t other = i + static_cast<size_t>(by);  // wraps below 0: none
    if (other >= order.size()) continue;
    std::vector<double>& now = out[samples[order[i]].id] = samples[order[other]].readings;
    for (size_t j = 0; share < 1 && j < now.size(); ++j)
      now[j] = samples[order[i]].readings[j] + share * (now[j] - samples[order[i]].readings[j]);
  }
  return out;
}

/// Whether these are readings of all that places a view.
bool readings_place(const Rig& rig, const View& view, const std::vector<double>& readings) {
  const Target& target = rig.targets[view.target];
  const Sensor& sensor = rig.sensors[view.sensor];
  for (int j : joints_between(rig, sensor.link, target.link < 0 ? rig.base : target.link,
                              sensor.scanning_joint))
    if (!std::isfinite(readings[j])) return false;
  return true;
}

bool same_readings(const std::vector<double>& a, const std::vector<double>& b) {
  for (size_t j = 0; j < a.size(); ++j)
    if (std::isfinite(a[j]) && std::isfinite(b[j]) && std::abs(a[j] - b[j]) > 1e-6) return false;
  return true;
}

/// Gives samples other readings; those that have none, and views that miss a joint then, go.
void replace_readings(const Rig& rig, const ReadingsOf& readings, std::vector<Sample>& samples) {
  std::vector<Sample> kept;
  for (Sample& s : samples) {
    const auto found = readings.find(s.id);
    if (found == readings.end()) continue;
    s.readings = found->second;
    s.views.erase(
        std::remove_if(s.views.begin(), s.views.end(),
                       [&](const View& v) { return !readings_place(rig, v, s.readings); }),
        s.views.end());
    if (!s.views.empty()) kept.push_back(std::move(s));
  }
  samples = std::move(kept);
}

size_t count_views(const std::vector<Sample>& samples) {
  size_t out = 0;
  for (const Sample& s : samples) out += s.views.size();
  return out;
}

/// Whether nearly all views are left with other readings.
bool keeps_views(const Rig& rig, const std::vector<Sample>& samples, const ReadingsOf& readings) {
  std::vector<Sample> changed = samples;
  replace_readings(rig, readings, changed);
  return changed.size() >= kFewest && static_cast<double>(count_views(changed)) >=
                                          kKept * static_cast<double>(count_views(samples));
}

/// An Undo that gives samples other readings.
Undo of_other_readings(ReadingsOf readings) {
  return [readings = std::make_shared<ReadingsOf>(std::move(readings))](
             Rig& r, std::vector<Sample>& changed) { replace_readings(r, *readings, changed); };
}

Hypothesis shifted(int by, Subjects where, const std::string& what, const std::string& cure,
                   Undo undo) {
  Hypothesis h{
      NoticeKind::shifted, std::move(where),
      what + " belong to the joint readings of the sample " + (by > 0 ? "after it" : "before it"),
      cure, std::move(undo)};
  h.many = true;
  return h;
}

/// The views of one sensor, by the sample to whose readings they belong.
using ViewsOf = std::map<std::string, std::vector<View>>;

void add_shift_of(int sensor, int by, const Rig& rig, const std::vector<Sample>& samples,
                  const std::vector<int>& order, std::vector<Hypothesis>& out) {
  auto views = std::make_shared<ViewsOf>();
  size_t all = 0, kept = 0;
  for (size_t i = 0; i < order.size(); ++i)
    for (const View& v : samples[order[i]].views) {
      if (v.sensor != sensor) continue;
      ++all;
      const size_t other = i + static_cast<size_t>(by);  // wraps below 0: none
      if (other >= order.size() || !readings_place(rig, v, samples[order[other]].readings))
        continue;
      (*views)[samples[order[other]].id].push_back(v);
      ++kept;
    }
  if (kept < kFewest || static_cast<double>(kept) < kKept * static_cast<double>(all)) return;
  out.push_back(shifted(
      by, {Subject::sensor(rig.sensors[sensor].name)},
      "the views of sensor " + quoted(rig.sensors[sensor].name),
      "Pair its views with the readings of their own time: its log starts a sample too early or "
      "too late",
      [sensor, views](Rig&, std::vector<Sample>& changed) {
        for (Sample& s : changed) {
          s.views.erase(std::remove_if(s.views.begin(), s.views.end(),
                                       [&](const View& v) { return v.sensor == sensor; }),
                        s.views.end());
          const auto found = views->find(s.id);
          if (found != views->end())
            s.views.insert(s.views.end(), found->second.begin(), found->second.end());
        }
      }));
}

/// Of samples whose numbers have gaps, where pictures were lost: readings of the next number, or
/// the one before; those that have no such neighbour are left out.
void add_shifts_by_number(const Rig& rig, const std::vector<Sample>& samples,
                          const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  const std::vector<int> order = logged_order(samples);
  const std::vector<long> numbers = growing_numbers(samples, order);
  if (numbers.size() <= kFewest ||
      numbers.back() - numbers.front() + 1 == static_cast<long>(numbers.size()))
    return;
  for (const int by : {1, -1}) {
    ReadingsOf readings;
    for (size_t i = 0; i < order.size(); ++i) {
      const size_t other = i + static_cast<size_t>(by);  // wraps below 0: none
      if (other < order.size() && numbers[other] == numbers[i] + by)
        readings[samples[order[i]].id] = samples[order[other]].readings;
    }
    if (readings.size() < kFewest) continue;
    out.push_back(shifted(by, all_sensors(rig, observations.sensors), kEverySample,
                          std::string(kPairAgain) +
                              " (seen by the numbers in the samples' ids; those whose neighbour "
                              "is missing were left out)",
                          of_other_readings(std::move(readings))));
    out.back().leaves_out = true;
  }
}

}  // namespace

void add_shifts(const Rig& rig, const std::vector<Sample>& samples,
                const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  const std::vector<int> order = logged_order(samples);
  if (order.size() <= kFewest) return;
  add_shifts_by_number(rig, samples, observations, out);
  for (int by : {1, -1}) {
    const ReadingsOf readings = moved_by_share(samples, order, by, 1);
    if (std::all_of(samples.begin(), samples.end(), [&](const Sample& s) {
          const auto found = readings.find(s.id);
          return found == readings.end() || same_readings(s.readings, found->second);
        }))
      return;
    if (keeps_views(rig, samples, readings))
      out.push_back(shifted(by, all_sensors(rig, observations.sensors), kEverySample, kPairAgain,
                            of_other_readings(readings)));
    for (int s : observations.sensors)
      if (observations.sensors.size() > 1 &&
          rig.sensors[s].model->measurement_kind() != MeasurementKind::chain)
        add_shift_of(s, by, rig, samples, order, out);
  }
}

// ------------------------------------------------------------------------------------------------
// rows in another order
namespace {

/// Where each of these numbers stands when they are sorted as texts: 1, 10, 11, 2.
std::vector<size_t> sorted_as_texts(const std::vector<long>& numbers) {
  std::vector<size_t> out(numbers.size());
  for (size_t i = 0; i < out.size(); ++i) out[i] = i;
  std::stable_sort(out.begin(), out.end(), [&](size_t a, size_t b) {
    return std::to_string(numbers[a]) < std::to_string(numbers[b]);
  });
  return out;
}

/// Orders in which two lists that belong together may stand to each other: the readings of row i
/// belong to the views of row order[i].
std::vector<std::pair<std::string, std::vector<size_t>>> other_orders(
    const std::vector<Sample>& samples, const std::vector<int>& order) {
  const size_t n = order.size();
  std::vector<size_t> as_it_is(n), reversed(n);
  for (size_t i = 0; i < n; ++i) as_it_is[i] = i, reversed[i] = n - 1 - i;
  std::vector<std::pair<std::string, std::vector<size_t>>> out;
  out.emplace_back("one of the two is in reversed order", reversed);
  const auto add = [&](const std::vector<size_t>& rows, const std::string& how) {
    std::vector<size_t> back(n);
    for (size_t i = 0; i < n; ++i) back[rows[i]] = i;
    for (const auto& one : {rows, back})
      if (one != as_it_is &&
          std::none_of(out.begin(), out.end(), [&](const auto& o) { return o.second == one; }))
        out.emplace_back(how, one);
  };
  const std::string texts = "one of the two is sorted by digits (1, 10, 11, 2)";
  std::vector<size_t> by_number = as_it_is;
  std::stable_sort(by_number.begin(), by_number.end(), [&](size_t a, size_t b) {
    return number_of(samples[order[a]].id) < number_of(samples[order[b]].id);
  });
  add(by_number, texts);
  std::vector<std::vector<long>> numberings = {growing_numbers(samples, order)};
  for (const long first : {0, 1}) {
    numberings.emplace_back();
    for (size_t i = 0; i < n; ++i) numberings.back().push_back(first + static_cast<long>(i));
  }
  for (const std::vector<long>& numbers : numberings)
    if (!numbers.empty()) add(sorted_as_texts(numbers), texts);
  return out;
}

}  // namespace

void add_orders_of_rows(const Rig& rig, const std::vector<Sample>& samples,
                        const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  const std::vector<int> order = logged_order(samples);
  if (order.size() <= kFewest) return;
  for (const auto& [how, rows] : other_orders(samples, order)) {
    ReadingsOf readings;
    for (size_t i = 0; i < order.size(); ++i)
      readings[samples[order[rows[i]]].id] = samples[order[i]].readings;
    if (!keeps_views(rig, samples, readings)) continue;
    out.push_back({NoticeKind::shifted, all_sensors(rig, observations.sensors),
                   "readings and views are paired in the wrong order: " + how,
                   "pair readings and views by their names or times, not by their place in a list",
                   of_other_readings(std::move(readings))});
  }
  for (const auto& range : observations.ranges) {
    const int joint = range.first;
    if (!(range.second.second > range.second.first)) continue;
    ReadingsOf readings;
    for (size_t i = 0; i + 1 < order.size(); ++i) {
      std::vector<double>& one = readings[samples[order[i]].id] = samples[order[i]].readings;
      one[joint] = samples[order[i + 1]].readings[joint];
    }
    if (!keeps_views(rig, samples, readings)) continue;
    const std::string& name = rig.tree.joints[joint].name;
    out.push_back(
        {NoticeKind::shifted,
         {Subject::joint(name)},
         "the readings of joint " + quoted(name) + " are those of the sample before",
         "log all joints at the time of the views: this one's readings are a sample too old",
         of_other_readings(std::move(readings))});
  }
}

// ------------------------------------------------------------------------------------------------
// a lag in time
namespace {

/// A LoggedMotion is what the samples show of the robot's movement.
struct LoggedMotion {
  std::vector<std::string> ids;
  std::vector<double> times;                  // ascending
  std::vector<std::vector<double>> readings;  // by sample and joint
  bool stamped = false;

  double step() const {
    return (times.back() - times.front()) / static_cast<double>(times.size() - 1);
  }
  /// Readings `lag` later, between the samples by cubics; what lies outside is left out.
  ReadingsOf later(double lag) const;
};

ReadingsOf LoggedMotion::later(double lag) const {
  ReadingsOf out;
  const size_t n = times.size();
  for (size_t i = 0; i < n; ++i) {
    const double t = times[i] + lag;
    if (t < times.front() || t > times.back()) continue;
    const size_t above =
        static_cast<size_t>(std::upper_bound(times.begin(), times.end() - 1, t) - times.begin());
    const size_t b = std::max<size_t>(1, above), a = b - 1;
    const double h = times[b] - times[a], x = (t - times[a]) / h;
    std::vector<double> now(readings[i].size());
    for (size_t j = 0; j < now.size(); ++j) {
      const auto slope = [&](size_t k) {
        const size_t low = k > 0 ? k - 1 : k, high = std::min(k + 1, n - 1);
        return (readings[high][j] - readings[low][j]) / (times[high] - times[low]);
      };
      const double qa = readings[a][j], qb = readings[b][j], y = 1 - x;
      now[j] = (1 + 2 * x) * y * y * qa + x * x * (3 - 2 * x) * qb +
               h * x * y * (y * slope(a) - x * slope(b));
    }
    out[ids[i]] = std::move(now);
  }
  return out;
}

/// The motion that the samples are of; nothing where they are single postures.
std::optional<LoggedMotion> steady_motion(const std::vector<Sample>& samples) {
  LoggedMotion out;
  const std::vector<int> order = logged_order(samples);
  if (order.size() < 3 * kFewest) return std::nullopt;
  out.stamped = samples[0].time && *samples[order.front()].time < *samples[order.back()].time;
  for (int i : order) {
    const double t = out.stamped ? *samples[i].time : static_cast<double>(out.times.size());
    if (!out.times.empty() && !(t > out.times.back())) return std::nullopt;
    out.times.push_back(t);
    out.ids.push_back(samples[i].id);
    out.readings.push_back(samples[i].readings);
  }
  double first = 0, second = 0;
  for (size_t i = 1; i + 1 < order.size(); ++i)
    for (size_t j = 0; j < out.readings[i].size(); ++j) {
      const double before = out.readings[i - 1][j], after = out.readings[i + 1][j],
                   bend = before + after - 2 * out.readings[i][j];
      if (!std::isfinite(bend)) continue;
      first += (after - before) * (after - before);
      second += bend * bend;
    }
  if (!(second < kOneMotion * first)) return std::nullopt;
  return out;
}

/// What a fit of samples with other readings leaves.
double score_with(const Recording& recording, const TrialContext& context,
                  std::vector<Sample> samples, const ReadingsOf& readings) {
  replace_readings(recording.rig, readings, samples);
  if (samples.size() < kFewest) return kInfinity;
  return best_fit(recording.with_samples(std::move(samples)), context, context.all, {40, 1e-7})
      .score();
}

/// Where a function is least near 0, and whether it is clearly lower there.
struct Least {
  double at = 0, value = 0;
  bool lower = false;
};

/// The best of three, and where their parabola has its least, again and again nearer.
Least find_least(const std::function<double(double)>& chi2, const std::vector<double>& steps,
                 double most) {
  Least out{0, chi2(0), false};
  const double at_first = out.value;
  for (const double h : steps) {
    const double middle = out.at, before = chi2(middle - h), after = chi2(middle + h),
                 bend = before + after - 2 * out.value;
    if (!std::isfinite(bend)) return out;
    const double to_least = bend > 0 ? 0.5 * h * (before - after) / bend : 0,
                 next = std::clamp(middle + std::clamp(to_least, -3 * h, 3 * h), -most, most);
    for (const auto& [at, there] :
         {std::pair(middle - h, before), std::pair(middle + h, after), std::pair(next, chi2(next))})
      if (there < out.value) out.at = at, out.value = there;
  }
  out.lower = out.value < 0.8 * at_first;
  return out;
}

/// Readings of another moment than the views; nothing: too few views have such.
std::optional<Hypothesis> lag_of(const Recording& recording, ReadingsOf readings,
                                 std::string mistake, std::string cure) {
  if (!keeps_views(recording.rig, recording.samples, readings)) return std::nullopt;
  return Hypothesis{NoticeKind::lag,
                    {{Subject::Kind::part, "joints"}},
                    std::move(mistake),
                    std::move(cure),
                    of_other_readings(std::move(readings))};
}

}  // namespace

std::optional<Hypothesis> time_lag(const Recording& recording, const TrialContext& context) {
  std::optional<LoggedMotion> motion = steady_motion(recording.samples);
  if (!motion) return std::nullopt;
  const std::vector<Sample> some = some_samples(recording, context.all.free.size());
  const double step = motion->step();
  // At the ends there is nothing to interpolate: the same samples are compared.
  const ReadingsOf early = motion->later(-2 * step), late = motion->later(2 * step);
  const auto chi2 = [&](double lag) {
    ReadingsOf readings = motion->later(lag);
    for (const std::string& id : motion->ids)
      if (!early.count(id) || !late.count(id)) readings.erase(id);
    return score_with(recording, context, some, readings);
  };
  const Least found =
      find_least(chi2, {0.5 * step, 0.2 * step, 0.1 * step, 0.04 * step, 0.01 * step}, 2 * step);
  const double lag = found.at;
  if (!found.lower || std::abs(lag) < kShortestLag * step) return std::nullopt;
  return lag_of(
      recording, motion->later(lag),
      std::string("the joint readings are ") + (lag > 0 ? "older" : "newer") +
          " than the views of their sample, by " +
          (motion->stamped ? text("%.4g s", std::abs(lag))
                           : text("%.3g of the time from sample to sample", std::abs(lag))),
      "take samples while the robot stands still, or take the readings at the time of "
      "the views");
}

// ------------------------------------------------------------------------------------------------
// a robot that has not come to rest
namespace {

constexpr size_t kAllSamples = 60;  // so many are all used
constexpr double kLargestShare = 0.3, kSmallestShare = 0.001, kFirstShare = 0.1;

}  // namespace

std::optional<Hypothesis> unfinished_move(const Recording& recording, const TrialContext& context) {
  const std::vector<Sample>& all = recording.samples;
  const std::vector<int> order = logged_order(all);
  if (order.size() < 3 * kFewest) return std::nullopt;
  // (A view tells six numbers, however many its points are: a few samples would not do.)
  const std::vector<Sample> some =
      all.size() <= kAllSamples ? all : some_samples(recording, 16 * context.all.free.size());
  Least best;
  int neighbour = 0;
  for (const int by : {1, -1}) {
    const auto chi2 = [&](double share) {
      return score_with(recording, context, some, moved_by_share(all, order, by, share));
    };
    const Least found =
        find_least(chi2, {kFirstShare, kFirstShare / 5, kFirstShare / 25}, kLargestShare);
    if (found.lower && std::abs(found.at) > kSmallestShare &&
        (neighbour == 0 || found.value < best.value))
      best = found, neighbour = by;
  }
  if (neighbour == 0) return std::nullopt;
  return lag_of(recording, moved_by_share(all, order, neighbour, best.at),
                std::string("the robot moved between readings and views: they differ by ") +
                    text("%.2g %% of the way ", 100 * std::abs(best.at)) +
                    (neighbour > 0 ? "to the posture of the sample after it"
                                   : "from the posture of the sample before it"),
                "take readings and views at one time, after the robot has come to rest");
}

}  // namespace kincal
