#include "json_values.h"

#include <cmath>

namespace kincal {

std::string json_text(const Json& json) {
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

Node node_of(const Json& json) {
  Node out;
  if (json.is_null() || (json.is_number_float() && !std::isfinite(json.get<double>()))) return out;
  out.kind = Node::Kind::scalar;
  if (json.is_object()) {
    out.kind = Node::Kind::mapping;
    for (const auto& [key, value] : json.get_ref<const Json::object_t&>())
      out.members.emplace_back(key, node_of(value));
  } else if (json.is_array()) {
    out.kind = Node::Kind::sequence;
    for (const Json& item : json) out.items.push_back(node_of(item));
  } else if (json.is_string()) {
    out.text = json.get_ref<const std::string&>();
    out.quoted = true;
  } else if (json.is_number_float()) {
    out.numbers = {json.get<double>()};
  } else {
    out.text = json.dump();
  }
  return out;
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
