#include "edit.h"

#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "../document/numbers.h"
#include "splices.h"

namespace kincal {
namespace {

void edit_origin(const std::string& text, const pugi::xml_node& joint, const Pose& from,
                 const Pose& to, std::vector<Splice>& splices) {
  const bool moved = to.translation != from.translation, turned = to.rotation != from.rotation;
  if (!moved && !turned) return;
  if (!to.translation.allFinite() || !to.rotation.allFinite())
    throw std::invalid_argument(title(joint) + ": the new origin is not finite");
  const std::string xyz = shortest(to.translation), rpy = shortest(rpy_from_rotation(to.rotation));
  const pugi::xml_node origin = joint.child("origin");
  if (!origin) {
    const size_t place = scan_tag(text, joint).end;
    splices.push_back({place, place, "<origin xyz=\"" + xyz + "\" rpy=\"" + rpy + "\"/>"});
    return;
  }
  std::vector<std::pair<std::string, std::string>> attributes;
  if (moved) attributes.emplace_back("xyz", xyz);
  if (turned) attributes.emplace_back("rpy", rpy);
  set_attributes(text, origin, attributes, splices);
}

}  // namespace

std::string edit_urdf(const Urdf& urdf, const UrdfChanges& changes) {
  const pugi::xml_node robot = urdf.document->document_element();
  const Elements joints = children(robot, "joint");
  std::vector<Splice> splices;
  for (const auto& [joint, origin] : changes.origins)
    edit_origin(urdf.text, joints.at(joint), urdf.tree.joints.at(joint).parent_T_joint, origin,
                splices);
  const std::vector<WrittenTransmission> reductions = find_reductions(urdf.text, robot);
  for (const auto& [joint, value] : changes.reductions) {
    if (!std::isfinite(value))
      throw std::invalid_argument("joint '" + joint +
                                  "': the new mechanicalReduction is not finite");
    bool found = false;
    for (const WrittenTransmission& r : reductions)
      if (r.transmission.joint == joint) {
        found = true;
        if (r.transmission.reduction != value) splices.push_back({r.begin, r.end, shortest(value)});
      }
    if (!found)
      throw std::invalid_argument(urdf.path + ": joint '" + joint +
                                  "' has no <transmission> with one mechanicalReduction");
  }
  return spliced(urdf.text, std::move(splices));
}

}  // namespace kincal
