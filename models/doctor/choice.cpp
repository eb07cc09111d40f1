#include "choice.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
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

constexpr double kBearing = 10;        // sigmas: beyond, a first look bears what is wrong besides
constexpr size_t kMostWithout = 4;     // of so many samples one may have points behind its camera
constexpr size_t kMostRobust = 5;      // hypotheses of which robust fits are made
constexpr size_t kMostForPairs = 200;  // hypotheses: of more, pairs take too long
constexpr double kHopeless = 20;       // times the least chi2 so far: not worth more

/// A hypothesis of the list, and what the first look at it left.
struct Look {
  double cost;
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

/// `recording`: what the hypothesis is tried on, all samples or some.
Trial try_hypothesis(const Recording& recording, const TrialContext& context, const Hypothesis& h,
                     const TrialFit& now, Effort effort) {
  Rig rig = recording.rig;
  Samples samples = recording.samples;
  h.undo(rig, samples);
  if (h.ignored_joint >= 0) rig.joints[h.ignored_joint].sigma = 1;
  // What leaves out most of the data explains nothing: readings of which no other sense can be
  // made.
  const bool emptied = 2 * samples.size() < recording.samples.size();
  Trial t{Recording(std::move(rig), std::move(samples)), context.all, {}, kInfinity};
  if (emptied) return t;
  t.stage.free.insert(t.stage.free.end(), h.free.begin(), h.free.end());
  for (int square : h.squares)
    t.stage.free.push_back("target/" + recording.rig.targets[square].name + "/square");
  effort.closed_form = h.new_poses;
  try {
    t.fit = best_fit(t.recording, context, t.stage, effort);
    t.cost = has_collapsed(t) ? kInfinity : t.fit.score();
  } catch (const std::invalid_argument&) {  // a path that cannot be walked in the other rig
  }
  if (h.leaves_out)
    t.cost *= Thresholds::leaving_out * static_cast<double>(now.dof) /
              static_cast<double>(std::max(1L, t.fit.dof));
  return t;
}

/// Whether chi2 falls enough. `strict`: a fit that proves the sigmas does not lower the demand, for
/// unknowns were added or data left out.
bool believed(const TrialFit& before, const TrialFit& now, double now_cost, bool strict) {
  const double per_dof = now.per_dof();
  // Another mistake may spoil some points besides.
  if (!before.complete())
    return per_dof < Thresholds::overwhelming ||
           (now.complete() && now.typical() < Thresholds::overwhelming);
  double worst = 0;  // a sensor's share of all may be small
  for (size_t s = 0; s < std::min(before.sensor.size(), now.sensor.size()); ++s)
    if (before.sensor[s] > Thresholds::good)
      worst = std::max(worst, before.sensor[s] / now.sensor[s]);
  if (per_dof < Thresholds::clean && !strict)
    return before.cost > Thresholds::clean_gain * now_cost ||
           (worst > Thresholds::decisive && before.cost > now_cost);
  const bool little = per_dof < Thresholds::noise || (worst > Thresholds::of_a_sensor && !strict);
  return before.cost > (little ? Thresholds::decisive : Thresholds::overwhelming) * now_cost;
}

bool explains(const Rig& rig, const Question& question, const Hypothesis& h, const Trial& t) {
  if (question.by_movement)
    return t.cost < 1.3 * question.now.cost && return_of_movement(question.now, t.fit) > 0;
  if (!h.squares.empty() && size_factors(rig, h, t).empty()) return false;
  if (h.proves && !(t.fit.per_dof() < Thresholds::clean)) return false;
  if (h.told && told(h, t).first.empty()) return false;
  const double cost =
      h.leaves_out ? t.cost / Thresholds::leaving_out : t.cost / (h.shrinks * h.shrinks);
  return believed(question.now, t.fit, cost, h.leaves_out || h.ignored_joint >= 0 || h.told);
}

/// The best few of the candidates from `first` to `end`, by a few iterations with some samples;
/// best first.
std::vector<Look> shortlist(const Recording& recording, const TrialContext& context,
                            const Question& question, const std::vector<Hypothesis>& candidates,
                            size_t first, size_t end) {
  const Recording some = recording.with_samples(some_samples(recording, context.all.free.size()));
  std::vector<Look> order;
  double least = kInfinity;
  bool explained = false;
  for (size_t i = first; i < end; ++i) {
    context.report(static_cast<int>(i - first), static_cast<int>(end - first));
    if (explained && candidates[i].many) continue;
    const Effort effort = {10, 1e-2, false, question.by_movement ? kInfinity : kHopeless * least};
    const Trial t = try_hypothesis(some, context, candidates[i], question.now, effort);
    const double shrinks = candidates[i].shrinks * candidates[i].shrinks;
    if (!std::isfinite(t.cost) ||
        (shrinks < 1 && question.now.complete() && t.cost > shrinks * question.now.cost))
      continue;
    least = std::min(least, t.cost);
    explained = explained || (t.fit.complete() && t.fit.per_dof() < Thresholds::clean);
    if (!question.by_movement)
      order.push_back({t.cost, i});
    else if (return_of_movement(question.now, t.fit) > 0)
      order.push_back({t.fit.per_dof() / return_of_movement(question.now, t.fit), i});
  }
  const auto by_cost = [](const Look& a, const Look& b) {
    return std::pair(a.cost, a.index) < std::pair(b.cost, b.index);
  };
  std::sort(order.begin(), order.end(), by_cost);
  // Numberings of a board whose pose is free are all as good: of such the likelier ones come first.
  const auto worse = std::find_if(order.begin(), order.end(), [&](const Look& look) {
    return look.cost > 1.02 * order.front().cost;
  });
  std::sort(order.begin(), worse, [](const Look& a, const Look& b) { return a.index < b.index; });
  if (order.size() > 4) order.resize(4);
  return order;
}

/// Numbers that are free besides.
size_t extras(const Hypothesis& h) { return h.squares.size() + h.free.size(); }

/// The factor within which two fits are equally good. A number that is free takes part of other
/// mistakes up; so do two signs, or a zero, of which there are many.
double equal_within(const Hypothesis& a, const Hypothesis& b, bool rarer) {
  const bool one_told = (a.told && extras(b) == 0) || (b.told && extras(a) == 0);
  return rarer ? Thresholds::decisive : one_told ? 2.5 : 1.2;
}

/// Leaves what can be no reason that the estimate is far from the rig's values.
void leave_out_what_moves_nothing(std::vector<Hypothesis>& all) {
  all.erase(std::remove_if(all.begin(), all.end(),
                           [](const Hypothesis& h) {
                             return h.numbered_by_markers || !h.squares.empty() || !h.free.empty();
                           }),
            all.end());
}

}  // namespace

