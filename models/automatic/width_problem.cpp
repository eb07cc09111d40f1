#include "width_problem.h"

#include "../../solver/decompositions.h"
#include "../../solver/observability.h"

namespace kincal {

double value_of(const ParameterTable& table, const VectorXd& initial, const VectorXd& shared,
                const Component& c) {
  const Parameter& p = table.all[c.parameter];
  if (!p.pose) return shared(p.start + c.index) - initial(p.start + c.index);
  return log_se3(inverse(get_pose(initial, p.start)) * get_pose(shared, p.start))(c.index);
}

std::map<Component, std::pair<int, double>> starting_widths(const AutomaticGroups& groups) {
  std::map<Component, std::pair<int, double>> out;
  for (size_t g = 0; g < groups.groups.size(); ++g)
    for (const Member& m : groups.groups[g].members)
      out[m.component] = {static_cast<int>(g), m.start};
  for (const Member& m : groups.stated) out[m.component] = {-1, m.start};
  return out;
}

DataProblem data_problem(const Recording& recording, const EstimationSetup& fitted,
                         const Values& values, const AutomaticGroups& groups) {
  EstimationSetup setup = fitted;
  setup.priors.clear();
  for (const WidthGroup& group : groups.groups)
    for (const Member& m : group.members)
      merge(setup.free, {{m.component.parameter, {m.component.index}}});
  DataProblem out;
  out.problem = std::make_shared<Estimation>(recording, recording.training(), setup);
  out.state = out.problem->pack(values);
  out.problem->renew(out.state);
  out.problem->prepare(out.state);
  return out;
}

std::vector<NormalPart> normal_parts(const DataProblem& at, const std::vector<int>& set,
                                     int count) {
  Estimation& data = *at.problem;
  const auto n = static_cast<Eigen::Index>(data.columns().size());
  std::vector<NormalPart> out(count);
  for (NormalPart& part : out) {
    part.normal.setZero(n, n);
    part.gradient.setZero(n);
  }
  MatrixXd rows;
  long rank = 0;
  for (size_t g = 0; g < data.groups().size(); ++g) {
    const int k = set[data.sample_of(static_cast<int>(g))];
    if (k < 0) continue;
    const GroupShape& shape = data.groups()[g];
    data.square_root(static_cast<int>(g), at.state, 0, rows);
    const MatrixXd left = eliminate(std::move(rows), shape.private_size, rank);
    const auto m = static_cast<Eigen::Index>(shape.columns.size());
    const MatrixXd products = gram(left);
    out[k].cost += products(m, m);
    for (Eigen::Index i = 0; i < m; ++i) {
      out[k].gradient(shape.columns[i]) += products(i, m);
      for (Eigen::Index j = 0; j < m; ++j)
        out[k].normal(shape.columns[i], shape.columns[j]) += products(i, j);
    }
  }
  return out;
}

FitWidths width_problem(const Recording& recording, const DataProblem& at,
                        const AutomaticGroups& groups) {
  Estimation& data = *at.problem;
  const VectorXd& state = at.state;
  const std::vector<Component>& columns = data.columns();
  const auto n = static_cast<Eigen::Index>(columns.size());
  NormalPart all =
      std::move(normal_parts(at, std::vector<int>(recording.samples.size(), 0), 1).front());
  WidthProblem out{std::move(all.normal),
                   std::move(all.gradient),
                   VectorXd::Zero(n),
                   VectorXd::Zero(n),
                   std::vector<int>(columns.size(), -1),
                   static_cast<int>(groups.groups.size()),
                   {},
                   {},
                   {}};
  std::map<std::pair<ParameterKind, std::string>, int> kinds;
  for (const WidthGroup& group : groups.groups) {
    out.known.push_back(group.width_known);
    const std::vector<Member>& some = group.members.empty() ? group.unseen : group.members;
    out.alike.push_back(-1);
    out.apart.push_back(0);
    if (some.empty()) continue;
    const Component& c = some.front().component;
    out.apart.back() = recording.table.all[c.parameter].kind == ParameterKind::joint_offset;
    const auto next = static_cast<int>(kinds.size());
    out.alike.back() =
        kinds.insert({{recording.table.all[c.parameter].kind, recording.table.unit(c)}, next})
            .first->second;
  }
  const auto members = starting_widths(groups);
  for (size_t i = 0; i < columns.size(); ++i) {
    const auto found = members.find(columns[i]);
    if (found == members.end()) continue;
    const auto k = static_cast<Eigen::Index>(i);
    out.group[i] = found->second.first;
    out.start(k) = found->second.second;
    out.at(k) = value_of(recording.table, data.initial(), state, columns[i]);
  }
  return {std::move(out), columns, all.cost};
}

Beside beside(const WidthProblem& p, const VectorXd& factor, int first_further, int group) {
  Beside out{group, {}, {}, {}, {}};
  for (int i = 0; i < p.start.size(); ++i)
    if (p.group[i] == group)
      out.own.push_back(i);
    else if (p.group[i] < first_further)
      out.others.push_back(i);
  out.h = p.normal(out.others, out.others);
  out.b = p.gradient(out.others);
  for (size_t i = 0; i < out.others.size(); ++i) {
    const int k = out.others[i];
    if (p.start(k) == 0) continue;
    const double t = p.start(k) * (p.group[k] < 0 ? 1 : factor(p.group[k]));
    out.h(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)) += 1 / (t * t);
    out.b(static_cast<Eigen::Index>(i)) += p.at(k) / (t * t);
  }
  return out;
}

WidthProblem alone(const WidthProblem& p, const Beside& of) {
  const std::vector<int>&own = of.own, &others = of.others;
  MatrixXd follow(of.h.rows(), static_cast<Eigen::Index>(own.size()) + 1);
  follow << p.normal(others, own), of.b;
  const MatrixXd moved = solve_symmetric(of.h, follow), across = p.normal(own, others);
  WidthProblem out;
  out.normal = p.normal(own, own) - across * moved.leftCols(moved.cols() - 1);
  out.gradient = p.gradient(own) - across * moved.rightCols(1);
  out.at = p.at(own);
  out.start = p.start(own);
  out.group.assign(own.size(), 0);
  out.groups = 1;
  out.known = {!p.learns(of.group)};
  return out;
}

}  // namespace kincal
