#include "plan.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include "../../models/analysis/linearisation.h"
#include "../../models/automatic/automatic.h"
#include "../../models/calibration/plan.h"
#include "../../models/joints/curve_joint.h"
#include "../../models/rig/random_stream.h"
#include "../../models/rig/words.h"
#include "../results/comparison.h"
#include "../results/input_files.h"
#include "../rig/samples_file.h"
#include "../rig/simulation_file.h"
#include "../urdf/boxes.h"
#include "require.h"

namespace kincal {
namespace {

constexpr int kGoalPostures = 300, kDraws = 4, kRandomDesigns = 10;

/// What is known before: the robot, the unknowns of its calibration, and their information.
struct Before {
  std::shared_ptr<const Recording> recording;  // of the samples there are; else without any
  std::vector<Readings> stood;                 // where samples were recorded
  CalibratedRobot robot;
  EstimationSetup setup;
  MatrixXd known;
};

/// Of a rig alone: its values count, and what its steps (without: the automatic path) would free
/// with samples such as these.
Before before_samples(const RigFile& rig_file, std::vector<Sample> samples,
                      const PlanSettings& settings) {
  Before out;
  out.recording = std::make_shared<Recording>(rig_file.rig, std::move(samples));
  if (rig_file.rig.steps.empty()) {
    Rig rig = rig_file.rig;
    rig.steps = automatic_steps(*out.recording, {});
    out.recording = std::make_shared<Recording>(out.recording->with_rig(std::move(rig)));
  }
  try {
    const StepPlan last = resolve_steps(*out.recording, {}).back();
    out.setup.sensors = last.sensors;
    out.setup.free = last.free;
    out.setup.priors = last.priors;
  } catch (const NameError& error) {
    throw with_nearest(error, settings.words);
  }
  Unknowns unknowns;
  unknowns.columns = components_of(out.setup.free);
  out.robot = {&out.recording->rig, &out.recording->table, out.recording->table.initial,
               std::move(unknowns)};
  out.known = known_before(out.robot, out.setup);
  return out;
}

/// After a calibration whose estimates and covariance are known. What it did not determine has its
/// usual errors; what it knew exactly takes no part.
Before after_calibration(const KnownRobot& result) {
  const CalibratedRobot& calibrated = result.robot;
  Before out;
  out.stood = result.stood;
  out.recording = std::make_shared<Recording>(*calibrated.rig, std::vector<Sample>());
  out.setup.sensors.resize(calibrated.rig->sensors.size());
  std::iota(out.setup.sensors.begin(), out.setup.sensors.end(), 0);
  const Unknowns& unknowns = *calibrated.unknowns;
  for (size_t i = 0; i < unknowns.columns.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    if (unknowns.covariance(row, row) > 0 || !unknowns.undetermined.row(row).isZero(0))
      merge(out.setup.free, {{unknowns.columns[i].parameter, {unknowns.columns[i].index}}});
  }
  Unknowns own;
  own.columns = components_of(out.setup.free);
  own.charts = unknowns.charts;
  out.robot = {&out.recording->rig, &out.recording->table, calibrated.values, std::move(own)};
  out.known = known_after(out.robot, out.setup, unknowns);
  return out;
}

/// After a calibration of the samples.
Before after_samples(const RigFile& rig_file, const SampleSet& samples,
                     const PlanSettings& settings, const Progress& progress) {
  CalibrateSettings calibrate;
  calibrate.words = settings.words;
  calibrate.no_report = true;
  Job job = make_job(rig_file, samples, calibrate);
  const Report report = run(job, calibrate, false, progress.in("calibrating"));
  const Solution& solution = report.solution;
  if (!solution.usable())
    throw InputError(samples.path + ": no plan can be made from a failed calibration: " +
                     (solution.message.empty() ? "see `kincal calibrate`" : solution.message));
  KnownRobot known{{&solution.rig(), &solution.table(), solution.values.shared,
                    last_unknowns(linearise(solution))},
                   {}};
  for (const Sample& sample : solution.samples()) known.stood.push_back(sample.readings);
  return after_calibration(known);
}

void refuse_open_poses(const RigFile& rig_file, const ParameterTable& table) {
  const std::vector<int> open = open_poses(rig_file.rig, table);
  if (open.empty()) return;
  std::vector<std::string> names;
  for (const int p : open) names.push_back(table.all[p].name);
  throw InputError(rig_file.path + ": the rig has no value of " + listed(names, names.size()) +
                   ", so that no view can be predicted: give each in the rig (`pose` of the "
                   "sensor, or in the `mount` of the target), or record some samples first and "
                   "plan with these, which determine them");
}

/// Candidates: postures with the views that they certainly have.
struct CandidatePostures {
  std::vector<Posture> postures;
  Simulation simulation;  // sample i is that of posture i
};

Simulation simulated(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                     std::vector<Posture> postures, std::uint64_t seed) {
  SimulationOptions options;
  options.seed = seed;
  options.samples = static_cast<int>(postures.size());
  options.postures = std::move(postures);
  return simulate(rig, table, values, options);
}

/// Gives every posture the views that it has on robots as they may be, too; leaves out those with
/// none, and those with a single view of what only several sensors together can place.
void keep_certain_views(const Before& before, const PlanSettings& settings, PosturePlan& plan,
                        CandidatePostures& of) {
  const Rig& rig = *before.robot.rig;
  const ParameterTable& table = *before.robot.table;
  const Eigen::LDLT<MatrixXd> known(before.known);
  const auto n = before.known.rows();
  RandomStream draws(settings.seed);
  std::map<std::string, std::set<std::pair<int, int>>> lost;
  for (int k = 0; k < kDraws; ++k) {
    // With H = P' L D L' P a draw of N(0, H^-1) is P' L'^-1 D^-1/2 z.
    VectorXd z(n);
    for (double& x : z) x = draws.normal();
    z = z.cwiseQuotient(known.vectorD().cwiseSqrt());
    known.matrixU().solveInPlace(z);
    const VectorXd values =
        changed_values(table, before.robot.values, before.robot.unknowns->columns,
                       known.transpositionsP().transpose() * z);
    for (const DroppedView& d : simulated(rig, table, values, of.postures, settings.seed).dropped)
      lost[d.sample].insert({d.sensor, d.target});
  }
  std::vector<Posture> kept;
  for (Posture& posture : of.postures) {
    const auto& of_this = lost[posture.id];
    const auto gone = [&](const std::pair<int, int>& view) { return of_this.count(view) > 0; };
    posture.views.erase(std::remove_if(posture.views.begin(), posture.views.end(), gone),
                        posture.views.end());
    if (!posture.views.empty()) kept.push_back(std::move(posture));
  }
  const auto gone = static_cast<int>(of.postures.size() - kept.size());
  if (gone > 0)
    plan.left_out.push_back({"no target is certain to be seen with the present uncertainty", gone});
  of.postures = std::move(kept);
}

/// Leaves out postures in which links come near each other.
void keep_clear(const RigFile& rig_file, const Before& before, const PlanSettings& settings,
                PosturePlan& plan, std::vector<Posture>& postures) {
  const Rig& rig = *before.robot.rig;
  const Clearance clearance =
      robot_clearance(rig_file, before.robot, before.stood, settings.clearance, plan.notes);
  if (clearance.empty()) return;
  std::vector<Readings> all;  // configurations refer to their readings
  for (const Posture& posture : postures) all.push_back(completed(posture.readings));
  std::map<std::string, int> count;
  std::vector<Posture> kept;
  for (size_t i = 0; i < postures.size(); ++i) {
    const std::pair<int, int> near =
        clearance.near(Configuration(rig, *before.robot.table, before.robot.values, all[i]));
    if (near.first < 0)
      kept.push_back(std::move(postures[i]));
    else
      ++count[rig.tree.links[near.first] + " comes near " + rig.tree.links[near.second]];
  }
  for (const auto& one : count) plan.left_out.push_back(one);
  postures = std::move(kept);
}

/// The order in which a robot whose joints all move at once gets round soonest: the nearest one
/// next, then pieces of the way are turned round while that shortens it.
std::vector<Posture> short_to_drive(const std::vector<Posture>& postures) {
  const size_t n = postures.size();
  const auto far = [&](size_t a, size_t b) {
    double out = 0;
    for (size_t j = 0; j < postures[a].readings.size(); ++j) {
      const double d = std::abs(postures[a].readings[j] - postures[b].readings[j]);
      if (std::isfinite(d)) out = std::max(out, d);
    }
    return out;
  };
  std::vector<size_t> order;
  std::vector<char> there(n, 0);
  for (size_t at = 0; order.size() < n;) {
    order.push_back(at);
    there[at] = 1;
    size_t next = n;
    for (size_t i = 0; i < n; ++i)
      if (!there[i] && (next == n || far(at, i) < far(at, next))) next = i;
    at = next;
  }
  for (bool better = true; better;) {
    better = false;
    for (size_t i = 0; i + 1 < n; ++i)
      for (size_t k = i + 1; k < n; ++k) {
        const double before = (i > 0 ? far(order[i - 1], order[i]) : 0) +
                              (k + 1 < n ? far(order[k], order[k + 1]) : 0),
                     after = (i > 0 ? far(order[i - 1], order[k]) : 0) +
                             (k + 1 < n ? far(order[i], order[k + 1]) : 0);
        if (after > before - 1e-9) continue;
        std::reverse(order.begin() + static_cast<long>(i),
                     order.begin() + static_cast<long>(k + 1));
        better = true;
      }
  }
  std::vector<Posture> out;
  for (const size_t i : order) out.push_back(postures[i]);
  return out;
}

/// The goal, and the tolerance if one is given.
void set_goal(const Before& before, const std::vector<Sample>& samples,
              const PlanSettings& settings, PosturePlan& plan) {
  const CalibratedRobot& robot = before.robot;
  if (settings.goal == "parameters") {
    plan.goal = sight_goal(robot, samples);
  } else if (settings.goal.rfind("frame/", 0) == 0) {
    std::string name = settings.goal.substr(6);
    const std::string where = option_name("goal", settings.words);
    if (name.find('<') != std::string::npos) {
      plan.tolerance =
          parse_requirement(settings.goal, *before.recording, settings.words, "goal")[0];
      name = plan.tolerance->name;
      if (plan.tolerance->rotation)
        throw InputError(where + " '" + settings.goal + "': a length is expected, as in 0.5mm");
    }
    plan.goal = frame_goal(robot, frame_named(*robot.rig, *robot.table, name, where),
                           random_postures(*robot.rig, kGoalPostures, settings.seed));
  } else {
    try {
      const std::vector<Freed> found =
          robot.table->find(settings.goal, option_name("goal", settings.words));
      plan.goal = component_goal(robot, components_of(found));
    } catch (const NameError& error) {
      throw with_nearest(error, settings.words);
    }
  }
  if (plan.goal.weight.isZero(0))
    throw InputError(option_name("goal", settings.words) + " '" + settings.goal +
                     "': nothing that this calibration estimates changes it");
}

/// The forecast: planned, and the mean of random choices.
void set_forecast(const Before& before, const std::vector<SampleRows>& rows, const Design& design,
                  const PlanSettings& settings, PosturePlan& plan) {
  std::vector<double> random(design.errors.size(), 0);
  RandomStream draws(settings.seed + 1);
  std::vector<int> usable;
  for (size_t i = 0; i < rows.size(); ++i)
    if (rows[i].rows.rows() > 0) usable.push_back(static_cast<int>(i));
  for (int k = 0; k < kRandomDesigns; ++k) {
    std::vector<int> order = usable;
    for (size_t i = 0; i < design.chosen.size(); ++i)
      std::swap(order[i], order[i + draws.index(order.size() - i)]);
    order.resize(design.chosen.size());
    const std::vector<double> errors = errors_of(before.known, rows, plan.goal, order);
    for (size_t i = 0; i < errors.size(); ++i) random[i] += errors[i] * errors[i] / kRandomDesigns;
  }
  std::vector<size_t> shown = {0, 1, 2, 5, 10};
  for (size_t n = 20; n < design.errors.size(); n += n < 100 ? 10 : 100) shown.push_back(n);
  shown.push_back(design.errors.size() - 1);
  std::sort(shown.begin(), shown.end());
  shown.erase(std::unique(shown.begin(), shown.end()), shown.end());
  for (const size_t n : shown)
    if (n < design.errors.size())
      plan.forecast.push_back({static_cast<int>(n), design.errors[n], std::sqrt(random[n])});
  MatrixXd data = MatrixXd::Zero(before.known.rows(), before.known.cols());
  add_information(rows, data);
  const DesignFloor floor = floor_of(before.known, data, plan.goal);
  plan.floor = floor.error;
  for (const auto& [column, coefficient] : floor.direction)
    plan.floor_names.push_back(before.robot.table->name(before.robot.unknowns->columns[column]));
  plan.enough = enough_postures(design.errors, floor.error, plan.goal);
  if (!plan.tolerance) return;
  const double limit = plan.tolerance->limit * plan.tolerance->limit - plan.goal.readings;
  for (size_t n = 0; n < design.errors.size() && plan.needed < 0; ++n)
    if (design.errors[n] * design.errors[n] <= limit) plan.needed = static_cast<int>(n);
  const double last = design.errors.back() * design.errors.back(), rest = plan.floor * plan.floor;
  // What is above the floor falls as one over the number of postures.
  if (plan.needed < 0 && limit > rest)
    plan.needed = static_cast<int>(
        std::ceil(static_cast<double>(design.chosen.size()) * (last - rest) / (limit - rest)));
}

/// The robot before, with the chosen postures as its samples.
void set_assumed(const Before& before, const Simulation& candidates, PosturePlan& plan) {
  Solution& out = plan.assumed;
  out.initial = out.values.shared = before.robot.values;
  std::map<std::string, int> candidate;
  for (size_t i = 0; i < candidates.samples.size(); ++i)
    candidate[candidates.samples[i].id] = static_cast<int>(i);
  std::vector<Sample> samples;
  for (const Posture& posture : plan.postures) {
    const int at = candidate.at(posture.id), place = static_cast<int>(samples.size());
    for (auto it = candidates.targets.lower_bound({at, -1});
         it != candidates.targets.end() && it->first.first == at; ++it)
      out.values.targets[{place, it->first.second}] = it->second;
    samples.emplace_back();
    samples.back().id = posture.id;
    samples.back().readings = posture.readings;
  }
  out.recording = make_recording(before.recording->with_samples(std::move(samples)));
}

/// Where a joint's error curve depends on a value that no sample depends on.
std::vector<std::pair<double, double>> unvisited_ranges(const std::vector<Sample>& samples,
                                                        const Joint& joint, int index) {
  constexpr double kPiece = 2 * kPi / CurveJoint::kValues, kRounding = 1e-9;
  const CurveJoint curve;
  const std::vector<char> seen = numbers_seen(samples, index, curve);
  const auto [low, high] = usual_range(joint);
  std::vector<std::pair<double, double>> out;
  for (double i = std::floor(low / kPiece + kRounding); i * kPiece < high - kRounding; ++i) {
    const int piece = curve.piece((i + 0.5) * kPiece);
    bool open = false;
    for (int k = 0; k < curve.size() && !open; ++k) open = !seen[k] && curve.depends(k, piece);
    if (!open) continue;
    const double from = std::max(low, i * kPiece), to = std::min(high, (i + 1) * kPiece);
    if (!out.empty() && out.back().second == from)
      out.back().second = to;
    else
      out.push_back({from, to});
  }
  return out;
}

/// Of joints that have an error curve, or for which the automatic path tries one.
void set_unvisited(const RigFile& rig_file, const Before& before, const Simulation& candidates,
                   PosturePlan& plan) {
  const Rig& rig = *before.robot.rig;
  std::vector<std::string> tried;
  if (rig_file.rig.steps.empty())
    tried = make_groups(Recording(rig_file.rig, candidates.samples), {}).further;
  std::vector<Sample> samples;
  const auto add = [&](const Readings& readings) {
    samples.emplace_back();
    samples.back().readings = readings;
  };
  for (const Readings& readings : before.stood) add(readings);
  for (const Posture& posture : plan.postures) add(posture.readings);
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    const Joint& joint = rig.tree.joints[j];
    if (rig.joints[j].model->name() != CurveJoint().name() &&
        std::find(tried.begin(), tried.end(), kCurve + joint.name) == tried.end())
      continue;
    auto ranges = unvisited_ranges(samples, joint, static_cast<int>(j));
    if (!ranges.empty()) plan.unvisited.push_back({joint.name, std::move(ranges)});
  }
}

}  // namespace

