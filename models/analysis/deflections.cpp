#include "deflections.h"

#include "../rig/configuration.h"
#include "../rig/elasticity.h"
#include "frames.h"

namespace kincal {

std::vector<Deflection> deflections(const Solution& solution) {
  std::vector<Deflection> out;
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  if (!rig.elasticity) return out;
  VectorXd stiff = solution.values.shared;
  for (const Parameter& p : table.all)
    if (p.kind == ParameterKind::compliance) stiff.segment<3>(p.start).setZero();
  for (const Frame& frame : all_frames(rig, table)) {
    if (frame.pose < 0) continue;
    Deflection one;
    one.frame = frame.name;
    for (size_t i = 0; i < solution.samples().size(); ++i) {
      const Readings& readings = solution.samples()[i].readings;
      if (!has_readings(rig, frame.link, readings)) continue;
      const double moved =
          (base_T_frame(rig, table, solution.values.shared, frame, readings).translation -
           base_T_frame(rig, table, stiff, frame, readings).translation)
              .norm();
      if (!std::isfinite(moved)) continue;
      ++one.samples;
      one.mean += moved;
      if (moved <= one.largest) continue;
      one.largest = moved;
      one.largest_in = static_cast<int>(i);
    }
    if (one.largest_in < 0) continue;
    one.mean /= static_cast<double>(one.samples);
    out.push_back(std::move(one));
  }
  return out;
}

std::vector<int> bent_against_load(const Solution& solution) {
  constexpr double kSigmas = 3;  // one rigid joint in 740 is told so by chance
  std::vector<int> out;
  for (const ParameterEstimate& e : solution.parameters) {
    const Parameter& p = solution.table().all[e.parameter];
    if (p.kind == ParameterKind::compliance && e.freed[0] && e.sigma[0] > 0 &&
        e.value[0] < -kSigmas * e.sigma[0])
      out.push_back(p.owner);
  }
  return out;
}

}  // namespace kincal
