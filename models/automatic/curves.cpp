#include "curves.h"

#include <algorithm>

#include "../../solver/decompositions.h"
#include "../joints/joint_models.h"

namespace kincal {
namespace {

constexpr int kCurveRounds = 20;

/// Where the parameters of a recording are in one with more of them: by index.
std::vector<int> places_of(const ParameterTable& table, const ParameterTable& in) {
  std::vector<int> out;
  size_t next = 0;
  for (const Parameter& p : table.all) {
    while (in.all[next].name != p.name) ++next;
    out.push_back(static_cast<int>(next++));
  }
  return out;
}

VectorXd moved(const VectorXd& shared, const ParameterTable& table, const ParameterTable& to,
               const std::vector<int>& places) {
  VectorXd out = to.initial;
  for (size_t p = 0; p < places.size(); ++p) {
    const Parameter& parameter = table.all[p];
    const int size = parameter.pose ? 12 : parameter.size();
    out.segment(to.all[places[p]].start, size) = shared.segment(parameter.start, size);
  }
  return out;
}

/// The problem of one group alone: all that has no curve eliminated, with its widths as they are.
WidthProblem alone(const WidthProblem& p, const VectorXd& factor, int group) {
  std::vector<int> own, others;
  for (int i = 0; i < p.start.size(); ++i)
    if (p.group[i] == group)
      own.push_back(i);
    else if (p.group[i] < factor.size())
      others.push_back(i);
  MatrixXd h = p.normal(others, others);
  VectorXd b = p.gradient(others);
  for (size_t i = 0; i < others.size(); ++i) {
    const int k = others[i];
    if (p.start(k) == 0) continue;
    const double t = p.start(k) * (p.group[k] < 0 ? 1 : factor(p.group[k]));
    h(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)) += 1 / (t * t);
    b(static_cast<Eigen::Index>(i)) += p.at(k) / (t * t);
  }
  MatrixXd follow(h.rows(), static_cast<Eigen::Index>(own.size()) + 1);
  follow << p.normal(others, own), b;
  const MatrixXd moved = solve_symmetric(h, follow), across = p.normal(own, others);
  WidthProblem out;
  out.normal = p.normal(own, own) - across * moved.leftCols(moved.cols() - 1);
  out.gradient = p.gradient(own) - across * moved.rightCols(1);
  out.at = p.at(own);
  out.start = p.start(own);
  out.group.assign(own.size(), 0);
  out.groups = 1;
  return out;
}

}  // namespace

std::shared_ptr<const Recording> with_curves(const Recording& recording,
                                             const std::vector<int>& joints) {
  Rig rig = recording.rig;
  for (const int j : joints) rig.joints[j].model = find_joint_model(joint_models(), "curve");
  return make_recording(recording.with_rig(std::move(rig)));
}

std::vector<int> joints_with_curves(const Recording& recording, const EstimationSetup& fitted,
                                    const Values& values, const AutomaticGroups& groups,
                                    const VectorXd& factor) {
  if (groups.curves.empty()) return {};
  const std::shared_ptr<const Recording> curved = with_curves(recording, groups.curves);
  const ParameterTable &from = recording.table, &to = curved->table;
  const std::vector<int> places = places_of(from, to);
  EstimationSetup setup = fitted;
  for (Freed& f : setup.free) f.parameter = places[f.parameter];
  if (setup.initial.size() > 0) setup.initial = moved(setup.initial, from, to, places);
  AutomaticGroups all;
  all.groups = groups.groups;
  all.stated = groups.stated;
  for (WidthGroup& group : all.groups)
    for (Member& m : group.members) m.component.parameter = places[m.component.parameter];
  for (Member& m : all.stated) m.component.parameter = places[m.component.parameter];
  for (const int j : groups.curves) {
    WidthGroup curve{"curve/" + recording.rig.tree.joints[j].name, {}, {}};
    const int parameter = to.joint_offset[j] + 2;
    const std::vector<char> seen = numbers_seen(recording.samples, j, *curved->rig.joints[j].model);
    for (int c = 0; c < to.all[parameter].size(); ++c)
      if (seen[2 + c]) curve.members.push_back({{parameter, c}, to.all[parameter].usual_error});
    all.groups.push_back(std::move(curve));
  }
  Values at = values;
  at.shared = moved(values.shared, from, to, places);
  const FitWidths found = width_problem(*curved, data_problem(*curved, setup, at, all), all);
  std::vector<int> out;
  for (size_t i = 0; i < groups.curves.size(); ++i) {
    const WidthProblem curve =
        alone(found.problem, factor, static_cast<int>(groups.groups.size() + i));
    const Widths learned = learn_widths(curve, VectorXd::Ones(1), kCurveRounds);
    if (learned.defined && evidence_gain(curve, learned, 0) >= kEvidence)
      out.push_back(groups.curves[i]);
  }
  return out;
}

}  // namespace kincal
