#include "validation_table.h"

#include <cmath>

#include "table.h"

namespace kincal {

std::string unfinished_text(const std::vector<Unfinished>& all, bool held_out_only) {
  std::string out;
  for (const Unfinished& u : all) {
    if (held_out_only && u.train) continue;
    out += "  not converged: " + u.column + (u.train ? " of training, " : " of held-out data, ") +
           text("in %zu sample%s, first '", u.samples.size(), u.samples.size() == 1 ? "" : "s") +
           u.samples.front() + "'\n";
  }
  return out;
}

namespace {

/// Simpler calibrations beside this one, on the same held-out samples.
std::string baselines_table(const Baselines& b) {
  std::vector<std::vector<std::string>> rows = {{"sensor", "unit", "points", "over"}};
  if (b.rig) rows[0].push_back("rig as it is");
  for (const char* head : {"mounts alone", "this", "this / mounts alone", "95 %"})
    rows[0].push_back(head);
  for (const Baseline& row : b.rows) {
    const Unit unit = shown(row.unit);
    const bool second = &row != &b.rows[0] && (&row - 1)->sensor == row.sensor;
    rows.push_back(
        {second ? "" : row.sensor, unit.name, second ? "" : std::to_string(row.points),
         second ? "" : std::to_string(row.blocks) + (row.by_target ? " targets" : " samples")});
    if (b.rig) rows.back().push_back(value(row.rig, unit.factor));
    rows.back().push_back(value(row.mounts, unit.factor));
    rows.back().push_back(value(row.automatic, unit.factor));
    rows.back().push_back(value(row.ratio));
    rows.back().push_back(std::isfinite(row.of_ratio.low)
                              ? value(row.of_ratio.low) + " to " + value(row.of_ratio.high)
                              : "-");
  }
  return std::string("\nBeside simpler calibrations (rms as read, ") +
         (b.cross_validated ? "each sample by the calibrations that lack it" : "held out") +
         "; a ratio above 1: this is worse)\n" + align(rows, 2);
}

/// The stages of the calibration, a line a sensor: each with its ratio to the stage before.
std::string stages_table(const StageErrors& stages) {
  std::string out;
  for (const StageError& row : stages.rows) {
    const Unit unit = shown(row.unit);
    const std::string rms = value(row.rms, unit.factor) + " " + unit.name;
    if (std::isnan(row.ratio)) {
      out += "\n  " + row.sensor + ": rigid " + rms;
      continue;
    }
    const std::string added = row.added.size() == 1
                                  ? row.added[0]
                                  : std::to_string(row.added.size()) + " curves";  // one at a time
    out += ", + " + added + " " + rms + " (x " + value(row.ratio);
    if (std::isfinite(row.of_ratio.low))
      out += ", 95 % " + value(row.of_ratio.low) + " to " + value(row.of_ratio.high);
    out += ")";
  }
  return std::string("\nWithout and with bending and curves (rms as read, ") +
         (stages.cross_validated ? "cross-validated" : "held out") +
         "; x: ratio to the one before)" + out + "\n";
}

/// What predictions of frames assume on the automatic path; "": nothing.
std::string assumption_text(const std::vector<AutomaticGroup>& groups) {
  constexpr size_t kMost = 3;
  std::vector<std::string> names;
  for (const bool unseen : {true, false})
    for (const AutomaticGroup& g : groups)
      for (const AutomaticNumber& n : unseen ? g.unseen : g.numbers)
        if (unseen || n.told < 0.1) names.push_back(n.name);
  if (names.empty()) return "";
  std::string list;
  for (size_t i = 0; i < names.size() && i < kMost; ++i) list += (i ? ", " : "") + names[i];
  if (names.size() > kMost) list += ", and " + std::to_string(names.size() - kMost) + " more";
  return "  parameters that the data do not determine (" + list +
         ") count with the prior width of their group, learned from its other members: an "
         "assumption\n";
}

}  // namespace

std::string validation_table(const Report& report) {
  const Validation& v = report.validation;
  std::string out;
  const auto errors = [&](const std::vector<HeldOutError>& sensors) {
    std::vector<std::vector<std::string>> rows = {{"sensor", "unit", "points", "over", "median",
                                                   "rms", "95 %", "as read", "95 %",
                                                   "training as read"}};
    const auto interval = [](const Interval& i, double factor) {
      return std::isfinite(i.low) ? value(i.low, factor) + " to " + value(i.high, factor) : "-";
    };
    for (const HeldOutError& e : sensors)
      for (bool rotation : {false, true}) {
        if (rotation && !e.measures_pose) continue;
        const Unit unit = shown(rotation ? "rad" : e.unit);
        double train = std::nan("");
        for (const SensorResult& s : report.residuals.sensors)
          if (s.name == e.sensor) train = rotation ? s.train.rotation_as_read : s.train.rms_as_read;
        std::string over = std::to_string(e.blocks) + (e.by_target ? " targets" : " samples");
        if (e.missing > 0) over += ", " + std::to_string(e.missing) + " views missing";
        rows.push_back({rotation ? "" : e.sensor, unit.name,
                        rotation ? "" : std::to_string(e.points), rotation ? "" : over,
                        rotation ? "" : value(e.median, unit.factor),
                        value(rotation ? e.rotation : e.rms, unit.factor),
                        interval(rotation ? e.of_rotation : e.of_rms, unit.factor),
                        value(rotation ? e.rotation_as_read : e.rms_as_read, unit.factor),
                        interval(rotation ? e.of_rotation_as_read : e.of_rms_as_read, unit.factor),
                        value(train, unit.factor)});
      }
    return align(rows, 2);
  };
  if (!v.test.empty())
    out += "\nHeld out (rms of data that the fit did not see, with 95 % intervals)\n" +
           errors(v.test) + unfinished_text(report.residuals.unfinished, true);
  if (v.cross_validation) {
    const CrossValidation& c = *v.cross_validation;
    out += text(
               "\nCross-validation, %zu folds%s (rms of each sample by the calibration that lacks "
               "it)\n",
               c.folds.size(), c.by_target ? ", whole targets held out" : "") +
           errors(c.sensors);
    size_t rejected = 0;
    for (const CrossValidation::Fold& fold : c.folds) rejected += fold.rejected.size();
    if (c.reject)
      out +=
          text("  tested with outliers included; %zu were removed from the training of the folds\n",
               rejected);
    for (size_t f = 0; f < c.folds.size(); ++f) {
      const CrossValidation::Fold& fold = c.folds[f];
      const char* wrong =
          !fold.error.empty() ? "no calibration: "
          : !fold.converged   ? "not converged"
          : !fold.judged      ? "joint errors or targets of its own samples: not converged"
          : !fold.determined  ? "the other folds do not determine every estimated parameter"
                              : nullptr;
      if (wrong) out += text("  fold %zu: ", f + 1) + wrong + fold.error + "\n";
    }
    std::string never;
    for (const std::string& n : c.never) never += (never.empty() ? "" : ", ") + n;
    if (!never.empty())
      out += "  never held out (the only data of a sensor, target or joint): " + never + "\n";
  }
  if (v.baselines) out += baselines_table(*v.baselines);
  if (v.stages) out += stages_table(*v.stages);
  if (!v.frames.empty()) {
    out += "\nFrames relative to " + v.frames[0].base +
           " (predicted sigma over postures; last column: with the noise of one reading of each "
           "joint)\n";
    std::vector<std::vector<std::string>> rows = {
        {"frame", "postures", "unit", "rms", "median", "worst", "rms with readings"}};
    for (const FrameReport& f : v.frames)
      for (const FrameSigma& s : f.workspaces)
        for (bool rotation : {false, true}) {
          const SigmaStatistics &alone = rotation ? s.rotation : s.position,
                                &read =
                                    rotation ? s.rotation_with_readings : s.position_with_readings;
          const bool first = &s == &f.workspaces[0] && !rotation;
          rows.push_back({first ? f.frame : "",
                          rotation ? ""
                                   : std::to_string(s.postures) + (s.workspace == "samples"
                                                                       ? " of the samples"
                                                                       : " in the joints' limits"),
                          rotation ? "mrad" : "mm",
                          std::isfinite(alone.rms) ? value(alone.rms, 1e3) : "not determined",
                          value(alone.median, 1e3), value(alone.worst, 1e3), value(read.rms, 1e3)});
        }
    out += align(rows, 2);
    for (const FrameReport& f : v.frames) {
      std::string held;
      for (const std::string& n : f.held) held += (held.empty() ? "" : ", ") + n;
      if (!held.empty())
        out +=
            "  " + f.frame + ": taken as exact, because the last step fixes them: " + held + "\n";
    }
    out += assumption_text(report.automatic);
  }
  if (!v.requirements.empty()) out += "\nTolerances\n";
  for (const Judgement& j : v.requirements)
    out += std::string(j.met ? "  met: " : "  NOT MET: ") + judgement_text(j) + "\n";
  return out;
}

}  // namespace kincal
