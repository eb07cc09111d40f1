#include "reductions.h"

#include "xml.h"

namespace kincal {
namespace {

/// A number between tags, e.g. of <mechanicalReduction>, and its bytes.
struct NumberText {
  double value;
  size_t begin, end;
};

/// Adds the element's number, if its text is one, straight from the file's bytes.
void add_number(const std::string& text, const pugi::xml_node& element,
                std::vector<NumberText>& found) {
  const std::ptrdiff_t offset = element.first_child().offset_debug();
  if (offset < 0) return;
  size_t begin = static_cast<size_t>(offset), end = text.find('<', begin);
  if (end == std::string::npos) return;
  while (begin < end && is_blank(text[begin])) ++begin;
  while (begin < end && is_blank(text[end - 1])) --end;
  double value;
  if (to_number(text.data() + begin, text.data() + end, value))
    found.push_back({value, begin, end});
}

}  // namespace

std::vector<WrittenTransmission> find_reductions(const std::string& text,
                                                 const pugi::xml_node& robot) {
  const char* const kName = "mechanicalReduction";
  std::vector<WrittenTransmission> reductions;
  for (const pugi::xml_node& transmission : robot.children("transmission")) {
    std::vector<NumberText> shared;
    for (const pugi::xml_node& e : transmission.children(kName)) add_number(text, e, shared);
    for (const pugi::xml_node& actuator : transmission.children("actuator"))
      for (const pugi::xml_node& e : actuator.children(kName)) add_number(text, e, shared);
    const bool single = !transmission.child("joint").next_sibling("joint");
    for (const pugi::xml_node& joint : transmission.children("joint")) {
      std::vector<NumberText> found;
      if (single) found = shared;
      for (const pugi::xml_node& e : joint.children(kName)) add_number(text, e, found);
      const std::string name = joint.attribute("name").value();
      if (found.size() == 1 && !name.empty())
        reductions.push_back({{transmission.attribute("name").value(), name, found[0].value},
                              found[0].begin,
                              found[0].end});
    }
  }
  return reductions;
}

}  // namespace kincal
