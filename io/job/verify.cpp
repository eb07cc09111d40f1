#include "verify.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "../../models/rig/configuration.h"
#include "../../models/rig/folds.h"
#include "../../models/rig/geometry.h"
#include "../../models/rig/numbers.h"
#include "../../models/rig/targets.h"
#include "../../models/rig/words.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/numbers.h"
#include "../results/comparison.h"
#include "require.h"

namespace kincal {
namespace {

constexpr double kOnePlace = 0.2;    // of the calibration's extent
constexpr double kSamePoint = 1e-3;  // m, between a frame and the point that is measured

/// The views that count, by index of their sample.
struct InstrumentViews {
  int sensor = -1, target = -1;
  std::vector<std::pair<int, const View*>> views;
};

bool measures_positions(const Rig& rig, int sensor) {
  const MeasurementKind kind = rig.sensors[sensor].model->measurement_kind();
  return kind == MeasurementKind::points || kind == MeasurementKind::pose;
}

InstrumentViews measured_views(const Rig& rig, const SampleSet& samples,
                               const VerifySettings& settings) {
  std::map<std::pair<int, int>, InstrumentViews> pairs;
  std::string why;
  for (size_t i = 0; i < samples.samples->size(); ++i)
    for (const View& view : (*samples.samples)[i].views) {
      if (!settings.sensor.empty() && rig.sensors[view.sensor].name != settings.sensor) continue;
      const std::string unfit = why_no_instrument(rig, view.sensor, view.target);
      if (!unfit.empty()) {
        why = unfit;
        continue;
      }
      InstrumentViews& of = pairs[{view.sensor, view.target}];
      of.sensor = view.sensor;
      of.target = view.target;
      of.views.push_back({static_cast<int>(i), &view});
    }
  if (pairs.empty())
    throw InputError(samples.path + ": " +
                     (!why.empty() ? why
                      : settings.sensor.empty()
                          ? "no sample has a view"
                          : "no view is of sensor '" + settings.sensor + "'"));
  if (pairs.size() > 1) {
    std::vector<std::string> names;
    for (const auto& pair : pairs)
      names.push_back(rig.sensors[pair.first.first].name + " on " +
                      rig.targets[pair.first.second].name);
    throw InputError(samples.path + ": one instrument and one target are verified, not " +
                     listed(names) + "; choose with " + option_name("sensor", settings.words) +
                     ", or remove the others");
  }
  return pairs.begin()->second;
}

std::vector<double> of_joints(const Readings& readings, const std::vector<int>& joints) {
  std::vector<double> out;
  for (const int j : joints) out.push_back(std::isnan(readings[j]) ? kInfinity : readings[j]);
  return out;
}

void refuse_seen(const VerifiedResult& result, const TrainingReadings& seen,
                 const SampleSet& samples, const InstrumentViews& measured) {
  const Node node = parse_json(result.result_json, result.files.path);
  const Field all = top(node, result.files.path);
  if (all.has("input") && all["input"].has("samples") &&
      all["input"]["samples"].string() == samples.hash)
    throw InputError(samples.path + ": is the file that " + result.files.path +
                     " was calibrated with: samples that it did not use are expected (held-out "
                     "ones in a separate file)");
  const std::vector<int> joints =
      view_readings(result.files.rig_file.rig, measured.sensor, measured.target);
  std::map<std::vector<double>, size_t> known;
  for (size_t i = 0; i < seen.readings.size(); ++i)
    known.insert({of_joints(seen.readings[i], joints), i});
  std::vector<std::string> ids;
  std::string first;
  for (const auto& [i, view] : measured.views) {
    const Sample& sample = (*samples.samples)[i];
    const auto found = known.find(of_joints(sample.readings, joints));
    if (found == known.end()) continue;
    if (first.empty()) first = seen.ids[found->second];
    ids.push_back(sample.id);
  }
  if (!ids.empty())
    throw InputError(samples.path + ": " + listed(ids) + " (" + std::to_string(ids.size()) +
                     " of " + std::to_string(measured.views.size()) +
                     " views) have the same readings as samples that " + result.files.path +
                     " was calibrated with (" + kincal::quoted(first) +
                     "): samples that it has not seen are expected");
}

/// Which posture each view is of: views whose readings are equal within their sigmas are of one.
std::vector<int> group_postures(const Rig& rig, const SampleSet& samples,
                                const InstrumentViews& measured) {
  const std::vector<int> joints = view_readings(rig, measured.sensor, measured.target);
  std::vector<const Sample*> first;
  std::vector<int> out;
  for (const auto& [i, view] : measured.views) {
    const Sample& sample = (*samples.samples)[i];
    size_t k = 0;
    while (k < first.size() && !is_same_posture(rig, *first[k], sample, joints)) ++k;
    if (k == first.size()) first.push_back(&sample);
    out.push_back(static_cast<int>(k));
  }
  return out;
}

/// The nominal robot with the calibrated instrument and target.
VectorXd nominal_values(const VerifiedResult& result) {
  const CalibratedFiles& files = result.files;
  VectorXd out = files.values;
  const ParameterTable& table = files.table;
  std::set<int> mounts(table.sensor_mount.begin(), table.sensor_mount.end());
  mounts.insert(table.target_mount.begin(), table.target_mount.end());
  const Node node = parse_json(result.result_json, files.path);
  const Field parameters = top(node, files.path)["parameters"];
  for (const auto& [name, ignored] : parameters.members()) {
    const int p = find_parameter(table, name);
    if (p < 0 || mounts.count(p)) continue;
    const Parameter& parameter = table.all[p];
    switch (parameter.kind) {
      case ParameterKind::joint_offset:
      case ParameterKind::joint_scale:
      case ParameterKind::joint_shape:
      case ParameterKind::backlash:
      case ParameterKind::temperature:
      case ParameterKind::ripple:
      case ParameterKind::coupling:
      case ParameterKind::compliance:
      case ParameterKind::load: {
        const std::vector<double> initial = parameters[name]["initial"].vector(parameter.size());
        for (int c = 0; c < parameter.size(); ++c) out(parameter.start + c) = initial[c];
        break;
      }
      case ParameterKind::joint_origin: {
        const std::vector<double> xi = parameters[name]["value"].vector(6);
        set_pose(out, parameter.start,
                 get_pose(out, parameter.start) *
                     inverse(exp_se3(Eigen::Map<const Vector6d>(xi.data()))));
        break;
      }
      default:
        break;
    }
  }
  return out;
}

/// What is stated of an instrument's noise. A calibration may have found other sigmas from the
/// errors of the robot itself, which are no statement about the instrument.
struct InstrumentNoise {
  std::vector<double> found;  // the sensor's sigmas in the result
  bool known = true;          // the rig stated them
  double factor[2] = {1, 1};  // stated over found: of positions, of rotations
};
InstrumentNoise instrument_noise(const VerifiedResult& result, const Sensor& sensor) {
  InstrumentNoise out;
  out.found = sensor.sigma;
  const Node node = parse_json(result.result_json, result.files.path);
  const Field all = top(node, result.files.path);
  if (!all.has("noise_levels")) return out;
  const Field levels = all["noise_levels"];
  for (size_t i = 0; i < levels.size(); ++i) {
    const Field level = levels.item(i);
    if (level["of"].string() != "sensor/" + sensor.name || !level.has("stated")) continue;
    out.known = out.known && level["stated"].boolean();
    if (level.has("used") && level["used"].node->kind == Node::Kind::scalar)
      out.factor[level["part"].string() == "rotation"] =
          level["assumed"].positive() / level["used"].positive();
  }
  return out;
}

/// What is measured of a target: a point of it, in its own frame.
struct MeasuredPoint {
  bool pose = false;        // the instrument measures poses, so any point of the body
  Vector3d point{0, 0, 0};  // then
  InstrumentNoise noise;
};

/// The tolerance, and whether it is on the largest error: "frame/NAME<0.3mm", "max frame/NAME<...".
Requirement parse_tolerance(const Rig& rig, const VerifySettings& settings, bool& largest) {
  const std::string max = "max ", frame = "frame/";
  largest = settings.tolerance.rfind(max, 0) == 0;
  std::string quantity = settings.tolerance.substr(largest ? max.size() : 0);
  quantity.erase(0, quantity.find_first_not_of(' '));
  if (quantity.rfind(frame, 0) != 0)
    throw InputError(option_name("tolerance", settings.words) + " '" + settings.tolerance +
                     "': an error of a frame is judged: its rms, 'frame/NAME<0.3mm' or "
                     "'frame/NAME<0.05deg', or its largest, 'max frame/NAME<0.8mm'");
  Requirement out =
      parse_requirement(quantity, *make_recording(rig, {}), settings.words, "tolerance")[0];
  out.text = settings.tolerance;
  return out;
}

/// Checks that the frame of a tolerance is on the target's body and measured.
MeasuredPoint measured_point(const CalibratedFiles& files, const InstrumentViews& measured,
                             const Requirement* tolerance, const VerifySettings& settings) {
  const Rig& rig = files.rig_file.rig;
  MeasuredPoint out;
  out.pose = rig.sensors[measured.sensor].model->measures_pose();
  if (!tolerance) return out;
  const std::string where =
      option_name("tolerance", settings.words) + " '" + settings.tolerance + "'";
  if (tolerance->rotation && settings.standard == "distances")
    throw InputError(where +
                     ": distances have no rotations; rotations relative to the instrument are "
                     "judged with " +
                     option_name("standard", settings.words) + " iso9283");
  if (tolerance->rotation && !out.pose)
    throw InputError(where + ": sensor '" + rig.sensors[measured.sensor].name +
                     "' measures points, no rotations: a length is expected, as in 0.3mm");
  const Target& target = rig.targets[measured.target];
  const Frame frame = frame_named(rig, files.table, tolerance->name, where);
  if (body_of(rig.tree, frame.link) != body_of(rig.tree, target.link))
    throw InputError(where + ": '" + tolerance->name +
                     "' is not on the body that carries target '" + target.name +
                     "', which was measured");
  const std::vector<double> readings = completed(Readings(rig.tree.joints.size(), kNan));
  const Configuration at(rig, files.table, files.values, readings);
  Pose link_T_frame = at.a_T_b(target.link, frame.link);
  if (frame.pose >= 0)
    link_T_frame = link_T_frame * get_pose(files.values, files.table.all[frame.pose].start);
  const Pose link_T_target =
      get_pose(files.values, files.table.all[files.table.target_pose[measured.target]].start);
  out.point = (inverse(link_T_target) * link_T_frame).translation;
  const Vector3d centre =
      target_points(rig, files.table, files.values, measured.target).rowwise().mean();
  if (!out.pose && tolerance->name != "target/" + target.name &&
      (out.point - centre).norm() > kSamePoint)
    throw InputError(where + ": sensor '" + rig.sensors[measured.sensor].name +
                     "' measures points, so where '" + tolerance->name + "' is, " +
                     length_text((out.point - centre).norm()) +
                     " from them, is not measured: write frame/target/" + target.name);
  return out;
}

/// A robot that predicts: values of all parameters.
struct PredictingRobot {
  const Rig& rig;
  const ParameterTable& table;
  const VectorXd& values;
};

/// Where the target is, as measured and as predicted.
VerifiedView verified_view(const PredictingRobot& robot, const Sample& sample, const View& view,
                           const MeasuredPoint& what, const std::string& place) {
  const Rig& rig = robot.rig;
  const Configuration at(rig, robot.table, robot.values, sample.readings, sample.conditions,
                         time_of(rig, view));
  const Pose sensor_T_target =
      inverse(at.base_T_sensor(view.sensor)) * at.base_T_target(view.target);
  VerifiedView out;
  if (what.pose) {
    const Pose z{
        rotation_from_quaternion(Eigen::Vector4d(view.z[3], view.z[4], view.z[5], view.z[6])),
        Vector3d(view.z[0], view.z[1], view.z[2])};
    out.turned = true;
    out.measured = z * what.point;
    out.predicted = sensor_T_target * what.point;
    out.measured_rotation = z.rotation;
    out.predicted_rotation = sensor_T_target.rotation;
    out.rotation_noise = Eigen::Map<const Vector3d>(view.sigma.data() + 3).cwiseAbs2().asDiagonal();
    const Eigen::Map<const Vector6d> sigma(view.sigma.data());
    const Matrix3d lever = skew(what.point);
    Matrix3d own = lever * sigma.tail<3>().cwiseAbs2().asDiagonal() * lever.transpose();
    own.diagonal() += sigma.head<3>().cwiseAbs2();
    out.noise = z.rotation * own * z.rotation.transpose();
    return out;
  }
  const Matrix3Xd points = target_points(rig, robot.table, robot.values, view.target);
  const int count = static_cast<int>(view.ids.size()),
            block = robot.table.sensor_block[view.sensor];
  ViewInput input;
  input.sensor_T_target = sensor_T_target;
  input.parameters = block < 0 ? nullptr : robot.values.data() + robot.table.all[block].start;
  input.points = &points;
  input.ids = view.ids.data();
  input.count = count;
  input.z = view.z.data();
  std::vector<double> residuals(3 * static_cast<size_t>(count));
  if (!rig.sensors[view.sensor].model->evaluate(input, Columns(), residuals.data(), nullptr))
    throw InputError(place + ": no position can be predicted");
  for (int i = 0; i < count; ++i) {
    const Vector3d z(view.z[3 * i], view.z[3 * i + 1], view.z[3 * i + 2]);
    out.measured += z / count;
    out.predicted += (z + Eigen::Map<const Vector3d>(&residuals[3 * i])) / count;
    const Matrix3d own =
        view.covariance.empty()
            ? Matrix3d(Eigen::Map<const Vector3d>(view.sigma.data()).cwiseAbs2().asDiagonal())
            : view.covariance[i];
    out.noise += own / (1.0 * count * count);
  }
  return out;
}

/// The diagonal of the box around positions.
double box(const std::vector<VerifiedView>& views) {
  Matrix3Xd points(3, static_cast<Eigen::Index>(views.size()));
  for (size_t i = 0; i < views.size(); ++i)
    points.col(static_cast<Eigen::Index>(i)) = views[i].predicted;
  return views.empty() ? 0 : extent(points);
}

/// Refuses too few postures, and postures in one place.
void refuse_narrow(const VerifiedResult& result, const TrainingReadings& seen,
                   const SampleSet& samples, const InstrumentViews& measured,
                   const std::vector<VerifiedView>& postures) {
  if (static_cast<int>(postures.size()) < kFewestPostures)
    throw InputError(samples.path + ": " + std::to_string(postures.size()) +
                     " different postures are too few: at least " +
                     std::to_string(kFewestPostures) + " are expected, better 50");
  const CalibratedFiles& files = result.files;
  const std::vector<int> needed = needed_readings(files.rig_file.rig, -1, measured.target);
  std::vector<VerifiedView> calibrated;
  for (const Readings& readings : seen.readings) {
    if (std::any_of(needed.begin(), needed.end(), [&](int j) { return std::isnan(readings[j]); }))
      continue;
    VerifiedView view;
    view.predicted = Configuration(files.rig_file.rig, files.table, files.values, readings)
                         .base_T_target(measured.target)
                         .translation;
    calibrated.push_back(view);
  }
  const double here = box(postures), there = box(calibrated);
  if (here < std::max(kSamePoint, kOnePlace * there))
    throw InputError(samples.path + ": all postures are in one place, within " + length_text(here) +
                     " (the calibration's: " + length_text(there) +
                     "): postures all over the workspace are expected");
}

/// The sigma of predicted positions by that of the instrument's pose, rms over postures, m; NaN:
/// not known.
double base_sigma(const CalibratedFiles& files, int sensor,
                  const std::vector<VerifiedView>& postures) {
  const int pose = files.table.sensor_pose[sensor];
  if (!files.unknowns || files.table.all[pose].replaced_by >= 0) return kNan;
  const Unknowns& unknowns = *files.unknowns;
  std::vector<int> columns;
  MatrixXd chart = MatrixXd::Zero(6, 0);
  for (size_t c = 0; c < unknowns.columns.size(); ++c) {
    if (unknowns.columns[c].parameter != pose) continue;
    columns.push_back(static_cast<int>(c));
    chart.conservativeResize(6, chart.cols() + 1);
    const auto found = unknowns.charts.find(pose);
    const int k = unknowns.columns[c].index;
    if (found == unknowns.charts.end())
      chart.rightCols<1>() = Vector6d::Unit(k);
    else
      chart.rightCols<1>() = found->second.col(k);
  }
  const auto n = static_cast<Eigen::Index>(columns.size());
  MatrixXd covariance(n, n);
  for (Eigen::Index a = 0; a < n; ++a)
    for (Eigen::Index b = 0; b < n; ++b)
      covariance(a, b) = unknowns.covariance(columns[a], columns[b]);
  double sum = 0;
  for (const VerifiedView& view : postures) {
    MatrixXd motion(3, 6);
    motion << Matrix3d::Identity(), -skew(view.predicted);
    sum += (motion * chart * covariance * chart.transpose() * motion.transpose()).trace();
  }
  return std::sqrt(sum / static_cast<double>(postures.size()));
}

VerifiedFigures figures(const std::vector<VerifiedView>& postures, bool refitted) {
  return {position_accuracy(postures, refitted ? 6 : 0), distance_accuracy(postures),
          rotation_accuracy(postures)};
}

/// The way that a sample's id names behind the last '@'; "" where there is none.
std::string approach_of(const std::string& id) {
  const size_t at = id.rfind('@');
  return at == std::string::npos ? "" : id.substr(at + 1);
}

/// The view with sigmas as they are stated; one that has its own keeps them.
View stated_view(View view, const InstrumentNoise& noise, bool& known) {
  if (!view.covariance.empty() || view.sigma != noise.found) return view;
  known = noise.known;
  std::vector<double> sigma = noise.found;
  for (size_t k = 0; k < sigma.size() && noise.known; ++k) sigma[k] *= noise.factor[k >= 3];
  view.sigma = sigma;
  return view;
}

/// All views, by a robot.
std::vector<VerifiedView> all_views(const PredictingRobot& robot, const SampleSet& samples,
                                    const InstrumentViews& measured, const MeasuredPoint& what) {
  const std::vector<int> postures = group_postures(robot.rig, samples, measured);
  std::map<std::string, int> ways;
  std::vector<VerifiedView> out;
  for (size_t k = 0; k < measured.views.size(); ++k) {
    const auto& [i, view] = measured.views[k];
    const Sample& sample = (*samples.samples)[i];
    bool known = true;
    const View stated = stated_view(*view, what.noise, known);
    out.push_back(verified_view(robot, sample, stated, what, samples.path + ": " + sample.id));
    out.back().noise_known = known;
    out.back().posture = postures[k];
    const std::string way = approach_of(sample.id);
    if (!way.empty())
      out.back().approach = ways.insert({way, static_cast<int>(ways.size())}).first->second;
  }
  return out;
}

void scale_noise(std::vector<VerifiedView>& views, double factor) {
  for (VerifiedView& view : views) view.noise *= factor;
}

void add_errors(const std::vector<VerifiedView>& postures, std::vector<double>& to) {
  for (const VerifiedView& view : postures) to.push_back((view.measured - view.predicted).norm());
}

}  // namespace

std::string why_no_instrument(const Rig& rig, int sensor, int target) {
  const std::string name = "sensor '" + rig.sensors[sensor].name + "'";
  if (!measures_positions(rig, sensor))
    return name + " is a " + rig.sensors[sensor].type +
           ": an instrument that measures points or poses is expected";
  if (rig.targets[target].link < 0)
    return "target '" + rig.targets[target].name +
           "' is not mounted; a target that the robot carries is expected";
  if (!needed_readings(rig, sensor, -1).empty())
    return name + " moves with the robot; a stationary instrument is expected";
  if (needed_readings(rig, -1, target).empty())
    return "target '" + rig.targets[target].name +
           "' stands still; a target that the robot carries is expected";
  return "";
}

VerifiedResult read_verified_result(const std::string& path) {
  namespace fs = std::filesystem;
  CalibratedFiles files = read_calibrated(path);
  std::error_code ignored;
  const fs::path folder =
      fs::is_directory(path, ignored) ? fs::path(path) : fs::path(path).parent_path();
  if (files.status.empty())
    throw InputError(path + ": the result directory of a calibration is expected");
  VerifiedResult out{std::move(files), read_file((folder / "result.json").string()), ""};
  const std::string samples = (folder / "samples.csv").string();
  if (file_exists(samples)) out.samples_csv = read_file(samples);
  return out;
}

Verification verify(const VerifiedResult& result, const SampleSet& samples,
                    const VerifySettings& settings) {
  const CalibratedFiles& files = result.files;
  const Rig& rig = files.rig_file.rig;
  if (settings.standard != "distances" && settings.standard != "iso9283")
    throw InputError(option_name("standard", settings.words) +
                     ": 'distances' or 'iso9283' is expected, not '" + settings.standard + "'");
  Verification out;
  if (!settings.tolerance.empty()) out.tolerance = parse_tolerance(rig, settings, out.largest);
  const InstrumentViews measured = measured_views(rig, samples, settings);
  const TrainingReadings seen = training_readings(result.samples_csv, files.path, rig.tree);
  refuse_seen(result, seen, samples, measured);
  MeasuredPoint what =
      measured_point(files, measured, out.tolerance ? &*out.tolerance : nullptr, settings);
  what.noise = instrument_noise(result, rig.sensors[measured.sensor]);
  out.robot = files.rig_file.urdf.robot;
  out.sensor = rig.sensors[measured.sensor].name;
  out.target = rig.targets[measured.target].name;
  out.frame = out.tolerance ? out.tolerance->name : "target/" + out.target;
  out.distances = settings.standard == "distances";
  out.refitted = settings.refit_base;
  out.views = static_cast<int>(measured.views.size());

  std::vector<VerifiedView> views =
      all_views({rig, files.table, files.values}, samples, measured, what);
  std::vector<VerifiedView> postures = barycentres(views);
  refuse_narrow(result, seen, samples, measured, postures);
  if (settings.refit_base) {
    const Pose motion = refit_base(postures);
    for (VerifiedView& view : views) {
      view.predicted = motion * view.predicted;
      view.predicted_rotation = motion.rotation * view.predicted_rotation;
    }
  }
  double trace = 0;
  for (const VerifiedView& view : views) trace += view.noise.trace() / out.views;
  out.sensor_sigma = std::sqrt(trace);
  out.scatter = scatter(views);
  double factor = 1;
  if (out.scatter.less) {
    factor = std::pow(out.scatter.sigma / out.scatter.stated, 2);
    out.notes.push_back(
        text("views of one posture scatter by %.3g mm, less than the instrument's stated %.3g mm: "
             "the smaller figure is taken",
             1e3 * out.scatter.sigma, 1e3 * out.scatter.stated));
  }
  scale_noise(views, factor);
  scale_noise(postures, factor);
  out.base_sigma = settings.refit_base ? kNan : base_sigma(files, measured.sensor, postures);
  out.after = figures(postures, settings.refit_base);
  out.repeated = repeated_postures(views);
  add_errors(postures, out.errors);
  const VectorXd nominal = nominal_values(result);
  std::vector<VerifiedView> before =
      barycentres(all_views({rig, files.table, nominal}, samples, measured, what));
  scale_noise(before, factor);
  refit_base(before);
  out.before = figures(before, true);
  add_errors(before, out.nominal);
  const std::vector<int> group = group_postures(rig, samples, measured);
  for (size_t k = 0; k < group.size(); ++k)
    if (group[k] == static_cast<int>(out.postures.size()))
      out.postures.push_back((*samples.samples)[measured.views[k].first].id);
  if (out.tolerance) {
    out.answer = conformity(out.judged(), out.tolerance->limit, out.largest);
    out.needed = out.largest ? -1 : postures_needed(out.judged(), out.tolerance->limit);
  }
  const AccuracyFigure& judged = out.judged();
  if (!judged.noise_known)
    out.notes.push_back(
        "the rig does not state the instrument's noise, and the noise found by the calibration "
        "contains errors of the robot: no noise is subtracted; state it as sigma in the samples' "
        "views");
  else if (judged.seen < judged.instrument)
    out.notes.push_back(
        "errors are smaller than the instrument's stated noise alone, which is therefore stated "
        "too large: upper limits are those of the errors as they are seen");
  for (const std::string& doubt : files.doubts)
    out.notes.push_back("of the calibration: " + doubt.substr(0, doubt.find(". What to do: ")));
  return out;
}

}  // namespace kincal
