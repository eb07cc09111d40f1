#include "scale_warnings.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>

#include "../../solver/decompositions.h"
#include "../rig/configuration.h"
#include "../rig/distributions.h"
#include "../rig/geometry.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kByChance = 0.002;  // that all lengths changed alike

/// Places of sensors and mounted targets that the rig gives and the training samples see, as the
/// rig has them and as they came out.
struct Places {
  std::vector<std::string> targets;  // of these, boards whose squares the rig states
  std::vector<Vector3d> before, after;
};

Places places(const Solution& solution) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  std::vector<char> sensors(rig.sensors.size(), 0), targets(rig.targets.size(), 0);
  const Sample* at = nullptr;
  for (const Sample& sample : solution.samples())
    for (const View& v : sample.views) {
      if (!sample.train) continue;
      if (!at) at = &sample;
      sensors[v.sensor] = targets[v.target] = 1;
    }
  Places out;
  if (!at) return out;
  const std::vector<double> readings = completed(at->readings);
  const VectorXd &initial = table.initial, &found = solution.values.shared;
  const Configuration before(rig, table, initial, readings), after(rig, table, found, readings);
  std::map<int, std::vector<int>> carried;  // by body; what moves along was built in one piece
  for (size_t i = 0; i < rig.sensors.size(); ++i) {
    if (!sensors[i] || !rig.sensors[i].pose_given) continue;
    const int body = body_of(rig.tree, rig.sensors[i].link);
    carried[body == body_of(rig.tree, rig.base) ? -1 - static_cast<int>(i) : body].push_back(
        static_cast<int>(i));
  }
  for (const auto& entry : carried) {
    Vector3d was = Vector3d::Zero(), is = Vector3d::Zero();
    const auto count = static_cast<double>(entry.second.size());
    for (const int s : entry.second) {
      was += before.base_T_sensor(s).translation / count;
      is += after.base_T_sensor(s).translation / count;
    }
    out.before.push_back(was);
    out.after.push_back(is);
  }
  for (size_t i = 0; i < rig.targets.size(); ++i) {
    const Target& target = rig.targets[i];
    if (!targets[i] || target.link < 0 || !target.pose_given) continue;
    const int t = static_cast<int>(i);
    out.before.push_back(before.base_T_target(t).translation);
    out.after.push_back(after.base_T_target(t).translation);
    const int square = table.target_square[i];
    if (square >= 0 && initial(table.all[square].start) == found(table.all[square].start))
      out.targets.push_back(target.name);
  }
  return out;
}

/// The scale between the two, with its share by chance; 1 and 1: they do not tell.
struct Scale {
  double factor = 1, by_chance = 1;
};

Scale common_scale(const Places& all) {
  const auto n = static_cast<Eigen::Index>(all.before.size());
  const double freedom = 3.0 * static_cast<double>(n) - 7;
  if (freedom < 2) return {};
  Eigen::Matrix3Xd x(3, n), y(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    x.col(i) = all.before[static_cast<size_t>(i)];
    y.col(i) = all.after[static_cast<size_t>(i)];
  }
  x.colwise() -= x.rowwise().mean().eval();
  y.colwise() -= y.rowwise().mean().eval();
  const SingularValues svd =
      singular_values(y * x.transpose(), Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Matrix3d u = svd.u, v = svd.v;
  const Vector3d signs(1, 1, u.determinant() * v.determinant() < 0 ? -1 : 1);
  const Matrix3d turn = u * signs.asDiagonal() * v.transpose();
  const double spread = x.squaredNorm(), factor = y.cwiseProduct(turn * x).sum() / spread;
  const double left = (y - factor * turn * x).squaredNorm();
  if (!(spread > 0 && factor > 0)) return {};
  const double t = std::abs(factor - 1) / std::sqrt(left / freedom / spread);
  return {factor, 2 * student_tail(t, freedom)};
}

bool of_joint(const UncheckedScale& scale) { return scale.scales[0].rfind("joint/", 0) == 0; }

std::string scale_words(const UncheckedScale& scale) {
  std::vector<std::string> owners;
  for (const std::string& name : scale.scales) {
    const size_t first = name.find('/'), last = name.rfind('/');
    owners.push_back(name.substr(first + 1, last - first - 1));
  }
  return of_joint(scale)
             ? "the readings of joint " + joined(owners)
             : (owners.size() == 1 ? "the square of target " : "the squares of targets ") +
                   joined(owners);
}

}  // namespace

void warn_of_scales(const Report& report, Notices& out) {
  const bool free = std::any_of(report.unchecked.begin(), report.unchecked.end(),
                                [](const UncheckedScale& s) { return !of_joint(s); });
  if (report.solution.usable() && free) {
    const Places all = places(report.solution);
    const Scale scale = common_scale(all);
    if (!all.targets.empty() &&
        std::abs(scale.factor - 1) > scales(ParameterKind::square, "m").reported &&
        scale.by_chance < kByChance)
      out.push_back(make_notice(
          NoticeKind::scale, subjects(Subject::Kind::target, all.targets),
          "all lengths between sensors and targets came out " +
              text("%.3g times those of the rig (by chance: %.1g %%)", scale.factor,
                   100 * scale.by_chance),
          std::string("if the squares of ") + (all.targets.size() == 1 ? "target " : "targets ") +
              joined(all.targets) +
              text(" are assumed %.3g times as large, the lengths agree with the rig",
                   1 / scale.factor) +
              ": nothing else determines the scale",
          "measure the spacing over many fields and correct the rig; if it is right, correct the "
          "poses"));
  }
  for (const UncheckedScale& scale : report.unchecked)
    out.push_back(make_notice(
        NoticeKind::unchecked, subjects(Subject::Kind::parameter, scale.scales),
        "nothing in the data checks " + scale_words(scale) + ": with an error of one percent, " +
            scale.worst + " would shift by " + shown_text(scale.moved, scale.unit) +
            text(", %.2g times its sigma, with residuals as small", scale.sigmas),
        "",
        of_joint(scale) ? "compare a long travel of the joint with a ruler, or state the "
                          "uncertainty of the other parameter (priors)"
                        : "measure over many fields, and write that value into the rig"));
}

std::string unchecked_words(const Report& report) {
  std::vector<std::string> words;
  for (const UncheckedScale& scale : report.unchecked) words.push_back(scale_words(scale));
  return words.empty() ? ""
                       : "it is only as accurate as " + listed(words) + ", which nothing checks";
}

}  // namespace kincal
