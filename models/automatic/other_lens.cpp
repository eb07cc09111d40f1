#include "other_lens.h"

#include <algorithm>
#include <cmath>

#include "../../solver/decompositions.h"
#include "../rig/scales.h"

namespace kincal {
namespace {

// Log odds beforehand that a rig names the wrong one of both lenses. Of 40 right ones none was
// named.
const double kOtherLens = std::log(0.1);
constexpr int kLensRounds = 20;  // of widths
constexpr int kLensSteps = 2;    // of the quadratic model

constexpr int kAngles = 100;           // at which lenses are compared
constexpr double kLargestAngle = 1.5;  // rad; pinholes see no further
const double kTangent[] = {1 / 3.0, 2 / 15.0, 17 / 315.0, 62 / 2835.0};  // after x, of tan x

int distortion_of(const Recording& recording, int sensor) {
  return recording.table.index_of(ParameterKind::distortion, sensor);
}

/// The radius of a lens with these coefficients (as in its block; tangential ones do nothing), of
/// focal length 1, at an angle.
double radius(Lens lens, const double* k, int count, double angle) {
  if (lens == Lens::kannala_brandt) {
    const double t = angle * angle;
    return angle * (1 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))));
  }
  const double r = std::tan(angle), s = r * r;
  const double above = 1 + s * (k[0] + s * (k[1] + s * k[4]));
  return r * above / (count < 8 ? 1 : 1 + s * (k[5] + s * (k[6] + s * k[7])));
}

/// The largest radius of what a camera saw in training samples, of focal length 1.
double largest_radius(const Recording& recording, int sensor, const double* intrinsics) {
  double out = 0;
  for (const int i : recording.training())
    for (const View& v : recording.samples[i].views)
      for (size_t k = 0; v.sensor == sensor && k + 1 < v.z.size(); k += 2)
        out = std::max(out, std::hypot((v.z[k] - intrinsics[2]) / intrinsics[0],
                                       (v.z[k + 1] - intrinsics[3]) / intrinsics[1]));
  return out;
}

/// The coefficients of a lens that come nearest to another one up to a radius.
std::vector<double> nearest(Lens lens, Lens from, const std::vector<double>& k, double reach) {
  const bool fisheye = lens == Lens::kannala_brandt;
  const int count = static_cast<int>(k.size());
  double most = kLargestAngle / kAngles;
  const auto at = [&](double angle) { return radius(from, k.data(), count, angle); };
  while (most < kLargestAngle && at(most) < reach && at(most + kLargestAngle / kAngles) > at(most))
    most += kLargestAngle / kAngles;
  const int n = fisheye ? 4 : 3;
  const double unit = fisheye ? most : std::tan(most);
  MatrixXd basis(kAngles, n);
  VectorXd left(kAngles);
  for (int i = 0; i < kAngles; ++i) {
    const double angle = most * (i + 1) / kAngles, x = fisheye ? angle : std::tan(angle);
    left(i) = at(angle) - x;
    for (int j = 0; j < n; ++j) basis(i, j) = x * std::pow(x / unit, 2 * (j + 1));
  }
  VectorXd found = least_squares(basis, left);
  for (int j = 0; j < n; ++j) found(j) /= std::pow(unit, 2 * (j + 1));
  if (fisheye) return {found(0), found(1), found(2), found(3)};
  return {found(0), found(1), 0, 0, found(2)};
}

/// The values of a recording in another that differs in one parameter, which is not set.
VectorXd values_but_for(int changed, const ParameterTable& from, const VectorXd& shared,
                        const ParameterTable& to) {
  VectorXd out = to.initial;
  for (size_t p = 0; p < from.all.size(); ++p) {
    const int size = from.all[p].pose ? 12 : from.all[p].size();
    if (static_cast<int>(p) != changed)
      out.segment(to.all[p].start, size) = shared.segment(from.all[p].start, size);
  }
  return out;
}

/// The fit with the other lens of a camera.
FitWithGroups with_other_lens(const FitWithGroups& fit, int sensor) {
  const int distortion = distortion_of(*fit.recording, sensor);
  FitWithGroups out = fit;
  out.recording = with_other_lens(*fit.recording, sensor, out.values.shared);
  const ParameterTable &from = fit.recording->table, &to = out.recording->table;
  if (out.setup.initial.size() > 0)
    out.setup.initial = values_but_for(distortion, from, fit.setup.initial, to);
  const auto is_lens = [&](const Member& m) { return m.component.parameter == distortion; };
  std::vector<Freed>& free = out.setup.free;
  free.erase(std::remove_if(free.begin(), free.end(),
                            [&](const Freed& f) { return f.parameter == distortion; }),
             free.end());
  for (WidthGroup& group : out.groups.groups) {
    std::vector<Member>& members = group.members;
    const auto lens = std::find_if(members.begin(), members.end(), is_lens);
    if (lens == members.end()) continue;
    members.erase(std::remove_if(lens, members.end(), is_lens), members.end());
    for (int c = 0; c < to.all[distortion].size(); ++c)
      members.push_back({{distortion, c}, scales(to, {distortion, c}, to.initial).width});
  }
  return out;
}

/// Whether all components of a parameter are in groups.
bool is_open(const AutomaticGroups& groups, int parameter, int size) {
  for (const WidthGroup& group : groups.groups)
    size -= static_cast<int>(
        std::count_if(group.members.begin(), group.members.end(),
                      [&](const Member& m) { return m.component.parameter == parameter; }));
  return size == 0;
}

/// A lens of a camera at its best values.
struct WeighedLens {
  std::vector<Component> columns;
  VectorXd moved;              // by column: from the fit
  double log_evidence = kNan;  // with the hyperprior of the factors
};

