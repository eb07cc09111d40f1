#include "sensors.h"

#include <stdexcept>

#include "cameras.h"
#include "point.h"
#include "pose.h"
#include "tilting_laser.h"

namespace kincal {

void SensorModel::own_noise(const ViewInput&, int, Eigen::MatrixXd& b) const {
  b.setIdentity(rows(), rows());
}

void SensorModel::compared(const double* z, int n, int stride, double* to) const {
  const int count = rows(), apart = measurement_size();
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < count; ++k) to[k * stride + i] = z[i * apart + k];
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
  throw std::invalid_argument(
      "distortion: pinhole takes 0 numbers, brown_conrady 5 or 8, kannala_brandt 4; not " +
      std::to_string(distortion_count));
}

std::vector<ParameterBlock> camera_parameters(Lens lens, const std::vector<double>& intrinsics,
                                              const std::vector<double>& distortion,
                                              double baseline) {
  std::vector<ParameterBlock> blocks = {
      {"intrinsics", {"fx", "fy", "cx", "cy"}, {"px", "px", "px", "px"}, intrinsics}};
  if (!distortion.empty()) {
    std::vector<std::string> names = {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"};
    if (lens == Lens::kannala_brandt) names = {"k1", "k2", "k3", "k4"};
    names.resize(distortion.size());
    blocks.push_back(
        {"distortion", names, std::vector<std::string>(distortion.size(), ""), distortion});
  }
  blocks.push_back({"baseline", {""}, {"m"}, {baseline}});
  return blocks;
}

std::shared_ptr<const SensorModel> make_point() {
  return std::make_shared<PointwiseSensor<PointSensor>>(PointSensor(), "m", view_kernels().point);
}
std::shared_ptr<const SensorModel> make_pose() { return std::make_shared<PoseSensor>(true); }
std::shared_ptr<const SensorModel> make_chain() { return std::make_shared<PoseSensor>(false); }
std::shared_ptr<const SensorModel> make_tilting_laser() { return std::make_shared<TiltingLaser>(); }

}  // namespace kincal
