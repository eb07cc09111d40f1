#include "tables.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>

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

std::string loop_table(const std::vector<Loop>& loops) {
  constexpr size_t kColumns = 8;  // at a time
  std::vector<std::string> from, to;
  for (const Loop& loop : loops) {
    if (loop.train.points == 0) continue;
    if (std::find(from.begin(), from.end(), loop.from) == from.end()) from.push_back(loop.from);
    const std::string head = loop.to + " " + shown(loop.unit).name;
    if (std::find(to.begin(), to.end(), head) == to.end()) to.push_back(head);
  }
  std::string out;
  for (size_t first = 0; first < to.size(); first += kColumns) {
    std::vector<std::vector<std::string>> rows = {{"from \\ to"}};
    for (size_t c = first; c < std::min(to.size(), first + kColumns); ++c) rows[0].push_back(to[c]);
    for (const std::string& name : from) {
      rows.push_back({name});
      for (size_t c = first; c < std::min(to.size(), first + kColumns); ++c) {
        const auto loop = std::find_if(loops.begin(), loops.end(), [&](const Loop& l) {
          return l.train.points && l.from == name && l.to + " " + shown(l.unit).name == to[c];
        });
        const auto rms = [&](double v) { return std::isfinite(v) ? format("%.3g", v * shown(loop->unit).factor) : "-"; };
        rows.back().push_back(loop == loops.end() ? "" : rms(loop->train.rms_before) + "→" + rms(loop->train.rms));
      }
    }
    out += align(rows, 1);
  }
  return out;
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
  }
  return out;
}

std::string report(const CalibrationResult& result, const ResultFiles& files) {
  std::string out = "\nResiduals (rms)\n" + residual_table(result.sensors, true);
  if (!result.loops.empty())
    out +=
        "\nLoops (rms before→after of one sensor's points in another's view of them, joint readings as read)\n" + loop_table(result.loops);
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
  if (!files.not_in_urdf.empty()) {
    out += "\nNot in robot.urdf, which cannot express it (see rig.yaml and result.json)\n";
    for (const std::string& n : files.not_in_urdf) out += "  " + n + "\n";
  }
  if (!files.reductions.empty()) out += "\nGear scales as mechanicalReduction (--write-reduction puts them into robot.urdf)\n";
  for (const Reduction& r : files.reductions)
    out += "  " + r.joint + ": scale " + format("%.6g", r.scale) + "; mechanicalReduction of " + r.transmission + " " + shortest(r.before) +
           " -> " + shortest(r.after) + "\n";
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
    if (s.status != "converged") failing.push_back({s.name, s.status, s.error});
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

}  // namespace kincal
