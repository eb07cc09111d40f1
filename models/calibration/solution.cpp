#include "solution.h"
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "../estimation/estimation.h"
#include "../rig/numbers.h"

namespace kincal {

std::vector<Direction> named_directions(const ParameterTable& table,
                                        const std::vector<Component>& columns,
                                        const Observability& observability) {
  std::vector<Direction> out;
  for (const auto& direction : observability.directions) {
    Direction named;
    for (const auto& c : direction) named.push_back({table.name(columns[c.first]), c.second});
    out.push_back(std::move(named));
  }
  return out;
}

void set_sigmas(const Observability& observability, const std::string& step,
                const std::vector<Prior>& priors, Solution& solution) {
  const std::vector<Component>& columns = solution.columns;
  for (size_t column = 0; column < columns.size(); ++column) {
    const int p = columns[column].parameter, component = columns[column].index;
    const Parameter& parameter = solution.table().all[p];
    auto estimate = std::find_if(solution.parameters.begin(), solution.parameters.end(),
                                 [&](const ParameterEstimate& e) { return e.parameter == p; });
    if (estimate == solution.parameters.end()) {
      solution.parameters.push_back({});
      estimate = solution.parameters.end() - 1;
      estimate->name = parameter.name;
      estimate->parameter = p;
      estimate->components = parameter.components;
      estimate->units = parameter.units;
      estimate->freed.assign(parameter.size(), 0);
    }
    if (column == 0 || columns[column - 1].parameter != p) {
      estimate->step = step;
      estimate->sigma.assign(parameter.size(), 0.0);
      estimate->prior.assign(parameter.size(), 0.0);
      for (const Prior& prior : priors)
        if (prior.parameter == p) estimate->prior[prior.component] = prior.sigma;
    }
    const Eigen::Index c = static_cast<Eigen::Index>(column);
    estimate->freed[component] = 1;
    estimate->sigma[component] = observability.unobservable[column]
                                     ? kNan
                                     : std::sqrt(std::max(0.0, observability.covariance(c, c)));
  }
}

void set_values(Solution& solution) {
  const VectorXd &v = solution.values.shared, &initial = solution.initial;
  for (ParameterEstimate& e : solution.parameters) {
    const Parameter& parameter = solution.table().all[e.parameter];
    if (!parameter.pose) {
      e.initial.assign(initial.data() + parameter.start,
                       initial.data() + parameter.start + parameter.size());
      e.value.assign(v.data() + parameter.start, v.data() + parameter.start + parameter.size());
      continue;
    }
    const Vector6d xi =
        log_se3(inverse(get_pose(initial, parameter.start)) * get_pose(v, parameter.start));
    e.initial.assign(6, 0.0);
    e.value.assign(xi.data(), xi.data() + 6);
    for (int c = 0; c < 6; ++c)
      if (!e.freed[c]) e.value[c] = 0;  // exactly: log and exp leave 1e-19
    e.pose = get_pose(v, parameter.start);
  }
}

void complete(Solution& solution) {
  Estimation problem(*solution.recording, solution.training(), solution.setup);
  const VectorXd state = problem.pack(solution.values);
  problem.renew(state);
  const Observability observability = observe(problem, state);
  solution.covariance = observability.covariance;
  solution.dof_data = observability.dof_data();
  solution.unobservable = named_directions(solution.table(), solution.columns, observability);
  set_sigmas(observability, solution.steps.back().name, solution.setup.priors, solution);
  set_values(solution);
}

double Solution::chi2_per_dof() const { return dof_data > 0 ? chi2_data / dof_data : kNan; }

const ParameterEstimate& Solution::operator[](const std::string& name) const {
  for (const ParameterEstimate& e : parameters)
    if (e.name == name) return e;
  if (parameters.empty() && !columns.empty())
    throw std::out_of_range("estimates after a repeated solve() are those of Calibration::last()");
  throw std::out_of_range("no step freed '" + name + "'");
}

Pose Solution::pose(const std::string& name) const {
  for (const Parameter& p : table().all)
    if (p.pose && p.name == name) return get_pose(values.shared, p.start);
  throw std::out_of_range("there is no pose '" + name + "'");
}

Tree Solution::tree() const {
  const RobotModel model = robot_model(*this);
  const std::vector<Pose> origins = fold_offsets(rig().tree, model.origins, model.offsets);
  Tree out = rig().tree;
  for (size_t j = 0; j < out.joints.size(); ++j) out.joints[j].parent_T_joint = origins[j];
  return out;
}

Solution uncancelled(Solution solution) {
  if (solution.status == Status::cancelled) throw Cancelled();
  return solution;
}

RobotModel robot_model(const Solution& solution) {
  const ParameterTable& table = solution.table();
  const VectorXd& values = solution.values.shared;
  RobotModel out;
  for (size_t j = 0; j < solution.rig().tree.joints.size(); ++j) {
    const Joint& joint = solution.rig().tree.joints[j];
    const Parameter& origin = table.all[table.joint_origin[j]];
    const Pose now = get_pose(values, origin.start),
               before = get_pose(solution.initial, origin.start);
    const bool same = now.rotation == before.rotation && now.translation == before.translation;
    out.origins.push_back(same ? joint.parent_T_joint : now);
    out.offsets.push_back(joint.has_reading() ? values(table.all[table.joint_offset[j]].start) : 0);
  }
  return out;
}

}  // namespace kincal
