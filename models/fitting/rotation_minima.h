// All rotations at which a sum of squares that is linear in the rotation's entries has a minimum.
//
// Residuals K_i [vec R; u; 1], linear in the nine entries of a rotation R (column after column) and
// in further unknowns u, have the sum of squares  x' S x,  x = [vec R; u; 1],  S = sum K_i' K_i.
// For a given R the best u is  -S_uu^+ S_ua a,  a = [vec R; 1]; what is left,
//     f(R) = a' Q a,   Q = S_aa - S_au S_uu^+ S_ua,
// is quadratic in R's entries: ten by ten numbers, however many residuals there are. (Perspective
// poses: Terzakis and Lourakis, SQPnP, 2020.) With R exp([w]x), h_j the block of Q a that belongs
// to column j of R, J = d vec R / d w (column j moves by -R [e_j]x w) and G = R' [h_0 h_1 h_2]:
//     f(w) = f + 2 w' J' Q a + w' (J' Q J + (G + G') / 2 - tr(G) 1) w + O(w^3).
// Newton's method, with the matrix shifted to be positive definite and steps that lower f, runs
// from the 24 rotations of a cube: f has few minima, and each is met by some of them.
#pragma once

#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

struct RotationMinimum {
  Matrix3d rotation;
  VectorXd others;  // u; the shortest where the residuals do not determine them
  double cost = 0;  // of all residuals together
  int directions =
      3;  // in which a turn raises the cost; fewer: turns about some axis change nothing
};

/// Returns the minima of x' S x, the least first; `s` is symmetric, of 9 + k + 1 rows.
std::vector<RotationMinimum> rotation_minima(const MatrixXd& s);

/// Fills in the nine columns with which `row` (coefficients of R p) depends on vec R: row R p.
inline void set_rotation_columns(const Matrix3d& row, const Vector3d& p, Eigen::Ref<MatrixXd> out) {
  for (int j = 0; j < 3; ++j) out.middleCols<3>(3 * j) = p(j) * row;
}

}  // namespace kincal
