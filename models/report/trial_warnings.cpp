#include "trial_warnings.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "../automatic/other_lens.h"
#include "../rig/words.h"
#include "../sensors/sensors.h"

namespace kincal {
namespace {

constexpr double kManyRejected = 0.2;  // share of the samples
constexpr double kWide = 5;            // times the width that a group begins with

}  // namespace

std::string shown_text(double value, const std::string& unit) {
  const bool thousandths = unit == "m" || unit == "rad";
  if (unit.empty()) return text("%.3g", value);
  return text("%.3g ", value * (thousandths ? 1e3 : 1)) + (thousandths ? "m" : "") + unit;
}

void warn_of_other_models(const Report& report, Notices& out) {
  constexpr double kArmScaled = 0.003;  // less harms nobody
  const std::vector<OtherModel>& all = report.other_models;
  for (const OtherModel* prior : told_models(all, NoticeKind::prior))
    out.push_back(make_notice(
        NoticeKind::prior, prior->where,
        "the data contradict the rig's prior on " + prior->where[0].name +
            text(": with one %.2g times as wide they are far more likely (log odds %+.3g)",
                 prior->value, prior->log_odds),
        "with the present prior other parameters absorb the difference",
        "check which of the two is wrong, the prior or the data; correct it, or delete the prior"));
  for (const OtherModel* arm : told_models(all, NoticeKind::arm_scale))
    if (report.solution.usable() && std::abs(arm->value - 1) >= kArmScaled)
      out.push_back(make_notice(
          NoticeKind::arm_scale, arm->where,
          "all lengths of the arm came out " +
              text("%.4g +- %.2g times the URDF's", arm->value, arm->sigma) + ", as if what " +
              joined(names_of(arm->where)) + (arm->where.size() == 1 ? " measures" : " measure") +
              " had another unit or scale",
          "",
          "measure a known distance with it; if the result is right, measure a link, and correct "
          "the URDF"));
  for (const OtherModel* lens : told_models(all, NoticeKind::intrinsics)) {
    const std::vector<Sensor>& sensors = report.solution.rig().sensors;
    const Sensor& camera = *std::find_if(sensors.begin(), sensors.end(), [&](const Sensor& s) {
      return s.name == lens->where[0].name;
    });
    const std::string other = lens_type(*other_lens(camera)).name;
    out.push_back(make_notice(
        NoticeKind::intrinsics, lens->where,
        "the lens of camera '" + camera.name + "' is " + other + " rather than " +
            lens_type(camera.parameters).name + text(" (log odds %+.3g)", lens->log_odds),
        "poses absorb the difference (predicted errors account for this)",
        "write `model: " + other + "` without distortion into the rig, and calibrate again"));
  }
}

void warn_of_use(const Residuals& residuals, Notices& out) {
  constexpr double kWorse = 1.1;  // times as large
  const bool held_out = std::any_of(residuals.sensors.begin(), residuals.sensors.end(),
                                    [](const SensorResult& s) { return s.test.points > 0; });
  std::vector<std::string> worse;
  Subjects where;
  for (const SensorResult& s : residuals.sensors) {
    const SplitStatistics& errors = held_out ? s.test : s.train;
    if (errors.rms_as_read < errors.rms_before) return;  // something is better: a trade
    if (!(errors.rms_as_read > kWorse * errors.rms_before)) continue;
    where.push_back(Subject::sensor(s.name));
    worse.push_back("sensor '" + s.name + "' " + shown_text(errors.rms_as_read, s.unit) +
                    ", before " + shown_text(errors.rms_before, s.unit));
  }
  if (worse.empty()) return;
  out.push_back(
      make_notice(NoticeKind::in_use, std::move(where),
                  std::string("with raw joint readings, errors are larger than before") +
                      (held_out ? ", on held-out data: " : ": ") + listed(worse, kNamed),
                  "either the stated noise of the readings is too large, or model errors were "
                  "attributed to their noise",
                  "state the estimated noise of the joints, calibrate again, and keep the robot's "
                  "own parameters until errors with raw readings are smaller"));
}

void warn_of_contradicted(const Report& report, Notices& out) {
  // Times as large as in the training, and more where that has few samples: what was fitted to ten
  // was up to 6.5 times as large on others (2 of 80 right robots); points of a sensor that tell.
  const double worst =
      5 * (1 + 5 / std::max(1.0, static_cast<double>(report.solution.training().size())));
  constexpr long kPoints = 8;
  const std::vector<SensorResult>& sensors = report.residuals.sensors;
  const std::vector<Sample>& samples = report.solution.samples();
  const bool any = std::any_of(samples.begin(), samples.end(),
                               [](const Sample& s) { return !s.train && !s.views.empty(); });
  const bool judged = std::any_of(sensors.begin(), sensors.end(),
                                  [](const SensorResult& s) { return s.test.points > 0; });
  if (!any) return;
  if (!judged) {
    out.push_back(make_notice(
        NoticeKind::contradicted, {},
        "no held-out sample can be evaluated at the estimate (a point lies behind a camera): they "
        "contradict the calibration, which is not validated",
        "", "check these samples; if they are right, the calibration is wrong"));
    return;
  }
  std::vector<std::string> worse;
  Subjects where;
  for (const SensorResult& s : sensors) {
    const auto mean = [](const SplitStatistics& split) {
      return split.whitened_squared / static_cast<double>(std::max(1L, split.whitened_count));
    };
    if (s.test.points < (s.measures_pose ? 3 : kPoints) || s.train.points == 0) continue;
    const bool fits = mean(s.test) <= worst * worst * std::max(1.0, mean(s.train)),
               reads = !(s.test.rms_as_read > worst * s.train.rms_as_read) ||
                       !(s.test.rms_as_read > worst * s.train.rms);
    if (fits && reads) continue;
    where.push_back(Subject::sensor(s.name));
    worse.push_back("sensor '" + s.name + "' " +
                    shown_text(fits ? s.test.rms_as_read : s.test.rms, s.unit) + ", of training " +
                    shown_text(fits ? s.train.rms_as_read : s.train.rms, s.unit));
  }
  if (worse.empty()) return;
  out.push_back(make_notice(NoticeKind::contradicted, std::move(where),
                            "held-out samples contradict the calibration: " + listed(worse, kNamed),
                            "", "look at the held-out samples"));
  out.back().otherwise =
      "if they are right, the calibration is valid only for the training postures, or not at all";
}

/// So many outliers that the majority need not be right.
void warn_of_rejected(const Report& report, Notices& out) {
  std::set<std::string> samples;
  for (const Rejected& r : report.rejected)
    if (r.sensor.empty()) samples.insert(r.sample);
  const size_t all = samples.size() + report.solution.training().size();
  if (samples.empty() || samples.size() < kManyRejected * static_cast<double>(all)) return;
  std::string wide;
  for (const AutomaticGroup& group : report.automatic)
    if (!group.held && group.factor >= kWide)
      wide += (wide.empty() ? "" : ", ") + group.name + text(" (%.2g times)", group.factor);
  if (!wide.empty())
    wide = ". The remaining data imply robot errors far larger than usual: " + wide;
  out.push_back(make_notice(NoticeKind::rejected,
                            subjects(Subject::Kind::sample, {samples.begin(), samples.end()}),
                            std::to_string(samples.size()) + " of " + std::to_string(all) +
                                " training samples were removed as outliers",
                            "with this many, the removed samples may be the good ones" + wide,
                            "check both parts before the result is used"));
}

/// A calibration that is worse than one that leaves the robot as it is.
void warn_of_held_out(const Validation& validation, Notices& out) {
  if (!validation.baselines) return;
  std::string list;
  for (const Baseline& b : validation.baselines->rows)
    if (b.worse())
      list += (list.empty() ? "sensor '" : "; sensor '") + b.sensor + "' " +
              shown_text(b.automatic, b.unit) + " as read, the mounts alone " +
              shown_text(b.mounts, b.unit) + text(" (%.3g times, 95 %% ", b.ratio) +
              text("%.3g to %.3g)", b.of_ratio.low, b.of_ratio.high);
  if (!list.empty())
    out.push_back(make_notice(
        NoticeKind::held_out, {},
        "on held-out data this calibration is worse than its mounts alone: " + list,
        "too many parameters are estimated for these data, or the arm's parameters absorb a "
        "mistake",
        "use only the mounts of the result, leave groups out (`no_group`), and look for mistakes "
        "(`check`)"));
}

}  // namespace kincal
