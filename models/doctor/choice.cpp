#include "choice.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>

#include "../rig/scales.h"
#include "alternatives.h"
#include "camera_mistakes.h"
#include "hypotheses.h"
#include "joint_mistakes.h"
#include "reading_mistakes.h"
#include "suspects.h"
#include "target_mistakes.h"
#include "turned_poses.h"

namespace kincal {
namespace {

using Samples = std::vector<Sample>;

}  // namespace

std::vector<double> size_factors(const Rig& rig, const Hypothesis& h, const Trial& t) {
  std::vector<double> factors;
  const ParameterTable& fitted = t.recording.table;
  for (int s : h.squares)
    factors.push_back(
        std::abs(t.fit.values.shared(
            fitted.all[fitted.target_square[s]].start)) /  // negative: the board half a turn round
        (rig.targets[s].grid ? rig.targets[s].square : 1));
  const double low = *std::min_element(factors.begin(), factors.end()),
               high = *std::max_element(factors.begin(), factors.end());
  const bool sane =
      low > 1e-4 && high < 1e4 && high < 1.1 * low &&
      std::max(std::abs(low - 1), std::abs(high - 1)) > scales(ParameterKind::square, "m").least;
  return sane ? factors : std::vector<double>();
}

std::pair<std::string, std::string> told(const Hypothesis& h, const Trial& t) {
  std::vector<double> found;
  for (const std::string& name : h.free)
    for (const Freed& f : t.recording.table.select(name))
      for (const int c : f.components)
        found.push_back(t.fit.values.shared(t.recording.table.all[f.parameter].start + c));
  return h.told(found);
}

namespace {

constexpr size_t kMostLooks = 4;   // hypotheses that are weighed with all samples
constexpr size_t kMostOfOne = 2;   // of these, of one kind about one thing
constexpr double kHopeless = 20;   // times the least chi2 so far: not worth more
constexpr double kFarBehind = 50;  // nats of rough evidence: not worth the evidence

/// A hypothesis of the list, and its evidence: rough, at the first look, or its log odds.
struct Look {
  double log;
  size_t index;
};

/// Whether a fit put mounted targets of single points at one place, where no two can be: on the
/// axis of what then holds them they explain everything.
bool are_targets_at_one_place(const Trial& t) {
  constexpr double kApart = 1e-4;  // m
  const Rig& rig = t.recording.rig;
  std::set<size_t> seen;
  for (const Sample& sample : t.recording.samples)
    for (const View& v : sample.views) seen.insert(static_cast<size_t>(v.target));
  std::map<int, std::vector<Vector3d>> places;  // by link
  for (const size_t i : seen) {
    const Target& target = rig.targets[i];
    if (target.link < 0 || target.count() != 1 || target.grid) continue;
    const Parameter& p = t.recording.table.all[t.recording.table.target_pose[i]];
    places[target.link].push_back(get_pose(t.fit.values.shared, p.start) *
                                  Vector3d(target.points.col(0)));
  }
  for (const auto& [link, points] : places)
    for (size_t a = 0; a < points.size(); ++a)
      for (size_t b = 0; b < a; ++b)
        if ((points[a] - points[b]).norm() < kApart) return true;
  return false;
}

/// Whether a fit made a size that is free next to nothing: then all that is seen may be one point,
/// which explains everything.
bool has_collapsed(const Trial& t) {
  constexpr double kNothing = 1e-4;
  const ParameterTable& table = t.recording.table;
  if (t.fit.values.shared.size() == 0) return false;
  if (are_targets_at_one_place(t)) return true;
  return std::any_of(table.target_square.begin(), table.target_square.end(), [&](int square) {
    if (square < 0) return false;
    const int at = table.all[square].start;
    return std::abs(t.fit.values.shared(at)) < kNothing * std::abs(table.initial(at));
  });
}

/// The recording without the mistake.
Recording undone(const Recording& recording, const Hypothesis& h) {
  const Recording out = h.undo(recording);
  if (h.ignored_joint < 0) return out;
  Rig rig = out.rig;
  rig.joints[h.ignored_joint].sigma = 1;
  return out.with_rig(std::move(rig));
}

/// `recording`: what the hypothesis is tried on, all samples or some.
Trial try_hypothesis(const Recording& recording, const TrialContext& context, const Hypothesis& h,
                     Effort effort) {
  Trial t{undone(recording, h), context.all, {}, kInfinity};
  t.spec.free.insert(t.spec.free.end(), h.free.begin(), h.free.end());
  for (int square : h.squares)
    t.spec.free.push_back("target/" + recording.rig.targets[square].name + "/square");
  effort.closed_form = h.new_poses;
  try {
    t.fit = best_fit(t.recording, context, t.spec, effort);
    t.cost = has_collapsed(t) ? kInfinity : t.fit.score();
  } catch (const std::invalid_argument&) {  // a path that cannot be walked in the other rig
  }
  return t;
}

/// Whether such a mistake has parameters like those that the trial found.
bool makes_sense(const Rig& rig, const Hypothesis& h, const Trial& t) {
  return (h.squares.empty() || !size_factors(rig, h, t).empty()) &&
         (!h.told || !told(h, t).first.empty());
}

/// The likeliest few of the candidates from `first` to `end`, by a few iterations with some
/// samples; the likeliest first.
std::vector<Look> shortlist(const Recording& recording, const TrialContext& context,
                            const TrialFit& now, const std::vector<Hypothesis>& candidates,
                            size_t first, size_t end) {
  const Recording some = recording.with_samples(some_samples(recording, context.all.free.size()));
  std::vector<Look> order;
  double least = good(now) ? kInfinity : now.score();
  bool explained = false;
  for (size_t i = first; i < end; ++i) {
    context.progress.share(static_cast<double>(i - first), static_cast<double>(end - first));
    if (explained && candidates[i].many) continue;
    const Trial t =
        try_hypothesis(some, context, candidates[i], {10, 1e-2, false, kHopeless * least});
    if (!std::isfinite(t.cost)) continue;
    // (Another lens takes up what is wrong with the rig's own: the evidence decides on it.)
    const bool decides = !candidates[i].leaves_out && !candidates[i].only_of_misfits;
    if (decides) least = std::min(least, t.cost);
    explained = explained || (decides && !good(now) && good(t.fit));
    order.push_back({rough_log_evidence(t.recording, t.fit, &candidates[i]) +
                         log_left_out(some, t.recording, t.fit),
                     i});
  }
  std::sort(order.begin(), order.end(), [](const Look& a, const Look& b) {
    return std::pair(-a.log, a.index) < std::pair(-b.log, b.index);
  });
  // Of hypotheses that are as likely as the first, the more usual ones go before.
  const auto worse = std::find_if(order.begin(), order.end(), [&](const Look& look) {
    return look.log < order.front().log - kAsLikely;
  });
  std::sort(order.begin(), worse, [](const Look& a, const Look& b) { return a.index < b.index; });
  std::vector<Look> out;
  std::map<std::pair<NoticeKind, std::vector<std::string>>, size_t> of_one;  // kind and thing
  for (const Look& look : order) {
    const Hypothesis& h = candidates[look.index];
    if (out.size() == kMostLooks) break;
    if (of_one[{h.kind, names_of(h.where)}]++ < kMostOfOne) out.push_back(look);
  }
  return out;
}

/// How many things a kind of mistake may be about.
size_t alike(const std::vector<Hypothesis>& all, NoticeKind kind) {
  std::set<std::vector<std::string>> things;
  for (const Hypothesis& h : all)
    if (h.kind == kind) things.insert(names_of(h.where));
  return things.size();
}

/// Weighs hypotheses with all samples against the data as they are, and keeps the likeliest.
class Weighing {
 public:
  Weighing(const Recording& recording, const TrialContext& context, const TrialFit& now)
      : recording_(recording),
        context_(context),
        now_(now),
        rough_as_is_(rough_log_evidence(recording, now, nullptr) +
                     log_left_out(recording, recording, now)),
        rough_(rough_as_is_) {}

