#include "write_lens.h"

#include "../../models/sensors/sensors.h"
#include "../document/error.h"
#include "../document/numbers.h"
#include "../document/yaml.h"
#include "../rig/types.h"

namespace kincal {
namespace {

std::vector<double> camera_matrix(const LensNumbers& lens) {
  const std::vector<double>& f = lens.intrinsics;
  return {f[0], 0, f[2], 0, f[1], f[3], 0, 0, 1};
}

std::string real_list(const std::vector<double>& numbers) {
  std::string out;
  for (double v : numbers) out += (out.empty() ? "" : ", ") + real_text(v);
  return "[" + out + "]";
}

void need_size(const LensNumbers& lens, const char* format) {
  if (lens.width == 0)
    throw InputError("sensors." + lens.name + ": without image_size: [WIDTH, HEIGHT] there is no " +
                     format + "; write it into the rig.yaml");
}

std::string matrix_block(const std::string& name, int rows, const std::vector<double>& data) {
  return name + ":\n  rows: " + std::to_string(rows) +
         "\n  cols: " + std::to_string(data.size() / rows) + "\n  data: " + real_list(data) + "\n";
}

std::string opencv_matrix(const std::string& name, int rows, const std::vector<double>& data) {
  return name + ": !!opencv-matrix\n   rows: " + std::to_string(rows) +
         "\n   cols: " + std::to_string(data.size() / rows) +
         "\n   dt: d\n   data: " + real_list(data) + "\n";
}

std::vector<double> plumb_bob(const LensNumbers& lens) {
  return lens.distortion.empty() ? std::vector<double>(5, 0.0) : lens.distortion;
}

/// @throws InputError: a lens that a format does not have, with those that do
void refuse_lens(const LensNumbers& lens, const std::string& format, const std::string& cure) {
  throw InputError("sensors." + lens.name + ": " + format + " has no lens " + lens.model +
                   (lens.distortion.empty()
                        ? ""
                        : " with " + std::to_string(lens.distortion.size()) + " numbers") +
                   "; " + cure);
}

bool is_sphere_lens(const LensNumbers& lens) {
  return lens.model == "unified" || lens.model == "double_sphere";
}

/// k1 k2 p1 p2 of a lens of Kalibr's; more numbers must be 0.
std::vector<double> radtan(const LensNumbers& lens) {
  std::vector<double> d = plumb_bob(lens);
  for (size_t i = 4; i < d.size(); ++i)
    if (d[i] != 0) {
      const std::string& number = lens_type(Lens::brown_conrady).numbers[i];
      throw InputError("sensors." + lens.name + ": Kalibr's radtan has k1 k2 p1 p2 only, and " +
                       number + " is not 0. Calibrate with it fixed at 0 (--fix 'sensor/" +
                       lens.name + "/distortion." + number + "'), or use --as opencv");
    }
  d.resize(4);
  return d;
}

struct KalibrLens {
  std::string model;  // of the camera
  std::vector<double> intrinsics;
  std::string distortion_model;
  std::vector<double> distortion;
};

/// xi, and alpha, stand before fx in Kalibr's intrinsics.
KalibrLens kalibr_lens(const LensNumbers& lens) {
  const std::vector<double>& d = lens.distortion;
  if (lens.model == "kannala_brandt") return {"pinhole", lens.intrinsics, "equidistant", d};
  if (!is_sphere_lens(lens)) return {"pinhole", lens.intrinsics, "radtan", radtan(lens)};
  const bool unified = lens.model == "unified";
  std::vector<double> first(d.begin(), d.begin() + (unified ? 1 : 2));
  const std::vector<double> rest(d.begin() + static_cast<int>(first.size()), d.end());
  first.insert(first.end(), lens.intrinsics.begin(), lens.intrinsics.end());
  return {unified ? "omni" : "ds", first, unified ? "radtan" : "none", rest};
}

}  // namespace

std::string camera_info_text(const LensNumbers& lens) {
  need_size(lens, "camera_info");
  if (is_sphere_lens(lens)) refuse_lens(lens, "ROS's camera_info", "use --as kalibr");
  if (lens.distortion.size() > 8) refuse_lens(lens, "ROS's camera_info", "use --as opencv");
  const std::vector<double>& f = lens.intrinsics;
  const std::vector<double> d = plumb_bob(lens);
  return "image_width: " + std::to_string(lens.width) +
         "\nimage_height: " + std::to_string(lens.height) +
         "\ncamera_name: " + yaml_text(lens.name) + "\n" +
         matrix_block("camera_matrix", 3, camera_matrix(lens)) +
         "distortion_model: " + ros_lens(lens.model, d.size()) + "\n" +
         matrix_block("distortion_coefficients", 1, d) +
         matrix_block("rectification_matrix", 3, {1, 0, 0, 0, 1, 0, 0, 0, 1}) +
         matrix_block(
             "projection_matrix", 3,
             {f[0], 0, f[2], -f[0] * lens.baseline.value_or(0), 0, f[1], f[3], 0, 0, 0, 1, 0});
}

std::string opencv_text(const LensNumbers& lens, std::vector<std::string>& notes) {
  if (lens.baseline.value_or(0) != 0)
    notes.push_back("sensors." + lens.name +
                    ".baseline is not in OpenCV's file (--as camera_info has it, in P)");
  if (is_sphere_lens(lens)) refuse_lens(lens, "OpenCV's file", "use --as kalibr");
  std::string out = "%YAML:1.0\n---\n";
  if (lens.width > 0)
    out += "image_width: " + std::to_string(lens.width) +
           "\nimage_height: " + std::to_string(lens.height) + "\n";
  const bool fisheye = lens.model == "kannala_brandt";
  const std::vector<double> d = plumb_bob(lens);
  return out + "camera_name: " + yaml_text(lens.name) +
         "\nfisheye_model: " + (fisheye ? "1" : "0") + "\n" +
         opencv_matrix("camera_matrix", 3, camera_matrix(lens)) +
         opencv_matrix("distortion_coefficients", static_cast<int>(d.size()), d);
}

std::string kalibr_text(const std::vector<LensNumbers>& lenses,
                        const std::vector<std::optional<Pose>>& before) {
  std::string out;
  for (size_t i = 0; i < lenses.size(); ++i) {
    const LensNumbers& lens = lenses[i];
    need_size(lens, "camchain of Kalibr's");
    out += "cam" + std::to_string(i) + ":   # " + yaml_text(lens.name) + "\n";
    if (before[i]) {
      out += "  T_cn_cnm1:\n";
      const Pose& pose = *before[i];
      for (int r = 0; r < 3; ++r)
        out += "  - " +
               real_list({pose.rotation(r, 0), pose.rotation(r, 1), pose.rotation(r, 2),
                          pose.translation(r)}) +
               "\n";
      out += "  - [0.0, 0.0, 0.0, 1.0]\n";
    }
    const KalibrLens kalibr = kalibr_lens(lens);
    out += "  camera_model: " + kalibr.model + "\n  intrinsics: " + real_list(kalibr.intrinsics) +
           "\n  distortion_model: " + kalibr.distortion_model +
           "\n  distortion_coeffs: " + real_list(kalibr.distortion) + "\n  resolution: [" +
           std::to_string(lens.width) + ", " + std::to_string(lens.height) +
           "]\n  rostopic: " + yaml_text("/" + lens.name + "/image_raw") + "\n";
  }
  return out;
}

}  // namespace kincal
