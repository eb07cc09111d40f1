#include "document.h"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <unordered_map>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string_view>
#include <system_error>

namespace kincal {
namespace {

constexpr size_t kMaxDepth = 100;            // of nesting: far beyond any real file, far below the end of the stack
constexpr size_t kMaxAliasNodes = 100'000;   // that all YAML anchors and aliases of a file together may hold

std::string place(const std::string& path, int line, int column) {
  return path + ":" + std::to_string(line) + ":" + std::to_string(column) + ": ";
}

// ------------------------------------------------------------------------------------------------ building a tree
/// Makes a Node from a parser's events. Checks what neither parser does: depth, and keys that stand twice.
class Builder {
 public:
  explicit Builder(const std::string& path) : path_(path) {}

  void open(Node::Kind kind, int line, int column) {
    if (open_.size() >= kMaxDepth)
      throw InputError(place(path_, line, column) + "nested more than " + std::to_string(kMaxDepth) + " levels deep");
    open_.emplace_back();
    open_.back().node.kind = kind;
    open_.back().node.line = line;
    open_.back().node.column = column;
  }

  /// Ends the innermost sequence or mapping; returns it where it now stands.
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

  /// In a mapping, is a key due next?
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
    if (!top.has_key) throw InputError(place(path_, node.line, node.column) + "a key must be a text or a number");
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
        throw InputError(place(path_, value.line, value.column) + "key '" + name + "' stands twice");
  }

  const std::string& path_;
  std::vector<Open> open_;
};

// ------------------------------------------------------------------------------------------------ YAML
size_t count_nodes(const Node& node) {
  size_t n = 1;
  for (const Node& item : node.items) n += count_nodes(item);
  for (const auto& member : node.members) n += count_nodes(member.second);
  return n;
}

/// yaml-cpp's events instead of its nodes: they tell quoted from plain scalars, show every key, and leave aliases to us.
class YamlEvents : public YAML::EventHandler {
 public:
  explicit YamlEvents(const std::string& path) : builder(path), path_(path) {}

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { value(make(Node::Kind::null, mark), anchor); }

  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor, const std::string& text) override {
    refuse_tag(mark, tag);
    if (builder.wants_key()) {
      if (anchor) fail(mark, "an anchor on a key is not supported");
      return builder.key(text, mark.line + 1, mark.column + 1);
    }
    Node node = make(Node::Kind::scalar, mark);
    node.text = text;
    node.quoted = tag != "?";
    value(std::move(node), anchor);
  }

  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    const auto found = anchors_.find(anchor);
    if (found == anchors_.end()) fail(mark, "an alias to something that contains it");
    if (builder.wants_key()) fail(mark, "an alias as a key is not supported");
    const Node& copied = builder.add(Node(found->second));
    limit(copied);
  }

  void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor, YAML::EmitterStyle::value) override {
    open(Node::Kind::sequence, mark, tag, anchor);
  }
  void OnSequenceEnd() override { close(); }
  void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor, YAML::EmitterStyle::value) override {
    open(Node::Kind::mapping, mark, tag, anchor);
  }
  void OnMapEnd() override { close(); }

  Builder builder;

 private:
  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& what) const {
    throw InputError(place(path_, mark.line + 1, mark.column + 1) + what);
  }
  /// Tags beyond those that a plain file has by itself ("?": plain, "!": quoted, "": neither) would change what is meant.
  void refuse_tag(const YAML::Mark& mark, const std::string& tag) const {
    if (!tag.empty() && tag != "?" && tag != "!") fail(mark, "the tag '" + tag + "' is not supported");
  }
  static Node make(Node::Kind kind, const YAML::Mark& mark) {
    Node node;
    node.kind = kind;
    node.line = mark.line + 1;
    node.column = mark.column + 1;
    return node;
  }
  void value(Node&& node, YAML::anchor_t anchor) {
    keep(builder.add(std::move(node)), anchor);
  }
  void open(Node::Kind kind, const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor) {
    refuse_tag(mark, tag);
    if (builder.wants_key()) fail(mark, "a key must be a text or a number");
    builder.open(kind, mark.line + 1, mark.column + 1);
    open_anchors_.push_back(anchor);
  }
  void close() {
    keep(builder.close(), open_anchors_.back());
    open_anchors_.pop_back();
  }
  void keep(const Node& node, YAML::anchor_t anchor) {
    if (!anchor) return;
    limit(node);
    anchors_[anchor] = node;
  }
  /// Few lines of aliases of aliases would fill the memory.
  void limit(const Node& copied) {
    alias_nodes_ += count_nodes(copied);
    if (alias_nodes_ > kMaxAliasNodes)
      throw InputError(place(path_, copied.line, copied.column) + "anchors and aliases hold more than " +
                       std::to_string(kMaxAliasNodes) + " values");
  }

  const std::string& path_;
  std::vector<YAML::anchor_t> open_anchors_;
  std::map<YAML::anchor_t, Node> anchors_;
  size_t alias_nodes_ = 0;
};

