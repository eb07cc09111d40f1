// The data's quadratic model that widths are learned from (widths.h), at a fit.
#pragma once

#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "../estimation/estimation.h"
#include "unchecked_scales.h"

namespace kincal {

/// Returns how far a component is from where it counts from.
double value_of(const ParameterTable& table, const VectorXd& initial, const VectorXd& shared,
                const Component& component);

/// Returns group (-1: none, its prior stays) and starting width of every number that has a prior.
std::map<Component, std::pair<int, double>> starting_widths(const AutomaticGroups& groups);

/// The data's problem at a fit, without what is assumed.
struct DataProblem {
  std::shared_ptr<Estimation> problem;
  VectorXd state;
};

/// Returns it, prepared there, with all members of the groups free: what the fit held counts as
/// well. `fitted` is the fit's setup.
DataProblem data_problem(const Recording& recording, const EstimationSetup& fitted,
                         const Values& values, const AutomaticGroups& groups);

/// Returns its quadratic model.
FitWidths width_problem(const Recording& recording, const DataProblem& at,
                        const AutomaticGroups& groups);

/// The members of a group, and the fit's unknowns with the matrix of their equations and its right
/// side, at their widths.
struct Beside {
  int group;
  std::vector<int> own, others;
  MatrixXd h;
  VectorXd b;
};
/// Returns those of a group beside the groups before `first_further`.
Beside beside(const WidthProblem& problem, const VectorXd& factor, int first_further, int group);
/// Returns the problem of that group alone: the fit's unknowns eliminated, with their widths as
/// they are.
WidthProblem alone(const WidthProblem& problem, const Beside& of);

/// Part of the normal equations of a problem, private unknowns eliminated.
struct NormalPart {
  MatrixXd normal;
  VectorXd gradient;
  double cost = 0;  // twice that of the data at the best private unknowns
};
/// Returns the parts of sets of samples. `set` is by sample of the recording; -1: in none.
std::vector<NormalPart> normal_parts(const DataProblem& at, const std::vector<int>& set, int count);

}  // namespace kincal
