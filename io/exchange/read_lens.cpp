#include "read_lens.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "../../models/rig/numbers.h"
#include "../../models/sensors/sensors.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "../rig/types.h"
#include "foreign.h"
#include "lens_fields.h"
#include "program_lenses.h"

namespace kincal {
namespace {

constexpr char kKnownLenses[] =
    "valid: plumb_bob (k1 k2 p1 p2 k3), rational_polynomial (k1 k2 p1 p2 k3 k4 k5 k6), "
    "equidistant or fisheye (k1 k2 k3 k4). Calibrate this camera again with one of them (`kincal "
    "intrinsics` does it from views of a board)";

/// The first of these keys that is there.
std::optional<Field> first_of(const Field& field, const Names& keys) {
  for (const std::string& key : keys)
    if (field.has(key)) return field[key];
  return std::nullopt;
}

/// The numbers of a matrix however it is written: {rows, cols, data}, rows in a list, or all in
/// one list.
std::vector<double> entries_of(const Field& field) {
  if (field.node->kind == Node::Kind::mapping) {
    const std::vector<double> data = entries_of(field["data"]);
    const int most = 1'000'000;
    if (field.has("rows") && field.has("cols") &&
        static_cast<double>(field["rows"].integer(0, most)) * field["cols"].integer(0, most) !=
            static_cast<double>(data.size()))
      field["data"].fail("as many numbers as rows x cols are expected, not " +
                         std::to_string(data.size()));
    return data;
  }
  if (field.node->kind == Node::Kind::scalar) return {field.number()};
  if (field.size() == 0 || field.item(0).node->kind != Node::Kind::sequence) return field.vector();
  std::vector<double> out;
  for (size_t i = 0; i < field.size(); ++i)
    for (double v : field.item(i).vector()) out.push_back(v);
  return out;
}

/// fx fy cx cy of the left 3 x 3 of a matrix with `columns` columns.
std::vector<double> intrinsics_of(const Field& field, const std::vector<double>& m, int columns) {
  const size_t c = columns;
  if (m.size() != 3 * c)
    field.fail(std::to_string(3 * c) + " numbers of a matrix 3 x " + std::to_string(columns) +
               " are expected, not " + std::to_string(m.size()));
  if (m[0] == 0 && m[c + 1] == 0)
    field.fail(
        "all 0: this camera is not calibrated. Run its calibration first (`kincal intrinsics` does "
        "it from views of a board)");
  if (m[0] < 0 || m[c + 1] < 0)
    field.fail(
        "a negative focal length means that the image is mirrored: mirror it back, and use the "
        "positive value, with cx as width - 1 - cx (or cy likewise)");
  if (!(m[0] > 0) || !(m[c + 1] > 0) || m[c] != 0 || m[2 * c] != 0 || m[2 * c + 1] != 0 ||
      m[2 * c + 2] != 1)
    field.fail("[fx 0 cx; 0 fy cy; 0 0 1] is expected, fx and fy greater than 0");
  if (std::abs(m[1]) > 1e-9 * m[0])
    field.fail("has a skew of " + shortest(m[1]) +
               " px, which kincal's camera models do not have. Calibrate this camera again without "
               "it (OpenCV's fisheye: CALIB_FIX_SKEW; `kincal intrinsics`), or write 0 instead and "
               "estimate the lens in the calibration");
  return {m[0], m[c + 1], m[2], m[c + 2]};
}

bool is_identity(const std::vector<double>& m) {
  for (size_t i = 0; i < m.size(); ++i)
    if (std::abs(m[i] - (i % 4 == 0 ? 1 : 0)) > 1e-12) return false;
  return m.size() == 9;
}

// ------------------------------------------------------------------------------------------------
// ROS and OpenCV
/// P and R of a camera_info. The right camera of a pair has its baseline in P; where R turns, K and
/// D are of a camera that stands turned, beside the frame that P belongs to.
void read_projection(const Field& file, const LensChoice& choice, LensNumbers& lens,
                     std::vector<std::string>& notes) {
  const std::optional<Field> p = first_of(file, {"projection_matrix", "P", "p"});
  if (!p) {
    if (choice.rectified)
      file.fail("there is no projection_matrix (P), which rectified images need");
    return;
  }
  const std::vector<double> m = entries_of(*p);
  if (choice.rectified) {
    lens.model = "pinhole";
    lens.distortion.clear();
    lens.intrinsics = intrinsics_of(*p, m, 4);
  }
  if (m.size() != 12 || !(m[0] > 0)) return;  // not filled in
  const std::optional<Field> r = first_of(file, {"rectification_matrix", "R", "r"});
  const std::vector<double> turn = r ? entries_of(*r) : std::vector<double>{};
  const bool turned =
      !is_identity(turn) && std::any_of(turn.begin(), turn.end(), [](double v) { return v != 0; });
  if (turned && !choice.rectified) {
    notes.emplace_back(
        "R and P are for rectified images and were not used: K and D are those of the raw "
        "ones. If yours are rectified, use --rectified");
    return;
  }
  const double baseline = m[3] == 0 ? 0 : -m[3] / m[0];
  if (!std::isfinite(baseline)) p->fail("its Tx is too large for its fx");
  lens.baseline = baseline;
  if (baseline < 0)
    notes.push_back("baseline " + shortest(baseline) +
                    " is from P, and negative: then this camera stands to the left of the "
                    "reference camera of its pair. For a right camera the fourth value of P is "
                    "negative, -fx * baseline: change its sign if it is wrong");
  if (baseline != 0)
    notes.push_back("baseline " + shortest(baseline) +
                    " is from P: the link of this camera must be that of the left camera of its "
                    "pair. If it has its own link, delete the key `baseline`");
}

/// What a message of ROS says of the images that were sent, not of the camera.
void note_smaller_images(const Field& file, std::vector<std::string>& notes) {
  const auto above = [](const std::optional<Field>& field, int most) {
    double value = 0;
    return field && read_number(field->node->text, value) && value > most;
  };
  const std::optional<Field> roi = first_of(file, {"roi"});
  if (above(first_of(file, {"binning_x"}), 1) || above(first_of(file, {"binning_y"}), 1) ||
      (roi && above(first_of(*roi, {"width"}), 0)))
    notes.emplace_back(
        "binning or a region of interest is set: the values are for the whole image at full "
        "resolution; use such images");
}

/// The lens that the file names; none: it names none. @throws InputError: one that kincal lacks
std::optional<Field> model_of(const Field& file) {
  static const Names kKnown = {
      "plumb_bob",     "rational_polynomial", "equidistant", "fisheye", "kannala_brandt",
      "brown_conrady", "rectified",           "none",        "pinhole", "unified",
      "double_sphere"};
  const std::optional<Field> field = first_of(file, {"distortion_model", "camera_model"});
  if (!field || field->string().empty()) return std::nullopt;
  if (std::find(kKnown.begin(), kKnown.end(), field->string()) == kKnown.end())
    field->fail("'" + field->string() + "' is not a lens model of kincal; " + kKnownLenses);
  return field;
}

/// A lens that only recordings of kincal name; null: another.
const LensType* find_own_lens(const std::string& model) {
  for (const LensType& type : lens_types())
    if (type.name == model && !type.plain.empty()) return &type;
  return nullptr;
}

void set_own_lens(const Field& field, const LensType& type, const std::vector<double>& d,
                  LensNumbers& lens) {
  if (d.size() != type.numbers.size())
    field.fail(std::to_string(type.numbers.size()) + " numbers are expected (" +
               comma_separated(type.numbers) + "), not " + std::to_string(d.size()));
  lens.model = type.name;
  lens.distortion = d;
}

LensNumbers read_matrices(const Field& file, const LensChoice& choice,
                          std::vector<std::string>& notes) {
  const std::string& one = choice.camera;
  const Names matrices =
      one.empty()
          ? Names{"camera_matrix",   "Camera_Matrix", "cameraMatrix", "CameraMatrix", "K", "k",
                  "intrinsic_matrix"}
          : Names{"M" + one, "K" + one, "cameraMatrix" + one};
  const std::optional<Field> k = first_of(file, matrices);
  if (!k && one.empty() && (file.has("M1") || file.has("K1") || file.has("cameraMatrix1")))
    file.fail("these are the cameras of a stereo pair: take --camera 1 or --camera 2");
  if (!k)
    file.fail(
        "no camera in this file; valid: " + comma_separated(matrices) +
        " (ROS, OpenCV), cam0 (Kalibr), model_type (VINS), lensmodel (mrcal), value0 (Basalt)");
  LensNumbers lens;
  lens.intrinsics = intrinsics_of(*k, entries_of(*k), 3);
  if (file.has("camera_name")) lens.name = file["camera_name"].string();
  const std::optional<Field> width = first_of(file,
                                              {"image_width", "image_Width", "img_width", "width"}),
                             height = first_of(
                                 file, {"image_height", "image_Height", "img_height", "height"});
  if (width && height) read_size(*width, *height, lens);
  const std::optional<Field> d = first_of(
      file, one.empty() ? Names{"distortion_coefficients", "Distortion_Coefficients", "distCoeffs",
                                "dist_coeffs", "distortion", "distortion_vector", "D", "d"}
                        : Names{"D" + one, "distCoeffs" + one});
  const std::vector<double> distortion =
      d && d->node->kind != Node::Kind::null ? entries_of(*d) : std::vector<double>{};
  bool fisheye = choice.fisheye;
  if (file.has("fisheye_model")) fisheye |= file["fisheye_model"].number() != 0;
  if (file.has("distortion_type"))  // of MC-Calib
    fisheye |= file["distortion_type"].integer(0, 1) == 1;
  const std::optional<Field> named = model_of(file);
  const std::string model = named ? named->string() : "";
  fisheye |= model == "equidistant" || model == "fisheye" || model == "kannala_brandt";
  const LensType* own = find_own_lens(model);
  if (d && fisheye)
    set_kannala_brandt(*d, distortion, lens);
  else if (d && own)
    set_own_lens(*d, *own, distortion, lens);
  else if (d)
    set_brown_conrady(*d, distortion, lens);
  note_smaller_images(file, notes);
  if (named || choice.rectified) read_projection(file, choice, lens, notes);
  return lens;
}

/// Cameras of one file by their names (MC-Calib, ost.txt of several).
bool is_camera(const Node& node) {
  return node.kind == Node::Kind::mapping && node.find("camera_matrix");
}

LensNumbers read_one_of(const Field& file, const LensChoice& choice,
                        std::vector<std::string>& notes) {
  Names cameras;
  for (const auto& member : file.members())
    if (is_camera(member.second)) cameras.push_back(member.first);
  if (cameras.empty()) return read_matrices(file, choice, notes);
  const std::string name = chosen_camera(file, cameras, choice.camera);
  LensChoice rest = choice;
  rest.camera.clear();
  LensNumbers lens = read_matrices(file[name], rest, notes);
  lens.name = name;
  if (file[name].has("camera_pose_matrix")) notes.push_back(pose_not_taken("camera_pose_matrix"));
  return lens;
}

// ------------------------------------------------------------------------------------------------
/// Where a lens turns back: further from the axis its image comes nearer to the middle again.
struct TurningPoint {
  double angle;   // rad, from the axis
  double pixels;  // from the principal point, along the larger side
};

/// The turning point on the way to the image's corners; none: it has none, or the size is unknown.
std::optional<TurningPoint> turning_point(const LensNumbers& lens) {
  constexpr int kSteps = 720;  // of half a turn
  if (lens.width == 0 || lens.distortion.empty()) return std::nullopt;
  const auto count = static_cast<int>(lens.distortion.size());
  const auto type = std::find_if(lens_types().begin(), lens_types().end(),
                                 [&](const LensType& t) { return t.name == lens.model; });
  const std::shared_ptr<const SensorModel> camera = make_camera(type->lens, count);
  std::vector<double> numbers = {1, 1, 0, 0};
  numbers.insert(numbers.end(), lens.distortion.begin(), lens.distortion.end());
  numbers.push_back(0);
  const std::vector<double>& f = lens.intrinsics;
  std::optional<TurningPoint> found;
  for (int corner = 0; corner < 4; ++corner) {
    const Eigen::Vector2d to(((corner % 2 ? lens.width - 0.5 : -0.5) - f[2]) / f[0],
                             ((corner / 2 ? lens.height - 0.5 : -0.5) - f[3]) / f[1]);
    double before = 0;
    for (int i = 1; i < kSteps && before < to.norm(); ++i) {
      const double angle = i * kPi / kSteps;
      Eigen::Matrix3Xd point(3, 1);
      point << std::sin(angle) * to / to.norm(), std::cos(angle);
      const int id = 0;
      const double none[2] = {0, 0};
      ViewInput in;
      in.parameters = numbers.data();
      in.points = &point;
      in.ids = &id;
      in.count = 1;
      in.z = none;
      Eigen::Vector2d image;
      if (!camera->evaluate(in, Columns(), image.data(), nullptr)) break;
      if (image.norm() < before) {
        if (!found || angle < found->angle)
          found = TurningPoint{angle, before * std::max(f[0], f[1])};
        break;
      }
      before = image.norm();
    }
  }
  return found;
}

void note_turning_point(const LensNumbers& lens, std::vector<std::string>& notes) {
  const std::optional<TurningPoint> turn = turning_point(lens);
  if (!turn) return;
  // The corners of a fisheye that sees sideways are black.
  const std::vector<double>& f = lens.intrinsics;
  if (turn->angle > kPi / 2 &&
      turn->pixels > std::max({f[2], f[3], lens.width - f[2], lens.height - f[3]}))
    return;
  char text[200];
  std::snprintf(
      text, sizeof text,
      "this lens turns back inside of the image, %.0f degrees from its axis (%.0f px from "
      "the principal point): ",
      turn->angle * 180 / kPi, turn->pixels);
  notes.push_back(std::string(text) +
                  "it is not valid beyond. Calibrate it again with views that reach the image's "
                  "corners, or estimate its distortion");
}

}  // namespace

LensNumbers read_lens(const std::string& path, const LensChoice& choice,
                      std::vector<std::string>& notes) {
  const Node node = read_foreign(path);
  const Field file = top(node, path);
  file.members();
  if (file.has("target_type"))
    file.fail("this is a Kalibr target file, not a camera file: use --target NAME");
  std::optional<LensNumbers> lens = read_program_lens(file, choice.camera, notes);
  if (!lens) lens = read_one_of(file, choice, notes);
  note_turning_point(*lens, notes);
  return *lens;
}

}  // namespace kincal