// ------------------------------------------------------------------------------------------------ JSON
/// Walks the text and remembers how far the parser has read, which its events do not tell.
struct Cursor {
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;
  const char* at;
  const char** furthest;
  reference operator*() const { return *at; }
  Cursor& operator++() {
    *furthest = ++at;
    return *this;
  }
  bool operator==(const Cursor& other) const { return at == other.at; }
  bool operator!=(const Cursor& other) const { return at != other.at; }
};

class JsonEvents : public nlohmann::json_sax<nlohmann::json> {
 public:
  JsonEvents(const std::string& text, const std::string& path, int line)
      : builder(path),
        furthest(text.data()),
        path_(path),
        text_(text),
        scanned_(text.data()),
        line_(line),
        line_start_(text.data()) {}

  bool null() override { return scalar(Node::Kind::null, "", false); }
  bool boolean(bool value) override { return scalar(Node::Kind::scalar, value ? "true" : "false", false); }
  bool number_integer(number_integer_t value) override { return scalar(Node::Kind::scalar, std::to_string(value), false); }
  bool number_unsigned(number_unsigned_t value) override { return scalar(Node::Kind::scalar, std::to_string(value), false); }
  /// The text comes from the value: nlohmann's own has the decimal point of the C locale in it.
  bool number_float(number_float_t value, const string_t&) override { return scalar(Node::Kind::scalar, shortest(value), false); }
  bool string(string_t& value) override { return scalar(Node::Kind::scalar, std::move(value), true); }
  bool binary(binary_t&) override { return false; }
  bool start_object(std::size_t) override { return open(Node::Kind::mapping); }
  bool key(string_t& value) override {
    find_token();
    builder.key(value, line_, column());
    scanned_ = furthest;
    return true;
  }
  bool end_object() override { return close(); }
  bool start_array(std::size_t) override { return open(Node::Kind::sequence); }
  bool end_array() override { return close(); }

  bool parse_error(std::size_t position, const std::string&, const nlohmann::detail::exception& error) override {
    const std::size_t end = std::min(position > 0 ? position - 1 : 0, text_.size());
    for (std::size_t i = scanned_ - text_.data(); i < end; ++i) count_line(text_.data() + i);
    const int error_column = static_cast<int>(text_.data() + end - line_start_) + 1;
    throw InputError(place(path_, line_, error_column) + plain_words(error.what()));
  }

  Builder builder;
  const char* furthest;

