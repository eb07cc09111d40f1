// Targets: the points they have, how boards lay them out, and how else their points could be numbered.
//
// Relabelings of a grid. Numbering a board from another corner, or its rows backwards, permutes its points by a symmetry of the grid:
// half a turn (n - 1 - i of a chessboard), a reflection, of a square board also a quarter turn. A view by itself cannot show that, for a
// permuted flat board is the same board somewhere else (seen from behind, of a reflection); what holds or else sees the board can.
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

/// Whether markers on the board tell which point is which.
bool numbered_by_markers(const Target& target);

/// How many points follow one another for one mark of the board: 4 corners of a tag, else 1.
int points_of_mark(const Target& target);

/// Where the points of a flat target go if it is turned or reflected about its centre by `m` (orthogonal 2 x 2): place i has the index of the
/// point that point i comes to lie on. Empty if it does not come to lie on itself.
std::vector<int> relabeling(const Target& target, const Eigen::Matrix2d& m);

/// Replaces ids of a view (all points in order if it has none) by `places` of them.
void relabel(View& view, const Target& target, const std::vector<int>& places);

}  // namespace kincal
