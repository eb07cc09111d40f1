// How boards that look the same from several sides are numbered, made to agree with the robot.
//
// A plain chessboard turned by half a turn (a square one by a quarter) is the same picture, so each
// picture was numbered by itself. The joints tell more. With C_i = link_T_link from a camera's link
// to the board's as the readings say, B_i = camera_T_board by the numbers of picture i, and T_g the
// turn of the board about its middle that belongs to another numbering:  X B_i T_g(i) = C_i Z. The
// unknown X and Z drop out of the angles of relative motions:
//     angle(C_j^-1 C_i) = angle(B_j^-1 B_i T),  T of g(i) - g(j) alone.
// Numbers are chosen such that as many pairs as possible agree: from one view outwards, then view
// by view against all others until none changes. Then X and Z are found in closed form, and each
// view takes the numbers that leave the least. That all views are turned alike shows nowhere but in
// Z: it stays as most pictures have it, or goes by views that must not change, by the board's pose
// in the rig, or by another camera.
#pragma once

#include <map>
#include <vector>

#include "../rig/parameters.h"
#include "../rig/samples.h"

namespace kincal {

/// A ViewTurn says what becomes of a view's numbers.
struct ViewTurn {
  int sample = 0, view = 0;
  int quarters = 0;  // point i is then the point that it comes to lie on if the board is turned by
                     // so many quarter turns from x to y (relabeling() of targets.h)
  bool decided = true;  // false: another numbering agrees nearly as well
};

/// Finds the numbers of all views of cameras on the targets in `open`, whose quarter turns look
/// alike (0 among them), that are mounted or held by a chain, by groups of at least three views.
/// `fixed` views (sample, view) keep theirs.
std::vector<ViewTurn> agreeing_numbers(const Rig& rig, const std::vector<Sample>& samples,
                                       const std::map<int, std::vector<int>>& open,
                                       const std::vector<std::pair<int, int>>& fixed);

}  // namespace kincal
