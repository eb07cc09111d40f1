// Proves, with a program that makes texts (libFuzzer by scripts/fuzz, mutations.cpp in the tests):
// whatever stands in a file, its reader takes it or throws an InputError; what was read is written
// so that it can be read again; and what readers take can be calibrated, or is refused by
// std::invalid_argument. The environment's KINCAL_READER names one of the readers below, whose
// first texts are the files of corpus/KINCAL_READER; where it needs other files, they come from the
// corpus too. It does not prove that a message is a good one.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <stdexcept>

#include "../../io/document/error.h"
#include "../../io/document/files.h"
#include "../../io/exchange/dh.h"
#include "../../io/exchange/guess.h"
#include "../../io/exchange/joint_table.h"
#include "../../io/exchange/kalibr_target.h"
#include "../../io/exchange/pose_samples.h"
#include "../../io/exchange/read_lens.h"
#include "../../io/exchange/read_table.h"
#include "../../io/exchange/robot_exports.h"
#include "../../io/exchange/ur_kinematics.h"
#include "../../io/exchange/write_lens.h"
#include "../../io/results/apply.h"
#include "../../io/results/comparison.h"
#include "../../io/results/results.h"
#include "../../io/rig/rig_text.h"
#include "../../io/rig/samples_file.h"
#include "../../io/rig/simulation_file.h"
#include "../../io/urdf/edit.h"
#include "../../io/urdf/edit_mjcf.h"
#include "../../models/report/study.h"
#ifdef KINCAL_FUZZ_IMAGES
#include "../../io/images/compression.h"
#endif
#include "fuzz.h"