 private:
  /// Without nlohmann's "[json.exception.parse_error.101] parse error at line 1, column 9: ".
  static std::string plain_words(std::string what) {
    const size_t bracket = what.find("] "), column = what.find(", column ");
    if (bracket != std::string::npos) {
      const size_t colon = column == std::string::npos ? std::string::npos : what.find(": ", column);
      what.erase(0, colon == std::string::npos ? bracket + 2 : colon + 2);
    }
    const bool nan = what.find("N'") != std::string::npos || what.find("I'") != std::string::npos;  // of NaN, Infinity
    return nan ? what + " (JSON has finite numbers only)" : what;
  }
  void count_line(const char* p) {
    if (*p != '\n') return;
    ++line_;
    line_start_ = p + 1;
  }
  /// Moves to the start of the token that an event is about: only separators and ends lie before it.
  void find_token() {
    static constexpr std::string_view between = " \t\r\n,:]}";
    for (; scanned_ < furthest && between.find(*scanned_) != std::string_view::npos; ++scanned_) count_line(scanned_);
  }
  int column() const { return static_cast<int>(scanned_ - line_start_) + 1; }
  bool scalar(Node::Kind kind, std::string&& value, bool quoted) {
    find_token();
    Node node;
    node.kind = kind;
    node.text = std::move(value);
    node.quoted = quoted;
    node.line = line_;
    node.column = column();
    builder.add(std::move(node));
    skip_token(quoted);
    return true;
  }
  /// A string ends where the parser has read to; anything else before the next separator, one of which it may have read.
  void skip_token(bool quoted) {
    static constexpr std::string_view ends = " \t\r\n,:]}";
    if (quoted)
      scanned_ = furthest;
    else
      while (scanned_ < furthest && ends.find(*scanned_) == std::string_view::npos) ++scanned_;
  }
  bool open(Node::Kind kind) {
    find_token();
    builder.open(kind, line_, column());
    ++scanned_;
    return true;
  }
  bool close() {
    builder.close();
    return true;
  }

  const std::string& path_;
  const std::string& text_;
  const char* scanned_;      // end of the last token
  int line_;                 // of scanned_
  const char* line_start_;
};

// ------------------------------------------------------------------------------------------------ plain JSON
/// Reads what machines write: ASCII without escapes, in one line, lists of numbers. All else is refused, for parse_json() to judge:
/// every function returns false then. A value means the same as parse_json()'s.
class PlainJson {
 public:
  PlainJson(std::string_view text, int line) : at_(text.data()), end_(at_ + text.size()), line_(line) {}

  bool whole(Node& node) { return value(node, 0) && (skip_blanks(), at_ == end_); }

 private:
  void skip_blanks() {
    while (at_ != end_ && (*at_ == ' ' || *at_ == '\t' || *at_ == '\r')) ++at_;
  }
  /// The next character that is no blank, 0 at the end.
  char peek() {
    skip_blanks();
    return at_ == end_ ? '\0' : *at_;
  }
  bool take(char c) { return peek() == c && (++at_, true); }
  bool take_word(std::string_view word) {
    if (static_cast<size_t>(end_ - at_) < word.size() || std::string_view(at_, word.size()) != word) return false;
    at_ += word.size();
    return true;
  }
  static bool is_digit(char c) { return c >= '0' && c <= '9'; }
  static bool begins_number(char c) { return is_digit(c) || c == '-'; }

  bool string(std::string& out) {
    if (!take('"')) return false;
    const char* const begin = at_;
    while (at_ != end_ && *at_ >= 0x20 && *at_ < 0x7f && *at_ != '"' && *at_ != '\\') ++at_;
    if (at_ == end_ || *at_ != '"') return false;
    out.assign(begin, at_);
    return take('"');
  }

  /// std::from_chars takes a little more than JSON allows (01, 1., inf), of which nothing passes here.
  bool number(double& out) {
    const char* digits = at_ + (at_ != end_ && *at_ == '-');
    if (digits == end_ || !is_digit(*digits)) return false;
    const char* after = digits;
    while (after != end_ && is_digit(*after)) ++after;
    if ((*digits == '0' && after - digits > 1) || (after != end_ && *after == '.' && (after + 1 == end_ || !is_digit(after[1]))))
      return false;
    const auto [stop, error] = std::from_chars(at_, end_, out);
    if (error != std::errc()) return false;
    if (out == 0) out = 0;  // not -0
    at_ = stop;
    return true;
  }

