// What commands have in common: a job (io/job) with files, a line of progress and exit codes.
#pragma once

#include <exception>
#include <functional>
#include <string>
#include <vector>

#include "../io/job/job.h"
#include "progress_line.h"
#include "signals.h"

namespace CLI {
class App;
}

namespace kincal {

/// Says what the program is at, "reading rig.yaml": for the message where the memory ends.
void now(const std::string& what);
/// Returns the words of an error; where the memory ended, those of what the program was at.
std::string error_text(const std::exception& error);

/// Returns the exit code of the status; kToleranceNotMet where that is good but a --require is not
/// met.
ExitCode exit_code(const Report& report);

/// Says what was cleared away of runs that were killed (clear_leftovers).
void say_cleared(const std::vector<std::string>& notes);

/// Returns the path of a rig; a folder with a rig.yaml (a result) stands for that file.
std::string rig_path(const std::string& path);

/// Reads samples, and shows how far that is.
std::vector<Sample> parse_samples(const std::string& text, const std::string& path, const Rig& rig,
                                  ProgressLine& line);
SampleSet read_sample_set(const std::string& path, const Rig& rig, ProgressLine& line);

/// Reads and checks a rig and its samples. @throws InputError
Job read_job(const std::string& rig, const std::string& samples, const CalibrateSettings& settings,
             ProgressLine& line);

/// Runs the study of a job, and shows how far that is. @throws InputError, std::exception
Report run(Job& job, const CalibrateSettings& settings, bool diagnose, ProgressLine& line);

/// Makes the files of a result, its page among them unless that is not wanted.
ResultFiles make_files(const Job& job, const Report& report, const CalibrateSettings& settings);

/// PageSettings say where a command that writes no folder puts its page; no file: nowhere.
struct PageSettings {
  std::string file, command;  // the command line, for the record
  bool force = false;
};
void add_page_settings(CLI::App& command, PageSettings& settings);
/// Refuses a file that is there, before any work is done. @throws InputError
void check_page_file(const PageSettings& settings);
/// Writes the page, and says so on standard output if `say`. @throws InputError
void write_page(const PageSettings& settings, const ResultFiles& files, bool say);

/// Adds the options that calibrate and batch share.
void add_settings(CLI::App& command, CalibrateSettings& settings);

/// Returns the names that an option of choices takes.
template <class Map>
std::vector<std::string> keys(const Map& map) {
  std::vector<std::string> out;
  for (const auto& entry : map) out.push_back(entry.first);
  return out;
}

}  // namespace kincal
