#include "restarts.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "../calibration/calibration.h"
#include "../rig/random_stream.h"
#include "../rig/scales.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr int kHalvings = 6;
constexpr double kSameCost = 1e-6, kSameSigmas = 0.01;
constexpr size_t kDiffering = 10;

/// How a restart moves its starts: by a share of the usual distances, each component once.
struct Scatter {
  double share = 1;
  RandomStream draws;
  std::vector<std::vector<char>> moved;  // by parameter and component
};

/// Moves what a step frees and `scatter` has not moved yet.
void move_start(const Recording& recording, const StepPlan& plan, const VectorXd& initial_values,
                Scatter& scatter, VectorXd& values) {
  const ParameterTable& table = recording.table;
  const VectorXd from = values;
  for (const Freed& f : plan.free) {
    const Parameter& p = table.all[f.parameter];
    VectorXd by = VectorXd::Zero(p.size());
    std::vector<char>& moved = scatter.moved[f.parameter];
    moved.resize(p.size(), 0);
    for (int c : f.components) {
      if (moved[c]) continue;
      moved[c] = 1;
      double size = scales(table, {f.parameter, c}, from).usual;
      for (const Prior& prior : plan.priors)
        if (prior.parameter == f.parameter && prior.component == c) size = prior.sigma;
      by(c) = scatter.share * size * scatter.draws.normal();
    }
    if (!p.pose) {
      values.segment(p.start, p.size()) += by;
    } else if (f.whole(p)) {
      set_pose(values, p.start, get_pose(from, p.start) * exp_se3(by));
    } else {
      const Pose initial = get_pose(initial_values, p.start);
      set_pose(values, p.start,
               initial * exp_se3(log_se3(inverse(initial) * get_pose(from, p.start)) + by));
    }
  }
}

/// `other` minus `result` in the result's sigmas, of all estimated components, largest first.
std::vector<std::pair<std::string, double>> differences(const Solution& result,
                                                        const Solution& other) {
  std::vector<std::pair<std::string, double>> out;
  for (size_t i = 0; i < result.parameters.size(); ++i) {
    const ParameterEstimate &a = result.parameters[i], &b = other.parameters[i];
    const bool whole = a.pose && std::all_of(a.freed.begin(), a.freed.end(),
                                             [](char freed) { return freed != 0; });
    const Vector6d apart = whole ? log_se3(inverse(*a.pose) * *b.pose) : Vector6d(Vector6d::Zero());
    for (size_t c = 0; c < a.value.size(); ++c) {
      const double difference =
          whole ? apart(static_cast<Eigen::Index>(c)) : b.value[c] - a.value[c];
      if (a.sigma[c] > 0)  // neither held nor unknown
        out.push_back({a.components[c].empty() ? a.name : a.name + "." + a.components[c],
                       difference / a.sigma[c]});
    }
  }
  std::stable_sort(out.begin(), out.end(), [](const auto& a, const auto& b) {
    return std::abs(a.second) > std::abs(b.second);
  });
  return out;
}

bool same(const Solution& a, const Solution& b) {
  const auto apart = differences(a, b);
  return same_cost(a.cost, b.cost) && (apart.empty() || std::abs(apart[0].second) <= kSameSigmas);
}

/// The end of restart `n`: with its start halved as often as it takes to be evaluated;
/// undefined_start: not even then. @throws Cancelled
Solution run_again(const Solution& solution, const CalibrationOptions& options, int n) {
  Solution end;
  for (int halving = 0; halving <= kHalvings; ++halving) {
    Scatter scatter{std::ldexp(1.0, -halving), RandomStream(static_cast<std::uint64_t>(n)), {}};
    scatter.moved.resize(solution.table().all.size());
    StepVariations other;
    other.noise_ratios = solution.setup.noise_ratios;  // else costs could not be compared
    other.before_step = [&](const StepPlan& plan, const VectorXd& initial, VectorXd& values) {
      move_start(*solution.recording, plan, initial, scatter, values);
    };
    CalibrationOptions named = options;
    named.progress = options.progress.in("restart " + std::to_string(n));
    end = uncancelled(calibrate(solution.recording, named, other));
    end.last.reset();
    if (end.status != Status::undefined_start) break;
  }
  return end;
}

}  // namespace

bool same_cost(double a, double b) {
  return std::abs(a - b) <= kSameCost * std::max({std::abs(a), std::abs(b), 1.0});
}

std::optional<Restarts> restarts(const Solution& solution, const CalibrationOptions& options,
                                 int count) try {
  struct End {
    const Solution* at;
    int count;
  };
  std::vector<Solution> kept;
  kept.reserve(count);
  std::vector<End> ends = {{&solution, 0}};
  Restarts out;
  out.count = count;
  for (int n = 1; n <= count; ++n) {
    options.progress.stage("restarts", (n - 1.0) / count);
    Solution end = run_again(solution, options, n);
    const bool started = end.status != Status::undefined_start;
    if (!started || !end.steps.back().converged) {
      ++out.failed;
      out.not_converged += started;
      continue;
    }
    const auto known =
        std::find_if(ends.begin(), ends.end(), [&](const End& e) { return same(*e.at, end); });
    if (known != ends.end()) {
      ++known->count;
      continue;
    }
    kept.push_back(std::move(end));
    ends.push_back({&kept.back(), 1});
  }
  options.progress.stage("restarts", 1);
  std::stable_sort(ends.begin() + 1, ends.end(),
                   [](const End& a, const End& b) { return a.at->cost < b.at->cost; });
  for (const End& e : ends) {
    Minimum m;
    m.cost = e.at->cost;
    m.chi2 = e.at->chi2;
    m.count = e.count;
    if (e.at != &solution) {
      m.differs = differences(solution, *e.at);
      m.differs.resize(std::min(m.differs.size(), kDiffering));
    }
    out.minima.push_back(std::move(m));
  }
  return out;
} catch (const Cancelled&) {
  return std::nullopt;
}

}  // namespace kincal
