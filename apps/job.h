// "Calibrate this rig with these samples", as the commands calibrate and batch share it.
#pragma once

#include <exception>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "../io/results/results.h"
#include "../io/rig/rig_file.h"
#include "../models/report/study.h"
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

extern const std::map<std::string, NoiseMode> kNoiseModes;
extern const std::map<std::string, LinearSolver> kLinearSolvers;

/// CalibrateSettings are the options of a calibration, as given.
struct CalibrateSettings {
  std::string noise = "latent", step, linear_solver = "auto";
  int iterations = 0;                          // 0: until converged
  std::vector<std::string> groups, no_groups;  // of a rig without steps
  std::vector<std::string> free, fix;
  int threads = 1;
  int restarts = 0;                     // calibrate only
  int holdout = 0, cross_validate = 0;  // folds; 0: not asked for
  std::vector<std::string> report_frames, require;
  bool reject = false, estimate_noise = false, no_report = false, write_reduction = false;
  std::string command;  // the command line, for the record
};

/// A Job is a rig and its samples, read and checked.
struct Job {
  RigFile rig_file;
  std::string samples_path, samples_hash;
  std::shared_ptr<const Recording> recording;
  std::vector<std::string> held_out;  // samples and targets that --holdout took out of the training
  std::string note;                   // what was done to the rig, for the user; mostly empty
};

/// Says what was cleared away of runs that were killed (clear_leftovers).
void say_cleared(const std::vector<std::string>& notes);

/// Returns the path of a rig; a folder with a rig.yaml (a result) stands for that file.
std::string rig_path(const std::string& path);

/// Puts together a rig and samples that were read from `samples_path`, with every step checked.
/// @throws InputError
std::shared_ptr<const Recording> checked_recording(const RigFile& rig_file,
                                                   std::vector<Sample> samples,
                                                   const std::string& samples_path);
/// Reads samples, and shows how far that is.
std::vector<Sample> parse_samples(const std::string& text, const std::string& path, const Rig& rig,
                                  ProgressLine& line);

/// Reads and checks a rig and its samples. `holdout` is a number of folds, of which one is held out
/// from the fit besides the samples that are so already; 0: none. @throws InputError
Job read_job(const std::string& rig, const std::string& samples, int holdout, ProgressLine& line);

/// Returns the error for the user: the unknown parameter name with the nearest ones that exist.
InputError with_nearest(const NameError& error);
/// Returns a message of the library in the program's terms: places in options ("free[0]",
/// "last_step") become switches (--free, --step).
std::string in_program_words(std::string message);
/// The same of all texts of a notice.
void in_program_words(Notice& notice);

/// Checks the names that --free and --fix give for a rig whose steps are not found yet.
/// @throws InputError
void check_names(const Job& job, const CalibrateSettings& settings);
/// Returns what each step would free and count. @throws InputError
std::vector<StepPlan> plan(const Job& job, const CalibrateSettings& settings);
/// Returns what the automatic path lets be wrong. @throws InputError: there is no such group.
AutomaticGroups automatic_groups(const Job& job, const CalibrateSettings& settings);

/// Checks --report-frame and --require against the rig. @throws InputError
void check_validation(const Job& job, const CalibrateSettings& settings);

/// Checks that the rig has no steps, if groups are named: steps say what is free. @throws
/// InputError
void check_groups(const Rig& rig, const CalibrateSettings& settings);

/// Runs the study of a job (models/report/study.h). A rig without steps has the steps found from
/// then on. With `diagnose`, mistakes are looked for if it ends badly. @throws InputError,
/// std::exception
Report run(Job& job, const CalibrateSettings& settings, bool diagnose, ProgressLine& line);

ResultFiles make_files(const Job& job, const Report& report, const CalibrateSettings& settings);

/// PageSettings say where a command that writes no folder puts its page; no file: nowhere.
struct PageSettings {
  std::string file, command;  // the command line, for the record
  bool force = false;
};
void add_page_settings(CLI::App& command, PageSettings& settings);
/// Refuses a file that is there, before any work is done. @throws InputError
void check_page_file(const PageSettings& settings);
/// Returns what the page records of where it comes from; `samples` is their text.
ResultOptions page_record(const PageSettings& settings, const std::string& samples);
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
