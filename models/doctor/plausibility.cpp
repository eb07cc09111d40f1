#include "plausibility.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "../../kinematics/floating.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "data_checks.h"
#include "observation_index.h"
#include "reading_mistakes.h"
#include "trial_fits.h"

namespace kincal {
namespace {

// Nothing that a robot is calibrated with is as large (m), no board has such fields (m).
constexpr double kFarAway = 200, kFarFlange = 20, kFarMounted = 50, kLargeSquare = 2,
                 kSmallSquare = 0.0005;
// Between two joints that move (m, times the next longest link); of a pair of cameras (m); of a
// sliding joint (m) beyond its limits, and without any.
constexpr double kLongestLink = 20, kLongLinkAlone = 5, kTimesTheOthers = 8, kFarBaseline = 3,
                 kBeyondSlide = 1, kFarthestSlide = 20;
constexpr double kDisparity = 3;  // px that two cameras at one place never see
// Multiples of a joint's limits beyond which readings are degrees.
constexpr double kBeyondLimits = 3;
// What is seen of the resolution if all points lie in a corner.
constexpr double kCorner = 0.52, kFilled = 0.35;
constexpr size_t kEnoughViews = 8;
constexpr double kShortestFocal = 0.1;  // of the width: no lens has so short a focal length
constexpr char kWriteMetres[] =
    "write metres: millimetres have to be divided by 1000, centimetres by 100";

constexpr size_t kFewestOfPart = 4;  // points of a view: of fewer the first are nothing strange

/// Where a camera's points lie.
struct PointCloud {
  size_t points = 0, views = 0, outside = 0, outside_turned = 0;
  double right = -kInfinity, low = -kInfinity;  // the largest u and v
  double beyond = 0, u = 0, v = 0;              // of the point furthest outside, px
  std::string sample;
};

/// How far a point lies outside of an image whose pixels have their centres at integers; 0: inside.
double pixels_outside(double u, double v, int width, int height) {
  return std::max({0.0, -0.5 - u, u - (width - 0.5), -0.5 - v, v - (height - 0.5)});
}

std::vector<PointCloud> point_clouds(const Rig& rig, const std::vector<Sample>& samples) {
  std::vector<PointCloud> out(rig.sensors.size());
  for (const Sample& sample : samples)
    for (const View& view : sample.views) {
      const Sensor& sensor = rig.sensors[view.sensor];
      const int width = sensor.image_width, height = sensor.image_height;
      if (sensor.model->measurement_kind() != MeasurementKind::rays || width <= 0) continue;
      PointCloud& cloud = out[view.sensor];
      ++cloud.views;
      for (size_t i = 0; i + 1 < view.z.size(); i += 2) {
        const double u = view.z[i], v = view.z[i + 1], beyond = pixels_outside(u, v, width, height);
        ++cloud.points;
        cloud.outside += beyond > 0;
        cloud.outside_turned += pixels_outside(u, v, height, width) > 0;
        cloud.right = std::max(cloud.right, u);
        cloud.low = std::max(cloud.low, v);
        if (!(beyond > cloud.beyond)) continue;
        cloud.beyond = beyond;
        cloud.u = u;
        cloud.v = v;
        cloud.sample = sample.id;
      }
    }
  return out;
}

/// fx fy cx cy.
using Intrinsics = std::array<double, 4>;

bool plausible(const Intrinsics& k, int width, int height, double margin) {
  return k[0] > 0 && k[1] > 0 && std::max(k[0], k[1]) < 1.25 * std::min(k[0], k[1]) &&
         std::abs(k[2] - 0.5 * width) < margin * width &&
         std::abs(k[3] - 0.5 * height) < margin * height;
}

/// The size of the image that a camera's intrinsics and points suit where image_size is larger; the
/// points must fill it. nullopt: none.
std::optional<std::pair<int, int>> smaller_image(const Sensor& sensor, const PointCloud& cloud) {
  constexpr double kSmaller = 0.8, kFills = 0.7;
  const ParameterBlock* block = find_block(sensor, ParameterKind::intrinsics);
  if (!block || block->values.size() != 4) return std::nullopt;
  const double width = 2 * block->values[2], height = 2 * block->values[3];
  if (!(width > 0 && height > 0) || width > kSmaller * sensor.image_width ||
      height > kSmaller * sensor.image_height || cloud.right > 1.02 * width ||
      cloud.low > 1.02 * height || cloud.right < kFills * width || cloud.low < kFills * height)
    return std::nullopt;
  return std::pair(static_cast<int>(std::lround(width)), static_cast<int>(std::lround(height)));
}

void check_images(const Rig& rig, const std::vector<PointCloud>& clouds, std::vector<Notice>& out) {
  for (size_t s = 0; s < clouds.size(); ++s) {
    const PointCloud& cloud = clouds[s];
    const Sensor& sensor = rig.sensors[s];
    const int width = sensor.image_width, height = sensor.image_height;
    if (cloud.outside > 0) {
      const bool turned = cloud.outside_turned == 0 && width != height;
      const bool larger = 5 * cloud.outside > cloud.points && cloud.right < 2 * width &&
                          cloud.low < 2 * height && cloud.right > 1.3 * width;
      out.push_back(make_notice(
          NoticeKind::points_outside, {Subject::sensor(sensor.name)},
          "of camera " + quoted(sensor.name) +
              text(" %zu of %zu points lie outside its image of %d x %d pixels, the worst by %.3g "
                   "px, at (%.5g, %.5g) in sample ",
                   cloud.outside, cloud.points, width, height, cloud.beyond, cloud.u, cloud.v) +
              quoted(cloud.sample),
          turned   ? "all lie inside it if width and height are exchanged"
          : larger ? "they look like points of an image twice as large"
                   : "",
          turned   ? "correct image_size, or exchange u and v of the points"
          : larger ? "make points, image_size and intrinsics those of one resolution"
                   : "correct image_size, or remove these points: no image can show them"));
    } else if (cloud.views >= kEnoughViews && cloud.right < kCorner * width &&
               cloud.low < kCorner * height && cloud.right > kFilled * width &&
               cloud.low > kFilled * height) {
      out.push_back(make_notice(
          NoticeKind::resolution, {Subject::sensor(sensor.name)},
          "all points of camera " + quoted(sensor.name) +
              text(" lie in the upper left quarter of its image of %d x %d pixels: they are of "
                   "images of half that size, or image_size is not that of the images used for "
                   "detection",
                   width, height),
          "", "make points, image_size and intrinsics those of one resolution"));
    } else if (const auto size = smaller_image(sensor, cloud);
               size && cloud.views >= kEnoughViews) {
      out.push_back(make_notice(
          NoticeKind::resolution, {Subject::sensor(sensor.name)},
          "all points of camera " + quoted(sensor.name) +
              text(" lie in the upper left %d x %d pixels of its image of %d x %d, whose middle "
                   "the intrinsics have",
                   size->first, size->second, width, height),
          "", "correct image_size, or make points and intrinsics those of the whole image"));
    }
  }
}

void check_intrinsics(const Sensor& sensor, const PointCloud& cloud, std::vector<Notice>& out) {
  const ParameterBlock* block = find_block(sensor, ParameterKind::intrinsics);
  const int width = sensor.image_width, height = sensor.image_height;
  if (!block || block->values.size() != 4 || width <= 0) return;
  const Intrinsics k = {block->values[0], block->values[1], block->values[2], block->values[3]};
  const auto add = [&](std::string what, std::string cure) {
    out.push_back(make_notice(NoticeKind::intrinsics, {Subject::sensor(sensor.name)},
                              std::move(what), "", std::move(cure)));
  };
  // (With a centre in pixels; else the whole is of normalised coordinates.)
  if (plausible(k, width, height, 0.3) && std::max(k[0], k[1]) < kShortestFocal * width) {
    add("the focal lengths of camera " + quoted(sensor.name) +
            text(", %.5g and %.5g, are far too small for its image of %d x %d pixels", k[0], k[1],
                 width, height),
        "write pixels: millimetres have to be divided by the size of a pixel on the chip in "
        "millimetres");
    return;
  }
  if (plausible(k, width, height, 0.3)) return;
  const std::string given = text("[%.5g, %.5g, %.5g, %.5g]", k[0], k[1], k[2], k[3]);
  const std::string begin = "the intrinsics of camera " + quoted(sensor.name) + ", " + given +
                            text(", do not suit its image of %d x %d pixels: ", width, height);
  if (width != height && cloud.points > 0 && cloud.outside_turned == 0 &&
      plausible(k, height, width, 0.15)) {
    if (cloud.outside == 0)  // else that says it
      add(begin +
              text("they suit one of %d x %d, and no point lies outside of that", height, width),
          text("if the images have this size, write image_size: [%d, %d]; if not, exchange cx and "
               "cy",
               height, width));
    return;
  }
  const std::pair<Intrinsics, const char*> orders[] = {{{k[0], k[2], k[1], k[3]}, "fx cx fy cy"},
                                                       {{k[2], k[3], k[0], k[1]}, "cx cy fx fy"},
                                                       {{k[0], k[1], k[3], k[2]}, "fx fy cy cx"}};
  for (const auto& order : orders)
    if (plausible(order.first, width, height, 0.15)) {
      add(begin + "they are " + order.second + " there",
          text("write them as fx, fy, cx, cy: [%.5g, %.5g, %.5g, %.5g]", order.first[0],
               order.first[1], order.first[2], order.first[3]));
      return;
    }
  const double times = 2 * k[2] / width;
  if (times > 0 && std::abs(std::log(times)) > std::log(1.5) &&
      plausible({k[0] / times, k[1] / times, k[2] / times, k[3] / times}, width, height, 0.05))
    add(begin + text("they are of an image %.3g times as large", times),
        "make them and image_size those of one resolution");
  else if (!(k[2] > -0.5 && k[2] < width - 0.5 && k[3] > -0.5 && k[3] < height - 0.5))
    add(begin + "their principal point (cx, cy) lies outside of it",
        "write them as fx, fy, cx, cy, and correct image_size");
}

/// Views without ids count as the first points of their target: where all that show a part show
/// the first so many, in order, that is likelier than that the rest was hidden.
void check_ids(const Rig& rig, const std::vector<Sample>& samples, std::vector<Notice>& out) {
  struct Parts {
    size_t views = 0, partial = 0, first = 0, fewest = 0;
    std::string sample;
  };
  std::map<int, Parts> parts;  // by target
  for (const Sample& sample : samples)
    for (const View& view : sample.views) {
      const Target& target = rig.targets[view.target];
      if (!target.grid || rig.sensors[view.sensor].model->measures_pose()) continue;
      Parts& p = parts[view.target];
      ++p.views;
      const size_t n = view.ids.size();
      if (n >= static_cast<size_t>(target.count())) continue;
      ++p.partial;
      bool first = n >= kFewestOfPart;
      for (size_t k = 0; first && k < n; ++k) first = view.ids[k] == static_cast<int>(k);
      if (!first) continue;
      if (p.first++ == 0) p.sample = sample.id, p.fewest = n;
      p.fewest = std::min(p.fewest, n);
    }
  for (const auto& [t, p] : parts)
    if (p.first >= 3 && p.first == p.partial)
      out.push_back(make_notice(
          NoticeKind::numbering, {Subject::target(rig.targets[t].name)},
          text("%zu of %zu views of target ", p.first, p.views) + quoted(rig.targets[t].name) +
              text(" have the first of its %d points, in order, and not the last (%zu at least, "
                   "first sample ",
                   rig.targets[t].count(), p.fewest) +
              quoted(p.sample) + ")",
          "points without \"ids\" count as 0, 1, 2, ...",
          "if a view shows only a part of the board, write the ids of its points; if it shows all, "
          "check rows and columns in the rig"));
}

/// Whether no robot has a link as long as the one that ends at a joint.
bool too_long(const Tree& tree, const Joint& joint) {
  const double length = joint.parent_T_joint.translation.norm();
  if (length > kFarMounted) return true;
  bool carried = false;  // what stands in the room may stand anywhere
  for (int j = tree.joint_above[joint.parent]; j >= 0 && !carried;
       j = tree.joint_above[tree.joints[j].parent])
    carried = tree.joints[j].moves();
  if (!carried || length < kLongLinkAlone) return false;
  double longest = 0;
  for (const Joint& other : tree.joints)
    if (&other != &joint) longest = std::max(longest, other.parent_T_joint.translation.norm());
  return length > kLongestLink || length > kTimesTheOthers * longest;
}

void check_lengths(const Rig& rig, std::vector<Notice>& out) {
  for (const Target& target : rig.targets) {
    const bool small = target.grid && target.square > 0 && target.square < kSmallSquare;
    if (target.grid && (small || target.square > kLargeSquare))
      out.push_back(make_notice(
          NoticeKind::square, {Subject::target(target.name)},
          "the fields of target " + quoted(target.name) +
              text(" are %.4g m large in the rig", target.square),
          "",
          small ? "measure, and write metres"
                : text("write metres: %.4g if these are millimetres, %.4g if centimetres",
                       target.square / 1000, target.square / 100)));
    if (!target.grid && target.points.cols() > 0 &&
        target.points.cwiseAbs().maxCoeff() > kFarMounted)
      out.push_back(make_notice(
          NoticeKind::square, {Subject::target(target.name)},
          "points of target " + quoted(target.name) +
              text(" are %.4g m from its origin in the rig", target.points.cwiseAbs().maxCoeff()),
          "", kWriteMetres));
  }
  const auto far = [&](const Subject& of, const std::string& what, const char* from,
                       double distance) {
    out.push_back(make_notice(
        NoticeKind::units, {of},
        what + " " + quoted(of.name) + text(" stands %.4g m from its %s", distance, from), "",
        kWriteMetres));
  };
  for (const Sensor& s : rig.sensors)
    if (const double distance = s.link_T_sensor.translation.norm(); distance > kFarMounted)
      far(Subject::sensor(s.name), "sensor", "link in the rig", distance);
  for (const Target& t : rig.targets)
    if (const double distance = t.link_T_target.translation.norm();
        t.link >= 0 && distance > kFarMounted)
      far(Subject::target(t.name), "target", "link in the rig", distance);
  for (const Joint& joint : rig.tree.joints)
    if (too_long(rig.tree, joint)) {
      far(Subject::joint(joint.name), "joint", "parent link in the URDF",
          joint.parent_T_joint.translation.norm());
      break;
    }
}

/// Measured points or positions, and poses of floating joints, of which more than half are further
/// away than anything.
void check_distances(const Rig& rig, const std::vector<Sample>& samples, std::vector<Notice>& out) {
  const auto check = [&](std::vector<double> distances, double most, NoticeKind kind,
                         const Subject& of, const std::string& what, const std::string& cure) {
    if (const double middle = median(std::move(distances), 0); middle > most)
      out.push_back(make_notice(kind, {of}, what + text(" %.4g m away", middle), "", cure));
  };
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.sensors[s];
    const MeasurementKind kind = sensor.model->measurement_kind();
    std::vector<double> distances;
    for (const Sample& sample : samples)
      for (const View& view : sample.views) {
        if (view.sensor != static_cast<int>(s) || sensor.model->scans()) continue;
        const size_t end = kind == MeasurementKind::points ? view.z.size()
                           : kind == MeasurementKind::pose ? std::min<size_t>(3, view.z.size())
                                                           : 0;
        for (size_t i = 0; i + 2 < end; i += 3)
          distances.push_back(std::hypot(view.z[i], view.z[i + 1], view.z[i + 2]));
      }
    check(
        std::move(distances), kFarAway, NoticeKind::square, Subject::sensor(sensor.name),
        "sensor " + quoted(sensor.name) + " measures points",
        "write metres into its views: millimetres have to be divided by 1000, centimetres by 100");
  }
  for (const int j : make_observation_index(rig, samples).floating) {
    const std::string& name = rig.tree.joints[j].name;
    std::vector<double> distances;
    for (const Sample& sample : samples)
      if (const Pose pose = pose_reading(rig.tree, j, sample.readings);
          pose.translation.allFinite())
        distances.push_back(pose.translation.norm());
    check(std::move(distances), kFarFlange, NoticeKind::units, Subject::joint(name),
          "the poses of joint " + quoted(name) + " are", kWriteMetres);
  }
}

void check_angles(const Rig& rig, const std::vector<Sample>& samples, std::vector<Notice>& out) {
  std::vector<std::string> names;
  double worst = 0;
  for (const auto& range : make_observation_index(rig, samples).ranges) {
    const Joint& joint = rig.tree.joints[range.first];
    // (Others may have turned on and on: the fits decide.)
    if (joint.type != JointType::revolute || !(joint.upper > joint.lower)) continue;
    const double reach = std::max(std::abs(joint.lower), std::abs(joint.upper)),
                 allowed = std::max(2 * kPi, kBeyondLimits * reach);
    const double most = std::abs(rig.joints[range.first].scale) *  // readings may be pulses
                        std::max(std::abs(range.second.first), std::abs(range.second.second));
    if (!(most > allowed)) continue;
    names.push_back(joint.name);
    worst = std::max(worst, most);
  }
  if (names.empty()) return;
  out.push_back(make_notice(NoticeKind::degrees, subjects(Subject::Kind::joint, names),
                            std::string("joint") + (names.size() == 1 ? " " : "s ") +
                                joined(names) + (names.size() == 1 ? " has" : " have") +
                                text(" readings of up to %.4g rad", worst),
                            "", "write radians: degrees have to be multiplied by pi / 180"));
}

/// Whether a sensor saw a mounted target move, by far more than noise.
bool sees_motion(const Rig& rig, const std::vector<Sample>& samples) {
  std::map<std::pair<int, int>, const View*> first;
  for (const Sample& sample : samples)
    for (const View& v : sample.views) {
      if (rig.targets[v.target].link < 0 || v.sigma.empty()) continue;
      const View& before = *first.try_emplace({v.sensor, v.target}, &v).first->second;
      if (before.ids != v.ids || before.z.size() != v.z.size()) continue;
      const double sigma = *std::max_element(v.sigma.begin(), v.sigma.end());
      for (size_t i = 0; i < v.z.size(); ++i)
        if (std::abs(v.z[i] - before.z[i]) > Thresholds::far_point * sigma) return true;
    }
  return false;
}

/// Poses of a floating joint that are the same in all samples, although targets move in the views.
void check_still_poses(const Rig& rig, const std::vector<Sample>& samples,
                       std::vector<Notice>& out) {
  for (const int j : make_observation_index(rig, samples).floating) {
    const int axis = rig.tree.joints[j].first_axis;
    const auto same = [&](const Sample& s) {
      return std::equal(s.readings.begin() + axis, s.readings.begin() + axis + kPoseAxes,
                        samples[0].readings.begin() + axis);
    };
    if (samples.size() > 2 && std::all_of(samples.begin(), samples.end(), same) &&
        sees_motion(rig, samples))
      out.push_back(make_notice(
          NoticeKind::still_joint, {Subject::joint(rig.tree.joints[j].name)},
          "the poses of joint " + quoted(rig.tree.joints[j].name) + " are the same in all " +
              std::to_string(samples.size()) + " samples, but targets move in the views",
          "", "record them with each sample: the recorded value is constant"));
  }
}

void check_slides(const Rig& rig, const std::vector<Sample>& samples, std::vector<Notice>& out) {
  for (const auto& range : make_observation_index(rig, samples).ranges) {
    const Joint& joint = rig.tree.joints[range.first];
    if (joint.type != JointType::prismatic) continue;
    const bool limited = joint.upper > joint.lower;
    const double reach = std::max(std::abs(joint.lower), std::abs(joint.upper)),
                 allowed = limited ? std::max(kBeyondLimits * reach, reach + kBeyondSlide)
                                   : kFarthestSlide,
                 low = range.second.first, high = range.second.second;
    const double most = std::abs(low) > std::abs(high) ? low : high;
    if (!(std::abs(most) > allowed)) continue;
    std::string unit;
    for (const LengthUnit& u : other_length_units())
      if (unit.empty() && limited && std::abs(most) * u.metres < 1.2 * reach)
        unit = std::string(": if these are ") + u.name + ", " + u.cure;
    out.push_back(make_notice(
        NoticeKind::units, {Subject::joint(joint.name)},
        "sliding joint " + quoted(joint.name) + text(" has readings of up to %.5g m", most) +
            (limited ? text(", its limits in the URDF are %.4g and %.4g", joint.lower, joint.upper)
                     : std::string()),
        "", "write metres" + unit));
  }
}

/// By how much further right (px) one camera sees the same points than another, by what a pair at
/// one place would see; nothing: they see nothing together.
std::optional<double> disparity(const std::vector<Sample>& samples, int a, int b) {
  double sum = 0;
  long count = 0;
  for (const Sample& sample : samples)
    for (const View& va : sample.views)
      for (const View& vb : sample.views) {
        if (va.sensor != a || vb.sensor != b || va.target != vb.target) continue;
        for (size_t i = 0; i < va.ids.size(); ++i) {
          const auto k = std::find(vb.ids.begin(), vb.ids.end(), va.ids[i]) - vb.ids.begin();
          if (k == static_cast<std::ptrdiff_t>(vb.ids.size())) continue;
          sum += va.z[2 * i] - vb.z[2 * static_cast<size_t>(k)];
          ++count;
        }
      }
  if (count == 0) return std::nullopt;
  return sum / static_cast<double>(count);
}

/// Baselines that are not metres, or that the views of a rectified pair contradict.
void check_baselines(const Rig& rig, const std::vector<Sample>& samples, std::vector<Notice>& out) {
  const auto number = [](const Sensor& s, ParameterKind kind, size_t i) {
    const ParameterBlock* block = find_block(s, kind);
    return block && block->values.size() > i ? block->values[i] : std::nan("");
  };
  for (size_t a = 0; a < rig.sensors.size(); ++a) {
    const Sensor& one = rig.sensors[a];
    const double baseline = number(one, ParameterKind::baseline, 0);
    if (std::abs(baseline) > kFarBaseline)
      out.push_back(
          make_notice(NoticeKind::baseline, {Subject::sensor(one.name)},
                      "the baseline of camera " + quoted(one.name) + text(" is %.4g m", baseline),
                      "", text("write metres: millimetres would be %.4g", baseline / 1000)));
    for (size_t b = a + 1; b < rig.sensors.size() && std::isfinite(baseline); ++b) {
      const Sensor& other = rig.sensors[b];
      const double apart = number(other, ParameterKind::baseline, 0) - baseline;
      // (Without a baseline between them, two cameras whose poses are open may stand anywhere.)
      const bool together = one.link == other.link && one.pose_given == other.pose_given &&
                            (one.pose_given || apart != 0) &&
                            log_se3(inverse(one.link_T_sensor) * other.link_T_sensor).norm() < 1e-9;
      if (!together || !std::isfinite(apart) ||
          number(one, ParameterKind::intrinsics, 0) != number(other, ParameterKind::intrinsics, 0))
        continue;
      const std::optional<double> seen =
          disparity(samples, static_cast<int>(a), static_cast<int>(b));
      const double centres =
          number(one, ParameterKind::intrinsics, 2) - number(other, ParameterKind::intrinsics, 2);
      if (!seen || std::abs(*seen - centres) < kDisparity || apart * (*seen - centres) > 0)
        continue;
      const Sensor &right = *seen > centres ? other : one, &left = *seen > centres ? one : other;
      out.push_back(make_notice(
          NoticeKind::baseline, {Subject::sensor(right.name), Subject::sensor(left.name)},
          "cameras " + quoted(one.name) + " and " + quoted(other.name) +
              (apart == 0 ? " stand at one place in the rig, without a baseline between them"
                          : " stand the other way round than they see") +
              text(": the same points lie %.3g px further %s in the first",
                   std::abs(*seen - centres), *seen > centres ? "right" : "left"),
          "",
          "give camera " + quoted(right.name) +
              ", which is the right one, the (positive) baseline, the other 0" +
              (apart == 0 ? "" : "; or exchange the names in the views")));
    }
  }
}

}  // namespace

std::vector<Notice> find_implausible(const Rig& rig, const std::vector<Sample>& samples) {
  std::vector<Notice> out;
  const std::vector<PointCloud> clouds = point_clouds(rig, samples);
  check_lengths(rig, out);
  check_distances(rig, samples, out);
  check_angles(rig, samples, out);
  check_still_poses(rig, samples, out);
  check_slides(rig, samples, out);
  check_baselines(rig, samples, out);
  check_ids(rig, samples, out);
  for (size_t s = 0; s < rig.sensors.size(); ++s) check_intrinsics(rig.sensors[s], clouds[s], out);
  check_images(rig, clouds, out);
  for (Notice& f : find_duplicates(rig, samples)) out.push_back(std::move(f));
  return out;
}

}  // namespace kincal
