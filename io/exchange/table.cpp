#include "table.h"

#include "../document/error.h"
#include "../document/numbers.h"

namespace kincal {

int column_of(const Table& table, const std::string& name) {
  for (size_t i = 0; i < table.header.size(); ++i)
    if (lower_case(table.header[i]) == lower_case(name)) return static_cast<int>(i);
  return -1;
}

double number_of(const TableRow& row, int column, const std::string& what) {
  const std::string& text = row.cells[static_cast<size_t>(column)];
  double value = 0;
  if (!read_number(text, value))
    throw InputError(row.where + ": " + what + ": a finite number is expected, not '" + text + "'" +
                     (text.find(',') != std::string::npos ? "; write a point, not a comma" : ""));
  return value;
}

std::string lower_case(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

}  // namespace kincal
