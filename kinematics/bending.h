// How the joints of a tree bend under the weight that they carry, with derivatives.
//
// A joint that bends has a rotation vector delta (rad, in the joint's frame before its motion)
// between its origin and its motion:
//     parent_T_child = parent_T_joint * exp(delta) * motion(position).
// It is proportional to the moment of the weights behind it. With the orientations F_i of joint i's
// frame and L_k of the child link of joint k, gravity g, all seen from the root,
//     s_i = sum of L_k S_k over joints k at i or outboard of it,
//     tau_i = F_i' (s_i x g),     delta_i = C_i tau_i,     C_i = B diag(compliance) B',
// B = [a u v]: the axis and two directions across it. S_k [kg m] is the first moment of the moving
// link k about its joint: of its own mass, and of all masses further out as if they sat at the
// joints where they begin. (With joints that turn, masses never appear alone; a sliding joint's
// displacement turns no moment here.) If the compliance turns with the joint's output (`rotor`),
// B turns with the motion.
//
// The moments depend on the deflections. The equilibrium is the fixed point of delta <- C tau,
// which gains a factor of 20 or so an iteration. Its derivative by any parameter x follows from the
// implicit function theorem: with A = d tau / d delta,
//     d delta / dx = E (dC/dx tau + C dtau/dx),     E = (I - C A)^-1.
// A rotation w (seen from the root) of everything that joint k carries changes moments by
//     F_i' (s_i x (g x w))     of joints i outboard of k, and of k if its frame turns as well,
//     F_i' ((w x s_k) x g)     of joints i that carry k, and of k itself;
// so a quantity that changes by D d delta changes by  D E C d tau = sum_i P_i (...) with the path's
// P = D E C F' (3 columns a bending joint). (After Khalil and Besnard, "Geometric calibration of
// robots with flexible joints and links", J. Intelligent and Robotic Systems 34, 2002, and
// Tenhumberg, Baeuml, "Calibration of an elastic humanoid upper body", Humanoids 2021.)
#pragma once

#include <Eigen/LU>
#include <vector>

#include "tree.h"

namespace kincal {

/// A Skeleton is the structure of a tree that bending depends on: which joints bend, and which
/// joints carry which.
struct Skeleton {
  std::vector<int> order;         // all joints, from the root outwards
  std::vector<int> above;         // by joint: the one whose child carries it, -1: none
  std::vector<int> bending;       // indices of joints that bend, from the root outwards
  std::vector<int> index;         // by joint: its index in `bending`, -1: it does not bend
  std::vector<Matrix3d> basis;    // by bending joint: axis, u, v
  std::vector<char> carried_by_;  // joints x joints

  Skeleton() = default;
  Skeleton(const Tree& tree, const std::vector<char>& bends);
  /// Returns whether k is i or lies outboard of it.
  bool carries(int i, int k) const { return carried_by_[i * above.size() + k]; }
  int size() const { return static_cast<int>(bending.size()); }
};

/// Returns a basis of axis and two directions across it, as columns. For axis z the directions are
/// x and y.
Matrix3d axis_basis(const Vector3d& axis);

/// A BentPosture is a skeleton in one posture: the inputs, the equilibrium, and the terms that
/// derivatives need. If it is used again for another posture, nothing is allocated.
struct BentPosture {
  // Input, by joint: rotations of origin and motion, first moment (kg m) of the child link in its
  // frame, compliances about axis, u, v (rad/Nm); gravity (m/s^2) seen from the root.
  std::vector<Matrix3d> origin, motion;
  std::vector<Vector3d> load, compliance;
  Vector3d gravity = Vector3d::Zero();
  bool rotor = false;
  // Output, by joint:
  std::vector<Matrix3d> frame, link;  // F, L
  std::vector<Vector3d> moment;       // s
  // and by bending joint:
  std::vector<Vector3d> torque, delta;
  std::vector<Matrix3d> bend;          // exp(delta)
  std::vector<Matrix3d> left;          // d exp(delta) = exp(left d delta) - 1 times exp(delta)
  std::vector<Matrix3d> yielding;      // C
  MatrixXd coupling, response, loads;  // scratch; E; E C F'
  Eigen::PartialPivLU<MatrixXd> factors;

  void resize(const Skeleton& skeleton);
};

/// Finds the equilibrium. Returns false if the iteration does not contract: this robot would
/// collapse.
bool bend(const Skeleton& skeleton, BentPosture& at);
/// Computes the terms that derivatives need; call it after bend().
void differentiate(const Skeleton& skeleton, BentPosture& at);

/// BendingColumns are the derivatives of a quantity that changes by D d delta (rows x 3 per bending
/// joint): `response` is D E, `loads` D E C F'.
struct BendingColumns {
  MatrixXd response, loads;
};
/// Computes the BendingColumns of D = `by_delta`. Does not allocate if `out` already has the right
/// size.
void through_equilibrium(const BentPosture& at, const Eigen::Ref<const MatrixXd>& by_delta,
                         BendingColumns& out);
/// Returns the columns of D of one joint on a path (kinematics/tree.h): twists, seen from a, of
/// everything behind it. `a_T_joint` is the frame of the joint without its deflection.
inline Eigen::Matrix<double, 6, 3> deflection_twists(const BentPosture& at, int bending,
                                                     int direction, const Pose& a_T_joint) {
  return direction * (adjoint(a_T_joint).rightCols<3>() * at.left[bending]);
}

/// The following functions return derivatives through bending (rows x 3, at most 12 rows) of a
/// quantity by a parameter of joint k:
using ThreeColumns = Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 12, 3>;
using OneColumn = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 12, 1>;
/// by the rotation increments of its origin,
ThreeColumns bent_by_origin(const Skeleton& skeleton, const BentPosture& at,
                            const BendingColumns& columns, int k);
/// by its position (one column), if it turns about `axis`,
OneColumn bent_by_position(const Skeleton& skeleton, const BentPosture& at,
                           const BendingColumns& columns, int k, const Vector3d& axis);
/// by the first moment of its link,
ThreeColumns bent_by_load(const Skeleton& skeleton, const BentPosture& at,
                          const BendingColumns& columns, int k);
/// and by its compliances, if it bends.
ThreeColumns bent_by_compliance(const Skeleton& skeleton, const BentPosture& at,
                                const BendingColumns& columns, int k);

}  // namespace kincal
