#include "camera_mistakes.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/words.h"
#include "../sensors/sensors.h"

namespace kincal {
namespace {

/// Normalised coordinates are below this (70 degrees), focal lengths in pixels above the other.
constexpr double kMostNormalised = 3, kLeastFocalLength = 20;
/// A principal point that moved by less of the image's width than this is no cropped image.
constexpr double kLeastCrop = 0.03;

/// fx fy cx cy of a camera; nothing: it is none.
const std::vector<double>* intrinsics_of(const Sensor& sensor) {
  if (sensor.model->measurement_kind() != MeasurementKind::rays) return nullptr;
  const ParameterBlock* block = find_block(sensor, ParameterKind::intrinsics);
  return block && block->values.size() == 4 ? &block->values : nullptr;
}

void set_intrinsics(Sensor& sensor, const std::vector<double>& values) {
  for (ParameterBlock& block : sensor.parameters)
    if (block.name == "intrinsics") block.values = values;
}

/// Cameras that a mistake may be about together: each alone, those of one link, all. A robot with
/// many has no time for links.
std::set<std::vector<int>> camera_sets(const Rig& rig, const ObservationIndex& observations) {
  std::map<int, std::vector<int>> on_link;
  std::set<std::vector<int>> out;
  std::vector<int> all;
  for (int s : observations.sensors)
    if (intrinsics_of(rig.sensors[s])) {
      on_link[rig.sensors[s].link].push_back(s);
      all.push_back(s);
      out.insert({s});
    }
  if (all.size() <= 4)
    for (const auto& link : on_link) out.insert(link.second);
  if (!all.empty()) out.insert(all);
  return out;
}

std::vector<std::string> names_of(const Rig& rig, const std::vector<int>& sensors) {
  std::vector<std::string> out;
  for (int s : sensors) out.push_back(rig.sensors[s].name);
  return out;
}

/// "camera 'a'", "cameras 'a' and 'b'".
std::string cameras(const Rig& rig, const std::vector<int>& group) {
  std::vector<std::string> names;
  for (int s : group) names.push_back(quoted(rig.sensors[s].name));
  return (group.size() == 1 ? "camera " : "cameras ") + listed(names, 12);
}

/// Where a camera's pixels lie.
struct Pixels {
  std::array<std::vector<double>, 2> numbers;  // u, v
  double most = 0;                             // of their sizes

