// One warning of many cases.
#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "../rig/words.h"
#include "trial_warnings.h"

namespace kincal {

/// A Case is one of what a warning is about: how bad it is orders them.
struct Case {
  std::string name, text;
  double size = 0;
};

/// Warns once of all cases: of one in its own words; of several how many there are, `what` they are
/// ("parameters above 3 sigmas"), the worst one's words and the names of the next.
inline void warn(const char* id, const char* what, std::vector<Case> cases, Warnings& out) {
  if (cases.empty()) return;
  std::stable_sort(cases.begin(), cases.end(),
                   [](const Case& a, const Case& b) { return a.size > b.size; });
  Warning warning{id, cases[0].text, {}};
  for (const Case& c : cases) warning.names.push_back(c.name);
  if (cases.size() > 1)
    warning.text = std::to_string(cases.size()) + " " + what + ", worst " + cases[0].text +
                   "; then " + listed({warning.names.begin() + 1, warning.names.end()}, kNamed - 2);
  out.push_back(std::move(warning));
}

}  // namespace kincal
