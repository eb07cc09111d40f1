#include "stated_sigmas.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "../analysis/linearisation.h"
#include "../analysis/noise_levels.h"
#include "../analysis/residuals.h"
#include "../calibration/calibration.h"
#include "../rig/scales.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kWrong = 5;           // times as large or small as stated
constexpr double kKnown = 0.3;         // relative uncertainty of a level
constexpr double kLevelAtRest = 0.05;  // of the logarithm of a level, from round to round
constexpr int kNoiseFits = 8;
constexpr double kErrAlike = 0.3;     // correlation of neighbouring points
constexpr double kSampleApart = 10;   // times the median sample's mean square
constexpr double kMiddle = 0.3;       // the median over the root mean square; of noise 0.67
constexpr int kPointsOfAView = 4;     // so many have neighbours
constexpr double kOtherwise = 0.5;    // of what chi2 is too large: less is left if it is no noise
constexpr double kNearlyRight = 2.5;  // levels within this factor at first end no further off

/// The rig with one step that frees what all steps free.
Rig with_one_step(const Recording& recording, const Stage& stage) {
  Rig out = recording.rig;
  Step step;
  step.name = "all";
  step.sensors = stage.sensors;
  step.free = stage.free;
  step.free_where.assign(stage.free.size(), "doctor");
  for (const auto& p : stage.priors)
    step.priors.push_back({p.first, p.second, p.second, false, "doctor"});
  out.steps = {step};
  out.priors.clear();
  return out;
}

/// Where the noise levels come to rest.
struct NoiseFit {
  std::vector<NoiseLevel> levels;  // `assumed` as stated, `seen` as found
  double per_dof = 0;
};

std::optional<NoiseFit> fit_noise(const Recording& recording, const TrialContext& context) {
  CalibrationOptions options;
  options.noise = context.noise;
  options.threads = context.threads;
  options.progress = [&](const std::string&, int, double, double) {
    return !context.progress || context.progress(-1, 0);
  };
  std::shared_ptr<const Recording> trial =
      make_recording(recording.with_rig(with_one_step(recording, context.all)));
  NoiseFit out;
  for (int round = 0; round < kNoiseFits; ++round) {
    const Solution solution = calibrate(trial, options);
    if (solution.status == Status::cancelled) throw Cancelled();
    if (!solution.usable()) return std::nullopt;
    const std::vector<NoiseLevel> levels = noise_levels(linearise(solution));
    out.per_dof = solution.chi2_per_dof();
    double moved = 0, farthest = 1;
    if (out.levels.empty()) out.levels = levels;
    for (size_t i = 0; i < levels.size() && i < out.levels.size(); ++i) {
      NoiseLevel& level = out.levels[i];
      level.seen = levels[i].seen;
      level.uncertainty = levels[i].uncertainty;
      if (!(levels[i].seen > 0)) continue;
      const double factor = levels[i].seen / levels[i].assumed;
      farthest = std::max({farthest, factor, 1 / factor});
      if (std::max(factor, 1 / factor) > 1.1) moved = std::max(moved, std::abs(std::log(factor)));
    }
    if (round == 0 && farthest < kNearlyRight) return std::nullopt;
    if (moved < kLevelAtRest) return out;
    trial = make_recording(scale_noise(*trial, levels));
  }
  return std::nullopt;
}

bool wrong(const NoiseLevel& level) {
  const double factor = level.seen / level.assumed;
  return level.guess == 0 && level.assumed > 0 && level.uncertainty < kKnown &&
         (factor >= kWrong || factor <= 1 / kWrong);
}