  std::array<double, 2> middle() const { return {median(numbers[0]), median(numbers[1])}; }
};

Pixels pixels_of(const std::vector<Sample>& samples, int sensor) {
  Pixels out;
  for (const Sample& sample : samples)
    for (const View& v : sample.views)
      if (v.sensor == sensor)
        for (size_t i = 0; i < v.z.size(); ++i) {
          out.numbers[i % 2].push_back(v.z[i]);
          out.most = std::max(out.most, std::abs(v.z[i]));
        }
  return out;
}

/// Intrinsics of an image that is `factor` times as large. Pixel centres have whole numbers.
std::vector<double> scaled_intrinsics(const std::vector<double>& k, double factor) {
  return {k[0] * factor, k[1] * factor, (k[2] + 0.5) * factor - 0.5, (k[3] + 0.5) * factor - 0.5};
}

/// Whether the pixels lie as if the image were `factor` times as large: clearly nearer to its
/// middle.
bool lies_as_if(const Pixels& pixels, const std::vector<double>& k, double factor) {
  if (pixels.most < kMostNormalised) return false;
  const std::array<double, 2> middle = pixels.middle();
  const std::vector<double> other = scaled_intrinsics(k, factor);
  return std::hypot(middle[0] - other[2], middle[1] - other[3]) <
         0.6 * std::hypot(middle[0] - k[2], middle[1] - k[3]);
}

struct PlainFactor {
  double factor;
  const char* words;
};

const std::vector<PlainFactor>& plain_factors() {
  static const std::vector<PlainFactor> all = {
      {0.25, "a quarter as large"}, {1.0 / 3, "a third as large"}, {0.5, "half as large"},
      {0.625, "5/8 as large"},      {2.0 / 3, "2/3 as large"},     {0.75, "3/4 as large"},
      {0.8, "4/5 as large"},        {1.25, "5/4 times as large"},  {4.0 / 3, "4/3 times as large"},
      {1.5, "1.5 times as large"},  {1.6, "1.6 times as large"},   {2, "twice as large"},
      {3, "three times as large"},  {4, "four times as large"}};
  return all;
}

Hypothesis about(const Rig& rig, NoticeKind kind, const std::vector<int>& group) {
  Hypothesis h;
  h.kind = kind;
  h.where = subjects(Subject::Kind::sensor, names_of(rig, group));
  return h;
}

/// The views of a camera that writes normalised coordinates, in pixels; `undistorted`: they were
/// freed of the lens's distortion, too.
Hypothesis normalised_views(const Rig& rig, int s, bool undistorted) {
  Hypothesis h = about(rig, NoticeKind::normalised, {s});
  h.mistake = "the views of camera " + quoted(rig.sensors[s].name) + " are normalised coordinates" +
              (undistorted ? ", without distortion," : "") + " but its intrinsics are pixels";
  h.cure = std::string("write the pixels as detected") +
           (undistorted ? " (not those of undistortPoints)" : "") +
           ", or give the rig model: pinhole, intrinsics: [1, 1, 0, 0] and a sigma that is "
           "divided by fx";
  h.rescaled = s;
  h.factor = (*intrinsics_of(rig.sensors[s]))[0];
  h.undo = [s, undistorted](Rig& r, std::vector<Sample>& samples) {
    Sensor& camera = r.sensors[s];
    const std::vector<double> k = *intrinsics_of(camera);
    for (Sample& sample : samples)
      for (View& v : sample.views)
        if (v.sensor == s)
          for (size_t i = 0; i < v.z.size(); ++i) v.z[i] = k[i % 2] * v.z[i] + k[2 + i % 2];
    if (!undistorted) return;
    const double baseline = find_block(camera, ParameterKind::baseline)->values[0];
    camera.model = make_camera(Lens::pinhole, 0);
    camera.parameters = camera_parameters(Lens::pinhole, k, {}, baseline);
  };
  return h;
}

/// The reverse: what the intrinsics are is not known and is free besides.
Hypothesis normalised_intrinsics(const Rig& rig, int s, const Pixels& pixels) {
  Hypothesis h = about(rig, NoticeKind::normalised, {s});
  const Sensor& camera = rig.sensors[s];
  h.mistake = "the views of camera " + quoted(camera.name) +
              " are pixels, but its intrinsics are those of normalised coordinates";
  h.cure =
      "give the camera's intrinsics in pixels and its sigma in pixels, or write normalised "
      "coordinates into its views";
  h.free = {"sensor/" + camera.name + "/intrinsics"};
  const std::array<double, 2> middle = pixels.middle();
  const double width = camera.image_width > 0 ? camera.image_width : 2 * middle[0] + 1,
               height = camera.image_height > 0 ? camera.image_height : 2 * middle[1] + 1;
  h.undo = [s, width, height](Rig& r, std::vector<Sample>& samples) {
    const double focal_length = std::max(width, height);
    set_intrinsics(r.sensors[s], {focal_length, focal_length, (width - 1) / 2, (height - 1) / 2});
    const bool small = r.sensors[s].sigma[0] < 0.02;  // of normalised coordinates, too
    if (!small) return;
    for (double& sigma : r.sensors[s].sigma) sigma *= focal_length;
    for (Sample& sample : samples)
      for (View& v : sample.views)
        if (v.sensor == s)
          for (double& sigma : v.sigma.own()) sigma *= focal_length;
  };
  return h;
}

using MistakeAndCure = std::pair<std::string, std::string>;

/// How far a principal point (cx cy) is from that of fx fy cx cy in the rig, and where; no mistake
/// if it is not far enough to be that of a cropped image.
MistakeAndCure cropped_words(const std::string& camera, const std::vector<double>& given,
                             const std::vector<double>& found) {
  const double du = found[0] - given[2], dv = found[1] - given[3];
  if (!(std::hypot(du, dv) > kLeastCrop * 2 * std::abs(given[2]))) return {};
  return {"the principal point of camera " + quoted(camera) +
              text(" is wrong: (%.6g, %.6g) in the rig, (%.6g, %.6g) from the data, %+.4g px in u "
                   "and %+.4g px in v. So its images are cropped (or the intrinsics belong to "
                   "another image)",
                   given[2], given[3], found[0], found[1], du, dv),
          "give the intrinsics of the image in which the points were detected: of a cropped one, "
          "cx minus the columns that are cut off at the left, cy minus the rows at the top; or "
          "free sensor/" +
              camera + "/intrinsics"};
}

/// Of focal lengths (fx fy) that are others than the rig's.
MistakeAndCure focal_words(const std::string& camera, const std::vector<double>& given,
                           const std::vector<double>& found) {
  double most = 0;
  for (size_t i = 0; i < 2; ++i) {
    const double factor = found[i] / given[i];
    if (!(factor > 0.1 && factor < 10)) return {};
    most = std::max(most, std::abs(factor - 1));
  }
  if (!(most > scales(ParameterKind::intrinsics, "px").least)) return {};
  return {"the focal lengths of camera " + quoted(camera) +
              text(" are wrong: %.6g and %.6g px in the rig, %.6g and %.6g px from the data (times "
                   "%.4g)",
                   given[0], given[1], found[0], found[1], found[0] / given[0]),
          "give the intrinsics of this camera, with the lens, zoom and resolution of these images; "
          "or free sensor/" +
              camera + "/intrinsics"};
}

}  // namespace

void add_exchanged_axes(const Rig& rig, const ObservationIndex& observations,
                        std::vector<Hypothesis>& out) {
  for (const std::vector<int>& group : camera_sets(rig, observations)) {
    Hypothesis h = about(rig, NoticeKind::exchanged_axes, group);
    h.mistake = "u and v are exchanged in the views of " + cameras(rig, group);
    h.cure =
        "write [u, v]: first the column, counted to the right, then the row, counted "
        "downwards";
    h.undo = [group](Rig&, std::vector<Sample>& samples) {
      for (Sample& sample : samples)
        for (View& v : sample.views)
          if (std::count(group.begin(), group.end(), v.sensor))
            for (size_t i = 0; i + 1 < v.z.size(); i += 2) std::swap(v.z[i], v.z[i + 1]);
    };
    out.push_back(h);
  }
}

void add_resolutions(const Rig& rig, const ParameterTable& table,
                     const std::vector<Sample>& samples, const ObservationIndex& observations,
                     const FreedNames& freed, std::vector<Hypothesis>& out) {
  std::map<int, Pixels> pixels;
  for (int s : observations.sensors)
    if (intrinsics_of(rig.sensors[s])) pixels[s] = pixels_of(samples, s);
  for (const std::vector<int>& group : camera_sets(rig, observations))
    for (size_t i = 0; i < plain_factors().size(); ++i) {
      const PlainFactor& plain = plain_factors()[i];
      const double factor = plain.factor;
      const auto as_if = [&](size_t k) {
        return k < plain_factors().size() && std::all_of(group.begin(), group.end(), [&](int s) {
                 return lies_as_if(pixels[s], *intrinsics_of(rig.sensors[s]),
                                   plain_factors()[k].factor);
               });
      };
      // (Few views show a board anywhere: they may look like the next factor.)
      if (!as_if(i) && !as_if(i + 1) && !(i > 0 && as_if(i - 1))) continue;
      Hypothesis h = about(rig, NoticeKind::resolution, group);
      h.mistake = "the views of " + cameras(rig, group) + " are of images " + plain.words +
                  " as those of the rig's intrinsics";
      const std::string number = text("%.4g", factor);
      h.cure = "give the intrinsics of this resolution (fx and fy times " + number +
               ", cx = (cx' + 0.5) * " + number +
               " - 0.5, cy alike; image_size too), or scale "
               "the pixels: u = (u' + 0.5) / " +
               number + " - 0.5, v alike";
      h.undo = [group, factor](Rig& r) {
        for (int s : group)
          set_intrinsics(r.sensors[s], scaled_intrinsics(*intrinsics_of(r.sensors[s]), factor));
      };
      out.push_back(h);
    }
  for (const auto& camera : pixels) {
    const int block = table.index_of(ParameterKind::intrinsics, camera.first);
    if (block < 0 || freed.parameter[block]) continue;
    const std::vector<double> given = *intrinsics_of(rig.sensors[camera.first]);
    Hypothesis h = about(rig, NoticeKind::resolution, {camera.first});
    h.free = {table.all[block].component_name(2), table.all[block].component_name(3)};
    h.undo = [](Rig&) {};
    h.told = [given, name = h.where[0].name](const std::vector<double>& found) {
      return cropped_words(name, given, found);
    };
    out.push_back(h);
    h.kind = NoticeKind::intrinsics;
    h.free = {table.all[block].component_name(0), table.all[block].component_name(1)};
    h.told = [given, name = h.where[0].name](const std::vector<double>& found) {
      return focal_words(name, given, found);
    };
    out.push_back(h);
  }
}

void add_orders(const Rig& rig, const ObservationIndex& observations,
                std::vector<Hypothesis>& out) {
  struct Order {
    const char* written;        // what the numbers of the rig are
    std::array<int, 4> places;  // of fx fy cx cy in them
  };
  static const std::vector<Order> orders = {{"fx cx fy cy", {0, 2, 1, 3}},
                                            {"cx cy fx fy", {2, 3, 0, 1}},
                                            {"fx fy cy cx", {0, 1, 3, 2}},
                                            {"cx fx cy fy", {1, 3, 0, 2}},
                                            {"cy cx fy fx", {3, 2, 1, 0}}};
  const auto oblong = [](const std::vector<double>& k) {
    return k[0] > 0 && k[1] > 0 ? std::abs(std::log(k[0] / k[1])) : kInfinity;
  };
  for (const std::vector<int>& group : camera_sets(rig, observations))
    for (const Order& order : orders) {
      const auto reordered = [&](int s) {
        const std::vector<double>& k = *intrinsics_of(rig.sensors[s]);
        std::vector<double> other;
        for (int place : order.places) other.push_back(k[place]);
        return other;
      };
      if (!std::all_of(group.begin(), group.end(), [&](int s) {
            const std::vector<double>& k = *intrinsics_of(rig.sensors[s]);
            const std::vector<double> other = reordered(s);
            double change = 0;
            for (int i = 0; i < 4; ++i) change = std::max(change, std::abs(other[i] - k[i]));
            return oblong(other) < oblong(k) + 0.05 && change > 0.01 * std::abs(k[0]);
          }))
        continue;
      Hypothesis h = about(rig, NoticeKind::intrinsics, group);
      h.mistake =
          "the intrinsics of " + cameras(rig, group) + " stand in the order " + order.written;
      h.cure = "write them as intrinsics: [fx, fy, cx, cy]" +
               (group.size() > 1
                    ? std::string()
                    : text(", here [%.6g, %.6g, %.6g, %.6g]", reordered(group[0])[0],
                           reordered(group[0])[1], reordered(group[0])[2], reordered(group[0])[3]));
      std::map<int, std::vector<double>> right;
      for (int s : group) right[s] = reordered(s);
      h.undo = [right](Rig& r) {
        for (const auto& camera : right) set_intrinsics(r.sensors[camera.first], camera.second);
      };
      out.push_back(h);
    }
}

void add_normalised(const Rig& rig, const std::vector<Sample>& samples,
                    const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (int s : observations.sensors) {
    const std::vector<double>* k = intrinsics_of(rig.sensors[s]);
    if (!k) continue;
    const Pixels pixels = pixels_of(samples, s);
    if ((*k)[0] > kLeastFocalLength && pixels.most < kMostNormalised) {
      const ParameterBlock* lens = find_block(rig.sensors[s], ParameterKind::distortion);
      out.push_back(normalised_views(rig, s, false));
      if (lens &&
          std::any_of(lens->values.begin(), lens->values.end(), [](double c) { return c != 0; }))
        out.push_back(normalised_views(rig, s, true));
    } else if ((*k)[0] < kMostNormalised && pixels.most > kLeastFocalLength) {
      out.push_back(normalised_intrinsics(rig, s, pixels));
    }
  }
}

std::vector<Notice> find_normalised(const Rig& rig, const std::vector<Sample>& samples) {
  std::vector<Notice> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const std::vector<double>* k = intrinsics_of(rig.sensors[s]);
    if (!k || !((*k)[0] > kLeastFocalLength)) continue;
    const Pixels pixels = pixels_of(samples, static_cast<int>(s));
    if (pixels.numbers[0].empty() || !(pixels.most < kMostNormalised)) continue;
    const Hypothesis h = normalised_views(rig, static_cast<int>(s), false);
    out.push_back(make_notice(
        h.kind, h.where,
        "all " + std::to_string(pixels.numbers[0].size()) + " pixels of camera " +
            quoted(rig.sensors[s].name) +
            text(" are within %.3g px of (0, 0): they are normalised coordinates, but its "
                 "intrinsics are pixels",
                 pixels.most),
        "", h.cure));
  }
  return out;
}

}  // namespace kincal
