#include "one_camera.h"

#include <cmath>
#include <optional>
#include <set>
#include <stdexcept>
#include <typeinfo>

#include "../analysis/linearisation.h"
#include "../analysis/residuals.h"
#include "../fitting/lens_start.h"
#include "../rig/geometry.h"
#include "../rig/targets.h"
#include "../rig/words.h"

namespace kincal {
namespace {

std::vector<double> block_values(const Sensor& camera, ParameterKind kind) {
  const ParameterBlock* block = find_block(camera, kind);
  return block ? block->values : std::vector<double>();
}

/// The camera with another lens: its distortion is cut off, or filled up with zeros.
Sensor with_lens(Sensor camera, const LensModel& model, const std::vector<double>& intrinsics,
                 std::vector<double> distortion) {
  const std::vector<double> baseline = block_values(camera, ParameterKind::baseline);
  distortion.resize(model.distortion, 0.0);
  for (int k = model.freed; k < model.distortion; ++k) distortion[k] = 0;
  camera.model = make_camera(model.lens, model.distortion);
  camera.parameters =
      camera_parameters(model.lens, intrinsics, distortion, baseline.empty() ? 0.0 : baseline[0]);
  return camera;
}

/// Frees a lens, and the pose of a camera that is not the reference.
void add_free(const Sensor& camera, const LensModel& model, bool pose, Step& step) {
  const std::string name = "sensor/" + camera.name + "/";
  step.free.push_back(name + "intrinsics");
  const ParameterBlock* distortion = find_block(camera, ParameterKind::distortion);
  for (int k = 0; k < model.freed; ++k)
    step.free.push_back(name + "distortion." + distortion->components[k]);
  if (pose) step.free.push_back(name + "pose");
}

/// The camera with a lens of these numbers, at the focal length that fits best.
Sensor plain_start(const OneCamera& camera, const LensModel& model,
                   const std::vector<double>& distortion) {
  Rig rig = camera.rig;
  rig.sensors[0] = with_lens(camera.rig.sensors[0], model, {1, 1, 0, 0}, distortion);
  return with_lens(rig.sensors[0], model, find_focal_length(rig, camera.views), distortion);
}

}  // namespace

const std::vector<LensModel>& lens_models() {
  static const std::vector<LensModel> models = {
      {"pinhole", "pinhole", Lens::pinhole, 0, 0},
      {"brown_conrady_4", "brown_conrady", Lens::brown_conrady, 5, 4},
      {"brown_conrady_5", "brown_conrady", Lens::brown_conrady, 5, 5},
      {"kannala_brandt", "kannala_brandt", Lens::kannala_brandt, 4, 4},
      {"brown_conrady_8", "brown_conrady", Lens::brown_conrady, 8, 8}};
  return models;
}

const std::vector<LensModel>& further_lens_models() {
  static const std::vector<LensModel> models = {
      {"brown_conrady_2", "brown_conrady", Lens::brown_conrady, 5, 2},
      {"brown_conrady_12", "brown_conrady", Lens::brown_conrady, 12, 12},
      {"brown_conrady_14", "brown_conrady", Lens::brown_conrady, 14, 14},
      {"unified", "unified", Lens::unified, 5, 5},
      {"double_sphere", "double_sphere", Lens::double_sphere, 2, 2}};
  return models;
}

bool start_alike(Lens a, Lens b) {
  const auto kind = [](Lens lens) { return lens == Lens::pinhole ? Lens::brown_conrady : lens; };
  return kind(a) == kind(b);
}

const LensModel& find_lens(const std::string& name) {
  std::vector<std::string> names;
  for (const auto* models : {&lens_models(), &further_lens_models()})
    for (const LensModel& model : *models) {
      if (model.name == name) return model;
      names.push_back(model.name);
    }
  throw std::invalid_argument("model: there is no lens '" + name + "'; valid: auto, rig, " +
                              listed(names, names.size()));
}

const LensModel& own_lens(const Sensor& camera) {
  for (const auto* models : {&lens_models(), &further_lens_models()})
    for (const LensModel& model : *models) {
      const std::shared_ptr<const SensorModel> made = make_camera(model.lens, model.distortion);
      const SensorModel &a = *made, &b = *camera.model;
      if (typeid(a) == typeid(b) && model.freed == model.distortion) return model;
    }
  throw std::invalid_argument("camera '" + camera.name + "' has a lens of its own");
}

void set_steps(const std::vector<const LensModel*>& lenses, Rig& rig) {
  Step step;
  step.name = "intrinsics";
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    step.sensors.push_back(static_cast<int>(s));
    add_free(rig.sensors[s], *lenses[s], s > 0, step);
  }
  step.free_where.assign(step.free.size(), "intrinsics");
  rig.steps = {step};
}

