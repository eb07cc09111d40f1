// What `kincal show` prints of a result: the essentials of its page, in 80 columns.
#pragma once

#include <string>

#include "../../io/document/document.h"

namespace kincal {

/// Returns verdict, errors of each sensor, the largest changes, what is badly known, and warnings.
/// @throws InputError where `result` is no result.json.
std::string show_text(const Field& result);

}  // namespace kincal
