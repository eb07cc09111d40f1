// A URDF as read. Its text is the truth: it is read strictly, with lines in the messages; edit.h
// writes changes into it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "../../kinematics/tree.h"
#include "reductions.h"

namespace pugi {
class xml_document;
}

namespace kincal {

/// An OriginText is an origin as it stands in the file: xyz and rpy in the file's own digits ("0 0
/// 0" where absent), for changes.yaml.
struct OriginText {
  std::string xyz, rpy;
};

/// A Urdf is a URDF as read.
struct Urdf {
  std::string path;                                    // where it came from, for messages
  std::string text;                                    // the file, byte for byte
  std::shared_ptr<const pugi::xml_document> document;  // parsed
  std::string robot;                                   // its name
  Tree tree;
  std::vector<OriginText> origins;  // by joint
  std::vector<LinkMass> masses;     // by link
  std::vector<Transmission> transmissions;
  std::vector<std::string> warnings;  // e.g. an undefined root link that was accepted
};

/// Both read a URDF. @throws InputError "path:line: element: what is wrong, what is valid".
Urdf read_urdf(const std::string& path);
Urdf parse_urdf(std::string text, const std::string& path);

/// Returns the type's name in a URDF.
const char* type_name(JointType type);

}  // namespace kincal