  /// Numbers up to the closing bracket, appended.
  bool row(std::vector<double>& numbers) {
    for (;;) {
      double read = 0;
      skip_blanks();
      if (!number(read)) return false;
      numbers.push_back(read);
      if (take(']')) return true;
      if (!take(',')) return false;
    }
  }

  bool rows(Node& node) {
    do {
      const size_t before = node.numbers.size();
      if (!take('[') || !row(node.numbers)) return false;
      const int columns = static_cast<int>(node.numbers.size() - before);
      if (before == 0) node.columns = columns;
      if (columns != node.columns) return false;
    } while (take(','));
    return take(']');
  }

  bool sequence(Node& node, int depth) {
    node.kind = Node::Kind::sequence;
    if (take(']')) return true;
    if (begins_number(peek())) return row(node.numbers);
    const char* const first = at_;
    if (take('[') && begins_number(peek())) return at_ = first, rows(node);
    at_ = first;
    do {
      node.items.emplace_back();
      if (!value(node.items.back(), depth)) return false;
    } while (take(','));
    return take(']');
  }

  bool mapping(Node& node, int depth) {
    node.kind = Node::Kind::mapping;
    if (take('}')) return true;
    node.members.reserve(8);
    do {
      node.members.emplace_back();
      auto& [name, member] = node.members.back();
      if (!string(name) || !take(':') || !value(member, depth)) return false;
    } while (take(','));
    return take('}') && !has_duplicates(node);
  }

  bool has_duplicates(const Node& mapping) {
    names_.clear();
    for (const auto& member : mapping.members) names_.push_back(member.first);
    std::sort(names_.begin(), names_.end());
    return std::adjacent_find(names_.begin(), names_.end()) != names_.end();
  }

  bool value(Node& node, int depth) {
    constexpr int kDeep = 20;
    if (depth > kDeep) return false;
    node.line = line_;
    const char next = peek();
    if (take('{')) return mapping(node, depth + 1);
    if (take('[')) return sequence(node, depth + 1);
    if (next == 'n') return take_word("null");
    node.kind = Node::Kind::scalar;
    if (begins_number(next)) return node.numbers.resize(1), number(node.numbers[0]);
    node.quoted = next == '"';
    if (node.quoted) return string(node.text);
    node.text = next == 't' ? "true" : "false";
    return take_word(node.text);
  }

  const char *at_, *const end_;
  const int line_;
  std::vector<std::string_view> names_;  // of the mapping at hand
};

// ------------------------------------------------------------------------------------------------ scalars
bool starts_with_zero(std::string_view digits) {
  return digits.size() > 1 && digits[0] == '0' && digits[1] >= '0' && digits[1] <= '9';
}

/// A whole finite decimal number. Refused: 010 (octal in YAML 1.1), 0x10, 1_000, 1:30, nan, inf.
bool read_number(std::string_view text, double& value) {
  if (!text.empty() && text[0] == '+') {
    text.remove_prefix(1);
    if (!text.empty() && text[0] == '-') return false;
  }
  if (starts_with_zero(text.substr(!text.empty() && text[0] == '-'))) return false;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && std::isfinite(value);
}

std::string shortened(const std::string& text) { return text.size() <= 60 ? text : text.substr(0, 57) + "..."; }

/// What stands there, for messages: 'abc', 'abc' (a string), a list, a mapping, nothing.
std::string describe(const Node& node) {
  switch (node.kind) {
    case Node::Kind::null: return "nothing";
    case Node::Kind::sequence: return "a list";
    case Node::Kind::mapping: return "a mapping";
    default: return "'" + shortened(node.text) + "'" + (node.quoted ? " (a string)" : "");
  }
}

// ------------------------------------------------------------------------------------------------ near names
char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

/// Insertions, deletions, replacements and swaps of neighbours between two names; a '*' of `name` stands for anything.
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
      if (i > 1 && j > 1 && a == lower(other[j - 2]) && lower(name[i - 2]) == b) d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
    }
  }
  return d[n][m];
}

