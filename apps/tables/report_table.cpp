#include "report_table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "../../io/document/numbers.h"
#include "../../io/job/check.h"
#include "../../models/report/warnings.h"
#include "../../models/rig/numbers.h"
#include "../../models/rig/scales.h"
#include "plan_table.h"
#include "show_table.h"
#include "table.h"
#include "validation_table.h"

namespace kincal {
namespace {

/// A pose that the rig does not have.
bool is_new(const Solution& solution, const ParameterEstimate& e) {
  return std::count(solution.computed_starts.begin(), solution.computed_starts.end(), e.name) > 0;
}

/// The `most` components of parameters that changed most, with sigmas.
std::string parameter_table(const Report& report, size_t most) {
  std::vector<WeightedRow> lines;
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; c < e.value.size(); ++c) {
      if (e.sigma[c] == 0 || is_new(report.solution, e)) continue;
      const Unit unit = shown(e.units[c]);
      const double change = e.value[c] - e.initial[c];
      lines.push_back({weight_of(change, e.units[c]),
                       {component_name(e.name, e.components[c]), value(e.initial[c], unit.factor),
                        value(e.value[c], unit.factor), text("%+.4g", change * unit.factor),
                        std::isfinite(e.sigma[c]) ? "± " + text("%.2g", e.sigma[c] * unit.factor)
                                                  : "not determined",
                        unit.name}});
    }
  sort_by_weight(lines);
  // Where targets stand is seldom what one wants to know: a few of these behind the robot and its
  // sensors.
  std::vector<std::vector<std::string>> rows = {
      {"parameter", "before", "after", "change", "sigma", "unit"}};
  for (bool target : {false, true}) {
    size_t room = target ? most / 3 : most;
    for (const WeightedRow& line : lines)
      if ((line.cells[0].rfind("target/", 0) == 0) == target && room > 0)
        rows.push_back(line.cells), --room;
  }
  std::string out = align(rows, 1);
  if (lines.size() + 1 > rows.size())
    out += "  ... and " + std::to_string(lines.size() + 1 - rows.size()) + " more in result.json\n";
  return out;
}

/// The paper's figure 10: sensors that look down, sensors that are looked into across; training
/// samples.
std::string loop_table(const Report& report) {
  constexpr size_t kColumns = 6;  // at a time
  const auto cell = [&](const std::string& from, const std::string& to) -> std::string {
    for (const Loop& loop : report.loops) {
      if (loop.from != from || loop.to != to || loop.train.points == 0) continue;
      const auto rms = [&](double v) {
        return std::isfinite(v) ? text("%.3g", v * shown(loop.unit).factor) : "-";
      };
      return rms(loop.train.rms_before) + "→" + rms(loop.train.rms);
    }
    return "";
  };
  std::vector<const SensorResult*> seen, looking;  // columns, rows
  for (const SensorResult& s : report.residuals.sensors) {
    const auto trained = [](const Loop& loop) { return loop.train.points > 0; };
    if (std::any_of(report.loops.begin(), report.loops.end(),
                    [&](const Loop& l) { return trained(l) && l.to == s.name; }))
      seen.push_back(&s);
    if (std::any_of(report.loops.begin(), report.loops.end(),
                    [&](const Loop& l) { return trained(l) && l.from == s.name; }))
      looking.push_back(&s);
  }
  std::string out;
  for (size_t first = 0; first < seen.size(); first += kColumns) {
    const size_t last = std::min(seen.size(), first + kColumns);
    std::vector<std::vector<std::string>> rows = {{"from \\ to"}};
    for (size_t c = first; c < last; ++c)
      rows[0].push_back(seen[c]->name + " " + shown(seen[c]->unit).name);
    for (const SensorResult* from : looking) {
      rows.push_back({from->name});
      for (size_t c = first; c < last; ++c)
        rows.back().push_back(from == seen[c] ? "" : cell(from->name, seen[c]->name));
    }
    out += align(rows, 1);
  }
  return out;
}

/// The minima that restarts found; `converged`: the result's last step.
std::string restart_table(const Restarts& restarts, bool converged) {
  const int own = restarts.minima[0].count, failed = restarts.failed;
  std::string out = text("  %d of %d end in this minimum", own, restarts.count);
  if (failed)
    out += text(", %d failed (%d not converged, %d could not start)", failed,
                restarts.not_converged, failed - restarts.not_converged);
  out += "\n";
  if (restarts.minima.size() == 1) return out;
  std::vector<std::vector<std::string>> rows = {{"restarts", "cost", "most different, in sigmas"}};
  for (size_t i = 0; i < restarts.minima.size(); ++i) {
    const Minimum& m = restarts.minima[i];
    std::string names = i == 0 ? converged ? "this result" : "this result (not converged)" : "";
    for (size_t k = 0; k < m.differs.size() && k < 3; ++k)
      names += (k ? ", " : "") + m.differs[k].first + text(" %+.3g", m.differs[k].second);
    rows.push_back({std::to_string(m.count), text("%.8g", m.cost), names});
  }
  return out + align(rows, 3);
}

/// Whether a number that the data do not tell is known all the same to 1 cm or 1 degree.
bool is_bounded(const WeakDirection& w) {
  return w.sigma_with_priors < pose_scales(w.unit).yardstick;
}

/// Weak directions, what priors decide, strong correlations. `automatic`: the priors are what the
/// groups are found to be off, none of the user's.
std::string weak_text(const Explanation& e, bool automatic) {
  std::string out;
  constexpr size_t kMost = 6;
  std::vector<const WeakDirection*> open;
  std::vector<std::string> bounded;  // by what their groups are assumed to be off
  for (const WeakDirection& w : e.weak)
    if (automatic && is_bounded(w))
      bounded.push_back(w.parameters[0].first);
    else
      open.push_back(&w);
  for (size_t i = 0; i < open.size() && i < kMost; ++i) {
    const WeakDirection& w = *open[i];
    const Unit unit = shown(w.unit);
    out += "  " + w.parameters[0].first + ": ";
    out += std::isfinite(w.sigma)
               ? "± " + value(w.sigma, unit.factor) + " " + unit.name + " from the data alone"
               : "not determined by the data";
    if (std::isfinite(w.sigma_with_priors) && w.sigma_with_priors != w.sigma)
      out += ", ± " + value(w.sigma_with_priors, unit.factor) + " " + unit.name +
             (automatic ? " with the prior of its group" : " with the prior");
    out += "\n    why: " + w.why + "\n    cure: " + w.cure + "\n";
  }
  if (open.size() > kMost)
    out += "  ... and " + std::to_string(open.size() - kMost) + " more directions in result.json\n";
  const auto line = [&](const std::string& title, const std::vector<std::string>& all) {
    if (all.empty()) return;
    out += "  " + title + ": ";
    for (size_t i = 0; i < all.size() && i < kMost; ++i) out += (i ? ", " : "") + all[i];
    out += all.size() > kMost ? ", and " + std::to_string(all.size() - kMost) + " more\n" : "\n";
  };
  std::vector<std::string> priors, pairs;
  for (const PriorDecides& p : e.prior_decides) priors.push_back(p.name);
  for (const Correlation& c : e.correlations)
    pairs.push_back(c.a + " with " + c.b + text(" (%+.4f)", c.correlation));
  line("hardly or not determined by the data (the priors of their groups count in all sigmas)",
       bounded);
  line(automatic ? "no better than its prior" : "the prior decides", priors);
  line("strong correlations", pairs);
  return out.empty() ? out : "\nWeakly determined parameters\n" + out;
}

/// Sigmas that the data contradict, or what was estimated.
std::string noise_text(const Report& report) {
  std::string out;
  for (const NoiseLevel& l : report.noise_levels) {
    if (l.guess > 0 || (report.noise_estimated ? l.used == l.assumed : !l.differs())) continue;
    const Unit unit = shown(l.unit);
    const std::string name = l.of.substr(l.of.find('/') + 1) + (l.part.empty() ? "" : " " + l.part),
                      unit_name = " " + unit.name;
    out += "  " + name + ": assumed " + value(l.assumed, unit.factor) + unit_name;
    if (report.noise_estimated) out += ", now " + value(l.used, unit.factor) + unit_name;
    if (std::isfinite(l.seen)) {
      if (!report.noise_estimated) out += ", seen " + value(l.seen, unit.factor) + unit_name;
      out += text(" (± %.2g %%)", 100 * l.uncertainty);
    } else {
      out += " (cannot be estimated beside the others)";
    }
    out += "\n";
  }
  if (out.empty()) return out;
  return (report.noise_estimated ? "\nNoise, estimated from the data\n"
                                 : "\nNoise estimated from the data beside the rig's sigmas (model "
                                   "errors count as noise; --estimate-noise)\n") +
         out;
}

/// The samples without which a parameter would move most.
std::string leverage_table(const std::vector<Leverage>& leverage) {
  constexpr size_t kMost = 5;
  std::vector<std::vector<std::string>> rows;
  std::set<std::string> samples;
  for (const Leverage& l : leverage)
    if (samples.insert(l.sample).second && rows.size() < kMost)  // of each sample the worst
      rows.push_back({"without " + l.sample, l.parameter,
                      std::isfinite(l.moved_sigmas)
                          ? "would move by " + text("%+.2g", l.moved_sigmas) + " sigmas"
                          : "is not determined"});
  std::string out = align(rows, 3);
  if (samples.size() > rows.size())
    out += text("  ... and %zu more in result.json\n", samples.size() - rows.size());
  return out;
}

/// What `--reject` took out: counts, and the first of it.
std::string rejected_table(const std::vector<Rejected>& rejected) {
  constexpr size_t kMost = 20;
  size_t points = 0, views = 0, samples = 0;
  std::string lines;
  for (bool ids : {false, true})  // samples and views first
    for (const Rejected& r : rejected) {
      if (r.ids.empty() == ids) continue;
      (ids ? points : r.sensor.empty() ? samples : views) += ids ? r.ids.size() : 1;
      if (points + views + samples == 0 ||
          static_cast<size_t>(std::count(lines.begin(), lines.end(), '\n')) >= kMost)
        continue;
      lines += "  sample " + r.sample;
      if (!r.sensor.empty()) lines += ", " + r.sensor + " of " + r.target;
      for (size_t i = 0; i < r.ids.size(); ++i)
        lines += (i                   ? ", "
                  : r.ids.size() == 1 ? ", point "
                                      : ", points ") +
                 std::to_string(r.ids[i]);
      lines += ": " + r.reason + "\n";
    }
  if (rejected.size() > kMost)
    lines += text("  ... and %zu more lines in result.json\n", rejected.size() - kMost);
  return text("Removed as gross outliers: %zu %s, %zu %s, %zu %s\n", samples,
              samples == 1 ? "sample" : "samples", views, views == 1 ? "view" : "views", points,
              points == 1 ? "point" : "points") +
         lines;
}

}  // namespace

