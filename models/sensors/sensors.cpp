#include "sensors.h"

#include <algorithm>
#include <stdexcept>

#include "cameras.h"
#include "double_sphere.h"
#include "point.h"
#include "pose.h"
#include "thin_prism.h"
#include "tilted.h"
#include "tilting_laser.h"
#include "unified.h"

namespace kincal {

void SensorModel::own_noise(const ViewInput&, int, Eigen::MatrixXd& b) const {
  b.setIdentity(rows(), rows());
}

void SensorModel::compared(const double* z, int n, int stride, double* to) const {
  const int count = rows(), apart = measurement_size();
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < count; ++k) to[k * stride + i] = z[i * apart + k];
}

const std::vector<LensType>& lens_types() {
  static const std::vector<LensType> types = {
      {Lens::pinhole, "pinhole", {}, {0}, {}},
      {Lens::brown_conrady,
       "brown_conrady",
       {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"},
       {5, 8, 12, 14},
       {}},
      {Lens::kannala_brandt, "kannala_brandt", {"k1", "k2", "k3", "k4"}, {4}, {}},
      {Lens::unified, "unified", {"xi", "k1", "k2", "p1", "p2"}, {5}, {1}},
      {Lens::double_sphere, "double_sphere", {"xi", "alpha"}, {2}, {0, 0.5}}};
  return types;
}

const LensType& lens_type(Lens lens) {
  const std::vector<LensType>& types = lens_types();
  return *std::find_if(types.begin(), types.end(),
                       [&](const LensType& type) { return type.lens == lens; });
}

const LensType& lens_type(const std::vector<ParameterBlock>& camera) {
  std::vector<std::string> names;
  for (const ParameterBlock& block : camera)
    if (block.name == "distortion") names = block.components;
  const std::vector<LensType>& types = lens_types();
  const auto found = std::find_if(types.begin(), types.end(), [&](const LensType& type) {
    return std::count(type.counts.begin(), type.counts.end(), static_cast<int>(names.size())) > 0 &&
           std::equal(names.begin(), names.end(), type.numbers.begin());
  });
  if (found == types.end()) throw std::invalid_argument("a camera with a lens of its own");
  return *found;
}

std::shared_ptr<const SensorModel> make_camera(Lens lens, int distortion_count) {
  const auto camera = [](auto camera_lens, ViewKernel kernel) {
    return std::make_shared<PointwiseSensor<decltype(camera_lens)>>(camera_lens, "px", kernel);
  };
  if (lens == Lens::kannala_brandt && distortion_count == 4)
    return camera(KannalaBrandt(), nullptr);
  if (lens == Lens::pinhole && distortion_count == 0)
    return camera(BrownConrady<0>(), view_kernels().pinhole);
  if (lens == Lens::brown_conrady && distortion_count == 5)
    return camera(BrownConrady<5>(), view_kernels().brown_conrady5);
  if (lens == Lens::brown_conrady && distortion_count == 8)
    return camera(BrownConrady<8>(), view_kernels().brown_conrady8);
  if (lens == Lens::brown_conrady && distortion_count == 12)
    return camera(LensCamera<ThinPrism>(), nullptr);
  if (lens == Lens::brown_conrady && distortion_count == 14)
    return camera(LensCamera<TiltedSensor>(), nullptr);
  if (lens == Lens::unified && distortion_count == 5) return camera(LensCamera<Unified>(), nullptr);
  if (lens == Lens::double_sphere && distortion_count == 2)
    return camera(LensCamera<DoubleSphere>(), nullptr);
  throw std::invalid_argument(
      "distortion: pinhole takes 0 coefficients, brown_conrady 5, 8, 12 or 14, kannala_brandt 4, "
      "unified "
      "5, double_sphere 2; not " +
      std::to_string(distortion_count));
}

std::vector<ParameterBlock> camera_parameters(Lens lens, const std::vector<double>& intrinsics,
                                              const std::vector<double>& distortion,
                                              double baseline) {
  std::vector<ParameterBlock> blocks = {
      {"intrinsics", {"fx", "fy", "cx", "cy"}, {"px", "px", "px", "px"}, intrinsics}};
  if (!distortion.empty()) {
    std::vector<std::string> names = lens_type(lens).numbers;
    names.resize(distortion.size());
    std::vector<std::string> units;
    for (const std::string& name : names)
      units.emplace_back(name.rfind("tau", 0) == 0 ? "rad" : "");
    blocks.push_back({"distortion", names, units, distortion});
  }
  blocks.push_back({"baseline", {""}, {"m"}, {baseline}});
  return blocks;
}

std::shared_ptr<const SensorModel> make_point() {
  return std::make_shared<PointwiseSensor<PointSensor>>(PointSensor(), "m", view_kernels().point);
}
std::shared_ptr<const SensorModel> make_ranged_point() {
  return std::make_shared<PointwiseSensor<RangedPoint>>();
}
std::vector<ParameterBlock> range_parameters(double scale, double offset) {
  return {{"range_scale", {""}, {""}, {scale}}, {"range_offset", {""}, {"m"}, {offset}}};
}
std::shared_ptr<const SensorModel> make_pose() { return std::make_shared<PoseSensor>(true, false); }
std::shared_ptr<const SensorModel> make_scaled_pose() {
  return std::make_shared<PoseSensor>(true, true);
}
std::vector<ParameterBlock> pose_scale(double scale) {
  return {{"range_scale", {""}, {""}, {scale}}};
}
std::shared_ptr<const SensorModel> make_chain() {
  return std::make_shared<PoseSensor>(false, false);
}
std::shared_ptr<const SensorModel> make_tilting_laser() { return std::make_shared<TiltingLaser>(); }

}  // namespace kincal
