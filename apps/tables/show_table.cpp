#include "show_table.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <sstream>

#include "../../kinematics/transform.h"
#include "../../models/notices/notice.h"
#include "table.h"

namespace kincal {
namespace {

constexpr size_t kTrack = 18, kMostChanges = 5, kMostLines = 4;
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

double number_or_unknown(const Field& field) {
  return field.node->kind == Node::Kind::null ? kUnknown : field.number();
}

/// A row of the table of errors; of a pose's rotation the sensor has no name.
struct ErrorRow {
  std::string sensor, from;
  Unit unit;
  double before, after, as_read;
};

std::vector<ErrorRow> error_rows(const Field& result) {
  std::vector<ErrorRow> out;
  const Field sensors = result["sensors"];
  for (const auto& [name, ignored] : sensors.members()) {
    const Field sensor = sensors[name];
    const bool held_out = sensor["test"]["points"].number() > 0;
    const Field split = sensor[held_out ? "test" : "train"];
    for (const std::string kind : {"rms", "rms_rotation"}) {
      if (!split.has(kind)) continue;
      const Unit unit = shown(kind == "rms" ? sensor["unit"].string() : "rad");
      const auto rms = [&](const char* when) {
        return unit.factor * number_or_unknown(split[kind + when]);
      };
      out.push_back({kind == "rms" ? name : "", held_out ? "held out" : "fit", unit, rms("_before"),
                     rms(""), rms("_as_read")});
    }
  }
  return out;
}

/// Before and after on a line, logarithmic, the same for all sensors of a unit.
std::string track(const ErrorRow& row, std::pair<double, double> range) {
  if (!(row.before > 0) || !(row.after > 0)) return "";
  const auto place = [&](double v) {
    const double share = std::log(v / range.first) / std::log(range.second / range.first);
    return static_cast<size_t>(std::lround(std::isfinite(share) ? share * (kTrack - 1) : 0));
  };
  const size_t from = place(row.before), to = place(row.after);
  std::string out;
  for (size_t i = 0; i < kTrack; ++i)
    out += i == to                                            ? "●"
           : i == from                                        ? "□"
           : i > std::min(from, to) && i < std::max(from, to) ? "─"
                                                              : " ";
  return out;
}

/// The table; without its drawing, column 1, where it is too wide for a terminal.
std::string narrowed(std::vector<std::vector<std::string>> rows) {
  std::string out = align(rows, 2);
  std::istringstream lines(out);
  for (std::string line; std::getline(lines, line);)
    if (shown_width(line) > kTerminal) {
      for (auto& row : rows) row.erase(row.begin() + 1);
      return align(rows, 1);
    }
  return out;
}

std::string error_table(const Field& result) {
  const std::vector<ErrorRow> all = error_rows(result);
  std::map<std::string, std::pair<double, double>> ranges;  // by unit
  for (const ErrorRow& row : all)
    for (const double v : {row.before, row.after})
      if (v > 0) {
        auto& range = ranges.insert({row.unit.name, {v, v}}).first->second;
        range = {std::min(range.first, v), std::max(range.second, v)};
      }
  std::vector<std::vector<std::string>> rows = {
      {"sensor", "□ before ● after", "before", "after", "in use", "", "data"}};
  for (const ErrorRow& row : all)
    rows.push_back({row.sensor, track(row, ranges[row.unit.name]), text("%.3g", row.before),
                    text("%.3g", row.after), text("%.3g", row.as_read), row.unit.name, row.from});
  for (auto& row : rows)
    for (std::string& cell : row)
      if (cell == "nan") cell = "-";
  return "Errors, rms (in use: joint readings taken as they come)\n" + narrowed(rows);
}

/// The name of component `c` of a parameter's `size` ones; a result has numbers only.
std::string part_name(const std::string& parameter, size_t c, size_t size) {
  static const std::vector<std::string> kPose = {"x", "y", "z", "rx", "ry", "rz"},
                                        kIntrinsics = {"fx", "fy", "cx", "cy"},
                                        kPrint = {"stretch", "shear"},
                                        kFisheye = {"k1", "k2", "k3", "k4"},
                                        kLens = {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"};
  const std::string kind = parameter.substr(parameter.rfind('/') + 1);
  if (size == 1) return "";
  if (kind == "curve") return std::to_string(c);
  if (kind == "points") return std::to_string(c / 3) + "." + kPose[c % 3];
  const std::vector<std::string>& names = kind == "intrinsics"   ? kIntrinsics
                                          : kind == "print"      ? kPrint
                                          : kind != "distortion" ? kPose
                                          : size == 4            ? kFisheye
                                                                 : kLens;
  return c < names.size() ? names[c] : std::to_string(c + 1);
}

/// A pose that the rig does not have.
bool is_new(const Field& parameter) {
  return parameter.has("nominal") && !parameter["nominal"].boolean();
}

std::string change_table(const Field& result) {
  struct Change {
    double weight, size;
    std::vector<std::string> cells;
  };
  std::vector<Change> changes;
  const Field parameters = result["parameters"];
  for (const auto& [name, ignored] : parameters.members()) {
    const Field p = parameters[name];
    if (is_new(p)) continue;
    const std::vector<std::string> units = p["unit"].strings();
    const std::vector<double> before = p["initial"].vector(), after = p["value"].vector();
    if (before.size() != after.size() || units.size() != after.size())
      p.fail("unit, initial and value have one entry per component");
    for (size_t c = 0; c < after.size(); ++c) {
      const double sigma = number_or_unknown(p["sigma"].item(c));
      if (sigma == 0) continue;  // held
      const Unit unit = shown(units[c]);
      double change = after[c] - before[c];
      if (std::isfinite(sigma) && std::abs(change) < 1e-6 * sigma) change = 0;  // rounding
      changes.push_back(
          {weight_of(change, units[c]),
           std::abs(change),
           {component_name(name, p.has("components") ? p["components"].item(c).string()
                                                     : part_name(name, c, after.size())),
            text("%+.4g", change * unit.factor),
            std::isfinite(sigma) ? text("± %.2g", sigma * unit.factor) : "not known", unit.name}});
    }
  }
  std::stable_sort(changes.begin(), changes.end(),
                   [](const Change& a, const Change& b) { return a.weight > b.weight; });
  if (changes.empty()) return "";
  std::vector<std::vector<std::string>> rows;
  for (size_t i = 0; i < std::min(changes.size(), kMostChanges); ++i) {
    const double share = changes[0].weight > 0 ? changes[i].weight / changes[0].weight : 0;
    std::string bar;
    for (long k = std::lround(12 * share); k > 0; --k) bar += "▇";
    rows.push_back({changes[i].cells[0], bar});
    rows.back().insert(rows.back().end(), changes[i].cells.begin() + 1, changes[i].cells.end());
  }
  return "\nLargest changes, of " + std::to_string(changes.size()) + "\n" + narrowed(rows);
}

/// Poses that the rig does not have: their values, which are no changes.
std::string new_table(const Field& result) {
  std::vector<std::vector<std::string>> rows;
  const Field parameters = result["parameters"];
  for (const auto& [name, ignored] : parameters.members()) {
    const Field p = parameters[name];
    if (!is_new(p)) continue;
    const Pose pose = p["pose"].pose();
    const Vector3d rpy = rpy_from_rotation(pose.rotation), &xyz = pose.translation;
    double sigma[2] = {0, 0};  // the largest of each three; NaN stays
    for (size_t c = 0; c < 6; ++c) {
      const double s = number_or_unknown(p["sigma"].item(c));
      if (!(s <= sigma[c / 3])) sigma[c / 3] = s;
    }
    const auto row = [&](const std::string& first, const char* what, const Vector3d& v,
                         double largest, const char* unit) {
      const double factor = unit[0] == 'm' ? 1e3 : 1;
      rows.push_back({first, what});
      for (int c = 0; c < 3; ++c)
        rows.back().push_back(text(factor > 1 ? "%.2f" : "%.4f", v(c) * factor));
      rows.back().push_back(std::isfinite(largest) ? text("± %.2g", largest * factor)
                                                   : "not known");
      rows.back().push_back(unit);
    };
    row(name, "xyz", xyz, sigma[0], "mm");
    row("", "rpy", rpy, sigma[1], "rad");
  }
  return rows.empty()
             ? ""
             : "\nNew, because the rig has no value (largest sigma of three)\n" + align(rows, 2);
}

/// The first lines of a list, and how many more there are.
std::string some_lines(const std::string& title, const std::vector<std::string>& all) {
  if (all.empty()) return "";
  std::string out = "\n" + title + "\n";
  for (size_t i = 0; i < std::min(all.size(), kMostLines); ++i) out += wrapped(all[i], "  ", 4);
  if (all.size() > kMostLines) out += text("  ... and %zu more\n", all.size() - kMostLines);
  return out;
}

std::vector<std::string> weak_lines(const Field& result) {
  std::vector<std::string> out;
  const Field weak = result["weak_directions"];
  for (size_t i = 0; i < weak.size(); ++i) {
    const Field w = weak.item(i);
    const Unit unit = shown(w["unit"].string());
    const double sigma = number_or_unknown(w["sigma"]);
    if (w["parameters"].size() == 0) w["parameters"].fail("at least one is expected");
    out.push_back(w["parameters"].members().front().first + ": " +
                  (std::isfinite(sigma) ? "± " + value(sigma, unit.factor) + " " + unit.name
                                        : "not determined") +
                  "; " + w["cure"].string());
  }
  return out;
}

/// Findings or warnings of a result, but for those that its verdict speaks of. (A finding that is a
/// remark stands among the warnings.)
std::vector<std::string> unsaid(const Field& result, const char* key, bool remarks) {
  const Field list = result[key];
  std::vector<std::string> out;
  for (size_t i = 0; i < list.size(); ++i) {
    const Field notice = list.item(i);
    const bool remark = notice.has("severity") && notice["severity"].string() == "remark";
    if (!notice.has("in_verdict") && (remarks || !remark))
      out.push_back(notice["id"].string() + ": " + notice["text"].string());
  }
  return out;
}

}  // namespace

std::string verdict_lines(const Field& result) {
  const Field verdict = result["verdict"];
  const std::vector<std::string> next = verdict["next"].strings();
  return verdict["use"].string() + ": " + verdict["why"].string() +
         "\nWhat to do: " + (next.empty() ? "nothing" : next[0]) + "\n";
}

std::string verdict_details(const Field& result) {
  const Field verdict = result["verdict"];
  std::string out;
  const auto add = [&](const char* key, size_t first) {
    if (!verdict.has(key)) return;
    const std::vector<std::string> all = verdict[key].strings();
    for (size_t i = first; i < all.size(); ++i) out += wrapped(capital(all[i]) + ".", "  ", 4);
  };
  add("reasons", 0);
  add("next", 1);
  add("notes", 0);
  return out.empty() ? out : "\nMore on that\n" + out;
}

std::string more_data_line(const Field& result) {
  if (!result.has("more_data")) return "";
  const Field more = result["more_data"];
  std::string out = text(
      "More data: three times as many samples like these would reduce the predicted error of the "
      "targets' positions relative to the sensors from %.2g to %.2g mm",
      1e3 * more["error"].number(), 1e3 * more["thrice"].number());
  if (more["readings"].number() > 0)
    out += text("; one reading of the joints adds %.2g mm", 1e3 * more["readings"].number());
  out += more["worth"].boolean() ? ": worth it" : ": not worth it";
  const std::vector<std::string> open = more["open"].strings();
  for (size_t i = 0; i < open.size(); ++i)
    out += (i ? ", "
              : "; the rest is mostly due to parameters that samples like these hardly "
                "determine: ") +
           open[i];
  return "\n" + wrapped(out + ". (`kincal plan` proposes postures.)", "", 0);
}

std::string show_text(const Field& result, bool all) {
  std::string out = verdict_lines(result);
  if (all) {
    std::string of = result["scene"]["robot"].string();
    for (const char* key : {"serial", "time"})
      if (result.has(key)) of += ", " + result[key].string();
    of += "; calibrated " + result["input"]["date"].string() + ", kincal " +
          result["kincal"].string();
    out += "\n" + wrapped(of, "", 0);
  }
  out += verdict_details(result);
  if (result.has("findings"))
    out += some_lines("What else may be wrong", unsaid(result, "findings", false));
  out += "\n" + error_table(result) + change_table(result) + new_table(result);
  if (all) out += some_lines("Poorly determined by the data", weak_lines(result));
  return out + some_lines("Warnings", unsaid(result, "warnings", true)) + more_data_line(result);
}

}  // namespace kincal
