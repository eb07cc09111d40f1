#include "two_parts.h"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <utility>

#include "../rig/words.h"
#include "alternatives.h"

namespace kincal {
namespace {

constexpr int kFewestSamples = 16, kFewestInPart = 5;

/// Two parts of the samples, fitted apart.
struct Parts {
  TrialFit before, after;
  double log = -kInfinity;  // evidence; only where it was asked for
  double chi2() const {
    return before.complete() && after.complete() ? before.chi2 + after.chi2 : kInfinity;
  }
};

Parts fit_parts(const Recording& recording, const TrialContext& context,
                const std::vector<int>& before, const std::vector<int>& after,
                bool with_evidence = false) {
  Parts parts;
  double log = 0;
  for (const bool first : {true, false}) {
    std::vector<Sample> samples;
    for (const int i : first ? before : after) samples.push_back(recording.samples[i]);
    TrialFit& fit = first ? parts.before : parts.after;
    try {
      const Recording part = recording.with_samples(std::move(samples));
      fit = best_fit(part, context, context.all, {30, 1e-4});
      if (with_evidence) log += log_evidence(part, context, context.all, fit, nullptr, {"*"});
    } catch (const std::invalid_argument&) {  // a part lacks what the whole has
      fit.chi2 = kInfinity;
      return parts;
    }
  }
  if (with_evidence) parts.log = log;
  return parts;
}

}  // namespace

std::optional<Changed> two_parts(const Recording& recording, const TrialContext& context,
                                 const TrialFit& now) {
  const std::vector<int> order = logged_order(recording.samples);
  const int n = static_cast<int>(order.size());
  if (n < kFewestSamples || !now.complete()) return std::nullopt;
  std::map<int, double> tried;  // chi2 by split
  int at = 0;
  const auto split = [&](int k, bool with_evidence) {
    return fit_parts(recording, context, {order.begin(), order.begin() + k},
                     {order.begin() + k, order.end()}, with_evidence);
  };
  const auto look = [&](int k) {
    if (k < kFewestInPart || k > n - kFewestInPart || tried.count(k)) return;
    context.report(static_cast<int>(tried.size()), static_cast<int>(tried.size()) + 8);
    tried[k] = split(k, false).chi2();
    if (tried[k] < (at == 0 ? kInfinity : tried.at(at))) at = k;
  };
  for (const int quarter : {2, 1, 3}) look(n * quarter / 4);
  for (int step = std::max(1, n / 8); at > 0 && step >= 1;) {
    const int middle = at;
    look(middle - step), look(middle + step);
    if (at == middle) step /= 2;
  }
  if (at == 0) return std::nullopt;
  const Parts best = split(at, true);
  const double prior = log_prior(false, static_cast<size_t>(n)), found = best.log + prior;
  const auto beats = [&](double log) { return found - log > kFound; };
  if (!beats(log_evidence(recording, context, context.all, now))) return std::nullopt;
  std::vector<int> some, others;
  for (int i = 0; i < n; ++i) ((i + 1) * at / n > i * at / n ? some : others).push_back(order[i]);
  if (!beats(fit_parts(recording, context, some, others, true).log + prior)) return std::nullopt;
  const std::string &last = recording.samples[order[at - 1]].id,
                    &first = recording.samples[order[at]].id;
  Notice out = make_notice(
      NoticeKind::changed, {Subject::sample(first)},
      "what was recorded up to sample " + quoted(last) + " and from " + quoted(first) +
          " on contradict each other: chi2/dof is " +
          text("%.3g of all, %.3g and %.3g of the two by themselves", now.per_dof(),
               best.before.per_dof(), best.after.per_dof()),
      "something changed between: images of another size or lens setting, a joint that was homed "
      "anew, a camera, tracker or target that was bumped, or it is another robot",
      "calibrate the two parts apart, and compare them (diff)");
  out.chi2_as_is = now.chi2;
  out.chi2_corrected = best.chi2();
  return Changed{std::move(out), found};
}

}  // namespace kincal
