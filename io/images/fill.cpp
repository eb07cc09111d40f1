#include "fill.h"

#include <fnmatch.h>
#include <string.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <sstream>

#include "../../models/rig/numbers.h"
#include "../../models/rig/targets.h"
#include "../../models/rig/words.h"
#include "../document/error.h"
#include "../document/files.h"
#include "../document/names.h"
#include "../exchange/poses.h"
#include "../results/json_values.h"
#include "advice.h"
#include "detect.h"
#include "image_task.h"
#include "parallel.h"
#include "renumber.h"
#include "tell_apart.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

/// `needed`: only the target of that name; "": all that can be found in images.
void add_targets(const RigFile& rig, const std::string& needed, ImageTargets& out) {
  for (const Target& target : rig.rig.targets) {
    if (out.count(target.name) || (!needed.empty() && target.name != needed)) continue;
    if (needed.empty() && target.type == "points") continue;
    out[target.name] = image_target(rig, target);
  }
}

const Sensor& camera(const RigFile& rig, const std::string& name, const std::string& where) {
  std::vector<std::string> cameras;
  const Sensor* found = nullptr;
  for (const Sensor& sensor : rig.rig.sensors) {
    if (sensor.type != "camera") continue;
    cameras.push_back(sensor.name);
    if (sensor.name == name || (name.empty() && !found)) found = &sensor;
  }
  if (cameras.empty()) throw InputError(rig.path + ": there is no camera in it");
  if (name.empty() && cameras.size() > 1)
    throw InputError("the rig has several cameras (" + comma_separated(cameras) +
                     "): name the one that took the images by --sensor");
  if (!found)
    throw InputError(where + ": there is no camera '" + name + "'" + nearest_names(name, cameras) +
                     "; known: " + comma_separated(cameras));
  return *found;
}

void draw_found(const ImageTask& task, const std::string& folder) {
  if (folder.empty() || task.image.grey.empty()) return;
  cv::Mat picture;
  cv::cvtColor(task.image.grey, picture, cv::COLOR_GRAY2BGR);
  for (const ImageTask::Wanted& one : task.wanted) draw(picture, *one.target, one.found);
  std::string name = task.shown;
  std::replace(name.begin(), name.end(), '/', '_');
  cv::imwrite((fs::path(folder) / (name + ".png")).string(), picture);
}

void work(ImageTask& task, const FillOptions& options) {
  task.image = load_image(task.path, task.camera->image_width, task.camera->image_height);
  try {
    if (!task.image.grey.empty())
      for (const std::vector<size_t>& group : by_print(task)) {
        std::vector<Detection> found = detect_boards(task.image.grey, *task.wanted[group[0]].target,
                                                     group.size(), task.image.compression);
        for (size_t k = 0; k < group.size(); ++k) task.wanted[group[k]].found = std::move(found[k]);
      }
    draw_found(task, options.draw);
  } catch (const std::exception& error) {  // of OpenCV; one image must not end the others
    for (ImageTask::Wanted& one : task.wanted)
      if (one.found.ids.empty()) one.found.reason = error.what();
  }
  task.image.grey.release();
}

void work_all(std::vector<ImageTask>& tasks, const FillOptions& options) {
  if (!options.draw.empty()) fs::create_directories(options.draw);
  in_parallel(
      tasks.size(), options.threads, [&](size_t i) { work(tasks[i], options); }, options.progress);
}

/// The layout of a ChArUco board that an image was read by (ImageTarget::layout).
int layout_read(const Detection& found) { return found.layouts[0] > found.layouts[1] ? 0 : 1; }

