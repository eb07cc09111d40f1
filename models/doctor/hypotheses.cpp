#include "hypotheses.h"

#include <algorithm>

#include "camera_mistakes.h"
#include "joint_mistakes.h"
#include "pose_mistakes.h"
#include "reading_mistakes.h"
#include "sensor_mistakes.h"
#include "target_mistakes.h"

namespace kincal {

std::vector<Hypothesis> hypotheses(const Rig& rig, const ParameterTable& table,
                                   const std::vector<Sample>& samples, const FreedNames& freed) {
  const Survey survey = make_survey(rig, samples);
  std::vector<Hypothesis> out;
  add_joints(rig, samples, survey, out);
  add_pose_readings(rig, samples, survey, out);
  add_pose_views(rig, survey, out);
  add_length_units(rig, survey, out);
  add_bearings(rig, samples, survey, out);
  add_squares(rig, table, survey, freed, out);
  add_boards(rig, survey, out);
  add_widths(rig, samples, survey, out);
  add_counts_from_one(rig, samples, survey, out);
  add_point_orders(rig, samples, survey, out);
  add_mirrors(rig, survey, out);
  add_mirrored_points(rig, survey, out);
  add_units(rig, survey, out);
  add_poses(rig, survey, out);
  add_quaternions(rig, survey, out);
  add_sides(rig, survey, out);
  add_baselines(rig, table, survey, freed, out);
  add_exchanges(rig, survey, out);
  add_lenses(rig, table, survey, freed, out);
  add_exchanged_axes(rig, survey, out);
  add_resolutions(rig, table, samples, survey, freed, out);
  add_orders(rig, survey, out);
  add_normalised(rig, samples, survey, out);
  add_shifts(rig, samples, survey, out);  // many: last, where bad ones are given up soon
  add_links(rig, samples, out);
  add_apart(rig, samples, out);
  if (!survey.floating.empty() && survey.ranges.empty())  // the same as poses the wrong way round
    out.erase(std::remove_if(out.begin(), out.end(),
                             [](const Hypothesis& h) { return h.kind == NoticeKind::eye_in_hand; }),
              out.end());
  return out;
}

}  // namespace kincal
