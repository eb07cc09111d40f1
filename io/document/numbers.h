// Decimal numbers as text, in and out: always with std::from_chars and std::to_chars, whatever the
// locale.
#pragma once

#include <array>
#include <string>
#include <string_view>

#include "../../kinematics/transform.h"

namespace kincal {

/// True for numbers such as 010, which YAML 1.1 takes as octal.
bool starts_with_zero(std::string_view digits);

/// Reads a whole finite decimal number. It refuses 010 (octal in YAML 1.1), 0x10, 1_000, 1:30, nan
/// and inf: false.
bool read_number(std::string_view text, double& value);

/// Returns the shortest decimal text that reads back as the same double; 0 and -0 are "0".
std::string shortest(double value);
/// Returns a number with so many significant digits, where they are too many for a drawing or
/// table.
std::string rounded(double value, int digits);
/// Returns the three numbers with blanks between them.
std::string shortest(const Vector3d& v);

/// Returns x y z qx qy qz qw, as files have poses.
std::array<double, 7> pose_numbers(const Pose& pose);

/// Writes a list as YAML and JSON both take it: "[1, 0.5]".
std::string list_text(const double* values, int count);

}  // namespace kincal
