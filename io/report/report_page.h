// report.html: one page that shows a result, made only from the files of its folder. The page
// (page/: TypeScript, built once into page/built/report.html) draws; this code collects its data
// and inserts them. page/src/data.ts defines the data.
#pragma once

#include <string>
#include <vector>

namespace kincal {

/// ResultTexts are the result files that the page shows. An empty text: the file is absent.
struct ResultTexts {
  std::string result_json, samples_csv, residuals_csv, loops_csv, covariance_csv;
};
/// Reads these files. @throws InputError: result.json is absent, or a file cannot be read.
ResultTexts read_result_texts(const std::string& directory);

/// Returns the page of a result. @throws InputError: a file does not have kincal's format.
std::string report_page(const ResultTexts& texts);

/// An OverviewEntry is one of several results shown side by side.
struct OverviewEntry {
  std::string folder, result_json;  // the name that it is shown with; the text
  std::string link;  // of its own page, relative to the overview's; empty: there is none
};
/// Returns the page's data for a calibration that failed with `error` and therefore has no
/// result.json.
std::string failed_result(const std::string& error);
/// Returns the page of several results. @throws InputError
std::string overview_page(const std::vector<OverviewEntry>& entries);

}  // namespace kincal
