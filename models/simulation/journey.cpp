#include "journey.h"

#include <algorithm>
#include <cmath>

#include "../rig/configuration.h"

namespace kincal {
namespace {

double on_the_way(double from, double to, double share) {
  return share == 0 ? from : share == 1 ? to : from + share * (to - from);
}

Pose on_the_way(const Pose& from, const Pose& to, double share) {
  return from * exp_se3(share * log_se3(inverse(from) * to));
}

}  // namespace

Journey::Phase Journey::phase(double time) const {
  const double period = options_.rest + options_.move,
               last = static_cast<double>(stops_.size()) - 1;
  const double at = std::min(last, std::max(0., std::floor(time / period)));
  const double u = std::min(1., std::max(0., (time - at * period - options_.rest) / options_.move));
  const auto stop = static_cast<size_t>(at);
  return {stop, std::min(stop + 1, stops_.size() - 1), u * u * u * (10 + u * (-15 + u * 6))};
}

int Journey::resting(double time) const {
  const Phase p = phase(time);
  return p.from == p.to || p.share == 0 ? static_cast<int>(p.from)
         : p.share == 1                 ? static_cast<int>(p.to)
                                        : -1;
}

Posture Journey::at(double time) const {
  const Phase p = phase(time);
  const Stop &from = stops_[p.from], &to = stops_[p.to];
  if (p.from == p.to || p.share == 0) return from.truth;
  if (p.share == 1) return to.truth;
  Posture out;
  out.id = from.truth.id + " to " + to.truth.id;
  for (size_t j = 0; j < from.truth.readings.size(); ++j)
    out.readings.push_back(on_the_way(from.truth.readings[j], to.truth.readings[j], p.share));
  for (const auto& [target, before] : from.truth.targets) {
    const auto after = to.truth.targets.find(target);
    if (after == to.truth.targets.end()) continue;
    const auto holder = from.holders.find(target), next = to.holders.find(target);
    if (holder == from.holders.end() || next == to.holders.end() ||
        holder->second != next->second) {
      out.targets[target] = on_the_way(before, after->second, p.share);
      continue;
    }
    const auto base_T_chain = [&](const std::vector<double>& readings) {
      return Configuration(rig_, table_, truth_, readings).base_T_sensor(holder->second);
    };
    out.targets[target] =
        base_T_chain(out.readings) *
        on_the_way(inverse(base_T_chain(from.truth.readings)) * before,
                   inverse(base_T_chain(to.truth.readings)) * after->second, p.share);
  }
  return out;
}

std::vector<double> Journey::logged(double time, RandomStream& draws) const {
  const Phase p = phase(time);
  std::vector<double> out;
  for (size_t j = 0; j < rig_.joints.size(); ++j)
    out.push_back(on_the_way(stops_[p.from].logged[j], stops_[p.to].logged[j], p.share) +
                  options_.scatter * rig_.joints[j].sigma * draws.normal());
  return out;
}

}  // namespace kincal
