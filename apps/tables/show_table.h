// What `kincal show` and `calibrate` print of a result: the essentials of its page, in 80 columns.
#pragma once

#include <string>

#include "../../io/document/document.h"

namespace kincal {

/// Returns the two lines of a verdict: whether to use the result and why, and what to do.
std::string verdict_lines(const Field& result);
/// Returns what stands behind these, under a heading of its own; "": nothing.
std::string verdict_details(const Field& result);
/// Returns verdict, findings, errors of each sensor, the largest changes and warnings; with `all`
/// also which robot it is, and what is badly known.
/// @throws InputError where `result` is no result.json.
std::string show_text(const Field& result, bool all);

}  // namespace kincal
