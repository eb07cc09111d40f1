// One text for the reader that the environment's KINCAL_READER names, and what readers need.
#pragma once

#include <map>
#include <string>

#include "../../io/rig/rig_file.h"

/// Returns whether it is read; not: it is refused as it should be. Anything else is a fault.
bool is_read(const std::string& text);

/// Writes a text to a file in a folder of this process, which has the corpus's robot and rig.
/// Returns its path.
std::string in_file(const std::string& name, const std::string& text);

const kincal::RigFile& usual_rig();  ///< of the corpus

using Readers = std::map<std::string, void (*)(const std::string&)>;
Readers bag_readers();  ///< of recordings (bags.cpp), where the libraries that they need are
