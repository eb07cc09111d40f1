#include "fleet_files.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <set>
#include <stdexcept>

#include "../../models/rig/numbers.h"
#include "../../models/rig/scales.h"
#include "../../models/rig/selection.h"
#include "../../models/rig/words.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "csv.h"
#include "json_values.h"
#include "read_calibrated.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;
constexpr double kYear = 365.25 * 86400;  // s
constexpr int kLevels = 3;

void find_below(const fs::path& folder, int levels, std::vector<std::string>& out) {
  std::error_code ignored;
  if (fs::exists(folder / "result.json", ignored)) {
    out.push_back(folder.string());
    return;
  }
  if (levels == 0) return;
  std::vector<fs::path> folders;
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (entry.is_directory(ignored) && entry.path().filename().string()[0] != '.')
      folders.push_back(entry.path());
  std::sort(folders.begin(), folders.end());
  for (const fs::path& one : folders) find_below(one, levels - 1, out);
}

/// The name of a folder as serial and time: NAME, NAME-DATE or DATE (of the robot that the folder
/// above is called after).
void read_name(const std::string& folder, std::string& serial, std::string& date) {
  fs::path path = fs::absolute(folder).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  const std::string name = path.filename().string();
  for (size_t i = 0; i < name.size(); ++i) {
    const bool begins = i == 0 || name[i - 1] == '-' || name[i - 1] == '_' || name[i - 1] == '@';
    if (!begins || name.size() - i < 7) continue;
    try {
      seconds_of_date(name.substr(i));
    } catch (const std::invalid_argument&) {
      continue;
    }
    date = name.substr(i);
    serial = i > 1 ? name.substr(0, i - 1) : path.parent_path().filename().string();
    return;
  }
  serial = name;
}

/// Normal equations of information.csv, with the name of each unknown.
struct Information {
  std::vector<std::string> names;
  MatrixXd normal;
  VectorXd pull;
};

Information read_information(const std::string& path) {
  std::vector<std::vector<std::string>> rows;
  for_each_csv_row(read_file(path),
                   [&](const std::vector<std::string>& row) { rows.push_back(row); });
  if (rows.empty() || rows[0].size() != rows.size() || rows[0][0] != "pull")
    throw InputError(path +
                     ": a header that begins with `pull` and a row for every name in it are "
                     "expected");
  const auto n = static_cast<Eigen::Index>(rows.size()) - 1;
  Information out{{rows[0].begin() + 1, rows[0].end()}, MatrixXd::Zero(n, n), VectorXd::Zero(n)};
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::vector<std::string>& row = rows[i + 1];
    const std::string where = path + ":" + std::to_string(i + 2);
    if (row.size() != rows[0].size())
      throw InputError(where + ": as many fields as the header has are expected");
    out.pull(i) = csv_number(row[0], where);
    for (Eigen::Index j = 0; j <= i; ++j)
      out.normal(i, j) = out.normal(j, i) = csv_number(row[j + 1], where);
  }
  return out;
}

/// The numbers that results have in common.
struct CommonNumbers {
  std::vector<FleetNumber> numbers;
  std::map<std::string, int> index;
};

/// The poses that results count from, by parameter: those of the first that has it.
using References = std::map<std::string, Pose>;

Pose reference_of(const std::string& parameter, const Pose& own, References& references) {
  return references.insert({parameter, own}).first->second;
}

/// How far a joint's origin is turned or shifted along its own axis from that of the first result:
/// an offset that an earlier calibration has put into the robot.
double folded_offset(const CalibratedFiles& files, int joint, References& references) {
  const Joint& j = files.rig_file.rig.tree.joints[joint];
  const Parameter& origin = files.table.all[files.table.joint_origin[joint]];
  const Pose own = get_pose(files.values, origin.start),
             off = inverse(reference_of(origin.name, own, references)) * own;
  return j.type == JointType::prismatic ? j.axis.dot(off.translation)
                                        : j.axis.dot(log_so3(off.rotation));
}

