#include "kinds.h"

#include <algorithm>
#include <optional>
#include <string_view>

#include "error.h"

namespace kincal {
namespace {

constexpr size_t kLooked = 1 << 16;  // bytes of the beginning; a robot's or rig's head is shorter

/// What a text looks like, and what to do about it whoever gets it; `is` where it is one of ours.
struct Likeness {
  std::string what, cure;
  std::optional<Wanted> is;
};

bool begins(std::string_view text, std::string_view with) {
  return text.substr(0, with.size()) == with;
}

bool has(std::string_view text, std::string_view part) {
  return text.find(part) != std::string_view::npos;
}

std::string_view first_line_of(std::string_view text) {
  const std::string_view line = text.substr(0, text.find('\n'));
  return !line.empty() && line.back() == '\r' ? line.substr(0, line.size() - 1) : line;
}

/// Is there a line that begins so?
bool has_line(std::string_view text, std::string_view begin) {
  return begins(text, begin) || has(text, "\n" + std::string(begin));
}

std::optional<Likeness> no_text(std::string_view text) {
  using namespace std::string_view_literals;
  static const struct {
    std::string_view begin;
    const char *what, *cure;
  } kKnown[] = {
      {"\x1f\x8b"sv, "this is a compressed file (gzip)", "uncompress it first: gunzip"},
      {"BZh"sv, "this is a compressed file (bzip2)", "uncompress it first: bunzip2"},
      {"\xFD"
       "7zXZ"sv,
       "this is a compressed file (xz)", "uncompress it first: unxz"},
      {"\x28\xB5\x2F\xFD"sv, "this is a compressed file (zstd)", "uncompress it first: unzstd"},
      {"PK\3\4"sv, "this is a zip archive", "unpack it first: unzip"},
      {"#ROSBAG"sv, "this is a ROS bag", "write what was measured in it as samples.jsonl"},
      {"SQLite format 3"sv, "this is a database (of a ROS 2 bag?)",
       "write what was measured in it as samples.jsonl"},
      {"\x89MCAP"sv, "this is a bag (MCAP)", "write what was measured in it as samples.jsonl"},
      {"\xFF\xFE"sv, "this is a text in UTF-16", "save it as UTF-8"},
      {"\xFE\xFF"sv, "this is a text in UTF-16", "save it as UTF-8"},
  };
  for (const auto& known : kKnown)
    if (begins(text, known.begin)) return Likeness{known.what, known.cure, std::nullopt};
  if (has(text, "\0"sv)) return Likeness{"this is binary data", "", std::nullopt};
  return std::nullopt;
}

std::optional<Likeness> xml(std::string_view text) {
  if (!begins(text, "<")) return std::nullopt;
  return Likeness{"this is XML", "", Wanted::urdf};  // its reader knows what else it may be
}

/// A sample is spread over lines where the second one does not begin another sample.
bool spread(std::string_view text) {
  const size_t second = text.find_first_not_of(" \t\r\n", std::min(text.find('\n'), text.size()));
  return second != std::string_view::npos && text[second] != '{' && has(text, "\"views\"");
}

std::optional<Likeness> json(std::string_view text) {
  if (begins(text, "[")) {
    const size_t inside = text.find_first_not_of(" \t\r\n", 1);
    if (inside == std::string_view::npos || text[inside] != '{') return std::nullopt;
    return Likeness{"this is a JSON list", "write each of it on a line of its own: jq -c '.[]'",
                    std::nullopt};
  }
  if (!begins(text, "{")) return std::nullopt;
  if (has(first_line_of(text), "\"views\""))
    return Likeness{"these are samples", "", Wanted::samples};
  if (has(text, "\"kincal\"") && has(text, "\"status\""))
    return Likeness{"this is a result.json", "", Wanted::result};
  if (has(text, "\"parameters\"") && has(text, "\"about\""))
    return Likeness{"this is a truth.json", "", Wanted::truth};
  if (!spread(text)) return std::nullopt;
  return Likeness{"this is JSON over several lines",
                  "write each sample on a line of its own: jq -c .", std::nullopt};
}

std::optional<Likeness> table(std::string_view text) {
  const std::string_view line = first_line_of(text);
  const size_t end = text.find('\n');
  if (end == std::string_view::npos || line.find_first_of("{}[]:") != std::string_view::npos)
    return std::nullopt;
  const std::string_view second = first_line_of(text.substr(end + 1));
  for (const char separator : {',', ';', '\t'}) {
    const auto columns = std::count(line.begin(), line.end(), separator);
    if (columns > 0 && std::count(second.begin(), second.end(), separator) == columns)
      return Likeness{"this is a table (CSV)", "", std::nullopt};
  }
  return std::nullopt;
}

std::optional<Likeness> likeness(std::string_view text) {
  if (auto found = no_text(text)) return found;
  text.remove_prefix(std::min(text.find_first_not_of("\xEF\xBB\xBF \t\r\n"), text.size()));
  if (auto found = xml(text)) return found;
  if (auto found = json(text)) return found;
  if (has_line(text, "format: kincal/") ||
      (has_line(text, "sensors:") && has_line(text, "targets:")))
    return Likeness{"this is a rig", "", Wanted::rig};
  if (has_line(text, "format: kincal-local/"))
    return Likeness{"these are local offsets", "", std::nullopt};
  return table(text);
}

const char* name_of(Wanted wanted) {
  switch (wanted) {
    case Wanted::urdf:
      return "URDF";
    case Wanted::rig:
      return "rig";
    case Wanted::samples:
      return "samples (one JSON object a line)";
    case Wanted::postures:
      return "postures (one JSON object a line)";
    case Wanted::truth:
      return "truth.json";
    case Wanted::foreign:
      return "file of another program";
    default:
      return "result.json";
  }
}

/// What to do about a file of kincal's own, or of a kind that could be written as what is wanted.
std::string cure_of(const Likeness& looks, Wanted wanted) {
  const bool lines = wanted == Wanted::samples || wanted == Wanted::postures;
  if (has(looks.cure, "jq")) return lines ? looks.cure : "";
  if (!looks.cure.empty()) return looks.cure;
  if (looks.is == Wanted::urdf && wanted == Wanted::rig)
    return "a rig names its robot's URDF (robot: ...); `kincal init` makes a first one";
  if (looks.is == Wanted::urdf && lines) return "the rig names its robot's URDF by itself";
  if (looks.is == Wanted::samples && wanted == Wanted::rig) return "the rig comes first";
  if (looks.is == Wanted::rig && lines) return "the rig comes first, then these";
  if (looks.is == Wanted::rig && wanted == Wanted::urdf)
    return "give the file that the rig names (robot: ...)";
  if (wanted == Wanted::foreign && has(looks.what, "CSV"))
    return "if its rows are poses, say how: --pose-format";
  if (lines && has(looks.what, "CSV"))
    return R"(write each row as {"id": "...", "joints": {...}, "views": [...]})";
  return "";
}

}  // namespace

void refuse_other_kinds(const std::string& text, const std::string& path, Wanted wanted) {
  const std::optional<Likeness> looks = likeness(std::string_view(text).substr(0, kLooked));
  if (!looks || looks->is == wanted) return;
  if (looks->is == Wanted::samples && wanted == Wanted::postures) return;  // the same keys
  const std::string cure = cure_of(*looks, wanted);
  throw InputError(path + ": " + looks->what + ", no " + name_of(wanted) +
                   (cure.empty() ? "" : "; " + cure));
}

}  // namespace kincal
