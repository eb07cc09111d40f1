#include "rig_entry.h"

#include <algorithm>
#include <map>
#include <sstream>

#include "../document/error.h"
#include "../document/yaml.h"

namespace kincal {
namespace {

/// Whether two trees say the same; the order of keys says nothing.
bool same_meaning(const Node& a, const Node& b) {
  if (a.kind != b.kind || a.text != b.text || a.items.size() != b.items.size() ||
      a.members.size() != b.members.size())
    return false;
  for (size_t i = 0; i < a.items.size(); ++i)
    if (!same_meaning(a.items[i], b.items[i])) return false;
  return std::all_of(a.members.begin(), a.members.end(), [&](const auto& member) {
    const Node* other = b.find(member.first);
    return other && same_meaning(member.second, *other);
  });
}

/// The tree with the keys changed: what the text is to say.
Node with_keys(Node tree, const RigKeys& keys) {
  for (const auto& [key, value] : keys) {
    const auto at = std::find_if(tree.members.begin(), tree.members.end(),
                                 [&, &k = key](const auto& m) { return m.first == k; });
    if (value.empty()) {
      if (at != tree.members.end()) tree.members.erase(at);
      continue;
    }
    const Node node = parse_yaml(value, key);
    if (at != tree.members.end())
      at->second = node;
    else
      tree.members.emplace_back(key, node);
  }
  return tree;
}

/// Lines of a text that are replaced, taken away (""), or get others behind them.
struct LineChanges {
  std::map<size_t, std::string> replaced, behind;  // by number, from 1
};

std::string with_lines(const std::string& text, const LineChanges& changes) {
  std::istringstream in(text);
  std::string out, line;
  for (size_t number = 1; std::getline(in, line); ++number) {
    const auto other = changes.replaced.find(number);
    out += other == changes.replaced.end() ? line + "\n" : other->second;
    const auto more = changes.behind.find(number);
    if (more != changes.behind.end()) out += more->second;
  }
  return out;
}

std::string line_of(const std::string& text, int number) {
  std::istringstream in(text);
  std::string line;
  for (int i = 0; i < number; ++i) std::getline(in, line);
  return line;
}

/// Puts "key: value" in the place of a line that begins with the key; its comment stays.
std::string changed_line(const std::string& line, const std::string& key,
                         const std::string& value) {
  const size_t comment = line.find(" #");
  std::string out = line.substr(0, line.find_first_not_of(" \t")) + key + ": " + value;
  if (comment != std::string::npos) {  // in its column, where there is room
    out.resize(std::max(out.size() + 1, comment + 1), ' ');
    out += line.substr(comment + 1);
  }
  return out + "\n";
}

/// Changes of the lines of a mapping in block style, one key a line. New keys stand behind the
/// last one that is changed, else behind the first of all.
void change_block(const std::string& text, const Node& mapping, const RigKeys& keys,
                  LineChanges& changes) {
  if (mapping.members.empty()) return;
  size_t behind = mapping.members[0].second.line;
  std::string added;
  const std::string first = line_of(text, mapping.members[0].second.line);
  const std::string indent = first.substr(0, first.find_first_not_of(' '));
  for (const auto& [key, value] : keys) {
    const Node* node = mapping.find(key);
    if (!node) {
      if (!value.empty()) added += indent + key + ": " + value + "\n";
      continue;
    }
    const std::string line = line_of(text, node->line);
    changes.replaced[node->line] = value.empty() ? "" : changed_line(line, key, value);
    if (!value.empty()) behind = std::max(behind, static_cast<size_t>(node->line));
  }
  if (!added.empty()) changes.behind[behind] = added;
}

int last_line(const Node& node) {
  int last = node.line;
  for (const Node& item : node.items) last = std::max(last, last_line(item));
  for (const auto& member : node.members) last = std::max(last, last_line(member.second));
  return last;
}

/// The whole entry written anew in the place of its lines, the first and `more`: for one in flow
/// style, {...}.
void replace_lines(const std::string& text, const std::string& name, const Node& now, int line,
                   int more, LineChanges& changes) {
  const std::string old = line_of(text, line);
  const std::string indent = old.substr(0, old.find_first_not_of(' '));
  Node entry;
  entry.kind = Node::Kind::mapping;
  entry.members.emplace_back(name, now);
  std::istringstream in(to_yaml(entry));
  std::string out;
  for (std::string one; std::getline(in, one);) out += indent + one + "\n";
  for (int i = 1; i <= more; ++i) changes.replaced[line + i] = "";
  changes.replaced[line] = out;
}

bool says(const std::string& text, const Node& expected) {
  try {
    return same_meaning(parse_yaml(text, ""), expected);
  } catch (const InputError&) {
    return false;
  }
}

}  // namespace

std::string keys_text(const RigKeys& keys) {
  std::string out;
  for (const auto& [key, value] : keys)
    if (!value.empty()) out.append(key).append(": ").append(value).append("\n");
  return out;
}

EditedRig edited_rig(const RigFile& rig, const std::string& section, const std::string& name,
                     const RigKeys& keys, const std::string& robot) {
  RigKeys top_keys;
  const Node* old_robot = rig.node.find("robot");
  if (old_robot && old_robot->kind == Node::Kind::scalar && old_robot->text != robot)
    top_keys.emplace_back("robot", yaml_text(robot));
  Node expected = with_keys(rig.node, top_keys);
  const Node& entry = *rig.node.find(section)->find(name);
  const Node now = with_keys(entry, keys);
  for (auto& part : expected.members)
    for (auto& member : part.second.members)
      if (part.first == section && member.first == name) member.second = now;
  // Key by key; else the entry anew, whose last bracket may stand on a line of its own.
  const int more = last_line(entry) - entry.line;
  for (const int lines : {-1, more, more + 1}) {
    LineChanges changes;
    change_block(rig.text, rig.node, top_keys, changes);
    if (lines < 0)
      change_block(rig.text, entry, keys, changes);
    else
      replace_lines(rig.text, name, now, entry.line, lines, changes);
    const std::string text = with_lines(rig.text, changes);
    if (says(text, expected)) return {text, true};
  }
  return {to_yaml(expected), false};
}

}  // namespace kincal