/// The equations of one result in the fleet's numbers; `columns` get the number of each.
Evidence sight(const CalibratedFiles& files, Information data, const std::string& path,
               CommonNumbers& common, References& references, std::vector<int>& columns) {
  const ParameterTable& table = files.table;
  const auto n = data.pull.size();
  VectorXd at(n), scale(n);
  std::map<std::string, Component> components;
  for (size_t p = 0; p < table.all.size(); ++p)
    for (int c = 0; c < table.all[p].size() && !table.all[p].hidden(); ++c)
      components[table.all[p].component_name(c)] = {static_cast<int>(p), c};
  std::map<int, std::vector<Eigen::Index>> poses;  // columns of a pose's components
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto found = components.find(data.names[i]);
    if (found == components.end())
      throw InputError(path + ":1: '" + data.names[i] +
                       "' is not a parameter of the rig beside it");
    const Component c = found->second;
    const Parameter& p = table.all[c.parameter];
    scale(i) = scales(table, c, files.values).usual;
    if (p.pose) {
      const Pose own = get_pose(files.values, p.start);
      at(i) = log_se3(inverse(reference_of(p.name, own, references)) * own)(c.index);
      poses[c.parameter].push_back(i);
    } else {
      at(i) = files.values(p.start + c.index);
      if (p.kind == ParameterKind::joint_offset) at(i) += folded_offset(files, p.owner, references);
    }
    const auto added =
        common.index.insert({data.names[i], static_cast<int>(common.numbers.size())});
    if (added.second) common.numbers.push_back({data.names[i], table.unit(c), scale(i)});
    columns.push_back(added.first->second);
    scale(i) = common.numbers[added.first->second].scale;
  }
  // Increments of a wholly freed pose stand on the right at the estimate; its numbers are those of
  // x = Log(reference^-1 pose), and an increment is J_r(x) dx. (Of a partly freed one both are the
  // same to first order.)
  for (const auto& [parameter, own] : poses) {
    if (own.size() != 6) continue;
    Vector6d x;
    for (int c = 0; c < 6; ++c) x(c) = at(own[c]);
    const Matrix6d chart = right_jacobian_se3(x);
    MatrixXd change = MatrixXd::Identity(n, n);
    for (int a = 0; a < 6; ++a)
      for (int b = 0; b < 6; ++b) change(own[a], own[b]) = chart(a, b);
    data.normal = change.transpose() * data.normal * change;
    data.pull = change.transpose() * data.pull;
  }
  return evidence(data.normal, data.pull, at, scale);
}

/// Why a result says nothing of a healthy robot; "": it does.
std::string unusable(const CalibratedFiles& files, const std::string& path) {
  if (files.status != "converged" && files.status != "unobservable")
    return "its status is '" + files.status + "'";
  if (!file_exists(path + "/information.csv"))
    return "it has no information.csv: an earlier kincal wrote it; calibrate again";
  return "";
}

/// What a result began with: the priors of its rig or last step, and the values of its numbers.
struct Beginning {
  std::string priors;
  std::map<std::string, double> values;  // by component; none of poses, which count from each rig's
};

Beginning read_beginning(const CalibratedFiles& files, const Field& result) {
  Beginning out;
  const Rig& rig = files.rig_file.rig;
  for (const std::vector<PriorSetting>* priors :
       {&rig.priors, rig.steps.empty() ? &rig.priors : &rig.steps.back().priors})
    for (const PriorSetting& prior : *priors)
      out.priors +=
          prior.pattern + " " + shortest(prior.translation) + " " + shortest(prior.rotation) + "\n";
  const Field parameters = result["parameters"];
  for (const Parameter& p : files.table.all) {
    if (p.pose || !parameters.has(p.name)) continue;
    const std::vector<double> initial = parameters[p.name]["initial"].vector();
    for (size_t c = 0; c < initial.size() && c < p.components.size(); ++c)
      out.values[p.component_name(static_cast<int>(c))] = initial[c];
  }
  return out;
}

/// How one result's rig differs from that of most; "": not by more than robots differ.
std::string other_rig(const Beginning& one, const std::string& priors,
                      const std::map<std::string, double>& middle,
                      const std::vector<FleetNumber>& numbers) {
  if (one.priors != priors) return "its rig has other priors than most";
  double most = 1;
  std::string out;
  for (const FleetNumber& n : numbers) {
    const auto found = one.values.find(n.name);
    if (found == one.values.end() || !(n.scale > 0)) continue;
    const double off = found->second - middle.at(n.name);
    if (!(std::abs(off) > most * n.scale)) continue;
    most = std::abs(off) / n.scale;
    out = n.name + " began " + text("%.3g ", off) + n.unit + " from where it began in most";
  }
  return out;
}

