// Checked access to a tree of nodes: converts a file's entries into numbers and
// names.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../../kinematics/transform.h"
#include "error.h"
#include "node.h"

namespace kincal {

/// A Field is a node with its path in the file, for messages: "rig.yaml:12:
/// sensors.wide_left.sigma: ...". It is cheap to make and refers to the node.
struct Field {
  const Node* node;
  const std::string* path;
  std::string name;  // e.g. "sensors.wide_left.sigma", empty at the top

  std::string where() const;  // "path:line: name"
  [[noreturn]] void fail(const std::string& what) const;

  bool has(const std::string& key) const;
  Field operator[](const std::string& key) const;  // member; fails with "key 'x' is missing"
  Field item(size_t i) const;                      // fails on Node::numbers, and beyond the end
  size_t size() const;                             // items or members
  /// Returns the members of a mapping. Fails on any other node.
  const std::vector<std::pair<std::string, Node>>& members() const;

  /// Fails if the node is not a mapping, if a key outside required + optional occurs (the message
  /// lists the nearest names), or if a required key is missing.
  void check_keys(const std::vector<std::string>& required,
                  const std::vector<std::string>& optional = {}) const;

  double number() const;  // finite
  double number_at_least(double low) const;
  double positive() const;  // > 0
  int integer(int low, int high) const;
  int integer_item(size_t i, int low, int high) const;
  bool boolean() const;
  std::string string() const;                        // any scalar but null
  std::vector<double> vector(int count = -1) const;  // finite numbers; -1: any length
  std::vector<double> table(
      int columns) const;  // a list of lists of `columns` finite numbers, row after row
  std::vector<std::string> strings() const;
  Pose pose() const;  // {xyz, rpy} or {xyz, quat}; both parts optional
};
Field top(const Node& node, const std::string& path);

}  // namespace kincal