/// A board of markers has one layout in all images: that with which most markers agree. An image
/// that shows a part of a board may suit both, one column apart, so images that were read by the
/// other one are read again. Returns what there is to say.
std::vector<std::string> agree_on_layouts(ImageTargets& targets, std::vector<ImageTask>& tasks,
                                          const FillOptions& options) {
  std::map<const ImageTarget*, std::array<int, 3>> votes;  // markers for each layout, and views
  for (const ImageTask& task : tasks)
    for (const ImageTask::Wanted& one : task.wanted)
      if (one.target->kind == ImageTarget::Kind::charuco && !one.found.ids.empty()) {
        std::array<int, 3>& all = votes[one.target];
        for (const int layout : {0, 1}) all[layout] += one.found.layouts[layout];
        ++all[2];
      }
  std::vector<std::string> notes;
  std::vector<ImageTask> again;
  std::vector<size_t> places;  // of these in `tasks`
  for (auto& [name, target] : targets) {
    if (!votes.count(&target)) continue;
    const std::array<int, 3>& all = votes.at(&target);
    target.layout = all[0] > all[1] ? 0 : 1;
    if (all[0] == all[1])
      notes.push_back(
          "target '" + name + "': " +
          (all[2] == 1 ? "the image suits" : "all " + std::to_string(all[2]) + " images suit") +
          " both layouts of a ChArUco board, whose corners are one column apart. The one with a "
          "dark upper left square is used; an image with the board's left or right column would "
          "decide");
  }
  for (size_t i = 0; i < tasks.size(); ++i) {
    const auto other = [](const ImageTask::Wanted& one) {
      return one.target->layout >= 0 && !one.found.ids.empty() &&
             layout_read(one.found) != one.target->layout;
    };
    if (std::none_of(tasks[i].wanted.begin(), tasks[i].wanted.end(), other)) continue;
    for (const ImageTask::Wanted& one : tasks[i].wanted)
      if (other(one))
        notes.push_back(tasks[i].shown + ": " + one.target->name +
                        ": read again by the layout that the other images have");
    again.push_back(tasks[i]);
    places.push_back(i);
  }
  in_parallel(again.size(), options.threads, [&](size_t i) { work(again[i], options); }, {});
  for (size_t k = 0; k < again.size(); ++k) tasks[places[k]] = std::move(again[k]);
  return notes;
}

std::string verdict_line(const ImageTask& task, const ImageTask::Wanted& one) {
  std::string line = task.shown + ": " + one.target->name + ": ";
  char text[160];
  if (one.found.ids.empty()) {
    line += "NOT FOUND: " + one.found.reason;
  } else {
    std::snprintf(text, sizeof text, "%zu of %zu points, blur %.1f px, contrast %.2f, rms %.3f px",
                  one.found.ids.size(), one.target->points.size(), one.found.blur,
                  one.found.contrast, one.found.rms);
    line += text;
    if (one.found.sigma > 0) {
      std::snprintf(text, sizeof text, ", sigma %.3f px", one.found.sigma);
      line += text;
    }
    if (!(one.found.rms < 1e6))  // no homography explains them at all
      line = line.substr(0, line.rfind(", rms")) + ", points that do not lie on a plane";
  }
  for (const std::string& note : task.image.notes) line += "; the image " + note;
  return line;
}

/// Numbers as short as they can be and still right to a ten-thousandth of a pixel.
double rounded(double value) { return std::round(value * 1e4) / 1e4; }

void put(const ImageTask::Wanted& one, bool sigma, Json& view) {
  if (one.found.ids.size() < one.target->points.size()) view["ids"] = one.found.ids;
  Json pixels = Json::array();
  for (const cv::Point2d& p : one.found.pixels) pixels.push_back({rounded(p.x), rounded(p.y)});
  view["pixels"] = std::move(pixels);
  if (sigma && one.found.sigma > 0 && !view.contains("sigma"))
    view["sigma"] = rounded(one.found.sigma);
}

