#include "sensor_mistakes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "../../kinematics/floating.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/words.h"
#include "../sensors/sensors.h"
#include "reading_mistakes.h"
#include "turned_poses.h"

namespace kincal {
namespace {

bool is_camera(const Sensor& sensor) {
  return sensor.model->measurement_kind() == MeasurementKind::rays;
}

bool has_own_lens(const Sensor& sensor) {
  return is_camera(sensor) && find_block(sensor, ParameterKind::intrinsics) &&
         find_block(sensor, ParameterKind::baseline);
}

/// Gives a camera another lens, with this many coefficients of 0.
void set_lens(Lens lens, int coefficients, Sensor& camera) {
  const std::vector<double> intrinsics = find_block(camera, ParameterKind::intrinsics)->values;
  const double baseline = find_block(camera, ParameterKind::baseline)->values[0];
  camera.model = make_camera(lens, coefficients);
  camera.parameters =
      camera_parameters(lens, intrinsics, std::vector<double>(coefficients, 0.0), baseline);
}

}  // namespace

void add_mirrors(const Rig& rig, const ObservationIndex& observations,
                 std::vector<Hypothesis>& out) {
  for (int s : observations.sensors) {
    const Sensor& sensor = rig.sensors[s];
    const MeasurementKind kind = sensor.model->measurement_kind();
    if (kind == MeasurementKind::rays) {
      const ParameterBlock* intrinsics = find_block(sensor, ParameterKind::intrinsics);
      if (!intrinsics || intrinsics->values.size() < 4) continue;
      const std::vector<double>& k = intrinsics->values;
      for (int axis : {0, 1}) {
        const int size = axis == 0 ? sensor.image_width : sensor.image_height;
        const double sum = size > 0 ? size - 1 : 2 * k[2 + axis];
        out.push_back({NoticeKind::mirrored,
                       {Subject::sensor(sensor.name)},
                       "the images of camera " + quoted(sensor.name) + " are mirrored " +
                           (axis == 0 ? "left to right" : "top to bottom"),
                       std::string("detect in the image as the camera gave it, or replace ") +
                           (axis == 0 ? "u by width - 1 - u" : "v by height - 1 - v") +
                           " in its views",
                       of_numbers(s, axis, 2, [sum](double z) { return sum - z; })});
      }
    } else if (kind == MeasurementKind::points) {
      for (int axis : {0, 1, 2}) {
        Hypothesis h = mirrored_points(
            "the points that sensor " + quoted(sensor.name) + " measures are mirrored", axis,
            "sensor", "its views");
        h.where = {Subject::sensor(sensor.name)};
        h.undo = of_numbers(s, axis, 3, [](double z) { return z == 0 ? z : -z; });
        out.push_back(h);
      }
    }
  }
}

void add_units(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (int s : observations.sensors) {
    const Sensor& sensor = rig.sensors[s];
    const bool pose = sensor.model->measurement_kind() == MeasurementKind::pose;
    if (!pose && sensor.model->measurement_kind() != MeasurementKind::points) continue;
    for (const LengthUnit& unit : other_length_units()) {
      out.push_back({NoticeKind::square,
                     {Subject::sensor(sensor.name)},
                     std::string(pose ? "the positions" : "the points") + " that sensor " +
                         quoted(sensor.name) + " measures are in " + unit.name,
                     std::string("write metres into its views: ") + unit.cure,
                     of_views(s, [pose, factor = unit.metres](const Rig&, View& v) {
                       for (size_t i = 0; i < (pose ? 3 : v.z.size()); ++i) v.z[i] *= factor;
                     })});
      out.back().new_poses = true;
      out.back().rescaled = s;
      out.back().factor = unit.metres;
    }
  }
}

void add_scales(const Rig& rig, const ObservationIndex& observations, const FreedNames& freed,
                const ParameterTable& table, std::vector<Hypothesis>& out) {
  for (const int s : observations.sensors) {
    const Sensor& sensor = rig.sensors[s];
    const int known = table.index_of(ParameterKind::range_scale, s);
    if (sensor.model->measurement_kind() != MeasurementKind::pose ||
        (known >= 0 && freed.parameter[known]))
      continue;
    const double given = known < 0 ? 1 : sensor.parameters[0].values[0];
    Hypothesis h{NoticeKind::square, {Subject::sensor(sensor.name)}};
    h.undo = [s, given](Rig& r) {
      r.sensors[s].model = make_scaled_pose();
      r.sensors[s].parameters = pose_scale(given);
    };
    h.free = {"sensor/" + sensor.name + "/range_scale"};
    h.told = [given, name = sensor.name](const std::vector<double>& found) {
      const double times = found[0] / given;
      const bool sane = times > 1e-4 && times < 1e4 &&
                        std::abs(times - 1) > scales(ParameterKind::range_scale, "").least;
      return std::pair(
          sane ? "the positions that sensor " + quoted(name) +
                     text(" measures are %.5g times", times) +
                     " what they should be, as if its markers were stated too " +
                     (times > 1 ? "large" : "small")
               : "",
          text("measure the marker (or what sets the scale), and divide the size that its detector "
               "is given, and the positions in the views, by %.5g; or write range_scale: %.5g "
               "into sensors.%s",
               times, found[0], name.c_str()));
    };
    out.push_back(std::move(h));
  }
}

namespace {

/// A StatedPose is that of a sensor or mounted target that is seen, as the rig has it.
struct StatedPose {
  const char* kind;
  Subject what;
  std::string place, owner, maps;  // of a pose in the rig; "target"; "the sensor's target"
  Pose pose;
  std::function<Pose&(Rig&)> in;
};

std::vector<StatedPose> stated_poses(const Rig& rig, const ObservationIndex& observations) {
  std::vector<StatedPose> out;
  for (const int s : observations.sensors)
    if (const Sensor& sensor = rig.sensors[s]; sensor.pose_given)
      out.push_back(
          {"sensor", Subject::sensor(sensor.name), "sensors." + sensor.name + ".pose", "sensor",
           sensor.model->measurement_kind() == MeasurementKind::chain ? "sensor's target"
                                                                      : "sensor",
           sensor.link_T_sensor, [s](Rig& r) -> Pose& { return r.sensors[s].link_T_sensor; }});
  for (const int t : observations.targets)
    if (const Target& target = rig.targets[t]; target.link >= 0 && target.pose_given)
      out.push_back({"target", Subject::target(target.name),
                     "targets." + target.name + ".mount.pose", "target", "target",
                     target.link_T_target,
                     [t](Rig& r) -> Pose& { return r.targets[t].link_T_target; }});
  return out;
}

}  // namespace

void add_poses(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (const StatedPose& given : stated_poses(rig, observations)) {
    const std::string pose =
        std::string("the pose of ") + given.kind + " " + quoted(given.what.name);
    if (log_se3(given.pose).norm() >= 1e-6)
      out.push_back({NoticeKind::inverted_pose,
                     {given.what},
                     pose + " is given the wrong way round, as " + given.owner + "_T_link",
                     "replace " + given.place + " by its inverse: it maps coordinates of the " +
                         given.maps + " to the link's",
                     [in = given.in](Rig& r) { in(r) = inverse(in(r)); }});
    if (is_cube_turn(given.pose.rotation)) continue;  // named as a turn: turned_poses.h
    out.push_back({NoticeKind::quaternion,
                   {given.what},
                   pose + " has its quaternion written w x y z",
                   "write " + given.place + ".quat as [x, y, z, w]",
                   [in = given.in](Rig& r) { in(r).rotation = of_w_x_y_z(in(r).rotation); }});
    out.back().rarer = true;
  }
}

void add_sides(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (const auto& pair : observations.pairs) {
    const int s = pair.first, t = pair.second;
    const Sensor& sensor = rig.sensors[s];
    const Target& target = rig.targets[t];
    if (sensor.model->measurement_kind() == MeasurementKind::chain || sensor.model->scans())
      continue;
    if (target.link >= 0) {
      if (target.link == sensor.link) continue;
      const bool pose = sensor.model->measurement_kind() == MeasurementKind::pose;
      for (bool poses : {false, true}) {
        out.push_back(
            {NoticeKind::eye_in_hand,
             {Subject::sensor(sensor.name), Subject::target(target.name)},
             "sensor " + quoted(sensor.name) + " and target " + quoted(target.name) +
                 " are on the wrong sides: the sensor sits on link " +
                 quoted(rig.tree.links[target.link]) + " and the target on " +
                 quoted(rig.tree.links[sensor.link]) +
                 (pose ? ", or its poses are the wrong way round, as those of the sensor in the "
                         "target: the data are the same"
                       : ""),
             "exchange sensors." + sensor.name + ".link and targets." + target.name +
                 ".mount.link" + (poses ? ", poses too" : "") +
                 (pose ? ". Or invert what it measures: sensor_T_target maps coordinates of the "
                         "target to the sensor's"
                       : ""),
             [s, t, poses](Rig& r) {
               std::swap(r.sensors[s].link, r.targets[t].link);
               if (poses) std::swap(r.sensors[s].link_T_sensor, r.targets[t].link_T_target);
             }});
        out.back().new_poses = true;
      }
      continue;
    }
    for (const auto& other : observations.pairs) {  // a free target in a hand
      if (other.second != t ||
          rig.sensors[other.first].model->measurement_kind() != MeasurementKind::chain ||
          rig.sensors[other.first].link == sensor.link)
        continue;
      const int c = other.first;
      out.push_back({NoticeKind::eye_in_hand,
                     {Subject::sensor(sensor.name), Subject::sensor(rig.sensors[c].name)},
                     "sensor " + quoted(sensor.name) + " and the hand " +
                         quoted(rig.sensors[c].name) + " are on the wrong sides",
                     "exchange sensors." + sensor.name + ".link and sensors." +
                         rig.sensors[c].name + ".link, poses too",
                     [s, c](Rig& r) {
                       std::swap(r.sensors[s].link, r.sensors[c].link);
                       std::swap(r.sensors[s].link_T_sensor, r.sensors[c].link_T_sensor);
                     }});
      out.back().new_poses = true;
    }
  }
}

namespace {

double baseline_of(const Sensor& sensor) {
  const ParameterBlock* block = find_block(sensor, ParameterKind::baseline);
  return is_camera(sensor) && block ? block->values[0] : 0;
}

}  // namespace

void add_baselines(const Rig& rig, const ParameterTable& table,
                   const ObservationIndex& observations, const FreedNames& freed,
                   std::vector<Hypothesis>& out) {
  for (int s : observations.sensors) {
    const Sensor& sensor = rig.sensors[s];
    const double baseline = baseline_of(sensor);
    const int parameter = table.index_of(ParameterKind::baseline, s);
    if (baseline == 0 || parameter < 0 || freed.parameter[parameter]) continue;
    Hypothesis h{NoticeKind::baseline, {Subject::sensor(sensor.name)}};
    if (baseline > 0) {
      h.free = {table.all[parameter].name};
      h.told = [baseline, camera = sensor.name](const std::vector<double>& found) {
        const double times = found[0] / baseline;
        const std::string mistake =
            "the baseline of camera " + quoted(camera) +
            text(" is wrong: %.5g m in the rig, %.5g m from the data (times %.4g)", baseline,
                 found[0], times);
        const bool sane = times > 1e-4 && times < 1e4 && std::abs(times - 1) > 0.01;
        return std::pair(sane ? mistake : "",
                         "correct sensors." + camera +
                             ".baseline: metres, from the left camera to the right one (or free "
                             "sensor/" +
                             camera + "/baseline)");
      };
    } else {
      h.mistake = "the baseline of camera " + quoted(sensor.name) + " has the wrong sign" +
                  text(" (%.4g m)", baseline);
      h.cure = "write it without its minus sign: the right camera's is positive, the left one's 0";
      h.undo = [s](Rig& r) {
        for (ParameterBlock& block : r.sensors[s].parameters)
          if (block.name == "baseline") block.values[0] = -block.values[0];
      };
    }
    out.push_back(std::move(h));
  }
}

void add_exchanges(const Rig& rig, const ObservationIndex& observations,
                   std::vector<Hypothesis>& out) {
  for (int a : observations.sensors)
    for (int b : observations.sensors) {
      if (a >= b || !is_camera(rig.sensors[a]) || !is_camera(rig.sensors[b])) continue;
      // (A negative baseline looks the same, and is that.)
      if (std::min(baseline_of(rig.sensors[a]), baseline_of(rig.sensors[b])) < 0) continue;
      out.push_back({NoticeKind::swapped_cameras,
                     {Subject::sensor(rig.sensors[a].name), Subject::sensor(rig.sensors[b].name)},
                     "cameras " + quoted(rig.sensors[a].name) + " and " +
                         quoted(rig.sensors[b].name) + " are exchanged",
                     "exchange the two names, in the rig or in the views",
                     of_views(-1, [a, b](const Rig&, View& v) {
                       if (v.sensor == a || v.sensor == b) v.sensor = a + b - v.sensor;
                     })});
    }
}

void add_lenses(const Rig& rig, const ParameterTable& table, const ObservationIndex& observations,
                const FreedNames& freed, std::vector<Hypothesis>& out) {
  std::map<std::pair<bool, int>, std::vector<int>> on_link;  // (distorts, link): cameras
  std::map<bool, std::vector<int>> all;
  for (int s : observations.sensors) {
    const Sensor& sensor = rig.sensors[s];
    if (!has_own_lens(sensor)) continue;
    const int distortion = table.index_of(ParameterKind::distortion, s);
    if (distortion >= 0 && freed.parameter[distortion]) continue;
    const std::vector<double> lens = distortion >= 0
                                         ? find_block(sensor, ParameterKind::distortion)->values
                                         : std::vector<double>();
    const bool distorts = std::any_of(lens.begin(), lens.end(), [](double k) { return k != 0; });
    on_link[{distorts, sensor.link}].push_back(s);
    all[distorts].push_back(s);
  }
  std::set<std::pair<bool, std::vector<int>>> groups;  // each alone, those of one link, all
  for (const auto& g : on_link) groups.insert({g.first.first, g.second});
  for (const auto& g : all) {
    groups.insert(g);
    for (int s : g.second) groups.insert({g.first, {s}});
  }
  for (const auto& group : groups) {
    Hypothesis h{NoticeKind::rectified};
    std::string names;
    for (int s : group.second) {
      h.where.push_back(Subject::sensor(rig.sensors[s].name));
      names += (names.empty() ? "" : ", ") + quoted(rig.sensors[s].name);
      if (!group.first) h.free.push_back("sensor/" + rig.sensors[s].name + "/distortion");
    }
    if (group.first) {
      h.mistake =
          "the rig corrects the lens of camera " + names + ", but the images are rectified already";
      h.cure =
          "take model: pinhole without distortion (and the intrinsics of the rectified image), or "
          "detect in the raw images";
    } else if (std::all_of(group.second.begin(), group.second.end(), [&](int s) {
                 return find_block(rig.sensors[s], ParameterKind::distortion) != nullptr;
               })) {
      h.mistake = "the lens of camera " + names + " distorts, but its distortion is 0 in the rig";
      h.cure =
          "free " + listed(h.free) + ", write the lens into the rig, or detect in rectified images";
    } else {
      h.mistake = "the images of camera " + names + " are raw, but the rig gives no distortion";
      h.cure =
          "take a model with distortion (brown_conrady, or kannala_brandt for a fisheye) and free "
          "it, or detect in rectified images";
    }
    h.undo = [group](Rig& r) {
      for (int s : group.second)
        set_lens(group.first ? Lens::pinhole : Lens::brown_conrady, group.first ? 0 : 5,
                 r.sensors[s]);
    };
    out.push_back(h);
  }
}

void add_fisheyes(const Rig& rig, const ObservationIndex& observations,
                  std::vector<Hypothesis>& out) {
  for (const int s : observations.sensors) {
    const Sensor& sensor = rig.sensors[s];
    if (!has_own_lens(sensor)) continue;
    const LensType& own = lens_type(sensor.parameters);
    if (own.lens != Lens::pinhole && own.lens != Lens::brown_conrady) continue;
    const LensType& fisheye = lens_type(Lens::kannala_brandt);
    Hypothesis h{NoticeKind::intrinsics, {Subject::sensor(sensor.name)}};
    h.mistake = "the lens of camera " + quoted(sensor.name) + " is " + fisheye.name +
                " rather than " + own.name;
    h.cure = std::string("write `model: ") + fisheye.name + "` without distortion into sensors." +
             sensor.name + ", and calibrate again";
    h.undo = [s](Rig& r) { set_lens(Lens::kannala_brandt, 4, r.sensors[s]); };
    h.free = {"sensor/" + sensor.name + "/distortion"};
    h.only_of_misfits = true;
    out.push_back(std::move(h));
  }
}

namespace {

/// The largest of a scanning sensor's readings (0), bearings (1) or ranges (2).
double largest_of(const std::vector<Sample>& samples, int sensor, size_t number) {
  double out = 0;
  for (const Sample& sample : samples)
    for (const View& v : sample.views)
      for (size_t i = number; v.sensor == sensor && i < v.z.size(); i += 3)
        out = std::max(out, std::abs(v.z[i]));
  return out;
}

/// Ranges that are further than a scanner sees.
void add_ranges(const Rig& rig, const std::vector<Sample>& samples, int sensor,
                std::vector<Hypothesis>& out) {
  constexpr double kFarRange = 30, kNearRange = 0.1;
  const double most = largest_of(samples, sensor, 2);
  for (const LengthUnit& unit : other_length_units()) {
    if (most < kFarRange || unit.metres * most > kFarRange || unit.metres * most < kNearRange)
      continue;
    out.push_back(
        {NoticeKind::units,
         {Subject::sensor(rig.sensors[sensor].name)},
         "the ranges of sensor " + quoted(rig.sensors[sensor].name) + " are in " + unit.name,
         std::string("write metres into its rays: ") + unit.cure,
         of_numbers(sensor, 2, 3, [factor = unit.metres](double z) { return z * factor; })});
    out.back().new_poses = true;
  }
}

/// Rays are [reading of the joint, bearing, range].
void add_ray_orders(const Rig& rig, int sensor, std::vector<Hypothesis>& out) {
  static const char* const kNumbers[] = {"reading", "bearing", "range"};
  for (const std::array<int, 3>& at :
       {std::array<int, 3>{1, 0, 2}, std::array<int, 3>{2, 0, 1}, std::array<int, 3>{1, 2, 0},
        std::array<int, 3>{0, 2, 1}, std::array<int, 3>{2, 1, 0}}) {  // where each number stands
    std::array<const char*, 3> given{};
    for (int k = 0; k < 3; ++k) given[at[k]] = kNumbers[k];
    out.push_back({NoticeKind::convention,
                   {Subject::sensor(rig.sensors[sensor].name)},
                   "the rays of sensor " + quoted(rig.sensors[sensor].name) +
                       " have their values in the order " + given[0] + ", " + given[1] + ", " +
                       given[2],
                   "write [reading of the joint, bearing, range]",
                   of_views(sensor, [at](const Rig&, View& v) {
                     for (size_t i = 0; i + 2 < v.z.size(); i += 3) {
                       const std::array<double, 3> old = {v.z[i], v.z[i + 1], v.z[i + 2]};
                       for (size_t k = 0; k < 3; ++k) v.z[i + k] = old[at[k]];
                     }
                   })});
    out.back().new_poses = true;
  }
}

}  // namespace

void add_bearings(const Rig& rig, const std::vector<Sample>& samples,
                  const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (int s : observations.sensors) {
    const Sensor& sensor = rig.sensors[s];
    if (!sensor.model->scans()) continue;
    const bool degrees = largest_of(samples, s, 1) > kPi + 0.1;
    const double factor = degrees ? kPi / 180 : -1;
    const std::string of = " of sensor " + quoted(sensor.name) + " are ";
    out.push_back({degrees ? NoticeKind::degrees : NoticeKind::mirrored,
                   {Subject::sensor(sensor.name)},
                   degrees ? "the bearings" + of + "degrees"
                           : "the rays" + of + "mirrored: their bearings have the wrong sign",
                   degrees ? "write radians: multiply them by pi / 180"
                           : "change the sign of its bearings: they count from x towards y",
                   of_numbers(s, 1, 3, [factor](double z) { return z * factor; })});
    add_ranges(rig, samples, s, out);
    add_ray_orders(rig, s, out);
  }
}

// ------------------------------------------------------------------------------------------------
// links
namespace {

/// Other bodies on the way to the root, and up to six joints further out.
std::vector<int> other_bodies(const Tree& tree, int link) {
  constexpr int kFurtherOut = 6;
  std::vector<int> out;
  const int own = immobile_body(tree, link);
  for (int l = own; tree.joint_above[l] >= 0;) {
    l = immobile_body(tree, tree.joints[tree.joint_above[l]].parent);
    out.push_back(l);
  }
  std::vector<int> last = {own};
  for (int k = 0; k < kFurtherOut; ++k) {
    std::vector<int> next;
    for (const Joint& joint : tree.joints)
      if (joint.moves() && std::count(last.begin(), last.end(), immobile_body(tree, joint.parent)))
        next.push_back(joint.child);
    out.insert(out.end(), next.begin(), next.end());
    last = std::move(next);
  }
  return out;
}

/// What sits on a link of the rig, or of a group of these: sensors, or one target.
struct Seat {
  std::vector<int> sensors;
  int target = -1, link = -1;
};

/// Whether all samples that show the seat's things have the readings of the joints between two
/// links, and one of these moves.
bool readings_move_between(const Rig& rig, const std::vector<Sample>& samples, const Seat& seat,
                           int link) {
  const std::vector<int> joints = joints_between(rig, seat.link, link);
  std::map<int, std::pair<double, double>> ranges;
  for (const Sample& s : samples)
    for (const View& v : s.views) {
      if (v.target != seat.target &&
          !std::count(seat.sensors.begin(), seat.sensors.end(), v.sensor))
        continue;
      for (int j : joints) {
        if (!std::isfinite(s.readings[j])) return false;
        auto& range = ranges.insert({j, {s.readings[j], s.readings[j]}}).first->second;
        range = {std::min(range.first, s.readings[j]), std::max(range.second, s.readings[j])};
      }
    }
  return std::any_of(ranges.begin(), ranges.end(),
                     [](const auto& r) { return r.second.second - r.second.first > 1e-3; });
}

/// Whether something that the seat's things see, or are seen by, sits on this body.
bool faces(const Rig& rig, const std::vector<Sample>& samples, const Seat& seat, int body) {
  for (const Sample& s : samples)
    for (const View& v : s.views) {
      const bool sees = std::count(seat.sensors.begin(), seat.sensors.end(), v.sensor) > 0;
      if (!sees && v.target != seat.target) continue;
      const int other = sees ? rig.targets[v.target].link : rig.sensors[v.sensor].link;
      if (other >= 0 && immobile_body(rig.tree, other) == body) return true;
    }
  return false;
}

std::vector<Seat> seats(const Rig& rig, const std::vector<Sample>& samples) {
  const ObservationIndex observations = make_observation_index(rig, samples);
  std::map<int, std::vector<int>> by_link;
  for (int s : observations.sensors)
    if (!rig.sensors[s].model->scans()) by_link[rig.sensors[s].link].push_back(s);
  std::vector<Seat> out;
  for (const auto& group : by_link) {
    out.push_back({group.second, -1, group.first});
    for (int s : group.second)
      if (group.second.size() > 1) out.push_back({{s}, -1, group.first});
  }
  for (int t : observations.targets)
    if (rig.targets[t].link >= 0) out.push_back({{}, t, rig.targets[t].link});
  return out;
}

}  // namespace

void add_links(const Rig& rig, const std::vector<Sample>& samples, std::vector<Hypothesis>& out) {
  for (const Seat& seat : seats(rig, samples))
    for (int link : other_bodies(rig.tree, seat.link)) {
      if (is_between_axes(rig.tree, link) || faces(rig, samples, seat, link) ||
          !readings_move_between(rig, samples, seat, link))
        continue;
      Hypothesis h{NoticeKind::wrong_link};
      h.many = true;
      for (int s : seat.sensors) h.where.push_back(Subject::sensor(rig.sensors[s].name));
      if (seat.target >= 0) h.where.push_back(Subject::target(rig.targets[seat.target].name));
      const std::string& name = rig.tree.links[link];
      h.mistake = std::string(seat.target >= 0     ? "target "
                              : h.where.size() > 1 ? "sensors "
                                                   : "sensor ") +
                  joined(names_of(h.where)) + (h.where.size() > 1 ? " sit" : " sits") +
                  " on link " + quoted(name) + " (or what is fixed to it), not on " +
                  quoted(rig.tree.links[seat.link]);
      h.cure = "correct " +
               (seat.target >= 0 ? "targets." + h.where[0].name + ".mount.link"
                                 : "sensors." + h.where[0].name + ".link") +
               ", and its pose, which counts from there";
      h.new_poses = true;
      h.undo = [seat, link](Rig& r) {
        for (int s : seat.sensors) r.sensors[s].link = link;
        if (seat.target >= 0) r.targets[seat.target].link = link;
      };
      out.push_back(std::move(h));
    }
}

}  // namespace kincal
