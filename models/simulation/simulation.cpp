#include "simulation.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <stdexcept>

#include "../rig/configuration.h"
#include "../rig/random_stream.h"
#include "../rig/selection.h"
#include "../rig/targets.h"
#include "../rig/words.h"
#include "random_postures.h"

namespace kincal {
namespace {

constexpr double kHandHeld = 0.5;  // m

/// Has the posture all readings that place the sensor and the target?
bool has_readings_of(const Rig& rig, const Posture& posture, int sensor, int target) {
  for (int j : needed_readings(rig, sensor, target))
    if (std::isnan(posture.readings[j])) return false;
  return true;
}

/// @throws std::invalid_argument
void check_posture(const Rig& rig, const Posture& posture) {
  const std::string where = "posture " + quoted(posture.id) + ": ";
  if (posture.readings.size() != rig.tree.joints.size())
    throw std::invalid_argument(where + "one reading a joint is expected, NaN for none");
  for (const auto& t : posture.targets)
    if (rig.targets.at(t.first).link >= 0)
      throw std::invalid_argument(where + "target " + quoted(rig.targets[t.first].name) +
                                  " is mounted");
  std::set<int> held;
  for (const SensorTarget& v : posture.views)
    if (is_chain(rig.sensors.at(v.first))) held.insert(v.second);
  for (const SensorTarget& v : posture.views) {
    const Target& target = rig.targets.at(v.second);
    const std::string view = where + "sensor " + quoted(rig.sensors[v.first].name) + ", target " +
                             quoted(target.name) + ": ";
    for (int j : needed_readings(rig, v.first, v.second))
      if (std::isnan(posture.readings[j]))
        throw std::invalid_argument(view + "needs joint " + quoted(rig.tree.joints[j].name) +
                                    ", which the posture lacks");
    if (target.link >= 0) continue;
    if (held.count(v.second) && posture.targets.count(v.second))
      throw std::invalid_argument(view +
                                  "the target is held by a chain, its pose cannot be given too");
    if (!held.count(v.second) && !posture.targets.count(v.second))
      throw std::invalid_argument(
          view + "the target is free: either a chain that holds it or its pose is needed");
  }
}

/// Views of a posture that lists none: one held target in turn if it places none, and all that sees
/// the placed and the mounted ones.
std::vector<SensorTarget> views_of(const Rig& rig, const Posture& posture,
                                   const std::vector<SensorTarget>& pairs, int k) {
  std::vector<SensorTarget> views, holds;
  for (const SensorTarget& p : pairs)
    if (is_chain(rig.sensors[p.first]) && posture.targets.empty() &&
        has_readings_of(rig, posture, p.first, p.second))
      holds.push_back(p);
  if (!holds.empty()) views.push_back(holds[k % holds.size()]);
  for (const SensorTarget& p : pairs) {
    const bool placed = rig.targets[p.second].link >= 0 || posture.targets.count(p.second) ||
                        (!holds.empty() && p.second == views[0].second);
    if (!is_chain(rig.sensors[p.first]) && placed &&
        has_readings_of(rig, posture, p.first, p.second))
      views.push_back(p);
  }
  return views;
}

/// Of equals the first.
std::string most_frequent(const std::vector<std::string>& reasons) {
  std::string out = "no sensor has the readings that it needs";
  std::ptrdiff_t most = 0;
  for (const std::string& reason : reasons)
    if (const auto n = std::count(reasons.begin(), reasons.end(), reason); n > most) {
      most = n;
      out = reason;
    }
  return out;
}

void check_truth(const ParameterTable& table, const VectorXd& truth) {
  if (truth.size() != table.initial.size())
    throw std::invalid_argument("the truth has a different number of values than the rig");
  for (const Parameter& p : table.all)
    for (int c = 0; c < p.size(); ++c)
      if (const char* why = improper_value(p, c, truth(p.start + c)))
        throw std::invalid_argument("the true " + p.component_name(c) + " is " +
                                    std::to_string(truth(p.start + c)) + "; " + why);
}

}  // namespace

VectorXd draw_truth(const ParameterTable& table, const std::vector<Spread>& spread,
                    std::uint64_t seed) {
  std::vector<std::vector<double>> sigma;
  for (const Parameter& p : table.all) sigma.emplace_back(p.size(), 0.0);
  for (const Spread& s : spread) {
    if (!(s.sigma >= 0 && std::isfinite(s.sigma)))
      throw std::invalid_argument("spread of '" + s.pattern +
                                  "': a number of at least 0 is expected");
    const std::vector<Freed> found =
        table.find(s.pattern, "spread[" + std::to_string(&s - spread.data()) + "]");
    for (const Freed& f : found)
      for (int c : f.components) sigma[f.parameter][c] = s.sigma;
  }
  VectorXd truth = table.initial;
  RandomStream draws(seed, kTruthStream);
  for (size_t i = 0; i < table.all.size(); ++i) {
    const Parameter& p = table.all[i];
    if (p.hidden()) continue;
    VectorXd moved(p.size());
    for (int c = 0; c < p.size(); ++c) moved(c) = sigma[i][c] * draws.normal();
    if (p.pose && !moved.isZero(0))
      set_pose(truth, p.start, get_pose(truth, p.start) * exp_se3(moved));
    else if (!p.pose)
      truth.segment(p.start, p.size()) += moved;
  }
  check_truth(table, truth);
  return truth;
}

std::vector<std::pair<int, int>> usual_pairs(const Rig& rig) {
  bool boards = false, points = false, small = false;
  const auto holdable = [](const Target& t) { return t.link < 0 && !on_a_line(target_points(t)); };
  const auto is_small = [](const Target& t) { return extent(target_points(t)) <= kHandHeld; };
  for (const Target& t : rig.targets) {
    boards = boards || t.grid;
    points = points || !t.grid;
    small = small || (holdable(t) && is_small(t));
  }
  std::vector<SensorTarget> pairs;
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    for (size_t t = 0; t < rig.targets.size(); ++t) {
      const Target& target = rig.targets[t];
      bool fits = true;
      switch (rig.sensors[s].model->measurement_kind()) {
        case MeasurementKind::chain:
          fits = holdable(target) && (is_small(target) || !small);
          break;
        case MeasurementKind::rays:
        case MeasurementKind::scan:
          fits = target.grid || !boards;
          break;
        case MeasurementKind::points:
          fits = !target.grid || !points;
          break;
        default:
          break;
      }
      if (fits) pairs.push_back({static_cast<int>(s), static_cast<int>(t)});
    }
  return pairs;
}

Simulation simulate(const Rig& rig, const ParameterTable& table, const VectorXd& truth,
                    const SimulationOptions& options) {
  if (options.samples < 1) throw std::invalid_argument("at least one sample is expected");
  check_truth(table, truth);
  for (const Sensor& s : rig.sensors) {
    const SensorModel& m = *s.model;
    const bool known = m.measurement_kind() == MeasurementKind::chain ||
                       m.measurement_kind() == MeasurementKind::pose ||
                       m.measurement_kind() == MeasurementKind::scan;
    if (!known && (m.measures_pose() || m.has_own_noise() || m.measurement_size() != m.rows()))
      throw std::invalid_argument("sensor " + quoted(s.name) + ": sensors of type " +
                                  quoted(s.type) + " cannot be simulated");
    if (static_cast<int>(s.sigma.size()) != m.sigmas())
      throw std::invalid_argument("sensor " + quoted(s.name) + ": it needs " +
                                  std::to_string(m.sigmas()) + " sigmas");
  }
  Simulation out;
  out.truth = truth;
  const World world(rig, table, truth);
  const std::vector<SensorTarget> pairs = options.pairs.empty() ? usual_pairs(rig) : options.pairs;
  std::vector<char> busy(rig.sensors.size(), 0);
  std::optional<RandomPostures> random;
  if (options.postures.empty()) random.emplace(rig, world, pairs, options.seed, options.samples);
  for (const Posture& posture : options.postures) check_posture(rig, posture);

  std::set<std::string> ids;
  for (const Posture& posture : options.postures) ids.insert(posture.id);
  for (int k = 0; k < options.samples; ++k) {
    try {
      options.progress.share(k, options.samples);
    } catch (const Cancelled&) {
      break;
    }
    Draft draft;
    if (random) {
      draft = random->next(k);
    } else {
      const size_t count = options.postures.size();
      Posture posture = options.postures[k % count];
      if (k >= static_cast<int>(count)) {  // once more, with new noise
        const std::string id = posture.id + "_" + std::to_string(k / count + 1);
        for (posture.id = id; !ids.insert(posture.id).second;) posture.id += "_";
      }
      if (posture.conditions.empty()) posture.conditions = draw_conditions(rig, options.seed, k);
      const bool listed = !posture.views.empty();
      draft = world.carry_out(
          posture, listed ? posture.views : views_of(rig, posture, pairs, k), listed,
          RandomStream(options.seed, kFirstSampleStream + static_cast<std::uint64_t>(k)));
    }
    out.dropped.insert(out.dropped.end(), draft.dropped.begin(), draft.dropped.end());
    if (draft.sample.views.empty()) {
      ++out.left_out[most_frequent(draft.unseen)];
      continue;
    }
    for (const View& v : draft.sample.views) {
      busy[v.sensor] = 1;
      if (rig.targets[v.target].link < 0)
        out.targets[{static_cast<int>(out.samples.size()), v.target}] = draft.targets.at(v.target);
    }
    out.samples.push_back(std::move(draft.sample));
    out.true_readings.push_back(std::move(draft.readings));
  }
  if (random) out.trials = random->trials();
  for (size_t s = 0; s < busy.size(); ++s)
    if (!busy[s]) out.idle.push_back(static_cast<int>(s));
  return out;
}

}  // namespace kincal
