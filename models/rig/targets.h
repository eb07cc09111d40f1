// Targets: the points they have, how boards lay them out, and how else their points could be
// numbered.
//
// Relabelings of a grid. Numbering a board from another corner, or its rows backwards, permutes its
// points by a symmetry of the grid: half a turn (n - 1 - i of a chessboard), a reflection, of a
// square board also a quarter turn. A view by itself cannot show that, for a permuted flat board is
// the same board somewhere else (seen from behind, of a reflection); the chain that holds the
// board, or another sensor that sees it, can.
#pragma once

#include <string>
#include <vector>

#include "parameters.h"
#include "samples.h"

namespace kincal {

/// A GridLayout is how a board lays out its points. They stand row by row from the origin; x is
/// along a row, y from row to row.
struct GridLayout {
  enum class Kind { corners, charuco, circles, tags } kind = Kind::corners;
  int rows = 0, columns = 0;
  bool asymmetric = false;  // circles: every other row is shifted by half a pitch
  double gap = 0;           // tags: between two tags, in tag sizes
};
/// Returns points for a spacing of 1, 3 x count, z = 0; of a tag these are its four corners. Times
/// `Target::square` they are in m.
Eigen::Matrix3Xd grid_layout(const GridLayout& grid);

/// Returns the shapes that a warped board is made of, one row each: 1 - u^2 and 1 - v^2 at its
/// points, u and v from -1 to 1 over the board along x and y. So the two numbers of a warp are how
/// far the middle stands out of the edges, along z.
Eigen::Matrix2Xd warp_shapes(const Eigen::Matrix3Xd& layout);
/// Gives a grid another layout, and a board that may be warped the shapes of it.
void set_layout(Target& target, const Eigen::Matrix3Xd& layout);

/// Both return the target's points in its own frame, in m: as the rig has them, or at given values.
Eigen::Matrix3Xd target_points(const Target& target);
Eigen::Matrix3Xd target_points(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                               int target);

/// Returns the target's points that a view shows: its ids, or all.
std::vector<int> view_ids(const View& view, const Target& target);

/// True if there are fewer than three points, or all are within a millionth of their extent of one
/// line.
bool on_a_line(const Eigen::Matrix3Xd& points);

/// Returns the length of the diagonal of the points' box, in m.
double extent(const Eigen::Matrix3Xd& points);

/// Returns whether markers on the board identify its points.
bool numbered_by_markers(const Target& target);

/// Returns how many points follow one another for one mark of the board: 4 corners of a tag,
/// else 1.
int points_of_mark(const Target& target);

/// Returns where the points of a flat target go if it is turned or reflected about its centre by
/// `m` (orthogonal 2 x 2): place i has the index of the point that point i comes to lie on. It is
/// empty if the target does not come to lie on itself.
std::vector<int> relabeling(const Target& target, const Eigen::Matrix2d& m);

/// Replaces ids of a view (all points in order if it has none) by `places` of them.
void relabel(View& view, const Target& target, const std::vector<int>& places);

}  // namespace kincal
