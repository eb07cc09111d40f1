#include "program_lenses.h"

#include <algorithm>

#include "../document/names.h"
#include "lens_fields.h"

namespace kincal {
namespace {

using Names = std::vector<std::string>;

constexpr char kAgain[] =
    "Calibrate this camera again with a lens that kincal has (`kincal intrinsics` does it from "
    "views of a board)";

/// The numbers of these keys.
std::vector<double> numbers_of(const Field& field, const Names& keys) {
  std::vector<double> out;
  for (const std::string& key : keys) out.push_back(field[key].number());
  return out;
}

/// fx fy cx cy by these keys.
void set_intrinsics(const Field& field, const Names& keys, LensNumbers& lens) {
  lens.intrinsics = numbers_of(field, keys);
  for (size_t i = 0; i < 2; ++i) field[keys[i]].positive();
}

[[noreturn]] void refuse_model(const Field& field, const std::string& program,
                               const std::string& valid, const std::string& cure) {
  field.fail("'" + field.string() + "' is not a lens model of kincal; valid of " + program + ": " +
             valid + ". " + cure);
}

// ------------------------------------------------------------------------------------------------
// VINS (camodocal): model_type, with the numbers of its lens in mappings
LensNumbers read_vins(const Field& file) {
  LensNumbers lens;
  const std::string model = file["model_type"].string();
  if (file.has("camera_name")) lens.name = file["camera_name"].string();
  if (file.has("image_width")) read_size(file["image_width"], file["image_height"], lens);
  const auto radtan = [&] {
    return numbers_of(file["distortion_parameters"], {"k1", "k2", "p1", "p2"});
  };
  if (model == "PINHOLE") {
    set_intrinsics(file["projection_parameters"], {"fx", "fy", "cx", "cy"}, lens);
    set_brown_conrady(file["distortion_parameters"], radtan(), lens);
  } else if (model == "PINHOLE_FULL") {
    set_intrinsics(file["projection_parameters"], {"fx", "fy", "cx", "cy"}, lens);
    const Field d = file["distortion_parameters"];
    set_brown_conrady(d, numbers_of(d, {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}), lens);
  } else if (model == "MEI") {
    set_intrinsics(file["projection_parameters"], {"gamma1", "gamma2", "u0", "v0"}, lens);
    lens.model = "unified";
    lens.distortion = radtan();
    lens.distortion.insert(lens.distortion.begin(), file["mirror_parameters"]["xi"].number());
  } else if (model == "KANNALA_BRANDT") {
    // Numbered by the powers of the angle: k2 is the factor of its third one.
    const Field numbers = file["projection_parameters"];
    set_intrinsics(numbers, {"mu", "mv", "u0", "v0"}, lens);
    set_kannala_brandt(numbers, numbers_of(numbers, {"k2", "k3", "k4", "k5"}), lens);
  } else {
    refuse_model(file["model_type"], "VINS", "PINHOLE, PINHOLE_FULL, MEI, KANNALA_BRANDT", kAgain);
  }
  return lens;
}

// ------------------------------------------------------------------------------------------------
// Basalt: {"value0": {"intrinsics": [{"camera_type": ..., "intrinsics": {...}}], "resolution":
// ...}}
LensNumbers read_basalt(const Field& calibration, const std::string& wanted, Names& notes) {
  const Field all = calibration["intrinsics"];
  Names cameras;
  for (size_t i = 0; i < all.size(); ++i) cameras.push_back("cam" + std::to_string(i));
  LensNumbers lens;
  lens.name = chosen_camera(calibration, cameras, wanted);
  const auto index =
      static_cast<size_t>(std::find(cameras.begin(), cameras.end(), lens.name) - cameras.begin());
  const Field camera = all.item(index), numbers = camera["intrinsics"];
  const std::string type = camera["camera_type"].string();
  if (calibration.has("resolution") && index < calibration["resolution"].size()) {
    const Field size = calibration["resolution"].item(index);
    size.vector(2);
    read_size(size.item(0), size.item(1), lens);
  }
  set_intrinsics(numbers, {"fx", "fy", "cx", "cy"}, lens);
  if (type == "kb4") {
    set_kannala_brandt(numbers, numbers_of(numbers, {"k1", "k2", "k3", "k4"}), lens);
  } else if (type == "ds") {
    lens.model = "double_sphere";
    lens.distortion = numbers_of(numbers, {"xi", "alpha"});
  } else if (type == "ucm") {  // by alpha = xi / (1 + xi)
    const double alpha = numbers["alpha"].number();
    if (!(alpha >= 0 && alpha < 1)) numbers["alpha"].fail("a number from 0 to below 1 is expected");
    lens.model = "unified";
    lens.distortion = {alpha / (1 - alpha), 0, 0, 0, 0};
    for (size_t i = 0; i < 2; ++i) lens.intrinsics[i] /= 1 - alpha;
  } else if (type == "pinhole-radtan8") {
    set_brown_conrady(numbers,
                      numbers_of(numbers, {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}), lens);
  } else if (type != "pinhole") {
    refuse_model(camera["camera_type"], "Basalt", "pinhole, pinhole-radtan8, kb4, ds, ucm",
                 "Calibrate this camera again with --cam-types ds or kb4");
  }
  if (calibration.has("T_imu_cam")) notes.push_back(pose_not_taken("T_imu_cam"));
  return lens;
}

// ------------------------------------------------------------------------------------------------
// mrcal: a dictionary with lensmodel, intrinsics (fx fy cx cy, then the distortion), imagersize
LensNumbers read_mrcal(const Field& file, Names& notes) {
  static const std::string kOpenCv = "LENSMODEL_OPENCV", kPinhole = "LENSMODEL_PINHOLE";
  const std::string model = file["lensmodel"].string();
  const Names known = {kPinhole, kOpenCv + "4", kOpenCv + "5", kOpenCv + "8", kOpenCv + "12"};
  if (std::find(known.begin(), known.end(), model) == known.end())
    refuse_model(file["lensmodel"], "mrcal", comma_separated(known),
                 "Write this camera with one of them: mrcal-convert-lensmodel " + kOpenCv + "8");
  LensNumbers lens;
  const Field field = file["intrinsics"];
  const std::vector<double> numbers = field.vector();
  const size_t wanted = 4 + (model == kPinhole ? 0 : std::stoul(model.substr(kOpenCv.size())));
  if (numbers.size() != wanted)
    field.fail(std::to_string(wanted) + " numbers are expected of " + model + ", not " +
               std::to_string(numbers.size()));
  for (size_t i = 0; i < 2; ++i) field.item(i).positive();
  lens.intrinsics.assign(numbers.begin(), numbers.begin() + 4);
  set_brown_conrady(field, {numbers.begin() + 4, numbers.end()}, lens);
  if (file.has("imagersize")) {
    file["imagersize"].vector(2);
    read_size(file["imagersize"].item(0), file["imagersize"].item(1), lens);
  }
  for (const char* key : {"extrinsics", "rt_cam_ref"})
    if (file.has(key)) {
      const std::vector<double> pose = file[key].vector();
      if (std::any_of(pose.begin(), pose.end(), [](double v) { return v != 0; }))
        notes.push_back(pose_not_taken(key));
    }
  return lens;
}

// ------------------------------------------------------------------------------------------------
// Kalibr: a camchain
bool is_camera_of_kalibr(const Node& node) {
  return node.kind == Node::Kind::mapping && node.find("camera_model");
}

/// Of several numbers of one camera, those before fx.
LensNumbers read_camchain(const Field& file, const std::string& wanted, Names& notes) {
  Names cameras;
  for (const auto& member : file.members())
    if (is_camera_of_kalibr(member.second)) cameras.push_back(member.first);
  LensNumbers lens;
  lens.name = chosen_camera(file, cameras, wanted);
  const Field camera = file[lens.name], intrinsics = camera["intrinsics"];
  const std::string model = camera["camera_model"].string();
  const std::string distortion =
      camera.has("distortion_model") ? camera["distortion_model"].string() : "none";
  const size_t before = model == "ds" ? 2 : model == "omni" ? 1 : 0;
  const std::string again = "Calibrate this camera again as " +
                            std::string(before > 0 ? model + (before == 2 ? "-none" : "-radtan")
                                                   : "pinhole-equi (up to about 180 degrees wide), "
                                                     "ds-none or omni-radtan (wider)");
  if (model != "pinhole" && before == 0)
    refuse_model(camera["camera_model"], "Kalibr",
                 "pinhole, with distortion_model radtan, equidistant or none; omni, with radtan or "
                 "none; ds",
                 again);
  const std::vector<double> numbers = intrinsics.vector(4 + static_cast<int>(before));
  for (size_t i = 0; i < 2; ++i) intrinsics.item(before + i).positive();
  lens.intrinsics.assign(numbers.begin() + static_cast<std::ptrdiff_t>(before), numbers.end());
  if (camera.has("resolution")) {
    camera["resolution"].vector(2);
    read_size(camera["resolution"].item(0), camera["resolution"].item(1), lens);
  }
  const bool radtan = distortion == "radtan", none = distortion == "none" || distortion.empty();
  if (model == "pinhole" && (distortion == "equidistant" || distortion == "equi"))
    set_kannala_brandt(camera["distortion_coeffs"], camera["distortion_coeffs"].vector(), lens);
  else if (!none && !(radtan && model != "ds"))
    refuse_model(camera["distortion_model"], "Kalibr's " + model,
                 model == "ds"     ? "none"
                 : model == "omni" ? "radtan, none"
                                   : "radtan, equidistant, none",
                 again);
  if (model == "pinhole" && radtan)
    set_brown_conrady(camera["distortion_coeffs"], camera["distortion_coeffs"].vector(4), lens);
  if (before > 0) {
    lens.model = model == "ds" ? "double_sphere" : "unified";
    lens.distortion.assign(numbers.begin(), numbers.begin() + static_cast<std::ptrdiff_t>(before));
    if (model == "omni") {
      const std::vector<double> d =
          radtan ? camera["distortion_coeffs"].vector(4) : std::vector<double>(4, 0.0);
      lens.distortion.insert(lens.distortion.end(), d.begin(), d.end());
    }
  }
  for (const char* key : {"T_cn_cnm1", "T_cam_imu"})
    if (camera.has(key)) notes.push_back(pose_not_taken(key));
  return lens;
}

// ------------------------------------------------------------------------------------------------
// rs-enumerate-devices (camera_texts.h)
LensNumbers read_realsense(const Field& camera) {
  const std::string own = "realsense ";
  LensNumbers lens;
  set_intrinsics(camera, {own + "Fx", own + "Fy", own + "PPX", own + "PPY"}, lens);
  read_size(camera[own + "Width"], camera[own + "Height"], lens);
  const Field field = camera[own + "Coeffs"];
  std::vector<double> d = field.vector();
  const std::string model = camera[own + "Distortion"].string();
  const bool straight = std::all_of(d.begin(), d.end(), [](double k) { return k == 0; });
  if (model == "Kannala Brandt4" && d.size() >= 4) {
    d.resize(4);
    set_kannala_brandt(field, d, lens);
  } else if (model == "Brown Conrady") {
    set_brown_conrady(field, d, lens);
  } else if (!straight) {  // Inverse and modified ones without any bend nothing
    refuse_model(camera[own + "Distortion"], "RealSense",
                 "Brown Conrady, Kannala Brandt4; all others with coefficients of 0", kAgain);
  }
  return lens;
}

/// Are these cameras that rs-enumerate-devices lists?
bool is_realsense(const Node& node) { return node.find("realsense Fx"); }

}  // namespace

std::optional<LensNumbers> read_program_lens(const Field& file, const std::string& wanted,
                                             Names& notes) {
  const auto any = [&](auto is) {
    const auto& members = file.node->members;
    return std::any_of(members.begin(), members.end(), [&](const auto& m) { return is(m.second); });
  };
  if (file.has("model_type")) return read_vins(file);
  if (file.has("lensmodel")) return read_mrcal(file, notes);
  if (any(is_camera_of_kalibr)) return read_camchain(file, wanted, notes);
  if (is_realsense(*file.node)) return read_realsense(file);
  if (any(is_realsense)) {
    Names cameras;
    for (const auto& member : file.members()) cameras.push_back(member.first);
    return read_realsense(file[chosen_camera(file, cameras, wanted)]);
  }
  if (!file.has("value0") || file["value0"].node->kind != Node::Kind::mapping) return std::nullopt;
  const Field calibration = file["value0"];
  if (!calibration.has("intrinsics")) return std::nullopt;
  return read_basalt(calibration, wanted, notes);
}

}  // namespace kincal
