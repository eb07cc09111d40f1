// `kincal monitor`: samples as they come, and whether the robot is still the one that was
// calibrated.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/results/json_values.h"
#include "../../io/results/read_calibrated.h"
#include "../../io/rig/samples_file.h"
#include "../../models/monitor/monitor.h"
#include "../../models/rig/words.h"
#include "../job.h"
#include "command.h"

namespace kincal {
namespace {

struct MonitorArguments {
  std::string result, samples;
  double every = MonitorOptions().samples_between_alarms;
  bool json = false, quiet = false;
};

/// A Found is an alarm: what may have moved.
struct Found {
  std::vector<Moved> groups;  // those that explain it, the likeliest first
};

/// How much less likely than the first a group may be and still be named.
constexpr double kNamedShare = 0.1;

const char* word(SampleState state) {
  switch (state) {
    case SampleState::fits:
      return "fits";
    case SampleState::outlier:
      return "outlier";
    case SampleState::tells_nothing:
      return "tells nothing";
    case SampleState::undefined:
      return "undefined";
  }
  return "";
}

/// How many samples after the alarm it is said what has moved: one sample often cannot tell.
constexpr long kNaming = 20;

/// A change in the units that people read: mrad and mm.
std::string size_text(double value, double sigma, const std::string& unit) {
  if (unit == "rad") return text("%+.3g +- %.2g mrad", 1e3 * value, 1e3 * sigma);
  if (unit == "m") return text("%+.3g +- %.2g mm", 1e3 * value, 1e3 * sigma);
  return text("%+.3g +- %.2g%s%s", value, sigma, unit.empty() ? "" : " ", unit.c_str());
}

/// The components of a group that changed by most sigmas, at most three and those beyond two
/// sigmas.
std::string changes_text(const Monitor& monitor, const Moved& moved) {
  const DriftGroup& group = monitor.groups()[moved.group];
  std::vector<int> order;
  for (int i = 0; i < static_cast<int>(group.columns.size()); ++i) order.push_back(i);
  const auto sigmas = [&](int i) { return std::abs(moved.change(i)) / moved.sigma(i); };
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return sigmas(a) > sigmas(b); });
  std::string out;
  for (size_t k = 0; k < order.size() && k < 3; ++k) {
    if (k > 0 && !(sigmas(order[k]) > 2)) break;
    const Component& c = monitor.columns()[group.columns[order[k]]];
    const std::string& name = monitor.table().all[c.parameter].components[c.index];
    out += (k ? ", " : "") + (name.empty() ? "" : name + " ") +
           size_text(moved.change(order[k]), moved.sigma(order[k]), monitor.table().unit(c));
  }
  return out;
}

std::string found_text(const Monitor& monitor, const Found& found,
                       const std::vector<std::string>& ids) {
  const Moved& first = found.groups.front();
  std::string out = monitor.groups()[first.group].name +
                    " has moved: " + changes_text(monitor, first) + ", since sample '" +
                    ids[first.since] + "'";
  if (found.groups.size() > 1) {
    out += "; as well explained by ";
    for (size_t i = 1; i < found.groups.size(); ++i)
      out += (i > 1 ? ", " : "") + monitor.groups()[found.groups[i].group].name +
             text(" (%.0f %%)", 100 * found.groups[i].probability);
  }
  return out;
}

Json found_json(const Monitor& monitor, const Found& found, const std::vector<std::string>& ids) {
  Json out = Json::array();
  for (const Moved& moved : found.groups) {
    const DriftGroup& group = monitor.groups()[moved.group];
    Json changes = Json::object();
    for (size_t i = 0; i < group.columns.size(); ++i) {
      const Component& c = monitor.columns()[group.columns[i]];
      changes[monitor.table().name(c)] = {{"change", moved.change(static_cast<Eigen::Index>(i))},
                                          {"sigma", moved.sigma(static_cast<Eigen::Index>(i))},
                                          {"unit", monitor.table().unit(c)}};
    }
    out.push_back({{"group", group.name},
                   {"probability", moved.probability},
                   {"since", ids[moved.since]},
                   {"changes", changes}});
  }
  return out;
}

Json sample_json(const Monitor& monitor, const Innovation& innovation, const std::string& id) {
  Json sensors = Json::object();
  for (const SensorInnovation& s : innovation.sensors)
    sensors[monitor.rig().sensors[s.sensor].name] = {
        {"chi2", s.chi2}, {"dof", s.dof}, {"probability", s.probability}};
  Json out = {{"sample", id},
              {"state", word(innovation.state)},
              {"chi2", innovation.chi2},
              {"dof", innovation.dof},
              {"probability", innovation.probability},
              {"unexplained", innovation.unexplained},
              {"sensors", sensors},
              {"drift", nullptr}};
  if (!innovation.why.empty()) out["why"] = innovation.why;
  return out;
}

std::string noise_name(const Monitor& monitor, const NoiseSeen& noise) {
  if (noise.sensor < 0) return "readings of " + monitor.rig().tree.joints[noise.part].name;
  const Sensor& sensor = monitor.rig().sensors[noise.sensor];
  const std::string part = sensor.model->noise_parts()[noise.part].name;
  return sensor.name + (part.empty() ? "" : " (" + part + ")");
}

/// A Watch is a monitor with what it was shown and what it found.
class Watch {
 public:
  Watch(Monitor monitor, const MonitorArguments& a) : monitor_(std::move(monitor)), a_(a) {}

