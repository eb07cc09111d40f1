// The mechanical reductions of a URDF's transmissions.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace pugi {
class xml_node;
}

namespace kincal {

/// A Transmission is a <transmission>'s mechanical reduction for a joint: only where one number can
/// be meant (not with several joints or several numbers in a transmission, nor with unexpanded
/// ${...}).
struct Transmission {
  std::string name, joint;
  double reduction = 1;
};

/// A WrittenTransmission is one with the bytes [begin, end) of its number.
struct WrittenTransmission {
  Transmission transmission;
  size_t begin, end;
};

/// Finds the mechanical reductions that belong to one joint beyond doubt: a single number in the
/// transmission can mean it. A number outside <joint> counts only if the transmission has no second
/// joint.
std::vector<WrittenTransmission> find_reductions(const std::string& text,
                                                 const pugi::xml_node& robot);

}  // namespace kincal