size_t common_prefix(const std::string& a, const std::string& b) {
  size_t n = 0;
  while (n < a.size() && n < b.size() && lower(a[n]) == lower(b[n])) ++n;
  return n;
}

// ------------------------------------------------------------------------------------------------ writing YAML
constexpr size_t kYamlWidth = 110;

/// May the text stand without quotes and mean itself? Stricter than YAML.
bool plain_ok(const std::string& text, bool in_flow) {
  static const std::set<std::string> nulls = {"", "~", "null", "Null", "NULL"};
  if (nulls.count(text) || text.front() == ' ' || text.back() == ' ' || text.back() == ':') return false;
  if (std::string_view("?:,[]{}#&*!|>'\"%@`=<").find(text[0]) != std::string_view::npos) return false;
  if (text[0] == '-' && (text.size() == 1 || !(std::isalnum(static_cast<unsigned char>(text[1])) || text[1] == '.'))) return false;
  if (text.compare(0, 3, "...") == 0 || text.find(": ") != std::string::npos || text.find(" #") != std::string::npos) return false;
  if (in_flow && text.find_first_of(",[]{}:") != std::string::npos) return false;
  return std::all_of(text.begin(), text.end(), [](unsigned char c) { return c >= 0x20 && c != 0x7f; });
}

std::string quote(const std::string& text) {
  std::string out = "\"";
  for (unsigned char c : text) {
    static const char* hex = "0123456789abcdef";
    if (c == '"' || c == '\\')
      out += {'\\', static_cast<char>(c)};
    else if (c == '\n')
      out += "\\n";
    else if (c == '\t')
      out += "\\t";
    else if (c < 0x20 || c == 0x7f)
      out += {'\\', 'x', hex[c >> 4], hex[c & 15]};
    else
      out += static_cast<char>(c);
  }
  return out + "\"";
}

std::string scalar_text(const Node& node, bool in_flow) {
  if (node.kind == Node::Kind::null) return "null";
  return node.quoted || !plain_ok(node.text, in_flow) ? quote(node.text) : node.text;
}
std::string key_text(const std::string& key, bool in_flow) { return plain_ok(key, in_flow) ? key : quote(key); }

bool is_scalar(const Node& node) { return node.kind == Node::Kind::scalar || node.kind == Node::Kind::null; }

/// Sequences of scalars, and small mappings of such or of scalars, go into one line: "" if `node` does not.
std::string flow_text(const Node& node, bool small_mapping) {
  if (is_scalar(node)) {
    const bool keeps_kind = node.kind == Node::Kind::null || node.quoted || plain_ok(node.text, true);
    return keeps_kind ? scalar_text(node, true) : "";
  }
  std::string out;
  if (node.kind == Node::Kind::sequence) {
    for (const Node& item : node.items) {
      const std::string text = is_scalar(item) ? flow_text(item, false) : "";
      if (text.empty()) return "";
      out += (out.empty() ? "" : ", ") + text;
    }
    return "[" + out + "]";
  }
  if (node.members.size() > (small_mapping ? 3 : 0)) return "";
  for (const auto& [key, value] : node.members) {
    const std::string text = value.kind == Node::Kind::mapping ? "" : flow_text(value, false);
    if (text.empty()) return "";
    out += (out.empty() ? "" : ", ") + key_text(key, true) + ": " + text;
  }
  return "{" + out + "}";
}

/// A vector, which stays in one line however long.
bool is_vector(const Node& node) {
  double value = 0;
  return node.items.size() <= 12 && std::all_of(node.items.begin(), node.items.end(), [&](const Node& item) {
    return item.kind == Node::Kind::scalar && !item.quoted && read_number(item.text, value);
  });
}

void write_block(const Node& node, size_t indent, bool first_line_indented, std::string& out);