  void weigh(const std::vector<Hypothesis>& all, size_t index) {
    const Hypothesis& h = all[index];
    const bool all_kept = best_ && !best_->hypothesis.leaves_out;
    // Mistakes that the freed poses hide are looked for only where the data need no explanation.
    const bool explained =
        context_.explained_as_given || good(now_) || is_impossible(recording_, now_);
    const double give_up = explained  ? kInfinity
                           : all_kept ? kHopeless * best_->trial.cost
                                      : now_.score();
    Trial t = try_hypothesis(recording_, context_, h, {100, 1e-9, false, give_up});
    if (!std::isfinite(t.cost) || !makes_sense(recording_.rig, h, t)) return;
    const double rough =
        rough_log_evidence(t.recording, t.fit, &h) + log_left_out(recording_, t.recording, t.fit);
    const double by_chance = log_by_chance({{recording_, now_}}, {{t.recording, t.fit}}, h.where);
    if (rough < std::max(rough_, rough_as_is_ + by_chance) - kFarBehind) return;
    if (!as_is_)
      as_is_ = log_evidence(recording_, context_, context_.all, now_) +
               log_left_out(recording_, recording_, now_);
    const double log = log_evidence(t.recording, context_, t.spec, t.fit, &h) +
                       log_left_out(recording_, t.recording, t.fit) +
                       log_prior(h.rarer, alike(all, h.kind));
    const double log_odds = log - *as_is_;
    if (context_.tried) context_.tried->push_back({h.kind, h.where, log_odds});
    if (!(log_odds - by_chance > kFound) &&
        !(!h.only_of_misfits && good(t.fit) &&
          now_.per_dof() > Thresholds::clean_gain * t.fit.per_dof() && explains_alone(h, t)))
      return;
    rough_ = std::max(rough_, rough);
    found_.push_back({h.kind, h.where, log_odds});
    const Look look = {log_odds, index + (h.rarer ? all.size() : 0)};
    if (best_ && !is_before(look)) return;
    best_.emplace(AcceptedHypothesis{h, std::move(t), log_odds, {}});
    best_at_ = look;
  }

