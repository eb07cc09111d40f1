// How messages name the options of a calibration: a program has switches (--no-group), other ways
// in (Python, C) have keywords (no_group).
#pragma once

#include <string>

#include "../../models/notices/notice.h"
#include "../../models/rig/selection.h"
#include "../document/error.h"

namespace kincal {

enum class Words { switches, keywords };

/// Returns what an option is called: "no_group" is "--no-group" or "no_group".
std::string option_name(const std::string& keyword, Words words);

/// Returns a message of the library in these terms: places in its options ("free[0]", "last_step")
/// and options that a text names ("`fix`").
std::string in_words(std::string message, Words words);
/// The same of all texts of a notice.
void in_words(Notice& notice, Words words);

/// A Place is where something is wrong, as the beginning of a message has it.
struct Place {
  std::string file;
  int line = 0;      // from 1; 0: not known
  std::string name;  // of the field ("views[0].pixels") or option ("free")
};
/// Reads it from the messages of readers ("rig.yaml:12: sensors.camera.sigma: ...", "rig.yaml:
/// ...") and of checks ("free[0]: ...", "require 'a<1': ...", "samples[2].joints.a: ...").
Place place_of(const std::string& message);

/// Returns the error for the user: the unknown parameter name with the nearest ones that exist.
InputError with_nearest(const NameError& error, Words words);

}  // namespace kincal
