#include "json.h"

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <system_error>
#include <unordered_map>
#include <utility>
#include <vector>

#include "builder.h"
#include "numbers.h"
#include "quoting.h"

namespace kincal {
namespace {

// ------------------------------------------------------------------------------------------------
// any JSON
/// Walks the text and remembers how far the parser has read, which its events do not give.
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
  bool boolean(bool value) override {
    return scalar(Node::Kind::scalar, value ? "true" : "false", false);
  }
  bool number_integer(number_integer_t value) override {
    return scalar(Node::Kind::scalar, std::to_string(value), false);
  }
  bool number_unsigned(number_unsigned_t value) override {
    return scalar(Node::Kind::scalar, std::to_string(value), false);
  }
  /// The text comes from the value: nlohmann's own has the decimal point of the C locale in it.
  bool number_float(number_float_t value, const string_t&) override {
    return scalar(Node::Kind::scalar, shortest(value), false);
  }
  bool string(string_t& value) override {
    return scalar(Node::Kind::scalar, std::move(value), true);
  }
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

  bool parse_error(std::size_t position, const std::string&,
                   const nlohmann::detail::exception& error) override {
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
      const size_t colon =
          column == std::string::npos ? std::string::npos : what.find(": ", column);
      what.erase(0, colon == std::string::npos ? bracket + 2 : colon + 2);
    }
    const bool nan = what.find("N'") != std::string::npos ||
                     what.find("I'") != std::string::npos;  // of NaN, Infinity
    return nan ? what + " (JSON has finite numbers only)" : what;
  }
  void count_line(const char* p) {
    if (*p != '\n') return;
    ++line_;
    line_start_ = p + 1;
  }
  /// Moves to the start of the token that an event is about: only separators and ends lie before
  /// it.
  void find_token() {
    static constexpr std::string_view between = " \t\r\n,:]}";
    for (; scanned_ < furthest && between.find(*scanned_) != std::string_view::npos; ++scanned_)
      count_line(scanned_);
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
  /// A string ends where the parser has read to; anything else before the next separator, one of
  /// which it may have read.
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
  const char* scanned_;  // end of the last token
  int line_;             // of scanned_
  const char* line_start_;
};

// ------------------------------------------------------------------------------------------------
// plain JSON
/// Reads what machines write: ASCII without escapes, in one line, lists of numbers. All else is
/// refused, for parse_json() to judge: every function returns false then. A value means the same as
/// parse_json()'s.
class PlainJson {
 public:
  PlainJson(std::string_view text, int line)
      : at_(text.data()), end_(at_ + text.size()), line_(line) {}

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
    if (static_cast<size_t>(end_ - at_) < word.size() || std::string_view(at_, word.size()) != word)
      return false;
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

  /// std::from_chars takes a little more than JSON allows (01, 1., inf), of which nothing passes
  /// here.
  bool number(double& out) {
    const char* digits = at_ + (at_ != end_ && *at_ == '-');
    if (digits == end_ || !is_digit(*digits)) return false;
    const char* after = digits;
    while (after != end_ && is_digit(*after)) ++after;
    if ((*digits == '0' && after - digits > 1) ||
        (after != end_ && *after == '.' && (after + 1 == end_ || !is_digit(after[1]))))
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

}  // namespace

Node parse_json(const std::string& text, const std::string& path, int line) {
  JsonEvents events(text, path, line);
  const char* begin = text.data();
  nlohmann::json::sax_parse(Cursor{begin, &events.furthest},
                            Cursor{begin + text.size(), &events.furthest}, &events);
  return std::move(events.builder.root);
}

bool parse_plain_json(std::string_view text, int line, Node& node) {
  return PlainJson(text, line).whole(node = Node());
}

void for_each_json_line(const std::string& text, const std::string& path,
                        const std::function<std::string(const Field&)>& read,
                        const Progress& progress) {
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
    if (line % 256 == 0) progress.share(static_cast<double>(at), static_cast<double>(text.size()));
    const size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view one = std::string_view(text).substr(at, end - at);
    at = end + 1;
    if (one.find_first_not_of(" \t\r") == std::string_view::npos) continue;
    if (!read_plain(one, line)) {
      node = parse_json(std::string(one), path, line);
      id = read(top(node, path));
    }
    const auto [first, is_new] = lines.emplace(id, line);
    if (!is_new)
      top(node, path)["id"].fail("'" + id + "' is already in line " +
                                 std::to_string(first->second) +
                                 ": leave one of them out, or give it another id");
  }
}

bool is_utf8(const std::string& text) {
  const auto is_ascii = [](char c) { return static_cast<unsigned char>(c) < 0x80; };
  if (std::all_of(text.begin(), text.end(), is_ascii)) return true;
  try {
    nlohmann::json(text).dump();
    return true;
  } catch (const nlohmann::json::type_error&) {
    return false;
  }
}

std::string json_string(const std::string& text) { return quoted_text(text, Quoting::json); }

}  // namespace kincal
