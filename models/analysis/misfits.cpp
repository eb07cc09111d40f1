#include "misfits.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>

#include "../fitting/robust.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "../rig/words.h"

namespace kincal {
namespace {

/// The share of a view's residuals that its free target's six numbers leave, on the average of the
/// sample's views of that target; 1 for a mounted target, at most 0 where the target takes up all.
double left_of_target(const Rig& rig, const Sample& sample, const View& view,
                      const std::map<const View*, Mean>& views) {
  if (rig.targets[view.target].link >= 0) return 1;
  long count = 0;
  for (const View& v : sample.views) {
    const auto mean = views.find(&v);
    if (v.target == view.target && mean != views.end()) count += mean->second.count;
  }
  return 1 - 6.0 / static_cast<double>(count);
}

}  // namespace

namespace {

/// Residuals and joint errors of each sample, squared and whitened, and how many of them its own
/// unknowns leave: chi-squared, or less where shared unknowns take some of it up.
std::vector<Mean> sample_squares(const Solution& solution,
                                 const std::map<const View*, Mean>& views) {
  const Rig& rig = solution.rig();
  std::vector<Mean> out(solution.samples().size());
  for (size_t i = 0; i < out.size(); ++i) {
    std::set<int> free;
    for (const View& v : solution.samples()[i].views) {
      const auto mean = views.find(&v);
      if (mean == views.end()) continue;
      out[i].sum += mean->second.sum;
      out[i].count += mean->second.count;
      if (rig.targets[v.target].link < 0) free.insert(v.target);
    }
    out[i].count -= 6 * static_cast<long>(free.size());
  }
  for (const auto& e : solution.values.errors)
    out[e.first.first].sum +=
        std::pow(e.second / joint_sigma(rig, solution.samples()[e.first.first], e.first.second), 2);
  return out;
}

/// Samples that are larger than chance makes one in a hundred recordings: by what is usual of the
/// others where that is more than the noise.
std::vector<char> beyond_chance(const Solution& solution,
                                const std::map<const View*, Mean>& views) {
  constexpr double kOneInHundred = 0.01;
  const std::vector<Mean> squares = sample_squares(solution, views);
  std::vector<char> out(squares.size(), 0);
  double usual = std::min(1.0, solution.chi2_per_dof());
  for (const bool train : {true, false}) {
    std::vector<double> means;
    for (size_t i = 0; i < squares.size(); ++i)
      if (solution.samples()[i].train == train && squares[i].count > 0)
        means.push_back(squares[i].value());
    usual = std::max(usual, median(means, 0));
    for (size_t i = 0; i < squares.size(); ++i)
      if (solution.samples()[i].train == train && squares[i].count > 0)
        out[i] = chi2_tail(squares[i].sum / usual, static_cast<double>(squares[i].count)) <
                 kOneInHundred / static_cast<double>(squares.size());
  }
  return out;
}

}  // namespace

Misfits misfits(const Solution& solution, const Residuals& residuals) {
  const Rig& rig = solution.rig();
  const auto sticks_out = [](double ratio, long count) {
    return ratio > std::max(9.0, chi2_bound(count) / static_cast<double>(count));
  };

  std::map<const View*, Mean> views;
  for (const ViewResiduals& r : residuals.after) {
    if (r.whitened.size() == 0 || !r.whitened.allFinite()) continue;
    views[r.view].sum = r.whitened.squaredNorm();
    views[r.view].count = r.whitened.size();
  }
  std::map<int, Mean> joints;  // by sample: errors in sigmas
  for (const auto& e : solution.values.errors) {
    joints[e.first.first].sum +=
        std::pow(e.second / joint_sigma(rig, solution.samples()[e.first.first], e.first.second), 2);
    ++joints[e.first.first].count;
  }
  std::vector<double> joint_means;
  for (const auto& j : joints) joint_means.push_back(j.second.value());
  const double usual_joints = std::max(1.0, median(joint_means, 0));

  // What is usual of a sensor's views, in training and held out, per residual that is left of them.
  std::map<std::pair<int, bool>, double> usual;
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    double least = rig.sensors[s].model->measurement_kind() == MeasurementKind::chain
                       ? 1
                       : kLeastNoiseRatio * kLeastNoiseRatio;
    for (bool train : {true, false}) {
      std::vector<double> means;
      for (const Sample& sample : solution.samples())
        for (const View& v : sample.views)
          if (sample.train == train && v.sensor == static_cast<int>(s) && views.count(&v)) {
            const double left = left_of_target(rig, sample, v, views);
            if (left > 0) means.push_back(views[&v].value() / left);
          }
      least = usual[{static_cast<int>(s), train}] = std::max(least, median(means, 0));
    }
  }

  const std::vector<char> beyond = beyond_chance(solution, views);
  Misfits out;
  for (size_t i = 0; i < solution.samples().size(); ++i) {
    if (!beyond[i]) continue;
    const Sample& sample = solution.samples()[i];
    std::vector<Misfit> bad;
    double worst = 0;
    size_t seen = 0;
    for (const View& v : sample.views) {
      const auto mean = views.find(&v);
      if (mean == views.end()) continue;
      ++seen;
      const double ratio = mean->second.value() / usual[{v.sensor, sample.train}];
      if (!sticks_out(ratio, mean->second.count)) continue;
      bad.push_back({ratio, "'" + sample.id + "' " + rig.sensors[v.sensor].name});
      worst = std::max(worst, ratio);
    }
    const auto joint = joints.find(static_cast<int>(i));
    const double joint_ratio = joint == joints.end() ? 0 : joint->second.value() / usual_joints;
    const bool wrong_joints = joint != joints.end() && sticks_out(joint_ratio, joint->second.count);
    if (wrong_joints || 2 * bad.size() > seen)
      out.samples.push_back({std::max(worst, wrong_joints ? joint_ratio : 0.0),
                             "'" + sample.id + "'" + (sample.train ? "" : " (held out)")});
    else
      out.views.insert(out.views.end(), bad.begin(), bad.end());
  }

  for (std::vector<Misfit>* found : {&out.samples, &out.views})
    std::stable_sort(found->begin(), found->end(),
                     [](const Misfit& a, const Misfit& b) { return a.ratio > b.ratio; });
  return out;
}

}  // namespace kincal