/// What follows "key:" or "-": a scalar or flow text in the same line, else a block.
void write_value(const Node& value, size_t indent, size_t used, bool in_sequence, std::string& out) {
  const bool one_line = is_scalar(value) || (value.members.empty() && is_vector(value));
  const std::string line = is_scalar(value) ? scalar_text(value, false) : flow_text(value, !in_sequence);
  if (!line.empty() && (one_line || used + line.size() <= kYamlWidth)) {
    out += " " + line + "\n";
  } else if (in_sequence) {
    out += " ";
    write_block(value, indent, true, out);
  } else {
    out += "\n";
    write_block(value, indent, false, out);
  }
}

void write_block(const Node& node, size_t indent, bool first_line_indented, std::string& out) {
  const std::string space(indent, ' ');
  bool first = first_line_indented;
  for (const Node& item : node.items) {
    out += (first ? "" : space) + "-";
    write_value(item, indent + 2, indent + 2, true, out);
    first = false;
  }
  for (const auto& [key, value] : node.members) {
    const std::string name = key_text(key, false);
    out += (first ? "" : space) + name + ":";
    write_value(value, indent + 2, indent + name.size() + 2, false, out);
    first = false;
  }
}

}  // namespace

// ------------------------------------------------------------------------------------------------ reading
const Node* Node::find(const std::string& key) const {
  for (const auto& member : members)
    if (member.first == key) return &member.second;
  return nullptr;
}

std::string read_file(const std::string& path) {
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  std::error_code ignored;
  if (file && std::filesystem::is_directory(path, ignored)) throw InputError(path + ": cannot be read: is a directory");
  if (!file) throw InputError(path + ": cannot be read: " + std::generic_category().message(errno ? errno : EIO));
  std::ostringstream text;
  text << file.rdbuf();
  if (file.bad()) throw InputError(path + ": cannot be read: " + std::generic_category().message(EIO));
  return text.str();
}

Node parse_yaml(const std::string& text, const std::string& path) {
  // yaml-cpp 0.7 takes a quote that is never closed if the file ends in a line break; an end marker makes it an error.
  std::istringstream stream(text + (text.empty() || text.back() == '\n' ? "...\n" : "\n...\n"));
  YamlEvents events(path);
  try {
    YAML::Parser parser(stream);
    if (!parser.HandleNextDocument(events)) return Node{};
    YamlEvents rest(path);
    if (parser.HandleNextDocument(rest))
      throw InputError(place(path, rest.builder.root.line, rest.builder.root.column) + "a second document; one is expected");
  } catch (const YAML::Exception& e) {
    const bool open_quote = e.msg.find("document indicator in scalar") != std::string::npos;
    throw InputError(place(path, e.mark.line + 1, e.mark.column + 1) + (open_quote ? "a quoted text is not closed" : e.msg));
  }
  return std::move(events.builder.root);
}

Node parse_json(const std::string& text, const std::string& path, int line) {
  JsonEvents events(text, path, line);
  const char* begin = text.data();
  nlohmann::json::sax_parse(Cursor{begin, &events.furthest}, Cursor{begin + text.size(), &events.furthest}, &events);
  return std::move(events.builder.root);
}

bool parse_plain_json(std::string_view text, int line, Node& node) { return PlainJson(text, line).whole(node = Node()); }

// ------------------------------------------------------------------------------------------------ fields
Field top(const Node& node, const std::string& path) { return {&node, &path, ""}; }

std::string Field::where() const {
  return *path + (node->line > 0 ? ":" + std::to_string(node->line) : "") + (name.empty() ? "" : ": " + name);
}

void Field::fail(const std::string& what) const { throw InputError(where() + ": " + what); }

bool Field::has(const std::string& key) const { return node->find(key) != nullptr; }

Field Field::operator[](const std::string& key) const {
  const Node* member = node->find(key);
  if (!member) fail("key '" + key + "' is missing");
  return {member, path, name.empty() ? key : name + "." + key};
}

Field Field::item(size_t i) const {
  if (!node->numbers.empty()) fail("a list of numbers");
  return {&node->items.at(i), path, name + "[" + std::to_string(i) + "]"};
}

size_t Field::size() const {
  if (!node->numbers.empty()) return node->numbers.size() / std::max(node->columns, 1);
  return node->kind == Node::Kind::mapping ? node->members.size() : node->items.size();
}