std::optional<Explanatory> choose(const Recording& recording, const TrialContext& context,
                                  const Question& question) {
  const TrialFit& now = question.now;
  const FreedNames freed = freed_names(recording.table, context.all);
  std::vector<Hypothesis> all =
      hypotheses(recording.rig, recording.table, recording.samples, freed);
  if (question.by_movement) leave_out_what_moves_nothing(all);
  const size_t common = all.size();
  if (!question.by_movement) {
    const TrialFit robust = robust_fit(recording, context);
    for (Hypothesis& h : turned_views(recording, robust)) all.push_back(std::move(h));
    if (auto h = outlier_points(recording, context, robust)) all.push_back(std::move(*h));
    if (auto h = bad_samples(recording, context, robust)) all.push_back(std::move(*h));
    if (auto h = time_lag(recording, context)) all.push_back(std::move(*h));
  }
  size_t usual = std::numeric_limits<size_t>::max();  // from here on: the rarer ones
  std::optional<Trial> best;
  std::optional<double> as_is;  // log evidence
  size_t chosen = 0;
  // Of what fits as well: what moves parameters less, or what is likelier.
  const auto preferred = [&](const Trial& t, bool earlier) {
    const double far = t.fit.farthest(), best_far = best->fit.farthest();
    return far < 0.5 * best_far ||
           (earlier && t.cost < 1.001 * best->cost && far < 1.001 * best_far + 1e-6);
  };
  const auto try_with_all_samples = [&](size_t i) {
    const Effort effort = {100, 1e-9, false,
                           question.by_movement ? kInfinity
                           : best               ? kHopeless * best->cost
                                                : now.score()};
    Trial t = try_hypothesis(recording, context, all[i], now, effort);
    if (context.tried && !question.by_movement && std::isfinite(t.cost)) {
      if (!as_is) as_is = log_evidence(recording, context, context.all, now, nullptr);
      tell_alternative(context, all[i], t, *as_is,
                       std::count_if(all.begin(), all.end(),
                                     [&](const Hypothesis& h) { return h.kind == all[i].kind; }));
    }
    if (!std::isfinite(t.cost) || !explains(recording.rig, question, all[i], t)) return;
    const double near =
        best ? equal_within(all[i], all[chosen], (i >= usual) != (chosen >= usual)) : 1;
    const bool equal = best && t.cost < near * best->cost && best->cost < near * t.cost;
    const size_t extra = extras(all[i]) + (i >= usual),
                 fewest = extras(all[chosen]) + (chosen >= usual);
    const bool simpler = equal && (extra < fewest || (extra == fewest && preferred(t, i < chosen)));
    if (!best || (equal ? simpler : t.cost < best->cost)) best.emplace(std::move(t)), chosen = i;
  };
  // What looked hopeless beside one that then explained all is not tried.
  const auto try_looked_at = [&](const std::vector<Look>& looks) {
    double explains_all = kInfinity;
    for (const Look& look : looks) {
      if (look.cost > kHopeless * explains_all) continue;
      try_with_all_samples(look.index);
      if (!question.by_movement && best && chosen == look.index && best->fit.complete() &&
          best->fit.per_dof() < Thresholds::clean)
        explains_all = std::min(explains_all, look.cost);
    }
  };
  for (size_t i = common; i < all.size(); ++i) try_with_all_samples(i);
  // A few samples or views may be all that is wrong; if many go with it, something else may be
  // wrong with these.
  if (!best || best->fit.per_dof() > Thresholds::clean ||
      static_cast<double>(best->fit.dof) < 0.97 * static_cast<double>(now.dof))
    try_looked_at(shortlist(recording, context, question, all, 0, common));
  // A shift takes a sample away from the few of a first look, and what is left may start far off.
  if (!question.by_movement && !best)
    for (size_t i = 0; i < common; ++i)
      if (all[i].kind == NoticeKind::shifted) try_with_all_samples(i);
  if (!question.by_movement && (!best || best->fit.per_dof() > Thresholds::clean))
    for (Hypothesis& h : turned_poses(recording, context)) {
      all.push_back(std::move(h));
      try_with_all_samples(all.size() - 1);
    }
  if (!question.by_movement &&
      (!best || best->fit.per_dof() > Thresholds::clean || all[chosen].leaves_out))
    if (auto h = moved_target(recording, context)) {
      all.push_back(std::move(*h));
      try_with_all_samples(all.size() - 1);
    }
  if (!best || (!question.by_movement && best->fit.per_dof() > Thresholds::clean)) {
    std::vector<Hypothesis> rarer;
    add_rarer_readings(recording.rig, recording.table, recording.samples, freed, rarer);
    add_orders_of_rows(recording.rig, recording.samples,
                       make_survey(recording.rig, recording.samples), rarer);
    if (question.by_movement) leave_out_what_moves_nothing(rarer);
    if (!question.by_movement && !best)
      if (auto h = unfinished_move(recording, context)) {
        all.push_back(std::move(*h));
        try_with_all_samples(all.size() - 1);
      }
    usual = all.size();
    std::move(rarer.begin(), rarer.end(), std::back_inserter(all));
    try_looked_at(shortlist(recording, context, question, all, usual, all.size()));
    // One sign may do what two do, but from a start too far for the first look.
    if (best && chosen >= usual && all[chosen].kind == NoticeKind::joint_sign)
      for (size_t i = 0; i < common; ++i)
        if (all[i].kind == NoticeKind::joint_sign) try_with_all_samples(i);
  }
  if (!best) return std::nullopt;
  return Explanatory{std::move(all[chosen]), std::move(*best)};
}