  bool found() const { return best_.has_value(); }
  /// Whether nothing is left that would need an explanation.
  bool explained() const {
    return best_ && good(best_->trial.fit) && !best_->hypothesis.leaves_out;
  }
  bool is_best(NoticeKind kind) const { return best_ && best_->hypothesis.kind == kind; }

  std::optional<AcceptedHypothesis> take() {
    for (const Alternative& a : found_)
      if (a.log_odds > best_->log_odds - kAsLikely - precision(best_->log_odds) &&
          a.kind != best_->hypothesis.kind)
        best_->as_likely.push_back(a);
    return std::move(best_);
  }

 private:
  /// Whether this is likelier than the best, or as likely and more usual.
  bool is_before(const Look& look) const {
    const double apart = precision(std::max(look.log, best_at_.log));
    return look.log > best_at_.log + (look.index < best_at_.index ? -apart : apart);
  }

  /// Whether the parameters that the mistake frees are not as stated, if all others are.
  bool explains_alone(const Hypothesis& h, const Trial& t) const {
    const std::vector<std::string> all = {"*"};
    return !(h.squares.empty() && h.free.empty()) &&
           log_evidence(t.recording, context_, t.spec, t.fit, &h, all) + log_prior(h.rarer, 1) -
                   log_evidence(recording_, context_, context_.all, now_, nullptr, all) >
               kFound;
  }

