#include "camera_texts.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <sstream>
#include <utility>
#include <vector>

#include "../document/error.h"

namespace kincal {
namespace {

struct TextLine {
  std::string text;  // without blanks at its ends
  int number = 0;    // in the file, from 1
};

std::string trimmed(const std::string& text) {
  const size_t first = text.find_first_not_of(" \t\r\n");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t\r\n") - first + 1);
}

/// The lines with something on them.
std::vector<TextLine> lines_of(const std::string& text) {
  std::vector<TextLine> out;
  std::istringstream in(text);
  int number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    const std::string words = trimmed(line);
    if (!words.empty()) out.push_back({words, number});
  }
  return out;
}

Node scalar_at(const std::string& text, int line) {
  Node node = scalar_node(text);
  node.line = line;
  return node;
}

/// A line's words as a list; more lines add to it.
void add_words(const TextLine& line, Node& list) {
  list.kind = Node::Kind::sequence;
  if (list.line == 0) list.line = line.number;
  std::istringstream in(line.text);
  for (std::string word; in >> word;) list.items.push_back(scalar_at(word, line.number));
}

Node mapping_at(int line) {
  Node node;
  node.kind = Node::Kind::mapping;
  node.line = line;
  return node;
}

bool has_line(const std::vector<TextLine>& lines, const std::string& begin) {
  return std::any_of(lines.begin(), lines.end(),
                     [&](const TextLine& line) { return line.text.rfind(begin, 0) == 0; });
}

// ------------------------------------------------------------------------------------------------
// ost.txt: [image] with width and height, then a section for each camera
bool is_section(const TextLine& line) {
  return line.text.size() > 2 && line.text.front() == '[' && line.text.back() == ']';
}

Node ost_cameras(const std::vector<TextLine>& lines) {
  static const std::array<std::pair<const char*, const char*>, 6> kKeys = {
      {{"width", "image_width"},
       {"height", "image_height"},
       {"camera matrix", "camera_matrix"},
       {"distortion", "distortion_coefficients"},
       {"rectification", "rectification_matrix"},
       {"projection", "projection_matrix"}}};
  Node image = mapping_at(1), cameras = mapping_at(1);
  Node* section = nullptr;
  Node* list = nullptr;  // that lines belong to
  for (const TextLine& line : lines) {
    if (line.text[0] == '#') continue;
    if (is_section(line)) {
      const std::string name = line.text.substr(1, line.text.size() - 2);
      list = nullptr;
      section = &image;
      if (name == "image") continue;
      if (name == "externals") {
        section = nullptr;
        continue;
      }
      cameras.members.emplace_back(name, image);
      section = &cameras.members.back().second;
      section->line = line.number;
      section->members.emplace_back("camera_name", scalar_at(name, line.number));
      continue;
    }
    const auto* key = std::find_if(kKeys.begin(), kKeys.end(),
                                   [&](const auto& k) { return line.text == k.first; });
    if (key != kKeys.end() && section) {
      section->members.emplace_back(key->second, Node());
      list = &section->members.back().second;
    } else if (list) {
      add_words(line, *list);
    }
  }
  for (auto& camera : cameras.members) {
    for (auto& member : camera.second.members)
      if (member.first.rfind("image_", 0) == 0 && member.second.items.size() == 1)
        member.second = Node(member.second.items[0]);
    const Node* d = camera.second.find("distortion_coefficients");
    camera.second.members.emplace_back(
        "distortion_model",
        scalar_at(d && d->items.size() == 8 ? "rational_polynomial" : "plumb_bob",
                  d ? d->line : camera.second.line));
  }
  return cameras.members.size() == 1 ? Node(cameras.members[0].second) : cameras;
}

// ------------------------------------------------------------------------------------------------
// rs-enumerate-devices -c: ` Intrinsic of "Color" / 1280x720 / {RGB8}`, then lines `Fx:  913.4`
constexpr char kIntrinsic[] = "Intrinsic of \"";

/// Color 1280x720
std::string stream_name(const std::string& title) {
  const size_t begin = sizeof(kIntrinsic) - 1, end = title.find('"', begin);
  if (end == std::string::npos) return "camera";
  std::string size = title.substr(end + 1);
  const size_t first = size.find_first_of("0123456789");
  size =
      first == std::string::npos ? "" : size.substr(first, size.find_first_of(" /", first) - first);
  return title.substr(begin, end - begin) + (size.empty() ? "" : " " + size);
}

Node realsense_cameras(const std::vector<TextLine>& lines) {
  Node cameras = mapping_at(1);
  Node* camera = nullptr;
  for (const TextLine& line : lines) {
    if (line.text.rfind(kIntrinsic, 0) == 0) {
      const std::string name = stream_name(line.text);
      // The same stream stands there once more for each of its formats.
      camera = nullptr;
      if (cameras.find(name)) continue;
      cameras.members.emplace_back(name, mapping_at(line.number));
      camera = &cameras.members.back().second;
      continue;
    }
    const size_t colon = line.text.find(':');
    if (!camera || colon == std::string::npos) {
      if (colon == std::string::npos) camera = nullptr;
      continue;
    }
    const std::string key = line.text.substr(0, colon),
                      value = trimmed(line.text.substr(colon + 1));
    Node node = scalar_at(value, line.number);
    if (key == "Coeffs") {
      node = Node();
      add_words({value, line.number}, node);
    }
    camera->members.emplace_back("realsense " + key, node);
  }
  return cameras.members.size() == 1 ? Node(cameras.members[0].second) : cameras;
}

}  // namespace

std::optional<Node> camera_text(const std::string& text, const std::string& path) {
  const std::vector<TextLine> lines = lines_of(text);
  if (has_line(lines, "[image]") && has_line(lines, "camera matrix")) return ost_cameras(lines);
  if (has_line(lines, kIntrinsic)) return realsense_cameras(lines);
  if (has_line(lines, "fc = [") || has_line(lines, "fc=[") || has_line(lines, "KK = ["))
    throw InputError(
        path +
        ": this is a text of the Camera Calibration Toolbox for MATLAB, which kincal does not "
        "read; write its values into the rig yourself: model: brown_conrady, intrinsics: [fc(1), "
        "fc(2), cc(1), cc(2)], distortion: kc as it is (k1 k2 p1 p2 k3), image_size: [nx, ny]. Its "
        "skew alpha_c must be 0: calibrate with est_alpha = 0");
  return std::nullopt;
}

}  // namespace kincal
