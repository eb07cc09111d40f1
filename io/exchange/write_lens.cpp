#include "write_lens.h"

#include "../document/error.h"
#include "../document/numbers.h"
#include "../document/yaml.h"

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

/// k1 k2 p1 p2 of a lens of Kalibr's; more numbers must be 0.
std::vector<double> radtan(const LensNumbers& lens) {
  std::vector<double> d = plumb_bob(lens);
  for (size_t i = 4; i < d.size(); ++i)
    if (d[i] != 0)
      throw InputError("sensors." + lens.name + ": Kalibr's radtan has k1 k2 p1 p2 only, and k" +
                       std::to_string(i - 1) +
                       " is not 0. Calibrate with it held at 0 (--fix 'sensor/" + lens.name +
                       "/distortion.k" + std::to_string(i - 1) + "'), or use --as opencv");
  d.resize(4);
  return d;
}

}  // namespace

std::string camera_info_text(const LensNumbers& lens) {
  need_size(lens, "camera_info");
  const std::vector<double>& f = lens.intrinsics;
  const std::vector<double> d = plumb_bob(lens);
  return "image_width: " + std::to_string(lens.width) +
         "\nimage_height: " + std::to_string(lens.height) +
         "\ncamera_name: " + yaml_text(lens.name) + "\n" +
         matrix_block("camera_matrix", 3, camera_matrix(lens)) + "distortion_model: " +
         (lens.model == "kannala_brandt" ? "equidistant"
          : d.size() == 8                ? "rational_polynomial"
                                         : "plumb_bob") +
         "\n" + matrix_block("distortion_coefficients", 1, d) +
         matrix_block("rectification_matrix", 3, {1, 0, 0, 0, 1, 0, 0, 0, 1}) +
         matrix_block(
             "projection_matrix", 3,
             {f[0], 0, f[2], -f[0] * lens.baseline.value_or(0), 0, f[1], f[3], 0, 0, 0, 1, 0});
}

std::string opencv_text(const LensNumbers& lens, std::vector<std::string>& notes) {
  if (lens.baseline.value_or(0) != 0)
    notes.push_back("sensors." + lens.name +
                    ".baseline is not in OpenCV's file (--as camera_info has it, in P)");
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
    const bool fisheye = lens.model == "kannala_brandt";
    out += "  camera_model: pinhole\n  intrinsics: " + real_list(lens.intrinsics) +
           "\n  distortion_model: " + (fisheye ? "equidistant" : "radtan") +
           "\n  distortion_coeffs: " + real_list(fisheye ? lens.distortion : radtan(lens)) +
           "\n  resolution: [" + std::to_string(lens.width) + ", " + std::to_string(lens.height) +
           "]\n  rostopic: " + yaml_text("/" + lens.name + "/image_raw") + "\n";
  }
  return out;
}

}  // namespace kincal
