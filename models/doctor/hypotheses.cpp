#include "hypotheses.h"

#include <algorithm>

#include "board_mistakes.h"
#include "camera_mistakes.h"
#include "joint_mistakes.h"
#include "pose_mistakes.h"
#include "reading_mistakes.h"
#include "sensor_mistakes.h"
#include "target_mistakes.h"

namespace kincal {

std::vector<Hypothesis> hypotheses(const Rig& rig, const ParameterTable& table,
                                   const std::vector<Sample>& samples, const FreedNames& freed) {
  const ObservationIndex observations = make_observation_index(rig, samples);
  std::vector<Hypothesis> out;
  add_joints(rig, samples, observations, out);
  add_pose_readings(rig, samples, observations, out);
  add_pose_views(rig, observations, out);
  add_length_units(rig, observations, out);
  add_bearings(rig, samples, observations, out);
  add_squares(rig, table, observations, freed, out);
  add_boards(rig, observations, out);
  add_widths(rig, samples, observations, out);
  add_counts_from_one(rig, samples, observations, out);
  add_point_orders(rig, samples, observations, out);
  add_mirrors(rig, observations, out);
  add_mirrored_points(rig, observations, out);
  add_units(rig, observations, out);
  add_poses(rig, observations, out);
  add_sides(rig, observations, out);
  add_scales(rig, observations, freed, table, out);
  add_baselines(rig, table, observations, freed, out);
  add_exchanges(rig, observations, out);
  add_lenses(rig, table, observations, freed, out);
  add_fisheyes(rig, observations, out);
  add_exchanged_axes(rig, observations, out);
  add_resolutions(rig, table, samples, observations, freed, out);
  add_orders(rig, observations, out);
  add_normalised(rig, samples, observations, out);
  add_shifts(rig, samples, observations, out);  // many: last, where bad ones are given up soon
  add_links(rig, samples, out);
  add_apart(rig, samples, out);
  if (!observations.floating.empty() &&
      observations.ranges.empty())  // the same as poses the wrong way round
    out.erase(std::remove_if(out.begin(), out.end(),
                             [](const Hypothesis& h) { return h.kind == NoticeKind::eye_in_hand; }),
              out.end());
  return out;
}

}  // namespace kincal