  const Recording& recording_;
  const TrialContext& context_;
  const TrialFit& now_;
  double rough_as_is_;
  double rough_;                 // of the likeliest finding so far
  std::optional<double> as_is_;  // log evidence
  std::vector<Alternative> found_;
  std::optional<AcceptedHypothesis> best_;
  Look best_at_{-kInfinity, 0};
};

}  // namespace

std::optional<AcceptedHypothesis> choose(const Recording& recording, const TrialContext& context,
                                         const TrialFit& now) {
  const FreedNames freed = freed_names(recording.table, context.all);
  std::vector<Hypothesis> all =
      hypotheses(recording.rig, recording.table, recording.samples, freed);
  const bool misfit = !good(now);
  if (!misfit)
    all.erase(std::remove_if(all.begin(), all.end(),
                             [](const Hypothesis& h) { return h.only_of_misfits; }),
              all.end());
  const size_t common = all.size();
  Weighing weighing(recording, context, now);
  const auto weigh_further = [&](std::optional<Hypothesis> h) {
    if (!h) return;
    all.push_back(std::move(*h));
    weighing.weigh(all, all.size() - 1);
  };
  const auto weigh_likeliest = [&](size_t first, size_t end) {
    for (const Look& look : shortlist(recording, context, now, all, first, end))
      weighing.weigh(all, look.index);
  };
  if (misfit) {
    const TrialFit robust = robust_fit(recording, context);
    for (Hypothesis& h : turned_views(recording, robust)) weigh_further(std::move(h));
    weigh_further(outlier_points(recording, context, robust));
    weigh_further(bad_samples(recording, context, robust));
    weigh_further(time_lag(recording, context));
  }
  if (!weighing.explained()) weigh_likeliest(0, common);
  // A shift takes a sample away from the few of a first look, and what is left may start far off.
  if (misfit && !weighing.found())
    for (size_t i = 0; i < common; ++i)
      if (all[i].kind == NoticeKind::shifted) weighing.weigh(all, i);
  if (misfit && !weighing.explained())
    for (Hypothesis& h : turned_poses(recording, context)) weigh_further(std::move(h));
  if (misfit && !weighing.explained()) weigh_further(moved_target(recording, context));
  if (!weighing.explained()) {
    if (misfit && !weighing.found()) weigh_further(unfinished_move(recording, context));
    const size_t usual = all.size();
    add_rarer_readings(recording.rig, recording.table, recording.samples, freed, all);
    add_orders_of_rows(recording.rig, recording.samples,
                       make_observation_index(recording.rig, recording.samples), all);
    for (size_t i = usual; i < all.size(); ++i) all[i].rarer = true;
    weigh_likeliest(usual, all.size());
    // One sign may do what two do, but from a start too far for the first look.
    if (weighing.is_best(NoticeKind::joint_sign))
      for (size_t i = 0; i < common; ++i)
        if (all[i].kind == NoticeKind::joint_sign) weighing.weigh(all, i);
  }
  return weighing.found() ? weighing.take() : std::nullopt;
}

Trial fit_without(const Recording& recording, const TrialContext& context, const Hypothesis& h) {
  return try_hypothesis(recording, context, h, {100, 1e-9});
}

std::vector<AcceptedHypothesis> first_looks(const Recording& recording, const TrialContext& context,
                                            const TrialFit& now) {
  std::vector<Hypothesis> all = hypotheses(recording.rig, recording.table, recording.samples,
                                           freed_names(recording.table, context.all));
  const auto frees = [](const Hypothesis& h) {  // more than sizes
    return h.ignored_joint >= 0 || !h.free.empty() || h.rescaled >= 0;
  };
  all.erase(std::remove_if(all.begin(), all.end(), frees), all.end());
  std::vector<AcceptedHypothesis> out;
  for (const Look& look : shortlist(recording, context, now, all, 0, all.size())) {
    const Hypothesis& h = all[look.index];
    Trial t = try_hypothesis(recording, context, h, {20, 1e-3});
    if (std::isfinite(t.cost) && makes_sense(recording.rig, h, t))
      out.push_back({h, std::move(t), 0, {}});
  }
  return out;
}

}  // namespace kincal
