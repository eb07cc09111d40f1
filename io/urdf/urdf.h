// A URDF as read, strictly and with lines in the messages. Its text is kept; edit.h
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

/// An OriginText is the text of an origin: xyz and rpy in the file's digits ("0 0 0" if absent),
/// for changes.yaml.
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

/// Both read a URDF. @throws InputError "path:line: element: error, valid values".
Urdf read_urdf(const std::string& path);
Urdf parse_urdf(std::string text, const std::string& path);

/// Returns the type's name in a URDF.
const char* type_name(JointType type);

}  // namespace kincal
