#include "suspects.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <stdexcept>

#include "../estimation/estimation.h"
#include "../fitting/starts.h"
#include "../rig/targets.h"
#include "../rig/words.h"

namespace kincal {
namespace {

/// Median of the finite numbers; NaN: there is none.
double median_of_finite(std::vector<double> numbers) {
  numbers.erase(
      std::remove_if(numbers.begin(), numbers.end(), [](double x) { return !std::isfinite(x); }),
      numbers.end());
  return median(std::move(numbers));
}

/// Whether each of these samples has no more than one point: nothing tells then whether it is the
/// point that is wrong, or the readings.
bool single_points(const std::vector<Sample>& samples, const std::set<std::string>& ids) {
  return std::all_of(samples.begin(), samples.end(), [&](const Sample& s) {
    return !ids.count(s.id) || (s.views.size() == 1 && s.views[0].ids.size() == 1);
  });
}

}  // namespace

TrialFit robust_fit(const Recording& recording, const TrialContext& context) {
  TrialOptions o;
  o.iterations = 15;
  o.relative_decrease = 1e-3;
  o.loss = Loss{LossKind::cauchy, 3, true};
  TrialFit out;
  double least = kInfinity;
  for (bool closed_form : {false, true}) {
    if (closed_form && !context.given_poses_freed) break;
    o.closed_form = closed_form;
    TrialFit trial = trial_fit(recording, context, {context.all}, o);
    const double typical = median_of_finite(trial.sample);
    if (!(typical < least)) continue;
    least = typical;
    out = std::move(trial);
  }
  return out;
}

std::optional<Hypothesis> bad_samples(const Recording& recording, const TrialContext& context,
                                      const TrialFit& robust) {
  const Rig& rig = recording.rig;
  if (recording.samples.size() < 4 || robust.sample.empty()) return std::nullopt;
  const double typical = median_of_finite(robust.sample);
  if (!std::isfinite(typical)) return std::nullopt;
  const double limit = Thresholds::sample_excess * std::max(1.0, typical);
  std::set<std::string> bad;
  for (size_t i = 0; i < recording.samples.size(); ++i)
    if ((robust.sample[i] > limit && robust.trimmed[i] > 0.2 * Thresholds::sample_excess) ||
        std::count(robust.undefined.begin(), robust.undefined.end(), static_cast<int>(i)))
      bad.insert(recording.samples[i].id);
  if (bad.empty() || bad.size() > Thresholds::most_bad * recording.samples.size())
    return std::nullopt;
  // A fit is free to contradict a sample that it lacks: samples that fit once they are back come
  // back.
  std::vector<std::pair<double, int>> order;
  for (size_t i = 0; i < recording.samples.size(); ++i)
    if (bad.count(recording.samples[i].id))
      order.push_back(
          {std::isfinite(robust.sample[i]) ? robust.sample[i] : kInfinity, static_cast<int>(i)});
  std::sort(order.begin(), order.end());
  const auto without_bad = [&](double give_up) {
    std::vector<Sample> rest = recording.samples;
    for (Sample& s : rest)
      if (bad.count(s.id)) s.views.clear();
    TrialOptions o;
    o.iterations = 40;
    o.relative_decrease = 1e-3;
    o.start = &robust.values;
    o.give_up = give_up;
    return trial_fit(recording.with_samples(std::move(rest)), context, {context.all}, o);
  };
  const TrialFit rest = without_bad(kInfinity);
  double per_dof = rest.per_dof();
  int refused = 0;
  for (size_t i = 0; i < order.size() && refused < 3; ++i) {
    const std::string& id = recording.samples[order[i].second].id;
    bad.erase(id);
    const TrialFit with = without_bad(4 * std::max(1.0, per_dof) * static_cast<double>(rest.dof));
    if (with.per_dof() < 2 * std::max(1.0, per_dof) &&
        with.sample[order[i].second] < Thresholds::sample_excess * std::max(1.0, per_dof)) {
      per_dof = with.per_dof();
    } else {
      bad.insert(id);
      ++refused;
    }
  }
  if (bad.empty()) return std::nullopt;
  for (size_t s = 0; s < rig.sensors.size();
       ++s) {  // all that a sensor sees: something is wrong with that sensor or with what it sees
    bool seen = false, left = false;
    for (const Sample& sample : recording.samples)
      for (const View& v : sample.views)
        if (v.sensor == static_cast<int>(s)) seen = true, left = left || !bad.count(sample.id);
    if (seen && !left) return std::nullopt;
  }
  Hypothesis h{NoticeKind::bad_samples, subjects(Subject::Kind::sample, {bad.begin(), bad.end()})};
  h.leaves_out = true;
  const bool one = bad.size() == 1;
  if (single_points(recording.samples, bad)) {
    h.mistake = std::string(one ? "sample " : "samples ") + joined(names_of(h.where)) +
                (one ? " contradicts" : " contradict") +
                " all others: the measured point is wrong, or the joint readings are of another "
                "moment";
    h.cure = one ? "leave it out (`reject` does), or measure it again"
                 : "leave them out (`reject` does), or measure them again";
  } else {
    h.mistake = (one ? "the joint readings of sample " : "the joint readings of samples ") +
                joined(names_of(h.where)) + " do not belong to " + (one ? "its" : "their") +
                " views";
    h.cure = one ? "leave it out, or find its readings" : "leave them out, or find their readings";
  }
  h.undo = [bad](Rig&, std::vector<Sample>& samples) {
    samples.erase(std::remove_if(samples.begin(), samples.end(),
                                 [&](const Sample& s) { return bad.count(s.id) > 0; }),
                  samples.end());
  };
  return h;
}

namespace {

/// A point of a view that lies far from where everything else says it is.
struct FarPoint {
  int sample, place;  // place of the point in the view
  const View* view;
  double whitened, raw;  // in sigmas, in units of the sensor
};

constexpr int kFewPoints = 4;  // of views with fewer all of a sensor and sample count as one

/// Points at more than `Thresholds::far_point` times their sigma (and what the others show), in
/// views of which most points are near. `points`: how many there are in all.
std::vector<FarPoint> far_points(const Recording& recording, const TrialContext& context,
                                 const TrialFit& robust, size_t& points) {
  std::vector<FarPoint> out;
  points = 0;
  std::vector<int> samples;
  for (size_t i = 0; i < robust.sample.size(); ++i)
    if (std::isfinite(robust.sample[i])) samples.push_back(static_cast<int>(i));
  if (samples.empty() || robust.values.shared.size() != recording.table.initial.size()) return out;
  EstimationSetup setup;
  setup.noise = context.noise;
  setup.sensors = context.all.sensors;
  Estimation problem(recording, samples, setup);
  const VectorXd state = problem.pack(robust.values);
  problem.renew(state);
  const std::vector<ViewResiduals> residuals = problem.residuals(state);
  std::vector<double> sizes;
  std::map<std::pair<int, int>, std::vector<FarPoint>> views;  // small ones: all of a sensor's
  for (const ViewResiduals& r : residuals) {
    const SensorModel& model = *recording.rig.sensors[r.view->sensor].model;
    const Eigen::Index count = static_cast<Eigen::Index>(r.view->ids.size());
    if (model.measures_pose() || count == 0 || r.raw.size() % count != 0 ||
        r.whitened.size() % count != 0)
      continue;
    const Eigen::Index rows = r.whitened.size() / count, raw = r.raw.size() / count;
    const bool small = count < kFewPoints;
    std::vector<FarPoint>& view = views[{
        r.sample, small ? -1 - r.view->sensor
                        : static_cast<int>(r.view - recording.samples[r.sample].views.data())}];
    for (Eigen::Index k = 0; k < count; ++k) {
      const double size = r.whitened.segment(k * rows, rows).norm();
      view.push_back({r.sample, static_cast<int>(k), r.view, std::isfinite(size) ? size : kInfinity,
                      r.raw.segment(k * raw, raw).norm()});
    }
  }
  for (auto v = views.begin(); v != views.end();) {
    if (v->second.size() < kFewPoints - 1) {
      v = views.erase(v);
      continue;
    }
    for (const FarPoint& p : v->second) sizes.push_back(p.whitened);
    ++v;
  }
  points = sizes.size();
  const double limit = Thresholds::far_point * std::max(1.0, median(std::move(sizes), 1.0));
  for (const auto& view : views) {
    std::vector<FarPoint> far;
    std::copy_if(view.second.begin(), view.second.end(), std::back_inserter(far),
                 [&](const FarPoint& p) { return p.whitened > limit; });
    if (3 * far.size() <= view.second.size()) out.insert(out.end(), far.begin(), far.end());
  }
  return out;
}

/// The view without the points at these places, ascending.
void leave_out(const std::vector<int>& places, View& view) {
  const auto numbers = static_cast<std::ptrdiff_t>(view.z.size() / view.ids.size());
  for (auto p = places.rbegin(); p != places.rend(); ++p) {
    view.z.erase(view.z.begin() + *p * numbers, view.z.begin() + (*p + 1) * numbers);
    if (view.covariance.size() == view.ids.size())
      view.covariance.erase(view.covariance.begin() + *p);
    view.ids.own().erase(view.ids.own().begin() + *p);
  }
}

}  // namespace

std::optional<Hypothesis> outlier_points(const Recording& recording, const TrialContext& context,
                                         const TrialFit& robust) {
  size_t points = 0;
  std::vector<FarPoint> far = far_points(recording, context, robust, points);
  if (far.empty() || static_cast<double>(far.size()) > Thresholds::most_far * points)
    return std::nullopt;
  std::map<std::pair<std::string, int>, std::vector<int>> out;  // sample, place of its view
  std::vector<std::string> samples;
  for (const FarPoint& p : far) {
    const Sample& sample = recording.samples[p.sample];
    out[{sample.id, static_cast<int>(p.view - sample.views.data())}].push_back(p.place);
    if (samples.empty() || samples.back() != sample.id) samples.push_back(sample.id);
  }
  std::sort(samples.begin(), samples.end());
  samples.erase(std::unique(samples.begin(), samples.end()), samples.end());
  std::sort(far.begin(), far.end(),
            [](const FarPoint& a, const FarPoint& b) { return a.whitened > b.whitened; });
  const FarPoint& worst = far.front();
  const Sensor& sensor = recording.rig.sensors[worst.view->sensor];
  const bool pixels = sensor.model->measurement_kind() == MeasurementKind::rays;
  Hypothesis h{NoticeKind::outlier_points, subjects(Subject::Kind::sample, samples)};
  h.leaves_out = true;
  h.mistake = std::to_string(far.size()) + " of " + std::to_string(points) +
              (far.size() == 1 ? " points lies" : " points lie") +
              " far off in views that are good otherwise (" + std::to_string(out.size()) +
              (out.size() == 1 ? " view, sample" : " views, sample") +
              (samples.size() == 1 ? " " : "s ") + joined(samples) + "), worst point " +
              std::to_string(worst.view->ids[worst.place]) + " of target " +
              quoted(recording.rig.targets[worst.view->target].name) + " by sensor " +
              quoted(sensor.name) + " in sample " + quoted(recording.samples[worst.sample].id) +
              (pixels ? text(": %.3g px", worst.raw) : text(": %.3g sigmas", worst.whitened));
  h.cure =
      "remove these points from the samples, or let calibrate do it (`reject`), or give the steps "
      "a robust loss (loss: {huber: 3}; {cauchy: 3, scale: data} if many are far off)";
  h.undo = [out](Rig& rig, std::vector<Sample>& all) {
    const auto emptied = [&](const View& v) {
      return v.ids.empty() && !rig.sensors[v.sensor].model->measures_pose();
    };
    for (Sample& sample : all) {
      for (size_t v = 0; v < sample.views.size(); ++v)
        if (const auto p = out.find({sample.id, static_cast<int>(v)}); p != out.end())
          leave_out(p->second, sample.views[v]);
      sample.views.erase(std::remove_if(sample.views.begin(), sample.views.end(), emptied),
                         sample.views.end());
    }
  };
  return h;
}

namespace {

/// What half a turn of a view may be of: the numbers of its points, its picture, or a picture whose
/// corners were numbered as it stands.
enum class HalfTurn { numbers, picture, both };

/// Whether there is such a turn of a view.
bool can_turn(const Rig& rig, const View& view, HalfTurn what) {
  const Sensor& sensor = rig.sensors[view.sensor];
  if (sensor.model->measures_pose()) return false;
  if (what != HalfTurn::picture &&
      relabeling(rig.targets[view.target], -Eigen::Matrix2d::Identity()).empty())
    return false;
  return what == HalfTurn::numbers ||
         (sensor.type == "camera" && sensor.image_width > 0 && sensor.image_height > 0);
}

void turn_half(const Rig& rig, HalfTurn what, View& view) {
  const Target& target = rig.targets[view.target];
  if (what != HalfTurn::picture)
    relabel(view, target, relabeling(target, -Eigen::Matrix2d::Identity()));
  if (what == HalfTurn::numbers) return;
  const Sensor& camera = rig.sensors[view.sensor];
  for (size_t k = 0; k < view.z.size(); ++k)
    view.z[k] = (k % 2 ? camera.image_height : camera.image_width) - 1 - view.z[k];
}

using TurnedViews = std::set<std::pair<std::string, int>>;  // sample, place of the view

Hypothesis turned_hypothesis(const Recording& recording, HalfTurn what, const TurnedViews& turned) {
  std::set<std::string> sensors, samples;
  for (const Sample& sample : recording.samples)
    for (size_t v = 0; v < sample.views.size(); ++v)
      if (turned.count({sample.id, static_cast<int>(v)})) {
        sensors.insert(recording.rig.sensors[sample.views[v].sensor].name);
        samples.insert(sample.id);
      }
  const bool one = turned.size() == 1;
  Hypothesis h;
  h.kind = what == HalfTurn::numbers ? NoticeKind::numbering : NoticeKind::turned_picture;
  h.where = subjects(Subject::Kind::sensor, {sensors.begin(), sensors.end()});
  for (const std::string& sample : samples) h.where.push_back(Subject::sample(sample));
  const std::string count = std::to_string(turned.size()),
                    of = joined({sensors.begin(), sensors.end()}),
                    which = std::string(": sample") + (samples.size() > 1 ? "s " : " ") +
                            joined({samples.begin(), samples.end()});
  if (what == HalfTurn::numbers) {
    h.mistake = count + (one ? " view of " : " views of ") + of +
                (one ? " numbers its board" : " number their boards") +
                " from the opposite corner (half a turn)" + which;
    h.cure = "reverse the order of the points in these views";
  } else {
    h.mistake = count + (one ? " picture of " : " pictures of ") + of + (one ? " is" : " are") +
                " turned by 180 degrees against the others" + which;
    h.cure =
        "turn " + std::string(one ? "it" : "them") +
        " back and detect again, or replace u and v there by width - 1 - u and height - 1 - v" +
        (what == HalfTurn::both ? ", and reverse the order of the points" : "");
  }
  h.undo = [turned, what](Rig& rig, std::vector<Sample>& all) {
    for (Sample& sample : all)
      for (size_t v = 0; v < sample.views.size(); ++v)
        if (turned.count({sample.id, static_cast<int>(v)})) turn_half(rig, what, sample.views[v]);
  };
  return h;
}

}  // namespace

std::vector<Hypothesis> turned_views(const Recording& recording, const TrialFit& robust) {
  if (!(median_of_finite(robust.sample) < Thresholds::sample_excess))
    return {};  // most samples fit nothing: there is no consensus to ask
  const Rig& rig = recording.rig;
  const std::vector<int> sensors = indices(rig.sensors.size());
  if (robust.values.shared.size() != recording.table.initial.size()) return {};
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  setup.sensors = sensors;
  setup.loss = {LossKind::soft_l1, 3};
  const auto cost_of = [&](const Sample& sample, StartEffort effort) {
    const Recording one = recording.with_samples({sample});
    Values values;
    values.shared = robust.values.shared;
    try {
      start_targets(one, {0}, sensors, setup.loss, values, {effort});
    } catch (const std::runtime_error&) {
      return kInfinity;
    }
    Estimation problem(one, {0}, setup);
    const VectorXd state = problem.pack(values);
    problem.renew(state);
    Cost cost;
    return !problem.empty() && problem.evaluate(0, state, 0, cost) && std::isfinite(cost.doubled)
               ? cost.doubled
               : kInfinity;
  };
  std::map<HalfTurn, TurnedViews> turned;
  std::map<HalfTurn, size_t> views;
  for (size_t i = 0; i < recording.samples.size(); ++i) {
    const Sample& sample = recording.samples[i];
    std::map<HalfTurn, std::vector<std::vector<int>>>
        sets;  // of views: each alone, all of a target
    for (const HalfTurn what : {HalfTurn::numbers, HalfTurn::picture, HalfTurn::both}) {
      std::map<int, std::vector<int>> by_target;
      for (size_t v = 0; v < sample.views.size(); ++v) {
        if (!can_turn(rig, sample.views[v], what)) continue;
        ++views[what];
        sets[what].push_back({static_cast<int>(v)});
        by_target[sample.views[v].target].push_back(static_cast<int>(v));
      }
      for (const auto& t : by_target)
        if (t.second.size() > 1) sets[what].push_back(t.second);
    }
    if (sets.empty() || robust.sample[i] < Thresholds::good) continue;
    const double now = cost_of(sample, StartEffort::refined);
    if (now < 50) continue;
    // What a proposed pose leaves of a view that is numbered right is what its own noise makes of
    // other views; refined it is less. What leaves more than there is now is numbered worse.
    for (const auto& [what, of_views] : sets) {
      double least = now / Thresholds::decisive;
      std::vector<int> best;
      for (const std::vector<int>& set : of_views) {
        Sample trial = sample;
        for (int v : set) turn_half(rig, what, trial.views[v]);
        if (cost_of(trial, StartEffort::proposed) > 2 * now) continue;
        const double cost = cost_of(trial, StartEffort::refined);
        if (cost < least) least = cost, best = set;
      }
      for (int v : best) turned[what].insert({sample.id, v});
    }
  }
  std::vector<Hypothesis> out;
  for (const auto& [what, of_samples] : turned)
    if (of_samples.size() < views[what])
      out.push_back(turned_hypothesis(recording, what, of_samples));
  return out;
}

}  // namespace kincal