void find_other_rigs(const std::vector<Beginning>& beginnings, Fleet& fleet) {
  std::map<std::string, size_t> count;
  std::map<std::string, std::vector<double>> values;
  for (const Beginning& one : beginnings) {
    ++count[one.priors];
    for (const auto& [name, value] : one.values) values[name].push_back(value);
  }
  const auto usual = std::max_element(
      count.begin(), count.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  std::map<std::string, double> middle;
  for (auto& [name, of_all] : values) middle[name] = median(std::move(of_all));
  for (size_t i = 0; i < beginnings.size(); ++i)
    if (const std::string how = other_rig(beginnings[i], usual->first, middle, fleet.numbers);
        !how.empty())
      fleet.other_rigs.push_back({fleet.results[i].path, how});
}

/// A result as it was read: its files, the data's equations and what it began with; or why it is
/// left out.
struct OneResult {
  CalibratedFiles files;
  Information data;
  Beginning beginning;
  FleetResult result;  // without its evidence
  std::string why;
};

OneResult read_result(const std::string& path) {
  OneResult one{read_calibrated(path), {}, {}, {}, ""};
  one.why = unusable(one.files, path);
  if (!one.why.empty()) return one;
  one.result.path = path;
  const std::string where = path + "/result.json";
  const Node node = parse_json(read_file(where), where);
  const Field all = top(node, where);
  read_name(path, one.result.serial, one.result.date);
  if (all.has("serial")) one.result.serial = all["serial"].string();
  if (all.has("time")) one.result.date = all["time"].string();
  if (one.result.date.empty()) one.result.date = all["input"]["date"].string();
  try {
    one.result.time = seconds_of_date(one.result.date) / kYear;
  } catch (const std::invalid_argument& error) {
    throw InputError(where + ": time: " + error.what());
  }
  one.data = read_information(path + "/information.csv");
  // Residuals larger than stated: what they tell is worth less.
  const double dof = all["dof_data"].number(),
               ratio = dof > 0 ? std::max(1.0, all["chi2_data"].number() / dof) : 1;
  one.data.normal /= ratio;
  one.data.pull /= ratio;
  one.beginning = read_beginning(one.files, all);
  return one;
}

std::set<std::string> moving_joints(const OneResult& one) {
  std::set<std::string> out;
  for (const Joint& joint : one.files.rig_file.rig.tree.joints)
    if (joint.moves()) out.insert(joint.name);
  return out;
}

/// Robots of which less than half of the moving joints are those of the kind that most are: where a
/// SCARA's board stands says nothing of an arm's.
void leave_out_other_robots(std::vector<OneResult>& all, Fleet& fleet) {
  constexpr double kSameKind = 0.5;  // of all joints that one of the two has
  std::map<std::set<std::string>, size_t> count;
  for (const OneResult& one : all) ++count[moving_joints(one)];
  if (count.size() < 2) return;
  const std::set<std::string> usual =
      std::max_element(count.begin(), count.end(), [](const auto& a, const auto& b) {
        return a.second < b.second;
      })->first;
  std::vector<OneResult> kept;
  for (OneResult& one : all) {
    const std::set<std::string> own = moving_joints(one);
    size_t common = 0;
    for (const std::string& name : own) common += usual.count(name);
    const size_t either = own.size() + usual.size() - common;
    if (static_cast<double>(common) >= kSameKind * static_cast<double>(either))
      kept.push_back(std::move(one));
    else
      fleet.left_out.push_back(
          {one.result.path, text("it is of another robot: %zu of its %zu moving joints are among "
                                 "those of most results. Judge robots of its kind separately",
                                 common, own.size())});
  }
  all = std::move(kept);
}

std::string robot_name(const FleetRobot& robot) { return csv_field(robot.serial); }

std::string field(double v) { return std::isfinite(v) ? "," + shortest(v) : ","; }

Json slope_json(const Slope& slope) {
  return {{"value", number(slope.value)}, {"sigma", number(slope.sigma)}};
}

}  // namespace