Clearance robot_clearance(const RigFile& rig_file, const CalibratedRobot& robot,
                          const std::vector<Readings>& stood, double margin,
                          std::vector<std::string>& notes) {
  const Rig& rig = *robot.rig;
  const LinkBoxes drawn = link_boxes(rig_file.urdf);
  std::vector<std::vector<Box>> boxes(rig.tree.links.size());
  const std::vector<std::string>& names = rig_file.urdf.tree.links;
  for (size_t l = 0; l < names.size() && l < drawn.of.size(); ++l) {
    const auto found = std::find(rig.tree.links.begin(), rig.tree.links.end(), names[l]);
    if (found == rig.tree.links.end()) continue;
    for (const LinkBox& box : drawn.of[l])
      boxes[found - rig.tree.links.begin()].push_back({box.link_T_box, box.size});
  }
  // (Configurations refer to their readings.) The robot as it is drawn: readings 0, within limits.
  std::vector<Readings> safe = {Readings(rig.tree.joints.size(), 0)};
  for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
    const auto [low, high] = usual_range(rig.tree.joints[j]);
    safe[0][j] = std::clamp(0.0, low, high);
  }
  for (const Readings& readings : stood) safe.push_back(completed(readings));
  std::vector<Configuration> robots;
  for (const Readings& r : safe) robots.emplace_back(rig, *robot.table, robot.values, r);
  Clearance out(rig, boxes, margin, robots);
  if (drawn.left_out > 0)
    notes.push_back(std::to_string(drawn.left_out) +
                    " links have missing meshes: collisions with them were not checked");
  if (out.empty())
    notes.push_back("no shapes of links: collisions of the robot with itself were not checked");
  return out;
}

