#include "linearisation.h"

namespace kincal {

Linearisation linearise(const Solution& solution) {
  solution.refresh();
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
