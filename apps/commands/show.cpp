// `kincal show`: the essentials of a result on a terminal.
#include <filesystem>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/document/json.h"
#include "../job.h"
#include "../tables/show_table.h"
#include "command.h"

namespace kincal {
namespace {

int show(const std::string& given) {
  std::error_code ignored;
  const bool folder = std::filesystem::is_directory(given, ignored);
  const std::string path = folder ? given + "/result.json" : given;
  if (folder && !file_exists(path) && file_exists(given + "/summary.json"))
    throw InputError(
        given +
        " is the folder of a batch: summary.csv and report.html have all its sets, `kincal show " +
        given + "/SET` shows one");
  if (folder && !file_exists(path))
    throw InputError(given + " has no result.json: give the folder that `calibrate --out` wrote");
  const Node node = parse_json(read_file(path), path);
  std::cout << show_text(top(node, path), true);
  if (folder && file_exists(given + "/report.html"))
    std::cout << "\nMore: " << given << "/report.html (a browser), result.json\n";
  return kConverged;
}

}  // namespace

Command show_command(CLI::App& app) {
  auto result = std::make_shared<std::string>();
  CLI::App* command =
      app.add_subcommand("show", "Print the summary of a result: verdict, errors, changes");
  command->add_option("RESULT", *result, "result directory, or its result.json")->required();
  command->footer("Exit codes: 0 printed; 1 bad input or usage.");
  return {command, [result] { return show(*result); }};
}

}  // namespace kincal
