// The XML of a URDF with the bytes it came from: parsed strictly, attributes read with the line in
// every message. This header is internal to this folder.
#pragma once

#include <cstddef>
#include <memory>
#include <pugixml.hpp>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// Xml is the parsed XML with the bytes it came from. pugixml keeps the offset of every element's
/// name in them.
struct Xml {
  const std::string& text;
  const std::string& path;
  std::shared_ptr<pugi::xml_document> document = std::make_shared<pugi::xml_document>();
};

/// Parses any XML and returns its top element. The bytes are taken as they are (UTF-8 or anything
/// that contains ASCII): pugixml converts nothing.
/// @throws InputError
pugi::xml_node load_document(Xml& xml);

/// Returns the node after this one in the order of the text; null at the end. Without recursion:
/// depth is the file's choice.
pugi::xml_node next_node(pugi::xml_node node);

/// Parses a URDF and returns <robot>. @throws InputError
pugi::xml_node load(Xml& xml);

/// Returns "path:line" of a byte.
std::string at_offset(const Xml& xml, std::ptrdiff_t offset);

/// Returns "joint 'elbow': <origin>" for the origin of a joint: the child of <robot> that holds the
/// element, and the element.
std::string title(const pugi::xml_node& element);

/// Returns "path:line: title: ", the beginning of a message.
std::string where(const Xml& xml, const pugi::xml_node& element);
[[noreturn]] void fail(const Xml& xml, const pugi::xml_node& element, const std::string& what);

bool is_blank(char c);

/// Reads all of [begin, end) as one finite number; false: it is none.
bool to_number(const char* begin, const char* end, double& value);

/// Reads all numbers of an attribute that is there. Another count fails, and so does a number
/// that is not finite.
std::vector<double> numbers_of(const Xml& xml, const pugi::xml_node& element, const char* attribute,
                               size_t count);

/// Both read an attribute, as three numbers or one; `absent` stands for one that is not there. They
/// fail on anything else.
Vector3d vector3(const Xml& xml, const pugi::xml_node& element, const char* attribute,
                 const Vector3d& absent);
double number(const Xml& xml, const pugi::xml_node& element, const char* attribute, double absent);

/// Returns an attribute that must not be empty.
std::string name_in(const Xml& xml, const pugi::xml_node& element, const char* attribute);

/// Returns the child of this name; null if there is none. Two are an error.
pugi::xml_node only_child(const Xml& xml, const pugi::xml_node& element, const char* name);

/// Elements stand in the order of the text, which is that of the tree's links or joints.
using Elements = std::vector<pugi::xml_node>;
Elements children(const pugi::xml_node& robot, const char* name);

}  // namespace kincal
