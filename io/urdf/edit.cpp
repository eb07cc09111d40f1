#include "edit.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <utility>
#include <vector>

#include "../document/numbers.h"
#include "xml.h"

namespace kincal {
namespace {

/// Bytes [begin, end) of the input to be replaced.
struct Splice {
  size_t begin, end;
  std::string text;
};

std::string apply(const std::string& text, std::vector<Splice> splices) {
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

/// Byte places in a start tag.
struct Tag {
  size_t name_end;                                          // just behind the element's name
  size_t end;                                               // just behind '>'
  std::map<std::string, std::pair<size_t, size_t>> values;  // by attribute, without the quotes
};

/// Scans an element's start tag, which pugixml has found well-formed; pugixml does not give the
/// places of attributes.
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
    tag.values[attribute] = {i + 1, close};
    i = close + 1;
  }
  tag.end = i + 1;
  return tag;
}

void edit_origin(const std::string& text, const pugi::xml_node& joint, const Pose& from,
                 const Pose& to, std::vector<Splice>& splices) {
  const bool moved = to.translation != from.translation, turned = to.rotation != from.rotation;
  if (!moved && !turned) return;
  if (!to.translation.allFinite() || !to.rotation.allFinite())
    throw std::invalid_argument(title(joint) + ": the new origin is not finite");
  const std::string xyz = shortest(to.translation), rpy = shortest(rpy_from_rotation(to.rotation));
  const pugi::xml_node origin = joint.child("origin");
  if (!origin) {
    const size_t place = scan_tag(text, joint).end;
    splices.push_back({place, place, "<origin xyz=\"" + xyz + "\" rpy=\"" + rpy + "\"/>"});
    return;
  }
  const Tag tag = scan_tag(text, origin);
  std::string added;
  const auto set = [&](const char* attribute, const std::string& value) {
    const auto it = tag.values.find(attribute);
    if (it != tag.values.end())
      splices.push_back({it->second.first, it->second.second, value});
    else
      added += std::string(" ") + attribute + "=\"" + value + "\"";
  };
  if (moved) set("xyz", xyz);
  if (turned) set("rpy", rpy);
  if (!added.empty()) splices.push_back({tag.name_end, tag.name_end, added});
}

}  // namespace

std::string edit_urdf(const Urdf& urdf, const UrdfChanges& changes) {
  const pugi::xml_node robot = urdf.document->document_element();
  const Elements joints = children(robot, "joint");
  std::vector<Splice> splices;
  for (const auto& [joint, origin] : changes.origins)
    edit_origin(urdf.text, joints.at(joint), urdf.tree.joints.at(joint).parent_T_joint, origin,
                splices);
  const std::vector<WrittenTransmission> reductions = find_reductions(urdf.text, robot);
  for (const auto& [joint, value] : changes.reductions) {
    if (!std::isfinite(value))
      throw std::invalid_argument("joint '" + joint +
                                  "': the new mechanicalReduction is not finite");
    bool found = false;
    for (const WrittenTransmission& r : reductions)
      if (r.transmission.joint == joint) {
        found = true;
        if (r.transmission.reduction != value) splices.push_back({r.begin, r.end, shortest(value)});
      }
    if (!found)
      throw std::invalid_argument(urdf.path + ": joint '" + joint +
                                  "' has no <transmission> with one mechanicalReduction");
  }
  return apply(urdf.text, std::move(splices));
}

}  // namespace kincal
