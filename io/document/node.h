// A value of a YAML or JSON file as plain data, with its place.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace kincal {

/// A Node is a value of a YAML or JSON file with its line and column.
struct Node {
  enum class Kind { null, scalar, sequence, mapping };
  Kind kind = Kind::null;
  std::string text;     // scalar: as written
  bool quoted = false;  // scalar: a string, never a number or true / false
  std::vector<std::pair<std::string, Node>> members;  // mapping, in the file's order
  std::vector<Node> items;                            // sequence
  std::vector<double>
      numbers;  // of parse_plain_json: in place of text or items, of a list of lists row after row
  int columns = 0;           // of such rows; 0: a number or a list of numbers
  int line = 0, column = 0;  // from 1

  /// Returns the member `key`; null if it is absent.
  const Node* find(const std::string& key) const {
    for (const auto& member : members)
      if (member.first == key) return &member.second;
    return nullptr;
  }
};

/// Makes an unquoted scalar that is not part of a file.
inline Node scalar_node(const std::string& text) {
  Node node;
  node.kind = Node::Kind::scalar;
  node.text = text;
  return node;
}

}  // namespace kincal
