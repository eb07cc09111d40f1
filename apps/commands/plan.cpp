// `kincal plan`: which postures to record next, and the accuracy that they will give.
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/job/plan.h"
#include "../../io/job/plan_verify.h"
#include "../../io/results/read_calibrated.h"
#include "../job.h"
#include "../signals.h"
#include "command.h"

namespace kincal {
namespace {

struct PlanArguments {
  std::string rig, samples, out, postures;
  PlanSettings settings;
  PageSettings page;
  TestPoseSettings test_poses;
  std::string standard = "iso9283";
  bool verify = false;
  double clearance = 20;  // mm
  bool no_clearance = false, json = false, force = false, quiet = false;
};

/// Plans the test poses of a verification. The same options of candidates count.
int plan_verification(const PlanArguments& a, const RigFile& rig_file) {
  TestPoseSettings settings = a.test_poses;
  settings.candidates = a.settings.candidates;
  settings.seed = a.settings.seed;
  settings.clearance = a.no_clearance ? -1 : a.clearance / 1000;
  ProgressLine line(a.quiet || a.json);
  const TestPosePlan made = plan_test_poses(rig_file, settings, line.progress());
  line.clear();
  begin_writing();
  if (!write_file(a.out, postures_text(rig_file.rig, made.postures), a.force, not_interrupted))
    return say_interrupted();
  if (a.json)
    std::cout << test_poses_json(rig_file.rig, made).dump(1) << "\n";
  else if (!a.quiet)
    std::cout << test_poses_text(made) << made.postures.size() << " postures written to " << a.out
              << ".\n";
  return kConverged;
}

int plan(PlanArguments a) {
  a.page.force = a.force;
  check_output_file(a.out, a.force);
  check_page_file(a.page);
  const CalibratedFiles files = read_calibrated(a.rig);
  const RigFile& rig_file = files.rig_file;
  if (a.verify) return plan_verification(a, rig_file);
  PlanSettings settings = a.settings;
  settings.clearance = a.no_clearance ? -1 : a.clearance / 1000;
  const std::string beside =
      (std::filesystem::path(rig_file.path).parent_path() / "samples.csv").string();
  settings.known = known_robot(files, file_exists(beside) ? read_file(beside) : "");
  if (!a.postures.empty()) settings.postures = NamedText{a.postures, read_file(a.postures)};
  ProgressLine line(a.quiet || a.json);
  std::optional<SampleSet> samples;
  if (!a.samples.empty())
    samples = parse_sample_set(read_file(a.samples), a.samples, rig_file.rig, line.progress());
  const PosturePlan made =
      plan_postures(rig_file, samples ? &*samples : nullptr, settings, line.progress());
  line.clear();
  begin_writing();
  if (!write_file(a.out, postures_text(rig_file.rig, made.postures), a.force, not_interrupted))
    return say_interrupted();
  if (a.json)
    std::cout << plan_json(made).dump(1) << "\n";
  else if (!a.quiet)
    std::cout << plan_text(made) << made.postures.size() << " postures written to " << a.out
              << ", in an order with short moves.\n";
  if (!a.page.file.empty())
    write_page(a.page,
               plan_files(rig_file, made, record_of(a.page.command, samples ? samples->hash : "")),
               !a.json && !a.quiet);
  return made.tolerance && made.needed < 0 ? kToleranceNotMet : kConverged;
}

void add_verify_options(CLI::App& command, PlanArguments& a) {
  CLI::Option* verify = command.add_flag(
      "--verify", a.verify,
      "instead: the test poses for `kincal verify`, five points in the largest cube that the "
      "robot reaches with the measured target; RIG is usually a result directory");
  for (const char* other : {"SAMPLES", "--next", "--goal", "--postures", "--report"})
    verify->excludes(command.get_option(other));
  command
      .add_option("--standard", a.standard,
                  "with --verify: whose test poses (`kincal verify --standard distances` needs "
                  "none: any postures all over the workspace)")
      ->check(CLI::IsMember(std::vector<std::string>{"iso9283"}))
      ->capture_default_str()
      ->needs(verify);
  command
      .add_option("--cycles", a.test_poses.cycles, "with --verify: how often each pose is taken")
      ->check(CLI::Range(1, 1000))
      ->type_name("N")
      ->capture_default_str()
      ->needs(verify);
  command
      .add_flag("--approaches", a.test_poses.approaches,
                "with --verify: P1, P2 and P4 are approached along x, y and z of the base, from "
                "the readings `from` (multi-directional accuracy, vAP)")
      ->needs(verify);
  command
      .add_option("--region", a.test_poses.region,
                  "with --verify: the cube lies between these two corners (m, base frame), for "
                  "example above the table")
      ->delimiter(',')
      ->expected(6)
      ->type_name("X,Y,Z,X,Y,Z")
      ->needs(verify);
  command
      .add_option("--sensor", a.test_poses.sensor,
                  "with --verify: name of the instrument, if there are several")
      ->type_name("NAME")
      ->needs(verify);
}

}  // namespace

Command plan_command(CLI::App& app, const std::string& command_line) {
  auto a = std::make_shared<PlanArguments>();
  a->page.command = command_line;
  CLI::App* command = app.add_subcommand(
      "plan", "Choose the postures to record next, and predict the accuracy they give");
  command->add_option("RIG", a->rig, "rig.yaml, or a result directory")->required();
  command->add_option("SAMPLES", a->samples, "samples already recorded (default: none)");
  command->add_option("--next", a->settings.next, "number of postures")
      ->check(CLI::Range(1, 1000))
      ->type_name("K")
      ->capture_default_str();
  command->add_option("--out", a->out, "file for the postures, JSON lines")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--goal", a->settings.goal,
                   "the goal: frame/LINK (its position over the joint limits), also with a "
                   "tolerance: 'frame/LINK<0.5mm'; names of parameters; or `parameters`: the "
                   "positions of the targets relative to their sensors")
      ->type_name("GOAL")
      ->capture_default_str();
  command->add_option("--candidates", a->settings.candidates, "number of candidates to choose from")
      ->check(CLI::Range(10, 100000))
      ->type_name("N")
      ->capture_default_str();
  command
      ->add_option("--postures", a->postures,
                   "choose from these postures (JSON lines), known to be safe")
      ->type_name("FILE");
  command
      ->add_option(
          "--clearance", a->clearance,
          "smallest distance between links, mm; links are checked as the boxes around their "
          "shapes; pairs that are already close in the URDF's zero posture are not checked")
      ->check(CLI::Range(0.0, 1000.0))
      ->type_name("MM")
      ->capture_default_str();
  command->add_flag("--no-clearance", a->no_clearance, "do not check for collisions between links");
  command->add_option("--seed", a->settings.seed, "the same seed makes the same candidates")
      ->capture_default_str();
  command
      ->add_option("--report", a->page.file,
                   "write a page (HTML) with the forecast and the robot in each posture")
      ->type_name("FILE");
  add_verify_options(*command, *a);
  command->add_flag("--json", a->json, "print the forecast, or the poses, as JSON");
  command->add_flag("--force", a->force, "replace existing files");
  command->add_flag("--quiet", a->quiet, "print nothing");
  command->footer(
      "Candidates are random postures in which a sensor sees a whole target for all mounts within "
      "their present uncertainty.\n"
      "The chosen ones together minimise the predicted error at the goal; `kincal simulate "
      "--postures` tries them out.\n"
      "Exit codes: 0 planned; 1 bad input or usage; 4 the tolerance cannot be reached; 130 "
      "interrupted, nothing written.");
  return {command, [a] { return plan(*a); }};
}

}  // namespace kincal
