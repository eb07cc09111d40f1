// Targets: their points, the layouts of boards, and other possible numberings of the points.
//
// Relabelings of a grid. Numbering a board from another corner, or its rows backwards, permutes its
// points by a symmetry of the grid: half a turn (n - 1 - i of a chessboard), a reflection, of a
// square board also a quarter turn. One view cannot show this, because a permuted flat board is the
// same board at another pose (for a reflection: seen from behind). The chain that holds the board,
// or another sensor that sees it, can show it.
#pragma once

#include <string>
#include <vector>

#include "parameters.h"
#include "samples.h"

namespace kincal {

/// A GridLayout is the arrangement of a board's points. They are listed row by row from the origin;
/// x is along a row, y from row to row.
struct GridLayout {
  enum class Kind { corners, charuco, circles, tags } kind = Kind::corners;
  int rows = 0, columns = 0;
  bool asymmetric = false;  // circles: every other row is shifted by half a pitch
  double gap = 0;           // tags: between two tags, in tag sizes
};
/// Returns the points for a spacing of 1, 3 x count, z = 0; of a tag the four corners. Multiplied
/// by `Target::square` they are in m.
Eigen::Matrix3Xd grid_layout(const GridLayout& grid);

/// Returns the two shapes of a warped board, one row each: 1 - u^2 and 1 - v^2 at its points, with
/// u and v from -1 to 1 over the board along x and y. So the two components of a warp are the
/// heights of the board's middle above its edges, along z.
Eigen::Matrix2Xd warp_shapes(const Eigen::Matrix3Xd& layout);
/// Returns the map of a board's plane that a print out of scale has: with stretch a and shear b
///     [1 + a/2, b/2; b/2, 1 - a/2],
/// so lengths along x are longer than along y by a, and the angle between x and y is smaller by b.
/// The mean length is the spacing's.
Eigen::Matrix2d print_map(const Eigen::Vector2d& print);
/// Sets another layout of a grid, and its warp shapes if it may be warped.
void set_layout(Target& target, const Eigen::Matrix3Xd& layout);

/// Both return the target's points in its own frame, in m: at the rig's values, or at given values.
Eigen::Matrix3Xd target_points(const Target& target);
Eigen::Matrix3Xd target_points(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                               int target);

/// Returns the indices of the target's points that a view contains: its ids; all if it has no ids.
std::vector<int> view_ids(const View& view, const Target& target);

/// True if there are fewer than three points, or if all are on a line to within a millionth of
/// their extent.
bool on_a_line(const Eigen::Matrix3Xd& points);

/// Returns the length of the diagonal of the points' box, in m.
double extent(const Eigen::Matrix3Xd& points);

/// Returns whether markers on the board identify its points.
bool numbered_by_markers(const Target& target);

/// Returns the number of consecutive points that one mark of the board has: 4 corners of a tag,
/// else 1.
int points_of_mark(const Target& target);

/// Returns the permutation of a flat target's points that is a rotation or reflection of its marks
/// by `m` (orthogonal 2 x 2) about its centre, and of the points of each mark by `of_mark` about
/// theirs: entry i is the index of the point onto which point i moves. Empty if the target does not
/// coincide with itself.
std::vector<int> relabeling(const Target& target, const Eigen::Matrix2d& m,
                            const Eigen::Matrix2d& of_mark);
/// The same of the whole target.
inline std::vector<int> relabeling(const Target& target, const Eigen::Matrix2d& m) {
  return relabeling(target, m, m);
}

/// Replaces the ids of a view (all points in order if it has none) by their entries in `places`.
void relabel(View& view, const Target& target, const std::vector<int>& places);

}  // namespace kincal