std::optional<KnownRobot> known_robot(const CalibratedFiles& files,
                                      const std::string& samples_csv) {
  if (!files.unknowns) return std::nullopt;
  return KnownRobot{files.robot(),
                    training_readings(samples_csv, files.path, files.rig_file.rig.tree).readings};
}

PosturePlan plan_postures(const RigFile& rig_file, const SampleSet* samples,
                          const PlanSettings& settings, const Progress& progress) {
  PosturePlan plan;
  Before before;
  if (samples) {
    before = after_samples(rig_file, *samples, settings, progress);
  } else if (settings.known) {
    before = after_calibration(*settings.known);
  } else {
    before.recording = std::make_shared<Recording>(rig_file.rig, std::vector<Sample>());
    refuse_open_poses(rig_file, before.recording->table);
    before.robot = {
        &before.recording->rig, &before.recording->table, before.recording->table.initial, {}};
  }
  CandidatePostures of;
  SimulationOptions options;
  options.seed = settings.seed;
  options.samples = settings.candidates;
  options.progress = progress.in("candidates");
  if (settings.postures) {
    options.postures =
        parse_postures(settings.postures->text, settings.postures->path, rig_file.rig);
    options.samples = static_cast<int>(options.postures.size());
  }
  Simulation first = simulate(*before.robot.rig, *before.robot.table, before.robot.values, options);
  plan.candidates = options.samples;
  plan.asked = settings.next;
  for (const auto& [why, count] : first.left_out)
    plan.left_out.push_back({"no sensor sees a target whole, " + why, count});
  if (first.samples.empty())
    throw InputError(rig_file.path + ": no candidate sees a target: nothing can be planned");
  for (size_t i = 0; i < first.samples.size(); ++i) {
    Posture posture;
    posture.id = first.samples[i].id;
    posture.readings = first.true_readings[i];
    for (const View& v : first.samples[i].views) posture.views.push_back({v.sensor, v.target});
    for (auto it = first.targets.lower_bound({static_cast<int>(i), -1});
         it != first.targets.end() && it->first.first == static_cast<int>(i); ++it)
      if (std::none_of(first.samples[i].views.begin(), first.samples[i].views.end(),
                       [&](const View& v) {
                         return v.target == it->first.second &&
                                before.robot.rig->sensors[v.sensor].model->measurement_kind() ==
                                    MeasurementKind::chain;
                       }))
        posture.targets[it->first.second] = it->second;
    of.postures.push_back(std::move(posture));
  }
  if (!before.robot.unknowns) before = before_samples(rig_file, first.samples, settings);
  if (settings.clearance >= 0) keep_clear(rig_file, before, settings, plan, of.postures);
  keep_certain_views(before, settings, plan, of);
  if (of.postures.empty())
    throw InputError(rig_file.path + ": no candidate is left: " +
                     (plan.left_out.empty() ? "" : plan.left_out.back().first));
  of.simulation = simulated(*before.robot.rig, *before.robot.table, before.robot.values,
                            of.postures, settings.seed);
  set_goal(before, of.simulation.samples, settings, plan);
  std::vector<Sample> true_samples = of.simulation.samples;
  for (size_t i = 0; i < true_samples.size(); ++i)
    true_samples[i].readings = of.simulation.true_readings[i];
  const std::vector<SampleRows> rows =
      sample_rows(before.robot, before.setup, std::move(true_samples), of.simulation.targets,
                  progress.in("evaluating candidates"));
  DesignOptions design_options;
  design_options.count = settings.next;
  design_options.progress = progress;
  const Design design = choose_postures(before.known, rows, plan.goal, design_options);
  set_forecast(before, rows, design, settings, plan);
  std::map<std::string, const Posture*> by_id;
  for (const Posture& posture : of.postures) by_id[posture.id] = &posture;
  for (const int i : design.chosen) plan.postures.push_back(*by_id.at(of.simulation.samples[i].id));
  plan.postures = short_to_drive(plan.postures);
  set_assumed(before, of.simulation, plan);
  set_unvisited(rig_file, before, of.simulation, plan);
  return plan;
}

