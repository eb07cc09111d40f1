// What a verification found, in words and as JSON. It is not for users of the library: it brings
// the JSON library along and is not installed.
#pragma once

#include <string>

#include "../results/json_values.h"
#include "verify.h"

namespace kincal {

/// Returns the content of certificate.json.
Json certificate_json(const VerifiedResult& result, const SampleSet& samples,
                      const Verification& found, const VerifySettings& settings);
/// Returns the answer in one sentence.
std::string answer_text(const Verification& found);
std::string verification_text(const Verification& found);

}  // namespace kincal