void Field::check_keys(const std::vector<std::string>& required, const std::vector<std::string>& optional) const {
  if (node->kind != Node::Kind::mapping) fail("a mapping is expected, not " + describe(*node));
  const auto among = [](const std::vector<std::string>& names, const std::string& key) {
    return std::find(names.begin(), names.end(), key) != names.end();
  };
  for (const auto& [key, value] : node->members)
    if (!among(required, key) && !among(optional, key)) {
      std::vector<std::string> valid = required, missing;
      valid.insert(valid.end(), optional.begin(), optional.end());
      const std::string near = nearest_names(key, valid);
      std::string all;
      for (const std::string& one : valid) all += (all.empty() ? "; valid: " : ", ") + one;
      Field{&value, path, name}.fail("unknown key '" + key + "'" + (near.empty() ? all : near));
    }
  for (const std::string& key : required) (*this)[key];
}

double Field::number() const {
  if (node->kind == Node::Kind::scalar && !node->numbers.empty()) return node->numbers[0];
  double value = 0;
  if (node->kind != Node::Kind::scalar || node->quoted || !read_number(node->text, value))
    fail("a finite number is expected, not " + describe(*node));
  return value;
}

double Field::number_at_least(double low) const {
  const double value = number();
  if (value < low) fail("a number of at least " + shortest(low) + " is expected, not " + describe(*node));
  return value;
}

double Field::positive() const {
  const double value = number();
  if (!(value > 0)) fail("a number greater than 0 is expected, not " + describe(*node));
  return value;
}

int Field::integer(int low, int high) const {
  int value = 0;
  const std::string& text = node->text;
  const char *begin = text.data() + (text[0] == '+'), *end = text.data() + text.size();
  const auto [at, error] = std::from_chars(begin, end, value);
  const bool whole = node->kind == Node::Kind::scalar && !node->quoted && error == std::errc() && at == end &&
                     !starts_with_zero({begin, static_cast<size_t>(end - begin)});
  if (!whole || value < low || value > high)
    fail("an integer in " + std::to_string(low) + " .. " + std::to_string(high) + " is expected, not " + describe(*node));
  return value;
}

int Field::integer_item(size_t i, int low, int high) const {
  constexpr int kMost = 99'999;  // up to here a whole number is an integer however it was written: 3, 3.0
  const double value = node->columns == 0 && i < node->numbers.size() ? node->numbers[i] : low - 1.0;
  if (value >= low && value <= std::min(high, kMost) && value == static_cast<int>(value)) return static_cast<int>(value);
  return item(i).integer(low, high);
}

bool Field::boolean() const {
  const bool yes = node->text == "true" || node->text == "True" || node->text == "TRUE";
  const bool no = node->text == "false" || node->text == "False" || node->text == "FALSE";
  if (node->kind != Node::Kind::scalar || node->quoted || (!yes && !no)) fail("true or false is expected, not " + describe(*node));
  return yes;
}

std::string Field::string() const {
  if (node->kind != Node::Kind::scalar || !node->numbers.empty()) fail("a text is expected, not " + describe(*node));
  return node->text;
}

std::vector<double> Field::vector(int count) const {
  const bool plain = node->kind == Node::Kind::sequence && !node->numbers.empty() && node->columns == 0;
  if (plain && (count < 0 || size() == static_cast<size_t>(count))) return node->numbers;
  if (node->kind != Node::Kind::sequence || (count >= 0 && node->items.size() != static_cast<size_t>(count)))
    fail("a list of " + (count >= 0 ? std::to_string(count) + " " : "") + "numbers is expected, not " + describe(*node) +
         (node->kind == Node::Kind::sequence ? " of " + std::to_string(node->items.size()) : ""));
  std::vector<double> values(size());
  for (size_t i = 0; i < values.size(); ++i) values[i] = item(i).number();
  return values;
}