std::string residual_table(const std::vector<SensorResult>& sensors, bool before) {
  const bool test = std::any_of(sensors.begin(), sensors.end(),
                                [](const SensorResult& s) { return s.test.points > 0; });
  const bool train = std::any_of(sensors.begin(), sensors.end(),
                                 [](const SensorResult& s) { return s.train.points > 0; });
  const bool uncorrected = std::any_of(sensors.begin(), sensors.end(), [](const SensorResult& s) {
    return std::isfinite(s.train.rms_uncorrected) || std::isfinite(s.test.rms_uncorrected);
  });
  std::vector<std::vector<std::string>> rows = {{"sensor", "unit"}};
  for (const char* split : {"train", "held out"}) {
    if ((split[0] == 't' && !train) || (split[0] == 'h' && !test)) continue;
    rows[0].push_back(std::string(split) + ": points");
    if (before) rows[0].push_back("before");
    rows[0].push_back(before ? "after" : "rms");
    rows[0].push_back("as read");
    if (uncorrected) rows[0].push_back("robot.urdf alone");
  }
  for (const SensorResult& s : sensors)
    for (bool rotation : {false, true}) {
      if (rotation && !s.measures_pose) continue;
      const Unit unit = shown(rotation ? "rad" : s.unit);
      std::vector<std::string> row = {rotation ? "" : s.name, unit.name};
      for (const SplitStatistics* split : {&s.train, &s.test}) {
        if ((split == &s.train && !train) || (split == &s.test && !test)) continue;
        row.push_back(rotation ? "" : std::to_string(split->points));
        if (before)
          row.push_back(value(rotation ? split->rotation_before : split->rms_before, unit.factor));
        row.push_back(value(rotation ? split->rotation : split->rms, unit.factor));
        row.push_back(value(rotation ? split->rotation_as_read : split->rms_as_read, unit.factor));
        if (uncorrected)
          row.push_back(
              value(rotation ? split->rotation_uncorrected : split->rms_uncorrected, unit.factor));
      }
      rows.push_back(row);
    }
  return align(rows, 2);
}

