#include "local_report.h"

#include <algorithm>
#include <cmath>

#include "table.h"

namespace kincal {

std::string local_report(const Rig& rig, const LocalCalibration& local) {
  std::string out = text(
      "%d samples near, the nearest at %.3g, %d within %.4g (largest difference of a joint, rad or "
      "m)\n",
      local.near, local.distances.front(), local.samples, local.radius);
  std::string unknown;
  for (const LocalOffset& o : local.offsets)
    if (!std::isfinite(o.offset))
      unknown += (unknown.empty() ? "" : ", ") + rig.tree.joints[o.joint].name;
  if (local.gain) {
    out += "\nOffsets around this posture, to be added to the joints' positions\n";
    std::vector<std::vector<std::string>> rows = {{"joint", "offset", "sigma", "unit", ""}};
    for (const LocalOffset& o : local.offsets) {
      const Joint& joint = rig.tree.joints[o.joint];
      const Unit unit = shown(joint.type == JointType::prismatic ? "m" : "rad");
      rows.push_back({joint.name, text("%+.4g", o.offset * unit.factor),
                      "± " + text("%.2g", o.sigma * unit.factor), unit.name,
                      o.determined ? "" : "not determined near here"});
      if (!std::isfinite(o.offset)) rows.back() = {joint.name, "unknown", "", unit.name, ""};
    }
    out += align(rows, 1);
    out += text("\nValid while no joint is further than %.4g from the posture", local.radius);
    out += local.ends
               ? "\n"
               : ", the distance of the furthest sample. The offsets may be valid further away; if "
                 "they are valid everywhere, calibrate the robot again\n";
  } else {
    out += "\nNo gain: the global calibration is equally good here. Offsets are 0\n";
  }
  if (!unknown.empty())
    out += "\nNot determined, because no sample within " + text("%.4g", local.bandwidth) +
           " depends on them: " + unknown +
           ".\n"
           "Record postures around this one that depend on them, or do not name these joints\n";
  out += local.gain ? "\nErrors within that (rms, readings as they are; each sample predicted "
                      "without itself)\n"
                    : "\nErrors nearby with offsets that were tried (rms, readings as they are; "
                      "each sample predicted without itself)\n";
  const bool test = std::any_of(local.sensors.begin(), local.sensors.end(),
                                [](const SensorResult& s) { return s.test.points > 0; });
  std::vector<std::vector<std::string>> rows = {{"sensor", "unit", "points", "before", "after"}};
  if (test) rows[0].insert(rows[0].end(), {"held out: points", "before", "after"});
  for (const SensorResult& s : local.sensors)
    for (bool rotation : {false, true}) {
      if (rotation && !s.measures_pose) continue;
      const Unit unit = shown(rotation ? "rad" : s.unit);
      std::vector<std::string> row = {rotation ? "" : s.name, unit.name};
      for (const SplitStatistics* split : {&s.train, &s.test}) {
        if (split == &s.test && !test) continue;
        row.push_back(rotation ? "" : std::to_string(split->points));
        row.push_back(value(rotation ? split->rotation_before : split->rms_before, unit.factor));
        row.push_back(value(rotation ? split->rotation_as_read : split->rms_as_read, unit.factor));
      }
      rows.push_back(row);
    }
  out += align(rows, 2);
  out += text(
      "chi2 in the directions of the offsets %.4g -> %.4g: gain %.3g ± %.2g; noise %.3g times as "
      "stated\n",
      local.chi2_before, local.chi2, local.chi2_before - local.chi2, local.gain_sigma, local.noise);
  if (!local.not_converged.empty())
    out += text("not converged: targets and joint errors of %zu of the samples, first '",
                local.not_converged.size()) +
           local.not_converged.front() + "'\n";
  return out;
}

}  // namespace kincal
