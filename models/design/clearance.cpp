#include "clearance.h"

#include <algorithm>
#include <cmath>

namespace kincal {

bool boxes_near(const Pose& a, const Vector3d& size_a, const Pose& b, const Vector3d& size_b,
                double margin) {
  const Matrix3d r = a.rotation.transpose() * b.rotation;
  const Vector3d t = a.rotation.transpose() * (b.translation - a.translation);
  const Vector3d half_a = 0.5 * size_a, half_b = 0.5 * size_b;
  const Matrix3d abs = r.cwiseAbs();
  const auto apart = [&](const Vector3d& axis_a, double reach) {
    return std::abs(axis_a.dot(t)) > reach + margin;
  };
  for (int i = 0; i < 3; ++i) {
    if (apart(Vector3d::Unit(i), half_a(i) + abs.row(i).dot(half_b))) return false;
    if (apart(r.col(i), half_b(i) + abs.col(i).dot(half_a))) return false;
  }
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) {
      const Vector3d axis = Vector3d::Unit(i).cross(Vector3d(r.col(k)));
      const double length = axis.norm();
      if (length < 1e-6) continue;  // parallel edges: the faces decide
      double reach = 0;
      for (int c = 0; c < 3; ++c)
        reach += half_a(c) * std::abs(axis(c)) + half_b(c) * std::abs(r.col(c).dot(axis));
      if (apart(axis / length, reach / length)) return false;
    }
  return true;
}

Clearance::Clearance(const Rig& rig, std::vector<std::vector<Box>> boxes, double margin,
                     const std::vector<Configuration>& safe)
    : boxes_(std::move(boxes)), margin_(margin) {
  for (int a = 0; a < static_cast<int>(boxes_.size()); ++a)
    for (int b = a + 1; b < static_cast<int>(boxes_.size()); ++b) {
      if (boxes_[a].empty() || boxes_[b].empty()) continue;
      int moving = 0;
      for (const PathStep& step : find_path(rig.tree, a, b))
        moving += rig.tree.joints[step.joint].moves();
      if (moving < 2) continue;
      const std::pair<int, int> pair(a, b);
      if (std::none_of(safe.begin(), safe.end(),
                       [&](const Configuration& robot) { return near(pair, robot); }))
        pairs_.push_back(pair);
    }
}

bool Clearance::near(const std::pair<int, int>& pair, const Configuration& robot) const {
  const Pose a = robot.base_T_link(pair.first), b = robot.base_T_link(pair.second);
  for (const Box& of_a : boxes_[pair.first])
    for (const Box& of_b : boxes_[pair.second])
      if (boxes_near(a * of_a.link_T_box, of_a.size, b * of_b.link_T_box, of_b.size, margin_))
        return true;
  return false;
}

std::pair<int, int> Clearance::near(const Configuration& robot) const {
  for (const auto& pair : pairs_)
    if (near(pair, robot)) return pair;
  return {-1, -1};
}

}  // namespace kincal
