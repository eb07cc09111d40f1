// One text for the reader that the environment's KINCAL_READER names.
#pragma once

#include <string>

/// Returns whether it is read; not: it is refused as it should be. Anything else is a fault.
bool is_read(const std::string& text);
