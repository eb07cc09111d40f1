#include "trial_warnings.h"

#include <algorithm>
#include <set>

#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kManyRejected = 0.2;  // share of the samples
constexpr double kWide = 5;            // times the width that a group begins with

}  // namespace

std::string shown_text(double value, const std::string& unit) {
  const bool thousandths = unit == "m" || unit == "rad";
  return text("%.3g ", value * (thousandths ? 1e3 : 1)) + (thousandths ? "m" : "") + unit;
}

void warn_of_doubted_priors(const Report& report, Warnings& out) {
  for (const DoubtedPrior& prior : report.doubted)
    out.push_back({"prior",
                   "the data contradict the rig's prior on " + prior.pattern +
                       text(": with one %.2g times as wide they are far more likely (log "
                            "evidence %+.3g). With the prior as it is other numbers take "
                            "the place of these; correct it, or leave it away",
                            prior.factor, prior.gain),
                   {prior.pattern}});
}

void warn_of_use(const Residuals& residuals, Warnings& out) {
  constexpr double kWorse = 1.1;  // times as large
  const bool held_out = std::any_of(residuals.sensors.begin(), residuals.sensors.end(),
                                    [](const SensorResult& s) { return s.test.points > 0; });
  std::vector<std::string> worse, names;
  for (const SensorResult& s : residuals.sensors) {
    const SplitStatistics& errors = held_out ? s.test : s.train;
    if (errors.rms_as_read < errors.rms_before) return;  // something is better: a trade
    if (!(errors.rms_as_read > kWorse * errors.rms_before)) continue;
    names.push_back(s.name);
    worse.push_back("sensor '" + s.name + "' " + shown_text(errors.rms_as_read, s.unit) +
                    ", before " + shown_text(errors.rms_before, s.unit));
  }
  if (worse.empty()) return;
  out.push_back({"in_use",
                 std::string("in use, with joint readings taken as they are, errors are larger "
                             "than before") +
                     (held_out ? ", on data that were held out: " : ": ") + listed(worse, kNamed) +
                     ". Either readings are stated noisier than they are (state what is seen), or "
                     "what the model lacks was taken for their noise. Do not replace the robot's "
                     "numbers by these",
                 names});
}

/// So many outliers that the majority need not be right.
void warn_of_rejected(const Report& report, Warnings& out) {
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
    wide = ". What is left asks for errors of the robot far beyond the usual: " + wide;
  out.push_back(
      {"rejected",
       std::to_string(samples.size()) + " of " + std::to_string(all) +
           " training samples were taken out as outliers. Among so many the good ones may "
           "be those that were taken out: look at both parts before the result is used" +
           wide,
       {samples.begin(), samples.end()}});
}

/// A calibration that is worse than one that leaves the robot as it is.
void warn_of_held_out(const Validation& validation, Warnings& out) {
  if (!validation.baselines) return;
  std::string list;
  for (const Baseline& b : validation.baselines->rows)
    if (b.worse())
      list += (list.empty() ? "sensor '" : "; sensor '") + b.sensor + "' " +
              shown_text(b.automatic, b.unit) + " as read, the mounts alone " +
              shown_text(b.mounts, b.unit) + text(" (%.3g times, 95 %% ", b.ratio) +
              text("%.3g to %.3g)", b.of_ratio.low, b.of_ratio.high);
  if (!list.empty())
    out.push_back(
        {"held_out",
         "on data that it did not use this calibration is worse than its mounts alone: " + list +
             ". Too many numbers are free for these data, or a mistake somewhere is "
             "taken up by the arm's numbers: use the result for its mounts at most, "
             "leave groups out, and look for mistakes",
         {}});
}

}  // namespace kincal
