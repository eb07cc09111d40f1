// Tables of numbers: what was read of a file of another program (read_table.h), cell by cell.
#pragma once

#include <string>
#include <vector>

namespace kincal {

struct TableRow {
  std::string where;  // path:line
  std::vector<std::string> cells;
};

struct Table {
  std::string path;
  std::string where;   // path:line of the header, or of the first row
  std::string kind;    // "a table (CSV)", "an array of numpy", ...
  std::string name;    // the key of a list in YAML or JSON; "": none
  std::string format;  // of its poses (exchange/poses.h), where the kind of file says it
  double length = 0;   // of one unit of its positions in m; 0: the file does not say
  std::vector<std::string> header;  // names of the columns; empty: the file has none
  std::vector<TableRow> rows;       // each with as many cells
  size_t columns() const { return rows.empty() ? header.size() : rows[0].cells.size(); }
};

/// Returns the place of a column by its name, whatever its case; -1: there is none.
int column_of(const Table& table, const std::string& name);

/// Returns the number of a cell; `what` is named in the message. @throws InputError
double number_of(const TableRow& row, int column, const std::string& what);

/// Returns text in lower case (ASCII).
std::string lower_case(std::string text);

}  // namespace kincal
