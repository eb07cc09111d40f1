// Does the robot touch itself? An approximation: links are the boxes around their shapes, and those
// that overlap where the robot certainly does not touch itself are not looked at.
#pragma once

#include <utility>
#include <vector>

#include "../rig/configuration.h"

namespace kincal {

/// A Box stands in a link's frame.
struct Box {
  Pose link_T_box;
  Vector3d size;  // along its own axes, m
};

/// Whether two boxes, each in its own pose, are nearer than `margin` (m) along one of the fifteen
/// axes that separate boxes (Gottschalk, Lin, Manocha 1996).
bool boxes_near(const Pose& a, const Vector3d& size_a, const Pose& b, const Vector3d& size_b,
                double margin);

class Clearance {
 public:
  /// `boxes`: by link. Pairs of links are not looked at that are joined by one joint, or near in
  /// one of these postures, in which the robot does not touch itself: as it is drawn, and as it
  /// stood.
  Clearance(const Rig& rig, std::vector<std::vector<Box>> boxes, double margin,
            const std::vector<Configuration>& safe);
  /// Returns two links that are near; {-1, -1}: none.
  std::pair<int, int> near(const Configuration& robot) const;
  bool empty() const { return pairs_.empty(); }

 private:
  bool near(const std::pair<int, int>& pair, const Configuration& robot) const;

  std::vector<std::vector<Box>> boxes_;
  double margin_;
  std::vector<std::pair<int, int>> pairs_;
};

}  // namespace kincal