/// Whether the residuals of a fit are spread as noise is.
bool spread_evenly(const Recording& recording, const TrialContext& context, const TrialFit& now) {
  std::vector<double> squares;
  for (double s : now.sample)
    if (!std::isnan(s)) squares.push_back(s);
  if (squares.empty() ||
      *std::max_element(squares.begin(), squares.end()) > kSampleApart * median(squares))
    return false;
  EstimationSetup setup;
  setup.noise = context.noise;
  setup.sensors = context.all.sensors;
  for (const std::string& name : context.all.free) merge(setup.free, recording.table.select(name));
  Estimation problem(recording, indices(recording.samples.size()), setup);
  const VectorXd state = problem.pack(now.values);
  problem.renew(state);
  double products = 0, sum = 0;
  std::map<int, std::vector<double>> sizes;  // of single residuals, by sensor
  for (const ViewResiduals& v : problem.residuals(state)) {
    for (double r : v.whitened) sizes[v.view->sensor].push_back(std::abs(r));
    const Eigen::Index points = static_cast<Eigen::Index>(v.view->ids.size());
    if (points < kPointsOfAView || v.raw.size() < points) continue;
    const Eigen::Index rest = v.raw.size() - v.raw.size() / points;
    products += v.raw.head(rest).dot(v.raw.tail(rest));
    sum += v.raw.head(rest).squaredNorm();
  }
  const auto few_are_large = [](const auto& of_sensor) {
    Mean square;
    for (double r : of_sensor.second) square.sum += r * r, ++square.count;
    return median(of_sensor.second) < kMiddle * std::sqrt(square.value());
  };
  return !(products > kErrAlike * sum) && std::none_of(sizes.begin(), sizes.end(), few_are_large);
}

/// Whether every sensor has views in which neighbouring points would show what is no noise of its
/// own.
bool shows_neighbours(const Recording& recording, int sensor) {
  long views = 0, large = 0;
  for (const Sample& s : recording.samples)
    for (const View& v : s.views)
      if (v.sensor == sensor) ++views, large += v.ids.size() >= static_cast<size_t>(kPointsOfAView);
  return 2 * large > views;
}

}  // namespace

std::optional<Notice> wrong_sigmas(const Recording& recording, const TrialContext& context,
                                   const TrialFit& now) {
  if ((context.noise != NoiseMode::latent && context.noise != NoiseMode::none) ||
      context.all.loss.kind != LossKind::none || !now.complete())
    return std::nullopt;
  const std::optional<NoiseFit> noise = fit_noise(recording, context);
  if (!noise || !(noise->per_dof > 0.8 && noise->per_dof < 1.25)) return std::nullopt;
  Subjects where;
  std::string sizes;
  bool larger = false;
  for (const NoiseLevel& level : noise->levels) {
    if (!wrong(level)) continue;
    const bool above = level.seen > level.assumed;
    if (above && level.sensor >= 0 && !shows_neighbours(recording, level.sensor))
      return std::nullopt;
    larger = larger || above;
    where.push_back({level.joint >= 0 ? Subject::Kind::joint : Subject::Kind::sensor,
                     level.of.substr(level.of.find('/') + 1)});
    sizes += (sizes.empty() ? "" : ", ") + level.of + (level.part.empty() ? "" : " " + level.part) +
             text(" %.3g ", level.seen) + level.unit + text(" (stated %.3g)", level.assumed);
  }
  if (where.empty()) return std::nullopt;
  if (larger) {
    if (!spread_evenly(recording, context, now)) return std::nullopt;
    const TrialFit freer =
        best_fit(recording, context, with_usual_errors(recording, context.all), {60, 1e-4});
    const auto excess = [](const TrialFit& f) { return f.chi2 - static_cast<double>(f.dof); };
    if (!freer.complete() || excess(freer) < kOtherwise * excess(now)) return std::nullopt;
  }
  Notice out = make_notice(
      NoticeKind::wrong_sigma, std::move(where),
      "sigmas are not of the size that the data show: " + sizes,
      text("chi2/dof is %.3g as stated and %.3g with these", now.per_dof(), noise->per_dof),
      "state these in the rig, or have the noise estimated (`estimate_noise`)");
  out.chi2_as_is = now.chi2;
  out.chi2_corrected = noise->per_dof * static_cast<double>(now.dof);
  return out;
}

}  // namespace kincal
