#include "gauges.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "../../solver/decompositions.h"
#include "../rig/geometry.h"
#include "../rig/selection.h"
#include "frames.h"

namespace kincal {
namespace {

/// What sees and what is seen, and whether that is a point or a plane.
struct SeenPair {
  Frame sensor, target;
  bool point = false, plane = false;
};

/// A pair for each two bodies (of a free target: two sensors that see it).
std::vector<SeenPair> seen_pairs(const Recording& recording) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  std::map<std::pair<int, int>, SeenPair> out;  // by parameters of the poses
  for (const int i : recording.training()) {
    std::map<int, Frame> free_seen;  // by target: the first sensor
    for (const View& v : recording.samples[i].views) {
      const Frame sensor = {"", rig.sensors[v.sensor].link, table.sensor_pose[v.sensor]};
      const Target& target = rig.targets[v.target];
      SeenPair pair = {sensor, {"", target.link, table.target_pose[v.target]}};
      if (target.link < 0) {
        const auto first = free_seen.insert({v.target, sensor});
        if (first.second) continue;
        pair.target = first.first->second;
      } else {
        pair.plane = target.type == "plane";
        pair.point = !pair.plane && target.count() == 1 &&
                     rig.sensors[v.sensor].model->measurement_kind() != MeasurementKind::pose;
      }
      out.insert({{pair.sensor.pose, pair.target.pose}, pair});
    }
  }
  std::vector<SeenPair> pairs;
  for (const auto& pair : out) pairs.push_back(pair.second);
  return pairs;
}

/// Puts joints that never moved where they stood in all samples.
void put_still_joints(const Recording& recording, Readings& readings) {
  const Rig& rig = recording.rig;
  for (size_t j = 0; j < readings.size(); ++j) {
    double low = kInfinity, high = -kInfinity;
    int samples = 0;
    for (const int s : recording.training()) {
      const double reading = recording.samples[s].readings[j];
      if (!std::isfinite(reading)) continue;
      low = std::min(low, reading), high = std::max(high, reading);
      ++samples;
    }
    if (samples > 1 && high - low <= std::max(1e-6, 3 * rig.joints[j].sigma)) readings[j] = low;
  }
}

}  // namespace

MatrixXd squared_motions(const Recording& recording, const VectorXd& shared,
                         const std::vector<Component>& columns, const Charts& charts) {
  constexpr int kPostures = 12;
  constexpr std::uint64_t kSeed = 1;
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  Unknowns unknowns;
  unknowns.columns = columns;
  unknowns.charts = charts;
  const Eigen::Index n = static_cast<Eigen::Index>(columns.size());
  const std::vector<SeenPair> pairs = seen_pairs(recording);
  MatrixXd out = MatrixXd::Zero(n, n);
  for (Readings& readings : random_postures(rig, kPostures, kSeed)) {
    put_still_joints(recording, readings);
    for (const SeenPair& pair : pairs) {
      MatrixXd apart = MatrixXd::Zero(6, n);
      Pose at;
      for (const auto& [frame, sign] :
           {std::pair(pair.sensor, -1.0), std::pair(pair.target, 1.0)}) {
        MatrixXd moved =
            frame_derivative(rig, table, shared, unknowns, frame, readings).by_unknowns;
        at = base_T_frame(rig, table, shared, frame, readings);
        moved.topRows<3>() += skew(at.translation) * moved.bottomRows<3>();  // of the base's point
        apart += sign * moved;
      }
      if (pair.point || pair.plane)  // of the point that is seen
        apart.topRows<3>() -= skew(at.translation) * apart.bottomRows<3>();
      if (pair.point) apart.bottomRows<3>().setZero();
      if (pair.plane) {  // along its normal, and about what lies in it
        const Matrix3d along = at.rotation.col(2) * at.rotation.col(2).transpose();
        apart.topRows<3>() = (along * apart.topRows<3>()).eval();
        apart.bottomRows<3>() -= (along * apart.bottomRows<3>()).eval();
      }
      out += apart.transpose() * apart;
    }
  }
  return out;
}

