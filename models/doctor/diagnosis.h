// The doctor's result: the mistakes that it found, and how well they explain the data.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../evidence/evidence.h"

namespace kincal {

/// A Diagnosis contains all findings and how well they explain the data.
struct Diagnosis {
  std::vector<Notice> findings;  // most explanatory first; those found without a fit last
  std::optional<double> chi2;    // without corrections; none: the fit cannot start
  long dof = 0;
  std::optional<double> with_usual_errors;  // chi2/dof of a rig without steps with a robot's usual
                                            // errors estimated; none: they do not explain it
  std::string verdict;                      // one or more sentences
  std::string
      readings;  // joint reading errors that would explain the data; empty: none, or not tested
  std::vector<Alternative> alternatives;  // those tried with all samples (DoctorOptions::compare)
  std::vector<std::string> tested;        // ids of the tested mistakes
};

}  // namespace kincal