std::vector<std::string> find_results(const std::vector<std::string>& paths) {
  std::vector<std::string> out;
  std::set<std::string> seen;
  for (const std::string& path : paths) {
    std::error_code ignored;
    if (!fs::is_directory(path, ignored))
      throw InputError(path +
                       ": is not a directory: result directories are expected, or folders of them");
    std::vector<std::string> below;
    find_below(path, kLevels, below);
    if (below.empty())
      throw InputError(path +
                       ": there is no result directory in it (a folder with a result.json, as "
                       "`kincal calibrate` and `kincal batch` write them)");
    for (const std::string& one : below)
      if (seen.insert(fs::weakly_canonical(one, ignored).string()).second) out.push_back(one);
  }
  return out;
}

double seconds_of_date(const std::string& text) {
  int year = 0, month = 0, day = 1, hour = 0, minute = 0, used = 0;
  double second = 0;
  const auto refuse = [&] {
    throw std::invalid_argument("'" + text +
                                "' is not a date like 2026-03-01 or 2026-03-01T12:30:00Z");
  };
  const char* rest = text.c_str();
  if (std::sscanf(rest, "%4d-%2d%n", &year, &month, &used) != 2 || used != 7) refuse();
  rest += used;
  if (*rest == '-') {
    if (std::sscanf(rest, "-%2d%n", &day, &used) != 1 || used != 3) refuse();
    rest += used;
    if (*rest == 'T' || *rest == '_' || *rest == ' ') {
      if (std::sscanf(++rest, "%2d%*1[:-]%2d%n", &hour, &minute, &used) != 2 || used != 5) refuse();
      rest += used;
      int whole = 0;
      if (*rest == ':' || *rest == '-') {
        if (std::sscanf(++rest, "%2d%n", &whole, &used) != 1 || used != 2) refuse();
        rest += used;
        second = whole;
        if (*rest == '.') rest += 1 + std::string(rest + 1).find_first_not_of("0123456789");
      }
      int zone_hour = 0, zone_minute = 0;
      if (*rest == '+' || *rest == '-') {
        const int sign = *rest == '-' ? -1 : 1;
        if (std::sscanf(++rest, "%2d:%2d%n", &zone_hour, &zone_minute, &used) != 2 || used != 5)
          refuse();
        rest += used;
        second -= sign * (3600.0 * zone_hour + 60.0 * zone_minute);
      } else if (*rest == 'Z') {
        ++rest;
      }
    }
  }
  if (*rest || month < 1 || month > 12 || day < 1 || day > 31 || hour > 24 || minute > 59) refuse();
  // Days from civil (Hinnant): March begins the year.
  const int y = month <= 2 ? year - 1 : year, era = y / 400, of_era = y - 400 * era,
            of_year = (153 * (month + (month > 2 ? -3 : 9)) + 2) / 5 + day - 1;
  const int leap_days = of_era / 4 - of_era / 100;
  const double days = 146097.0 * era + 365.0 * of_era + leap_days + of_year - 719468;
  return 86400 * days + 3600.0 * hour + 60.0 * minute + second;
}

