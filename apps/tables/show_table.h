// What `kincal show` and `calibrate` print of a result: the essentials of its page, in 80 columns.
#pragma once

#include <string>

#include "../../io/document/document.h"

namespace kincal {

/// Returns verdict, findings, errors of each sensor, the largest changes and warnings; with `all`
/// also which robot it is, and what is badly known.
/// @throws InputError where `result` is no result.json.
std::string show_text(const Field& result, bool all);

}  // namespace kincal
