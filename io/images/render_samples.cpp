#include "render_samples.h"

#include <cmath>
#include <filesystem>
#include <map>
#include <opencv2/imgcodecs.hpp>

#include "../../models/rig/configuration.h"
#include "../document/error.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../rig/simulation_file.h"
#include "parallel.h"

namespace kincal {
namespace {

/// A PictureTask is one picture to be taken.
struct PictureTask {
  std::string path;
  int sensor = 0;
  const Posture* posture = nullptr;
};

/// A Studio is what all pictures have in common.
struct Studio {
  const Rig& rig;
  ParameterTable table;
  VectorXd truth;
  std::map<int, Print> prints;     // by target
  std::map<int, CameraRays> rays;  // by sensor
};

int camera_index(const Field& field, const Rig& rig) {
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.sensors[s];
    if (sensor.name != field.string() || sensor.type != "camera") continue;
    if (sensor.image_width < 1)
      field.fail("camera '" + sensor.name + "' needs an image_size in the rig to take pictures");
    return static_cast<int>(s);
  }
  field.fail("there is no camera '" + field.string() + "' in the rig");
}

/// One task for each image, in the order of the file.
std::vector<PictureTask> tasks_of(const std::string& path, const Rig& rig,
                                  const std::map<std::string, Posture>& postures) {
  std::vector<PictureTask> tasks;
  std::map<std::string, size_t> known;
  for_each_json_line(read_file(path), path, [&](const Field& sample) {
    const auto posture = postures.find(sample["id"].string());
    if (posture == postures.end())
      sample["id"].fail("the truth has no sample '" + sample["id"].string() + "'");
    const Field views = sample["views"];
    for (size_t v = 0; v < views.size(); ++v) {
      const Field view = views.item(v);
      if (!view.has("image")) continue;
      const std::filesystem::path image(view["image"].string());
      const int sensor = camera_index(view["sensor"], rig);
      const std::string file =
          image.is_absolute()
              ? image.string()
              : (std::filesystem::path(path).parent_path() / image).lexically_normal().string();
      const auto at = known.emplace(file, tasks.size());
      if (at.second)
        tasks.push_back({file, sensor, &posture->second});
      else if (tasks[at.first->second].sensor != sensor ||
               tasks[at.first->second].posture != &posture->second)
        view["image"].fail("another view of another camera or sample has this image");
    }
    return posture->first;
  });
  if (tasks.empty()) throw InputError(path + ": no view has an `image`");
  return tasks;
}

cv::Mat picture_of(const Studio& studio, const PictureTask& task, const Look& look, Draws draws) {
  const Configuration robot(studio.rig, studio.table, studio.truth, task.posture->readings);
  const int link = studio.rig.sensors[task.sensor].link;
  const Pose camera_T_link = inverse(robot.link_T_sensor(task.sensor));
  const auto stands = [&](int other) {  // relative to the camera
    for (int j : joints_between(studio.rig, link, other))
      if (std::isnan(task.posture->readings[j])) return false;
    return true;
  };
  std::vector<Sheet> sheets;
  for (const auto& [t, print] : studio.prints) {
    const Target& target = studio.rig.targets[t];
    const auto placed = task.posture->targets.find(t);
    Sheet sheet;
    sheet.print = &print;
    const int frame = target.link >= 0 ? target.link : studio.rig.base;
    if ((target.link < 0 && placed == task.posture->targets.end()) || !stands(frame)) continue;
    const Pose frame_T_print =
        target.link < 0
            ? placed->second
            : get_pose(studio.truth, studio.table.all[studio.table.target_pose[t]].start);
    sheet.camera_T_print = camera_T_link * robot.a_T_b(link, frame) * frame_T_print;
    if (target.grid)
      sheet.unit = studio.truth(studio.table.all[studio.table.target_square[t]].start);
    sheet.y_up = target.y_up;
    sheets.push_back(sheet);
  }
  return take_picture(studio.rays.at(task.sensor), sheets, look, draws);
}

}  // namespace

int render_samples(const RigFile& rig, const std::string& samples, const std::string& truth,
                   const RenderOptions& options) {
  Studio studio{rig.rig, ParameterTable(rig.rig), {}, {}, {}};
  studio.truth = read_truth(truth, studio.table);
  const std::map<std::string, Posture> postures = read_true_postures(truth, rig.rig);
  const std::vector<PictureTask> tasks = tasks_of(samples, rig.rig, postures);
  for (size_t t = 0; t < rig.rig.targets.size(); ++t)
    if (rig.rig.targets[t].type != "points")
      studio.prints[static_cast<int>(t)] = print_of(image_target(rig, rig.rig.targets[t]));
  for (const PictureTask& task : tasks) {
    const std::filesystem::path folder = std::filesystem::path(task.path).parent_path();
    std::error_code status;  // what is wrong with it the next line says
    if (!folder.empty()) std::filesystem::create_directories(folder, status);
    check_output_file(task.path, options.force);
    if (!studio.rays.count(task.sensor))
      studio.rays[task.sensor] = camera_rays(rig.rig, studio.table, studio.truth, task.sensor);
  }
  const auto take = [&](size_t i) {
    // A stream of its own: the samples' noise has those of the seed itself.
    const cv::Mat picture = picture_of(studio, tasks[i], options.look, Draws(~options.seed, i));
    std::vector<uchar> png;
    cv::imencode(".png", picture, png,
                 {cv::IMWRITE_PNG_COMPRESSION, 9, cv::IMWRITE_PNG_STRATEGY,
                  cv::IMWRITE_PNG_STRATEGY_FILTERED});
    write_file(tasks[i].path, std::string(png.begin(), png.end()), options.force);
  };
  in_parallel(tasks.size(), options.threads, take, options.progress);
  return static_cast<int>(tasks.size());
}

}  // namespace kincal
