#include "foreign.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <sstream>
#include <string_view>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/kinds.h"
#include "../document/yaml.h"
#include "../urdf/xml.h"
#include "camera_texts.h"

namespace kincal {
namespace {

/// Puts blanks over a part of the text, so that lines and columns stay.
void blank_out(std::string& text, size_t begin, size_t count) {
  for (size_t i = begin; i < std::min(begin + count, text.size()); ++i)
    if (text[i] != '\n') text[i] = ' ';
}

/// YAML as OpenCV writes it begins with %YAML:1.0, which no YAML parser takes, and has a tag on
/// every matrix.
Node foreign_yaml(std::string text, const std::string& path) {
  if (text.compare(0, 5, "%YAML") == 0) blank_out(text, 0, text.find('\n'));
  constexpr std::string_view kTag = "!!opencv-matrix";
  for (size_t at = text.find(kTag); at != std::string::npos; at = text.find(kTag, at))
    blank_out(text, at, kTag.size());
  const size_t content = text.find_first_not_of(" \n\r-");
  const size_t second = text.find("\n---", std::min(content, text.size()));
  if (second != std::string::npos) text.resize(second + 1);
  return parse_yaml(text, path);
}

std::vector<std::string> words_of(const std::string& text) {
  std::istringstream in(text);
  std::vector<std::string> words;
  for (std::string word; in >> word;) words.push_back(word);
  return words;
}

/// An element with elements inside is a mapping (a list, where they are called _), one with several
/// words a list of them.
Node foreign_node(const Xml& xml, const pugi::xml_node& element, int line) {
  Node node;
  node.line = line;
  node.kind = Node::Kind::mapping;
  const std::vector<std::string> words = words_of(element.child_value());
  const bool inner =
      element.find_child([](const pugi::xml_node& n) { return n.type() == pugi::node_element; });
  if (!inner) {
    node.kind = words.empty()       ? Node::Kind::null
                : words.size() == 1 ? Node::Kind::scalar
                                    : Node::Kind::sequence;
    if (words.size() == 1) node.text = words[0];
    for (const std::string& word : words) {
      if (words.size() < 2) break;
      node.items.push_back(scalar_node(word));
      node.items.back().line = line;
    }
    return node;
  }
  for (const pugi::xml_node& child : element.children()) {
    if (child.type() != pugi::node_element) continue;
    const std::string place = at_offset(xml, child.offset_debug());
    const int below = std::stoi(place.substr(place.rfind(':') + 1));
    if (std::strcmp(child.name(), "_") == 0) {
      node.kind = Node::Kind::sequence;
      node.items.push_back(foreign_node(xml, child, below));
    } else {
      node.members.emplace_back(child.name(), foreign_node(xml, child, below));
    }
  }
  return node;
}

}  // namespace

Node read_foreign(const std::string& path) {
  const std::string text = read_file(path);
  if (const size_t begin = text.find_first_not_of(" \t\r\n");
      begin != std::string::npos && text[begin] != '<')
    refuse_other_kinds(text, path, Wanted::foreign);
  return read_any_tree(path);
}

Node read_any_tree(const std::string& path) {
  const std::string text = read_file(path);
  const size_t begin = text.find_first_not_of(" \t\r\n");
  if (begin == std::string::npos) throw InputError(path + ": the file is empty");
  if (text[begin] != '<')
    if (std::optional<Node> cameras = camera_text(text, path)) return *cameras;
  const size_t quote = text.find_first_of("'\"", begin);  // a dictionary of Python has ', as YAML
  const bool python = text[begin] == '{' && quote != std::string::npos && text[quote] == '\'';
  if (text[begin] == '[' || (text[begin] == '{' && !python)) return parse_json(text, path);
  if (text[begin] != '<') return foreign_yaml(text, path);
  Xml xml{text, path};
  const pugi::xml_node top = load_document(xml);
  if (std::strcmp(top.name(), "opencv_storage") != 0)
    throw InputError(path + ": <" + top.name() +
                     "> is not an XML file of OpenCV; the top element must be <opencv_storage>");
  return foreign_node(xml, top, 1);
}

}  // namespace kincal
