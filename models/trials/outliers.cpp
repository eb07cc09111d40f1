#include "outliers.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "../../solver/decompositions.h"
#include "consensus.h"
#include "../fitting/robust.h"

namespace kincal {
namespace {

constexpr int kRounds = 8;

std::vector<Sample> left_of_all(const Calibration& calibration, const std::vector<Verdict>& verdicts) {
  std::vector<Sample> out;
  for (size_t i = 0; i < verdicts.size(); ++i)
    if (!verdicts[i].out)
      out.push_back(verdicts[i].clean() ? calibration.samples()[i] : left_of(calibration.rig(), calibration.samples()[i], verdicts[i]));
  return out;
}

void describe(const Calibration& calibration, const std::vector<Verdict>& verdicts, std::vector<Rejected>& out) {
  const Rig& rig = calibration.rig();
  for (size_t i = 0; i < verdicts.size(); ++i) {
    const Sample& sample = calibration.samples()[i];
    const Verdict& verdict = verdicts[i];
    if (verdict.out) out.push_back({sample.id, "", "", {}, verdict.reason});
    for (size_t v = 0; !verdict.out && v < sample.views.size(); ++v) {
      const View& view = sample.views[v];
      Rejected r{sample.id, rig.sensors[view.sensor].name, rig.targets[view.target].name, {}, verdict.view_reason[v]};
      for (size_t b = 0; !verdict.view[v] && b < verdict.point[v].size(); ++b)
        if (verdict.point[v][b]) r.ids.push_back(view.ids.empty() ? static_cast<int>(b) : view.ids[b]);
      if (!r.ids.empty()) r.reason = "far from where the view's other points put " + std::string(r.ids.size() == 1 ? "it" : "them");
      if (verdict.view[v] || !r.ids.empty()) out.push_back(r);
    }
  }
}

}  // namespace

std::optional<Cleaned> calibrate_without_outliers(const Calibration& calibration, const CalibrationOptions& options) {
  const Rig& rig = calibration.rig();
  const std::vector<Sample>& samples = calibration.samples();
  const std::vector<int> training = calibration.training();

  CalibrationOptions quick = options;  // to find them
  quick.judge = false;
  quick.noise = NoiseMode::latent;
  int iterations = 0;
  if (options.progress)
    quick.progress = [&](const std::string&, int iteration, double chi2, double damping) {
      return options.progress("looking for outliers", iteration == 0 ? iterations : ++iterations, chi2, damping);
    };
  quick.robust = true;
  Calibration all = calibration;
  std::optional<CalibrationResult> fit = all.run(quick);
  if (!fit) return std::nullopt;
  quick.robust = false;
  Bench bench{Recording(rig, {}), fit->setup.sensors, fit->values.shared, fit->setup.levels, {}, {}};
  std::vector<Values> start(samples.size());
  for (const auto& t : fit->values.targets) start[t.first.first].targets[{0, t.first.second}] = t.second;

  std::vector<Verdict> verdicts;
  for (const Sample& s : samples) verdicts.push_back(all_in(rig, s));
  std::vector<char> returned(samples.size(), 0);  // what came back once and is out again stays out
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<Verdict> before = verdicts;
    for (int i : training) {
      if (before[i].took_part()) {
        verdicts[i] = judge_sample(bench, samples[i], before[i], start[i]);
      } else if (!returned[i]) {
        verdicts[i] = judge_sample(bench, samples[i], before[i], start[i]);
        returned[i] = verdicts[i].took_part();
      }
    }
    const auto out = std::count_if(verdicts.begin(), verdicts.end(), [](const Verdict& v) { return v.out; });
    if (2 * out > static_cast<long>(training.size())) {
      const std::string what = "--reject: " + std::to_string(out) + " of " + std::to_string(training.size()) +
                               " samples do not fit the others: nothing was taken out";
      Cleaned plain{calibration, {}};
      try {
        fit = plain.calibration.run(options);
      } catch (const std::runtime_error& error) {
        throw std::runtime_error(what + ", and the plain fit cannot start: " + error.what());
      }
      if (!fit) return std::nullopt;
      plain.result = std::move(*fit);
      plain.result.warnings.push_back({"no_consensus", what});
      return plain;
    }
    if (round > 0 && verdicts == before) break;
    Calibration left(rig, left_of_all(calibration, verdicts));
    fit = left.run(quick);
    if (!fit) return std::nullopt;
    Estimation problem(left.recording(), left.training(), fit->setup);
    const VectorXd state = problem.pack(fit->values);
    problem.renew(state);
    bench.levels = robust_levels(rig, problem.residuals(state));
    bench.shared = fit->values.shared;
    bench.free = fit->setup.free;
    bench.root = std::sqrt(fit->dof > 0 ? std::max(1.0, fit->chi2 / static_cast<double>(fit->dof)) : 1.0) * root_of_covariance(fit->covariance);
  }
  Cleaned clean{Calibration(rig, left_of_all(calibration, verdicts)), {}};
  fit = clean.calibration.run(options);
  if (!fit) return std::nullopt;
  clean.result = std::move(*fit);
  describe(calibration, verdicts, clean.result.rejected);
  return clean;
}

bool name_outliers(const Calibration& calibration, const CalibrationOptions& options, CalibrationResult& result) {
  CalibrationOptions quick = options;
  quick.judge = false;
  std::optional<Cleaned> clean;
  try {
    clean = calibrate_without_outliers(calibration, quick);
    if (!clean) return false;
  } catch (const std::exception&) {  // the robust fit had no start, or what is left frees nothing: no names
    return true;
  }
  if (clean->result.rejected.empty()) return true;
  const auto named = [](const Warning& w) { return w.id == "outlier_sample" || w.id == "outlier_view"; };
  result.warnings.erase(std::remove_if(result.warnings.begin(), result.warnings.end(), named), result.warnings.end());
  struct Kind {
    const char *id, *one, *many;
    size_t count, shown;
    std::string list;
  };
  Kind kinds[] = {{"outlier_sample", " sample does", " samples do", 0, 0, ""},
                  {"outlier_view", " view does", " views do", 0, 0, ""},
                  {"outlier_point", " point does", " points do", 0, 0, ""}};
  for (const Rejected& r : clean->result.rejected) {
    Kind& kind = kinds[r.sensor.empty() ? 0 : r.ids.empty() ? 1 : 2];
    kind.count += std::max<size_t>(1, r.ids.size());
    if (++kind.shown > 5) continue;
    kind.list += (kind.shown > 1 ? ", '" : "'") + r.sample + "'" + (r.sensor.empty() ? "" : " " + r.sensor);
  }
  for (const Kind& kind : kinds)
    if (kind.count > 0)
      result.warnings.push_back({kind.id, "a robust fit finds that " + std::to_string(kind.count) +
                                              (kind.count == 1 ? kind.one : kind.many) + " not belong to the others: " + kind.list +
                                              (kind.shown > 5 ? ", ..." : "") + "; --reject takes them out"});
  return true;
}

}  // namespace kincal