std::string diagnosis_text(const Diagnosis& d) {
  std::string out;
  for (const Notice& f : d.findings) out += with_id(f) + "\n";
  if (d.findings.empty()) {
    out += explained(d) ? "Nothing found. Tested: "
                        : "None of the usual mistakes explains the data. Tested: ";
    for (size_t i = 0; i < d.tested.size(); ++i) out += (i ? ", " : "") + d.tested[i];
    out += "\n";
  }
  return out + d.verdict + "\n";
}

std::string no_start_text(const std::string& message, const std::optional<Diagnosis>& found) {
  if (!found) return message;
  const Diagnosis& diagnosis = *found;
  const std::string heading = "What may be wrong (kincal check):\n";
  if (diagnosis.findings.empty()) return message + "\n" + heading + diagnosis_text(diagnosis);
  return with_id(diagnosis.findings[0]) + "\nSo no calibration can start: " + message + "\n" +
         heading + diagnosis_text(diagnosis);
}

namespace {

/// Estimated mounts to be copied.
std::string mount_lines(const std::vector<MountText>& mounts, bool has_urdf) {
  constexpr size_t kMounts = 6;
  std::string out;
  if (!mounts.empty())
    out += std::string("\nMounts") + (has_urdf ? " that no joint of robot.urdf has" : "") +
           ", to copy (also in changes.yaml)\n";
  for (size_t i = 0; i < std::min(mounts.size(), kMounts); ++i) {
    out += "  " + mounts[i].name + "\n    ";
    for (const char c : mounts[i].urdf + "\n" + mounts[i].ros2)
      out += c == '\n' ? "\n    " : std::string(1, c);
    out += "\n";
  }
  if (mounts.size() > kMounts)
    out += text("  and %d more\n", static_cast<int>(mounts.size() - kMounts));
  return out;
}

}  // namespace

