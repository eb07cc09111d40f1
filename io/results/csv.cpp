#include "csv.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "../document/document.h"
#include "../document/numbers.h"

namespace kincal {

namespace {

/// Appends `count` fields, each behind a comma; those beyond `known`, and what is not finite, are
/// empty. `digits` are significant; 0: as many as it takes to read the same number again.
void add_numbers(std::string& out, const double* values, int known, int count, int digits = 0) {
  for (int i = 0; i < count; ++i) {
    out += ',';
    if (i < known && std::isfinite(values[i]))
      out += digits ? rounded(values[i], digits) : shortest(values[i]);
  }
}

constexpr size_t kMostLoopRows = 100000;

const char* split_name(const Sample& sample) { return sample.train ? "train" : "test"; }

}  // namespace

std::string residuals_csv(const Report& report) {
  std::string out =
      "sample,split,sensor,target,id,unit,x,y,z,rx,ry,rz,before_x,before_y,before_z,whitened,"
      "measured_1,measured_2,measured_3,whitened_1,whitened_2,whitened_3,whitened_4,whitened_5,"
      "whitened_6\n";
  std::map<const View*, const ViewResiduals*> before;
  for (const ViewResiduals& r : report.residuals.before) before[r.view] = &r;
  const Rig& rig = report.solution.rig();
  for (const ViewResiduals& r : report.residuals.after) {
    const Sensor& sensor = rig.sensors[r.view->sensor];
    const int rows = sensor.model->rows();
    const bool poses = sensor.model->measures_pose();
    const int numbers = poses ? (r.view->z.empty() ? 0 : 3) : sensor.model->measurement_size();
    const Eigen::Index blocks = r.raw.size() / rows, white = r.whitened.size() / blocks;
    const auto found = before.find(r.view);
    const Sample& sample = report.solution.samples()[r.sample];
    const std::string head = csv_field(sample.id) + "," + split_name(sample) + "," +
                             csv_field(sensor.name) + "," +
                             csv_field(rig.targets[r.view->target].name) + ",";
    for (Eigen::Index b = 0; b < blocks; ++b) {
      out += head;
      if (!poses) out += std::to_string(r.view->ids.empty() ? static_cast<int>(b) : r.view->ids[b]);
      out += std::string(",") + sensor.model->unit();
      add_numbers(out, r.raw.data() + b * rows, rows, 6);
      add_numbers(out, found == before.end() ? nullptr : found->second->raw.data() + b * rows,
                  found == before.end() ? 0 : rows, 3);
      const double norm = r.whitened.segment(b * white, white).norm();
      add_numbers(out, &norm, 1, 1);
      add_numbers(out, r.view->z.data() + b * numbers, numbers, 3);
      add_numbers(out, r.whitened.data() + b * white, static_cast<int>(white), 6, 6);
      out += "\n";
    }
  }
  return out;
}

std::string samples_csv(const Solution& solution) {
  const Rig& rig = solution.rig();
  const std::vector<Joint>& joints = rig.tree.joints;
  const std::vector<Sample>& samples = solution.samples();
  std::vector<int> read;  // joints that have a reading in some sample
  for (size_t j = 0; j < joints.size(); ++j)
    if (joints[j].drives() && joints[j].axis_of_pose != PoseAxis::error &&
        std::any_of(samples.begin(), samples.end(),
                    [&](const Sample& s) { return !std::isnan(s.readings[j]); }))
      read.push_back(static_cast<int>(j));
  std::set<int> erring, placed;  // joints with estimated errors, targets with estimated poses
  for (const auto& e : solution.values.errors) erring.insert(e.first.second);
  for (const auto& t : solution.values.targets) placed.insert(t.first.second);

  std::string out = "sample,split";
  for (int j : read) out += "," + csv_field("reading/" + joints[j].name);
  for (int j : erring) out += "," + csv_field("error/" + joints[j].name);
  for (int t : placed)
    for (const char* number : {"x", "y", "z", "qx", "qy", "qz", "qw"})
      out += "," + csv_field("target/" + rig.targets[t].name + "/" + number);
  out += "\n";
  for (size_t i = 0; i < samples.size(); ++i) {
    const int sample = static_cast<int>(i);
    out += csv_field(samples[i].id) + "," + split_name(samples[i]);
    for (int j : read) add_numbers(out, &samples[i].readings[j], 1, 1);
    for (int j : erring) {
      const auto found = solution.values.errors.find({sample, j});
      const bool known = found != solution.values.errors.end();
      add_numbers(out, known ? &found->second : nullptr, known, 1);
    }
    for (int t : placed) {
      const auto found = solution.values.targets.find({sample, t});
      const bool known = found != solution.values.targets.end();
      const std::array<double, 7> numbers = known ? pose_numbers(found->second) : pose_numbers({});
      add_numbers(out, numbers.data(), known ? 7 : 0, 7);
    }
    out += "\n";
  }
  return out;
}

size_t loops_every(const Report& report) {
  size_t rows = 0;
  for (const LoopView& v : report.loop_views) rows += static_cast<size_t>(v.after.cols());
  const size_t every = rows / kMostLoopRows + 1;
  return every % 2 ? every : every + 1;  // odd: samples that alternate between two arms show both
}

std::string loops_csv(const Report& report) {
  std::string out = "sample,split,from,to,target,id,unit,before_x,before_y,before_z,x,y,z\n";
  const Rig& rig = report.solution.rig();
  const size_t every = loops_every(report);
  for (const LoopView& v : report.loop_views) {
    if (static_cast<size_t>(v.sample) % every != 0) continue;
    const Sample& sample = report.solution.samples()[v.sample];
    const Sensor& to = rig.sensors[v.to->sensor];
    const std::string head = csv_field(sample.id) + "," + split_name(sample) + "," +
                             csv_field(rig.sensors[v.from->sensor].name) + "," +
                             csv_field(to.name) + "," + csv_field(rig.targets[v.to->target].name) +
                             ",";
    const int rows = static_cast<int>(v.after.rows());
    for (Eigen::Index i = 0; i < v.after.cols(); ++i) {
      out += head + (v.ids.empty() ? std::string() : std::to_string(v.ids[i])) + "," +
             to.model->unit();
      add_numbers(out, v.before.col(i).data(), rows, 3, 6);
      add_numbers(out, v.after.col(i).data(), rows, 3, 6);
      out += "\n";
    }
  }
  return out;
}

ReportedCovariance reported_covariance(const Solution& solution) {
  ReportedCovariance out;
  const bool predicted = solution.prediction.has_value();
  const std::vector<Component>& columns =
      predicted ? solution.prediction->columns : solution.columns;
  out.matrix = predicted ? solution.prediction->covariance : solution.covariance;
  for (size_t i = 0; i < columns.size(); ++i) {
    out.names.push_back(solution.table().name(columns[i]));
    const auto k = static_cast<Eigen::Index>(i);
    for (const ParameterEstimate& e : solution.parameters)
      if (e.parameter == columns[i].parameter && std::isnan(e.sigma[columns[i].index]) &&
          k < out.matrix.rows()) {
        out.matrix.row(k).setConstant(kNan);
        out.matrix.col(k).setConstant(kNan);
      }
  }
  return out;
}

std::string covariance_csv(const Solution& solution) {
  const ReportedCovariance covariance = reported_covariance(solution);
  std::string out;
  for (const std::string& name : covariance.names)
    out += (out.empty() ? "" : ",") + csv_field(name);
  out += "\n";
  for (Eigen::Index i = 0; i < covariance.matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j < covariance.matrix.cols(); ++j) {
      const double value = covariance.matrix(i, j);
      out += (j ? "," : "") + (std::isnan(value) ? std::string() : shortest(value));
    }
    out += "\n";
  }
  return out;
}