std::optional<TwoMistakes> choose_two(const Recording& recording, const TrialContext& context,
                                      const TrialFit& now) {
  const auto plain = [&](const Recording& r, const Stage& stage) {
    std::vector<Hypothesis> out =
        hypotheses(r.rig, r.table, r.samples, freed_names(r.table, stage));
    out.erase(std::remove_if(out.begin(), out.end(),
                             [](const Hypothesis& h) {
                               return h.ignored_joint >= 0 || !h.free.empty() || h.shrinks < 1;
                             }),
              out.end());
    return out;
  };
  const std::vector<Hypothesis> all = plain(recording, context.all);
  std::optional<TwoMistakes> best;
  if (all.size() > kMostForPairs) return best;
  for (const auto& [first_cost, i] :
       shortlist(recording, context, {now, false}, all, 0, all.size())) {
    const Trial one = try_hypothesis(recording, context, all[i], now, {20, 1e-3});
    if (!std::isfinite(one.cost)) continue;
    TrialContext further = context;
    further.all = one.stage;
    further.given_poses_freed = frees_given_poses(one.recording, one.stage);
    std::vector<Hypothesis> others = plain(one.recording, one.stage);
    if (!all[i].squares.empty())
      others.erase(std::remove_if(others.begin(), others.end(),
                                  [](const Hypothesis& h) { return !h.squares.empty(); }),
                   others.end());
    const Question question = {one.fit, false};
    for (const auto& [second_cost, k] :
         shortlist(one.recording, further, question, others, 0, others.size())) {
      Trial two = try_hypothesis(one.recording, further, others[k], one.fit,
                                 {100, 1e-9, false, best ? best->trial.cost : kInfinity});
      if (!(two.cost < (best ? best->trial.cost : kInfinity))) continue;
      best.emplace(TwoMistakes{all[i], others[k], std::move(two)});
    }
  }
  if (!best) return best;
  const double per_dof = best->trial.fit.per_dof();
  const double demanded =
      per_dof < Thresholds::noise ? Thresholds::overwhelming : Thresholds::together;
  const bool enough =
      now.complete() ? now.cost > demanded * best->trial.cost : per_dof < Thresholds::overwhelming;
  if (!enough) best.reset();
  return best;
}

