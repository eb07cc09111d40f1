# Makes a source of the report's page, io/report/page/built/report.html: a function that returns its text.
# It stands in git as it is built, so that nobody who builds kincal needs what builds the page.
set(page ${PROJECT_SOURCE_DIR}/io/report/page/built/report.html)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${page})
file(READ ${page} page_text)
set(page_source "#include \"${PROJECT_SOURCE_DIR}/io/report/page_template.h\"
namespace kincal {
const char* page_template() { return R\"kincal_page(${page_text})kincal_page\"; }
}  // namespace kincal
")
set(KINCAL_PAGE_SOURCE ${PROJECT_BINARY_DIR}/page_template.cpp)
set(page_old "")
if(EXISTS ${KINCAL_PAGE_SOURCE})
  file(READ ${KINCAL_PAGE_SOURCE} page_old)
endif()
if(NOT page_old STREQUAL page_source)
  file(WRITE ${KINCAL_PAGE_SOURCE} "${page_source}")
endif()
