#include "check.h"

#include <algorithm>

#include "../../models/report/warnings.h"
#include "../results/result_json.h"
#include "../rig/alike.h"

namespace kincal {
namespace {

constexpr double kExplained =
    2;  // chi2/dof below which there is nothing that a mistake could explain

/// Samples, by target, with views whose numbers nothing decides.
std::map<std::string, std::vector<std::string>> find_open_numbers(
    const RigFile& rig, const std::vector<Sample>& samples) {
  std::map<std::string, std::vector<std::string>> out;
  for (const auto& [sample, view] : undecided_numbers(rig, samples)) {
    const Sample& one = samples[static_cast<size_t>(sample)];
    const int target = one.views[static_cast<size_t>(view)].target;
    std::vector<std::string>& ids = out[rig.rig.targets[static_cast<size_t>(target)].name];
    if (ids.empty() || ids.back() != one.id) ids.push_back(one.id);
  }
  return out;
}

}  // namespace

CheckedJob check_samples(const RigFile& rig_file, const SampleSet& samples,
                         const DoctorOptions& options, Words words) {
  auto all = std::make_shared<std::vector<Sample>>(*samples.samples);
  for (Sample& s : *all) s.train = true;  // held-out samples can be wrong as well
  std::shared_ptr<const Recording> recording =
      checked_recording(rig_file, {samples.path, samples.hash, std::move(all)}, words);
  std::optional<Diagnosis> diagnosis;
  try {
    diagnosis = uncancelled(diagnose(*recording, options));
  } catch (const NameError& error) {
    throw with_nearest(error, words);
  }
  for (Notice& finding : diagnosis->findings) in_words(finding, Words::switches);
  std::map<std::string, std::vector<std::string>> open;
  if (diagnosis->findings.empty()) open = find_open_numbers(rig_file, recording->samples);
  return {std::move(recording), std::move(*diagnosis), std::move(open)};
}

bool explained(const Diagnosis& d) {
  return d.with_usual_errors || (d.chi2 && *d.chi2 < kExplained * static_cast<double>(d.dof));
}

Json check_json(const CheckedJob& checked) {
  Json json = diagnosis_json(checked.diagnosis);
  json["open_numbering"] = Json::object();
  for (const auto& [target, samples] : checked.open_numbers)
    json["open_numbering"][target] = samples;
  return json;
}

EvaluatedJob evaluate_samples(RigFile& rig_file, const SampleSet& samples,
                              const CalibrateSettings& settings, const Progress& progress) {
  if (std::none_of(samples.samples->begin(), samples.samples->end(),
                   [](const Sample& sample) { return sample.train; }))
    clear_steps(rig_file.rig);  // new data to judge: no step has anything to fit
  std::shared_ptr<const Recording> recording = checked_recording(rig_file, samples, settings.words);
  try {
    Evaluation evaluation =
        evaluate(*recording, kNoiseModes.at(settings.noise), settings.free, progress);
    Notices words = warnings(evaluation);
    for (Notice& w : words) in_words(w, Words::switches);
    return {std::move(recording), std::move(evaluation), std::move(words)};
  } catch (const NameError& error) {
    throw with_nearest(error, settings.words);
  }
}

}  // namespace kincal
