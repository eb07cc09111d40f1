#include "intrinsics_table.h"

#include <algorithm>
#include <cmath>

#include "table.h"

namespace kincal {
namespace {

/// A grid as the image has it, line by line.
std::string grid_text(const Grid& grid, const char* format) {
  std::vector<std::vector<std::string>> rows;
  for (int r = 0; r < grid.rows; ++r) {
    rows.push_back({" "});
    for (int c = 0; c < grid.columns; ++c) {
      const double v = grid.values[r * grid.columns + c];
      rows.back().push_back(std::isfinite(v) ? text(format, v) : "-");
    }
  }
  return align(rows, 1);
}

/// How the lenses did, the chosen one marked.
std::string choice_text(const CameraIntrinsics& camera) {
  std::vector<std::vector<std::string>> rows = {
      {"lens", "numbers", "rms", "held out", "worse than the best", ""}};
  for (const LensTrial& t : camera.trials) {
    const std::string worse =
        std::isfinite(t.worse) ? text("%.5f +- %.5f", t.worse, t.worse_sigma) : "-";
    rows.push_back({t.model->name, std::to_string(t.model->numbers()), value(t.rms),
                    value(t.held_out), worse, t.model == camera.model ? "chosen" : t.unusable});
  }
  return align(rows, 1);
}

std::string estimates_text(const Solution& solution, const std::string& name) {
  std::vector<std::vector<std::string>> rows = {{"", "value", "sigma", ""}};
  for (const ParameterEstimate& e : solution.parameters)
    if (e.name == name + "intrinsics" || e.name == name + "distortion")
      for (size_t c = 0; c < e.value.size(); ++c)
        if (e.freed[c])
          rows.push_back({e.components[c], text("%.6g", e.value[c]),
                          std::isfinite(e.sigma[c]) ? "± " + text("%.2g", e.sigma[c]) : "unknown",
                          e.units[c]});
  return align(rows, 1);
}

std::string stereo_text(const Solution& solution, const std::string& name,
                        const std::string& reference) {
  const ParameterEstimate& e = solution[name + "pose"];
  const Vector3d t = e.pose->translation * 1e3, w = log_so3(e.pose->rotation) * 1e3;
  std::string out = "pose seen from '" + reference + "'\n";
  std::vector<std::vector<std::string>> rows;
  for (int c = 0; c < 6; ++c)
    rows.push_back({c < 3 ? std::string(1, "xyz"[c]) : "r" + std::string(1, "xyz"[c - 3]),
                    text("%.6g", c < 3 ? t(c) : w(c - 3)),
                    std::isfinite(e.sigma[c]) ? "± " + text("%.2g", e.sigma[c] * 1e3) : "unknown",
                    c < 3 ? "mm" : "mrad"});
  return out + align(rows, 1);
}

}  // namespace

std::string intrinsics_table(const Rig& rig, const IntrinsicsResult& result) {
  std::string out;
  for (const CameraIntrinsics& camera : result.cameras) {
    const IntrinsicsGroup& group = result.groups[camera.group];
    const std::string& name = rig.sensors[camera.camera].name;
    out += (out.empty() ? "" : "\n") + text("Camera '%s': %s, %ld views with %ld corners\n",
                                            name.c_str(), camera.model->name.c_str(), camera.views,
                                            camera.points);
    if (!camera.trials.empty())
      out += "\nLenses (px; held out: samples that the fit did not use)\n" + choice_text(camera);
    out += "\n" + estimates_text(group.solution, "sensor/" + name + "/");
    if (camera.sensor > 0)
      out +=
          stereo_text(group.solution, "sensor/" + name + "/", rig.sensors[group.cameras[0]].name);
    out += text("rms %.4g px; noise of the corners %.3g px along each axis, %.3g in the rig\n",
                camera.rms, camera.noise, camera.stated);
    if (camera.held_out)
      out += text("held out: rms %.4g px (95 %%: %.4g to %.4g), median %.4g px\n",
                  camera.held_out->rms, camera.held_out->of_rms.low, camera.held_out->of_rms.high,
                  camera.held_out->median);
    out += text("\nCorners over the image (%.0f x %.0f px)\n", camera.image.x(), camera.image.y()) +
           grid_text(camera.coverage, "%.0f");
    const auto empty =
        std::count(camera.coverage.values.begin(), camera.coverage.values.end(), 0.0);
    if (empty > 0)
      out += text("%ld of %zu parts of the image have no corners: the lens is extrapolated there\n",
                  static_cast<long>(empty), camera.coverage.values.size());
    out += text("\nSigma in px of where a point appears at %.3g m, the boards' distance\n",
                camera.distance) +
           grid_text(camera.near, "%.2g") + "and far away\n" + grid_text(camera.far, "%.2g");
  }
  for (const IntrinsicsGroup& group : result.groups) {
    if (!group.warp) continue;
    out += text(
        "\nBoards that may be bent: held out %.4g px, flat %.4g px; better by %.5f +- %.5f, "
        "%s\n",
        group.warp->warped, group.warp->flat, group.warp->better, group.warp->better_sigma,
        group.warp->kept ? "kept" : "not kept");
    for (const ParameterEstimate& e : group.solution.parameters)
      if (group.solution.table().all[e.parameter].kind == ParameterKind::warp)
        out += text("  %s: %.3g ± %.2g mm along x, %.3g ± %.2g mm along y\n", e.name.c_str(),
                    e.value[0] * 1e3, e.sigma[0] * 1e3, e.value[1] * 1e3, e.sigma[1] * 1e3);
  }
  return out;
}

}  // namespace kincal
