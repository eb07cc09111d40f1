#include "tables.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <set>

#include "../../io/document/numbers.h"

namespace kincal {
namespace {

std::string format(const char* pattern, ...) {
  char buffer[512];
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(buffer, sizeof buffer, pattern, arguments);
  va_end(arguments);
  return buffer;
}

size_t shown_width(const std::string& s) {  // UTF-8 continuation bytes take no place
  return static_cast<size_t>(std::count_if(s.begin(), s.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

/// Columns padded to their widest cell; the first `left` ones to the left, the others to the right.
std::string align(const std::vector<std::vector<std::string>>& rows, size_t left) {
  std::vector<size_t> width;
  for (const auto& row : rows)
    for (size_t c = 0; c < row.size(); ++c) {
      if (width.size() <= c) width.push_back(0);
      width[c] = std::max(width[c], shown_width(row[c]));
    }
  std::string out;
  for (const auto& row : rows) {
    std::string line;
    for (size_t c = 0; c < row.size(); ++c) {
      const std::string pad(width[c] - shown_width(row[c]), ' ');
      line += "  " + (c < left ? row[c] + pad : pad + row[c]);
    }
    while (!line.empty() && line.back() == ' ') line.pop_back();
    out += line + "\n";
  }
  return out;
}

/// px as they are, m in mm, rad in mrad.
struct Unit {
  std::string name;
  double factor;
};
Unit shown(const std::string& unit) {
  if (unit == "m") return {"mm", 1e3};
  if (unit == "rad") return {"mrad", 1e3};
  return {unit, 1};
}

std::string value(double v, double factor = 1) { return std::isfinite(v) ? format("%.4g", v * factor) : "-"; }

}  // namespace

Progress::Progress(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO)) {}

void Progress::update(const std::string& step, int iteration, double chi2, double damping) {
  if (quiet_) return;
  if (step != step_) finish();
  step_ = step;
  if (iteration == 0) {
    if (terminal_) std::fprintf(stderr, "\r\033[K%s: starting values", step.c_str());
    iteration_ = 0;
    return;
  }
  iteration_ = iteration;
  chi2_ = chi2;
  if (terminal_) std::fprintf(stderr, "\r\033[K%s: iteration %d, chi2 %.8g, damping %.0e", step.c_str(), iteration, chi2, damping);
}

void Progress::interrupted() {
  if (terminal_ && !quiet_ && !step_.empty()) std::fprintf(stderr, "\n");
  step_.clear();
}

void Progress::finish() {
  if (quiet_ || step_.empty() || iteration_ == 0) return;
  std::fprintf(stderr, "%s%s: %d iterations, chi2 %.8g\n", terminal_ ? "\r\033[K" : "", step_.c_str(), iteration_, chi2_);
  step_.clear();
}

std::string residual_table(const std::vector<SensorResult>& sensors, bool before) {
  const bool test = std::any_of(sensors.begin(), sensors.end(), [](const SensorResult& s) { return s.test.points > 0; });
  const bool train = std::any_of(sensors.begin(), sensors.end(), [](const SensorResult& s) { return s.train.points > 0; });
  std::vector<std::vector<std::string>> rows = {{"sensor", "unit"}};
  for (const char* split : {"train", "held out"}) {
    if ((split[0] == 't' && !train) || (split[0] == 'h' && !test)) continue;
    rows[0].push_back(std::string(split) + ": points");
    if (before) rows[0].push_back("before");
    rows[0].push_back(before ? "after" : "rms");
    rows[0].push_back("as read");
  }
  for (const SensorResult& s : sensors)
    for (bool rotation : {false, true}) {
      if (rotation && !s.whole_pose) continue;
      const Unit unit = shown(rotation ? "rad" : s.unit);
      std::vector<std::string> row = {rotation ? "" : s.name, unit.name};
      for (const SplitStatistics* split : {&s.train, &s.test}) {
        if ((split == &s.train && !train) || (split == &s.test && !test)) continue;
        row.push_back(rotation ? "" : std::to_string(split->points));
        if (before) row.push_back(value(rotation ? split->rotation_before : split->rms_before, unit.factor));
        row.push_back(value(rotation ? split->rotation : split->rms, unit.factor));
        row.push_back(value(rotation ? split->rotation_as_read : split->rms_as_read, unit.factor));
      }
      rows.push_back(row);
    }
  return align(rows, 2);
}

std::string parameter_table(const CalibrationResult& result, size_t most) {
  struct Line {
    double weight;
    std::vector<std::string> cells;
  };
  std::vector<Line> lines;
  for (const ParameterEstimate& e : result.parameters)
    for (size_t c = 0; c < e.value.size(); ++c) {
      if (e.sigma[c] == 0) continue;
      const Unit unit = shown(e.units[c]);
      const double change = e.value[c] - e.initial[c];
      // A thousandth of a metre, a radian or a ratio and a tenth of a pixel weigh alike.
      const double weight = std::abs(change) * (e.units[c] == "px" ? 10 : 1e3);
      lines.push_back({weight,
                       {e.components[c].empty() ? e.name : e.name + "." + e.components[c], value(e.initial[c], unit.factor),
                        value(e.value[c], unit.factor), format("%+.4g", change * unit.factor),
                        std::isfinite(e.sigma[c]) ? "± " + format("%.2g", e.sigma[c] * unit.factor) : "not determined", unit.name}});
    }
  std::stable_sort(lines.begin(), lines.end(), [](const Line& a, const Line& b) { return a.weight > b.weight; });
  // Where targets stand is seldom what one wants to know: a few of these behind the robot and its sensors.
  std::vector<std::vector<std::string>> rows = {{"parameter", "before", "after", "change", "sigma", "unit"}};
  for (bool target : {false, true}) {
    size_t room = target ? most / 3 : most;
    for (const Line& line : lines)
      if ((line.cells[0].rfind("target/", 0) == 0) == target && room > 0) rows.push_back(line.cells), --room;
  }
  std::string out = align(rows, 1);
  if (lines.size() + 1 > rows.size()) out += "  ... and " + std::to_string(lines.size() + 1 - rows.size()) + " more in result.json\n";
  return out;
}

std::string loop_table(const CalibrationResult& result) {
  constexpr size_t kColumns = 6;  // at a time
  const auto cell = [&](const std::string& from, const std::string& to) -> std::string {
    for (const Loop& loop : result.loops) {
      if (loop.from != from || loop.to != to || loop.train.points == 0) continue;
      const auto rms = [&](double v) { return std::isfinite(v) ? format("%.3g", v * shown(loop.unit).factor) : "-"; };
      return rms(loop.train.rms_before) + "→" + rms(loop.train.rms);
    }
    return "";
  };
  std::vector<const SensorResult*> seen, looking;  // columns, rows
  for (const SensorResult& s : result.sensors) {
    const auto trained = [](const Loop& loop) { return loop.train.points > 0; };
    if (std::any_of(result.loops.begin(), result.loops.end(), [&](const Loop& l) { return trained(l) && l.to == s.name; }))
      seen.push_back(&s);
    if (std::any_of(result.loops.begin(), result.loops.end(), [&](const Loop& l) { return trained(l) && l.from == s.name; }))
      looking.push_back(&s);
  }
  std::string out;
  for (size_t first = 0; first < seen.size(); first += kColumns) {
    const size_t last = std::min(seen.size(), first + kColumns);
    std::vector<std::vector<std::string>> rows = {{"from \\ to"}};
    for (size_t c = first; c < last; ++c) rows[0].push_back(seen[c]->name + " " + shown(seen[c]->unit).name);
    for (const SensorResult* from : looking) {
      rows.push_back({from->name});
      for (size_t c = first; c < last; ++c) rows.back().push_back(from == seen[c] ? "" : cell(from->name, seen[c]->name));
    }
    out += align(rows, 1);
  }
  return out;
}

std::string restart_table(const Restarts& restarts) {
  const int own = restarts.minima[0].count, failed = restarts.failed;
  std::string out = format("  %d of %d end in this minimum", own, restarts.count);
  if (failed) out += format(", %d failed", failed);
  out += "\n";
  if (restarts.minima.size() == 1) return out;
  std::vector<std::vector<std::string>> rows = {{"restarts", "cost", "most different, in sigmas"}};
  for (size_t i = 0; i < restarts.minima.size(); ++i) {
    const Minimum& m = restarts.minima[i];
    std::string names = i == 0 ? "this result" : "";
    for (size_t k = 0; k < m.differs.size() && k < 3; ++k)
      names += (k ? ", " : "") + m.differs[k].first + format(" %+.3g", m.differs[k].second);
    rows.push_back({std::to_string(m.count), format("%.8g", m.cost), names});
  }
  return out + align(rows, 3);
}

std::string plan_table(const std::vector<StepPlan>& plans, const ParameterTable& table) {
  std::string out;
  for (const StepPlan& p : plans) {
    int shared = 0;
    for (const Freed& f : p.free) shared += static_cast<int>(f.components.size());
    out += format("step %s: %d shared parameters free, %d samples\n", p.name.c_str(), shared, p.samples);
    out += format("  %ld residuals, joint-error and prior terms - %ld unknowns (%d shared, %ld in the samples) = %ld degrees of freedom\n",
                  p.rows, p.unknowns, shared, p.unknowns - shared, p.rows - p.unknowns);
    for (const Freed& f : p.free) {
      const Parameter& parameter = table.all[f.parameter];
      std::string components;
      if (!f.whole(parameter))
        for (int c : f.components) components += (components.empty() ? "." : " .") + parameter.components[c];
      std::string priors;
      for (const Prior& prior : p.priors)
        if (prior.parameter == f.parameter) priors += (priors.empty() ? "  prior sigma " : ", ") + shortest(prior.sigma);
      out += "    " + parameter.name + (components.empty() ? "" : " " + components) + priors + "\n";
    }
    for (const std::string& n : p.unused) out += "    unused (no measurement of this step depends on it): " + n + "\n";
    for (const std::string& n : p.held_out) out += "    held out (only held-out samples see it): " + n + "\n";
    for (const std::string& n : p.without_effect) out += "    warning: " + n + "\n";
  }
  return out;
}

std::string staging_plan(const std::vector<std::pair<std::string, std::vector<std::string>>>& groups) {
  std::string out =
      "The rig has no `estimate`: calibrate stages it automatically. Groups in the order in which they are tried; what the\n"
      "data do not determine is held, and a group is kept only if it lowers the error on samples that were left out of the fit:\n";
  for (const auto& group : groups) {
    out += "  " + group.first + "\n";
    for (const std::string& name : group.second) out += "    " + name + "\n";
  }
  return out;
}

std::string staging_table(const std::vector<StagingTrial>& trials) {
  std::vector<std::vector<std::string>> rows = {{"group", "", "error without", "with", "numbers"}};
  for (const StagingTrial& t : trials)
    rows.push_back({t.group,
                    std::string(t.removal ? "again: " : "") + (t.parameters.empty()  ? "not determined"
                                                               : t.group == "mounts" ? "kept (always)"
                                                               : t.kept              ? "kept"
                                                                                     : "not kept (no clear gain)"),
                    value(t.error_before), value(t.error_after), std::to_string(t.numbers)});
  return align(rows, 2);
}
namespace {

/// Weak directions, what priors decide, strong correlations.
std::string weak_text(const Explanation& e) {
  std::string out;
  constexpr size_t kMost = 6;
  for (size_t i = 0; i < e.weak.size() && i < kMost; ++i) {
    const WeakDirection& w = e.weak[i];
    const Unit unit = shown(w.unit);
    out += "  " + w.parameters[0].first + ": ";
    out += std::isfinite(w.sigma) ? "± " + value(w.sigma, unit.factor) + " " + unit.name + " from the data alone"
                                  : "not determined by the data";
    if (std::isfinite(w.sigma_with_priors) && w.sigma_with_priors != w.sigma)
      out += ", ± " + value(w.sigma_with_priors, unit.factor) + " " + unit.name + " with the prior";
    out += "\n    why: " + w.why + "\n    cure: " + w.cure + "\n";
  }
  if (e.weak.size() > kMost) out += "  ... and " + std::to_string(e.weak.size() - kMost) + " more directions in result.json\n";
  const auto line = [&](const std::string& title, const std::vector<std::string>& all) {
    if (all.empty()) return;
    out += "  " + title + ": ";
    for (size_t i = 0; i < all.size() && i < kMost; ++i) out += (i ? ", " : "") + all[i];
    out += all.size() > kMost ? ", and " + std::to_string(all.size() - kMost) + " more\n" : "\n";
  };
  std::vector<std::string> priors, pairs;
  for (const PriorDecides& p : e.prior_decides) priors.push_back(p.name);
  for (const Correlation& c : e.correlations) pairs.push_back(c.a + " with " + c.b + format(" (%+.4f)", c.correlation));
  line("the prior decides", priors);
  line("strong correlations", pairs);
  return out.empty() ? out : "\nWhat the data hardly tell\n" + out;
}

/// Sigmas that the data contradict, or what was estimated.
std::string noise_text(const CalibrationResult& result) {
  std::string out;
  for (const NoiseLevel& l : result.noise_levels) {
    if (result.noise_rounds > 0 ? l.used == l.assumed : !l.differs()) continue;
    const Unit unit = shown(l.unit);
    const std::string name = l.of.substr(l.of.find('/') + 1) + (l.part.empty() ? "" : " " + l.part), unit_name = " " + unit.name;
    out += "  " + name + ": assumed " + value(l.assumed, unit.factor) + unit_name;
    if (result.noise_rounds > 0) out += ", now " + value(l.used, unit.factor) + unit_name;
    if (std::isfinite(l.seen)) {
      if (result.noise_rounds == 0) out += ", seen " + value(l.seen, unit.factor) + unit_name;
      out += format(" (± %.2g %%)", 100 * l.uncertainty);
    } else {
      out += " (with the others as they are now it cannot be told)";
    }
    out += "\n";
  }
  if (out.empty()) return out;
  return (result.noise_rounds > 0
              ? "\nNoise, estimated from the data\n"
              : "\nNoise that is seen beside the rig's sigmas (what the model lacks counts as noise; --estimate-noise)\n") +
         out;
}

}  // namespace

std::string validation_table(const CalibrationResult& result) {
  const Validation& v = result.validation;
  std::string out;
  const auto errors = [&](const std::vector<HeldOutError>& sensors) {
    std::vector<std::vector<std::string>> rows = {
        {"sensor", "unit", "points", "over", "rms", "95 %", "as read", "95 %", "training as read"}};
    const auto interval = [](const Interval& i, double factor) {
      return std::isfinite(i.low) ? value(i.low, factor) + " to " + value(i.high, factor) : "-";
    };
    for (const HeldOutError& e : sensors)
      for (bool rotation : {false, true}) {
        if (rotation && !e.whole_pose) continue;
        const Unit unit = shown(rotation ? "rad" : e.unit);
        double train = std::nan("");
        for (const SensorResult& s : result.sensors)
          if (s.name == e.sensor) train = rotation ? s.train.rotation_as_read : s.train.rms_as_read;
        std::string over = std::to_string(e.blocks) + (e.by_target ? " targets" : " samples");
        if (e.missing > 0) over += ", " + std::to_string(e.missing) + " views missing";
        rows.push_back({rotation ? "" : e.sensor, unit.name, rotation ? "" : std::to_string(e.points), rotation ? "" : over,
                        value(rotation ? e.rotation : e.rms, unit.factor), interval(rotation ? e.of_rotation : e.of_rms, unit.factor),
                        value(rotation ? e.rotation_as_read : e.rms_as_read, unit.factor),
                        interval(rotation ? e.of_rotation_as_read : e.of_rms_as_read, unit.factor), value(train, unit.factor)});
      }
    return align(rows, 2);
  };
  if (!v.test.empty()) out += "\nHeld out (rms of data that the fit did not see, with 95 % intervals)\n" + errors(v.test);
  if (v.cross_validation) {
    const CrossValidation& c = *v.cross_validation;
    out += format("\nCross-validation, %zu folds%s (rms of each sample by the calibration that lacks it)\n", c.folds.size(),
                  c.by_target ? ", whole targets held out" : "") +
           errors(c.sensors);
    for (size_t f = 0; f < c.folds.size(); ++f) {
      const CrossValidation::Fold& fold = c.folds[f];
      const char* wrong = !fold.error.empty() ? "no calibration: "
                          : !fold.converged   ? "not converged"
                          : !fold.determined  ? "something freed is not determined without it"
                                              : nullptr;
      if (wrong) out += format("  fold %zu: ", f + 1) + wrong + fold.error + "\n";
    }
    std::string never;
    for (const std::string& n : c.never) never += (never.empty() ? "" : ", ") + n;
    if (!never.empty()) out += "  never held out (the only data of a sensor or target): " + never + "\n";
  }
  if (!v.frames.empty()) {
    out += "\nFrames relative to " + v.frames[0].base +
           " (predicted sigma over postures; last column: with the noise of one reading of each joint)\n";
    std::vector<std::vector<std::string>> rows = {{"frame", "postures", "unit", "rms", "median", "worst", "rms with readings"}};
    for (const FrameReport& f : v.frames)
      for (const FrameSigma& s : f.workspaces)
        for (bool rotation : {false, true}) {
          const SigmaStatistics &alone = rotation ? s.rotation : s.position,
                                &read = rotation ? s.rotation_with_readings : s.position_with_readings;
          const bool first = &s == &f.workspaces[0] && !rotation;
          rows.push_back(
              {first ? f.frame : "",
               rotation ? "" : std::to_string(s.postures) + (s.workspace == "samples" ? " of the samples" : " in the joints' limits"),
               rotation ? "mrad" : "mm", std::isfinite(alone.rms) ? value(alone.rms, 1e3) : "not determined", value(alone.median, 1e3),
               value(alone.worst, 1e3), value(read.rms, 1e3)});
        }
    out += align(rows, 2);
    for (const FrameReport& f : v.frames) {
      std::string held;
      for (const std::string& n : f.held) held += (held.empty() ? "" : ", ") + n;
      if (!held.empty()) out += "  " + f.frame + ": taken as exact, since the last step holds them: " + held + "\n";
    }
  }
  if (!v.requirements.empty()) out += "\nTolerances\n";
  for (const Judgement& j : v.requirements) out += std::string(j.met ? "  met: " : "  NOT MET: ") + judgement_text(j) + "\n";
  return out;
}

std::string comparison_table(const Comparison& comparison, size_t most) {
  struct Line {
    double weight;
    std::vector<std::string> cells;
  };
  std::vector<Line> lines;
  for (const ParameterDifference& d : comparison.parameters)
    for (size_t c = 0; c < d.difference.size(); ++c) {
      if (std::abs(d.difference[c]) < 1e-11 * std::max(1.0, std::abs(d.a[c]))) continue;  // rounding of what was written
      const Unit unit = shown(d.units[c]);
      const double sigmas = std::abs(d.difference[c]) / d.sigma[c];
      // Without a sigma by size, behind the others: a thousandth of a metre, a radian or a ratio and a tenth of a pixel weigh alike.
      const double weight = std::isfinite(sigmas) ? sigmas + 1e9 : std::abs(d.difference[c]) * (d.units[c] == "px" ? 10 : 1e3);
      lines.push_back(
          {weight,
           {d.components[c].empty() ? d.name : d.name + "." + d.components[c], unit.name, format("%.7g", d.a[c] * unit.factor + 0.0),
            format("%.7g", d.b[c] * unit.factor + 0.0), format("%+.4g", d.difference[c] * unit.factor),
            std::isfinite(d.sigma[c]) ? "± " + format("%.2g", d.sigma[c] * unit.factor) : "-",
            std::isfinite(sigmas) ? format("%.2f", sigmas) : "-"}});
    }
  std::stable_sort(lines.begin(), lines.end(), [](const Line& a, const Line& b) { return a.weight > b.weight; });
  std::vector<std::vector<std::string>> rows = {{"parameter", "unit", "A", "B", "difference", "sigma", "in sigmas"}};
  for (size_t i = 0; i < lines.size() && i < most; ++i) rows.push_back(lines[i].cells);
  std::string out = "Parameters that differ most (poses: A and B as xyz and rpy, the difference in the frame itself)\n";
  out += lines.empty() ? "  none\n" : align(rows, 2);
  if (lines.size() > most) out += format("  ... and %zu more with --json\n", lines.size() - most);
  if (!comparison.frames.empty()) {
    out += "\nFrames relative to " + comparison.base + " over postures" +
           (comparison.workspace == "limits" ? ", random within the joints' limits\n" : " of the samples\n");
    rows = {{"frame", "unit", "postures", "rms", "worst", "sigma", "in sigmas"}};
    for (const FrameDifference& f : comparison.frames)
      for (bool rotation : {false, true}) {
        const double rms = rotation ? f.rotation_rms : f.position_rms, worst = rotation ? f.rotation_worst : f.position_worst;
        const double sigma = rotation ? f.rotation_sigma : f.position_sigma;
        rows.push_back({rotation ? "" : f.frame, rotation ? "mrad" : "mm", rotation ? "" : std::to_string(f.postures), value(rms, 1e3),
                        value(worst, 1e3), std::isfinite(sigma) ? "± " + value(sigma, 1e3) : "-", value(rms / sigma)});
      }
    out += align(rows, 2);
  }
  const std::pair<const char*, const std::vector<std::string>*> only[] = {{"A", &comparison.only_in_a}, {"B", &comparison.only_in_b}};
  for (const auto& side : only)
    for (const std::string& name : *side.second) out += std::string("  only in ") + side.first + ": " + name + "\n";
  for (const std::string& note : comparison.notes) out += "  note: " + note + "\n";
  return out;
}

std::string leverage_table(const std::vector<Leverage>& leverage) {
  constexpr size_t kMost = 5;
  std::vector<std::vector<std::string>> rows;
  std::set<std::string> samples;
  for (const Leverage& l : leverage)
    if (samples.insert(l.sample).second && rows.size() < kMost)  // of each sample the worst
      rows.push_back(
          {"without " + l.sample, l.parameter,
           std::isfinite(l.moved_sigmas) ? "would move by " + format("%+.2g", l.moved_sigmas) + " sigmas" : "is not determined"});
  std::string out = align(rows, 3);
  if (samples.size() > rows.size()) out += format("  ... and %zu more samples in result.json\n", samples.size() - rows.size());
  return out;
}

std::string rejected_table(const std::vector<Rejected>& rejected) {
  constexpr size_t kMost = 20;
  size_t points = 0, views = 0, samples = 0;
  std::string lines;
  for (bool ids : {false, true})  // samples and views first
    for (const Rejected& r : rejected) {
      if (r.ids.empty() == ids) continue;
      (ids ? points : r.sensor.empty() ? samples : views) += ids ? r.ids.size() : 1;
      if (points + views + samples == 0 || static_cast<size_t>(std::count(lines.begin(), lines.end(), '\n')) >= kMost) continue;
      lines += "  sample " + r.sample;
      if (!r.sensor.empty()) lines += ", " + r.sensor + " of " + r.target;
      for (size_t i = 0; i < r.ids.size(); ++i)
        lines += (i ? ", " : r.ids.size() == 1 ? ", point " : ", points ") + std::to_string(r.ids[i]);
      lines += ": " + r.reason + "\n";
    }
  if (rejected.size() > kMost) lines += format("  ... and %zu more lines in result.json\n", rejected.size() - kMost);
  return format("Taken out as gross outliers: %zu %s, %zu %s, %zu %s\n", samples, samples == 1 ? "sample" : "samples", views,
                views == 1 ? "view" : "views", points, points == 1 ? "point" : "points") +
         lines;
}

std::string report(const CalibrationResult& result, const ResultFiles& files) {
  std::string out;
  if (!result.staging.empty())
    out += "\nAutomatic staging (cross-validation: held-out error in sigmas without and with each group)\n" + staging_table(result.staging);
  out += "\nResiduals (rms)\n" + residual_table(result.sensors, true);
  out += validation_table(result);
  if (result.restarts) out += "\nRestarts from other starting values\n" + restart_table(*result.restarts);
  if (!result.loops.empty())
    out += "\nLoops (rms before→after of one sensor's points in another's view of them, joint readings as read)\n" + loop_table(result);
  out += "\nParameters that changed most\n" + parameter_table(result, 12);
  if (!result.computed_starts.empty()) {
    out += "\nPoses that the rig leaves open (started from the data; the changes above count from there)\n";
    std::vector<std::vector<std::string>> poses = {{"parameter", "x", "y", "z", "roll", "pitch", "yaw", ""}};
    for (const ParameterEstimate& e : result.parameters)
      if (std::count(result.computed_starts.begin(), result.computed_starts.end(), e.name)) {
        const Vector3d& t = e.pose->translation;
        const Vector3d rpy = rpy_from_rotation(e.pose->rotation);
        std::vector<std::string> row = {e.name};
        for (double v : {t.x(), t.y(), t.z(), rpy.x(), rpy.y(), rpy.z()}) row.push_back(format("%.6f", v));
        row.push_back("m, rad");
        poses.push_back(row);
      }
    out += align(poses, 1);
  }
  out += format("\nchi2 %.8g, %ld degrees of freedom", result.chi2, result.dof);
  if (result.dof > 0) out += format(", chi2/dof %.4g", result.chi2 / result.dof);
  out += "\n";
  out += noise_text(result);
  out += weak_text(result.explanation);
  if (!files.not_in_urdf.empty()) {
    out += "\nNot in robot.urdf, which cannot express it (see rig.yaml and result.json)\n";
    for (const std::string& n : files.not_in_urdf) out += "  " + n + "\n";
  }
  if (!files.reductions.empty()) out += "\nGear scales as mechanicalReduction (--write-reduction puts them into robot.urdf)\n";
  for (const Reduction& r : files.reductions)
    out += "  " + r.joint + ": scale " + format("%.6g", r.scale) + "; mechanicalReduction of " + r.transmission + " " + shortest(r.before) +
           " -> " + shortest(r.after) + "\n";
  if (!result.leverage.empty()) out += "\nWhat hangs on single samples\n" + leverage_table(result.leverage);
  if (!result.rejected.empty()) out += "\n" + rejected_table(result.rejected);
  if (result.diagnosis) out += "\nWhat may be wrong (kincal check)\n" + diagnosis_text(*result.diagnosis);
  if (!result.warnings.empty()) {
    out += "\nWarnings\n";
    for (const Warning& w : result.warnings) out += "  " + w.id + ": " + w.text + "\n";
  }
  return out;
}

std::string batch_table(const std::vector<SetSummary>& sets, size_t ignored) {
  std::string out = format("%zu %s", sets.size(), sets.size() == 1 ? "set" : "sets");
  for (const char* status : {"converged", "unobservable", "not_converged", "failed"}) {
    const auto n = std::count_if(sets.begin(), sets.end(), [&](const SetSummary& s) { return s.status == status; });
    if (n > 0) out += format(", %ld %s", static_cast<long>(n), status);
  }
  if (ignored > 0) out += format("; %zu other %s with neither rig.yaml nor samples.jsonl", ignored, ignored == 1 ? "folder" : "folders");
  out += "\n";

  // One line a quantity, in the order in which the sets name them: the middle one and the worst, and whose that is.
  struct Quantity {
    std::string name;
    Unit unit;
    std::vector<std::pair<double, std::string>> values;
  };
  std::vector<Quantity> quantities;
  const auto add = [&](const std::string& name, const std::string& unit, double v, const std::string& set) {
    if (!std::isfinite(v)) return;
    const Unit u = shown(unit);
    auto found =
        std::find_if(quantities.begin(), quantities.end(), [&](const Quantity& q) { return q.name == name && q.unit.name == u.name; });
    if (found == quantities.end()) found = quantities.insert(found, {name, u, {}});
    found->values.push_back({v, set});
  };
  for (const SetSummary& s : sets)
    if (s.status != "failed" && s.dof > 0) add("chi2/dof", "", s.chi2 / static_cast<double>(s.dof), s.name);
  for (const SetSummary& s : sets)
    for (const SensorRms& r : s.sensors) {
      add("rms " + r.name, r.unit, r.train, s.name);
      add("rms " + r.name + ", held out", r.unit, r.test, s.name);
    }
  if (!quantities.empty()) {
    std::vector<std::vector<std::string>> rows = {{"", "unit", "median", "worst", ""}};
    for (Quantity& q : quantities) {
      std::stable_sort(q.values.begin(), q.values.end(), [](const auto& x, const auto& y) { return x.first < y.first; });
      const auto& worst = q.values.back();
      const double median = (q.values[(q.values.size() - 1) / 2].first + q.values[q.values.size() / 2].first) / 2;
      rows.push_back({q.name, q.unit.name, value(median, q.unit.factor), value(worst.first, q.unit.factor), worst.second});
    }
    out += align(rows, 2);
  }
  std::vector<std::vector<std::string>> failing;
  for (const SetSummary& s : sets)
    if (s.fails()) failing.push_back({s.name, s.status, s.error});
  if (!failing.empty()) out += "\nNot converged, or not to be relied on\n" + align(failing, 3);
  return out;
}

std::string diagnosis_text(const Diagnosis& d) {
  std::string out;
  for (const Finding& f : d.findings) out += f.id + ": " + f.text + "\n";
  if (d.findings.empty()) {
    out += "Nothing found. Tested: ";
    for (size_t i = 0; i < d.tested.size(); ++i) out += (i ? ", " : "") + d.tested[i];
    out += "\n";
  }
  return out + d.verdict + "\n";
}

std::string local_report(const Rig& rig, const LocalCalibration& local) {
  std::string out = format("%d samples near, the nearest at %.3g, %d within %.4g (largest difference of a joint, rad or m)\n", local.near,
                           local.distances.front(), local.samples, local.radius);
  if (local.gain) {
    out += "\nOffsets around this posture, to be added to the joints' positions\n";
    std::vector<std::vector<std::string>> rows = {{"joint", "offset", "sigma", "unit", ""}};
    for (const LocalOffset& o : local.offsets) {
      const Joint& joint = rig.tree.joints[o.joint];
      const Unit unit = shown(joint.type == JointType::prismatic ? "m" : "rad");
      rows.push_back({joint.name, format("%+.4g", o.offset * unit.factor), "± " + format("%.2g", o.sigma * unit.factor), unit.name,
                      o.determined ? "" : "not determined near here"});
    }
    out += align(rows, 1);
    out += format("\nValid while no joint is further than %.4g from the posture", local.radius);
    out += local.ends ? "\n" : ": the furthest sample looked at. Where the gain ends is not known; if it never does, calibrate again\n";
  } else {
    out += "\nNo gain: the global calibration is as good here. Offsets are 0\n";
  }
  out += local.gain ? "\nErrors within that (rms, readings as they are; each sample predicted without itself)\n"
                    : "\nErrors nearby with offsets that were tried (rms, readings as they are; each sample predicted without itself)\n";
  const bool test = std::any_of(local.sensors.begin(), local.sensors.end(), [](const SensorResult& s) { return s.test.points > 0; });
  std::vector<std::vector<std::string>> rows = {{"sensor", "unit", "points", "before", "after"}};
  if (test) rows[0].insert(rows[0].end(), {"held out: points", "before", "after"});
  for (const SensorResult& s : local.sensors)
    for (bool rotation : {false, true}) {
      if (rotation && !s.whole_pose) continue;
      const Unit unit = shown(rotation ? "rad" : s.unit);
      std::vector<std::string> row = {rotation ? "" : s.name, unit.name};
      for (const SplitStatistics* split : {&s.train, &s.test}) {
        if (split == &s.test && !test) continue;
        row.push_back(rotation ? "" : std::to_string(split->points));
        row.push_back(value(rotation ? split->rotation_before : split->rms_before, unit.factor));
        row.push_back(value(rotation ? split->rotation_as_read : split->rms_as_read, unit.factor));
      }
      rows.push_back(row);
    }
  out += align(rows, 2);
  out += format("chi2 in the directions of the offsets %.4g -> %.4g: gain %.3g ± %.2g; noise %.3g times as stated\n", local.chi2_before,
                local.chi2, local.chi2_before - local.chi2, local.gain_sigma, local.noise);
  return out;
}

}  // namespace kincal
