#include "advice.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "../../models/rig/numbers.h"
#include "../../models/rig/words.h"
#include "finders.h"
#include "markers.h"

namespace kincal {
namespace {

/// What to say of a chessboard that no image shows: whether one of another size is there.
std::string never_found(const ImageTarget& target, const std::vector<ImageTask>& tasks) {
  constexpr int kLookedAt = 5;
  std::map<std::pair<int, int>, int> sizes;  // rows, columns: images
  int looked = 0;
  for (const ImageTask& task : tasks) {
    if (looked == kLookedAt || !task.image.error.empty()) continue;
    if (std::none_of(task.wanted.begin(), task.wanted.end(),
                     [&](const ImageTask::Wanted& one) { return one.target == &target; }))
      continue;
    const LoadedImage image =
        load_image(task.path, task.camera->image_width, task.camera->image_height);
    if (image.grey.empty()) continue;
    ++looked;
    const cv::Size size = size_instead(image.grey, target);
    if (size.area() > 0) ++sizes[{size.height, size.width}];
  }
  const auto most = std::max_element(
      sizes.begin(), sizes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  const std::string begin = "target '" + target.name + "': no image shows a chessboard of " +
                            std::to_string(target.rows) + " x " + std::to_string(target.columns) +
                            " inner corners";
  if (most == sizes.end())
    return looked == 0
               ? ""
               : begin +
                     ", nor one with a row or column more or less. It has to be seen whole, "
                     "sharp and not too obliquely, with a white margin: look at an image, and "
                     "count the corners where four squares meet";
  return begin + ", but " + std::to_string(most->second) + " of " + std::to_string(looked) +
         " looked at show " + std::to_string(most->first.first) + " x " +
         std::to_string(most->first.second) +
         ": count the corners where four squares meet, one fewer than the squares. Write "
         "rows: " +
         std::to_string(most->first.first) + ", columns: " + std::to_string(most->first.second);
}

/// What to say of a board whose points are far off where a plane has them, in most images; "":
/// nothing.
std::string hardly_flat(const ImageTarget& target, const std::vector<ImageTask>& tasks) {
  constexpr double kFarOff = 15, kLeast = 0.15;  // times the noise of the corners; px
  constexpr size_t kEnough = 3;
  std::vector<double> rms, times;
  for (const ImageTask& task : tasks)
    for (const ImageTask::Wanted& one : task.wanted)
      if (one.target == &target && one.found.sigma > 0 && one.found.rms > 0) {
        rms.push_back(one.found.rms);
        times.push_back(one.found.rms / (std::sqrt(2) * one.found.sigma));
      }
  if (rms.size() < kEnough || median(rms, 0) < kLeast || median(times, 0) < kFarOff) return "";
  return "target '" + target.name + "': " +
         text(
             "its points deviate by %.2g px from a plane seen through a lens (rms, median of %zu "
             "images), %.0f times the noise: the board is warped, or the lens distorts strongly. "
             "`kincal intrinsics --warp` decides, and calibrates with both",
             median(rms, 0), rms.size(), median(times, 0));
}

/// What to say of cameras whose images all have one size, and not the rig's.
std::vector<std::string> other_sizes(const std::vector<ImageTask>& tasks) {
  std::map<const Sensor*, std::vector<const ImageTask*>> cameras;
  for (const ImageTask& task : tasks) cameras[task.camera].push_back(&task);
  std::vector<std::string> out;
  for (const auto& [camera, those] : cameras) {
    const LoadedImage& first = those[0]->image;
    if (!first.other_size.empty() &&
        std::all_of(those.begin(), those.end(), [&](const ImageTask* one) {
          return one->image.other_size == first.other_size;
        }))
      out.push_back("all " + std::to_string(those.size()) + " images of '" + camera->name +
                    "': each " + first.error + ". " + cure_of_size(*camera, first.other_size));
  }
  return out;
}

/// Markers of one dictionary in some images.
struct MarkersThere {
  int dictionary = -1, count = 0;  // count: of all images
  std::set<int> ids;
};

/// Whether two dictionaries have the same codes, as far as the shorter one goes.
bool same_codes(int one, int other) {
  constexpr int kSized = 16;  // of those before, four sizes have the same codes
  return one == other ||
         (one >= 0 && other >= 0 && one < kSized && other < kSized && one / 4 == other / 4);
}

/// Of which dictionary most markers are in some images, but for those of targets that were `found`.
/// Of a board at least four, and in more than one of the images, if these are many: dirt may look
/// like a marker.
MarkersThere markers_there(const ImageTarget& target, const ImageTargets& found,
                           const std::vector<cv::Mat>& images) {
  constexpr int kWindow = 23;  // px: one takes an eighth of the time of all
  const bool tags = target.kind == ImageTarget::Kind::tags;
  const size_t least = target.kind == ImageTarget::Kind::marker ? 1 : 4;
  std::vector<int> dictionaries = {target.dictionary};  // of equally many, the rig's is meant
  for (int d = 0; !dictionary_name(d).empty(); ++d) dictionaries.push_back(d);
  MarkersThere best;
  for (const int dictionary : dictionaries) {
    const bool taken = std::any_of(found.begin(), found.end(), [&](const auto& other) {
      return same_codes(other.second.dictionary, dictionary);
    });
    const bool own = same_codes(target.dictionary, dictionary);
    if (taken && !(own && target.kind == ImageTarget::Kind::marker)) continue;
    std::map<int, int> seen;  // number: images
    for (const cv::Mat& image : images) {
      Markers here = find_markers(image, dictionary, {1, 7, kWindow, kWindow});
      if (tags) here.merge(find_markers(image, dictionary, {2}));
      for (auto one = here.begin(); one != here.end(); one = here.upper_bound(one->first))
        ++seen[one->first];
    }
    for (const auto& [name, other] : found)
      if (same_codes(other.dictionary, dictionary)) seen.erase(other.marker_id);
    MarkersThere there;
    there.dictionary = dictionary;
    for (const auto& [id, times] : seen)
      if (times > 1 || images.size() == 1) there.ids.insert(id), there.count += times;
    if (there.ids.size() >= least && there.count > best.count) best = there;
  }
  return best;
}

/// What to say of a target of markers that no image shows: which are there.
std::string no_markers_found(const ImageTarget& target, const ImageTargets& found,
                             const std::vector<ImageTask>& tasks) {
  const size_t looked_at = target.kind == ImageTarget::Kind::marker ? 12 : 5;
  const bool tags = target.kind == ImageTarget::Kind::tags;
  std::vector<const ImageTask*> those;
  for (const ImageTask& task : tasks)
    if (task.image.error.empty() &&
        std::any_of(task.wanted.begin(), task.wanted.end(),
                    [&](const ImageTask::Wanted& one) { return one.target == &target; }))
      those.push_back(&task);
  std::vector<cv::Mat> images;  // from the first to the last
  for (size_t k = 0; k < std::min(looked_at, those.size()); ++k) {
    const ImageTask& task = *those[k * those.size() / std::min(looked_at, those.size())];
    images.push_back(
        load_image(task.path, task.camera->image_width, task.camera->image_height).grey);
  }
  if (images.empty()) return "";
  const MarkersThere there = markers_there(target, found, images);
  const std::string begin = "target '" + target.name + "': no image shows it";
  if (there.dictionary < 0) return begin + ", nor other markers that no target of the rig has";
  const int low = *there.ids.begin(), high = *there.ids.rbegin();
  const std::string name = dictionary_name(there.dictionary),
                    what =
                        begin + ", but the " + std::to_string(images.size()) +
                        " looked at show markers of " + name + ", id" +
                        (low == high ? " " + std::to_string(low)
                                     : "s " + std::to_string(low) + " to " + std::to_string(high));
  if (there.dictionary != target.dictionary)
    return what + ": write " + (tags ? "family: " : "dictionary: ") + name;
  if (target.kind == ImageTarget::Kind::marker) return what + ": write id: " + std::to_string(low);
  const int all = target.rows * target.columns / (tags ? 1 : 2);
  return what + (high >= target.marker_id + all || low < target.marker_id
                     ? ": the rig's board has " + std::to_string(target.marker_id) + " to " +
                           std::to_string(target.marker_id + all - 1) + " (write first_id: " +
                           std::to_string(low) + ", if that is its first marker)"
                     : ": its rows, columns, or the sizes of markers and gaps differ");
}

/// What to say of a ChArUco board whose last row of corners no image shows, where its print ends in
/// some; "": nothing.
std::string row_too_many(const ImageTarget& target, const std::vector<ImageTask>& tasks) {
  constexpr int kEnough = 3;  // images
  const int first = (target.rows - 2) * (target.columns - 1);
  int ends = 0;
  for (const ImageTask& task : tasks)
    for (const ImageTask::Wanted& one : task.wanted) {
      if (one.target != &target) continue;
      if (!one.found.ids.empty() && one.found.ids.back() >= first) return "";
      ends += !one.found.no_corners.empty() && one.found.no_corners.back() >= first;
    }
  if (ends < kEnough) return "";
  return "target '" + target.name + "': its last row of corners is in no image, and in " +
         std::to_string(ends) +
         " the print ends where it should be: the rig's board seems to have " +
         "a row too many. Write rows: " + std::to_string(target.rows - 1) +
         " if the print has so many";
}

}  // namespace

std::vector<std::string> advice(const ImageTargets& known, const ImageTargets& found,
                                const std::vector<ImageTask>& tasks) {
  std::vector<std::string> out;
  for (const auto& [name, target] : known) {
    using Kind = ImageTarget::Kind;
    std::string note;
    if (target.kind == Kind::charuco && found.count(name)) note = row_too_many(target, tasks);
    if (target.kind == Kind::chessboard && !found.count(name)) note = never_found(target, tasks);
    if (target.kind != Kind::chessboard && target.kind != Kind::circles && !found.count(name))
      note = no_markers_found(target, found, tasks);
    if (!note.empty()) out.push_back(std::move(note));
    if (note = hardly_flat(target, tasks); !note.empty()) out.push_back(std::move(note));
  }
  for (std::string& note : other_sizes(tasks)) out.push_back(std::move(note));
  return out;
}

}  // namespace kincal
