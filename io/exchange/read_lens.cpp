#include "read_lens.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "../document/document.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "../rig/types.h"
#include "foreign.h"

namespace kincal {
namespace {

constexpr char kKnownLenses[] =
    "valid: plumb_bob (k1 k2 p1 p2 k3), rational_polynomial (k1 k2 p1 p2 k3 k4 k5 k6), "
    "equidistant (k1 k2 k3 k4)";

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
    field.fail("all 0: this camera is not calibrated; run its calibration first");
  if (!(m[0] > 0) || !(m[c + 1] > 0) || m[c] != 0 || m[2 * c] != 0 || m[2 * c + 1] != 0 ||
      m[2 * c + 2] != 1)
    field.fail("[fx 0 cx; 0 fy cy; 0 0 1] is expected, fx and fy greater than 0");
  if (std::abs(m[1]) > 1e-9 * m[0])
    field.fail("has a skew of " + shortest(m[1]) + " px, which kincal's cameras do not have");
  return {m[0], m[c + 1], m[2], m[c + 2]};
}

/// Distortion of OpenCV's order into a lens; what OpenCV has beyond eight numbers must be 0.
void set_brown_conrady(const Field& field, std::vector<double> d, LensNumbers& lens) {
  for (size_t i = 8; i < d.size(); ++i)
    if (d[i] != 0)
      field.fail("number " + std::to_string(i + 1) +
                 " (thin prism or tilted sensor) is not 0; kincal has k1 k2 p1 p2 k3 k4 k5 k6");
  if (d.size() > 8) d.resize(8);
  if (d.empty()) return;  // a pinhole
  if (d.size() == 4) d.push_back(0);
  if (d.size() != 5 && d.size() != 8)
    field.fail("4, 5, 8, 12 or 14 numbers are expected (k1 k2 p1 p2 [k3 [k4 k5 k6]]), not " +
               std::to_string(d.size()));
  lens.model = "brown_conrady";
  lens.distortion = d;
}

void set_kannala_brandt(const Field& field, const std::vector<double>& d, LensNumbers& lens) {
  if (d.size() != 4)
    field.fail("4 numbers are expected (k1 k2 k3 k4), not " + std::to_string(d.size()));
  lens.model = "kannala_brandt";
  lens.distortion = d;
}

void read_size(const Field& width, const Field& height, LensNumbers& lens) {
  constexpr int kMost = 1'000'000;
  lens.width = width.integer(0, kMost);
  lens.height = height.integer(0, kMost);
  if (lens.width == 0 || lens.height == 0) lens.width = lens.height = 0;  // unknown
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
        "R and P are of the rectified images and were not taken: K and D are those of the raw "
        "ones. If yours are rectified, take --rectified");
    return;
  }
  const double baseline = m[3] == 0 ? 0 : -m[3] / m[0];
  if (!std::isfinite(baseline)) p->fail("its Tx is too large for its fx");
  lens.baseline = baseline;
  if (baseline != 0)
    notes.push_back("baseline " + shortest(baseline) +
                    " is from P: such a camera's link is that of the left camera of its pair. If "
                    "it has a link of its own, take the key `baseline` away");
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
        "binning or a region of interest is set: the numbers are of the whole image of full "
        "resolution; use images of that");
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
    file.fail("no camera in this file; valid: " + comma_separated(matrices) +
              " (ROS, OpenCV), cam0 (Kalibr)");
  LensNumbers lens;
  lens.intrinsics = intrinsics_of(*k, entries_of(*k), 3);
  if (file.has("camera_name")) lens.name = file["camera_name"].string();
  const std::optional<Field> width = first_of(file, {"image_width", "image_Width", "width"}),
                             height = first_of(file, {"image_height", "image_Height", "height"});
  if (width && height) read_size(*width, *height, lens);
  const std::optional<Field> d =
      first_of(file, one.empty() ? Names{"distortion_coefficients", "Distortion_Coefficients",
                                         "distCoeffs", "dist_coeffs", "distortion", "D", "d"}
                                 : Names{"D" + one, "distCoeffs" + one});
  const std::vector<double> distortion =
      d && d->node->kind != Node::Kind::null ? entries_of(*d) : std::vector<double>{};
  bool fisheye = choice.fisheye;
  if (file.has("fisheye_model")) fisheye |= file["fisheye_model"].number() != 0;
  const bool named = file.has("distortion_model") && !file["distortion_model"].string().empty();
  if (named) {
    const std::string model = file["distortion_model"].string();
    fisheye |= model == "equidistant" || model == "fisheye" || model == "kannala_brandt";
    const Names known = {"plumb_bob",      "rational_polynomial", "equidistant", "fisheye",
                         "kannala_brandt", "brown_conrady",       "rectified",   "none",
                         "pinhole"};
    if (std::find(known.begin(), known.end(), model) == known.end())
      file["distortion_model"].fail("'" + model + "' is no lens that kincal has; " + kKnownLenses);
  }
  if (d && fisheye)
    set_kannala_brandt(*d, distortion, lens);
  else if (d)
    set_brown_conrady(*d, distortion, lens);
  note_smaller_images(file, notes);
  if (named || choice.rectified) read_projection(file, choice, lens, notes);
  return lens;
}

