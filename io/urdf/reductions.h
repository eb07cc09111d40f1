// The mechanical reductions of a URDF's transmissions.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace pugi {
class xml_node;
}

namespace kincal {

/// A Transmission is the mechanical reduction of one joint in a <transmission>. Ambiguous ones
/// (several joints or several numbers in a transmission, unexpanded ${...}) are not listed.
struct Transmission {
  std::string name, joint;
  double reduction = 1;
};

/// A WrittenTransmission also has the byte range [begin, end) of its number.
struct WrittenTransmission {
  Transmission transmission;
  size_t begin, end;
};

/// Finds the mechanical reductions that belong to exactly one joint, each a single number in its
/// transmission. A number outside <joint> counts only if the transmission has no second joint.
std::vector<WrittenTransmission> find_reductions(const std::string& text,
                                                 const pugi::xml_node& robot);

}  // namespace kincal
