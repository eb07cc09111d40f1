// YAML and JSON as one strict tree with places, and the checks that turn it into numbers and names.
// All numbers are read with std::from_chars, whatever the locale.
#pragma once

#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// Something in the user's input is wrong; the text says where (file:line), which field, what is valid.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A value of a YAML or JSON file and where it stands.
struct Node {
  enum class Kind { null, scalar, sequence, mapping };
  Kind kind = Kind::null;
  std::string text;                                 // scalar: as written
  bool quoted = false;                              // scalar: a string, never a number or true / false
  std::vector<std::pair<std::string, Node>> members;  // mapping, in the file's order
  std::vector<Node> items;                          // sequence
  std::vector<double> numbers;                      // of parse_plain_json: in place of text or items, of a list of lists row after row
  int columns = 0;                                  // of such rows; 0: a number or a list of numbers
  int line = 0, column = 0;                         // from 1

  /// Member by key, null if absent.
  const Node* find(const std::string& key) const;
};

/// The whole file. @throws InputError with path and reason.
std::string read_file(const std::string& path);

/// @throws InputError with path:line:column on malformed text and on a key that stands twice in a mapping.
Node parse_yaml(const std::string& text, const std::string& path);
/// One JSON value; `line` is that of the text's first line. @throws InputError likewise; also on NaN, Infinity and numbers beyond double.
Node parse_json(const std::string& text, const std::string& path, int line = 1);
/// The same for what machines write in one line, many times faster: numbers become Node::numbers, columns are unknown (0). False: the text is
/// malformed or has something rare (escapes, other than ASCII, lists of unlike things): parse_json() tells.
bool parse_plain_json(std::string_view text, int line, Node& node);

/// A node with the way to it, for messages: "rig.yaml:12: sensors.wide_left.sigma: ...". Cheap to make; refers to the node.
struct Field {
  const Node* node;
  const std::string* path;
  std::string name;                                 // e.g. "sensors.wide_left.sigma", empty at the top

  std::string where() const;                        // "path:line: name"
  [[noreturn]] void fail(const std::string& what) const;

  bool has(const std::string& key) const;
  Field operator[](const std::string& key) const;   // member; fails with "key 'x' is missing"
  Field item(size_t i) const;                       // fails on Node::numbers
  size_t size() const;                              // items or members

  /// Fails on keys outside required + optional (with the nearest names) and on missing ones; on anything but a mapping.
  void check_keys(const std::vector<std::string>& required, const std::vector<std::string>& optional = {}) const;

  double number() const;                            // finite
  double number_at_least(double low) const;
  double positive() const;                          // > 0
  int integer(int low, int high) const;
  int integer_item(size_t i, int low, int high) const;
  bool boolean() const;
  std::string string() const;                       // any scalar but null
  std::vector<double> vector(int count = -1) const; // finite numbers; -1: any length
  std::vector<double> table(int columns) const;     // a list of lists of `columns` finite numbers, row after row
  std::vector<std::string> strings() const;
  Pose pose() const;                                // {xyz, rpy} or {xyz, quat}; both parts optional
};
Field top(const Node& node, const std::string& path);

/// Visits the values of a JSON lines file, one a line, blank lines aside. `read` returns the value's id. It gets a line by
/// parse_plain_json() first; if it throws InputError, again by parse_json(), and what it says then counts. @throws InputError where a line
/// is malformed or an id stands twice.
void for_each_json_line(const std::string& path, const std::function<std::string(const Field&)>& read);

/// "; nearest: a, b, c" by edit distance, or "" if nothing is near.
std::string nearest_names(const std::string& name, const std::vector<std::string>& names);

/// Shortest decimal text that reads back as the same double (std::to_chars).
std::string shortest(double value);

/// YAML text of a tree: block mappings (those of up to 3 simple values in one line), flow sequences of scalars (where they fit
/// a line), strings quoted where needed. Reads back as the same tree (odd plain texts become quoted). Comments are not kept.
std::string to_yaml(const Node& node);

}  // namespace kincal
