#include "certificate.h"

#include <algorithm>

#include "../../models/rig/words.h"
#include "../document/files.h"
#include "../document/json.h"

namespace kincal {
namespace {

std::string judged_words(const Verification& found) {
  return found.tolerance->rotation ? "rotations" : found.distances ? "distances" : "positions";
}

/// The share of errors that are below the largest one. Pairs of postures that share none count as
/// pairs.
double share_of_largest(const Verification& found) {
  const long postures = found.judged().postures;
  return share_below_largest(found.distances ? postures / 2 : postures);
}

}  // namespace

std::string answer_text(const Verification& found) {
  if (!found.tolerance) return "No tolerance was given.";
  const AccuracyFigure& figure = found.judged();
  const bool largest = found.largest;
  const Requirement& tolerance = *found.tolerance;
  const double per = 1 / tolerance.factor;
  const std::string limit = text("%.4g %s", per * tolerance.limit, tolerance.unit.c_str()),
                    seen = text("%.4g %s (k = 2: %.4g to %.4g)",
                                per * (largest ? figure.max : figure.rms), tolerance.unit.c_str(),
                                per * (largest ? figure.max_lower : figure.lower),
                                per * (largest ? figure.max_upper : figure.upper)),
                    of = (largest ? "largest error of " : "rms error of ") + judged_words(found) +
                         " of " + found.frame;
  switch (found.answer) {
    case Conformity::pass:
      return "pass: " + of + " is " + seen + ", below " + limit +
             (largest ? text(", of %ld measured postures; so are %.3g %% of all %s distributed "
                             "like these, at least.",
                             figure.postures, 100 * share_of_largest(found),
                             judged_words(found).c_str())
                      : ".");
    case Conformity::fail:
      return "fail: " + of + " is " + seen + ", above " + limit + ".";
    case Conformity::not_provable:
      break;
  }
  return "not provable with this instrument and " + std::to_string(figure.postures) +
         " postures: " + of + " is " + seen + ", which contains " + limit + "; " +
         (largest            ? "not more postures but repeated ones, or a better instrument, could."
          : found.needed < 0 ? "no number of postures can prove it with this instrument."
                             : "about " + std::to_string(found.needed) + " postures would.");
}

std::string verification_text(const Verification& found) {
  std::string out = answer_text(found) + "\n\n";
  out += text("  %-15s %10s %10s %21s %10s %10s\n", "rms error", "before", "after", "k = 2",
              "as seen", "largest");
  const auto row = [&](const char* name, const AccuracyFigure& before,
                       const AccuracyFigure& after) {
    const std::string limits =
        after.freedom > 0 ? text("%.4g to %.4g", 1e3 * after.lower, 1e3 * after.upper) : "";
    out += text("  %-15s %10.4g %10.4g %21s %10.4g %10.4g\n", name, 1e3 * before.rms,
                1e3 * after.rms, limits.c_str(), 1e3 * after.seen, 1e3 * after.max);
  };
  row("distances, mm", found.before.distance, found.after.distance);
  row("positions, mm", found.before.position, found.after.position);
  if (found.after.rotation.postures)
    row("rotations, mrad", found.before.rotation, found.after.rotation);
  out += text(
      "%ld postures, %d views by '%s' (sigma %.3g mm); before: the nominal robot, the "
      "instrument's pose fitted to these samples",
      found.after.position.postures, found.views, found.sensor.c_str(), 1e3 * found.sensor_sigma);
  out += found.refitted ? ", as after.\n" : ".\n";
  if (!found.repeated.empty()) {
    double ap = 0, rp = 0, vap = 0;
    for (const RepeatedPosture& one : found.repeated) {
      ap = std::max(ap, one.ap);
      rp = std::max(rp, one.rp);
      vap = std::max(vap, one.vap);
    }
    out +=
        text("%zu postures repeat: accuracy AP at most %.4g mm, repeatability RP at most %.4g mm",
             found.repeated.size(), 1e3 * ap, 1e3 * rp);
    out += vap > 0 ? text(", vAP at most %.4g mm.\n", 1e3 * vap) : ".\n";
  }
  for (const std::string& note : found.notes) out += "Note: " + note + ".\n";
  return out;
}

namespace {

Json figure_json(const AccuracyFigure& figure) {
  Json out = {
      {"rms", number(figure.rms)}, {"seen", number(figure.seen)}, {"max", number(figure.max)}};
  out["lower"] = number(figure.lower);
  out["upper"] = number(figure.upper);
  out["max_lower"] = number(figure.max_lower);
  out["max_upper"] = number(figure.max_upper);
  out["instrument"] = number(figure.instrument);
  out["freedom"] = number(figure.freedom);
  return out;
}

Json figures_json(const VerifiedFigures& figures) {
  Json out = {{"distance", figure_json(figures.distance)},
              {"position", figure_json(figures.position)}};
  if (figures.rotation.postures) out["rotation"] = figure_json(figures.rotation);
  return out;
}

Json repeated_json(const Verification& found) {
  Json out = Json::array();
  for (const RepeatedPosture& one : found.repeated) {
    Json item = {{"posture", found.postures[one.posture]},
                 {"count", one.count},
                 {"ap", number(one.ap)},
                 {"ap_uncertainty", number(one.ap_uncertainty)},
                 {"rp", number(one.rp)},
                 {"rp_uncertainty", number(one.rp_uncertainty)}};
    if (one.turned) item["rp_rotation"] = vector3(one.rp_rotation);
    if (one.approaches > 1) item["vap"] = number(one.vap);
    out.push_back(std::move(item));
  }
  return out;
}

std::string answer_word(const Verification& found) {
  return !found.tolerance                   ? "none"
         : found.answer == Conformity::pass ? "pass"
         : found.answer == Conformity::fail ? "fail"
                                            : "not provable";
}

}  // namespace

Json certificate_json(const VerifiedResult& result, const SampleSet& samples,
                      const Verification& found, const VerifySettings& settings) {
  const ResultOptions record = record_of(settings.command, samples.hash);
  const Node node = parse_json(result.result_json, result.files.path);
  const Field all = top(node, result.files.path);
  const RigFile& rig_file = result.files.rig_file;
  const std::string serial = settings.serial.empty() ? rig_file.serial : settings.serial;
  const auto given = [](const std::string& words) { return words.empty() ? Json() : Json(words); };
  Json postures = Json::array();
  for (size_t i = 0; i < found.postures.size(); ++i)
    postures.push_back({{"id", found.postures[i]},
                        {"error", number(found.errors[i])},
                        {"before", number(found.nominal[i])}});
  Json tolerance;
  if (found.tolerance)
    tolerance = {{"text", found.tolerance->text},
                 {"limit", found.tolerance->limit},
                 {"of", found.largest ? "max" : "rms"},
                 {"quantity", found.tolerance->rotation ? "rotation"
                              : found.distances         ? "distance"
                                                        : "position"},
                 {"share", found.largest ? Json(share_of_largest(found)) : Json()},
                 {"needed", found.needed < 0 ? Json() : Json(found.needed)}};
  return {{"certificate", "kincal/1"},
          {"answer", answer_word(found)},
          {"text", answer_text(found)},
          {"standard", found.distances ? "distances" : "iso9283"},
          {"tolerance", tolerance},
          {"robot", {{"name", found.robot}, {"serial", given(serial)}}},
          {"instrument",
           {{"sensor", found.sensor},
            {"target", found.target},
            {"frame", found.frame},
            {"name", given(settings.instrument)},
            {"sigma", number(found.sensor_sigma)},
            {"known", kInstrumentKnown},
            {"base_sigma", number(found.base_sigma)},
            {"refitted", found.refitted}}},
          {"environment", given(settings.environment)},
          {"dates",
           {{"calibrated", all.has("input") && all["input"].has("date")
                               ? Json(all["input"]["date"].string())
                               : Json()},
            {"measured", given(settings.measured)},
            {"issued", record.date}}},
          {"sha256",
           {{"result.json", sha256(result.result_json)},
            {"rig.yaml", sha256(rig_file.text)},
            {"robot.urdf", sha256(rig_file.urdf.text)},
            {"samples", samples.hash}}},
          {"counts", {{"postures", found.after.position.postures}, {"views", found.views}}},
          {"before", figures_json(found.before)},
          {"after", figures_json(found.after)},
          {"scatter", {{"sigma", number(found.scatter.sigma)}, {"freedom", found.scatter.freedom}}},
          {"repeated", repeated_json(found)},
          {"postures", postures},
          {"notes", found.notes},
          {"command", record.command},
          {"kincal", record.version}};
}

}  // namespace kincal
