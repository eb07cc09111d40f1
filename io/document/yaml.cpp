#include "yaml.h"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <map>
#include <set>
#include <sstream>
#include <string_view>

#include "builder.h"
#include "numbers.h"
#include "quoting.h"

namespace kincal {
namespace {

constexpr size_t kMaxAliasNodes =
    100'000;  // that all YAML anchors and aliases of a file together may hold
constexpr size_t kYamlWidth = 110;
constexpr size_t kLongestKey = 250;  // bytes; written with escapes it is still below YAML's 1024

// ------------------------------------------------------------------------------------------------
// reading
size_t count_nodes(const Node& node) {
  size_t n = 1;
  for (const Node& item : node.items) n += count_nodes(item);
  for (const auto& member : node.members) n += count_nodes(member.second);
  return n;
}

/// yaml-cpp's events instead of its nodes: they distinguish quoted from plain scalars, show every
/// key, and leave aliases to us.
class YamlEvents : public YAML::EventHandler {
 public:
  explicit YamlEvents(const std::string& path) : builder(path), path_(path) {}

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    value(make(Node::Kind::null, mark), anchor);
  }

  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                const std::string& text) override {
    refuse_tag(mark, tag);
    if (builder.wants_key()) {
      if (anchor) fail(mark, "an anchor on a key is not supported");
      if (text.size() > kLongestKey)
        fail(mark, "a key of " + std::to_string(text.size()) + " bytes; at most " +
                       std::to_string(kLongestKey) + " are expected");
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

  void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    open(Node::Kind::sequence, mark, tag, anchor);
  }
  void OnSequenceEnd() override { close(); }
  void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    open(Node::Kind::mapping, mark, tag, anchor);
  }
  void OnMapEnd() override { close(); }

  Builder builder;

 private:
  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& what) const {
    throw InputError(place(path_, mark.line + 1, mark.column + 1) + what);
  }
  /// Tags beyond those that a plain file has by itself ("?": plain, "!": quoted, "": neither) would
  /// change what is meant.
  void refuse_tag(const YAML::Mark& mark, const std::string& tag) const {
    if (!tag.empty() && tag != "?" && tag != "!")
      fail(mark, "the tag '" + tag + "' is not supported");
  }
  static Node make(Node::Kind kind, const YAML::Mark& mark) {
    Node node;
    node.kind = kind;
    node.line = mark.line + 1;
    node.column = mark.column + 1;
    return node;
  }
  void value(Node&& node, YAML::anchor_t anchor) { keep(builder.add(std::move(node)), anchor); }
  void open(Node::Kind kind, const YAML::Mark& mark, const std::string& tag,
            YAML::anchor_t anchor) {
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
      throw InputError(place(path_, copied.line, copied.column) +
                       "anchors and aliases hold more than " + std::to_string(kMaxAliasNodes) +
                       " values");
  }

  const std::string& path_;
  std::vector<YAML::anchor_t> open_anchors_;
  std::map<YAML::anchor_t, Node> anchors_;
  size_t alias_nodes_ = 0;
};

// ------------------------------------------------------------------------------------------------
// writing
/// May the text stand without quotes and mean itself? Stricter than YAML.
bool plain_ok(const std::string& text, bool in_flow) {
  static const std::set<std::string> nulls = {"", "~", "null", "Null", "NULL"};
  if (nulls.count(text) || text.front() == ' ' || text.back() == ' ' || text.back() == ':')
    return false;
  if (std::string_view("?:,[]{}#&*!|>'\"%@`=<").find(text[0]) != std::string_view::npos)
    return false;
  if (text[0] == '-' &&
      (text.size() == 1 || !(std::isalnum(static_cast<unsigned char>(text[1])) || text[1] == '.')))
    return false;
  if (text.compare(0, 3, "...") == 0 || text.find(": ") != std::string::npos ||
      text.find(" #") != std::string::npos)
    return false;
  if (in_flow && text.find_first_of(",[]{}:?") != std::string::npos) return false;
  for (size_t i = 0; i < text.size(); ++i)
    if (unprintable(text, i).bytes > 0) return false;
  return true;
}

