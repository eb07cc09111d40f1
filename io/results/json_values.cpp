#include "json_values.h"

#include <cmath>

namespace kincal {

std::string json_text(const Json& json) {
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

Json number(double v) { return std::isfinite(v) ? Json(v == 0 ? 0.0 : v) : Json(nullptr); }

Json numbers(const std::vector<double>& v) {
  Json out = Json::array();
  for (double x : v) out.push_back(number(x));
  return out;
}

Json vector3(const Vector3d& v) { return numbers({v.x(), v.y(), v.z()}); }

Json pose(const Pose& p) {
  const Eigen::Vector4d q = quaternion_from_rotation(p.rotation);
  return {{"xyz", vector3(p.translation)}, {"quat", numbers({q(0), q(1), q(2), q(3)})}};
}

}  // namespace kincal
