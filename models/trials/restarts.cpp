#include "restarts.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "../calibration/calibration.h"
#include "../rig/draws.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr int kHalvings = 6;
constexpr double kSameCost = 1e-6, kSameSigmas = 0.01;
constexpr size_t kNamed = 10;

/// Moves what a step frees and `moved` does not have yet, which it gets.
void scatter(const ParameterTable& table, const VectorXd& initial_values, const StepPlan& plan, double share, Draws& draws, std::vector<std::vector<char>>& moved,
             VectorXd& values) {
  const VectorXd from = values;
  for (const Freed& f : plan.free) {
    const Parameter& p = table.all[f.parameter];
    VectorXd by = VectorXd::Zero(p.size());
    moved[f.parameter].resize(p.size(), 0);
    for (int c : f.components) {
      if (moved[f.parameter][c]) continue;
      moved[f.parameter][c] = 1;
      double size = usual_error(table, {f.parameter, c}, from);
      for (const Prior& prior : plan.priors)
        if (prior.parameter == f.parameter && prior.component == c) size = prior.sigma;
      by(c) = share * size * draws.normal();
    }
    if (!p.pose) {
      values.segment(p.start, p.size()) += by;
    } else if (f.whole(p)) {
      set_pose(values, p.start, get_pose(from, p.start) * exp_se3(by));
    } else {
      const Pose initial = get_pose(initial_values, p.start);
      set_pose(values, p.start, initial * exp_se3(log_se3(inverse(initial) * get_pose(from, p.start)) + by));
    }
  }
}

/// `other` minus `result` in the result's sigmas, of all estimated components, largest first.
std::vector<std::pair<std::string, double>> differences(const CalibrationResult& result, const CalibrationResult& other) {
  std::vector<std::pair<std::string, double>> out;
  for (size_t i = 0; i < result.parameters.size(); ++i) {
    const ParameterEstimate &a = result.parameters[i], &b = other.parameters[i];
    const bool whole = a.pose && std::all_of(a.freed.begin(), a.freed.end(), [](char freed) { return freed != 0; });
    const Vector6d apart = whole ? log_se3(inverse(*a.pose) * *b.pose) : Vector6d(Vector6d::Zero());
    for (size_t c = 0; c < a.value.size(); ++c) {
      const double difference = whole ? apart(static_cast<Eigen::Index>(c)) : b.value[c] - a.value[c];
      if (a.sigma[c] > 0)  // neither held nor unknown
        out.push_back({a.components[c].empty() ? a.name : a.name + "." + a.components[c], difference / a.sigma[c]});
    }
  }
  std::stable_sort(out.begin(), out.end(), [](const auto& a, const auto& b) { return std::abs(a.second) > std::abs(b.second); });
  return out;
}

bool same_cost(double a, double b) { return std::abs(a - b) <= kSameCost * std::max({std::abs(a), std::abs(b), 1.0}); }

bool same(const CalibrationResult& a, const CalibrationResult& b) {
  const auto apart = differences(a, b);
  return same_cost(a.cost, b.cost) && (apart.empty() || std::abs(apart[0].second) <= kSameSigmas);
}

}  // namespace

bool add_restarts(const Calibration& calibration, const CalibrationOptions& options, int count, CalibrationResult& result) {
  struct End {
    const CalibrationResult* at;
    int count;
  };
  std::vector<CalibrationResult> kept;
  kept.reserve(count);
  std::vector<End> ends = {{&result, 0}};
  Restarts out;
  out.count = count;
  for (int n = 1; n <= count; ++n) {
    Calibration again = calibration;
    std::optional<CalibrationResult> end;
    for (int halving = 0; halving <= kHalvings && !end; ++halving) {
      Draws draws(static_cast<std::uint64_t>(n));
      std::vector<std::vector<char>> moved(again.table().all.size());
      CalibrationOptions other = options;
      other.judge = false;
      other.scatter = [&](const StepPlan& plan, VectorXd& values) {
        scatter(again.table(), again.initial(), plan, std::ldexp(1.0, -halving), draws, moved, values);
      };
      bool cancelled = false;
      if (options.progress)
        other.progress = [&](const std::string&, int iteration, double chi2, double damping) {
          cancelled = !options.progress("restart " + std::to_string(n), iteration, chi2, damping);
          return !cancelled;
        };
      try {
        end = again.run(other);
      } catch (const std::runtime_error&) {  // this start cannot be evaluated
        continue;
      }
      if (!end) return false;
    }
    if (!end || !end->steps.back().converged) {
      ++out.failed;
      continue;
    }
    const auto known = std::find_if(ends.begin(), ends.end(), [&](const End& e) { return same(*e.at, *end); });
    if (known != ends.end()) {
      ++known->count;
      continue;
    }
    kept.push_back(std::move(*end));
    ends.push_back({&kept.back(), 1});
  }
  std::stable_sort(ends.begin() + 1, ends.end(), [](const End& a, const End& b) { return a.at->cost < b.at->cost; });
  for (const End& e : ends) {
    Minimum m;
    m.cost = e.at->cost;
    m.chi2 = e.at->chi2;
    m.count = e.count;
    if (e.at != &result) {
      m.differs = differences(result, *e.at);
      m.differs.resize(std::min(m.differs.size(), kNamed));
    }
    out.minima.push_back(std::move(m));
  }
  if (out.minima.size() > 1 && (out.minima[1].cost < out.minima[0].cost || same_cost(out.minima[1].cost, out.minima[0].cost))) {
    const Minimum& m = out.minima[1];
    std::string names;
    for (size_t i = 0; i < std::min<size_t>(m.differs.size(), 3); ++i)
      names += (i ? ", " : "") + m.differs[i].first + text(" (%+.3g sigmas)", m.differs[i].second, 0);
    result.warnings.push_back({"minima", std::to_string(m.count) + " of " + std::to_string(count) + " restarts end in " +
                                             (same_cost(m.cost, out.minima[0].cost)
                                                  ? "another minimum that is as good as this result"
                                                  : text("a better minimum: cost %.8g, this result has %.8g", m.cost, out.minima[0].cost)) +
                                             ". Most different: " + names + ". The result is the one that the rig's own values lead to"});
  }
  result.restarts = std::move(out);
  return true;
}

}  // namespace kincal
