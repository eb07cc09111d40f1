// The options of a calibration by name, as other languages give them: one table for all of them.
#pragma once

#include <string>
#include <variant>
#include <vector>

#include "job.h"

namespace kincal {

/// A Setting is an option, what its value has to be, and where it stands.
struct Setting {
  const char* name;
  const char* expected;  // "a list of names"
  std::variant<std::string CalibrateSettings::*, std::vector<std::string> CalibrateSettings::*,
               int CalibrateSettings::*, bool CalibrateSettings::*>
      field;
};

/// Returns the option of a name; `names` are those that are allowed, empty: all. @throws
/// InputError: there is no such option
const Setting& find_setting(const std::string& name, const std::vector<std::string>& names = {});

/// Reads settings from a JSON mapping, {"noise": "point", "free": ["joint/*"]}, and checks them; a
/// list may be one text. `names` are those that are allowed, empty: all. Messages name options by
/// keyword. @throws InputError
CalibrateSettings parse_settings(const std::string& json,
                                 const std::vector<std::string>& names = {});

}  // namespace kincal
