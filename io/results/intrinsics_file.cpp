#include "intrinsics_file.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "../../models/rig/words.h"
#include "../document/files.h"
#include "../rig/rig_text.h"
#include "json_values.h"
#include "result_json.h"

namespace kincal {
namespace {

Json estimate_json(const Solution& solution, const std::string& name) {
  Json out = Json::object();
  for (const ParameterEstimate& e : solution.parameters)
    if (e.name == name)
      for (size_t c = 0; c < e.value.size(); ++c)
        out[e.components[c]] = {{"value", number(e.value[c])}, {"sigma", number(e.sigma[c])}};
  return out;
}

/// Rows of a grid, from the top.
Json grid_json(const Grid& grid) {
  Json rows = Json::array();
  for (int r = 0; r < grid.rows; ++r) {
    Json row = Json::array();
    for (int c = 0; c < grid.columns; ++c) row.push_back(number(grid.values[r * grid.columns + c]));
    rows.push_back(row);
  }
  return rows;
}

Json trials_json(const CameraIntrinsics& camera) {
  Json out = Json::array();
  for (const LensTrial& t : camera.trials) {
    Json one = {{"model", t.model->name},
                {"numbers", t.model->numbers()},
                {"rms", number(t.rms)},
                {"held_out", number(t.held_out)},
                {"worse", number(t.worse)},
                {"worse_sigma", number(t.worse_sigma)},
                {"chosen", t.model == camera.model}};
    if (!t.unusable.empty()) one["unusable"] = t.unusable;
    out.push_back(one);
  }
  return out;
}

Json camera_json(const RigFile& rig_file, const IntrinsicsResult& result,
                 const CameraIntrinsics& camera) {
  const IntrinsicsGroup& group = result.groups[camera.group];
  const Solution& solution = group.solution;
  const std::string& name = rig_file.rig.sensors[camera.camera].name;
  const std::string prefix = "sensor/" + name + "/";
  Json out = {{"lens", camera.model->name},
              {"model", camera.model->type},
              {"image_size", {camera.image.x(), camera.image.y()}},
              {"views", camera.views},
              {"points", camera.points},
              {"rms", number(camera.rms)},
              {"noise", {{"stated", number(camera.stated)}, {"seen", number(camera.noise)}}},
              {"intrinsics", estimate_json(solution, prefix + "intrinsics")},
              {"distortion", estimate_json(solution, prefix + "distortion")}};
  if (camera.held_out)
    out["held_out"] = {
        {"rms", number(camera.held_out->rms)},
        {"interval", {number(camera.held_out->of_rms.low), number(camera.held_out->of_rms.high)}},
        {"median", number(camera.held_out->median)},
        {"points", camera.held_out->points}};
  if (!camera.trials.empty()) out["models"] = trials_json(camera);
  out["tilt"] = number(camera.tilt);
  out["coverage"] = grid_json(camera.coverage);
  out["projection"] = {{"distance", number(camera.distance)},
                       {"sigma", grid_json(camera.near)},
                       {"sigma_far", grid_json(camera.far)}};
  if (camera.sensor > 0) {
    const ParameterEstimate& relative = solution[prefix + "pose"];
    out["stereo"] = {{"reference", rig_file.rig.sensors[group.cameras[0]].name},
                     {"pose", pose(*relative.pose)},
                     {"sigma", numbers(relative.sigma)}};
  }
  return out;
}

Json covariance_json(const Solution& solution) {
  Json names = Json::array(), rows = Json::array();
  for (const Component& c : solution.columns) names.push_back(solution.table().name(c));
  for (Eigen::Index r = 0; r < solution.covariance.rows(); ++r) {
    Json row = Json::array();
    for (Eigen::Index c = 0; c < solution.covariance.cols(); ++c)
      row.push_back(number(solution.covariance(r, c)));
    rows.push_back(row);
  }
  return {{"names", names}, {"rows", rows}};
}

/// What boards that may be bent were worth, and how they are.
Json warp_json(const IntrinsicsGroup& group) {
  const ParameterTable& table = group.solution.table();
  Json out = {{"flat", number(group.warp->flat)},
              {"warped", number(group.warp->warped)},
              {"better", number(group.warp->better)},
              {"better_sigma", number(group.warp->better_sigma)},
              {"kept", group.warp->kept},
              {"targets", Json::object()}};
  for (const ParameterEstimate& e : group.solution.parameters)
    if (table.all[e.parameter].kind == ParameterKind::warp)
      out["targets"][group.solution.rig().targets[table.all[e.parameter].owner].name] = {
          {"value", numbers(e.value)}, {"sigma", numbers(e.sigma)}};
  return out;
}

Json result_of(const RigFile& rig_file, const IntrinsicsResult& result,
               const IntrinsicsSource& source) {
  Json out = {{"kincal", source.version},
              {"status", status_name(result.status)},
              {"input",
               {{"command", source.command},
                {"rig", sha256(rig_file.text)},
                {"samples", source.samples_hash},
                {"urdf", sha256(rig_file.urdf.text)}}},
              {"cameras", Json::object()},
              {"groups", Json::array()},
              {"warnings", Json::array()}};
  for (const CameraIntrinsics& camera : result.cameras)
    out["cameras"][rig_file.rig.sensors[camera.camera].name] =
        camera_json(rig_file, result, camera);
  for (const IntrinsicsGroup& group : result.groups) {
    Json one = {{"cameras", Json::array()},
                {"chi2", number(group.solution.chi2)},
                {"dof", group.solution.dof},
                {"unobservable", Json::array()},
                {"covariance", covariance_json(group.solution)}};
    if (group.warp) one["warp"] = warp_json(group);
    for (int camera : group.cameras) one["cameras"].push_back(rig_file.rig.sensors[camera].name);
    for (const Direction& direction : group.solution.unobservable) {
      Json entry = Json::object();
      for (const auto& [name, coefficient] : direction) entry[name] = number(coefficient);
      one["unobservable"].push_back(entry);
    }
    out["groups"].push_back(one);
  }
  for (const IntrinsicsNote& note : result.notes)
    out["warnings"].push_back({{"id", note.id}, {"text", note.text}});
  return out;
}

// ------------------------------------------------------------------------------------------------
// picture
std::string escaped(const std::string& name) {
  std::string out;
  for (const char c : name)
    out += c == '<' ? "&lt;" : c == '>' ? "&gt;" : c == '&' ? "&amp;" : std::string(1, c);
  return out;
}

/// One camera's image, 640 wide: corners as dots, and in each cell the sigma of what appears there;
/// cells without corners are shaded.
std::string picture(const Sensor& sensor, const IntrinsicsGroup& group,
                    const CameraIntrinsics& camera, double top, double& height) {
  const double scale = 640 / camera.image.x();
  height = camera.image.y() * scale;
  std::string labels, out = text("<g transform='translate(10 %.1f)'>\n<text y='-8'>", top) +
                            escaped(sensor.name) +
                            text(": %ld corners; sigma in px of a point at %.3g m</text>\n",
                                 camera.points, camera.distance);
  const Grid& grid = camera.coverage;
  const double w = 640.0 / grid.columns, h = height / grid.rows;
  for (int r = 0; r < grid.rows; ++r)
    for (int c = 0; c < grid.columns; ++c) {
      const int i = r * grid.columns + c;
      out += text("<rect x='%.1f' y='%.1f' width='%.1f' height='%.1f' fill='%s'/>\n", c * w, r * h,
                  w, h, grid.values[i] > 0 ? "#fff" : "#f4c7c3");
      if (std::isfinite(camera.near.values[i]))
        labels += text("<text x='%.1f' y='%.1f' class='s'>%.2g</text>\n", (c + 0.5) * w,
                       (r + 0.5) * h + 4, camera.near.values[i]);
    }
  for (const Sample& sample : group.solution.samples())
    for (const View& view : sample.views) {
      if (view.sensor != camera.sensor) continue;
      for (size_t k = 0; k + 1 < view.z.size(); k += 2)
        out += text("<circle cx='%.1f' cy='%.1f' r='1'/>", (view.z[k] + 0.5) * scale,
                    (view.z[k + 1] + 0.5) * scale);
      out += "\n";
    }
  return out + labels + "</g>\n";
}

std::string coverage_svg(const Rig& rig, const IntrinsicsResult& result) {
  std::string body;
  double top = 30, height = 0;
  for (const CameraIntrinsics& camera : result.cameras) {
    body += picture(rig.sensors[camera.camera], result.groups[camera.group], camera, top, height);
    top += height + 40;
  }
  return text(
             "<svg xmlns='http://www.w3.org/2000/svg' width='660' height='%.0f' "
             "font-family='sans-serif' font-size='13'>\n",
             top) +
         "<style>rect{stroke:#999;stroke-width:.5}circle{fill:#1a73e8;fill-opacity:.6}"
         ".s{text-anchor:middle;font-size:12px;stroke:#fff;stroke-width:3;paint-order:stroke}</"
         "style>\n" +
         body + "</svg>\n";
}

/// The rig with the new lenses. What was nominal of them is not centred on any more.
RigFile with_lenses(RigFile rig, const IntrinsicsResult& result) {
  std::vector<NominalValue> nominal;
  const auto of_camera = [&](const std::string& parameter) {
    return std::any_of(result.cameras.begin(), result.cameras.end(), [&](const auto& camera) {
      const std::string prefix = "sensor/" + rig.rig.sensors[camera.camera].name + "/";
      return parameter == prefix + "intrinsics" || parameter == prefix + "distortion";
    });
  };
  for (const NominalValue& value : rig.rig.nominal)
    if (!of_camera(value.parameter)) nominal.push_back(value);
  if (nominal.size() < rig.rig.nominal.size()) set_nominal(rig, nominal);
  for (const CameraIntrinsics& camera : result.cameras)
    set_lens(rig, camera.camera, camera.model->type, calibrated_camera(rig.rig, result, camera));
  return rig;
}

/// What the views of boards leave open of lenses and of boards that are bent, as priors for a
/// calibration that sees other samples.
std::vector<PriorSetting> priors_of(const IntrinsicsResult& result) {
  std::vector<PriorSetting> out;
  for (const IntrinsicsGroup& group : result.groups)
    for (const ParameterEstimate& e : group.solution.parameters) {
      const ParameterKind kind = group.solution.table().all[e.parameter].kind;
      if (kind != ParameterKind::intrinsics && kind != ParameterKind::distortion &&
          kind != ParameterKind::warp)
        continue;
      for (size_t c = 0; c < e.sigma.size(); ++c)
        if (e.sigma[c] > 0)
          out.push_back({e.component_name(c), e.sigma[c], e.sigma[c], false, "kincal intrinsics"});
    }
  return out;
}

}  // namespace

std::vector<std::string> names_without_parameter(const RigFile& rig_file,
                                                 const IntrinsicsResult& result) {
  const Rig now = with_lenses(rig_file, result).rig;
  const ParameterTable table(now);
  std::vector<std::string> out;
  for (const Step& step : now.steps)
    for (const std::string& pattern : step.free)
      if (table.select(pattern).empty()) out.push_back(pattern);
  return out;
}

std::vector<std::pair<std::string, std::string>> intrinsics_files(const RigFile& rig_file,
                                                                  const IntrinsicsResult& result,
                                                                  const IntrinsicsSource& source) {
  RigFile written = with_lenses(rig_file, result);
  if (written.rig.steps.empty()) add_priors(written, priors_of(result));
  RigValues values = values_of(written.rig);
  for (const CameraIntrinsics& camera : result.cameras)
    if (const Sensor found = calibrated_camera(rig_file.rig, result, camera); found.pose_given)
      values.sensor_poses[camera.camera] = found.link_T_sensor;
  for (const IntrinsicsGroup& group : result.groups)
    for (const ParameterEstimate& e : group.solution.parameters) {
      const Parameter& p = group.solution.table().all[e.parameter];
      if (p.kind == ParameterKind::warp) values.target_warps[p.owner] = {e.value[0], e.value[1]};
    }
  const std::string mark = result.status == Status::converged
                               ? ""
                               : "# kincal: status " + status_name(result.status) +
                                     ", see intrinsics.json: do not rely on these values.\n";
  return {{"robot.urdf", rig_file.urdf.text},
          {"rig.yaml", mark + rig_text(written, values, "robot.urdf")},
          {"intrinsics.json", json_text(result_of(rig_file, result, source))},
          {"coverage.svg", coverage_svg(rig_file.rig, result)}};
}

bool lenses_are_from(const std::string& rig_path, const std::string& samples_hash) {
  const auto beside = std::filesystem::path(rig_path).parent_path() / "intrinsics.json";
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(beside, ignored)) return false;
  try {
    const Json all = Json::parse(read_file(beside.string()));
    return all.at("input").at("samples") == samples_hash;
  } catch (const std::exception&) {  // not ours, or damaged: nothing is known
    return false;
  }
}

void forget_lenses(Rig& rig) {
  constexpr double kNothing = 1000;  // times as wide
  for (PriorSetting& prior : rig.priors)
    for (const char* part : {"/intrinsics.", "/distortion.", "/warp."})
      if (prior.pattern.find(part) != std::string::npos) {
        prior.translation *= kNothing;
        prior.rotation *= kNothing;
      }
}

}  // namespace kincal
