#include "names.h"

#include <algorithm>

namespace kincal {
namespace {

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

/// Insertions, deletions, replacements and swaps of neighbours between two names; a '*' of `name`
/// stands for anything.
size_t edit_distance(const std::string& name, const std::string& other) {
  const size_t n = name.size(), m = other.size();
  std::vector<std::vector<size_t>> d(n + 1, std::vector<size_t>(m + 1, 0));
  for (size_t j = 1; j <= m; ++j) d[0][j] = j;
  for (size_t i = 1; i <= n; ++i) {
    const char a = lower(name[i - 1]);
    const bool any = a == '*';
    d[i][0] = d[i - 1][0] + !any;
    for (size_t j = 1; j <= m; ++j) {
      const char b = lower(other[j - 1]);
      if (any) {
        d[i][j] = std::min(d[i - 1][j], d[i][j - 1]);
        continue;
      }
      d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + (a != b)});
      if (i > 1 && j > 1 && a == lower(other[j - 2]) && lower(name[i - 2]) == b)
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
    }
  }
  return d[n][m];
}

size_t common_prefix(const std::string& a, const std::string& b) {
  size_t n = 0;
  while (n < a.size() && n < b.size() && lower(a[n]) == lower(b[n])) ++n;
  return n;
}

}  // namespace

std::string nearest_names(const std::string& name, const std::vector<std::string>& names) {
  constexpr size_t kLongest = 200,
                   kMost = 4;  // longer ones are no slips of the pen, and costly to compare
  if (name.size() > kLongest) return "";
  const size_t letters = name.size() - std::count(name.begin(), name.end(), '*');
  const size_t limit = std::max<size_t>(2, letters / 3);
  struct Near {
    size_t distance, prefix;
    const std::string* name;
  };
  std::vector<Near> near;
  for (const std::string& other : names) {
    if (other.empty() || other.size() > kLongest) continue;
    size_t distance = edit_distance(name, other);
    const bool part =
        std::min(letters, other.size()) >= 3 &&
        (other.find(name) != std::string::npos || name.find(other) != std::string::npos);
    if (part) distance = std::min(distance, limit);
    // of short names two changes are the whole name
    if (distance > limit || distance >= std::max(letters, other.size())) continue;
    near.push_back({distance, common_prefix(name, other), &other});
  }
  std::stable_sort(near.begin(), near.end(), [](const Near& a, const Near& b) {
    return a.distance != b.distance ? a.distance < b.distance : a.prefix > b.prefix;
  });
  if (near.size() > kMost) near.resize(kMost);
  std::string out;
  for (const Near& one : near) out += (out.empty() ? "; nearest: " : ", ") + *one.name;
  return out;
}

std::string long_name(const std::string& name) {
  return "a name of " + std::to_string(name.size()) + " bytes ('" + name.substr(0, 20) +
         "...'); at most " + std::to_string(kLongestName) + " are expected";
}

std::string comma_separated(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

}  // namespace kincal
