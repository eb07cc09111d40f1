// What every table is made of: columns in line, numbers in the units that people read.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "../../models/rig/words.h"

namespace kincal {

constexpr size_t kTerminal = 80;  // columns

/// Returns how many columns of a terminal a text takes.
size_t shown_width(const std::string& text);
/// Returns a paragraph no wider than a terminal, that begins with `first`; `indent`: blanks before
/// its other lines.
std::string wrapped(const std::string& words, const std::string& first, size_t indent);

/// Pads columns to their widest cell; the first `left` ones to the left, the others to the right.
std::string align(const std::vector<std::vector<std::string>>& rows, size_t left);

/// A Unit is a unit as a table shows it, and the factor from the unit of the results to this one.
struct Unit {
  std::string name;
  double factor;
};
/// Returns the unit in which a table shows numbers of `unit`: m in mm, rad in mrad, all others as
/// they are.
Unit shown(const std::string& unit);

/// Returns a number in four digits, or "-" if it is not finite.
std::string value(double v, double factor = 1);

/// A WeightedRow is a row of a table that shows the heaviest rows first.
struct WeightedRow {
  double weight;
  std::vector<std::string> cells;
};
/// Sorts the rows by falling weight; rows of the same weight keep their order.
void sort_by_weight(std::vector<WeightedRow>& rows);
/// Returns how much a change of a parameter weighs in a table: a thousandth of a metre, a radian or
/// a ratio and a tenth of a pixel weigh alike.
double weight_of(double change, const std::string& unit);
/// Returns a component's name as tables write it: "parameter.component", or the parameter's name if
/// the component has none.
std::string component_name(const std::string& parameter, const std::string& component);

}  // namespace kincal
