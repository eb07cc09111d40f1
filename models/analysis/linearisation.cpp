#include "linearisation.h"

#include <stdexcept>

#include "../estimation/estimation.h"

namespace kincal {

const MatrixXd& Linearisation::reduced_rows(size_t group, MatrixXd& scratch) const {
  if (group < at->kept_rows.size()) return at->kept_rows[group];
  return scratch = kincal::reduced_rows(*at->problem, at->state, group);
}

Linearisation linearise(const Solution& solution) {
  if (solution.parameters.empty() && !solution.columns.empty())
    throw std::invalid_argument(
        "a solution without estimates cannot be analysed: after a repeated solve() take that of "
        "Calibration::last()");
  Linearisation out{solution, solution.last};
  if (out.at) return out;
  out.at = std::make_shared<LastProblem>();
  out.at->problem =
      std::make_unique<Estimation>(*solution.recording, solution.training(), solution.setup);
  out.at->state = out.at->problem->pack(solution.values);
  out.at->problem->renew(out.at->state);
  out.at->observability = observe(*out.at->problem, out.at->state, &out.at->kept_rows);
  return out;
}

}  // namespace kincal
