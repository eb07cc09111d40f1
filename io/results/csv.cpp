#include "csv.h"

#include <cmath>
#include <map>

#include "../document/document.h"
#include "../document/files.h"
#include "../document/numbers.h"

namespace kincal {

std::string residuals_csv(const Report& report) {
  std::string out =
      "sample,split,sensor,target,id,unit,x,y,z,rx,ry,rz,before_x,before_y,before_z,whitened\n";
  std::map<const View*, const ViewResiduals*> before;
  for (const ViewResiduals& r : report.residuals.before) before[r.view] = &r;
  const Rig& rig = report.solution.rig();
  for (const ViewResiduals& r : report.residuals.after) {
    const Sensor& sensor = rig.sensors[r.view->sensor];
    const int rows = sensor.model->rows();
    const Eigen::Index blocks = r.raw.size() / rows, white = r.whitened.size() / blocks;
    const auto found = before.find(r.view);
    const Sample& sample = report.solution.samples()[r.sample];
    const std::string head = csv_field(sample.id) + (sample.train ? ",train," : ",test,") +
                             csv_field(sensor.name) + "," +
                             csv_field(rig.targets[r.view->target].name) + ",";
    for (Eigen::Index b = 0; b < blocks; ++b) {
      out += head;
      if (!sensor.model->measures_pose())
        out += std::to_string(r.view->ids.empty() ? static_cast<int>(b) : r.view->ids[b]);
      out += std::string(",") + sensor.model->unit();
      for (int i = 0; i < 6; ++i)
        out += "," + (i < rows ? shortest(r.raw(b * rows + i)) : std::string());
      for (int i = 0; i < 3; ++i)
        out += "," +
               (i < rows && found != before.end() && std::isfinite(found->second->raw(b * rows + i))
                    ? shortest(found->second->raw(b * rows + i))
                    : std::string());
      out += "," + shortest(r.whitened.segment(b * white, white).norm()) + "\n";
    }
  }
  return out;
}

std::string covariance_csv(const Solution& solution) {
  const bool predicted = solution.prediction.has_value();
  const std::vector<Component>& columns =
      predicted ? solution.prediction->columns : solution.columns;
  const MatrixXd& covariance = predicted ? solution.prediction->covariance : solution.covariance;
  std::vector<char> known(columns.size(), 1);  // by column: its sigma is
  for (size_t i = 0; i < columns.size(); ++i)
    for (const ParameterEstimate& e : solution.parameters)
      if (e.parameter == columns[i].parameter && std::isnan(e.sigma[columns[i].index]))
        known[i] = 0;
  std::string out;
  for (size_t i = 0; i < columns.size(); ++i)
    out += (i ? "," : "") + csv_field(solution.table().name(columns[i]));
  out += "\n";
  for (Eigen::Index i = 0; i < covariance.rows(); ++i) {
    for (Eigen::Index j = 0; j < covariance.cols(); ++j)
      out += (j ? "," : "") + (known[i] && known[j] ? shortest(covariance(i, j)) : std::string());
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

std::vector<std::vector<std::string>> read_csv(const std::string& path) {
  std::vector<std::vector<std::string>> rows;
  std::vector<std::string> row;
  std::string cell;
  bool quoted = false;
  const std::string text = read_file(path);
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted) {
      if (c != '"')
        cell += c;
      else if (i + 1 < text.size() && text[i + 1] == '"')
        cell += text[++i];
      else
        quoted = false;
    } else if (c == '"') {
      quoted = true;
    } else if (c == ',' || c == '\n') {
      row.push_back(cell);
      cell.clear();
      if (c == '\n') {
        rows.push_back(row);
        row.clear();
      }
    } else {
      cell += c;
    }
  }
  return rows;
}

double csv_number(const std::string& text, const std::string& place) {
  const Node node = scalar_node(text);
  return top(node, place).number();
}

}  // namespace kincal