int common_body(const Rig& rig) {
  const Tree& tree = rig.tree;
  std::map<int, size_t> count;  // links that stand behind a body
  std::vector<int> links;
  for (const Sensor& s : rig.sensors) links.push_back(s.link);
  for (const Target& t : rig.targets)
    if (t.link >= 0) links.push_back(t.link);
  for (const int link : links)
    for (int body = body_of(tree, link);;) {
      if (++count[body] == links.size()) return body;  // (the first of the last link's way up)
      if (tree.joint_above[body] < 0) break;
      body = body_of(tree, tree.joints[tree.joint_above[body]].parent);
    }
  return body_of(tree, rig.base);
}

std::vector<Gauge> find_gauges(const Recording& recording, const VectorXd& shared,
                               const std::vector<Freed>& poses) {
  constexpr double kRounding = 1e-10;                   // of the largest motion
  constexpr double kNone = 1e-4;                        // of the motions by each component
  constexpr double kTakesPart = 0.2;                    // of the largest component of a direction
  constexpr double kGiven = 4, kTarget = 2, kSame = 2;  // preferred, in shares of a direction
  std::vector<Component> columns;
  for (const Freed& pose : poses)
    for (const int c : pose.components) columns.push_back({pose.parameter, c});
  if (columns.empty()) return {};
  const MatrixXd all = squared_motions(recording, shared, columns);
  const auto n = static_cast<Eigen::Index>(columns.size());
  // (A component that moves nothing moves it by rounding.)
  const double rounding = std::pow(kRounding, 2) * all.diagonal().maxCoeff();
  VectorXd scale = VectorXd::Zero(n);
  for (Eigen::Index i = 0; i < n; ++i)
    if (all(i, i) > rounding) scale(i) = 1 / std::sqrt(all(i, i));
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * all * scale.asDiagonal());
  Eigen::Index count = 0;
  while (count < n && eigen.values(count) < kNone * kNone) ++count;
  MatrixXd open = eigen.vectors.leftCols(count);
  std::vector<Gauge> out;
  const auto component = [&](Eigen::Index i) { return columns[static_cast<size_t>(i)]; };
  for (Eigen::Index k = 0; k < count; ++k) {
    Eigen::Index best = 0;
    double most = -1;
    for (Eigen::Index i = 0; i < n; ++i) {
      const int parameter = component(i).parameter;
      const double share =
          open.row(i).norm() *
          (is_given(recording.rig, recording.table.all[parameter]) ? kGiven : 1) *
          (recording.table.all[parameter].kind == ParameterKind::target_pose ? kTarget : 1) *
          (std::any_of(out.begin(), out.end(),
                       [&](const Gauge& g) { return g.fixed.parameter == parameter; })
               ? kSame
               : 1);
      if (share > most * (1 + 1e-6)) most = share, best = i;
    }
    const VectorXd direction = open * open.row(best).transpose().normalized();
    Gauge gauge{component(best),
                is_given(recording.rig, recording.table.all[component(best).parameter]),
                {}};
    std::vector<std::pair<double, Component>> with;
    for (Eigen::Index i = 0; i < n; ++i)
      if (i != best && std::abs(direction(i)) > kTakesPart * direction.cwiseAbs().maxCoeff())
        with.push_back({std::abs(direction(i)), component(i)});
    std::stable_sort(with.begin(), with.end(),
                     [](const auto& a, const auto& b) { return a.first > b.first; });
    for (const auto& entry : with) gauge.with.push_back(entry.second);
    const VectorXd row = open.row(best).transpose().normalized();
    open -= (open * row * row.transpose()).eval();
    out.push_back(std::move(gauge));
  }
  return out;
}

}  // namespace kincal
