// `kincal report`: the page of a result made again, and that of several results.
#include <filesystem>
#include <iostream>

#include "../../io/document/error.h"
#include "../../io/document/files.h"
#include "../../io/report/report_page.h"
#include "../job.h"
#include "../signals.h"
#include "command.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

struct ReportArguments {
  std::vector<std::string> results;
  std::string out;
  bool force = false;
};

/// The entry of a result in an overview that is written to `out`: links are relative to it.
OverviewEntry entry_of(const std::string& result, const std::string& out) {
  OverviewEntry entry{fs::path(result).lexically_normal().string(),
                      read_file(result + "/result.json"), ""};
  const std::string page = result + "/report.html";
  if (file_exists(page))
    entry.link = fs::proximate(page, fs::absolute(out).parent_path()).generic_string();
  return entry;
}

int write_report(const ReportArguments& a) {
  const bool one = a.results.size() == 1;
  if (!one && a.out.empty())
    throw InputError("report: several results need --out FILE, e.g. --out fleet.html");
  const std::string out = a.out.empty() ? a.results[0] + "/report.html" : a.out;
  const bool own = a.out.empty();  // it is kincal's own file in a result's folder
  std::string page;
  if (one) {
    page = report_page(read_result_texts(a.results[0]));
  } else {
    std::vector<OverviewEntry> entries;
    for (const std::string& result : a.results) entries.push_back(entry_of(result, out));
    page = overview_page(entries);
  }
  say_cleared(clear_leftovers(out));
  check_output_file(out, a.force || own);
  begin_writing();
  write_file(out, page, a.force || own);
  std::cout << "Written to " << out << "\n";
  return kConverged;
}

}  // namespace

Command report_command(CLI::App& app) {
  auto a = std::make_shared<ReportArguments>();
  CLI::App* command = app.add_subcommand(
      "report",
      "Write the report page of a result again, or one page that compares several results");
  command->add_option("RESULT", a->results, "result directories, as calibrate and batch write them")
      ->required()
      ->type_name("DIR");
  command->add_option("--out", a->out,
                      "file to write; default for one result: report.html in its folder");
  command->add_flag("--force", a->force, "replace an existing file");
  command->footer(
      "The page needs only a browser: no network, no server. For several results (a fleet, or one "
      "robot over months) it lists\n"
      "verdicts and errors, the worst first, with a link to the page of each.\n"
      "Exit codes: 0 written; 1 bad input or usage, nothing written.");
  return {command, [a] { return write_report(*a); }};
}

}  // namespace kincal