/// Looks for everything, writes what was found into the samples and drops what was not.
Filled finish(const RigFile& rig, std::vector<Json>& samples, std::vector<ImageTask>& tasks,
              ImageTargets& known, const FillOptions& options) {
  refuse_alike(rig, samples, tasks);
  work_all(tasks, options);
  Filled out;
  const std::vector<std::string> layouts = agree_on_layouts(known, tasks, options);
  tell_apart(rig, samples, tasks);
  std::map<std::string, int> unusual;  // what is, and how many images
  ImageTargets targets;
  std::set<std::pair<int, int>> found;  // sample and view
  for (ImageTask& task : tasks) {
    for (const std::string& note : task.image.notes) ++unusual[note];
    if (!task.image.error.empty()) {
      ++out.unusable;
      out.lines.push_back(task.shown + ": UNUSABLE: the image " + task.image.error);
    }
    for (ImageTask::Wanted& one : task.wanted) {
      ++out.views;
      Json& view = samples[one.sample]["views"][one.view];
      if (task.image.error.empty()) out.lines.push_back(verdict_line(task, one));
      if (one.found.ids.empty()) {
        view = nullptr;
        continue;
      }
      ++out.found;
      put(one, options.sigma, view);
      found.emplace(one.sample, one.view);
      targets.emplace(one.target->name, *one.target);
    }
  }
  std::vector<Json> kept;
  std::set<std::pair<int, int>> filled;  // of those that are kept
  for (size_t s = 0; s < samples.size(); ++s) {
    Json& sample = samples[s];
    Json views = Json::array();
    for (size_t v = 0; v < sample["views"].size(); ++v) {
      if (sample["views"][v].is_null()) continue;
      if (found.count({static_cast<int>(s), static_cast<int>(v)}))
        filled.emplace(kept.size(), views.size());
      views.push_back(std::move(sample["views"][v]));
    }
    if (views.empty()) {
      out.lost.push_back("sample '" + sample.value("id", "") + "': nothing was found");
      continue;
    }
    sample["views"] = std::move(views);
    kept.push_back(std::move(sample));
  }
  out.notes = renumber(rig, targets, filled, kept);
  out.notes.insert(out.notes.begin(), layouts.begin(), layouts.end());
  for (std::string& note : advice(known, targets, tasks)) out.notes.push_back(std::move(note));
  for (const auto& [note, count] : unusual)
    out.notes.push_back(std::to_string(count) + " of " + std::to_string(tasks.size()) +
                        " images: each " + note);
  for (const Json& sample : kept) out.text += sample.dump() + "\n";
  out.samples = static_cast<int>(kept.size());
  return out;
}

/// The path of an image as the written samples file has to name it.
std::string path_for(const std::string& image, const std::string& out) {
  const fs::path folder = fs::absolute(out).lexically_normal().parent_path();
  return fs::absolute(image).lexically_normal().lexically_relative(folder).string();
}

/// Reads the readings that were logged beside images.
JointTable joint_rows(const RigFile& rig, const FillOptions& options, size_t images) {
  if (options.joints.empty()) return {};
  JointTable out = options.pose_format.empty()
                       ? read_joint_table(options.joints, rig.rig, options.words)
                       : read_flange_table(options.joints, options.pose_format, options.unit);
  if (!out.rows[0].image.empty() || out.rows[0].time) return out;
  if (out.rows.size() != images)
    throw InputError(options.joints +
                     ": its rows have no names (a column `image`) and no times, so "
                     "they are matched to the images in order; but there are " +
                     std::to_string(out.rows.size()) + " rows and " + std::to_string(images) +
                     " images");
  out.notes.push_back(options.joints + ": " + std::to_string(images) +
                      " rows without names go with the images in the order of their names");
  return out;
}

