#include "names.h"

#include <algorithm>
#include <cctype>
#include <optional>
#include <set>

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

/// A name as it is compared: its letters and digits in small letters, cut into words at everything
/// else and between letters and digits ("Joint2", "joint_2": joint, 2).
struct Spelling {
  std::string text, plain;
  std::vector<size_t> words;       // beginnings in `plain`
  std::vector<std::string> parts;  // between the slashes and dots of a parameter's name
  size_t letters = 0;              // but for '*'
};

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_letter(char c) {
  return (c >= 'a' && c <= 'z') || static_cast<unsigned char>(c) >= 128;  // and all others of UTF-8
}

Spelling spelling_of(const std::string& name) {
  Spelling out;
  out.text = name;
  out.parts.emplace_back();
  char before = 0;
  for (const char raw : name) {
    const char c = lower(raw);
    if (c == '/' || c == '.') out.parts.emplace_back();
    if (is_letter(c) || is_digit(c) || c == '*') {
      if (!(is_letter(c) && is_letter(before)) && !(is_digit(c) && is_digit(before)))
        out.words.push_back(out.plain.size());
      out.plain += c;
      out.parts.back() += c;
      out.letters += c != '*';
    }
    before = c;
  }
  return out;
}

/// How far `part` is from what is left of `whole` without its first words: a prefix of a robot's
/// ("robot1_joint_2", "joint_2"). Nothing: it is not near.
std::optional<size_t> distance_behind_prefix(const Spelling& part, const Spelling& whole) {
  std::optional<size_t> out;
  for (size_t w = 1; w < whole.words.size(); ++w) {
    const std::string rest = whole.plain.substr(whole.words[w]);
    const size_t longest = std::max(rest.size(), part.plain.size()), limit = longest / 5;
    if (longest < 2 || longest - std::min(rest.size(), part.plain.size()) > limit) continue;
    const size_t distance = edit_distance(part.plain, rest);
    if (distance <= limit && (!out || distance + 1 < *out)) out = distance + 1;
  }
  return out;
}

/// Whether every part of the one is a part of the other, as j2 or j2/offset of joint/j2/offset.
bool has_parts(const Spelling& all, const Spelling& some) {
  return all.parts.size() > 1 &&
         std::all_of(some.parts.begin(), some.parts.end(), [&](const std::string& part) {
           return !part.empty() && std::count(all.parts.begin(), all.parts.end(), part) > 0;
         });
}

/// How far a name is from one that exists; nothing: it is not near.
std::optional<size_t> distance_of(const Spelling& meant, const Spelling& other) {
  const size_t limit = std::max<size_t>(2, meant.letters / 3);
  size_t distance = meant.plain.empty() ? edit_distance(meant.text, other.text)
                                        : edit_distance(meant.plain, other.plain);
  const bool part = std::min(meant.letters, other.plain.size()) >= 3 &&
                    (other.text.find(meant.text) != std::string::npos ||
                     meant.text.find(other.text) != std::string::npos);
  std::optional<size_t> out;
  // of short names two changes are the whole name
  if (distance <= limit && distance < std::max(meant.letters, other.plain.size())) out = distance;
  if (!out && (part || has_parts(other, meant))) out = limit;
  if (meant.letters < meant.plain.size()) return out;  // a glob has no prefix
  for (const auto& behind :
       {distance_behind_prefix(other, meant), distance_behind_prefix(meant, other)})
    if (behind && (!out || *behind < *out)) out = behind;
  return out;
}

size_t common_prefix(const std::string& a, const std::string& b) {
  size_t n = 0;
  while (n < a.size() && n < b.size() && lower(a[n]) == lower(b[n])) ++n;
  return n;
}

std::set<std::string> lower_words(const std::string& name) {
  std::set<std::string> out;
  std::string word;
  for (const char c : name + "/") {
    if (std::isalnum(static_cast<unsigned char>(c))) {
      word += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    } else if (!word.empty()) {
      out.insert(word);
      word.clear();
    }
  }
  return out;
}

}  // namespace

std::string nearest_names(const std::string& name, const std::vector<std::string>& names) {
  constexpr size_t kLongest = 200,
                   kMost = 4;  // longer ones are no slips of the pen, and costly to compare
  if (name.size() > kLongest) return "";
  const Spelling meant = spelling_of(name);
  struct Near {
    size_t distance, prefix;
    const std::string* name;
  };
  std::vector<Near> near;
  for (const std::string& other : names) {
    if (other.empty() || other.size() > kLongest) continue;
    if (const std::optional<size_t> distance = distance_of(meant, spelling_of(other)))
      near.push_back({*distance, common_prefix(name, other), &other});
  }
  std::stable_sort(near.begin(), near.end(), [](const Near& a, const Near& b) {
    return a.distance != b.distance ? a.distance < b.distance : a.prefix > b.prefix;
  });
  if (!near.empty() && near[0].distance == 0)  // the same but for case and what is between words
    near.erase(std::find_if(near.begin(), near.end(), [](const Near& n) { return n.distance > 0; }),
               near.end());
  if (near.size() > kMost) near.resize(kMost);
  std::string out;
  for (const Near& one : near) out += (out.empty() ? "; nearest: " : ", ") + *one.name;
  return out;
}

std::string nearest_or_all(const std::string& name, const std::vector<std::string>& names,
                           const std::string& there_are) {
  constexpr size_t kMost = 20;
  std::string out = nearest_names(name, names);
  if (!out.empty() || names.empty()) return out;
  const size_t shown = std::min(names.size(), kMost);
  out = "; " + there_are + ": " + comma_separated({names.begin(), names.begin() + shown});
  return names.size() > shown ? out + " and " + std::to_string(names.size() - shown) + " more"
                              : out;
}

std::string long_name(const std::string& name) {
  return "a name of " + std::to_string(name.size()) + " bytes ('" + name.substr(0, 20) +
         "...'); at most " + std::to_string(kLongestName) + " are expected";
}

double name_likeness(const std::string& name, const std::string& in) {
  const std::set<std::string> words = lower_words(name), others = lower_words(in);
  double found = 0;
  for (const std::string& word : words) found += others.count(word) ? 1 : 0;
  if (found > 0 || words.empty())
    return found / static_cast<double>(std::max<size_t>(1, words.size()));
  return name.size() > 3 && in.find(name) != std::string::npos ? 1 : 0;
}

std::string comma_separated(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

}  // namespace kincal