std::string postures_text(const Rig& rig, const std::vector<Posture>& postures) {
  std::string out;
  for (const Posture& posture : postures) {
    Json views = Json::array(), targets = Json::object();
    for (const auto& [sensor, target] : posture.views)
      views.push_back({{"sensor", rig.sensors[sensor].name}, {"target", rig.targets[target].name}});
    for (const auto& [target, pose] : posture.targets) {
      const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
      const Vector3d& t = pose.translation;
      targets[rig.targets[target].name] = {{"xyz", {t.x(), t.y(), t.z()}},
                                           {"quat", {q[0], q[1], q[2], q[3]}}};
    }
    out += "{\"id\": " + Json(posture.id).dump() +
           ", \"joints\": " + readings_text(rig.tree, posture.readings) +
           (posture.from.empty() ? "" : ", \"from\": " + readings_text(rig.tree, posture.from)) +
           ", \"views\": " + views.dump() +
           (targets.empty() ? "" : ", \"targets\": " + targets.dump()) + "}\n";
  }
  return out;
}

Json plan_json(const PosturePlan& plan) {
  Json forecast = Json::array(), left_out = Json::object(), ids = Json::array(),
       unvisited = Json::object();
  for (const PlanStep& step : plan.forecast)
    forecast.push_back(
        {{"postures", step.postures}, {"planned", step.planned}, {"random", step.random}});
  for (const auto& [why, count] : plan.left_out) left_out[why] = count;
  for (const Posture& posture : plan.postures) ids.push_back(posture.id);
  for (const UnvisitedAngles& of : plan.unvisited) unvisited[of.joint] = of.ranges;
  return {{"goal", plan.goal.name},
          {"unit", plan.goal.unit},
          {"tolerance", plan.tolerance ? Json(plan.tolerance->limit) : Json()},
          {"postures", ids},
          {"forecast", forecast},
          {"readings", std::sqrt(plan.goal.readings)},
          {"floor", {{"error", plan.floor}, {"parameters", plan.floor_names}}},
          {"enough", plan.enough < 0 ? Json() : Json(plan.enough)},
          {"needed", plan.needed < 0 ? Json() : Json(plan.needed)},
          {"candidates", plan.candidates},
          {"left_out", left_out},
          {"unvisited", unvisited},
          {"notes", plan.notes}};
}

