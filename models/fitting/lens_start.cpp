#include "lens_start.h"

#include <algorithm>
#include <cmath>

#include "../rig/numbers.h"
#include "../rig/targets.h"
#include "view_poses.h"

namespace kincal {
namespace {

// Focal lengths that are tried, in widths of the image: from a fisheye's to a long tele's.
constexpr double kShortest = 0.2, kLongest = 12, kRatio = 1.25;
constexpr size_t kViewsTried = 12;
// A view's worth of misfit for a focal length that is e times, or one e-th of, the image's width:
// it decides where the views say nothing.
constexpr double kUnusual = 0.05;

/// Mean square of a view's residuals with its target at a pose, in px^2; infinite where one is
/// undefined.
double mean_square(const Rig& rig, const ParameterTable& table, const View& view,
                   const Pose& sensor_T_target) {
  const Sensor& camera = rig.sensors[view.sensor];
  const Matrix3Xd points = target_points(rig.targets[view.target]);
  const std::vector<int> ids = view_ids(view, rig.targets[view.target]);
  ViewInput in;
  in.sensor_T_target = sensor_T_target;
  in.parameters = table.initial.data() + table.all[table.sensor_block[view.sensor]].start;
  in.points = &points;
  in.ids = ids.data();
  in.count = static_cast<int>(ids.size());
  in.z = view.z.data();
  VectorXd r(2 * in.count);
  if (!camera.model->evaluate(in, Columns(), r.data(), nullptr)) return kInfinity;
  return r.squaredNorm() / static_cast<double>(in.count);
}

}  // namespace

double lens_misfit(const Rig& rig, const std::vector<const View*>& views) {
  const ParameterTable table(rig);
  constexpr double kWorst = 1e6;  // px^2: of a view that no pose explains
  double sum = 0;
  for (const View* view : views) {
    double least = kWorst;
    for (const Pose& pose : view_poses(rig, table, table.initial, *view))
      least = std::min(least, mean_square(rig, table, *view, pose));
    sum += std::log1p(least);
  }
  return sum;
}

std::vector<double> find_focal_length(Rig rig, const std::vector<const View*>& views) {
  const Eigen::Vector2d size = image_size(rig.sensors[0], views);
  std::vector<const View*> some;
  const size_t step = std::max<size_t>(1, views.size() / kViewsTried);
  for (size_t i = 0; i < views.size(); i += step) some.push_back(views[i]);
  std::vector<double>& numbers = rig.sensors[0].parameters[0].values;
  std::vector<double> best;
  double least = kInfinity;
  for (double f = kShortest * size.x(); f < kLongest * size.x(); f *= kRatio) {
    numbers = {f, f, (size.x() - 1) / 2, (size.y() - 1) / 2};
    const double unusual = std::log(f / size.x());
    const double misfit =
        lens_misfit(rig, some) + kUnusual * unusual * unusual * static_cast<double>(some.size());
    if (misfit < least) least = misfit, best = numbers;
  }
  return best;
}

Eigen::Vector2d image_size(const Sensor& camera, const std::vector<const View*>& views) {
  if (camera.image_width > 0)
    return {static_cast<double>(camera.image_width), static_cast<double>(camera.image_height)};
  Eigen::Vector2d size(1, 1);
  for (const View* view : views)
    for (size_t i = 0; i + 1 < view->z.size(); i += 2)
      size =
          size.cwiseMax(Eigen::Vector2d(std::ceil(view->z[i]) + 1, std::ceil(view->z[i + 1]) + 1));
  return size;
}

}  // namespace kincal
