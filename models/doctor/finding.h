// What the doctor returns: findings, and the diagnosis that they make.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace kincal {

/// A Finding is a mistake that was found.
struct Finding {
  std::string id, text;            // ids: docs/formats.md
  std::vector<std::string> where;  // sensors, targets, joints, samples
  std::optional<double> chi2_as_is,
      chi2_corrected;      // nothing: does not apply, or (as is) the fit cannot even start
  bool estimated = false;  // no mistake where it is estimated: goes behind the others
};

/// A Diagnosis is all that was found, and what it explains.
struct Diagnosis {
  std::vector<Finding> findings;  // what explains most first; those without a fit last
  std::optional<double> chi2;     // as is; nothing: the fit cannot start
  long dof = 0;
  std::string verdict;  // one or more sentences
  std::string
      readings;  // what errors of the joint readings would explain; empty: not, or not asked
  std::vector<std::string> tested;  // ids of the mistakes that were looked for
};

}  // namespace kincal
