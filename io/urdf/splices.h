// Attributes of an XML text replaced in place: all other bytes stay. This header is internal to
// this folder.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "xml.h"

namespace kincal {

/// A Splice replaces the bytes [begin, end) of the text.
struct Splice {
  size_t begin, end;
  std::string text;
};

/// Returns the text with all of them; they do not overlap.
std::string spliced(const std::string& text, std::vector<Splice> splices);

/// Places of an attribute in the text: of its name, and of its value without the quotes.
struct AttributePlace {
  size_t name, begin, end;
};

/// Byte places in a start tag.
struct Tag {
  size_t name_end;  // just behind the element's name
  size_t end;       // just behind '>'
  std::map<std::string, AttributePlace> attributes;
};

/// Scans an element's start tag, which pugixml has found well-formed; pugixml does not give the
/// places of attributes.
Tag scan_tag(const std::string& text, const pugi::xml_node& element);

/// Sets attributes of an element, (name, value): the value is replaced, or the attribute added
/// behind the element's name.
void set_attributes(const std::string& text, const pugi::xml_node& element,
                    const std::vector<std::pair<std::string, std::string>>& attributes,
                    std::vector<Splice>& splices);

}  // namespace kincal