std::optional<Explanatory> choose_by_most(const Recording& recording, const TrialContext& context,
                                          const TrialFit& now) {
  const double as_is = robust_fit(recording, context).typical();
  std::vector<Hypothesis> all = hypotheses(recording.rig, recording.table, recording.samples,
                                           freed_names(recording.table, context.all));
  TrialContext bearing = context;
  bearing.all.loss = Loss{LossKind::cauchy, kBearing};
  const Recording some = recording.with_samples(some_samples(recording, context.all.free.size()));
  std::vector<std::pair<double, size_t>> order;
  for (size_t i = 0; i < all.size(); ++i) {
    context.report(static_cast<int>(i), static_cast<int>(all.size()));
    if (all[i].many || all[i].shrinks < 1 || all[i].told || all[i].ignored_joint >= 0) continue;
    const Trial t = try_hypothesis(some, bearing, all[i], now, {10, 1e-2});
    if (const double typical = t.fit.typical(); std::isfinite(typical))
      order.push_back({typical, i});
  }
  std::sort(order.begin(), order.end());
  if (order.size() > kMostRobust) order.resize(kMostRobust);
  std::optional<Trial> best;
  size_t chosen = 0;
  double least = std::min(Thresholds::overwhelming, as_is / Thresholds::together);
  for (const auto& [_, i] : order) {
    Trial t = try_hypothesis(recording, bearing, all[i], now, {15, 1e-3});
    TrialContext further = context;
    further.all = t.stage;
    further.all.loss = context.all.loss;
    further.given_poses_freed = frees_given_poses(t.recording, t.stage);
    const double typical = robust_fit(t.recording, further).typical();
    if (!(typical < least)) continue;
    t.stage = further.all;
    t.fit = best_fit(t.recording, further, t.stage, {100, 1e-9});
    if (kMostWithout * t.fit.undefined.size() > t.recording.samples.size()) continue;
    least = typical;
    best.emplace(std::move(t));
    chosen = i;
  }
  if (!best) return std::nullopt;
  return Explanatory{std::move(all[chosen]), std::move(*best)};
}

}  // namespace kincal