std::string short_text(const Report& report, const ResultFiles& files) {
  constexpr size_t kMost = 3;
  const std::string place = "result.json";
  std::string out = show_text(top(files.told(), place), false);
  if (report.diagnosis && report.diagnosis->findings.empty())
    out += "\nWhat may be wrong (kincal check)\n" +
           wrapped(std::string(explained(*report.diagnosis) ? "nothing found; "
                                                            : "none of the usual mistakes; ") +
                       report.diagnosis->verdict,
                   "  ", 2);
  const Validation& v = report.validation;  // of held-out data the table above has the errors
  if (v.cross_validation || !v.frames.empty() || !v.requirements.empty())
    out += validation_table(report);
  if (report.restarts)
    out += "\nRestarts from other starting values\n" +
           restart_table(*report.restarts, report.solution.steps.back().converged);
  if (!report.rejected.empty()) out += "\n" + rejected_table(report.rejected);
  const std::vector<std::string>& left = files.not_in_urdf;
  if (files.robot_urdf.empty() || left.empty()) return out;
  std::string names;
  for (size_t i = 0; i < std::min(left.size(), kMost); ++i) names += (i ? ", " : "") + left[i];
  if (left.size() > kMost) names += text(" and %zu more", left.size() - kMost);
  return out + "\n" +
         wrapped(names + " (rig.yaml has them)", "Not in robot.urdf, which cannot express it: ", 2);
}

