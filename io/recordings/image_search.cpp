#include "image_search.h"

#include <algorithm>
#include <array>
#include <opencv2/imgcodecs.hpp>

#include "../images/detect.h"
#include "../images/image_target.h"
#include "../images/load.h"
#include "../images/renumber.h"
#include "bytes.h"
#include "raw_image.h"

namespace kincal {

namespace {

struct SearchParts {
  const RigFile& rig;
  std::map<int, ImageTarget> targets;

  explicit SearchParts(const RigFile& of) : rig(of) {
    for (size_t t = 0; t < rig.rig.targets.size(); ++t)
      if (rig.rig.targets[t].type != "points")
        targets.emplace(static_cast<int>(t), image_target(rig, rig.rig.targets[t]));
  }

  LookResult look(const MessageValue& image, bool compressed, int sensor,
                  const std::vector<int>& wanted) const {
    const Sensor& camera = rig.rig.sensors[static_cast<size_t>(sensor)];
    LookResult out;
    LoadedImage loaded;
    Picture picture;
    if (compressed) {
      const NumberArray data = numbers_of(field(image, "data"));
      loaded = decode_image(data.bytes, camera.image_width, camera.image_height);
    } else {
      picture = grey_picture(image);
      loaded = fitting_image(cv::Mat(picture.height, picture.width, CV_8UC1, picture.pixels.data()),
                             camera.image_width, camera.image_height);
    }
    if (!loaded.error.empty()) {
      out.unusable = "images of '" + camera.name + "' cannot be used: an image " + loaded.error;
      if (!loaded.other_size.empty())
        out.unusable += ". " + cure_of_size(camera, loaded.other_size);
      return out;
    }
    for (const std::string& note : loaded.notes)
      out.notes.push_back("'" + camera.name + "': an image " + note);
    for (const int t : wanted) {
      Detection found;
      try {
        found = detect(loaded.grey, targets.at(t), loaded.compression);
      } catch (const cv::Exception&) {  // one image must not end the others
        continue;
      }
      if (found.ids.empty()) continue;
      Sighting seen;
      seen.target = t;
      seen.layouts = found.layouts;
      seen.frame.ids = found.ids;
      seen.frame.floor = found.floor;
      for (const cv::Point2d& p : found.pixels) {
        seen.frame.pixels.push_back(p.x);
        seen.frame.pixels.push_back(p.y);
      }
      out.seen.push_back(std::move(seen));
    }
    return out;
  }

  /// Whether lasers can find a target: a board, or one reflector.
  bool in_beams(int target) const {
    const Target& what = rig.rig.targets[static_cast<size_t>(target)];
    return what.type == "chessboard" || what.type == "charuco" ||
           (what.type == "points" && what.count() == 1);
  }

  void keep(const BeamView& found, int sensor, int target, std::vector<View>& views,
            BeamWords& words) const {
    if (found.view.ids.empty()) {
      words.why_not = found.reason;
      return;
    }
    views.push_back(found.view);
    views.back().sensor = sensor;
    views.back().target = target;
    for (const std::string& note : found.notes)
      words.doubts.push_back(rig.rig.sensors[static_cast<size_t>(sensor)].name + " on " +
                             rig.rig.targets[static_cast<size_t>(target)].name + ": " + note);
  }

  std::vector<std::string> agree(std::vector<Sighting>& sightings) const {
    std::map<int, std::array<int, 2>> votes;  // markers, by target
    const auto is_charuco = [&](const Sighting& one) {
      const auto found = targets.find(one.target);
      return found != targets.end() && found->second.kind == ImageTarget::Kind::charuco;
    };
    for (const Sighting& one : sightings)
      if (is_charuco(one))
        for (const size_t layout : {0, 1}) votes[one.target][layout] += one.layouts[layout];
    std::map<int, int> wrong;
    const auto other = [&](const Sighting& one) {
      if (!is_charuco(one)) return false;
      const std::array<int, 2>& all = votes.at(one.target);
      const int layout = all[0] > all[1] ? 0 : 1, read_by = one.layouts[0] > one.layouts[1] ? 0 : 1;
      if (layout == read_by) return false;
      ++wrong[one.target];
      return true;
    };
    sightings.erase(std::remove_if(sightings.begin(), sightings.end(), other), sightings.end());
    std::vector<std::string> notes;
    for (const auto& [t, count] : wrong)
      notes.push_back("target '" + rig.rig.targets[static_cast<size_t>(t)].name +
                      "': " + std::to_string(count) +
                      " images that show a part of it were read one column off, and are left out");
    return notes;
  }
};

}  // namespace

TargetSearch image_search(const RigFile& rig) {
  const auto parts = std::make_shared<SearchParts>(rig);
  TargetSearch out;
  for (const auto& [t, target] : parts->targets) {
    out.targets.push_back(t);
    const std::vector<int> turns = open_turns(target);
    if (turns.size() > 1) out.open_turns[t] = turns;
  }
  out.look = [parts](const MessageValue& image, bool compressed, int sensor,
                     const std::vector<int>& targets) {
    return parts->look(image, compressed, sensor, targets);
  };
  out.sweep = [parts](int sensor, int target, const Sweep& recorded, BeamWords& words) {
    std::vector<View> views;
    if (!parts->in_beams(target)) return views;
    for (const Sweep& way : one_way_sweeps(recorded))
      parts->keep(find_in_sweep(parts->rig, sensor, target, way), sensor, target, views, words);
    return views;
  };
  out.cloud = [parts](int sensor, int target, const Cloud& cloud, BeamWords& words) {
    std::vector<View> views;
    if (parts->in_beams(target))
      parts->keep(find_in_cloud(parts->rig, sensor, target, cloud), sensor, target, views, words);
    return views;
  };
  out.agree = [parts](std::vector<Sighting>& sightings) { return parts->agree(sightings); };
  return out;
}

}  // namespace kincal
