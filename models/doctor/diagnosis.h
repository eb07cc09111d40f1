// What the doctor returns: the mistakes that it found, and what they explain.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../evidence/evidence.h"

namespace kincal {

/// A Diagnosis contains all findings and how well they explain the data.
struct Diagnosis {
  std::vector<Notice> findings;  // what explains most first; those without a fit last
  std::optional<double> chi2;    // as is; nothing: the fit cannot start
  long dof = 0;
  std::string verdict;  // one or more sentences
  std::string
      readings;  // what errors of the joint readings would explain; empty: not, or not asked
  std::vector<Alternative>
      alternatives;                 // that were tried with all samples (DoctorOptions::compare)
  std::vector<std::string> tested;  // ids of the mistakes that were looked for
};

}  // namespace kincal
