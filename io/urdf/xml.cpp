#include "xml.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <system_error>

#include "../document/error.h"
#include "../document/json.h"

namespace kincal {
namespace {

constexpr int kMostLevels = 100;  // of nesting, as in YAML and JSON: urdfdom reads by recursion

std::string own_title(const pugi::xml_node& element) {
  const pugi::xml_attribute name = element.attribute("name");
  return name ? std::string(element.name()) + " '" + name.value() + "'"
              : std::string("<") + element.name() + ">";
}

/// Whether a name has no prefix, a built-in one, or one declared (xmlns:prefix) on the element or
/// above it.
bool is_bound(const pugi::xml_node& element, const char* name) {
  const char* const colon = std::strchr(name, ':');
  if (!colon) return true;
  const std::string prefix(name, colon);
  if (prefix == "xml" || prefix == "xmlns") return true;
  for (pugi::xml_node n = element; n; n = n.parent())
    if (n.attribute(("xmlns:" + prefix).c_str())) return true;
  return false;
}

/// What XML demands and pugixml does not look at: one top element, declared prefixes, no attribute
/// twice. And the depth, which XML leaves open.
void check_element(const Xml& xml, const pugi::xml_node& element) {
  int levels = 0;
  for (pugi::xml_node n = element.parent(); n; n = n.parent()) ++levels;
  if (levels > kMostLevels)
    throw InputError(at_offset(xml, element.offset_debug()) + ": nested more than " +
                     std::to_string(kMostLevels) + " levels deep");
  const auto check_prefix = [&](const char* written) {
    if (is_bound(element, written)) return;
    const std::string name = written;
    if (name.compare(0, 6, "xacro:") == 0)
      throw InputError(at_offset(xml, element.offset_debug()) + ": '" + name +
                       "' is not expanded: run xacro first");
    throw InputError(at_offset(xml, element.offset_debug()) +
                     ": not well-formed XML: unbound prefix in '" + name +
                     "'; declare xmlns:" + name.substr(0, name.find(':')) + " in <robot>");
  };
  check_prefix(element.name());
  for (const pugi::xml_attribute& attribute : element.attributes()) {
    check_prefix(attribute.name());
    for (pugi::xml_attribute other = attribute.next_attribute(); other;
         other = other.next_attribute())
      if (std::strcmp(attribute.name(), other.name()) == 0)
        throw InputError(where(xml, element) + "not well-formed XML: attribute '" + other.name() +
                         "' occurs twice");
  }
}

/// Is there an expression that xacro would have replaced?
bool is_xacro(const std::string& text) {
  return text.find("${") != std::string::npos || text.find("$(") != std::string::npos;
}

}  // namespace

// ---------------------------------------------------------------- places
std::string at_offset(const Xml& xml, std::ptrdiff_t offset) {
  const auto end = xml.text.begin() + std::clamp<std::ptrdiff_t>(
                                          offset, 0, static_cast<std::ptrdiff_t>(xml.text.size()));
  return xml.path + ":" + std::to_string(1 + std::count(xml.text.begin(), end, '\n'));
}

std::string title(const pugi::xml_node& element) {
  pugi::xml_node holder = element;
  while (holder.parent().parent().parent())
    holder = holder.parent();  // below <robot>, that below the document
  return (holder == element ? "" : own_title(holder) + ": ") + own_title(element);
}

std::string where(const Xml& xml, const pugi::xml_node& element) {
  return at_offset(xml, element.offset_debug()) + ": " + title(element) + ": ";
}

void fail(const Xml& xml, const pugi::xml_node& element, const std::string& what) {
  throw InputError(where(xml, element) + what);
}

pugi::xml_node next_node(pugi::xml_node node) {
  if (node.first_child()) return node.first_child();
  while (node && !node.next_sibling()) node = node.parent();
  return node.next_sibling();
}

pugi::xml_node load_document(Xml& xml) {
  const pugi::xml_parse_result result = xml.document->load_buffer(
      xml.text.data(), xml.text.size(), pugi::parse_default, pugi::encoding_utf8);
  if (!result)
    throw InputError(at_offset(xml, result.offset) +
                     ": not well-formed XML: " + result.description());
  const pugi::xml_node top = xml.document->document_element();
  for (pugi::xml_node n = xml.document->first_child(); n; n = next_node(n))
    if (n.type() == pugi::node_element) {
      if (n.parent() == *xml.document && n != top)
        throw InputError(at_offset(xml, n.offset_debug()) + ": not well-formed XML: <" + n.name() +
                         "> after the end of <" + top.name() +
                         ">; a file has one element at the top");
      check_element(xml, n);
    }
  return top;
}

pugi::xml_node load(Xml& xml) {
  const pugi::xml_node robot = load_document(xml);
  if (std::strcmp(robot.name(), "robot") != 0)
    throw InputError(at_offset(xml, robot.offset_debug()) + ": <" + robot.name() +
                     "> is not a URDF; the top element must be <robot>");
  return robot;
}

// ---------------------------------------------------------------- attributes and children
bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

bool to_number(const char* begin, const char* end, double& value) {
  if (end - begin > 1 && *begin == '+' && begin[1] != '-') ++begin;
  const auto result = std::from_chars(begin, end, value);
  return result.ec == std::errc() && result.ptr == end && std::isfinite(value);
}

std::vector<double> numbers_of(const Xml& xml, const pugi::xml_node& element, const char* attribute,
                               size_t count) {
  const std::string text = element.attribute(attribute).value();
  std::vector<double> values;
  const char *at = text.data(), *const end = at + text.size();
  for (;;) {
    while (at != end && is_blank(*at)) ++at;
    if (at == end) break;
    const char* const begin = at;
    while (at != end && !is_blank(*at)) ++at;
    values.push_back(0);
    if (!to_number(begin, at, values.back()))
      fail(xml, element,
           std::string(attribute) + "=\"" + text + "\": '" + std::string(begin, at) +
               "' is not a finite number" +
               (is_xacro(text) ? "; run xacro first: it is not expanded" : ""));
  }
  if (values.size() != count)
    fail(xml, element,
         std::string(attribute) + "=\"" + text + "\" has " + std::to_string(values.size()) +
             " numbers, " + std::to_string(count) + (count == 1 ? " is" : " are") + " needed");
  return values;
}

Vector3d vector3(const Xml& xml, const pugi::xml_node& element, const char* attribute,
                 const Vector3d& absent) {
  if (!element.attribute(attribute)) return absent;
  return Vector3d(numbers_of(xml, element, attribute, 3).data());
}

double number(const Xml& xml, const pugi::xml_node& element, const char* attribute, double absent) {
  return element.attribute(attribute) ? numbers_of(xml, element, attribute, 1)[0] : absent;
}

std::string name_in(const Xml& xml, const pugi::xml_node& element, const char* attribute) {
  const std::string name = element.attribute(attribute).value();
  if (name.empty())
    fail(xml, element, std::string("the attribute '") + attribute + "' is missing or empty");
  if (is_xacro(name))
    fail(xml, element,
         std::string("the attribute '") + attribute + "' is not expanded: '" + name +
             "'; run xacro first");
  if (!is_utf8(name))
    fail(xml, element,
         std::string("the attribute '") + attribute + "' is not UTF-8: '" + name +
             "'; convert the file, as by iconv -f latin1 -t utf-8");
  return name;
}

pugi::xml_node only_child(const Xml& xml, const pugi::xml_node& element, const char* name) {
  const pugi::xml_node child = element.child(name), second = child.next_sibling(name);
  if (second) fail(xml, second, "occurs twice; one is allowed");
  return child;
}

Elements children(const pugi::xml_node& robot, const char* name) {
  Elements elements;
  for (const pugi::xml_node& child : robot.children(name)) elements.push_back(child);
  return elements;
}

}  // namespace kincal