std::string information_csv(const Report& report) {
  const DataEquations& data = report.data;
  std::string out = "pull";
  for (const Component& c : data.columns) out += "," + csv_field(report.solution.table().name(c));
  out += "\n";
  for (Eigen::Index i = 0; i < data.pull.size(); ++i) {
    out += shortest(data.pull(i));
    for (Eigen::Index j = 0; j < data.pull.size(); ++j)
      out += j <= i ? "," + shortest(data.normal(i, j)) : ",";
    out += "\n";
  }
  return out;
}

std::string csv_field(const std::string& s) {
  if (s.find_first_of(",\"\n\r") == std::string::npos) return s;
  std::string out = "\"";
  for (char c : s) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

void for_each_csv_row(const std::string& text,
                      const std::function<void(const std::vector<std::string>&)>& visit) {
  std::vector<std::string> row;
  size_t count = 0;  // of the row's fields; the texts beyond are kept for the next ones
  const auto next_field = [&] {
    if (count == row.size()) row.emplace_back();
    row[count].clear();
    return &row[count++];
  };
  std::string* field = next_field();
  for (size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '"') {
      for (++i; i < text.size() && (text[i] != '"' || text[i + 1] == '"'); ++i) {
        *field += text[i];
        i += text[i] == '"';
      }
    } else if (text[i] == ',') {
      field = next_field();
    } else if (text[i] == '\n') {
      row.resize(count);
      visit(row);
      count = 0;
      field = next_field();
    } else {  // all up to what means something, at once
      size_t end = i + 1;
      while (end < text.size() && text[end] != '"' && text[end] != ',' && text[end] != '\n') ++end;
      field->append(text, i, end - i);
      i = end - 1;
    }
  }
}

double csv_number(const std::string& text, const std::string& place) {
  const Node node = scalar_node(text);
  return top(node, place).number();
}

}  // namespace kincal
