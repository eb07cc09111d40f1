#include "report_page.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/numbers.h"
#include "../results/csv.h"
#include "page_template.h"

namespace kincal {
namespace {

using OrderedJson = nlohmann::ordered_json;

constexpr char kPlaceholder[] = "{\"kincal-report-data\":null}";
constexpr int kDrawnDigits = 5, kReadingDigits = 7;  // of what is only drawn
// Points that are drawn: more cannot be told apart. Of residuals every so-manieth of all stands in
// the page, of loops those of every so-manieth sample.
constexpr size_t kMostResiduals = 50000, kMostLoops = 20000;
constexpr size_t kMostCorrelated = 400;  // unknowns whose correlations are shown

/// An Index gives names numbers, in the order of their first appearance.
struct Index {
  std::map<std::string, int> known;
  std::vector<std::string> names;

  int operator()(const std::string& name) {
    const auto [found, is_new] = known.insert({name, static_cast<int>(names.size())});
    if (is_new) names.push_back(name);
    return found->second;
  }
};

std::string name_list(const std::vector<std::string>& names) {
  std::string out = "[";
  for (size_t i = 0; i < names.size(); ++i) out += (i ? "," : "") + json_string(names[i]);
  return out + "]";
}

/// A DataColumn is a list of a page's data, as it grows.
struct DataColumn {
  std::string text;
  bool any = false;  // not only nulls

  void add(const std::string& value) {
    text += text.empty() ? '[' : ',';
    text += value.empty() ? "null" : value;
    any = any || !value.empty();
  }
  std::string list() const { return text.empty() ? "[]" : text + "]"; }
};

/// Refuses rows that are shorter than what is read of them.
void expect_fields(const std::vector<std::string>& row, size_t count, const char* file) {
  if (row.size() < count)
    throw InputError(std::string(file) + ": a row has " + std::to_string(row.size()) +
                     " fields, at least " + std::to_string(count) + " are expected");
}

/// A number of a CSV file with fewer digits; "" stays.
std::string drawn(const std::string& field, int digits) {
  double value = 0;
  if (field.empty() || !read_number(field, value)) return "";
  return rounded(value, digits);
}

/// DataColumns by name, in order, as members of an object.
class DataColumns {
 public:
  explicit DataColumns(std::vector<std::string> names)
      : names_(std::move(names)), columns_(names_.size()) {}
  DataColumn& operator[](size_t i) { return columns_[i]; }
  size_t size() const { return columns_.size(); }
  std::string object() const {
    std::string out = "{";
    for (size_t i = 0; i < names_.size(); ++i) {
      if (!columns_[i].any && !columns_[i].text.empty()) continue;  // a column of nulls
      out += (out.size() > 1 ? "," : "") + json_string(names_[i]) + ":" + columns_[i].list();
    }
    return out + "}";
  }

