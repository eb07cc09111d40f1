#include "render_samples.h"

#include <filesystem>
#include <map>
#include <opencv2/imgcodecs.hpp>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../rig/simulation_file.h"
#include "parallel.h"
#include "studio.h"

namespace kincal {
namespace {

/// A PictureTask is one picture to be taken.
struct PictureTask {
  std::string path;
  int sensor = 0;
  const Posture* posture = nullptr;
};

int camera_index(const Field& field, const Rig& rig) {
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.sensors[s];
    if (sensor.name != field.string() || sensor.type != "camera") continue;
    if (sensor.image_width < 1)
      field.fail("camera '" + sensor.name + "' needs an image_size in the rig for rendering");
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

}  // namespace

int render_samples(const RigFile& rig, const std::string& samples, const std::string& truth,
                   const RenderOptions& options) {
  Studio studio = make_studio(rig, truth);
  const std::map<std::string, Posture> postures = read_true_postures(truth, rig.rig);
  const std::vector<PictureTask> tasks = tasks_of(samples, rig.rig, postures);
  for (const PictureTask& task : tasks) {
    const std::filesystem::path folder = std::filesystem::path(task.path).parent_path();
    std::error_code status;  // what is wrong with it the next line says
    if (!folder.empty()) std::filesystem::create_directories(folder, status);
    check_output_file(task.path, options.force);
    prepare_camera(studio, task.sensor);
  }
  const auto take = [&](size_t i) {
    // A stream of its own: the samples' noise has those of the seed itself.
    const PictureTask& task = tasks[i];
    const cv::Mat picture =
        take_picture(studio.rays.at(task.sensor), sheets_before(studio, task.sensor, *task.posture),
                     options.look, RandomStream(~options.seed, i));
    std::vector<uchar> png;
    cv::imencode(".png", picture, png,
                 {cv::IMWRITE_PNG_COMPRESSION, 9, cv::IMWRITE_PNG_STRATEGY,
                  cv::IMWRITE_PNG_STRATEGY_FILTERED});
    write_file(task.path, std::string(png.begin(), png.end()), options.force);
  };
  in_parallel(tasks.size(), options.threads, take, options.progress);
  return static_cast<int>(tasks.size());
}

}  // namespace kincal