  void show(const Sample& sample) {
    const Innovation innovation = monitor_.add(sample);
    ids_.push_back(sample.id);
    Json json = a_.json ? sample_json(monitor_, innovation, sample.id) : Json();
    std::string words;
    if (innovation.state == SampleState::outlier || innovation.state == SampleState::undefined)
      words = innovation.state == SampleState::outlier
                  ? text("does not fit: chi2 %.4g of %.0f", innovation.chi2, innovation.dof) +
                        worst(innovation) +
                        (innovation.unexplained
                             ? "; samples in a row do not fit, and nothing that moved explains them"
                             : "")
                  : "cannot be evaluated: " + innovation.why;
    const long number = monitor_.samples();
    if (innovation.alarm && name_at_ == 0) {
      name_at_ = number + kNaming;
      tell(json, words, false);
    } else if (innovation.alarm && number >= name_at_) {
      tell(json, words, true);
    }
    if (a_.json)
      std::cout << json.dump() << "\n" << std::flush;
    else if (!words.empty() && !a_.quiet)
      std::cout << sample.id << ": " << words << "\n" << std::flush;
  }

  int end() {
    if (name_at_ > 0) {
      Json ignored;
      std::string words;
      tell(ignored, words, true);
    }
    if (!a_.json) std::cout << summary();
    return found_.empty() ? kConverged : kMoved;
  }

 private:
  /// Tells what may have moved; `named`: from now on the robot counts as calibrated with that.
  void tell(Json& json, std::string& words, bool named) {
    Found found{monitor_.moved()};
    const double least = kNamedShare * found.groups.front().probability;
    while (found.groups.back().probability < least) found.groups.pop_back();
    if (a_.json) json["drift"] = {{"named", named}, {"groups", found_json(monitor_, found, ids_)}};
    words += (words.empty() ? "" : "; ") + std::string(named ? "" : "something has moved, maybe ") +
             found_text(monitor_, found, ids_);
    if (!named) return;
    found_.push_back(found);
    monitor_.restart(true);
    name_at_ = 0;
  }
  std::string worst(const Innovation& innovation) const {
    const SensorInnovation* least = nullptr;
    for (const SensorInnovation& s : innovation.sensors)
      if (!least || s.probability < least->probability) least = &s;
    return least ? "; " + monitor_.rig().sensors[least->sensor].name + " most" : "";
  }
  std::string summary() const {
    std::string out = text("%ld samples, %ld outliers. ", monitor_.samples(), monitor_.outliers());
    if (found_.empty())
      out += text("Nothing has moved (one false alarm in about %.0f samples).\n", a_.every);
    else
      out += "Moved:\n";
    for (const Found& f : found_) out += "  " + found_text(monitor_, f, ids_) + "\n";
    for (const NoiseSeen& n : monitor_.noise())
      if (std::abs(std::log(n.factor)) > std::log(1.25))
        out += "  Noise of " + noise_name(monitor_, n) +
               text(": %.2f times the calibration's (%.0f residuals)\n", n.factor, n.residuals);
    return out;
  }

  Monitor monitor_;
  const MonitorArguments& a_;
  std::vector<std::string> ids_;
  std::vector<Found> found_;
  long name_at_ = 0;  // number of samples; 0: nothing to be named
};

int monitor(const MonitorArguments& a) {
  now("reading " + a.result);
  const CalibratedFiles files = read_calibrated(a.result);
  MonitorOptions options;
  options.samples_between_alarms = a.every;
  Watch watch(Monitor(state_of(files), options), a);
  const Rig& rig = files.rig_file.rig;
  now("monitoring " + a.samples);
  if (a.samples != "-") {
    ProgressLine line(a.quiet || a.json);
    const std::vector<Sample> samples = parse_samples(read_file(a.samples), a.samples, rig, line);
    line.clear();
    for (const Sample& sample : samples) watch.show(sample);
    return watch.end();
  }
  std::string one;
  for (int number = 1; std::getline(std::cin, one); ++number)
    for (const Sample& sample :
         parse_samples(one, "standard input, line " + std::to_string(number), rig))
      watch.show(sample);
  return watch.end();
}

}  // namespace

Command monitor_command(CLI::App& app) {
  auto a = std::make_shared<MonitorArguments>();
  CLI::App* command = app.add_subcommand(
      "monitor", "Watch samples of a calibrated robot: how well each fits, and what has moved");
  command->add_option("RESULT", a->result, "the result directory of a calibration")->required();
  command
      ->add_option("SAMPLES", a->samples,
                   "samples.jsonl, in the order of time; - reads standard input line by line")
      ->required();
  command
      ->add_option("--false-alarms", a->every,
                   "so many samples lie between two false alarms, in the mean")
      ->check(CLI::Range(10.0, 1e9))
      ->type_name("N")
      ->capture_default_str();
  command->add_flag("--json", a->json,
                    "print a line of JSON for every sample: {sample, state, chi2, dof, "
                    "probability, unexplained, sensors, drift}");
  command->add_flag("--quiet", a->quiet, "print the summary only");
  command->footer(
      "Each sample is compared with what the calibration predicts: noise of sensors and joint "
      "readings, and what is uncertain of\n"
      "the calibration itself. A sample that fits as badly as one in a million is an outlier and "
      "left out, until the next one\n"
      "is an outlier too. What moves together is a group: the mount of a sensor or target, the "
      "offset of a joint, the intrinsics\n"
      "of a camera, a baseline. If one has moved it says which, how far, since when, and what else "
      "explains it; from then on the\n"
      "robot counts as calibrated with that change.\n"
      "Exit codes: 0 nothing has moved; 1 bad input or usage; 6 something has moved.");
  return {command, [a] { return monitor(*a); }};
}

}  // namespace kincal
