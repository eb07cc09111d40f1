#include "geometry.h"

#include <algorithm>
#include <cmath>

namespace kincal {
namespace {

constexpr int kGeometryPostures = 40;
constexpr double kNegligible = 5e-3;  // of a column's length

/// Positions of all joints, followers included, drawn within the limits.
std::vector<std::vector<double>> draw_postures(const Tree& tree) {
  RandomStream draws(1);
  std::vector<std::vector<double>> out(kGeometryPostures,
                                       std::vector<double>(tree.joints.size(), 0.0));
  for (std::vector<double>& positions : out) {
    draw_readings(tree, draws, positions);
    follow_mimics(tree, positions);
  }
  return out;
}

/// Group of a component in the order of preference: 0, 1, 2; see the head of the header.
int preference(const Joint& joint, int component) {
  if (!joint.moves()) return 2;
  if (component % 3 == component_along(joint.axis)) return 1;
  return joint.type == JointType::prismatic && component < 3 ? 1 : 0;
}

/// Orthonormal columns.
class Basis {
 public:
  /// Adds what is left of a column; false if that is negligible.
  bool add(VectorXd column) {
    const double before = column.norm();
    for (int pass = 0; pass < 2; ++pass)
      for (const VectorXd& q : columns_) column -= q.dot(column) * q;
    const double left = column.norm();
    if (!(left > kNegligible * before)) return false;
    columns_.push_back(column / left);
    return true;
  }

 private:
  std::vector<VectorXd> columns_;
};

}  // namespace

int component_along(const Vector3d& axis) {
  int best = 2;
  for (int k = 1; k >= 0; --k)
    if (std::abs(axis(k)) > std::abs(axis(best)) + 1e-6) best = k;
  return best;
}

void draw_readings(const Tree& tree, RandomStream& draws, std::vector<double>& readings) {
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    if (!tree.joints[j].drives()) continue;
    const auto [lower, upper] = usual_range(tree.joints[j]);
    readings[j] = draws.uniform(lower, upper);
  }
}

int body_of(const Tree& tree, int link) {
  while (tree.joint_above[link] >= 0 && tree.joints[tree.joint_above[link]].is_rigid())
    link = tree.joints[tree.joint_above[link]].parent;
  return link;
}

std::vector<OriginComponents> independent_geometry(const Tree& tree,
                                                   const std::vector<Chain>& all_chains,
                                                   const std::vector<char>& has_pose) {
  std::vector<Chain> chains;
  std::vector<Path> paths;
  std::vector<int> joints, ends;  // on any path, in its order; bodies with a pose at an end
  std::vector<char> body_has_pose(tree.links.size(), 0);
  for (size_t l = 0; l < has_pose.size(); ++l)
    if (has_pose[l]) body_has_pose[body_of(tree, static_cast<int>(l))] = 1;
  for (const Chain& chain : all_chains) {
    if (body_of(tree, chain.base) == body_of(tree, chain.tip))
      continue;  // nothing moves between: constants of the ends' poses
    chains.push_back(chain);
    paths.push_back(find_path(tree, chain.base, chain.tip));
    for (const PathStep& step : paths.back())
      if (tree.joints[step.joint].axis_of_pose == PoseAxis::none &&
          !std::count(joints.begin(), joints.end(), step.joint))
        joints.push_back(step.joint);
    for (int link : {chain.base, chain.tip}) {
      const int body = body_of(tree, link);
      if (body_has_pose[body] && !std::count(ends.begin(), ends.end(), body)) ends.push_back(body);
    }
  }

  // Derivatives of base_T_tip, chain by chain and posture by posture: six columns an end, six a
  // joint.
  const Eigen::Index rows = static_cast<Eigen::Index>(6 * kGeometryPostures * chains.size());
  std::vector<Eigen::Matrix<double, Eigen::Dynamic, 6>> of_end(ends.size()),
      of_joint(joints.size());
  for (auto& m : of_end) m.setZero(rows, 6);
  for (auto& m : of_joint) m.setZero(rows, 6);
  const auto place = [](const std::vector<int>& list, int entry) {
    return std::find(list.begin(), list.end(), entry) - list.begin();
  };
  const std::vector<std::vector<double>> postures = draw_postures(tree);
  std::vector<Pose> origins;
  for (const Joint& joint : tree.joints) origins.push_back(joint.parent_T_joint);
  Eigen::Index row = 0;
  double reach = 0;
  for (const std::vector<double>& positions : postures) {
    const std::vector<Pose> root_T_link = link_poses(tree, origins, positions);
    for (size_t c = 0; c < chains.size(); ++c, row += 6) {
      const Pose base_T_root = inverse(root_T_link[chains[c].base]);
      Pose base_T_here;
      for (const PathStep& step : paths[c]) {
        Pose base_T_joint, base_T_there;
        walk(step, origins[step.joint],
             joint_motion(tree.joints[step.joint], positions[step.joint]), base_T_here,
             base_T_joint, base_T_there);
        if (const size_t at = place(joints, step.joint); at < joints.size())
          of_joint[at].middleRows<6>(row) = step.direction * adjoint(base_T_joint);
        base_T_here = base_T_there;
        reach = std::max(reach, base_T_here.translation.norm());
      }
      for (const auto& end :
           {std::make_pair(chains[c].base, -1.0), std::make_pair(chains[c].tip, 1.0)}) {
        const int body = body_of(tree, end.first);
        if (body_has_pose[body])
          of_end[place(ends, body)].middleRows<6>(row) +=
              end.second * adjoint(base_T_root * root_T_link[body]);
      }
    }
  }
  const auto column = [&](const Eigen::Matrix<double, Eigen::Dynamic, 6>& twists, int component) {
    VectorXd out = twists.col(component);
    for (Eigen::Index i = 0; i < rows; i += 6) out.segment<3>(i) /= reach > 0 ? reach : 1;
    return out;
  };

  Basis basis;
  for (const auto& end : of_end)
    for (int k = 0; k < 6; ++k) basis.add(column(end, k));
  std::vector<OriginComponents> out;
  for (int j : joints) out.push_back({j, {}});
  for (int group = 0; group < 3; ++group)
    for (size_t j = 0; j < joints.size(); ++j)
      for (int k = 0; k < 6; ++k)
        if (preference(tree.joints[joints[j]], k) == group && basis.add(column(of_joint[j], k)))
          out[j].components.push_back(k);
  for (OriginComponents& o : out) std::sort(o.components.begin(), o.components.end());
  out.erase(std::remove_if(out.begin(), out.end(),
                           [](const OriginComponents& o) { return o.components.empty(); }),
            out.end());
  return out;
}

}  // namespace kincal