// ------------------------------------------------------------------------------------------------
// Kalibr
bool is_kalibr(const Field& file) {
  return std::any_of(file.node->members.begin(), file.node->members.end(), [](const auto& m) {
    return m.second.kind == Node::Kind::mapping && m.second.find("camera_model");
  });
}

LensNumbers read_camchain(const Field& file, const LensChoice& choice,
                          std::vector<std::string>& notes) {
  Names cameras;
  for (const auto& member : file.members())
    if (member.second.find("camera_model")) cameras.push_back(member.first);
  if (choice.camera.empty() && cameras.size() > 1)
    file.fail("has several cameras: take --camera NAME with one of " + comma_separated(cameras));
  const std::string name = choice.camera.empty() ? cameras[0] : choice.camera;
  if (std::find(cameras.begin(), cameras.end(), name) == cameras.end())
    file.fail("there is no camera '" + name + "'; valid: " + comma_separated(cameras));
  const Field camera = file[name];
  const std::string model = camera["camera_model"].string();
  if (model != "pinhole")
    camera["camera_model"].fail(
        "'" + model +
        "' is no lens that kincal has; valid: pinhole, with distortion_model radtan, equidistant "
        "or none. Calibrate this camera again as pinhole-equi (up to about 180 degrees wide)");
  LensNumbers lens;
  lens.name = name;
  lens.intrinsics = camera["intrinsics"].vector(4);
  for (size_t i = 0; i < 2; ++i) camera["intrinsics"].item(i).positive();
  if (camera.has("resolution")) {
    camera["resolution"].vector(2);
    read_size(camera["resolution"].item(0), camera["resolution"].item(1), lens);
  }
  const std::string distortion = camera["distortion_model"].string();
  if (distortion == "radtan")
    set_brown_conrady(camera["distortion_coeffs"], camera["distortion_coeffs"].vector(4), lens);
  else if (distortion == "equidistant" || distortion == "equi")
    set_kannala_brandt(camera["distortion_coeffs"], camera["distortion_coeffs"].vector(), lens);
  else if (distortion != "none")
    camera["distortion_model"].fail("'" + distortion +
                                    "' is no lens that kincal has; valid: radtan, equidistant, "
                                    "none. Calibrate this camera again as pinhole-equi");
  for (const char* key : {"T_cn_cnm1", "T_cam_imu"})
    if (camera.has(key))
      notes.push_back(std::string(key) +
                      " was not taken: where the cameras are is for the calibration to find");
  return lens;
}

}  // namespace

LensNumbers read_lens(const std::string& path, const LensChoice& choice,
                      std::vector<std::string>& notes) {
  const Node node = read_foreign(path);
  const Field file = top(node, path);
  file.members();
  if (file.has("target_type"))
    file.fail("this is a target of Kalibr's, no camera: take --target NAME");
  return is_kalibr(file) ? read_camchain(file, choice, notes) : read_matrices(file, choice, notes);
}

}  // namespace kincal