Fleet read_fleet(const std::vector<std::string>& results, const Progress& progress) {
  Fleet out;
  std::vector<OneResult> all;
  for (size_t i = 0; i < results.size(); ++i) {
    try {
      OneResult one = read_result(results[i]);
      if (one.why.empty())
        all.push_back(std::move(one));
      else
        out.left_out.push_back({results[i], one.why});
    } catch (const InputError& error) {  // one that is damaged is no reason to judge none
      out.left_out.push_back({results[i], std::string("it cannot be read: ") + error.what()});
    }
    progress.share(static_cast<double>(i + 1), static_cast<double>(results.size()));
  }
  leave_out_other_robots(all, out);
  CommonNumbers common;
  References of_all;
  std::map<std::string, References> of_robot;  // by serial
  std::map<std::string, int> count;
  for (const OneResult& one : all) ++count[one.result.serial];
  std::vector<std::vector<int>> columns;
  std::vector<Beginning> beginnings;
  for (OneResult& one : all) {
    FleetResult& result = one.result;
    const std::string path = result.path + "/information.csv";
    columns.emplace_back();
    if (count[result.serial] > 1)
      result.over_time =
          sight(one.files, one.data, path, common, of_robot[result.serial], columns.back());
    columns.back().clear();
    result.evidence = sight(one.files, std::move(one.data), path, common, of_all, columns.back());
    if (out.results.empty()) out.reference = result.path;
    beginnings.push_back(std::move(one.beginning));
    out.results.push_back(std::move(result));
  }
  if (out.results.empty())
    throw InputError(out.left_out[0].first + ": " + out.left_out[0].second +
                     (results.size() > 1 ? "; no other result can be used either" : ""));
  // Joint offsets come first: of what explains the same they are what is off most often.
  std::vector<int> place(common.numbers.size());
  for (const bool offsets : {true, false})
    for (size_t c = 0; c < common.numbers.size(); ++c) {
      const std::string& name = common.numbers[c].name;
      const bool is = name.rfind("joint/", 0) == 0 && name.substr(name.rfind('/')) == "/offset";
      if (is != offsets) continue;
      place[c] = static_cast<int>(out.numbers.size());
      out.numbers.push_back(common.numbers[c]);
    }
  find_other_rigs(beginnings, out);
  for (size_t i = 0; i < out.results.size(); ++i) {
    for (Evidence* e : {&out.results[i].evidence, &out.results[i].over_time}) {
      const MatrixXd own = std::move(e->rows);
      e->rows = MatrixXd::Zero(own.rows(), static_cast<Eigen::Index>(out.numbers.size()));
      for (Eigen::Index c = 0; c < own.cols(); ++c) e->rows.col(place[columns[i][c]]) = own.col(c);
    }
  }
  return out;
}

std::vector<int> fleet_numbers(const Fleet& fleet, const std::vector<std::string>& patterns,
                               const std::string& where) {
  std::set<int> out;
  for (const std::string& pattern : patterns) {
    bool any = false;
    std::vector<std::string> names;
    for (size_t c = 0; c < fleet.numbers.size(); ++c) {
      const std::string& name = fleet.numbers[c].name;
      const std::string parameter = name.substr(0, name.find('.', name.rfind('/') + 1));
      names.push_back(parameter);
      if (name != pattern && parameter != pattern && !glob_matches(pattern, name) &&
          !glob_matches(pattern, parameter))
        continue;
      out.insert(static_cast<int>(c));
      any = true;
    }
    if (!any && !where.empty())
      throw InputError(where + ": '" + pattern + "' matches no parameter of the results" +
                       nearest_names(pattern, names));
  }
  return {out.begin(), out.end()};
}

std::string robots_csv(const Fleet& fleet, const FleetFindings& findings) {
  std::string out =
      "serial,results,time,result,p,out_of_family,family_p,distance,equations,number,unit,off,"
      "sigma,"
      "drifts,drift_p\n";
  for (const FleetRobot& robot : findings.robots) {
    const FleetResult& latest = fleet.results[robot.results.back()];
    out += robot_name(robot) + "," + std::to_string(robot.results.size()) + "," +
           csv_field(latest.date) + "," + csv_field(latest.path) + field(robot.p);
    if (robot.member) {
      out += std::string(",") + (robot.out_of_family ? "yes" : "no") + field(robot.member->p) +
             field(robot.member->distance) + "," + std::to_string(robot.member->equations);
      if (robot.member->numbers.empty()) {
        out += ",,,,";
      } else {
        const OffNumber& worst = robot.member->numbers[0];
        const FleetNumber& is = fleet.numbers[worst.number];
        out += "," + csv_field(is.name) + "," + is.unit + field(worst.off) + field(worst.sigma);
      }
    } else {
      out += ",,,,,,,,";
    }
    out += robot.drift ? std::string(",") + (robot.drifts() ? "yes" : "no") + field(robot.drift->p)
                       : ",,";
    out += "\n";
  }
  return out;
}

std::string family_csv(const Fleet& fleet, const FleetFindings& findings) {
  std::string out = "serial,number,unit,off,sigma,in_sigmas\n";
  for (const FleetRobot& robot : findings.robots) {
    if (!robot.member) continue;
    for (const OffNumber& off : robot.member->numbers) {
      const FleetNumber& is = fleet.numbers[off.number];
      out += robot_name(robot) + "," + csv_field(is.name) + "," + is.unit + field(off.off) +
             field(off.sigma) + field(off.off / off.sigma) + "\n";
    }
  }
  return out;
}