Rig at_solution(const Solution& solution) {
  Rig rig = solution.rig();
  const ParameterTable& table = solution.table();
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    rig.sensors[s].link_T_sensor =
        get_pose(solution.values.shared, table.all[table.sensor_pose[s]].start);
    rig.sensors[s].pose_given = true;
    int start = table.all[table.sensor_block[s]].start;
    for (ParameterBlock& block : rig.sensors[s].parameters)
      for (double& v : block.values) v = solution.values.shared(start++);
  }
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (table.target_warp[t] >= 0)
      rig.targets[t].warp =
          solution.values.shared.segment<2>(table.all[table.target_warp[t]].start);
  return rig;
}

bool bend_boards(const std::vector<Sample>& samples, Rig& rig) {
  std::set<int> seen;
  for (const Sample& sample : samples)
    for (const View& view : sample.views)
      if (rig.targets[view.target].grid) seen.insert(view.target);
  for (const int t : seen) {
    Target& target = rig.targets[t];
    target.bulge = warp_shapes(target.layout);
    rig.steps[0].free.push_back("target/" + target.name + "/warp");
    rig.steps[0].free_where.push_back("warp");
  }
  return !seen.empty();
}

std::shared_ptr<const Recording> recording_of(Rig rig, const SharedSamples& samples) {
  return std::make_shared<const Recording>(std::make_shared<const Rig>(std::move(rig)), nullptr,
                                           samples);
}

OneCamera one_camera(const Rig& rig, const std::vector<Sample>& samples, int camera, bool bent) {
  OneCamera out;
  out.bent = bent;
  out.rig = bench(rig, {camera});
  out.samples = std::make_shared<const std::vector<Sample>>(seen_by(rig, samples, {camera}));
  out.views = camera_views(*out.samples, 0);
  out.starts = {out.rig.sensors[0]};
  for (const char* plain : {"pinhole", "kannala_brandt"})
    out.starts.push_back(plain_start(out, find_lens(plain), {}));
  return out;
}

void fit_plain_lens(const LensModel& model, const CalibrationOptions& options, OneCamera& camera) {
  std::vector<std::vector<double>> usual = {lens_type(model.lens).plain};
  if (model.lens == Lens::double_sphere) usual = {{-0.3, 0.6}, {0, 0.5}, {0.3, 0.6}};
  double least = kInfinity;
  std::optional<Sensor> best;
  for (const std::vector<double>& distortion : usual) {
    OneCamera alone = camera;
    alone.starts = {plain_start(camera, model, distortion)};
    const Solution found = fit_lens(model, options, alone);
    if (best && !(found.usable() && found.chi2_data < least)) continue;
    least = found.usable() ? found.chi2_data : kInfinity;
    best = alone.starts.back();
  }
  camera.starts.push_back(*best);
}

Sensor best_start(const OneCamera& camera, const LensModel& model) {
  Sensor best;
  double least = kInfinity;
  for (const Sensor& start : camera.starts) {
    if (!start_alike(own_lens(start).lens, model.lens)) continue;
    Rig rig = camera.rig;
    rig.sensors[0] = with_lens(start, model, block_values(start, ParameterKind::intrinsics),
                               block_values(start, ParameterKind::distortion));
    const double misfit = lens_misfit(rig, camera.views);
    if (misfit < least) least = misfit, best = rig.sensors[0];
  }
  return best;
}

Solution fit_lens(const LensModel& model, const CalibrationOptions& options, OneCamera& camera) {
  Rig rig = camera.rig;
  rig.sensors[0] = best_start(camera, model);
  set_steps({&model}, rig);
  if (camera.bent) bend_boards(*camera.samples, rig);
  Solution solution = uncancelled(calibrate(recording_of(std::move(rig), camera.samples), options));
  if (solution.usable()) camera.starts.push_back(at_solution(solution).sensors[0]);
  return solution;
}

double training_rms(const Solution& solution, int sensor) {
  const Residuals found = residuals(linearise(solution));
  for (const SensorResult& s : found.sensors)
    if (s.name == solution.rig().sensors[sensor].name) return s.train.rms;
  return kNan;
}

}  // namespace kincal
