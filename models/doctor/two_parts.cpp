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

double chi2(const std::vector<FittedPart>& parts) {
  double out = parts.empty() ? kInfinity : 0;
  for (const FittedPart& part : parts) out += part.fit.complete() ? part.fit.chi2 : kInfinity;
  return out;
}

/// Fits two parts of the samples apart; empty: one lacks what the whole has.
std::vector<FittedPart> fit_parts(const Recording& recording, const TrialContext& context,
                                  const std::vector<int>& before, const std::vector<int>& after) {
  std::vector<FittedPart> out;
  for (const std::vector<int>* part : {&before, &after}) {
    std::vector<Sample> samples;
    for (const int i : *part) samples.push_back(recording.samples[i]);
    try {
      out.push_back({recording.with_samples(std::move(samples)), {}});
      out.back().fit = best_fit(out.back().recording, context, context.all, {30, 1e-4});
    } catch (const std::invalid_argument&) {
      return {};
    }
  }
  return out;
}

}  // namespace

int best_cut(int n, int fewest, int also, const std::function<double(int)>& cost) {
  std::map<int, double> tried;
  int at = 0;
  const auto look = [&](int k) {
    if (k < fewest || k > n - fewest || tried.count(k)) return;
    tried[k] = cost(k);
    if (tried[k] < (at == 0 ? kInfinity : tried.at(at))) at = k;
  };
  for (const int first : {also, n / 2, n / 4, n * 3 / 4}) look(first);
  for (int step = std::max(1, n / 8); at > 0 && step >= 1;) {
    const int middle = at;
    look(middle - step), look(middle + step);
    if (at == middle) step /= 2;
  }
  return at;
}

std::optional<Changed> two_parts(const Recording& recording, const TrialContext& context,
                                 const TrialFit& now) {
  const std::vector<int> order = logged_order(recording.samples);
  const int n = static_cast<int>(order.size());
  if (n < kFewestSamples || !now.complete()) return std::nullopt;
  const auto split = [&](int k) {
    return fit_parts(recording, context, {order.begin(), order.begin() + k},
                     {order.begin() + k, order.end()});
  };
  double tried = 0;
  const int at = best_cut(n, kFewestInPart, 0, [&](int k) {
    context.progress.share(tried, tried + 8);
    ++tried;
    return chi2(split(k));
  });
  if (at == 0) return std::nullopt;
  const std::vector<FittedPart> best = split(at);
  const std::optional<EvidenceApart> apart = evidence_apart(best);
  if (!apart) return std::nullopt;
  // Noise is what it is within the parts: what lies between them is not.
  const double prior = log_prior(false, static_cast<size_t>(n)),
               of_whole = log_evidence_at({{recording, now}}, apart->noise),
               log_odds = log_evidence_at(best, apart->noise) + prior - of_whole;
  if (!(log_odds - log_by_chance({{recording, now}}, best) > kFound)) return std::nullopt;
  std::vector<int> some, others;
  for (int i = 0; i < n; ++i) ((i + 1) * at / n > i * at / n ? some : others).push_back(order[i]);
  const std::vector<FittedPart> spread = fit_parts(recording, context, some, others);
  const std::optional<EvidenceApart> mixed = evidence_apart(spread);
  if (mixed && !(apart->log + prior - mixed->log - log_by_chance(spread, best) > kFound))
    return std::nullopt;
  const std::string &last = recording.samples[order[at - 1]].id,
                    &first = recording.samples[order[at]].id;
  Notice out =
      make_notice(NoticeKind::changed, {Subject::sample(first)},
                  "the samples up to " + quoted(last) + " and those from " + quoted(first) +
                      " on contradict each other: chi2/dof is " +
                      text("%.3g for all, %.3g and %.3g for the two separately", now.per_dof(),
                           best[0].fit.per_dof(), best[1].fit.per_dof()),
                  "something changed in between: image size or lens setting, a joint that was "
                  "homed again, a camera, tracker or target that was bumped, or another robot",
                  "calibrate the two parts separately, and compare them (diff)");
  out.chi2_as_is = now.chi2;
  out.chi2_corrected = chi2(best);
  return Changed{std::move(out), apart->log + prior};
}

}  // namespace kincal
