// Targets: the points they have, how boards lay them out, and how else their points could be numbered.
#pragma once

#include <string>
#include <vector>

#include "parameters.h"
#include "samples.h"

namespace kincal {

/// How a board lays out its points. Points stand row by row from the origin; x along a row, y from row to row.
struct GridLayout {
  enum class Kind { corners, charuco, circles, tags } kind = Kind::corners;
  int rows = 0, columns = 0;
  bool asymmetric = false;  // circles: every other row is shifted by half a pitch
  double gap = 0;           // tags: between two tags, in tag sizes
};
/// Points for a spacing of 1, 3 x count, z = 0; of a tag its four corners. Times `Target::square`: m.
Eigen::Matrix3Xd grid_layout(const GridLayout& grid);

/// The target's points in its own frame, m: as the rig has them, or at given values.
Eigen::Matrix3Xd target_points(const Target& target);
Eigen::Matrix3Xd target_points(const Rig& rig, const ParameterTable& table, const VectorXd& values, int target);

/// The target's points that a view shows: its ids, or all.
std::vector<int> view_ids(const View& view, const Target& target);

/// True if fewer than three points, or all within a millionth of their extent of one line.
bool on_a_line(const Eigen::Matrix3Xd& points);

/// Length of the diagonal of the points' box, m.
double extent(const Eigen::Matrix3Xd& points);

}  // namespace kincal
