#include "settled_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "../../models/rig/numbers.h"

namespace kincal {
namespace {

constexpr double kStillFrames = 3;    // in scatters
constexpr double kHarmless = 1. / 3;  // of the rig's sigma

/// Calls f(i, j) for the places of all ids that two frames have in common.
template <class F>
void for_common(const std::vector<int>& a, const std::vector<int>& b, const F& f) {
  for (size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    if (a[i] == b[j])
      f(i++, j++);
    else if (a[i] < b[j])
      ++i;
    else
      ++j;
  }
}

/// The mean square over coordinates of how two frames differ; NaN: they have nothing in common.
double mean_square(const CornerFrame& a, const CornerFrame& b) {
  Mean mean;
  for_common(a.ids, b.ids, [&](size_t i, size_t j) {
    for (size_t k = 0; k < 2; ++k) {
      const double d = a.pixels[2 * i + k] - b.pixels[2 * j + k];
      mean.sum += d * d;
      ++mean.count;
    }
  });
  return mean.count ? mean.value() : kNan;
}

using Coordinates = std::map<int, std::array<std::vector<double>, 2>>;  // by id

Coordinates coordinates_of(const std::vector<const CornerFrame*>& frames) {
  Coordinates out;
  for (const CornerFrame* frame : frames)
    for (size_t i = 0; i < frame->ids.size(); ++i)
      for (size_t k = 0; k < 2; ++k) out[frame->ids[i]][k].push_back(frame->pixels[2 * i + k]);
  return out;
}

/// The corners in the middle of some frames.
CornerFrame median_corners(const std::vector<CornerFrame>& frames, size_t first, size_t end) {
  std::vector<const CornerFrame*> some;
  for (size_t i = first; i < end; ++i) some.push_back(&frames[i]);
  CornerFrame out;
  for (const auto& [id, values] : coordinates_of(some)) {
    out.ids.push_back(id);
    for (const std::vector<double>& one : values) out.pixels.push_back(median(one));
  }
  return out;
}

}  // namespace

double frame_tolerance(double given, double usual, double own, double sigma) {
  if (!std::isnan(given)) return given;
  return std::max(kStillFrames * std::min(std::max(usual, own), 3 * usual), kHarmless * sigma);
}

double corner_scatter(const std::vector<std::vector<CornerFrame>>& rests, double quantile) {
  std::vector<double> squares;
  for (const std::vector<CornerFrame>& frames : rests)
    for (size_t i = 1; i < frames.size(); ++i) {
      const double square = mean_square(frames[i - 1], frames[i]);
      if (std::isfinite(square)) squares.push_back(square / 2);
    }
  if (squares.empty()) return 0;
  const auto smaller = static_cast<size_t>(quantile * static_cast<double>(squares.size()));
  return std::sqrt(nth_smallest(std::move(squares), smaller));
}

Intervals still_frames(const std::vector<CornerFrame>& frames, double tolerance,
                       double longest_gap) {
  struct Run {
    size_t first, last;
  };
  std::vector<Run> runs;
  for (size_t first = 0; first < frames.size(); ++first) {
    size_t last = first;
    while (last + 1 < frames.size() && frames[last + 1].time - frames[last].time <= longest_gap &&
           mean_square(frames[last + 1], frames[first]) <= 2 * tolerance * tolerance)
      ++last;
    if (last > first) runs.push_back({first, last});
  }
  const auto length = [&](const Run& r) { return frames[r.last].time - frames[r.first].time; };
  std::stable_sort(runs.begin(), runs.end(),
                   [&](const Run& a, const Run& b) { return length(a) > length(b); });
  std::vector<char> used(frames.size(), 0);
  Intervals out;
  for (Run run : runs) {
    while (run.first <= run.last && used[run.first]) ++run.first;
    while (run.last > run.first && used[run.last]) --run.last;
    if (run.first >= run.last) continue;
    for (size_t i = run.first; i <= run.last; ++i) used[i] = 1;
    out.push_back({frames[run.first].time, frames[run.last].time});
  }
  std::sort(out.begin(), out.end(),
            [](const TimeInterval& a, const TimeInterval& b) { return a.begin < b.begin; });
  return out;
}

ViewRest view_rest(const std::vector<CornerFrame>& frames, double tolerance) {
  ViewRest best;
  const auto worst_of = [&](size_t first, size_t end) {
    const CornerFrame middle = median_corners(frames, first, end);
    double worst = 0;
    for (size_t i = first; i < end; ++i) {
      const double square = mean_square(frames[i], middle);
      worst = std::max(worst, std::isfinite(square) ? std::sqrt(square) : kInfinity);
    }
    return worst;
  };
  if (frames.empty()) return best;
  best.motion = worst_of(0, frames.size());
  for (size_t length = frames.size(); length > best.frames; --length)  // few frames, so simply all
    for (size_t first = 0; first + length <= frames.size(); ++first)
      if (worst_of(first, first + length) <= tolerance) {
        best.frames = length;
        best.still = {frames[first].time, frames[first + length - 1].time};
        break;
      }
  return best;
}

double SettledCorners::sigma(double sigma) const {
  return std::sqrt(sigma * sigma + floor * floor +
                   (scatter_known && frames > 0 ? scatter * scatter / frames : 0));
}

SettledCorners average_corners(const std::vector<CornerFrame>& frames, const TimeInterval& over) {
  std::vector<const CornerFrame*> inside;
  for (const CornerFrame& frame : frames)
    if (over.contains(frame.time)) inside.push_back(&frame);
  SettledCorners out;
  for (const CornerFrame* frame : inside)
    out.floor += frame->floor * frame->floor / static_cast<double>(inside.size());
  out.floor = std::sqrt(out.floor);
  const Coordinates all = coordinates_of(inside);
  std::vector<double> deviations;  // from the medians
  for (const auto& [id, values] : all)
    for (const std::vector<double>& one : values) {
      const double middle = median(one);
      if (one.size() > 2)
        for (const double value : one) deviations.push_back(std::abs(value - middle));
    }
  const double far = 6 * 1.4826 * median(deviations, kInfinity) + 0.01;
  double squares = 0, degrees = 0, counted = 0;
  for (const auto& [id, values] : all) {
    if (2 * values[0].size() < inside.size()) continue;
    out.ids.push_back(id);
    for (const std::vector<double>& one : values) {
      const double middle = median(one);
      Mean mean;
      for (const double value : one)
        if (!(std::abs(value - middle) > far)) mean.sum += value, ++mean.count;
      for (const double value : one)
        if (!(std::abs(value - middle) > far))
          squares += (value - mean.value()) * (value - mean.value());
      degrees += static_cast<double>(mean.count - 1);
      counted += static_cast<double>(mean.count);
      out.pixels.push_back(mean.value());
    }
  }
  if (!out.ids.empty()) out.frames = counted / (2 * static_cast<double>(out.ids.size()));
  out.scatter_known = degrees > 0;
  if (out.scatter_known) out.scatter = std::sqrt(squares / degrees);
  return out;
}

}  // namespace kincal