/// Moves a camera's lens in a fit, and all else with it, to its best values, and weighs it there.
WeighedLens weigh_lens(const FitWithGroups& fit) {
  DataProblem data = data_problem(*fit.recording, fit.setup, fit.values, fit.groups);
  Eigen::Index own = 0;
  for (const GroupShape& shape : data.problem->groups()) own += shape.private_size;
  const VectorXd start = data.state, still = VectorXd::Zero(own);
  VectorXd factor = fit.factor;
  WeighedLens out;
  for (int step = 0;; ++step) {
    FitWidths at = width_problem(*fit.recording, data, fit.groups);
    const Widths best = learn_widths(at.problem, factor, kLensRounds);
    if (!best.defined) return out;
    factor = best.factor;
    VectorXd move = best.posterior.value, weight = VectorXd::Zero(move.size());
    for (Eigen::Index i = 0; i < move.size(); ++i) {
      if (at.problem.start(i) == 0) continue;
      const int group = at.problem.group[i];
      const double width = at.problem.start(i) * (group < 0 ? 1 : factor(group));
      weight(i) = 1 / (width * width);
      move(i) -= at.problem.at(i);
    }
    if (step < kLensSteps) {
      data.problem->retract(VectorXd(data.state), move, still, data.state);
      data.problem->renew(data.state);
      data.problem->prepare(data.state);
      continue;
    }
    at.problem.gradient = -weight.cwiseProduct(at.problem.at);  // (counted here, where it has come)
    out.log_evidence = log_evidence(at.problem, factor) - at.cost / 2 -
                       factor.array().log().square().sum() / (2 * kWidthSpread * kWidthSpread);
    out.moved.resize(move.size());
    for (size_t i = 0; i < at.columns.size(); ++i)
      out.moved(static_cast<Eigen::Index>(i)) =
          value_of(fit.recording->table, start, data.state, at.columns[i]);
    out.columns = std::move(at.columns);
    return out;
  }
}

}  // namespace

std::optional<Lens> other_lens(const Sensor& sensor) {
  if (sensor.type != "camera" || !find_block(sensor, ParameterKind::distortion)) return {};
  switch (lens_type(sensor.parameters).lens) {
    case Lens::brown_conrady:
      return Lens::kannala_brandt;
    case Lens::kannala_brandt:
      return Lens::brown_conrady;
    default:
      return {};
  }
}

std::shared_ptr<const Recording> with_other_lens(const Recording& recording, int sensor,
                                                 VectorXd& shared) {
  const ParameterTable& table = recording.table;
  Rig rig = recording.rig;
  Sensor& camera = rig.sensors[sensor];
  const Lens own = lens_type(camera.parameters).lens, lens = *other_lens(camera);
  const int distortion = distortion_of(recording, sensor);
  const double* const values = shared.data() + table.all[distortion].start;
  const double* const intrinsics =
      shared.data() + table.all[table.index_of(ParameterKind::intrinsics, sensor)].start;
  const std::vector<double> found =
      nearest(lens, own, {values, values + table.all[distortion].size()},
              largest_radius(recording, sensor, intrinsics));
  const std::vector<double> none =
      lens == Lens::kannala_brandt ? std::vector<double>(std::begin(kTangent), std::end(kTangent))
                                   : std::vector<double>(5, 0.0);
  const ParameterBlock* baseline = find_block(camera, ParameterKind::baseline);
  const std::vector<ParameterBlock> blocks =
      camera_parameters(lens, find_block(camera, ParameterKind::intrinsics)->values, none,
                        baseline ? baseline->values[0] : 0.0);
  camera.model = make_camera(lens, static_cast<int>(none.size()));
  camera.parameters = blocks;
  const std::shared_ptr<const Recording> out = make_recording(recording.with_rig(std::move(rig)));
  shared = values_but_for(distortion, table, shared, out->table);
  std::copy(found.begin(), found.end(), shared.data() + out->table.all[distortion].start);
  return out;
}

std::vector<OtherLens> other_lenses(const FitWithGroups& fit,
                                    const std::vector<Component>& estimated) {
  std::vector<OtherLens> out;
  for (size_t s = 0; s < fit.recording->rig.sensors.size(); ++s) {
    const int sensor = static_cast<int>(s), distortion = distortion_of(*fit.recording, sensor);
    if (!other_lens(fit.recording->rig.sensors[s]) ||
        !is_open(fit.groups, distortion, fit.recording->table.all[distortion].size()) ||
        std::none_of(estimated.begin(), estimated.end(),
                     [&](const Component& c) { return c.parameter == distortion; }))
      continue;
    const WeighedLens own = weigh_lens(fit), other = weigh_lens(with_other_lens(fit, sensor));
    OtherLens one;
    one.model.kind = NoticeKind::intrinsics;
    one.model.where = {Subject::sensor(fit.recording->rig.sensors[s].name)};
    one.model.log_odds = kOtherLens + other.log_evidence - own.log_evidence;
    if (!std::isfinite(one.model.log_odds)) continue;
    std::vector<double> moved;
    for (size_t i = 0; i < own.columns.size(); ++i) {
      const Component& c = own.columns[i];
      const auto found = std::find(other.columns.begin(), other.columns.end(), c);
      if (c.parameter == distortion || found == other.columns.end()) continue;
      one.columns.push_back(c);
      moved.push_back(other.moved(found - other.columns.begin()) -
                      own.moved(static_cast<Eigen::Index>(i)));
    }
    one.moved = Eigen::Map<const VectorXd>(moved.data(), static_cast<Eigen::Index>(moved.size()));
    out.push_back(std::move(one));
  }
  return out;
}

}  // namespace kincal
