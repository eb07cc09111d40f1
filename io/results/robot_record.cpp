#include "robot_record.h"

#include "../document/numbers.h"
#include "../urdf/urdf.h"

namespace kincal {

Json exact_pose(const Pose& p) {
  Json rows = Json::array();
  for (int i = 0; i < 3; ++i) rows.push_back(vector3(p.rotation.row(i)));
  return {{"xyz", vector3(p.translation)}, {"rotation", rows}};
}

Pose read_exact_pose(const Field& field) {
  field.check_keys({"xyz", "rotation"});
  const std::vector<double> xyz = field["xyz"].vector(3), rows = field["rotation"].table(3);
  if (rows.size() != 9) field["rotation"].fail("3 x 3 numbers are expected");
  const Matrix3d rotation =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rows.data());
  if (!((rotation * rotation.transpose()).isIdentity(1e-9) && rotation.determinant() > 0))
    field["rotation"].fail("is not a rotation");
  return {rotation, Eigen::Map<const Vector3d>(xyz.data())};
}

std::string motion_text(const Tree& tree, const Joint& joint) {
  std::string out = type_name(joint.type);
  if (joint.has_axis()) out += " " + shortest(joint.axis);
  if (joint.mimic)
    out += " mimics " + tree.joints[joint.mimic->master].name + " times " +
           shortest(joint.mimic->multiplier) + " plus " + shortest(joint.mimic->offset);
  return out;
}

bool equal(const Pose& a, const Pose& b) {
  return a.rotation == b.rotation && a.translation == b.translation;
}

}  // namespace kincal
