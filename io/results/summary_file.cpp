#include "summary_file.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "../document/files.h"
#include "../document/numbers.h"
#include "csv.h"
#include "result_json.h"

namespace kincal {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double number_or_none(const Json& json) { return json.is_null() ? kNone : json.get<double>(); }

Json set_json(const SetSummary& set) {
  Json out = {{"status", set.status},
              {"exit_code", set.exit_code},
              {"verdict", set.verdict},
              {"error", set.error}};
  if (set.status != "failed") {
    out["chi2"] = number(set.chi2);
    out["dof"] = set.dof;
    out["chi2_data"] = number(set.chi2_data);
    out["dof_data"] = number(set.dof_data);
    out["chi2_per_dof"] = number(set.chi2_per_dof());
  }
  out["seconds"] = number(set.seconds);
  out["warnings"] = set.warnings;
  out["sensors"] = Json::object();
  for (const SensorRms& s : set.sensors)
    out["sensors"][s.name] = {
        {"unit", s.unit}, {"train", number(s.train)}, {"test", number(s.test)}};
  out["parameters"] = Json::object();
  for (const Change& c : set.changes)
    out["parameters"][c.name] = {{"unit", c.unit},
                                 {"initial", number(c.initial)},
                                 {"value", number(c.value)},
                                 {"sigma", number(c.sigma)}};
  out["poses"] = Json::object();
  for (const AbsolutePose& p : set.poses)
    out["poses"][p.name] = {{"xyz", numbers({p.xyz.x(), p.xyz.y(), p.xyz.z()})},
                            {"rpy", numbers({p.rpy.x(), p.rpy.y(), p.rpy.z()})}};
  return out;
}

SetSummary read_set(const Json& json) {
  SetSummary set;
  set.status = json.at("status").get<std::string>();
  set.exit_code = json.at("exit_code").get<int>();
  set.verdict = json.at("verdict").get<std::string>();
  set.error = json.at("error").get<std::string>();
  set.chi2 = number_or_none(json.at("chi2"));
  set.dof = json.at("dof").get<long>();
  set.chi2_data = number_or_none(json.at("chi2_data"));
  set.dof_data = number_or_none(json.at("dof_data"));
  set.seconds = number_or_none(json.at("seconds"));
  set.warnings = json.at("warnings").get<std::vector<std::string>>();
  for (const auto& s : json.at("sensors").items())
    set.sensors.push_back({s.key(), s.value().at("unit").get<std::string>(),
                           number_or_none(s.value().at("train")),
                           number_or_none(s.value().at("test"))});
  for (const auto& c : json.at("parameters").items()) {
    const Json& v = c.value();
    set.changes.push_back({c.key(), v.at("unit").get<std::string>(),
                           number_or_none(v.at("initial")), number_or_none(v.at("value")),
                           number_or_none(v.at("sigma"))});
  }
  const auto vector = [](const Json& v) {
    return Vector3d(number_or_none(v.at(0)), number_or_none(v.at(1)), number_or_none(v.at(2)));
  };
  for (const auto& p : json.at("poses").items())
    set.poses.push_back({p.key(), vector(p.value().at("xyz")), vector(p.value().at("rpy"))});
  return set;
}

std::string cell(double v) { return std::isfinite(v) ? shortest(v) : ""; }

std::string heading(const std::string& name, const std::string& unit) {
  return unit.empty() ? name : name + " [" + unit + "]";
}

/// What columns are of.
enum class ColumnKind { sensors, changes, poses };
constexpr ColumnKind kColumnKinds[] = {ColumnKind::sensors, ColumnKind::changes, ColumnKind::poses};

/// The columns of a set. A value that is no number, and a parameter that did not change, need no
/// column.
std::vector<std::pair<std::string, double>> entries(const SetSummary& set, ColumnKind columns) {
  std::vector<std::pair<std::string, double>> all;
  if (columns == ColumnKind::poses) {
    const char* names[] = {"x", "y", "z", "roll", "pitch", "yaw"};
    for (const AbsolutePose& p : set.poses)
      for (int c = 0; c < 6; ++c)
        all.push_back({heading("absolute " + p.name + "." + names[c], c < 3 ? "m" : "rad"),
                       c < 3 ? p.xyz(c) : p.rpy(c - 3)});
  } else if (columns == ColumnKind::changes) {
    for (const Change& c : set.changes)
      if (c.value != c.initial) all.push_back({heading(c.name, c.unit), c.value - c.initial});
  } else {
    for (const SensorRms& s : set.sensors) {
      all.push_back({heading("rms " + s.name + " train", s.unit), s.train});
      all.push_back({heading("rms " + s.name + " test", s.unit), s.test});
    }
  }
  all.erase(std::remove_if(all.begin(), all.end(),
                           [](const auto& e) { return !std::isfinite(e.second); }),
            all.end());
  return all;
}

}  // namespace