std::vector<Json> parse_lines(const std::string& path) {
  std::istringstream in(read_file(path));
  std::vector<Json> samples;
  std::map<std::string, int> lines;  // of ids
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    Json sample = Json::parse(line, nullptr, false);
    const std::string where = path + ":" + std::to_string(number);
    if (!sample.is_object() || !sample.contains("views") || !sample["views"].is_array())
      throw InputError(where +
                       ": a sample is expected: {\"id\": ..., \"joints\": {...}, "
                       "\"views\": [...]}");
    if (!sample.contains("id") || !sample["id"].is_string())
      throw InputError(where + ": id: a text is expected, as in {\"id\": \"posture_7\", ...}");
    const auto id = lines.emplace(sample["id"].get<std::string>(), number);
    if (!id.second)
      throw InputError(where + ": id '" + id.first->first + "' is that of line " +
                       std::to_string(id.first->second) + " already; each sample needs its own");
    for (const Json& view : sample["views"])
      for (const char* key : {"sensor", "target", "image"})
        if (!view.is_object() || (view.contains(key) ? !view[key].is_string() : *key != 'i'))
          throw InputError(where +
                           ": views: each needs \"sensor\" and \"target\", strings like "
                           "\"image\"");
    samples.push_back(std::move(sample));
  }
  return samples;
}

}  // namespace

Filled fill_samples(const RigFile& rig, const std::string& path, const FillOptions& options) {
  std::vector<Json> samples = parse_lines(path);
  std::vector<ImageTask> tasks;
  std::map<std::pair<std::string, std::string>, size_t> known;  // image and sensor: its task
  ImageTargets targets;
  for (size_t s = 0; s < samples.size(); ++s)
    for (size_t v = 0; v < samples[s]["views"].size(); ++v) {
      Json& view = samples[s]["views"][v];
      if (!view.contains("image")) continue;
      const std::string shown = view["image"].get<std::string>();
      const fs::path image =
          fs::path(shown).is_absolute() ? fs::path(shown) : fs::path(path).parent_path() / shown;
      if (!fs::path(shown).is_absolute()) view["image"] = path_for(image.string(), options.out);
      const Sensor* sensor = nullptr;
      for (const Sensor& one : rig.rig.sensors)
        if (one.name == view["sensor"].get<std::string>()) sensor = &one;
      if (view.contains("pixels") || (sensor && sensor->type != "camera")) continue;
      const Sensor& seen_by = camera(rig, view["sensor"].get<std::string>(), path);
      const std::string target = view["target"].get<std::string>();
      add_targets(rig, target, targets);
      if (!targets.count(target))
        throw InputError(path + ": there is no target '" + target + "' in " + rig.path);
      const auto at = known.emplace(std::make_pair(shown, seen_by.name), tasks.size());
      if (at.second) tasks.push_back({image.string(), shown, &seen_by, {}, {}});
      tasks[at.first->second].wanted.push_back(
          {static_cast<int>(s), static_cast<int>(v), &targets.at(target), {}});
    }
  if (tasks.empty())
    throw InputError(path + ": no view of a camera has an `image` and no `pixels`: nothing to do");
  return finish(rig, samples, tasks, targets, options);
}

