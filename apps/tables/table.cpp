#include "table.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace kincal {

size_t shown_width(const std::string& s) {  // UTF-8 continuation bytes take no place
  return static_cast<size_t>(
      std::count_if(s.begin(), s.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

std::string wrapped(const std::string& words, const std::string& first, size_t indent) {
  std::string out, line = first;
  std::istringstream in(words);
  for (std::string word; in >> word;) {
    const bool begins = line.find_first_not_of(' ') == std::string::npos || line == first;
    if (!begins && line.size() + 1 + word.size() > kTerminal) {
      out += line + "\n";
      line = std::string(indent, ' ') + word;
    } else {
      line += (begins ? "" : " ") + word;
    }
  }
  return out + line + "\n";
}

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

Unit shown(const std::string& unit) {
  if (unit == "m") return {"mm", 1e3};
  if (unit == "rad") return {"mrad", 1e3};
  if (unit == "s") return {"ms", 1e3};
  return {unit, 1};
}

std::string value(double v, double factor) {
  return std::isfinite(v) ? text("%.4g", v * factor) : "-";
}

void sort_by_weight(std::vector<WeightedRow>& rows) {
  std::stable_sort(rows.begin(), rows.end(),
                   [](const WeightedRow& a, const WeightedRow& b) { return a.weight > b.weight; });
}

double weight_of(double change, const std::string& unit) {
  return std::abs(change) * (unit == "px" ? 10 : 1e3);
}

std::string component_name(const std::string& parameter, const std::string& component) {
  return component.empty() ? parameter : parameter + "." + component;
}

}  // namespace kincal