double SetSummary::chi2_per_dof() const { return dof_data > 0 ? chi2_data / dof_data : kNone; }

SetSummary summarize(const Report& report) {
  const Solution& solution = report.solution;
  SetSummary set;
  set.status = status_name(solution.status);
  set.chi2 = solution.chi2;
  set.dof = solution.dof;
  set.chi2_data = solution.chi2_data;
  set.dof_data = solution.dof_data;
  set.verdict = report.verdict.use;
  if (set.verdict == "no") set.error = sentences(report.verdict);
  for (const Notice& w : report.warnings)
    set.warnings.push_back(std::string(id(w.kind)) + ": " + sentences(w));
  for (const Judgement& j : report.validation.requirements)
    if (set.error.empty() && !j.met) set.error = "not met: " + judgement_text(j);
  if (set.error.empty() && set.verdict == "doubts") set.error = sentences(report.verdict);
  for (const SensorResult& s : report.residuals.sensors) {
    set.sensors.push_back({s.name, s.unit, s.train.rms, s.test.rms});
    if (s.measures_pose)
      set.sensors.push_back({s.name + "/rotation", "rad", s.train.rotation, s.test.rotation});
  }
  for (const ParameterEstimate& e : solution.parameters) {
    if (e.pose)
      set.poses.push_back({e.name, e.pose->translation, rpy_from_rotation(e.pose->rotation)});
    for (size_t c = 0; c < e.value.size(); ++c)
      if (e.sigma[c] != 0)  // 0: held
        set.changes.push_back(
            {e.component_name(c), e.units[c], e.initial[c], e.value[c], e.sigma[c]});
  }
  return set;
}

std::string record_text(const BatchRecord& r) {
  const Json json = {{"kincal", r.version},   {"options", r.options}, {"rig", r.rig},
                     {"samples", r.samples},  {"urdf", r.urdf},       {"robot", r.robot},
                     {"set", set_json(r.set)}};
  return json_text(json);
}

std::optional<BatchRecord> read_record(const std::string& path) {
  try {
    const Json json = Json::parse(read_file(path));
    BatchRecord r;
    r.version = json.at("kincal").get<std::string>();
    r.options = json.at("options").get<std::string>();
    r.rig = json.at("rig").get<std::string>();
    r.samples = json.at("samples").get<std::string>();
    r.urdf = json.at("urdf").get<std::string>();
    r.robot = json.at("robot").get<std::string>();
    r.set = read_set(json.at("set"));
    return r;
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

std::string summary_csv(const std::vector<SetSummary>& sets) {
  std::vector<std::string> columns;
  std::map<std::string, size_t> index;
  for (ColumnKind kind : kColumnKinds)
    for (const SetSummary& set : sets)
      for (const auto& e : entries(set, kind))
        if (index.emplace(e.first, columns.size()).second) columns.push_back(e.first);

  std::string out = "name,status,exit_code,verdict,error,chi2,dof,chi2_per_dof,warnings";
  for (const std::string& name : columns) out += "," + csv_field(name);
  out += "\n";
  for (const SetSummary& set : sets) {
    out += csv_field(set.name) + "," + set.status + "," + std::to_string(set.exit_code) + "," +
           set.verdict + "," + csv_field(set.error) + ",";
    if (set.status == "failed") {
      out += ",,,";
    } else {
      out += cell(set.chi2) + "," + std::to_string(set.dof) + "," + cell(set.chi2_per_dof()) + "," +
             std::to_string(set.warnings.size());
    }
    std::vector<std::string> cells(columns.size());
    for (ColumnKind kind : kColumnKinds)
      for (const auto& e : entries(set, kind)) cells[index[e.first]] = shortest(e.second);
    for (const std::string& c : cells) out += "," + c;
    out += "\n";
  }
  return out;
}

std::string summary_json(const std::vector<SetSummary>& sets, const std::string& version,
                         const std::string& options, size_t ignored) {
  Json json = {{"kincal", version}, {"options", options}, {"sets", sets.size()}};
  for (const char* status : {"converged", "unobservable", "not_converged", "unexplained", "failed"})
    json[status] = std::count_if(sets.begin(), sets.end(),
                                 [&](const SetSummary& s) { return s.status == status; });
  json["ignored"] = ignored;
  json["results"] = Json::object();
  Json& results = json["results"];
  for (const SetSummary& set : sets)
    results.get_ref<Json::object_t&>().emplace_back(set.name, set_json(set));
  return json_text(json);
}

}  // namespace kincal
