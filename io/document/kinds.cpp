#include "kinds.h"

#include <algorithm>
#include <optional>
#include <string_view>
#include <vector>

#include "error.h"

namespace kincal {
namespace {

constexpr size_t kHead = 1 << 10;
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

constexpr const char* kImages =
    "`kincal detect` finds the targets in a folder of images and writes samples.jsonl";

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
      {"PK\3\4"sv, "this is a zip archive (numpy's .npz is one, too)", "unpack it first: unzip"},
      {"\x93NUMPY"sv, "this is an array of numpy",
       "write its measurements as samples.jsonl, one JSON object per line"},
      {"\x89PNG"sv, "this is an image (PNG)", kImages},
      {"\xFF\xD8\xFF"sv, "this is an image (JPEG)", kImages},
      {"#ROSBAG"sv, "this is a ROS bag", "write its measurements as samples.jsonl"},
      {"SQLite format 3"sv, "this is a database (of a ROS 2 bag?)",
       "write its measurements as samples.jsonl"},
      {"\x89MCAP"sv, "this is a bag (MCAP)", "write its measurements as samples.jsonl"},
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

/// The name that stands in quotes at `at`, if it is that of a list of objects; else "".
std::string list_at(std::string_view text, size_t at) {
  if (at >= text.size() || text[at] != '"') return "";
  const size_t end = text.find('"', at + 1);
  if (end == std::string_view::npos) return "";
  size_t next = end;
  for (const char expected : {':', '[', '{'}) {
    next = text.find_first_not_of(" \t\r\n", next + 1);
    if (next == std::string_view::npos || text[next] != expected) return "";
  }
  return std::string(text.substr(at + 1, end - at - 1));
}

/// The name of a list of objects that a JSON object begins with, or that is called samples; "":
/// there is none. (Samples begin with another key than their views, or are no such list.)
std::string list_in(std::string_view text) {
  text = text.substr(0, kHead);
  const std::string first = list_at(text, text.find_first_not_of(" \t\r\n", 1));
  if (!first.empty() && first != "views") return first;
  for (size_t at = 0; (at = text.find("\"samples\"", at)) != std::string_view::npos; ++at)
    if (const std::string name = list_at(text, at); !name.empty()) return name;
  return "";
}

std::optional<Likeness> json(std::string_view text) {
  if (begins(text, "[")) {
    const size_t inside = text.find_first_not_of(" \t\r\n", 1);
    if (inside == std::string_view::npos || text[inside] != '{') return std::nullopt;
    return Likeness{"this is a JSON list", "write each element on its own line: jq -c '.[]'",
                    std::nullopt};
  }
  if (!begins(text, "{")) return std::nullopt;
  if (has(first_line_of(text), "\"views\"") && list_in(text).empty())
    return Likeness{"these are samples", "", Wanted::samples};
  if (has(text, "\"kincal\"") && has(text, "\"status\""))
    return Likeness{"this is a result.json", "", Wanted::result};
  if (has(text, "\"parameters\"") && has(text, "\"about\""))
    return Likeness{"this is a truth.json", "", Wanted::truth};
  if (const std::string list = list_in(text); !list.empty())
    return Likeness{"this is one JSON object around a list ('" + list + "')",
                    "write each element of the list on its own line: jq -c '." + list + "[]'",
                    std::nullopt};
  if (!spread(text)) return std::nullopt;
  return Likeness{"this is JSON over several lines", "write each sample on its own line: jq -c .",
                  std::nullopt};
}

/// Numbers with blanks between them, two at least.
bool is_row(std::string_view line) {
  const size_t first = line.find_first_of("0123456789"), last = line.find_last_of("0123456789");
  return first != std::string_view::npos &&
         line.find_first_not_of("0123456789+-.eE \t\r") == std::string_view::npos &&
         has(line.substr(first, last - first), " ");
}

std::optional<Likeness> table(std::string_view text) {
  while (begins(text, "#") || begins(text, "\n") || begins(text, "\r\n"))  // comments before it
    text.remove_prefix(std::min(text.find('\n'), text.size() - 1) + 1);
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
  if (is_row(line) && is_row(second))
    return Likeness{"this is a table (CSV, with blanks)", "", std::nullopt};
  return std::nullopt;
}

/// Files of other calibrations, by keys that they have: all of `lines` begin one, or stand in the
/// text.
std::optional<Likeness> other_programs(std::string_view text) {
  static const struct {
    std::vector<const char*> lines;
    const char *what, *cure;
  } kKnown[] = {
      {{"camera_matrix:", "image_width:"},
       "this is a camera_info of ROS (the lens of one camera)",
       "`kincal import` puts it into a rig (import FILE --rig RIG --sensor NAME --out NEW_RIG), "
       "`kincal init` makes a first one"},
      {{"distortion_model:", "K:", "D:"},
       "this is a camera_info message of ROS (the lens of one camera)",
       "`kincal import` puts it into a rig (import FILE --rig RIG --sensor NAME --out NEW_RIG), "
       "`kincal init` makes a first one"},
      {{"!!opencv-matrix"},
       "this is a file of OpenCV (FileStorage)",
       "`kincal import` puts the lens of such a file into a rig (import FILE --rig RIG --sensor "
       "NAME --out NEW_RIG), `kincal init` makes a first one"},
      {{"cam0:", "camera_model:", "intrinsics:"},
       "this is a camchain of Kalibr",
       "`kincal import` puts one of its cameras into a rig (import FILE --camera cam0 --rig RIG "
       "--sensor NAME --out NEW_RIG), `kincal init` makes a first one"},
      {{"target_type:"},
       "this is a target of Kalibr",
       "`kincal import` puts it into a rig (import FILE --rig RIG --target NAME --out NEW_RIG), "
       "`kincal init` makes a first one"},
      {{"eye_on_hand:", "transformation:"},
       "this is a result of easy_handeye (one pose)",
       "a rig has such a pose as a sensor's or target's, pose: {xyz: [x, y, z], quat: [qx, qy, qz, "
       "qw]}, and needs none: kincal finds it. `kincal init robot.urdf --sensor camera:LINK` "
       "writes a first one"},
      {{"calibration_type:", "robot_base_frame:"},
       "this is a file of easy_handeye (one pose)",
       "a rig has such a pose as a sensor's or target's, pose: {xyz: [x, y, z], quat: [x, y, z, "
       "w]}, and needs none: kincal finds it. `kincal init robot.urdf --sensor camera:LINK` "
       "writes a first one"},
  };
  const auto has_key = [&](const char* key) {
    return has_line(text, key) || has(text, "\n  " + std::string(key)) ||
           (key[0] == '!' && has(text, key));
  };
  for (const auto& known : kKnown)
    if (std::all_of(known.lines.begin(), known.lines.end(), has_key))
      return Likeness{known.what, known.cure, std::nullopt};
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
  if (auto found = other_programs(text)) return found;
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
  if (looks.is == Wanted::rig && lines) return "the rig comes first, then these files";
  if (looks.is == Wanted::rig && wanted == Wanted::urdf)
    return "give the file that the rig names (robot: ...)";
  if (looks.is == Wanted::rig && wanted == Wanted::foreign)
    return "give the other program's file, and the rig as --rig";
  if (wanted == Wanted::foreign && has(looks.what, "CSV"))
    return "if its rows are poses, give their format: --pose-format";
  if (lines && has(looks.what, "CSV"))
    return R"(write each row as {"id": "...", "joints": {...}, "views": [...]})";
  return "";
}

}  // namespace

void refuse_other_kinds(const std::string& text, const std::string& path, Wanted wanted) {
  const std::optional<Likeness> looks = likeness(std::string_view(text).substr(0, kLooked));
  if (!looks || looks->is == wanted) return;
  if (wanted == Wanted::foreign && has(looks->cure, "kincal import")) return;
  if (looks->is == Wanted::samples && wanted == Wanted::postures) return;  // the same keys
  const std::string cure = cure_of(*looks, wanted);
  throw InputError(path + ": " + looks->what + ", no " + name_of(wanted) +
                   (cure.empty() ? "" : "; " + cure));
}

}  // namespace kincal
