// `kincal diff`: two calibrations of one robot compared.
#include <iostream>

#include "../../io/results/comparison.h"
#include "../job.h"
#include "../tables/comparison_table.h"
#include "command.h"

namespace kincal {
namespace {

struct DiffArguments {
  std::string a, b, samples;
  std::vector<std::string> frames;
  bool json = false;
};

int diff(const DiffArguments& args) {
  const CalibratedFiles first = read_calibrated(args.a);
  const bool truth = is_truth_file(args.b);  // then errors: the result less the truth
  const CalibratedFiles second = truth ? read_true_values(args.b, first) : read_calibrated(args.b);
  const CalibratedFiles &a = truth ? second : first, &b = truth ? first : second;
  const Comparison comparison = compare(a, b, args.frames, args.samples);
  if (args.json)
    std::cout << comparison_json(a, b, comparison);
  else if (truth)
    std::cout << "Result: " << args.a << "\nTruth: " << args.b << "\n\n"
              << comparison_table(comparison, comparison.parameters.size() * 6)
              << errors_text(b, comparison);
  else
    std::cout << "A: " << args.a << "\nB: " << args.b << "\n\n" << comparison_table(comparison, 30);
  return kConverged;
}

}  // namespace

Command diff_command(CLI::App& app) {
  auto a = std::make_shared<DiffArguments>();
  CLI::App* command = app.add_subcommand(
      "diff",
      "Compare two calibrations of one robot by parameter and by frame, or one with the truth");
  command->add_option("A", a->a, "result directory, its result.json, or a rig.yaml")->required();
  command->add_option("B", a->b, "likewise, or the truth.json of `kincal simulate`: errors of A")
      ->required();
  command
      ->add_option("--frame", a->frames,
                   "link, sensor/NAME or target/NAME whose pose relative to the base is compared; "
                   "may be repeated (default: sensors, mounted\n"
                   "targets, and the links that carry them)")
      ->allow_extra_args(false)
      ->type_name("FRAME");
  command->add_option("--samples", a->samples,
                      "samples.jsonl of A's rig whose joint readings define the workspace "
                      "(default: random within the joint limits)");
  command->add_flag("--json", a->json, "print everything as JSON");
  command->footer(
      "Differences are B - A, also in sigmas of the difference (root of the sum of both squared "
      "sigmas, valid for calibrations from different data).\n"
      "Poses are compared as poses, independent of their initial values. Exit codes: 0; 1 bad "
      "input, or different robots.");
  return {command, [a] { return diff(*a); }};
}

}  // namespace kincal
