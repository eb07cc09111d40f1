#include "sensors.h"

#include <stdexcept>

#include "cameras.h"
#include "point.h"
#include "pose.h"
#include "tilting_laser.h"

namespace kincal {

void SensorModel::own_noise(const ViewInput&, int, Eigen::MatrixXd& b) const { b.setIdentity(rows(), rows()); }

std::shared_ptr<const SensorModel> make_camera(Lens lens, int distortion_count) {
  if (lens == Lens::kannala_brandt && distortion_count == 4) return std::make_shared<PointwiseSensor<KannalaBrandt>>(KannalaBrandt(), "px");
  if (lens == Lens::pinhole && distortion_count == 0) return std::make_shared<PointwiseSensor<BrownConrady<0>>>(BrownConrady<0>(), "px");
  if (lens == Lens::brown_conrady && distortion_count == 5)
    return std::make_shared<PointwiseSensor<BrownConrady<5>>>(BrownConrady<5>(), "px");
  if (lens == Lens::brown_conrady && distortion_count == 8)
    return std::make_shared<PointwiseSensor<BrownConrady<8>>>(BrownConrady<8>(), "px");
  throw std::invalid_argument("distortion: pinhole takes 0 numbers, brown_conrady 5 or 8, kannala_brandt 4; not " +
                              std::to_string(distortion_count));
}

std::vector<ParameterBlock> camera_parameters(Lens lens, const std::vector<double>& intrinsics, const std::vector<double>& distortion,
                                              double baseline) {
  std::vector<ParameterBlock> blocks = {{"intrinsics", {"fx", "fy", "cx", "cy"}, {"px", "px", "px", "px"}, intrinsics}};
  if (!distortion.empty()) {
    std::vector<std::string> names = {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"};
    if (lens == Lens::kannala_brandt) names = {"k1", "k2", "k3", "k4"};
    names.resize(distortion.size());
    blocks.push_back({"distortion", names, std::vector<std::string>(distortion.size(), ""), distortion});
  }
  blocks.push_back({"baseline", {""}, {"m"}, {baseline}});
  return blocks;
}

std::shared_ptr<const SensorModel> make_point() { return std::make_shared<PointwiseSensor<PointSensor>>(); }
std::shared_ptr<const SensorModel> make_pose() { return std::make_shared<PoseSensor>(true); }
std::shared_ptr<const SensorModel> make_chain() { return std::make_shared<PoseSensor>(false); }
std::shared_ptr<const SensorModel> make_tilting_laser() { return std::make_shared<TiltingLaser>(); }

}  // namespace kincal
