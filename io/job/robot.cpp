#include "robot.h"

#include <algorithm>
#include <cmath>

#include "../../models/rig/configuration.h"
#include "../../models/rig/numbers.h"
#include "../document/error.h"
#include "../document/names.h"

namespace kincal {
namespace {

Frame frame_of(const KnownRig& rig, const std::string& name, const char* argument) {
  if (const std::optional<Frame> found = find_frame(rig.file.rig, rig.table, name)) return *found;
  std::vector<std::string> valid;
  for (const Frame& frame : all_frames(rig.file.rig, rig.table)) valid.push_back(frame.name);
  throw InputError(std::string(argument) + ": there is no frame '" + name + "'" +
                   nearest_or_all(name, valid, "there are"));
}

/// The readings by joint of the tree; every joint that moves one of `frames` has one.
std::vector<Readings> readings_of(const KnownRig& rig, const Postures& postures,
                                  const std::vector<Frame>& frames) {
  const Rig& of = rig.file.rig;
  std::vector<int> columns;
  for (const std::string& name : postures.joints) {
    const int j = of.tree.find_joint(name);
    if (j < 0 || !of.tree.joints[j].has_reading())
      throw InputError("joints: '" + name + "' is no joint with a reading" +
                       nearest_or_all(name, joint_names(of), "there are"));
    columns.push_back(j);
  }
  std::vector<Readings> out(postures.rows, Readings(of.tree.joints.size(), kNan));
  const double* value = postures.values;
  for (size_t r = 0; r < postures.rows; ++r)
    for (size_t c = 0; c < columns.size(); ++c, ++value) {
      if (!std::isfinite(*value))
        throw InputError("joints: the reading of '" + postures.joints[c] +
                         "' is not finite (posture " + std::to_string(r) + ")");
      out[r][columns[c]] = *value;
    }
  for (const Frame& frame : frames)
    for (const int j : joints_between(of, of.base, frame.link))
      if (!out.empty() && std::isnan(out[0][j]))
        throw InputError("joints: there is no reading of joint '" + of.tree.joints[j].name +
                         "', which moves '" + frame.name + "'");
  for (Readings& one : out) one = completed(std::move(one));
  return out;
}

RobotTip tip_of(const KnownRig& rig, const std::string& tip, const std::string& base) {
  return {{&rig.file.rig, &rig.table, rig.table.initial, {}},
          frame_of(rig, tip, "tip"),
          frame_of(rig, base, "base")};
}

/// What compensation is seen from: something that stands still.
std::string still_base(const KnownRig& rig, const std::string& given) {
  const std::string& link = rig.file.rig.tree.links[rig.file.rig.base];
  std::vector<std::string> still;
  for (const Frame& frame : still_frames(rig.file.rig, rig.table)) still.push_back(frame.name);
  const size_t frames = still.size();
  still.push_back(link);
  if (given.empty() && frames > 1)
    throw InputError("base: two calibrations may place the base link differently: give one of " +
                     comma_separated(still));
  const std::string base = given.empty() ? still[0] : given;
  if (std::find(still.begin(), still.end(), base) == still.end())
    throw InputError("base: '" + base + "' does not stand still; one of " + comma_separated(still) +
                     " is expected");
  return base;
}

}  // namespace

std::vector<std::string> joint_names(const Rig& rig) {
  std::vector<std::string> out;
  for (const Joint& joint : rig.tree.joints)
    if (joint.has_reading()) out.push_back(joint.name);
  return out;
}

void forward_poses(const KnownRig& rig, const Postures& postures, const std::string& frame,
                   const std::string& base, double* out) {
  const Frame tip = frame_of(rig, frame, "frame"), from = frame_of(rig, base, "base");
  const RobotTip path{{&rig.file.rig, &rig.table, rig.table.initial, {}}, tip, from};
  for (const Readings& readings : readings_of(rig, postures, {tip, from})) {
    const Pose pose = path.at(readings);
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
        *out++ = i == 3 ? double(j == 3) : j == 3 ? pose.translation(i) : pose.rotation(i, j);
  }
}

std::vector<Compensated> compensate_postures(const KnownRig& real, const KnownRig& planned,
                                             const Postures& postures,
                                             const CompensationWish& wish) {
  const std::string base = still_base(real, wish.base);
  RobotTip to = tip_of(real, wish.tip, base);
  const RobotTip plan = tip_of(planned, wish.tip, base);
  if (!wish.temperature && real.table.has(ParameterKind::temperature))
    throw InputError("temperature: joints of this robot depend on it: give degrees Celsius");
  to.conditions.temperature = wish.temperature;
  std::vector<Compensated> out;
  for (const Readings& readings : readings_of(real, postures, {to.tip}))
    out.push_back(compensate(to, plan, readings, wish.position_only));
  return out;
}

}  // namespace kincal
