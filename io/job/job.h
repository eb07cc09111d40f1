// "Calibrate this rig with these samples", as the program, Python and C share it: what was read,
// put together and checked; settings as they are given; the run; the files of its result. Nothing
// is printed here.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "../../models/report/study.h"
#include "../results/results.h"
#include "../rig/rig_file.h"
#include "words.h"

namespace kincal {

extern const std::map<std::string, NoiseMode> kNoiseModes;
extern const std::map<std::string, LinearSolver> kLinearSolvers;

/// CalibrateSettings are the options of a calibration, as given.
struct CalibrateSettings {
  std::string noise = "latent", step, linear_solver = "auto";
  int iterations = 0;                          // 0: until converged
  std::vector<std::string> groups, no_groups;  // of a rig without steps
  std::vector<std::string> free, fix;
  int threads = 1;
  int restarts = 0;                     // 0: none
  int holdout = 0, cross_validate = 0;  // folds; 0: not asked for
  std::vector<std::string> report_frames, require;
  bool reject = false, estimate_noise = false, no_report = false, write_reduction = false;
  std::string command;            // the command line, for the record
  Words words = Words::switches;  // of errors; results always name the program's options
};

/// SampleSet are samples as read, and where they were read from.
struct SampleSet {
  std::string path, hash;  // SHA-256 of the text, in hex
  std::shared_ptr<const std::vector<Sample>> samples;
};
/// Reads samples from the text of a file. @throws InputError, Cancelled
SampleSet parse_sample_set(const std::string& text, const std::string& path, const Rig& rig,
                           const Progress& progress = {});

/// A Job is a rig and its samples, read and checked.
struct Job {
  RigFile rig_file;
  std::string samples_path, samples_hash;
  std::shared_ptr<const Recording> recording;
  std::vector<std::string> held_out;  // samples and targets that a holdout took out of the training
  std::string note;                   // what was done to the rig, for the user; mostly empty
};

/// Puts a rig and samples together, with every step checked. @throws InputError
std::shared_ptr<const Recording> checked_recording(const RigFile& rig_file,
                                                   const SampleSet& samples, Words words);

/// Puts a rig and its samples together; of the settings `holdout` is a number of folds, of which
/// one is held out from the fit besides the samples that are so already. @throws InputError
Job make_job(RigFile rig_file, const SampleSet& samples, const CalibrateSettings& settings);

/// Checks settings that no program has checked: ranges, and names of choices. @throws InputError
void check_settings(const CalibrateSettings& settings);
/// Checks the names that `free` and `fix` give for a rig whose steps are not found yet.
/// @throws InputError
void check_names(const Job& job, const CalibrateSettings& settings);
/// Returns what each step would free and count. @throws InputError
std::vector<StepPlan> plan(const Job& job, const CalibrateSettings& settings);
/// Returns what the automatic path lets be wrong. @throws InputError: there is no such group.
AutomaticGroups automatic_groups(const Job& job, const CalibrateSettings& settings);

/// Checks `report_frames` and `require` against the rig. @throws InputError
void check_validation(const Job& job, const CalibrateSettings& settings);

/// Checks that the rig has no steps, if groups are named: steps say what is free. @throws
/// InputError
void check_groups(const Rig& rig, const CalibrateSettings& settings);

/// Runs the study of a job (models/report/study.h). A rig without steps has the steps found from
/// then on. With `diagnose`, mistakes are looked for if it ends badly.
/// @throws InputError, std::exception, Cancelled
Report run(Job& job, const CalibrateSettings& settings, bool diagnose, const Progress& progress);

/// Returns what a result records of where it comes from: date and version too.
ResultOptions record_of(const std::string& command, const std::string& samples_hash);

/// Makes the files of a result but for its page.
ResultFiles make_texts(const Job& job, const Report& report, const CalibrateSettings& settings);
/// Makes the page of these, report.html.
std::string make_page(const ResultFiles& files);

/// A FinishedJob is a calibration with the texts of its files, but for the page; there are none
/// where no calibration can start.
struct FinishedJob {
  Job job;
  Report report;
  ResultFiles files;
};
/// Calibrates: all of the above in order. @throws InputError, std::exception, Cancelled
FinishedJob calibrate_job(const RigFile& rig_file, const SampleSet& samples,
                          const CalibrateSettings& settings, const Progress& progress);
/// Returns why no calibration can start, with what may be wrong; "" where one did.
std::string why_no_start(const Report& report);

}  // namespace kincal