/// May readers of YAML 1.1 or 1.2 take the plain text for a number, a date, a truth value or
/// nothing? Stricter than either.
bool taken_for_other(const std::string& text) {
  static const std::set<std::string> words = {"y",     "n",     "yes",   "no",   "on",
                                              "off",   "true",  "false", "null", ".inf",
                                              "+.inf", "-.inf", ".nan"};
  std::string lower;
  for (const char c : text) lower += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  const size_t first = text.find_first_not_of("+-.");
  return words.count(lower) > 0 ||
         (first != std::string::npos && std::isdigit(static_cast<unsigned char>(text[first])));
}

std::string scalar_text(const Node& node, bool in_flow) {
  if (node.kind == Node::Kind::null) return "null";
  return node.quoted || !plain_ok(node.text, in_flow) ? quoted_text(node.text, Quoting::yaml)
                                                      : node.text;
}
std::string key_text(const std::string& key, bool in_flow) {
  return scalar_text(text_node(key), in_flow);
}

bool is_scalar(const Node& node) {
  return node.kind == Node::Kind::scalar || node.kind == Node::Kind::null;
}

/// Sequences of scalars, and small mappings of such or of scalars, go into one line: "" if `node`
/// does not.
std::string flow_text(const Node& node, bool small_mapping) {
  if (is_scalar(node)) {
    const bool keeps_kind =
        node.kind == Node::Kind::null || node.quoted || plain_ok(node.text, true);
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
  return node.items.size() <= 12 &&
         std::all_of(node.items.begin(), node.items.end(), [&](const Node& item) {
           return item.kind == Node::Kind::scalar && !item.quoted && read_number(item.text, value);
         });
}

void write_block(const Node& node, size_t indent, bool first_line_indented, std::string& out);

/// What follows "key:" or "-": a scalar or flow text in the same line, else a block.
void write_value(const Node& value, size_t indent, size_t used, bool in_sequence,
                 std::string& out) {
  const bool one_line = is_scalar(value) || (value.members.empty() && is_vector(value));
  const std::string line =
      is_scalar(value) ? scalar_text(value, false) : flow_text(value, !in_sequence);
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

/// Of a line that the parser did not understand: a tab there is mostly why.
bool indented_by_tab(const std::string& text, int line) {
  size_t begin = 0;
  for (; line > 0 && begin < text.size(); --line)
    begin = std::min(text.find('\n', begin), text.size() - 1) + 1;
  const size_t end = std::min(text.find_first_not_of(" \t", begin), text.size());
  return begin < end && text.find('\t', begin) < end;
}

}  // namespace

Node parse_yaml(const std::string& text, const std::string& path) {
  // yaml-cpp 0.7 takes a quote that is never closed if the file ends in a line break; an end marker
  // makes it an error.
  std::istringstream stream(text + (text.empty() || text.back() == '\n' ? "...\n" : "\n...\n"));
  YamlEvents events(path);
  try {
    YAML::Parser parser(stream);
    if (!parser.HandleNextDocument(events)) return Node{};
    YamlEvents rest(path);
    if (parser.HandleNextDocument(rest))
      throw InputError(place(path, rest.builder.root.line, rest.builder.root.column) +
                       "a second document; one is expected");
  } catch (const YAML::Exception& e) {
    if (indented_by_tab(text, e.mark.line))
      throw InputError(place(path, e.mark.line + 1, 1) +
                       "a tab indents this line; YAML takes blanks only");
    const bool open_quote = e.msg.find("document indicator in scalar") != std::string::npos;
    throw InputError(place(path, e.mark.line + 1, e.mark.column + 1) +
                     (open_quote ? "a quoted text is not closed" : e.msg));
  }
  return std::move(events.builder.root);
}

std::string to_yaml(const Node& node) {
  if (is_scalar(node)) return scalar_text(node, false) + "\n";
  if (node.items.empty() && node.members.empty())
    return node.kind == Node::Kind::sequence ? "[]\n" : "{}\n";
  std::string out;
  write_block(node, 0, false, out);
  return out;
}

Node text_node(const std::string& text) {
  Node node = scalar_node(text);
  node.quoted = taken_for_other(text);
  return node;
}

std::string yaml_text(const std::string& text) { return scalar_text(text_node(text), true); }

}  // namespace kincal
