#include "two_parts.h"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <utility>

#include "../rig/words.h"

namespace kincal {
namespace {

constexpr int kFewestSamples = 16, kFewestInPart = 5;
constexpr double kSplit = 3;  // times as good as parts that are spread over all samples
constexpr double kLarge = 5;  // chi2/dof; less a robot's own geometry makes, in one region
                              // otherwise than in another

/// The samples before the k-th in the order of logging and those from it on, fitted apart.
struct Parts {
  TrialFit before, after;
  double chi2() const {
    return before.complete() && after.complete() ? before.chi2 + after.chi2 : kInfinity;
  }
  long dof() const { return before.dof + after.dof; }
};

TrialFit fit_of(const Recording& recording, const TrialContext& context,
                const std::vector<int>& samples) {
  std::vector<Sample> part;
  for (const int i : samples) part.push_back(recording.samples[i]);
  return best_fit(recording.with_samples(std::move(part)), context, context.all, {30, 1e-4});
}

/// `count` of the samples, spread over all, and the others, fitted apart. What changed at some
/// sample both parts have; what two fits explain better than one for other reasons (errors of
/// readings that nobody stated, with few samples) they explain as well as a true split.
Parts spread_parts(const Recording& recording, const TrialContext& context,
                   const std::vector<int>& order, int count) {
  const int n = static_cast<int>(order.size());
  std::vector<int> some, others;
  for (int i = 0; i < n; ++i)
    ((i + 1) * count / n > i * count / n ? some : others).push_back(order[i]);
  Parts parts;
  try {
    parts.before = fit_of(recording, context, some);
    parts.after = fit_of(recording, context, others);
  } catch (const std::invalid_argument&) {  // a part lacks what the whole has
    parts.before.chi2 = kInfinity;
  }
  return parts;
}

}  // namespace

std::optional<Notice> two_parts(const Recording& recording, const TrialContext& context,
                                const TrialFit& now) {
  const std::vector<int> order = logged_order(recording.samples);
  const int n = static_cast<int>(order.size());
  if (n < kFewestSamples || !now.complete() || now.per_dof() < kLarge) return std::nullopt;
  std::map<int, Parts> tried;
  int at = 0;
  const auto look = [&](int k) {
    if (k < kFewestInPart || k > n - kFewestInPart || tried.count(k)) return;
    context.report(static_cast<int>(tried.size()), static_cast<int>(tried.size()) + 8);
    Parts& parts = tried[k];
    try {
      parts.before = fit_of(recording, context, {order.begin(), order.begin() + k});
      parts.after = fit_of(recording, context, {order.begin() + k, order.end()});
    } catch (const std::invalid_argument&) {  // a part lacks what the whole has
      parts.before.chi2 = kInfinity;
      return;
    }
    if (at == 0 || parts.chi2() < tried.at(at).chi2()) at = k;
  };
  for (const int quarter : {2, 1, 3}) look(n * quarter / 4);
  if (at == 0 || !(Thresholds::clean_gain * tried.at(at).chi2() < now.chi2)) return std::nullopt;
  for (int step = std::max(1, n / 8); step >= 1;) {
    const int middle = at;
    look(middle - step), look(middle + step);
    if (at == middle) step /= 2;
  }
  const Parts& best = tried.at(at);
  const double left = best.chi2() / static_cast<double>(std::max(1L, best.dof()));
  if (!((left < Thresholds::noise ? Thresholds::decisive : Thresholds::overwhelming) * left <
        now.per_dof()))
    return std::nullopt;
  if (!(kSplit * best.chi2() < spread_parts(recording, context, order, at).chi2()))
    return std::nullopt;
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
  return out;
}

}  // namespace kincal