std::string drift_csv(const Fleet& fleet, const FleetFindings& findings) {
  std::string out =
      "serial,number,unit,per_year,per_year_sigma,per_year_in_sigmas,changed_at,change,change_"
      "sigma,"
      "change_in_sigmas\n";
  for (const FleetRobot& robot : findings.robots) {
    if (!robot.drift) continue;
    for (const NumberDrift& drift : robot.drift->numbers) {
      const FleetNumber& is = fleet.numbers[drift.number];
      out += robot_name(robot) + "," + csv_field(is.name) + "," + is.unit;
      if (drift.line.sigma > 0)
        out += field(drift.line.value) + field(drift.line.sigma) + field(drift.line.in_sigmas());
      else
        out += ",,,";
      if (drift.change.sigma > 0)
        out += "," + csv_field(fleet.results[robot.results[drift.from]].date) +
               field(drift.change.value) + field(drift.change.sigma) +
               field(drift.change.in_sigmas());
      else
        out += ",,,,";
      out += "\n";
    }
  }
  return out;
}

std::string fleet_json(const Fleet& fleet, const FleetFindings& findings,
                       const FleetOptions& options, const std::string& version) {
  Json json = {{"kincal", version},
               {"level", options.level},
               {"reference", fleet.reference},
               {"results", fleet.results.size()},
               {"out_of_family", findings.out_of_family},
               {"drifting", findings.drifting},
               {"left_out", Json::array()},
               {"other_rigs", Json::array()},
               {"family", nullptr},
               {"robots", Json::array()}};
  for (const auto& [path, why] : fleet.left_out)
    json["left_out"].push_back({{"result", path}, {"why", why}});
  for (const auto& [path, how] : fleet.other_rigs)
    json["other_rigs"].push_back({{"result", path}, {"how", how}});
  if (findings.family.judged) {
    json["family"] = Json::object();
    for (size_t c = 0; c < fleet.numbers.size(); ++c) {
      const auto i = static_cast<Eigen::Index>(c);
      json["family"][fleet.numbers[c].name] = {
          {"unit", fleet.numbers[c].unit},
          {"mean", number(findings.family.mean(i))},
          {"spread", number(std::sqrt(findings.family.covariance(i, i)))}};
    }
  }
  for (const FleetRobot& robot : findings.robots) {
    Json one = {{"serial", robot.serial}, {"p", number(robot.p)}, {"results", Json::array()}};
    for (const int i : robot.results)
      one["results"].push_back(
          {{"result", fleet.results[i].path}, {"time", fleet.results[i].date}});
    if (robot.member) {
      Json worst = Json::array();
      for (size_t k = 0; k < robot.member->numbers.size() && k < 5; ++k) {
        const OffNumber& off = robot.member->numbers[k];
        worst.push_back({{"number", fleet.numbers[off.number].name},
                         {"unit", fleet.numbers[off.number].unit},
                         {"off", number(off.off)},
                         {"sigma", number(off.sigma)}});
      }
      one["family"] = {{"out", robot.out_of_family},
                       {"p", number(robot.member->p)},
                       {"distance", number(robot.member->distance)},
                       {"equations", robot.member->equations},
                       {"left_out_of_mean", robot.member->left_out},
                       {"numbers", worst}};
    }
    if (robot.drift) {
      Json causes = Json::array();
      for (const Cause& cause : robot.drift->causes) {
        Json is = {{"number", fleet.numbers[cause.number].name},
                   {"unit", fleet.numbers[cause.number].unit},
                   {"kind", cause.from ? "change" : "line"}};
        if (cause.from) is["from"] = fleet.results[robot.results[cause.from]].date;
        is.update(slope_json(cause.slope));
        is["p"] = number(cause.p);
        causes.push_back(is);
      }
      one["drift"] = {{"p", number(robot.drift->p)}, {"causes", causes}};
    }
    json["robots"].push_back(one);
  }
  return json_text(json);
}

}  // namespace kincal
