#include "elasticity_entry.h"

#include <stdexcept>
#include <string>
#include <vector>

#include "../../models/rig/elasticity.h"
#include "../document/error.h"
#include "../document/names.h"
#include "../document/numbers.h"

namespace kincal {
namespace {

constexpr double kLightest = 9, kHeaviest = 11;  // gravity on Earth, m/s^2, with much room

Node list_of(const Vector3d& v) {
  Node node;
  node.kind = Node::Kind::sequence;
  for (int i = 0; i < 3; ++i) node.items.push_back(scalar_node(shortest(v(i))));
  return node;
}

Node mapping() {
  Node node;
  node.kind = Node::Kind::mapping;
  return node;
}

/// The joints that entries of a mapping are of, by name of the joint or of the link it moves.
template <class Take>
void each_joint(const Field& field, const Rig& rig, bool links, Take take) {
  const Skeleton& skeleton = *rig.elasticity->skeleton;
  for (const auto& member : field.members()) {
    int joint = -1;
    std::vector<std::string> valid;
    for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
      if (links ? !rig.tree.joints[j].moves() : skeleton.index[j] < 0) continue;
      valid.push_back(links ? rig.tree.links[rig.tree.joints[j].child] : rig.tree.joints[j].name);
      if (valid.back() == member.first) joint = static_cast<int>(j);
    }
    if (joint < 0)
      field[member.first].fail(
          (links ? "no joint moves a link '" : "no joint bends that is called '") + member.first +
          "'" + nearest_names(member.first, valid) + "; valid: " + comma_separated(valid));
    take(field[member.first], joint);
  }
}

Vector3d vector_of(const Field& field) {
  const std::vector<double> v = field.vector(3);
  return {v[0], v[1], v[2]};
}

}  // namespace

Elasticity read_elasticity(const Field& field, const Rig& given) {
  field.check_keys({}, {"gravity", "frame", "compliance", "turned", "load"});
  Rig rig = given;
  try {
    rig.elasticity = nominal_elasticity(rig);
  } catch (const std::invalid_argument& e) {
    field.fail(e.what());
  }
  Elasticity& out = *rig.elasticity;
  if (field.has("gravity")) {
    out.gravity = vector_of(field["gravity"]);
    if (out.gravity.norm() < kLightest || out.gravity.norm() > kHeaviest)
      field["gravity"].fail("its length is " + shortest(out.gravity.norm()) +
                            "; on Earth about 9.81 is expected, m/s^2, from the base downwards");
  }
  if (field.has("frame")) {
    const std::string frame = field["frame"].string();
    if (frame != "stator" && frame != "rotor")
      field["frame"].fail("'" + frame + "' is neither stator nor rotor");
    out.rotor = frame == "rotor";
  }
  if (field.has("compliance"))
    each_joint(field["compliance"], rig, false,
               [&](const Field& entry, int j) { out.compliance[j] = vector_of(entry); });
  if (field.has("turned"))
    each_joint(field["turned"], rig, false,
               [&](const Field& entry, int j) { out.turned[j] = entry.number(); });
  if (field.has("load"))
    each_joint(field["load"], rig, true,
               [&](const Field& entry, int j) { out.load[j] = vector_of(entry); });
  turn_skeleton(rig.tree, out);
  return out;
}

Node elasticity_node(const Elasticity& elasticity, const Tree& tree) {
  Node out = mapping(), compliance = mapping(), turned = mapping(), load = mapping();
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    if (elasticity.skeleton->index[j] >= 0)
      compliance.members.push_back({tree.joints[j].name, list_of(elasticity.compliance[j])});
    if (elasticity.turned[j] != 0)
      turned.members.push_back({tree.joints[j].name, scalar_node(shortest(elasticity.turned[j]))});
    if (tree.joints[j].moves())
      load.members.push_back({tree.links[tree.joints[j].child], list_of(elasticity.load[j])});
  }
  out.members = {{"gravity", list_of(elasticity.gravity)},
                 {"frame", scalar_node(elasticity.rotor ? "rotor" : "stator")},
                 {"compliance", compliance}};
  if (!turned.members.empty()) out.members.push_back({"turned", turned});
  out.members.push_back({"load", load});
  return out;
}

}  // namespace kincal
