// How the parsers of YAML and JSON make a tree of nodes. This header is internal to this folder.
#pragma once

#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "error.h"
#include "node.h"

namespace kincal {

constexpr size_t kMaxDepth =
    100;  // of nesting: far beyond any real file, far below the end of the stack

/// Returns the place of an error, in front of a message.
inline std::string place(const std::string& path, int line, int column) {
  return path + ":" + std::to_string(line) + ":" + std::to_string(column) + ": ";
}

/// A Builder makes a Node from a parser's events. It checks what neither parser does: depth, and
/// duplicate keys.
class Builder {
 public:
  explicit Builder(const std::string& path) : path_(path) {}

  void open(Node::Kind kind, int line, int column) {
    if (open_.size() >= kMaxDepth)
      throw InputError(place(path_, line, column) + "nested more than " +
                       std::to_string(kMaxDepth) + " levels deep");
    open_.emplace_back();
    open_.back().node.kind = kind;
    open_.back().node.line = line;
    open_.back().node.column = column;
  }

  /// Ends the innermost sequence or mapping, and returns it where it now stands.
  const Node& close() {
    Node node = std::move(open_.back().node);
    open_.pop_back();
    if (node.kind == Node::Kind::mapping) refuse_duplicates(node);
    return add(std::move(node));
  }

  void key(const std::string& text, int line, int column) {
    Open& top = open_.back();
    top.key = text;
    top.key_line = line;
    top.key_column = column;
    top.has_key = true;
  }

  /// Returns whether a key is due next, in a mapping.
  bool wants_key() const {
    return !open_.empty() && open_.back().node.kind == Node::Kind::mapping && !open_.back().has_key;
  }

  const Node& add(Node&& node) {
    if (open_.empty()) return root = std::move(node);
    Open& top = open_.back();
    if (top.node.kind == Node::Kind::sequence) {
      top.node.items.push_back(std::move(node));
      return top.node.items.back();
    }
    if (!top.has_key)
      throw InputError(place(path_, node.line, node.column) + "a key must be a text or a number");
    if (node.line != top.key_line) {  // a block below its key: messages about it point to the key
      node.line = top.key_line;
      node.column = top.key_column;
    }
    top.has_key = false;
    top.node.members.emplace_back(std::move(top.key), std::move(node));
    return top.node.members.back().second;
  }

  Node root;

 private:
  struct Open {
    Node node;
    std::string key;
    int key_line = 0, key_column = 0;
    bool has_key = false;
  };

  void refuse_duplicates(const Node& mapping) const {
    std::set<std::string_view> seen;
    for (const auto& [name, value] : mapping.members)
      if (!seen.insert(name).second)
        throw InputError(place(path_, value.line, value.column) + "key '" + name +
                         "' occurs twice");
  }

  const std::string& path_;
  std::vector<Open> open_;
};

}  // namespace kincal
