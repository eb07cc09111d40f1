// One warning of many cases.
#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "../rig/words.h"
#include "trial_warnings.h"

namespace kincal {

/// A WarningItem is one of what a warning is about: how bad it is orders them.
struct WarningItem {
  Subject what;
  std::string text;
  double size = 0;
};

/// Makes one warning of all cases, of which there is at least one: of one case in its own words; of
/// several how many there are, `plural` says of what ("parameters are more than 3 sigmas from their
/// priors"), the worst one's words and the names of the next.
inline Notice notice_of(NoticeKind kind, const std::string& plural, std::vector<WarningItem> cases,
                        std::string why = "", std::string cure = "") {
  std::stable_sort(cases.begin(), cases.end(),
                   [](const WarningItem& a, const WarningItem& b) { return a.size > b.size; });
  Subjects where;
  for (const WarningItem& c : cases) where.push_back(c.what);
  std::string what = cases[0].text;
  if (cases.size() > 1)
    what = std::to_string(cases.size()) + " " + plural + ", worst " + what + "; then " +
           listed(names_of({where.begin() + 1, where.end()}), kNamed - 2);
  return make_notice(kind, std::move(where), std::move(what), std::move(why), std::move(cure));
}

/// As notice_of(), of any number of cases.
inline void warn(NoticeKind kind, const std::string& plural, std::vector<WarningItem> cases,
                 std::string cure, Notices& out) {
  if (!cases.empty()) out.push_back(notice_of(kind, plural, std::move(cases), "", std::move(cure)));
}

/// Says of a warning that its cause is not noise: errors of neighbouring points are correlated.
inline void say_no_noise(Notice& warning) {
  warning.why =
      "errors of neighbouring points are correlated, so this is not noise: something is bent, "
      "turned, shifted or has a wrong size" +
      (warning.why.empty() ? "" : ". " + capital(warning.why));
  warning.otherwise = "until the cause is found, the sigmas of the result are too small";
  warning.cure =
      "look for a difference from the rig: a board that is bent or has two different spacings, "
      "a lens, a rolling shutter";
}

}  // namespace kincal
