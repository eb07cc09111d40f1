#include "read_table.h"

#include <algorithm>
#include <cctype>
#include <sstream>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "number_lists.h"

namespace kincal {
namespace {

using Cells = std::vector<std::string>;

std::string without_blanks(const std::string& text) {
  const size_t begin = text.find_first_not_of(" \t\r"), end = text.find_last_not_of(" \t\r");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

/// Cells between separators; what stands in quotes is one cell.
Cells cells_between(const std::string& line, char separator) {
  Cells cells;
  std::string cell;
  bool quoted = false, was_quoted = false;
  const auto add = [&] {
    if (!was_quoted) cell = without_blanks(cell);
    if (separator != ' ' || !cell.empty() || was_quoted) cells.push_back(cell);
    cell.clear();
    was_quoted = false;
  };
  for (const char c : line) {
    if (c == '"' && (quoted || without_blanks(cell).empty())) {
      if (!quoted) cell.clear();
      quoted = !quoted;
      was_quoted = true;
    } else if (!quoted && (c == separator || (separator == ' ' && c == '\t'))) {
      add();
    } else if (!was_quoted || quoted) {
      cell += c;
    }
  }
  add();
  return cells;
}

/// Replaces the comma of 1,25 by a point; false: the cell is no such number.
bool replace_decimal_comma(std::string& cell) {
  const size_t comma = cell.find(',');
  if (comma == std::string::npos || cell.find(',', comma + 1) != std::string::npos) return false;
  std::string text = cell;
  text[comma] = '.';
  double ignored = 0;
  const bool digits = comma > 0 && std::isdigit(static_cast<unsigned char>(cell[comma - 1])) != 0 &&
                      comma + 1 < cell.size() &&
                      std::isdigit(static_cast<unsigned char>(cell[comma + 1])) != 0;
  if (!digits || !read_number(text, ignored)) return false;
  cell = text;
  return true;
}

/// Numbers with blanks between them, of which some have a decimal comma: "0,5 1,2".
bool blanks_separate_decimal_commas(const std::string& line) {
  Cells cells = cells_between(line, ' ');
  bool commas = false;
  for (std::string& cell : cells) {
    double ignored = 0;
    if (replace_decimal_comma(cell))
      commas = true;
    else if (!read_number(cell, ignored))
      return false;
  }
  return commas && cells.size() > 1;
}

char separator_of(const std::string& line) {
  for (const char c : {'\t', ';'})
    if (line.find(c) != std::string::npos) return c;
  return line.find(',') == std::string::npos || blanks_separate_decimal_commas(line) ? ' ' : ',';
}

bool is_number(std::string cell) {
  double ignored = 0;
  replace_decimal_comma(cell);
  return read_number(cell, ignored);
}

/// The names and numbers of a frame or axes of a KUKA program: {E6POS: X 1.5, Y 2, ...}, also with
/// a name in front: DECL E6POS XP1={X 1.5, ...}. False: it is none.
bool read_krl(const std::string& line, Cells& names, Cells& numbers, std::string& name) {
  const size_t open = line.find('{'), close = line.find('}', open);
  if (open == std::string::npos || close == std::string::npos) return false;
  std::string inside = line.substr(open + 1, close - open - 1);
  if (const size_t colon = inside.find(':'); colon != std::string::npos) inside.erase(0, colon + 1);
  for (const std::string& part : cells_between(inside, ',')) {
    std::istringstream in(part);
    std::string key, value, more;
    if (!(in >> key >> value) || in >> more || !is_number(value)) return false;
    names.push_back(key);
    numbers.push_back(value);
  }
  const size_t equal = line.find('=');
  if (equal < open) {
    std::istringstream before(line.substr(0, equal));
    while (before >> name) {
    }
  }
  return !names.empty();
}

/// The lines of a text with their numbers; blank ones and comments are left out.
struct TableLine {
  int number;
  std::string text;
};
std::vector<TableLine> table_lines(const std::string& text) {
  std::vector<TableLine> out;
  std::istringstream in(text);
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (number == 1 && line.compare(0, 3, "\xEF\xBB\xBF") == 0) line.erase(0, 3);  // of Excel
    const std::string content = without_blanks(line);
    if (!content.empty() && content[0] != '#' && content[0] != '%')
      out.push_back({number, content});
  }
  return out;
}

std::string place(const std::string& path, int line) { return path + ":" + std::to_string(line); }

Table krl_table(const std::string& path, const std::vector<TableLine>& lines) {
  Table out;
  out.path = path;
  out.kind = "positions of a KUKA program";
  out.format = "kuka";
  for (const TableLine& line : lines) {
    Cells names, numbers;
    std::string name;
    if (!read_krl(line.text, names, numbers, name)) continue;
    names.insert(names.begin(), "id");
    numbers.insert(numbers.begin(), name);
    if (out.header.empty()) out.header = names;
    if (names != out.header)
      throw InputError(place(path, line.number) + ": has " + comma_separated(names) +
                       "; the first position has " + comma_separated(out.header));
    out.rows.push_back({place(path, line.number), numbers});
  }
  const bool unnamed = std::all_of(out.rows.begin(), out.rows.end(),
                                   [](const TableRow& row) { return row.cells[0].empty(); });
  if (unnamed) {
    out.header.erase(out.header.begin());
    for (TableRow& row : out.rows) row.cells.erase(row.cells.begin());
  }
  return out;
}

/// The pose of a controller of Universal Robots, p[x, y, z, rx, ry, rz], is its numbers.
std::string without_p_brackets(std::string line) {
  if (const size_t p = line.find("p["); p != std::string::npos && line.back() == ']') {
    line.erase(p, 2);
    line.pop_back();
  }
  return line;
}

Table text_table(const std::string& path, const std::vector<TableLine>& lines) {
  Table out;
  out.path = path;
  out.kind = "a table (CSV)";
  if (lines.empty()) return out;
  const std::string first = without_p_brackets(lines[0].text);
  const char separator = separator_of(first);
  for (const TableLine& line : lines) {
    Cells cells = cells_between(without_p_brackets(line.text), separator);
    if (separator != ',')
      for (std::string& cell : cells) replace_decimal_comma(cell);
    if (&line == &lines[0]) out.where = place(path, line.number);
    if (&line == &lines[0] && std::none_of(cells.begin(), cells.end(), is_number)) {
      out.header = std::move(cells);
      continue;
    }
    const size_t wanted = !out.header.empty() ? out.header.size() : out.columns();
    if (wanted > 0 && cells.size() != wanted)
      throw InputError(place(path, line.number) + ": " + std::to_string(cells.size()) +
                       " cells; the " + (out.header.empty() ? "first line" : "header") + " has " +
                       std::to_string(wanted));
    out.rows.push_back({place(path, line.number), std::move(cells)});
  }
  return out;
}

bool all_numbers(const Table& table) {
  for (const TableRow& row : table.rows)
    if (!std::all_of(row.cells.begin(), row.cells.end(), is_number)) return false;
  return true;
}

bool ends_a_matrix(const Cells& cells, size_t at) {
  for (size_t i = 0; i < 4; ++i) {
    double value = 0;
    if (!read_number(cells[at + i], value) || value != (i == 3 ? 1 : 0)) return false;
  }
  return true;
}

/// Matrices of 4 x 4 one below the other, or side by side, as rows of 16.
void join_matrices(Table& table) {
  const size_t wide = table.columns() / 4, high = table.rows.size() / 4;
  if (!table.header.empty() || table.columns() % 4 != 0 || wide == 0 ||
      table.rows.size() % 4 != 0 || (wide > 1 && high != 1) || !all_numbers(table))
    return;
  for (size_t i = 0; i < high; ++i)
    for (size_t k = 0; k < wide; ++k)
      if (!ends_a_matrix(table.rows[4 * i + 3].cells, 4 * k)) return;
  std::vector<TableRow> joined;
  for (size_t i = 0; i < high; ++i)
    for (size_t k = 0; k < wide; ++k) {
      TableRow row{table.rows[4 * i].where, {}};
      for (size_t r = 0; r < 4; ++r)
        for (size_t c = 0; c < 4; ++c) row.cells.push_back(table.rows[4 * i + r].cells[4 * k + c]);
      joined.push_back(std::move(row));
    }
  table.rows = std::move(joined);
  table.kind = "matrices of 4 x 4";
  table.format = "matrix";
}

bool is_krl(const std::vector<TableLine>& lines) {
  Cells names, numbers;
  std::string name;
  return std::any_of(lines.begin(), lines.end(), [&](const TableLine& line) {
    return read_krl(line.text, names, numbers, name);
  });
}

}  // namespace

std::vector<Table> read_tables(const std::string& path) {
  const std::string text = read_file(path);
  std::vector<Table> out;
  if (is_numpy(text)) {
    out = {numpy_table(text, path)};
  } else if (has_number_lists(text, path)) {
    out = list_tables(path);
  } else {
    const std::vector<TableLine> lines = table_lines(text);
    out = {is_krl(lines) ? krl_table(path, lines) : text_table(path, lines)};
    join_matrices(out[0]);
  }
  if (out.empty() || out[0].rows.empty())
    throw InputError(path +
                     (text.empty() ? ": the file is empty" : ": contains no row of numbers"));
  for (Table& table : out)
    if (table.where.empty()) table.where = table.rows[0].where;
  return out;
}

Table read_table(const std::string& path) {
  std::vector<Table> all = read_tables(path);
  if (all.size() == 1) return std::move(all[0]);
  Cells names;
  for (const Table& one : all) names.push_back(one.name);
  throw InputError(path + ": one list of poses is expected, there are " +
                   std::to_string(all.size()) + ": " + comma_separated(names));
}

}  // namespace kincal
