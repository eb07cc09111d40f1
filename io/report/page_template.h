// The page as it is built from page/ (cmake/page_template.cmake makes a source of it).
#pragma once

namespace kincal {

/// Returns the text of page/built/report.html, whose data is still missing.
const char* page_template();

}  // namespace kincal