 private:
  std::vector<std::string> names_;
  std::vector<DataColumn> columns_;
};

/// The samples: ids, split, and what stands in columns KIND/NAME of samples.csv.
std::string samples_data(const std::string& csv, Index& ids) {
  DataColumn id, train;
  std::vector<std::string> head;
  std::vector<DataColumn> columns;
  for_each_csv_row(csv, [&](const std::vector<std::string>& row) {
    if (head.empty()) {
      expect_fields(row, 2, "samples.csv");
      head = row;
      columns.resize(head.size());
      return;
    }
    expect_fields(row, head.size(), "samples.csv");
    ids(row[0]);
    id.add(json_string(row[0]));
    train.add(row[1] == "test" ? "0" : "1");
    for (size_t i = 2; i < row.size() && i < head.size(); ++i) {
      if (head[i].rfind("target/", 0) != 0) {
        columns[i].add(drawn(row[i], kReadingDigits));
        continue;
      }
      DataColumn pose;  // seven columns target/NAME/x ... qw
      for (size_t k = i; k < i + 7 && k < row.size(); ++k) pose.add(drawn(row[k], kReadingDigits));
      columns[i].add(pose.any ? pose.list() : "");
      i += 6;
    }
  });
  std::map<std::string, std::string> groups;  // by kind of column
  for (size_t i = 2; i < head.size(); ++i) {
    const size_t slash = head[i].find('/');
    const std::string kind = head[i].substr(0, slash);
    std::string name = head[i].substr(slash + 1);
    if (kind == "target") name = name.substr(0, name.rfind('/'));
    std::string& group = groups[kind];
    group += (group.empty() ? "" : ",") + json_string(name) + ":" + columns[i].list();
    if (kind == "target") i += 6;
  }
  return "{\"id\":" + id.list() + ",\"train\":" + train.list() + ",\"joints\":{" +
         groups["reading"] + "},\"errors\":{" + groups["error"] + "},\"targets\":{" +
         groups["target"] + "}}";
}

struct PageNames {
  Index samples, sensors, targets;
};

size_t line_count(const std::string& csv) {
  return static_cast<size_t>(std::count(csv.begin(), csv.end(), '\n'));
}

/// Columns of which only every so-manieth entry is there, for there are too many to be drawn.
std::string with_every(size_t every, const DataColumns& columns) {
  return "{\"every\":" + std::to_string(every) + "," + columns.object().substr(1);
}

std::string residuals_data(const std::string& csv, PageNames& names) {
  DataColumns out({"sample",     "sensor",     "target",     "id",         "x",
                   "y",          "z",          "rx",         "ry",         "rz",
                   "before_x",   "before_y",   "before_z",   "whitened",   "measured_1",
                   "measured_2", "measured_3", "whitened_1", "whitened_2", "whitened_3",
                   "whitened_4", "whitened_5", "whitened_6"});
  const size_t every = line_count(csv) / kMostResiduals + 1;
  size_t line = 0;
  for_each_csv_row(csv, [&](const std::vector<std::string>& row) {
    expect_fields(row, 16, "residuals.csv");
    if (line++ == 0 || (!row[4].empty() && line % every != 0)) return;  // views of poses: all
    out[0].add(std::to_string(names.samples(row[0])));
    out[1].add(std::to_string(names.sensors(row[2])));
    out[2].add(std::to_string(names.targets(row[3])));
    out[3].add(row[4]);
    for (size_t i = 4; i < out.size(); ++i) {  // x is field 6; files of old have fewer columns
      const size_t field = i + 2;
      out[i].add(field < row.size() ? drawn(row[field], field < 16   ? kDrawnDigits
                                                        : field < 19 ? 6
                                                                     : 4)
                                    : "");
    }
  });
  return with_every(every, out);
}

/// `written`: loops.csv has the points of every so-manieth sample only.
std::string loops_data(const std::string& csv, size_t written, PageNames& names) {
  const size_t rows = line_count(csv), every = written * (rows / kMostLoops + 1);
  if (rows < 2) return "null";
  DataColumns out(
      {"sample", "from", "to", "target", "id", "before_x", "before_y", "before_z", "x", "y", "z"});
  bool head = true;
  for_each_csv_row(csv, [&](const std::vector<std::string>& row) {
    expect_fields(row, 13, "loops.csv");
    if (std::exchange(head, false)) return;
    const int sample = names.samples(row[0]);
    if (static_cast<size_t>(sample) % every != 0) return;
    out[0].add(std::to_string(sample));
    out[1].add(std::to_string(names.sensors(row[2])));
    out[2].add(std::to_string(names.sensors(row[3])));
    out[3].add(std::to_string(names.targets(row[4])));
    out[4].add(row[5]);
    for (size_t i = 5; i < out.size(); ++i) out[i].add(row[i + 2]);
  });
  return with_every(every, out);
}

std::string covariance_data(const std::string& csv) {
  std::vector<std::string> names;
  std::vector<std::vector<double>> rows;
  for_each_csv_row(csv, [&](const std::vector<std::string>& row) {
    if (names.empty()) {
      names = row;
      return;
    }
    expect_fields(row, names.size(), "covariance.csv");
    rows.emplace_back();
    for (const std::string& field : row) {
      double value = 0;
      rows.back().push_back(read_number(field, value) ? value : std::nan(""));
    }
  });
  if (names.empty() || rows.size() != names.size() || names.size() > kMostCorrelated) return "null";
  DataColumn sigma, correlation;
  for (size_t i = 0; i < rows.size(); ++i) {
    const double s = std::sqrt(rows[i][i]);
    sigma.add(std::isfinite(s) ? rounded(s, kDrawnDigits) : "");
    DataColumn row;
    for (size_t j = 0; j <= i; ++j) {
      const double c = 1000 * rows[i][j] / std::sqrt(rows[i][i] * rows[j][j]);
      row.add(std::isfinite(c) ? std::to_string(std::lround(c)) : "");
    }
    correlation.add(row.list());
  }
  return "{\"names\":" + name_list(names) + ",\"sigma\":" + sigma.list() +
         ",\"correlation\":" + correlation.list() + "}";
}

OrderedJson parsed(const std::string& text, const std::string& place) {
  OrderedJson json = OrderedJson::parse(text, nullptr, false);
  if (!json.is_object()) throw InputError(place + ": this is not a result.json of kincal");
  return json;
}

std::string compact(const OrderedJson& json) {
  return json.dump(-1, ' ', false, OrderedJson::error_handler_t::replace);
}

std::string robot_name(const OrderedJson& result) {
  const OrderedJson name = result.value("/scene/robot"_json_pointer, OrderedJson());
  return name.is_string() ? name.get<std::string>() : "";
}

/// A member of a member ..., null where there is none.
OrderedJson member(const OrderedJson& json, const std::string& pointer) {
  return json.value(OrderedJson::json_pointer(pointer), OrderedJson());
}

/// loops.csv has the points of every so-manieth sample: 1 in results of before that was said.
size_t loops_written(const OrderedJson& result) {
  const OrderedJson every = member(result, "/loops_csv/every");
  return every.is_number_unsigned() && every > 0 ? every.get<size_t>() : 1;
}

/// Poses that the rig leaves open: they did not change, for they were nowhere before.
std::set<std::string> open_poses(const OrderedJson& result) {
  std::set<std::string> out;
  for (const char* kind : {"sensor", "target"})
    for (const OrderedJson& part : member(result, "/scene/" + std::string(kind) + "s"))
      if (part.is_object() && part.contains("before") && part["before"].is_null())
        out.insert(std::string(kind) + "/" + part.at("name").get<std::string>() + "/pose");
  return out;
}

/// The component that changed most, as tables weigh changes: a thousandth of a metre, a radian or a
/// ratio and a tenth of a pixel alike.
OrderedJson largest_change(const OrderedJson& result) {
  OrderedJson out;
  double most = 0;
  const OrderedJson parameters = member(result, "/parameters");
  const std::set<std::string> open = open_poses(result);
  for (const auto& [name, p] : parameters.items())
    for (size_t c = 0; c < p.at("value").size() && !open.count(name); ++c) {
      if (p.at("sigma").at(c) == 0 || !p.at("value").at(c).is_number()) continue;  // held
      const double change = p.at("value").at(c).get<double>() - p.at("initial").at(c).get<double>();
      const double weight = std::abs(change) * (p.at("unit").at(c) == "px" ? 10 : 1e3);
      if (weight <= most) continue;
      most = weight;
      out = {{"parameter", name},
             {"value", change},
             {"unit", p.at("unit").at(c)},
             {"sigma", p.at("sigma").at(c)}};
    }
  return out;
}

/// What of a result an overview shows: of each sensor the errors on held-out data where there are
/// some, else on the training's.
OrderedJson overview_entry(const OverviewEntry& e) {
  const OrderedJson result = parsed(e.result_json, e.folder + "/result.json");
  OrderedJson out = {{"folder", e.folder}, {"title", robot_name(result)}};
  for (const char* key : {"serial", "time", "verdict", "status"})
    if (result.contains(key)) out[key] = result[key];
  if (!out.contains("time")) out["time"] = member(result, "/input/date");
  const OrderedJson chi2 = member(result, "/chi2_data"), dof = member(result, "/dof_data");
  if (chi2.is_number() && dof.is_number() && dof > 0)
    out["chi2_dof"] = chi2.get<double>() / dof.get<double>();
  out["sensors"] = OrderedJson::object();
  const OrderedJson sensors = member(result, "/sensors"),
                    folds = member(result, "/validation/cross_validation/sensors");
  for (const auto& [name, sensor] : sensors.items()) {
    const bool held_out = member(sensor, "/test/points") > 0;
    const OrderedJson split = sensor.at(held_out ? "test" : "train");
    OrderedJson one = {{"unit", sensor.at("unit")},
                       {"before", split.at("rms_before")},
                       {"after", split.at("rms_as_read")},
                       {"from", held_out ? "test" : "train"}};
    if (!held_out && folds.contains(name))
      one["after"] = folds.at(name).at("rms_as_read"), one["from"] = "cross_validation";
    out["sensors"][name] = one;
  }
  out["largest_change"] = largest_change(result);
  out["link"] = e.link.empty() ? OrderedJson(nullptr) : OrderedJson(e.link);
  return out;
}

/// The page with its data: text of scripts must not hold what would end them.
std::string with_data(const std::string& data) {
  const std::string page = page_template();
  const size_t at = page.find(kPlaceholder);
  std::string out;
  out.reserve(page.size() + data.size() + data.size() / 50);
  out.append(page, 0, at);
  for (size_t from = 0; from < data.size();) {
    const size_t to = std::min(data.find('<', from), data.size());
    out.append(data, from, to - from);
    if (to < data.size()) out += "\\u003c";
    from = to + 1;
  }
  return out.append(page, at + sizeof kPlaceholder - 1, std::string::npos);
}

}  // namespace

ResultTexts read_result_texts(const std::string& directory) {
  ResultTexts out;
  out.result_json = read_file(directory + "/result.json");
  for (const auto& [name, text] : std::initializer_list<std::pair<const char*, std::string*>>{
           {"samples.csv", &out.samples_csv},
           {"residuals.csv", &out.residuals_csv},
           {"loops.csv", &out.loops_csv},
           {"covariance.csv", &out.covariance_csv}})
    if (file_exists(directory + "/" + name)) *text = read_file(directory + "/" + name);
  return out;
}

std::string report_page(const ResultTexts& texts) {
  OrderedJson result = parsed(texts.result_json, "result.json");
  result.erase("samples");  // they stand in samples.csv
  PageNames names;
  const std::string samples = samples_data(texts.samples_csv, names.samples),
                    residuals = residuals_data(texts.residuals_csv, names),
                    loops = loops_data(texts.loops_csv, loops_written(result), names),
                    covariance = covariance_data(texts.covariance_csv);
  return with_data("{\"version\":1,\"title\":" + json_string(robot_name(result)) + ",\"result\":" +
                   compact(result) + ",\"names\":{\"sensors\":" + name_list(names.sensors.names) +
                   ",\"targets\":" + name_list(names.targets.names) + "},\"samples\":" + samples +
                   ",\"residuals\":" + residuals + ",\"loops\":" + loops +
                   ",\"covariance\":" + covariance + "}");
}

std::string failed_result(const std::string& error) {
  return compact({{"status", "failed"}, {"verdict", {{"use", "no"}, {"text", error}}}});
}

std::string overview_page(const std::vector<OverviewEntry>& entries) {
  OrderedJson list = OrderedJson::array();
  for (const OverviewEntry& e : entries) {
    try {
      list.push_back(overview_entry(e));
    } catch (const OrderedJson::exception&) {
      throw InputError(e.folder + "/result.json: this is not a result.json of kincal");
    }
  }
  return with_data("{\"version\":1,\"overview\":" + compact(list) + "}");
}

}  // namespace kincal