std::string report_text(const Report& report, const ResultFiles& files) {
  const Node result = files.told();
  const Field told = top(result, "result.json");
  std::string out = verdict_lines(told) + verdict_details(told) + "\n";
  const std::string diagnosed =
      report.diagnosis ? "What may be wrong (kincal check)\n" + diagnosis_text(*report.diagnosis)
                       : "";
  const bool first = report.diagnosis && !report.diagnosis->findings.empty();
  if (first) out += diagnosed + "\n";
  for (const StepResult& step : report.solution.steps) {
    char line[64];
    std::snprintf(line, sizeof line, ": %d iterations, chi2 %.8g\n", step.iterations, step.chi2);
    out += step.name + line;
  }
  if (!report.automatic.empty())
    out += "\nGroups of parameters that may be wrong (the rig has no `estimate`)\n" +
           automatic_table(report.automatic) + dropped_text(report.tried);
  const bool converged = report.solution.status != Status::not_converged;
  out += std::string("\nResiduals (rms") + (converged ? "" : "; a step did not converge") + ")\n" +
         residual_table(report.residuals.sensors, true) +
         unfinished_text(report.residuals.unfinished);
  out += validation_table(report);
  if (report.restarts)
    out += "\nRestarts from other starting values\n" +
           restart_table(*report.restarts, report.solution.steps.back().converged);
  if (!report.loops.empty())
    out +=
        "\nLoops (rms before→after of one sensor's points in another's view of them, joint "
        "readings as read)\n" +
        loop_table(report);
  out += "\nParameters that changed most\n" + parameter_table(report, 12);
  if (!report.solution.computed_starts.empty()) {
    out += "\nPoses without a value in the rig (new, no changes)\n";
    std::vector<std::vector<std::string>> poses = {
        {"parameter", "x", "y", "z", "roll", "pitch", "yaw", ""}};
    for (const ParameterEstimate& e : report.solution.parameters)
      if (is_new(report.solution, e)) {
        const Vector3d& t = e.pose->translation;
        const Vector3d rpy = rpy_from_rotation(e.pose->rotation);
        std::vector<std::string> row = {e.name};
        for (double v : {t.x(), t.y(), t.z(), rpy.x(), rpy.y(), rpy.z()})
          row.push_back(text("%.6f", v));
        row.push_back("m, rad");
        poses.push_back(row);
      }
    out += align(poses, 1);
  }
  const Solution& solution = report.solution;
  out += solution.setup.priors.empty()
             ? text("\nchi2 %.8g, %ld degrees of freedom", solution.chi2, solution.dof)
             : text("\nchi2 of the data %.8g, %.1f degrees of freedom", solution.chi2_data,
                    solution.dof_data);
  if (solution.dof_data > 0) out += text(", chi2/dof %.4g", solution.chi2_per_dof());
  out += "\n";
  out += noise_text(report);
  out += weak_text(report.explanation, !report.automatic.empty());
  const bool has_urdf = !files.robot_urdf.empty();
  if (has_urdf && !files.not_in_urdf.empty()) {
    out += "\nNot in robot.urdf, which cannot express it (see rig.yaml and result.json)\n";
    for (const std::string& n : files.not_in_urdf) out += "  " + n + "\n";
  }
  out += mount_lines(files.mounts, has_urdf);
  if (!files.reductions.empty())
    out += "\nGear scales as mechanicalReduction (--write-reduction puts them into robot.urdf)\n";
  for (const Reduction& r : files.reductions)
    out += "  " + r.joint + ": scale " + text("%.6g", r.scale) + "; mechanicalReduction of " +
           r.transmission + " " + shortest(r.before) + " -> " + shortest(r.after) + "\n";
  if (!report.leverage.empty()) out += "\nInfluential samples\n" + leverage_table(report.leverage);
  if (!report.rejected.empty()) out += "\n" + rejected_table(report.rejected);
  if (!first && !diagnosed.empty()) out += "\n" + diagnosed;
  if (!report.warnings.empty()) {
    out += "\nWarnings\n";
    for (const Notice& w : report.warnings) {
      out += "  " + with_id(w);
      out += w.where.size() > kNamed ? " (all in result.json)\n" : "\n";
    }
  }
  return out;
}

}  // namespace kincal
