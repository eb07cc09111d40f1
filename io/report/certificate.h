// certificate.html: a verification as a page of its own that is handed on and printed (two sheets).
#pragma once

#include <string>

namespace kincal {

/// Returns the page of a certificate.json, as a text: no scripts, nothing that is loaded.
/// @throws InputError: it is no certificate
std::string certificate_page(const std::string& certificate_json);

}  // namespace kincal
