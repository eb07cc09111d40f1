// `kincal simulate`: samples with known truth from a rig, and pictures of them.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <set>

#include "../../io/document/files.h"
#include "../../io/document/numbers.h"
#include "../../io/job/simulate.h"
#include "../../io/rig/rig_file.h"
#include "../../io/rig/samples_file.h"
#include "../../io/rig/simulation_file.h"
#include "../job.h"
#include "../render_options.h"
#include "../sibling.h"
#include "../signals.h"
#include "command.h"

namespace kincal {
namespace {

struct SimulateArguments {
  std::string rig, out, truth, postures, render, bag;
  std::vector<std::string> spread;
  RenderArguments look;
  JourneyArguments journey;
  int samples = 0;
  unsigned long long seed = 0;
  bool pixels = false, force = false, quiet = false;
};

bool takes_pictures(const Rig& rig, const View& view) {
  return rig.sensors[view.sensor].type == "camera" && rig.targets[view.target].type != "points";
}

/// The images that are to be taken, and the readings beside their names as `detect --joints` takes
/// them.
struct ImageNames {
  std::vector<std::vector<std::string>> paths;  // by sample and view, relative to the samples
  std::string table;
};

/// Names an image for every view of a camera on a print, and takes its points away unless they are
/// asked for.
ImageNames name_images(const SimulateArguments& a, const Rig& rig, std::vector<Sample>& samples) {
  namespace fs = std::filesystem;
  int cameras = 0;
  for (const Sensor& sensor : rig.sensors) cameras += sensor.type == "camera";
  const fs::path folder = fs::absolute(a.render).lexically_normal();
  std::vector<char> logged(rig.tree.joints.size(), 1);
  for (const Sample& sample : samples)
    for (size_t j = 0; j < logged.size(); ++j)
      if (std::isnan(sample.readings[j])) logged[j] = 0;
  ImageNames out;
  std::string row;
  out.table = "image";
  for (size_t j = 0; j < logged.size(); ++j)
    if (logged[j]) out.table += "," + rig.tree.joints[j].name;
  std::set<std::string> names;
  for (Sample& sample : samples) {
    std::string stem = sample.id;
    for (char& c : stem)
      if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '.') c = '_';
    while (!names.insert(stem).second) stem += "_";
    row.clear();
    for (size_t j = 0; j < logged.size(); ++j)
      if (logged[j]) row += "," + shortest(sample.readings[j]);
    std::set<std::string> taken;
    out.paths.emplace_back();
    for (View& view : sample.views) {
      const Sensor& sensor = rig.sensors[view.sensor];
      std::string& path = out.paths.back().emplace_back();
      if (!takes_pictures(rig, view)) continue;
      if (sensor.image_width < 1)
        throw InputError("simulate: --render: camera '" + sensor.name +
                         "' has no image_size in the rig");
      const std::string name = stem + (cameras > 1 ? "_" + sensor.name : "") + ".png";
      if (!a.force && fs::exists(folder / name))
        throw InputError((folder / name).string() +
                         ": exists already; --force replaces it, another --render keeps it");
      path = (folder / name).lexically_relative(fs::absolute(a.out).lexically_normal()).string();
      if (!a.pixels) view.ids.clear(), view.z.clear();
      if (taken.insert(name).second) out.table += "\n" + name + row;
    }
  }
  out.table += "\n";
  return out;
}

/// The folder of --out that holds the images, if they are to be inside it; else "".
std::string folder_of_images(const SimulateArguments& a) {
  namespace fs = std::filesystem;
  if (a.render.empty()) return "";
  const fs::path inside = fs::absolute(a.render).lexically_normal().lexically_relative(
      fs::absolute(a.out).lexically_normal());
  const std::string first = inside.empty() ? "" : inside.begin()->string();
  return first == ".." || first == "." ? "" : first;
}

/// Becomes the program that takes the pictures, for a folder or a bag.
[[noreturn]] void take_pictures(const std::string& program, const SimulateArguments& a) {
  std::vector<std::string> words = {
      "kincal-render",       rig_path(a.rig), a.out + "/samples.jsonl",
      a.out + "/truth.json", "--seed",        std::to_string(a.seed)};
  for (const std::string& word : words_of(a.look)) words.push_back(word);
  if (!a.bag.empty())
    for (const std::string& word : words_of(a.journey, a.bag)) words.push_back(word);
  if (a.force) words.emplace_back("--force");
  if (a.quiet) words.emplace_back("--quiet");
  std::fflush(stdout);
  become(program, words);
}

int simulate(const SimulateArguments& a) {
  const bool pictures = !a.render.empty();
  const std::string program =
      pictures || !a.bag.empty()
          ? find_sibling("kincal-render",
                         pictures ? "`kincal simulate --render`" : "`kincal simulate --bag`",
                         kBuiltWithImages)
          : "";
  say_cleared(clear_leftovers(a.out));
  check_output(a.out, a.force, folder_of_images(a));
  if (!a.bag.empty()) {
    say_cleared(clear_leftovers(a.bag));
    check_output_file(a.bag, a.force);
  }
  const RigFile rig_file = read_rig(rig_path(a.rig));
  SimulateSettings settings;
  settings.seed = a.seed;
  settings.samples = a.samples;
  if (!a.postures.empty()) settings.postures = NamedText{a.postures, read_file(a.postures)};
  if (!a.truth.empty()) settings.truth = NamedText{a.truth, read_file(a.truth)};
  for (const std::string& s : a.spread) {
    const size_t equals = s.rfind('=');
    Node value;
    value.kind = Node::Kind::scalar;
    value.text = equals == std::string::npos ? "" : s.substr(equals + 1);
    const std::string where = "--spread";
    if (equals == std::string::npos || equals == 0)
      throw InputError("--spread: GLOB=SIGMA is expected, not '" + s + "'");
    settings.spread.push_back({s.substr(0, equals), Field{&value, &where, s}.number_at_least(0)});
  }
  ProgressLine line(a.quiet);
  SimulatedJob job = simulate_samples(rig_file, settings, line.progress().in("simulating"));
  line.clear();
  Simulation& simulation = job.simulation;
  for (const std::string& warning : job.warnings)
    std::fprintf(stderr, "kincal: warning: %s\n", warning.c_str());
  if (simulation.samples.empty())
    throw InputError("simulate: no sample is left: no posture has a possible view");
  std::map<int, int> views;
  for (const Sample& sample : simulation.samples)
    for (const View& view : sample.views) ++views[view.sensor];
  std::vector<std::pair<std::string, std::string>> files;
  ImageNames images;
  if (pictures) images = name_images(a, rig_file.rig, simulation.samples);
  const std::vector<Joint>& joints = rig_file.rig.tree.joints;
  const bool poses = std::any_of(joints.begin(), joints.end(),  // they are no columns of numbers
                                 [](const Joint& joint) { return joint.first_axis >= 0; });
  if (pictures && !poses) files.emplace_back("joints.csv", images.table);
  files.emplace_back("samples.jsonl", samples_text(rig_file.rig, simulation.samples, images.paths));
  files.emplace_back("truth.json", truth_text(rig_file.rig, job.table, simulation));
  begin_writing();
  if (!write_directory(a.out, files, a.force, not_interrupted, "", folder_of_images(a)))
    return say_interrupted();
  if (!a.quiet) {
    std::printf("%zu samples", simulation.samples.size());
    for (const auto& v : views)
      std::printf(", %s %d views", rig_file.rig.sensors[v.first].name.c_str(), v.second);
    std::printf("\nWritten to %s: samples.jsonl, truth.json%s\n", a.out.c_str(),
                !pictures || poses ? "" : ", joints.csv");
  }
  if (!program.empty()) take_pictures(program, a);
  return kConverged;
}

}  // namespace

