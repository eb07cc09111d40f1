// A MuJoCo model (MJCF) as far as its kinematics go: where bodies, joints, cameras and sites are.
// This header is internal to this folder.
//
// At a body with joints 1 ... n, of readings q and values `ref` at which the model stands as it is
// written,
//     above_T_body(q) = pose * S_1(q_1 - ref_1) * ... * S_n(q_n - ref_n),
// S a turn about the line through `pos` along `axis`, or a slide along it, in the body's frame.
#pragma once

#include <string>
#include <vector>

#include "../../kinematics/tree.h"
#include "xml.h"

namespace kincal {

struct MjcfJoint {
  pugi::xml_node element;
  std::string name, type;             // hinge, slide, ball, free
  Vector3d axis = Vector3d::UnitZ();  // unit length
  Vector3d pos = Vector3d::Zero();
  double ref = 0;  // rad, m

  Pose motion(double reading) const;
};

struct MjcfBody {
  pugi::xml_node element;
  std::string name;
  int above = -1;     // index of the body that it hangs on; -1: the world
  Pose above_T_here;  // the <frame>s between that body and this one
  Pose pose;          // here_T_body, of the attributes pos, quat, ...
  std::vector<MjcfJoint> joints;
};

/// A camera or site.
struct MjcfMark {
  pugi::xml_node element;
  std::string name;
  int body = -1;
  Pose body_T_here, pose;
  bool still = true;  // false: a camera that follows something
};

struct Mjcf {
  std::vector<MjcfBody> bodies;  // what hangs on another one stands behind it
  std::vector<MjcfMark> cameras, sites;
};

/// Reads a model. `xml` gets the document, which the elements are of. @throws InputError, also of
/// what this reader does not know: includes, replicated bodies, global coordinates
Mjcf read_mjcf(Xml& xml);

/// The attributes that say how a frame is turned; an element has one of them.
extern const std::vector<std::string> kMjcfRotations;

}  // namespace kincal