ResultFiles plan_files(const RigFile& rig_file, const PosturePlan& plan,
                       const ResultOptions& record) {
  const Rig& rig = plan.assumed.rig();
  Json json = plan_json(plan), views = Json::array();
  for (const Posture& posture : plan.postures) {
    Json of = Json::array();
    for (const auto& [sensor, target] : posture.views)
      of.push_back({rig.sensors[sensor].name, rig.targets[target].name});
    views.push_back(std::move(of));
  }
  json["views"] = std::move(views);
  Report report;
  report.solution = plan.assumed;
  return page_files("plan", rig_file, record, report, {{"plan", json}});
}

namespace {

std::string size_of(const DesignGoal& goal, double error) {
  return goal.unit == "m" ? text("%.3g mm", 1e3 * error) : text("%.3g", error);
}

/// How many candidates were left out, and the main reasons.
std::string left_out_text(const PosturePlan& plan) {
  constexpr size_t kTold = 3;
  std::vector<std::pair<std::string, int>> reasons = plan.left_out;
  std::stable_sort(reasons.begin(), reasons.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  int all = 0;
  for (const auto& reason : reasons) all += reason.second;
  if (all == 0) return "";
  std::string out = text("%d of %d candidates were left out: ", all, plan.candidates);
  for (size_t i = 0; i < reasons.size() && i < kTold; ++i)
    out += (i ? "; " : "") + reasons[i].first + text(" (%d)", reasons[i].second);
  if (reasons.size() > kTold) out += text("; and %zu reasons more", reasons.size() - kTold);
  return out + ".\n";
}

}  // namespace

std::string plan_text(const PosturePlan& plan) {
  std::string out = "Predicted error of the calibration, " + plan.goal.name +
                    (plan.goal.unit.empty() ? " (in yardsticks)" : " (position)") + ":\n";
  out += text("  %8s %12s %12s\n", "postures", "planned", "random");
  for (const PlanStep& step : plan.forecast)
    out += text("  %8d %12s %12s\n", step.postures, size_of(plan.goal, step.planned).c_str(),
                size_of(plan.goal, step.random).c_str());
  if (plan.goal.readings > 0)
    out += "The noise of one reading of the joints adds " +
           size_of(plan.goal, std::sqrt(plan.goal.readings)) + ".\n";
  const double last = plan.forecast.back().planned;
  if (plan.floor > 0.3 * last) {
    out += "No posture lowers it below " + size_of(plan.goal, plan.floor) + ", mostly because of ";
    for (size_t i = 0; i < plan.floor_names.size(); ++i)
      out += (i ? ", " : "") + plan.floor_names[i];
    out += ".\n";
  }
  const bool reachable = !plan.tolerance || plan.needed >= 0;
  if (reachable && plan.enough >= 0)
    out += text("Enough: %d posture%s. Three times as many lower the error by less than a tenth.\n",
                plan.enough, plan.enough == 1 ? "" : "s");
  else if (reachable)
    out += "More postures still help: three times as many lower the error by more than a tenth.\n";
  if (plan.tolerance && plan.needed >= 0)
    out += plan.tolerance->text + text(": about %d postures are needed.\n", plan.needed);
  if (plan.tolerance && plan.needed < 0)
    out += plan.tolerance->text + ": out of reach, because " +
           (plan.goal.readings >= plan.tolerance->limit * plan.tolerance->limit
                ? "the noise of the joints' readings alone is larger.\n"
                : "the error that no posture reduces is larger.\n");
  if (static_cast<int>(plan.postures.size()) < plan.asked)
    out += text(
        "Only %zu of %d postures: no other candidate is left. More candidates, or priors of "
        "the mounts in the rig, give more.\n",
        plan.postures.size(), plan.asked);
  if (!plan.unvisited.empty())
    out += "Without a sample (rad): errors that depend on the angle are not seen there.\n";
  for (const UnvisitedAngles& of : plan.unvisited) {
    out += "  " + of.joint + ":";
    for (size_t i = 0; i < of.ranges.size(); ++i)
      out += text("%s %.2f to %.2f", i ? "," : "", of.ranges[i].first, of.ranges[i].second);
    out += "\n";
  }
  out += left_out_text(plan);
  for (const std::string& note : plan.notes) out += "Note: " + note + ".\n";
  return out;
}

}  // namespace kincal
