#include "held_out.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "../rig/distributions.h"

namespace kincal {
namespace {

/// The factor between a root mean square, or a ratio of two, and the ends of its interval; theta is
/// twice its logarithm without each block. Infinite: one block is nearly all of it, and the scatter
/// over blocks means nothing.
double interval_factor(const std::vector<double>& theta) {
  const auto m = static_cast<double>(theta.size());
  double mean = 0, variance = 0;
  for (double t : theta) mean += t / m;
  for (double t : theta) variance += (t - mean) * (t - mean);
  const double error = std::sqrt(variance * (m - 1) / m),
               factor = std::exp(student_quantile(0.025, m - 1) * error / 2);
  return factor > 10 ? INFINITY : factor;
}

}  // namespace

Interval rms_interval(const std::vector<double>& squares, const std::vector<long>& points) {
  const size_t m = squares.size();
  double sum = 0;
  long count = 0;
  for (size_t i = 0; i < m; ++i) sum += squares[i], count += points[i];
  if (m < 3) return {};
  if (sum == 0) return {0, 0};
  std::vector<double> theta;
  for (size_t i = 0; i < m; ++i) {
    const double left = sum - squares[i];
    if (!(left > 0) || count == points[i]) return {};  // all of it in one block
    theta.push_back(std::log(left / static_cast<double>(count - points[i])));
  }
  const double rms = std::sqrt(sum / static_cast<double>(count)), factor = interval_factor(theta);
  if (!std::isfinite(factor)) return {};
  return {rms / factor, rms * factor};
}

Interval rms_ratio_interval(const std::vector<double>& squares, const std::vector<double>& others) {
  double sum = 0, other = 0;
  for (size_t i = 0; i < squares.size(); ++i) sum += squares[i], other += others[i];
  if (squares.size() < 3) return {};
  std::vector<double> theta;
  for (size_t i = 0; i < squares.size(); ++i) {
    if (!(sum > squares[i]) || !(other > others[i])) return {};
    theta.push_back(std::log((sum - squares[i]) / (other - others[i])));
  }
  const double ratio = std::sqrt(sum / other), factor = interval_factor(theta);
  if (!std::isfinite(factor)) return {};
  return {ratio / factor, ratio * factor};
}

namespace {

/// Appends the length of each point's residual; of a pose, of its translation.
void add_lengths(const VectorXd& raw, Eigen::Index rows, bool pose, std::vector<double>& to) {
  for (Eigen::Index at = 0; at < raw.size(); at += rows)
    to.push_back(raw.segment(at, pose ? 3 : rows).norm());
}

}  // namespace

void HeldOutSums::add(const Recording& recording, const Residuals& residuals,
                      const std::vector<int>& index) {
  const Rig& rig = recording.rig;
  for (const Sample& s : recording.samples)
    if (!s.train)
      for (const View& v : s.views) ++missing[v.sensor];
  for (bool read : {false, true})
    for (const ViewResiduals& r : read ? residuals.as_read : residuals.after) {
      if (recording.samples[r.sample].train) continue;
      BlockSums& sums = all[{r.view->sensor, index[r.sample]}];
      const bool whole = rig.sensors[r.view->sensor].model->measures_pose();
      const double squared = whole ? r.raw.head<3>().squaredNorm() : r.raw.squaredNorm();
      const double rotation = whole ? r.raw.tail<3>().squaredNorm() : 0;
      add_lengths(r.raw, whole ? 6 : rig.sensors[r.view->sensor].model->rows(), whole,
                  (read ? lengths_as_read : lengths)[r.view->sensor]);
      (read ? sums.as_read : sums.squared) += squared;
      (read ? sums.rotation_as_read : sums.rotation) += rotation;
      if (read) {
        sums.points += whole ? 1 : r.raw.size() / rig.sensors[r.view->sensor].model->rows();
        --missing[r.view->sensor];
      }
    }
}

std::vector<HeldOutError> held_out_errors(const Rig& rig, const Blocks& blocks,
                                          const HeldOutSums& held_out) {
  std::vector<HeldOutError> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const auto missing = held_out.missing.find(static_cast<int>(s));
    if (missing == held_out.missing.end()) continue;
    HeldOutError e;
    e.sensor = rig.sensors[s].name;
    e.unit = rig.sensors[s].model->unit();
    e.measures_pose = rig.sensors[s].model->measures_pose();
    e.missing = missing->second;
    std::map<int, BlockSums> by_block, by_sample;
    BlockSums total;
    const auto add = [](BlockSums& to, const BlockSums& more) {
      to.points += more.points;
      to.squared += more.squared;
      to.as_read += more.as_read;
      to.rotation += more.rotation;
      to.rotation_as_read += more.rotation_as_read;
    };
    for (const auto& entry : held_out.all) {
      if (entry.first.first != static_cast<int>(s)) continue;
      const int block = blocks.of[entry.first.second];
      e.by_target = e.by_target || blocks.target[block];
      add(by_block[block], entry.second);
      add(by_sample[entry.first.second], entry.second);
      add(total, entry.second);
    }
    if (by_block.size() < 3) e.by_target = false;
    const std::map<int, BlockSums>& parts =
        e.by_target || by_block.size() >= 3 ? by_block : by_sample;
    e.points = total.points;
    e.blocks = static_cast<long>(parts.size());
    const auto judge = [&](double BlockSums::*squares, double& rms, Interval& interval) {
      rms = total.points ? std::sqrt(total.*squares / static_cast<double>(total.points)) : kNan;
      std::vector<double> values;
      std::vector<long> points;
      for (const auto& part : parts) {
        values.push_back(part.second.*squares);
        points.push_back(part.second.points);
      }
      interval = rms_interval(values, points);
    };
    judge(&BlockSums::squared, e.rms, e.of_rms);
    judge(&BlockSums::as_read, e.rms_as_read, e.of_rms_as_read);
    const auto median_of = [&](const std::map<int, std::vector<double>>& by_sensor) {
      const auto found = by_sensor.find(static_cast<int>(s));
      return found == by_sensor.end() ? kNan : median(found->second);
    };
    e.median = median_of(held_out.lengths);
    e.median_as_read = median_of(held_out.lengths_as_read);
    e.rotation = e.rotation_as_read = kNan;
    if (e.measures_pose) {
      judge(&BlockSums::rotation, e.rotation, e.of_rotation);
      judge(&BlockSums::rotation_as_read, e.rotation_as_read, e.of_rotation_as_read);
    }
    out.push_back(e);
  }
  return out;
}