std::vector<double> Field::table(int columns) const {
  if (!node->numbers.empty() && node->columns == columns) return node->numbers;
  if (node->kind != Node::Kind::sequence)
    fail("a list of lists of " + std::to_string(columns) + " numbers is expected, not " + describe(*node));
  std::vector<double> values;
  values.reserve(node->items.size() * columns);
  for (size_t i = 0; i < size(); ++i) {
    if (!node->numbers.empty()) item(i);  // fails
    const Node& row = node->items[i];
    if (row.kind != Node::Kind::sequence || row.items.size() != static_cast<size_t>(columns)) item(i).vector(columns);  // fails
    for (int k = 0; k < columns; ++k) {
      const Node& one = row.items[k];
      double value = 0;
      if (one.kind != Node::Kind::scalar || one.quoted || !read_number(one.text, value)) item(i).item(k).number();  // fails
      values.push_back(value);
    }
  }
  return values;
}

std::vector<std::string> Field::strings() const {
  if (node->kind != Node::Kind::sequence) fail("a list of texts is expected, not " + describe(*node));
  std::vector<std::string> values;
  for (size_t i = 0; i < size(); ++i) values.push_back(item(i).string());
  return values;
}

Pose Field::pose() const {
  static const std::vector<std::string> keys = {"xyz", "rpy", "quat"};
  check_keys({}, keys);
  Pose pose;
  if (has("xyz")) pose.translation = Eigen::Map<const Vector3d>((*this)["xyz"].vector(3).data());
  if (has("rpy") && has("quat")) fail("either rpy or quat, not both");
  if (has("rpy")) pose.rotation = rotation_from_rpy(Eigen::Map<const Vector3d>((*this)["rpy"].vector(3).data()));
  if (has("quat")) {
    const Field field = (*this)["quat"];
    const std::vector<double> q = field.vector(4);
    const double length = Eigen::Map<const Eigen::Vector4d>(q.data()).norm();
    if (!(std::abs(length - 1) <= 1e-3))
      field.fail("a unit quaternion [x, y, z, w] is expected, this one's length is " + shortest(length));
    pose.rotation = rotation_from_quaternion(Eigen::Map<const Eigen::Vector4d>(q.data()));
  }
  return pose;
}

// ------------------------------------------------------------------------------------------------ texts
std::string nearest_names(const std::string& name, const std::vector<std::string>& names) {
  constexpr size_t kLongest = 200, kMost = 4;  // longer ones are no slips of the pen, and costly to compare
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
    const bool part = std::min(letters, other.size()) >= 3 &&
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

std::string shortest(double value) {
  if (value == 0) return "0";
  char buffer[32];
  return {buffer, std::to_chars(buffer, buffer + sizeof buffer, value).ptr};
}

std::string to_yaml(const Node& node) {
  if (is_scalar(node)) return scalar_text(node, false) + "\n";
  if (node.items.empty() && node.members.empty()) return node.kind == Node::Kind::sequence ? "[]\n" : "{}\n";
  std::string out;
  write_block(node, 0, false, out);
  return out;
}

void for_each_json_line(const std::string& path, const std::function<std::string(const Field&)>& read) {
  const std::string text = read_file(path);
  std::unordered_map<std::string, int> lines;  // of the ids
  Node node;
  std::string id;
  const auto read_plain = [&](std::string_view one, int line) {
    if (!parse_plain_json(one, line, node)) return false;
    try {
      id = read(top(node, path));
      return true;
    } catch (const InputError&) {
      return false;
    }
  };
  int line = 1;
  for (size_t at = 0; at < text.size(); ++line) {
    const size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view one = std::string_view(text).substr(at, end - at);
    at = end + 1;
    if (one.find_first_not_of(" \t\r") == std::string_view::npos) continue;
    if (!read_plain(one, line)) {
      node = parse_json(std::string(one), path, line);
      id = read(top(node, path));
    }
    const auto [first, is_new] = lines.emplace(id, line);
    if (!is_new) top(node, path)["id"].fail("'" + id + "' stands already in line " + std::to_string(first->second));
  }
}

}  // namespace kincal
