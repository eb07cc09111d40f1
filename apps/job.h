// "Calibrate this rig with these samples", as the commands calibrate and batch share it.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "../io/results.h"
#include "../io/rig_file.h"
#include "../models/calibration.h"

namespace CLI {
class App;
}

namespace kincal {

enum ExitCode { kConverged = 0, kBadInput = 1, kUnobservable = 2, kNotConverged = 3, kInterrupted = 130 };
ExitCode exit_code(Status status);

extern const std::map<std::string, NoiseMode> kNoiseModes;
extern const std::map<std::string, LinearSolver> kLinearSolvers;

/// The options of a calibration, as given.
struct CalibrateSettings {
  std::string noise = "latent", step, linear_solver = "auto";
  std::vector<std::string> free, fix;
  int threads = 1;
  bool reject = false, no_report = false, write_reduction = false;
  std::string command;  // the command line, for the record
};

/// A rig and its samples, read and checked.
struct Job {
  RigFile rig_file;
  std::string samples_path;
  Calibration calibration;
};

/// A folder with a rig.yaml (a result) stands for that file.
std::string rig_path(const std::string& path);

/// @throws InputError
Calibration make_calibration(const RigFile& rig_file, const std::string& samples_path);
Job read_job(const std::string& rig, const std::string& samples);

/// An unknown parameter name in terms that help: with the nearest ones.
InputError with_nearest(const NameError& error, const Calibration& calibration);

std::vector<StepPlan> plan(const Job& job, const CalibrateSettings& settings);

/// With `reject` the job's calibration is that of what is left afterwards. nullopt: `progress` (see CalibrationOptions) cancelled. @throws InputError, std::exception
std::optional<CalibrationResult> run(Job& job, const CalibrateSettings& settings,
                                     const std::function<bool(const std::string&, int, double, double)>& progress);

ResultFiles make_files(const Job& job, const CalibrationResult& result, const CalibrateSettings& settings);

/// The options that calibrate and batch share.
void add_settings(CLI::App& command, CalibrateSettings& settings);

/// The names that an option of choices takes.
template <class Map>
std::vector<std::string> keys(const Map& map) {
  std::vector<std::string> out;
  for (const auto& entry : map) out.push_back(entry.first);
  return out;
}

}  // namespace kincal