Command simulate_command(CLI::App& app) {
  auto a = std::make_shared<SimulateArguments>();
  CLI::App* command = app.add_subcommand(
      "simulate",
      "Simulate samples with known true parameters and noise from a rig, to try out a setup");
  command
      ->add_option("RIG", a->rig, "rig.yaml: the nominal robot, sensors, targets and their sigmas")
      ->required();
  command->add_option("--samples", a->samples, "number of samples")
      ->required()
      ->check(CLI::Range(1, 1000000));
  command->add_option("--seed", a->seed, "the same seed makes the same samples")
      ->required()
      ->check(CLI::Range(0LL, 1LL << 62));
  command->add_option("--out", a->out, "new directory for samples.jsonl and truth.json")
      ->required();
  CLI::Option* truth_option = command->add_option(
      "--truth", a->truth,
      "JSON: {\"parameters\": {NAME: true value, ...}}; poses as increments from the "
      "rig's (absent: from the identity)");
  command
      ->add_option("--spread", a->spread,
                   "GLOB=SIGMA: draw true values around the rig's, e.g. 'joint/*/offset=0.01'")
      ->allow_extra_args(false)
      ->type_name("GLOB")
      ->excludes(truth_option);
  command->add_option("--postures", a->postures,
                      "JSON lines with postures, views and poses of targets; without views: all "
                      "whole targets that are seen. Default: random postures within the joint "
                      "limits in which a target is seen");
  CLI::Option* render =
      command->add_option("--render", a->render,
                          "also render images of boards and markers into this folder; views get an "
                          "`image` and no pixels, for `kincal detect`");
  render->type_name("DIR");
  const std::vector<CLI::Option*> of_pictures = add_render_options(*command, a->look);
  command->add_flag("--pixels", a->pixels, "with --render: write pixels as well")->needs(render);
  CLI::Option* bag = command->add_option(
      "--bag", a->bag,
      "write a bag of joint readings and images of a robot that moves from posture to posture and "
      "rests in each: ROS 1 (NAME.bag) or ROS 2 (NAME.mcap)");
  bag->type_name("FILE")->excludes(render)->check(ends_as_a_bag);
  for (CLI::Option* option : add_journey_options(*command, a->journey)) option->needs(bag);
  command->add_flag("--force", a->force, "replace an existing simulation");
  command->add_flag("--quiet", a->quiet, "no progress, no summary");
  command->footer(
      "Exit codes: 0 written; 1 bad input or usage, nothing written; 130 interrupted, nothing "
      "written.");
  return {command, [a, of_pictures] {
            for (const CLI::Option* option : of_pictures)
              if (option->count() > 0 && a->render.empty() && a->bag.empty())
                throw InputError(option->get_name() + " needs --render or --bag");
            return simulate(*a);
          }};
}

}  // namespace kincal