std::vector<HeldOutError> held_out_errors(const Solution& solution, const Residuals& residuals) {
  HeldOutSums sums;
  sums.add(*solution.recording, residuals, indices(solution.samples().size()));
  return held_out_errors(solution.rig(), make_blocks(solution.rig(), solution.samples()), sums);
}

std::vector<ComparedError> compare_errors(const Rig& rig, const Blocks& blocks,
                                          const std::vector<const HeldOutSums*>& sums,
                                          size_t may_lack) {
  std::vector<ComparedError> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    for (const auto part : {&BlockSums::as_read, &BlockSums::rotation_as_read}) {
      const bool rotation = part == &BlockSums::rotation_as_read;
      const SensorModel& model = *rig.sensors[s].model;
      if (rotation && !model.measures_pose()) continue;
      ComparedError row{rig.sensors[s].name, rotation ? "rad" : model.unit()};
      std::map<int, std::vector<double>> by_block, by_sample;
      for (const auto& [place, last] : sums.back()->all) {
        if (place.first != static_cast<int>(s)) continue;
        std::vector<double> squares;
        for (const HeldOutSums* one : sums) {
          const auto found = one->all.find(place);
          const bool same = found != one->all.end() && found->second.points == last.points;
          if (same || squares.size() < may_lack)
            squares.push_back(same ? found->second.*part : kNan);
        }
        if (squares.size() < sums.size()) continue;
        const int block = blocks.of[place.second];
        row.points += last.points;
        row.by_target = row.by_target || blocks.target[block];
        for (std::vector<double>* to : {&by_block[block], &by_sample[place.second]}) {
          to->resize(sums.size(), 0);
          for (size_t k = 0; k < sums.size(); ++k) (*to)[k] += squares[k];
        }
      }
      if (row.points == 0) continue;
      const bool whole = by_block.size() >= 3;
      row.by_target = whole && row.by_target;
      row.squares.resize(sums.size());
      for (const auto& entry : whole ? by_block : by_sample)
        for (size_t k = 0; k < sums.size(); ++k) row.squares[k].push_back(entry.second[k]);
      row.blocks = static_cast<long>(row.squares.back().size());
      for (const std::vector<double>& squares : row.squares)
        row.rms.push_back(std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.0) /
                                    static_cast<double>(row.points)));
      out.push_back(std::move(row));
    }
  return out;
}

}  // namespace kincal
