#include "static_views.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "../../models/rig/words.h"

namespace kincal {
namespace {

std::string point_name(const std::pair<std::string, int>& point) {
  return (point.first.empty() ? "point " : point.first + ", point ") + std::to_string(point.second);
}

}  // namespace

/// What a sample shows, by camera.
std::map<std::string, StaticViews::Picture> StaticViews::read(const Field& sample) {
  std::map<std::string, Picture> out;
  const Field views = sample["views"];
  for (size_t v = 0; v < views.size(); ++v) {
    const Field view = views.item(v);
    const std::vector<double> pixels = view["pixels"].table(2);
    const auto count = static_cast<int>(pixels.size() / 2);
    std::vector<int> ids;
    for (int i = 0; i < count; ++i) ids.push_back(i);
    if (view.has("ids")) {
      const Field given = view["ids"];
      if (given.size() != ids.size())
        given.fail("as many as 'pixels' are expected: " + std::to_string(count));
      for (int i = 0; i < count; ++i) ids[i] = given.integer_item(i, 0, 1 << 30);
    }
    const std::string target = view.has("target") ? view["target"].string() : "";
    Picture& picture = out[view["sensor"].string()];
    const auto before = picture.pixels.cols();
    picture.pixels.conservativeResize(Eigen::NoChange, before + count);
    for (int i = 0; i < count; ++i) {
      const Point point{target, ids[i]};
      if (std::find(picture.points.begin(), picture.points.end(), point) != picture.points.end())
        view.fail(point_name(point) + " occurs twice");
      picture.points.push_back(point);
      picture.pixels.col(before + i) << pixels[2 * i], pixels[2 * i + 1];
    }
  }
  return out;
}

ViewInnovation StaticViews::add(Camera& camera, const Picture& picture) const {
  const auto show = [&](const Picture& one) {
    std::vector<int> points;
    std::vector<Eigen::Index> places;
    for (size_t i = 0; i < one.points.size(); ++i) {
      const auto found = camera.index.find(one.points[i]);
      if (found == camera.index.end()) continue;  // the first pictures did not show it
      points.push_back(found->second);
      places.push_back(static_cast<Eigen::Index>(i));
    }
    return camera.view[0].add(points, one.pixels(Eigen::all, places));
  };
  if (!camera.view.empty()) return show(picture);
  camera.first.push_back(picture);
  ViewInnovation out;
  out.learning = true;
  if (static_cast<int>(camera.first.size()) < options_.learning) return out;
  for (const Picture& one : camera.first)
    for (const Point& point : one.points)
      if (camera.index.emplace(point, static_cast<int>(camera.points.size())).second)
        camera.points.push_back(point);
  camera.view.emplace_back(static_cast<int>(camera.points.size()), options_);
  for (const Picture& one : std::exchange(camera.first, {})) show(one);
  return out;
}

StaticViews::Told StaticViews::show(const Field& sample) {
  Told out;
  const std::map<std::string, Picture> pictures = read(sample);
  out.id = sample.has("id") ? sample["id"].string() : std::to_string(samples_ + 1);
  ++samples_;
  Json sensors = Json::object();
  for (const auto& [name, picture] : pictures) {
    if (picture.points.empty()) continue;
    Camera& camera = cameras_[name];
    camera.ids.push_back(out.id);
    const ViewInnovation innovation = add(camera, picture);
    Json left_out = Json::array(), moved = nullptr;
    for (const int point : innovation.left_out)
      left_out.push_back(point_name(camera.points[point]));
    if (innovation.alarm) {
      const ViewMoved first = camera.view[0].moved().front();
      const std::string what = first.point < 0 ? "camera" : point_name(camera.points[first.point]);
      moved = {{"what", what},
               {"probability", first.probability},
               {"since", camera.ids[first.since]},
               {"shift", {first.shift.x(), first.shift.y()}},
               {"sigma", {first.sigma.x(), first.sigma.y()}},
               {"largest", first.largest}};
      const std::string words =
          name + (first.point < 0 ? " has moved: its picture" : ": " + what + " has moved") +
          text(" by %+.3g +- %.2g px along x, %+.3g +- %.2g px along y", first.shift.x(),
               first.sigma.x(), first.shift.y(), first.sigma.y()) +
          (first.point < 0 ? text(" in the middle, %.3g px at most", first.largest) : "") +
          ", since sample '" + camera.ids[first.since] + "'";
      out.words += (out.words.empty() ? "" : "; ") + words;
      found_.push_back(words);
      camera.view[0].restart();
    }
    sensors[name] = {{"learning", innovation.learning},
                     {"chi2", innovation.chi2},
                     {"dof", innovation.dof},
                     {"probability", innovation.probability},
                     {"left_out", left_out},
                     {"largest", innovation.largest},
                     {"moved", moved}};
  }
  out.json = Json({{"sample", out.id}, {"sensors", sensors}}).dump();
  return out;
}

std::string StaticViews::summary() const {
  std::string out = text("%ld samples. ", samples_);
  if (found_.empty())
    out += text("Nothing has moved (one false alarm in about %.0f samples of a camera).\n",
                options_.samples_between_alarms);
  else
    out += "Moved:\n";
  for (const std::string& found : found_) out += "  " + found + "\n";
  for (const auto& [name, camera] : cameras_) {
    if (camera.view.empty()) {
      out += "  " + name +
             text(": %zu pictures, all of them to learn from (%d are needed)\n",
                  camera.first.size(), options_.learning);
      continue;
    }
    std::vector<double> noise;
    for (const double sigma : camera.view[0].noise())
      if (sigma > 0) noise.push_back(sigma);
    if (noise.empty()) continue;
    std::sort(noise.begin(), noise.end());
    out += "  " + name +
           text(": %zu points, noise %.2g px (%.2g to %.2g)\n", noise.size(),
                noise[noise.size() / 2], noise.front(), noise.back());
  }
  return out;
}

}  // namespace kincal
