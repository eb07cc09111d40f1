#include "alternatives.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/selection.h"

namespace kincal {
namespace {

// Log density of a residual that is left out, against the peak of a normal one; the mean of that of
// a residual that is kept.
const double kAnywhere = std::log(Thresholds::anywhere / std::sqrt(2 * kPi)), kOfAKept = 0.5;
constexpr double kMovesAs = 6;        // degrees of freedom of a rigid motion
constexpr double kRoughNumbers = 12;  // of a view: six of where its target is, six of the rest

/// Whether a hypothesis frees this parameter because it may be anywhere.
bool is_sought(const ParameterTable& table, int parameter, const Hypothesis* h) {
  if (!h) return false;
  const Parameter& p = table.all[parameter];
  if (p.kind == ParameterKind::square && std::count(h->squares.begin(), h->squares.end(), p.owner))
    return true;
  return std::any_of(h->free.begin(), h->free.end(),
                     [&](const std::string& name) { return name.rfind(p.name, 0) == 0; });
}

/// The log density of parameters that the steps free without a prior, where they came out.
double log_moved(const Recording& recording, const TrialFit& fit, const Hypothesis* h) {
  const ParameterTable& table = recording.table;
  double out = is_impossible(recording, fit) ? Thresholds::impossible : 0;
  for (const Freed& freed : fit.setup.free) {
    const Parameter& p = table.all[freed.parameter];
    if (p.pose) {
      if (!freed.whole(p)) continue;
      if (!is_given(recording.rig, p)) {  // (3 + 1) / 2
        out -= 2 * std::log1p(get_pose(fit.values.shared, p.start).translation.squaredNorm());
        continue;
      }
      const Pose change =
          inverse(get_pose(table.initial, p.start)) * get_pose(fit.values.shared, p.start);
      const double moved = change.translation.squaredNorm() /
                           (Thresholds::pose_near * Thresholds::pose_near),
                   turned = log_so3(change.rotation).squaredNorm() /
                            (Thresholds::turn_near * Thresholds::turn_near);
      out -= 3.5 * std::log1p(moved + turned);  // (1 + 6) / 2
      continue;
    }
    const bool sought = is_sought(table, freed.parameter, h);
    for (const int c : freed.components) {
      if (std::any_of(fit.setup.priors.begin(), fit.setup.priors.end(), [&](const Prior& prior) {
            return prior.parameter == freed.parameter && prior.component == c;
          }))
        continue;
      const double usual = scales(table, {freed.parameter, c}, table.initial).usual,
                   d = (fit.values.shared(p.start + c) - table.initial(p.start + c)) / usual;
      if (usual > 0) out -= sought ? std::log1p(d * d) : 2 * std::log1p(d * d / 3);
    }
  }
  return out;
}

/// What an effective residual of a sensor's view adds that is kept.
double of_a_residual(const Hypothesis* h, int sensor) {
  return kOfAKept + (h && h->rescaled == sensor ? std::log(h->factor) : 0);
}

double log_with_units(const ModelEvidence& found, const Hypothesis* h) {
  double out = found.log;
  for (size_t k = 0; k < found.kinds.size(); ++k)
    if (const int sensor = found.kinds[k].sensor; sensor >= 0)
      out += found.numbers(static_cast<Eigen::Index>(k)) * of_a_residual(h, sensor);
  return out;
}

double rough_numbers(const Recording& recording, const View& v) {
  const SensorModel& model = *recording.rig.sensors[v.sensor].model;
  const size_t points = model.measures_pose() ? 1 : v.ids.size();
  return std::min(kRoughNumbers, model.rows() * static_cast<double>(points));
}
double rough_numbers(const Recording& recording, const Sample& sample) {
  double out = 0;
  for (const View& v : sample.views) out += rough_numbers(recording, v);
  return out;
}

/// The residuals that a fit leaves out: six for the views of a target from one body in a sample (a
/// rigid motion), twice the points of a view that keeps others.
double left_out(const Recording& given, const Recording& kept, const std::vector<int>& fitted) {
  std::map<std::string, const Sample*> by_id;
  for (const int s : fitted) by_id[kept.samples[s].id] = &kept.samples[s];
  double out = 0;
  for (const Sample& sample : given.samples) {
    if (sample.views.empty()) continue;
    const auto found = by_id.find(sample.id);
    if (found == by_id.end() || found->second->views.empty()) {
      std::map<std::pair<int, int>, double> apart;  // sensors of one body see a target alike
      for (const View& v : sample.views) {
        double& numbers =
            apart[{immobile_body(given.rig.tree, given.rig.sensors[v.sensor].link), v.target}];
        numbers = std::min(kMovesAs, numbers + rough_numbers(given, v));
      }
      for (const auto& entry : apart) out += entry.second;
      continue;
    }
    const std::vector<View>& views = found->second->views;
    const bool all_kept = views.size() == sample.views.size();  // if of another target
    for (size_t k = 0; k < sample.views.size(); ++k) {
      const View& v = sample.views[k];
      const auto same = all_kept ? views.begin() + static_cast<std::ptrdiff_t>(k)
                                 : std::find_if(views.begin(), views.end(), [&](const View& o) {
                                     return o.sensor == v.sensor && o.target == v.target;
                                   });
      const double points = static_cast<double>(v.ids.size()) -
                            static_cast<double>(same == views.end() ? 0 : same->ids.size());
      out += same == views.end() ? std::min(kMovesAs, rough_numbers(given, v))
                                 : std::clamp(2 * points, 0.0, 2 * kMovesAs);
    }
  }
  return out;
}

}  // namespace

bool is_impossible(const Recording& recording, const TrialFit& fit) {
  const ParameterTable& table = recording.table;
  return std::any_of(fit.setup.free.begin(), fit.setup.free.end(), [&](const Freed& freed) {
    const Parameter& p = table.all[freed.parameter];
    return p.kind == ParameterKind::intrinsics &&
           std::any_of(freed.components.begin(), freed.components.end(), [&](int c) {
             return std::abs(fit.values.shared(p.start + c) - table.initial(p.start + c)) >
                    std::abs(table.initial(p.start));
           });
  });
}

std::optional<FreerFit> fit_with_usual_errors(const Recording& recording,
                                              const TrialContext& context, const FitSpec& spec,
                                              const TrialFit& fit,
                                              const std::vector<std::string>& as_stated) {
  TrialOptions options;
  options.iterations = 30;
  options.relative_decrease = 1e-6;
  options.start = &fit.values;
  options.loss = Loss();
  FreerFit out;
  out.fit = trial_fit(recording, context, {with_usual_errors(recording, spec, as_stated)}, options);
  if (!std::isfinite(out.fit.chi2) || out.fit.samples.empty()) return std::nullopt;
  out.evidence = evidence({{recording, out.fit.samples, out.fit.setup, out.fit.values}});
  if (!std::isfinite(out.evidence.log)) return std::nullopt;
  return out;
}

double precision(double log_odds) {
  constexpr double kOfEnds = 2e-3, kLeast = 2;  // of what a mistake explains; nats
  return kLeast + kOfEnds * std::max(0.0, log_odds);
}

double log_prior(bool rarer, size_t alike) {
  return std::log((rarer ? Thresholds::rarer : Thresholds::of_a_kind) /
                  static_cast<double>(std::max<size_t>(1, alike)));
}

double log_left_out(const Recording& given, const Recording& kept, const TrialFit& fit) {
  const double noise = std::log(std::max(1.0, std::isfinite(fit.per_dof()) ? fit.per_dof() : 1.0));
  double more = 0;  // effective residuals, each of this noise
  for (const Sample& sample : given.samples) more += rough_numbers(given, sample);
  for (const int s : fit.samples) more -= rough_numbers(kept, kept.samples[s]);
  return -kAnywhere * left_out(given, kept, fit.samples) - noise / 2 * more;
}

double log_evidence(const Recording& recording, const TrialContext& context, const FitSpec& spec,
                    const TrialFit& fit, const Hypothesis* h,
                    const std::vector<std::string>& as_stated) {
  const std::optional<FreerFit> freer =
      fit_with_usual_errors(recording, context, spec, fit, as_stated);
  if (!freer) return -kInfinity;
  return log_with_units(freer->evidence, h) + log_moved(recording, freer->fit, h);
}

double log_evidence_either_way(const Recording& recording, const TrialContext& context,
                               const TrialFit& fit) {
  return std::max(log_evidence(recording, context, context.all, fit),
                  log_evidence(recording, context, context.all, fit, nullptr, {"*"}));
}

namespace {

/// Parts and their fits, as the evidence wants them; empty: one has no fit.
std::vector<FittedData> data_of(const std::vector<FittedPart>& parts) {
  std::vector<FittedData> out;
  for (const FittedPart& part : parts) {
    const TrialFit& fit = part.fit;
    if (!std::isfinite(fit.chi2) || fit.samples.empty()) return {};
    out.push_back({part.recording, fit.samples, fit.setup, fit.values});
  }
  return out;
}

/// Not finite: a part has no complete fit.
double per_dof(const std::vector<FittedPart>& parts) {
  double chi2 = 0, dof = 0;
  for (const FittedPart& part : parts) {
    chi2 += part.fit.complete() ? part.fit.chi2 : kInfinity;
    dof += static_cast<double>(part.fit.dof);
  }
  return chi2 / std::max(1.0, dof);
}

double log_moved(const std::vector<FittedPart>& parts) {
  double out = 0;
  for (const FittedPart& part : parts) out += log_moved(part.recording, part.fit, nullptr);
  return out;
}

}  // namespace

std::optional<EvidenceApart> evidence_apart(const std::vector<FittedPart>& parts) {
  const std::vector<FittedData> data = data_of(parts);
  if (data.empty()) return std::nullopt;
  EvidenceApart out{0, evidence(data)};
  if (!std::isfinite(out.noise.log)) return std::nullopt;
  out.log = log_with_units(out.noise, nullptr) + log_moved(parts);
  return out;
}

double log_evidence_at(const std::vector<FittedPart>& parts, const ModelEvidence& noise) {
  const std::vector<FittedData> data = data_of(parts);
  const double log = data.empty() ? kNan : log_evidence_at(data, noise);
  return std::isfinite(log) ? log + log_moved(parts) : -kInfinity;
}

double log_by_chance(const std::vector<FittedPart>& with, const std::vector<FittedPart>& without,
                     const Subjects& about) {
  const double left_with = per_dof(with), left = per_dof(without);
  if (!std::isfinite(left_with) || left < Thresholds::noise) return 0;
  std::map<std::string, double> squares;  // mean squares by sample
  for (const FittedPart& part : without)
    for (size_t i = 0; i < part.fit.sample.size(); ++i)
      squares[part.recording.samples[i].id] = part.fit.sample[i];
  std::map<bool, std::pair<Mean, Mean>> gains;  // and their squares, by whether it is about them
  for (const FittedPart& part : with)
    for (size_t i = 0; i < part.fit.sample.size(); ++i) {
      const Sample& sample = part.recording.samples[i];
      const auto other = squares.find(sample.id);
      if (other == squares.end() || !std::isfinite(part.fit.sample[i] + other->second)) continue;
      const double by = rough_numbers(part.recording, sample) / 2 *
                        (part.fit.sample[i] / left_with - other->second / left);
      auto& [gain, square] =
          gains[std::count(about.begin(), about.end(), Subject::sample(sample.id)) > 0];
      gain.sum += by, ++gain.count;
      square.sum += by * by, ++square.count;
    }
  double variance = 0;  // of the sum
  for (const auto& entry : gains) {
    const auto& [gain, square] = entry.second;
    variance += static_cast<double>(gain.count) *
                std::max(0.0, square.value() - gain.value() * gain.value());
  }
  return Thresholds::by_chance * std::sqrt(variance);
}

double rough_log_evidence(const Recording& recording, const TrialFit& fit, const Hypothesis* h) {
  if (!std::isfinite(fit.chi2) || fit.samples.empty()) return -kInfinity;
  double numbers = 0, out = log_moved(recording, fit, h);
  for (const int s : fit.samples) {
    numbers += rough_numbers(recording, recording.samples[s]);
    for (const View& v : recording.samples[s].views)
      out += rough_numbers(recording, v) * of_a_residual(h, v.sensor);
  }
  const double per_dof = fit.cost / static_cast<double>(std::max(1L, fit.dof));
  return out - numbers * std::log(std::max(1e-12, per_dof)) / 2;
}

}  // namespace kincal
