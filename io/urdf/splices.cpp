#include "splices.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace kincal {

std::string spliced(const std::string& text, std::vector<Splice> splices) {
  std::sort(splices.begin(), splices.end(),
            [](const Splice& a, const Splice& b) { return a.begin < b.begin; });
  std::string result;
  size_t at = 0;
  for (const Splice& splice : splices) {
    result.append(text, at, splice.begin - at).append(splice.text);
    at = splice.end;
  }
  return result.append(text, at, std::string::npos);
}

Tag scan_tag(const std::string& text, const pugi::xml_node& element) {
  const auto broken = [&]() -> Tag {
    throw std::logic_error(title(element) + ": start tag not found again");
  };
  const auto skip_blanks = [&](size_t& i) {
    while (i < text.size() && is_blank(text[i])) ++i;
  };
  Tag tag;
  size_t i = tag.name_end =
      static_cast<size_t>(element.offset_debug()) + std::strlen(element.name());
  for (;;) {
    skip_blanks(i);
    if (i < text.size() && text[i] == '/') ++i;
    if (i >= text.size()) return broken();
    if (text[i] == '>') break;
    const size_t name = i;
    while (i < text.size() && text[i] != '=' && !is_blank(text[i])) ++i;
    const std::string attribute = text.substr(name, i - name);
    skip_blanks(i);
    if (i >= text.size() || text[i] != '=') return broken();
    skip_blanks(++i);
    if (i >= text.size() || (text[i] != '"' && text[i] != '\'')) return broken();
    const size_t close = text.find(text[i], i + 1);
    if (close == std::string::npos) return broken();
    tag.attributes[attribute] = {name, i + 1, close};
    i = close + 1;
  }
  tag.end = i + 1;
  return tag;
}

void set_attributes(const std::string& text, const pugi::xml_node& element,
                    const std::vector<std::pair<std::string, std::string>>& attributes,
                    std::vector<Splice>& splices) {
  const Tag tag = scan_tag(text, element);
  std::string added;
  for (const auto& [name, value] : attributes) {
    const auto it = tag.attributes.find(name);
    if (it != tag.attributes.end())
      splices.push_back({it->second.begin, it->second.end, value});
    else
      added += " " + name + "=\"" + value + "\"";
  }
  if (!added.empty()) splices.push_back({tag.name_end, tag.name_end, added});
}

}  // namespace kincal
