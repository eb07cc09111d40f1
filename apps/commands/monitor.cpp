// `kincal monitor`: samples as they come, and whether the robot is still the one that was
// calibrated.
#include <cstdio>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/document/json.h"
#include "../../io/job/static_views.h"
#include "../../io/job/watch.h"
#include "../../io/rig/samples_file.h"
#include "../job.h"
#include "command.h"

namespace kincal {
namespace {

struct MonitorArguments {
  std::string result, samples, state;
  double every = MonitorOptions().samples_between_alarms;
  bool json = false, quiet = false, still = false;
};

/// Cameras that should stand still, without a calibration.
int monitor_still(const MonitorArguments& a) {
  if (!a.samples.empty()) throw InputError("--static takes only SAMPLES, no RESULT");
  if (!a.state.empty()) throw InputError("--static and --state exclude each other");
  StaticViewOptions options;
  options.samples_between_alarms = a.every;
  StaticViews views(options);
  now("monitoring " + a.result);
  const auto show = [&](const Field& sample) {
    const StaticViews::Told told = views.show(sample);
    if (a.json)
      std::cout << told.json << "\n" << std::flush;
    else if (!told.words.empty() && !a.quiet)
      std::cout << told.id << ": " << told.words << "\n" << std::flush;
    return told.id;
  };
  if (a.result != "-") {
    for_each_json_line(read_file(a.result), a.result, show);
  } else {
    std::string one;
    for (int number = 1; std::getline(std::cin, one); ++number)
      for_each_json_line(one, "standard input, line " + std::to_string(number), show);
  }
  if (!a.json) std::cout << views.summary();
  return views.moved() ? kMoved : kConverged;
}

int monitor(const MonitorArguments& a) {
  if (a.still) return monitor_still(a);
  if (a.samples.empty()) throw InputError("SAMPLES is missing: kincal monitor RESULT SAMPLES");
  now("reading " + a.result);
  MonitorOptions options;
  options.samples_between_alarms = a.every;
  const CalibratedFiles files = read_calibrated(a.result);
  for (const std::string& doubt : files.doubts)
    std::fprintf(
        stderr,
        "kincal: warning: data that the calibration does not explain may look like a change: %s\n",
        doubt.c_str());
  Watch watch(files, options);
  if (!a.state.empty() && file_exists(a.state)) try {
      watch.load(read_file(a.state));
    } catch (const std::invalid_argument& error) {
      throw InputError(a.state + ": " + error.what());
    }
  now("monitoring " + a.samples);
  const auto show = [&](const Sample& sample) {
    const Watch::Told told = watch.show(sample);
    if (a.json)
      std::cout << told.json << "\n" << std::flush;
    else if (!told.words.empty() && !a.quiet)
      std::cout << sample.id << ": " << told.words << "\n" << std::flush;
  };
  if (a.samples != "-") {
    ProgressLine line(a.quiet || a.json);
    const std::vector<Sample> samples =
        parse_samples(read_file(a.samples), a.samples, watch.rig(), line.progress());
    line.clear();
    for (const Sample& sample : samples) show(sample);
  } else {
    std::string one;
    for (int number = 1; std::getline(std::cin, one); ++number)
      for (const Sample& sample :
           parse_samples(one, "standard input, line " + std::to_string(number), watch.rig()))
        show(sample);
  }
  if (!a.state.empty()) write_file(a.state, watch.save(), true);
  watch.end();
  if (!a.json) std::cout << watch.summary();
  return watch.moved() ? kMoved : watch.unexplained() > 0 ? kNotExplained : kConverged;
}

}  // namespace

Command monitor_command(CLI::App& app) {
  auto a = std::make_shared<MonitorArguments>();
  CLI::App* command = app.add_subcommand(
      "monitor", "Check new samples of a calibrated robot: how well each fits, and what has moved");
  command
      ->add_option("RESULT", a->result, "the result directory of a calibration; not with --static")
      ->required();
  command->add_option("SAMPLES", a->samples,
                      "samples.jsonl in the order of time; - reads standard input line by line");
  command->add_flag("--static", a->still,
                    "kincal monitor --static SAMPLES: fixed cameras see things that do not move; "
                    "detect a camera that has moved");
  command
      ->add_option("--state", a->state,
                   "continue from this file if it exists, and write the state to it at the end")
      ->type_name("FILE");
  command->add_option("--false-alarms", a->every, "mean number of samples between two false alarms")
      ->check(CLI::Range(10.0, 1e9))
      ->type_name("N")
      ->capture_default_str();
  command->add_flag("--json", a->json,
                    "print one line of JSON per sample: {sample, state, chi2, dof, probability, "
                    "unexplained, sensors, drift}");
  command->add_flag("--quiet", a->quiet, "print only the summary");
  command->footer(
      "Each sample is compared with the prediction of the calibration, including the noise of "
      "sensors and joint readings and the uncertainty of\n"
      "the calibration itself. A sample with a probability below one in a million is an outlier "
      "and is left out, unless the next one\n"
      "is an outlier too. Parts that move together are a group: the mount of a sensor or target, "
      "the offset of a joint, the intrinsics\n"
      "of a camera, a baseline. If a group has moved, the output names it, how far and since when "
      "it moved, and the alternatives. From then on\n"
      "the robot is monitored with that change applied.\n"
      "Exit codes: 0 nothing has moved; 1 bad input or usage; 5 consecutive samples do not fit and "
      "no single change explains them; 6 something has moved.");
  return {command, [a] { return monitor(*a); }};
}

}  // namespace kincal