Filled fill_images(const RigFile& rig, const std::vector<std::string>& images,
                   const FillOptions& options) {
  const Sensor& sensor = camera(rig, options.sensor, "--sensor");
  const JointTable table = joint_rows(rig, options, images.size());
  const std::vector<JointRow>& rows = table.rows;
  const bool by_order = !rows.empty() && rows[0].image.empty() && !rows[0].time;
  ImageTargets targets;
  add_targets(rig, "", targets);
  if (targets.empty())
    throw InputError(rig.path + ": none of its targets can be detected in images");
  std::vector<Json> samples;
  std::vector<ImageTask> tasks;
  std::vector<std::string> without;
  std::map<std::string, int> stems;
  for (const std::string& image : images) ++stems[fs::path(image).stem().string()];
  for (const std::string& image : images) {
    Json joints = Json::object();
    if (!rows.empty()) {
      const JointRow* row = by_order ? &rows[static_cast<size_t>(&image - images.data())]
                                     : row_of_image(rows, image, options.tolerance);
      if (!row) {
        const bool no_time =
            rows[0].time && rows[0].image.empty() &&
            fs::path(image).stem().string().find_first_not_of("0123456789.") != std::string::npos;
        without.push_back("image '" + image + "': no joint readings in " + options.joints +
                          (no_time ? ", which is matched by time: the image's name is not a number "
                                     "of seconds or nanoseconds"
                                   : ""));
        continue;
      }
      for (const auto& [name, value] : row->joints) joints[name] = value;
      for (const auto& [name, value] : row->poses) joints[name] = pose(value);
    }
    ImageTask task{image, image, &sensor, {}, {}};
    Json views = Json::array();
    for (const auto& [name, target] : targets) {
      task.wanted.push_back(
          {static_cast<int>(samples.size()), static_cast<int>(views.size()), &target, {}});
      views.push_back(
          {{"sensor", sensor.name}, {"target", name}, {"image", path_for(image, options.out)}});
    }
    const fs::path name(image);  // a.png and a.jpg are two samples
    const bool own = stems[name.stem().string()] == 1;
    samples.push_back({{"id", (own ? name.stem() : name.filename()).string()}, {"joints", joints}});
    samples.back()["views"] = views;
    tasks.push_back(std::move(task));
  }
  if (without.size() == images.size() && !rows.empty() && !rows[0].image.empty())
    throw InputError(options.joints + ": names none of the images: its first is '" + rows[0].image +
                     "', the first image is '" + images[0] + "'");
  Filled out = finish(rig, samples, tasks, targets, options);
  for (const std::string& joint :
       rows.empty() ? std::vector<std::string>() : joints_with_readings(rig.rig)) {
    const auto lacks = [&](const JointRow& row) {
      return !row.joints.count(joint) && !row.poses.count(joint);
    };
    const auto first = std::find_if(rows.begin(), rows.end(), lacks);
    if (first != rows.end())
      out.notes.push_back(
          first->where + ": no reading of joint '" + joint +
          "': parameters that depend on it cannot be calibrated from these samples");
  }
  out.notes.insert(out.notes.end(), table.notes.begin(), table.notes.end());
  std::vector<Pose> flange;
  for (const JointRow& row : rows)
    for (const auto& [name, value] : row.poses) flange.push_back(value);
  if (const std::string doubt = doubt_of_unit(options.joints, flange); !doubt.empty())
    out.notes.push_back(doubt);
  out.lost.insert(out.lost.begin(), without.begin(), without.end());
  return out;
}

std::vector<std::string> image_files(const std::string& path) {
  const bool folder = fs::is_directory(path);
  const bool pattern = !folder && path.find_first_of("*?[") != std::string::npos;
  if (!folder && !pattern && !fs::exists(path))
    throw InputError(path + ": there is no such file or folder");
  if (!folder && !pattern) return {path};
  fs::path inside = folder ? fs::path(path) : fs::path(path).parent_path();
  if (inside.empty()) inside = ".";
  static const std::vector<std::string> endings = {".png",  ".jpg", ".jpeg", ".bmp", ".tif",
                                                   ".tiff", ".pgm", ".ppm",  ".webp"};
  std::vector<std::string> out;
  std::error_code status;
  for (const fs::directory_entry& entry : fs::directory_iterator(inside, status)) {
    const std::string name = entry.path().filename().string();
    std::string ending = entry.path().extension().string();
    for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    const bool meant = pattern ? fnmatch(fs::path(path).filename().c_str(), name.c_str(), 0) == 0
                               : std::find(endings.begin(), endings.end(), ending) != endings.end();
    if (meant && entry.is_regular_file())
      out.push_back((inside / name).lexically_normal().string());
  }
  std::sort(out.begin(), out.end(), [](const std::string& a, const std::string& b) {
    return strverscmp(a.c_str(), b.c_str()) < 0;
  });
  if (out.empty()) throw InputError(path + ": no images there");
  return out;
}

}  // namespace kincal
