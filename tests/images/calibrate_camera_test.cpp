// models/intrinsics/intrinsics.h beside OpenCV's calibrateCamera, on the same views.
//
// Proves: with the same lens and the same corners kincal's sum of squares is not above OpenCV's,
// and the numbers are the same to a small part of their sigmas; on simulated views always, on real
// ones (KINCAL_DATA, as the tests in Python) where they are. Not proved: sigmas
// (models/intrinsics/intrinsics_test.cpp).
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <opencv2/calib3d.hpp>

#include "../../io/rig/rig_file.h"
#include "../../io/rig/samples_file.h"
#include "../../models/intrinsics/intrinsics.h"
#include "../../models/rig/targets.h"
#include "../fixtures/random.h"
#include "../fixtures/rigs.h"
#include "catch2/catch.hpp"

namespace calibrate_camera_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// OpenCV's flags for a lens of lens_models().
int flags_of(const std::string& model) {
  using namespace cv;
  if (model == "pinhole")
    return CALIB_ZERO_TANGENT_DIST | CALIB_FIX_K1 | CALIB_FIX_K2 | CALIB_FIX_K3;
  if (model == "brown_conrady_2") return CALIB_ZERO_TANGENT_DIST | CALIB_FIX_K3;
  if (model == "brown_conrady_4") return CALIB_FIX_K3;
  return 0;
}

/// Calibrates the first camera of a rig by both, and compares. OpenCV takes corners and boards in
/// single precision: so does kincal here.
void compare_with_opencv(Rig rig, std::vector<Sample> samples, const std::string& model) {
  INFO(model);
  for (Target& target : rig.targets) {
    target.points = target_points(target).cast<float>().cast<double>();
    target.grid = false;
  }
  for (Sample& sample : samples)
    for (View& view : sample.views)
      for (double& z : view.z) z = static_cast<double>(static_cast<float>(z));
  IntrinsicsOptions options;
  options.model = model;
  const IntrinsicsResult result = *calibrate_intrinsics(rig, samples, options);
  REQUIRE(result.status == Status::converged);
  const CameraIntrinsics& camera = result.cameras[0];
  const Solution& solution = result.groups[0].solution;

  std::vector<std::vector<cv::Point3f>> objects;
  std::vector<std::vector<cv::Point2f>> images;
  for (const Sample& sample : solution.samples())
    for (const View& view : sample.views) {
      const Target& target = solution.rig().targets[view.target];
      const Matrix3Xd points = target_points(target);
      objects.emplace_back();
      images.emplace_back();
      for (int id : view_ids(view, target))
        objects.back().emplace_back(points(0, id), points(1, id), points(2, id));
      for (size_t k = 0; k + 1 < view.z.size(); k += 2)
        images.back().emplace_back(view.z[k], view.z[k + 1]);
    }
  cv::Mat matrix, distortion;
  std::vector<cv::Mat> rotations, translations;
  const cv::TermCriteria until(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 300, 1e-12);
  const double rms = cv::calibrateCamera(
      objects, images, cv::Size(rig.sensors[0].image_width, rig.sensors[0].image_height), matrix,
      distortion, rotations, translations, flags_of(model), until);
  INFO("kincal " << camera.rms << " OpenCV " << rms);
  CHECK(camera.rms <= rms * (1 + 1e-7));
  const ParameterEstimate& found = solution["sensor/" + rig.sensors[0].name + "/intrinsics"];
  const double of_opencv[] = {matrix.at<double>(0, 0), matrix.at<double>(1, 1),
                              matrix.at<double>(0, 2), matrix.at<double>(1, 2)};
  if (camera.rms > rms * (1 - 1e-6))  // else it ended elsewhere
    for (int c = 0; c < 4; ++c)
      CHECK(std::abs(found.value[c] - of_opencv[c]) < 0.1 * found.sigma[c]);
}

void compare_on_data(const std::string& rig_name, const std::string& samples_name) {
  const char* folder = std::getenv("KINCAL_DATA");
  const std::string data = folder ? folder : "";
  if (data.empty() || !std::filesystem::exists(data + "/" + samples_name)) {
    WARN("skipped: no data at KINCAL_DATA");
    return;
  }
  const Rig rig = read_rig(data + "/" + rig_name).rig;
  const std::vector<Sample> samples = read_samples(data + "/" + samples_name, without_robot(rig));
  for (const char* model : {"pinhole", "brown_conrady_2", "brown_conrady_4", "brown_conrady_5"})
    compare_with_opencv(rig, samples, model);
}

}  // namespace

TEST_CASE("calibrate_camera: simulated views, as OpenCV", "[calibrate_camera]") {
  Rig rig;
  add_link(rig, "base");
  finish_tree(rig.tree);
  add_grid(rig, "board", 6, 9, 0.03);
  add_camera(rig, "eye", "base", Pose(), Lens::brown_conrady, {-0.25, 0.1, 0.001, -0.002, -0.02});
  const Sensor& eye = rig.sensors[0];
  const ParameterTable table(rig);
  const Matrix3Xd points = target_points(rig.targets[0]);
  Random random(7);
  std::vector<Sample> samples;
  for (int i = 0; i < 15; ++i) {
    View view;
    view.sensor = view.target = 0;
    view.sigma = eye.sigma;
    for (int k = 0; k < points.cols(); ++k) view.ids.push_back(k);
    view.z.assign(2 * view.ids.size(), 0);
    ViewInput in;
    const double z = random.uniform(0.4, 0.8);
    in.sensor_T_target.rotation = random.rotation(0.7);
    in.sensor_T_target.translation =
        Vector3d(random.uniform(-0.2, 0.2) * z, random.uniform(-0.15, 0.15) * z, z) -
        in.sensor_T_target.rotation * Vector3d(0.12, 0.075, 0);
    in.parameters = table.initial.data() + table.all[table.sensor_block[0]].start;
    in.points = &points;
    in.ids = view.ids.data();
    in.count = static_cast<int>(view.ids.size());
    in.z = view.z.data();
    std::vector<double> pixels(view.z.size());
    REQUIRE(eye.model->evaluate(in, Columns(), pixels.data(), nullptr));
    for (double& pixel : pixels) pixel += 0.3 * random.normal();
    view.z = pixels;
    samples.emplace_back();
    samples.back().id = "view" + std::to_string(i);
    samples.back().views = {view};
  }
  for (const char* model : {"pinhole", "brown_conrady_2", "brown_conrady_4", "brown_conrady_5"})
    compare_with_opencv(rig, samples, model);
}

TEST_CASE("calibrate_camera: real views of a chessboard, as OpenCV", "[calibrate_camera]") {
  compare_on_data("aubo-i10/rig_images.yaml", "aubo-i10/samples_images.jsonl");
}

TEST_CASE("calibrate_camera: real views of a charuco board, as OpenCV", "[calibrate_camera]") {
  compare_on_data("ros-industrial-charuco/rig.yaml", "ros-industrial-charuco/samples.jsonl");
}

}  // namespace calibrate_camera_test