namespace {

namespace fs = std::filesystem;
using namespace kincal;

/// A folder of this process, with the robot and the rig of the corpus.
struct Folder {
  Folder() {
    std::string pattern = (fs::temp_directory_path() / "kincal-fuzz-XXXXXX").string();
    if (!mkdtemp(pattern.data())) std::abort();
    path = pattern;
    for (const char* file : {"urdf/robot.urdf", "rig/rig.yaml"})
      fs::copy(fs::path(KINCAL_FUZZ_CORPUS) / file, path);
  }
  ~Folder() { fs::remove_all(path); }
  fs::path path;
};

std::string path_of(const std::string& name) {
  static const Folder folder;
  return (folder.path / name).string();
}

/// What kincal wrote, kincal reads.
template <class F>
auto again(const F& read) {
  try {
    return read();
  } catch (const InputError& error) {
    throw std::logic_error(std::string("what was written cannot be read: ") + error.what());
  }
}

// ------------------------------------------------------------------------------------------------
void urdf(const std::string& text) {
  const Urdf urdf = parse_urdf(text, "robot.urdf");
  if (edit_urdf(urdf, {}) != text) throw std::logic_error("no change changes the text");
  UrdfChanges changes;
  for (size_t j = 0; j < urdf.tree.joints.size(); ++j)
    changes.origins[static_cast<int>(j)] = Pose();
  again([&] { return parse_urdf(edit_urdf(urdf, changes), "written.urdf"); });
}

/// A model whose robot has other origins: what is written is that robot's.
void mjcf(const std::string& text) {
  static const Urdf urdf = read_urdf(KINCAL_FUZZ_CORPUS "/urdf/robot.urdf");
  CalibratedTree robot{urdf.tree, {}, {}, {{"eye", 2, Pose()}}};
  for (const Joint& joint : urdf.tree.joints) robot.before.push_back(joint.parent_T_joint);
  robot.after = robot.before;
  for (Pose& origin : robot.after)
    origin = origin * Pose{rotation_about(Vector3d::UnitY(), 0.01), Vector3d(0.001, 0.002, 0)};
  const std::string written = edit_mjcf(text, "model.xml", robot).text;
  const CalibratedTree same{urdf.tree, robot.after, robot.after, {}};
  again([&] { return edit_mjcf(written, "written.xml", same); });
}

void rig(const std::string& text) {
  const RigFile file = read_rig(in_file("any.yaml", text));
  const std::string written = rig_text(file, values_of(file.rig), "robot.urdf");
  again([&] { return read_rig(in_file("written.yaml", written)); });
}

void samples(const std::string& text) {
  const Rig& rig = usual_rig().rig;
  const std::string written = samples_text(rig, parse_samples(text, "samples.jsonl", rig));
  again([&] { return parse_samples(written, "written.jsonl", rig); });
}

void truth(const std::string& text) {
  read_truth(in_file("truth.json", text), ParameterTable(usual_rig().rig));
}

void result(const std::string& text) {
  static const Urdf nominal = read_urdf(KINCAL_FUZZ_CORPUS "/urdf/nominal.urdf");
  const std::string path = in_file("result.json", text);
  const CalibratedFiles files = read_calibrated(path);
  comparison_json(files, files, compare(files, files, {}, ""));
  apply_result(path, nominal, true);
}

/// A table becomes a URDF. A robot that it makes may still be refused, for names of its joints.
void dh(const std::string& text) {
  const std::string path = in_file("table.csv", text);
  for (const bool modified : {false, true})
    parse_urdf(dh_urdf(read_dh(path, modified), "robot"), "table.urdf");
}

void kinematics(const std::string& text) {
  const UrKinematics read = read_ur_kinematics(in_file("kinematics.yaml", text));
  again([&] { return read_ur_kinematics(in_file("written.yaml", ur_kinematics_text(read))); });
}

/// Motors of LeRobot, of a robot with offsets.
void lerobot(const std::string& text) {
  static const CalibratedFiles files = read_calibrated(path_of("rig.yaml"));
  RobotNumbers robot = robot_numbers(files);
  for (double& offset : robot.offsets) offset = 0.1;
  std::vector<std::string> notes;
  const std::string written = lerobot_text(robot, in_file("arm.json", text), "dynamixel", notes);
  again([&] { return lerobot_text(robot, in_file("written.json", written), "dynamixel", notes); });
}

/// A file of another program.
void foreign(const std::string& text) {
  const std::string path = in_file("foreign.yaml", text);
  if (is_hand_eye(path)) {
    const HandEyeFiles files = hand_eye_files(path, read_hand_eye(path, false), false);
    const RigFile rig = again([&] { return read_rig(in_file("made.yaml", files.rig_yaml)); });
    again([&] { return parse_samples(files.samples_jsonl, "made.jsonl", rig.rig); });
    return;
  }
  std::vector<std::string> notes;
  if (is_kalibr_target(path)) {
    read_kalibr_target(path, notes);
    return;
  }
  LensNumbers lens = read_lens(path, {}, notes);
  const EditedRig edited =
      edited_rig(usual_rig(), "sensors", cameras_of(usual_rig().rig, {})[0]->name, lens_keys(lens),
                 "robot.urdf");
  again([&] { return read_rig(in_file("edited.yaml", edited.text)); });
  lens.width = lens.height = 100;
  const bool sphere = lens.model == "unified" || lens.model == "double_sphere";
  if (sphere) lens.name = "cam0";
  const std::string written = in_file(
      "written.yml", sphere ? kalibr_text({lens}, {std::nullopt}) : opencv_text(lens, notes));
  again([&] { return read_lens(written, {}, notes); });
}

/// A table of poses, in any of the kinds of files that have them: each thing that is made of one.
void poses(const std::string& text) {
  const std::string path = in_file("poses.csv", text);
  const std::vector<std::function<void()>> all = {
      [&] { guess_text({path}); },
      [&] { flange_lines(read_flange_poses(path, pose_format("kuka"), 0), "", ""); },
      [&] { flange_lines(read_poses({path}, {}, "--pose-format"), "", ""); },
      [&] {
        std::string note;
        hand_eye_files(path, pairs_of(read_tables(path), {"rotvec", ""}, {}, note), true);
      },
      [&] {
        read_joint_table(path, usual_rig().rig, {{{"a", "x"}}, true});
      }};
  for (const auto& one : all) try {
      one();
    } catch (const InputError&) {  // of others it may be one
    }
}

/// A rig, a line ---, samples.
void calibration(const std::string& text) {
  const size_t end = text.find("---\n");
  if (end == std::string::npos) return;
  const RigFile file = read_rig(in_file("any.yaml", text.substr(0, end)));
  for (const Target& target : file.rig.targets)
    if (target.count() > 100) return;  // slow is not wrong
  const auto recording =
      make_recording(file.rig, parse_samples(text.substr(end + 4), "samples.jsonl", file.rig));
  if (recording->training().empty()) return;
  check_steps(*recording);
  StudyOptions options;
  options.calibration.max_iterations = 3;
  const std::optional<Report> report = study(recording, options);
  if (report->solution.status != Status::undefined_start) make_results(file, *report, {});
}

#ifdef KINCAL_FUZZ_IMAGES
/// The tables of a JPEG: what is cut off behind them has the same ones.
void jpeg(const std::string& text) {
  const Compression whole = compression_of(text);
  for (size_t quarters : {1, 2, 3}) {
    const Compression part =
        compression_of(std::string_view(text).substr(0, text.size() * quarters / 4));
    if (part.any() && part.steps != whole.steps)
      throw std::logic_error("what is cut off has others");
  }
  if (!whole.any()) throw InputError("there are no steps in it");
}
#endif

Readers all_readers() {
  Readers out = {{"urdf", urdf},
                 {"rig", rig},
                 {"samples", samples},
                 {"truth", truth},
                 {"result", result},
                 {"calibration", calibration},
                 {"foreign", foreign},
                 {"poses", poses},
                 {"mjcf", mjcf},
                 {"dh", dh},
                 {"kinematics", kinematics},
                 {"lerobot", lerobot}};
#ifdef KINCAL_FUZZ_IMAGES
  out.emplace("jpeg", jpeg);
#endif
#ifdef KINCAL_FUZZ_BAGS
  out.merge(bag_readers());
#endif
  return out;
}

}  // namespace

std::string in_file(const std::string& name, const std::string& text) {
  std::ofstream(path_of(name), std::ios::binary) << text;
  return path_of(name);
}

const RigFile& usual_rig() {
  static const RigFile rig = read_rig(path_of("rig.yaml"));
  return rig;
}

bool is_read(const std::string& text) {
  static const char* const name = std::getenv("KINCAL_READER");
  static const auto reader = all_readers().at(name ? name : "");
  try {
    reader(text);
    return true;
  } catch (const InputError&) {
  } catch (const std::invalid_argument&) {
  }
  return false;
}

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, size_t size) {
  is_read(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
