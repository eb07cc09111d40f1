#include "intrinsics.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include "../analysis/linearisation.h"
#include "../fitting/closed_form.h"
#include "../fitting/lens_start.h"
#include "../rig/configuration.h"
#include "../rig/geometry.h"
#include "../rig/scales.h"
#include "../rig/targets.h"
#include "../rig/words.h"
#include "../trials/estimate_noise.h"
#include "camera_groups.h"
#include "far_corners.h"
#include "two_lenses.h"

namespace kincal {
namespace {

constexpr double kUnsettled = 1.1;  // times the sigma used: the noise was not found
constexpr double kSurely = 6;       // in chi2, and 2 for each number more
constexpr double kSurelyBent = 3;   // standard errors by which bent boards are better

// ------------------------------------------------------------------------------------------------
// the choice of a lens
/// Cross-validates a solution from where it stands. Without enough samples the result has no
/// sensors.
CrossValidation hold_out(const Solution& solution, const CalibrationOptions& options, int folds) {
  const auto samples = static_cast<int>(solution.samples().size());
  if (samples < 3) return CrossValidation();
  try {
    return uncancelled(
        cross_validate(make_recording(solution.recording->with_rig(at_solution(solution))), options,
                       std::clamp(folds, 2, samples)));
  } catch (const std::invalid_argument&) {  // too few that can be held out
    return CrossValidation();
  }
}

std::string why_unusable(const Solution& solution) {
  if (solution.status == Status::undefined_start) return "cannot start";
  if (solution.status == Status::not_converged) return "did not converge";
  return solution.unobservable.empty() ? "" : "not determined by these views";
}

/// Sets how much worse than the best each lens is on what was held out.
void compare(std::vector<LensTrial>& trials) {
  const LensTrial* best = nullptr;
  for (const LensTrial& t : trials)
    if (t.unusable.empty() && (!best || t.held_out < best->held_out)) best = &t;
  if (!best) return;
  for (LensTrial& t : trials)
    if (t.unusable.empty()) std::tie(t.worse, t.worse_sigma) = worse_by(t.blocks, best->blocks);
}

/// Tries all lenses on one camera.
void try_lenses(const IntrinsicsOptions& options, OneCamera& camera, CameraIntrinsics& out) {
  for (const LensModel& model : lens_models()) {
    options.progress.stage("lens of '" + camera.rig.sensors[0].name + "': " + model.name);
    LensTrial trial;
    trial.model = &model;
    const Solution solution = fit_lens(model, options, camera);
    trial.unusable = why_unusable(solution);
    if (solution.usable()) {
      trial.rms = training_rms(solution, 0);
      trial.loose = !(looseness(solution["sensor/" + camera.rig.sensors[0].name + "/intrinsics"],
                                trial.rms / std::sqrt(2), camera.rig.sensors[0].sigma[0]) <=
                      scales(ParameterKind::intrinsics, "px").open);
      const CrossValidation held_out = hold_out(solution, options, options.folds);
      if (!held_out.sensors.empty()) trial.held_out = held_out.sensors[0].rms;
      trial.blocks = blocks(held_out);
    }
    out.trials.push_back(std::move(trial));
  }
  size_t most = 0;
  for (const LensTrial& t : out.trials) most = std::max(most, t.blocks.size());
  for (LensTrial& t : out.trials)
    if (t.unusable.empty() && (t.blocks.size() < most || !std::isfinite(t.held_out)))
      t.unusable = "some samples cannot be judged";
  compare(out.trials);
}

const LensTrial* chosen(const std::vector<LensTrial>& trials) {
  for (const LensTrial& t : trials)
    if (t.unusable.empty() && t.worse <= t.worse_sigma) return &t;
  return nullptr;
}

/// Finds the lens of a camera and where it starts.
Sensor find_camera(const IntrinsicsOptions& options, OneCamera& camera,
                   std::vector<IntrinsicsNote>& notes, CameraIntrinsics& out) {
  const std::string& name = camera.rig.sensors[0].name;
  const LensModel& given = own_lens(camera.rig.sensors[0]);
  if (options.model == "auto") {
    try_lenses(options, camera, out);
    const LensTrial* best = chosen(out.trials);
    out.model = best && !best->loose ? best->model : &given;
    if (out.model == &given && (!best || best->loose))
      notes.push_back({"model", text("'%s': no lens can be tested with the held-out part of %zu "
                                     "samples%s: it is %s, as in the rig",
                                     name.c_str(), camera.samples->size(),
                                     best ? ", because these do not determine a focal length" : "",
                                     given.name.c_str())});
  } else {
    out.model = options.model == "rig" ? &given : &find_lens(options.model);
  }
  if (!lens_type(out.model->lens).plain.empty()) fit_plain_lens(*out.model, options, camera);
  for (const LensModel& model : lens_models()) {  // simpler ones are starts
    if (!start_alike(model.lens, out.model->lens)) continue;
    if (!out.trials.empty() || model.numbers() >= out.model->numbers()) break;
    fit_lens(model, options, camera);
  }
  return best_start(camera, *out.model);
}

// ------------------------------------------------------------------------------------------------
// a group
/// Fills in what a solution of the group says of one camera.
void describe(const Solution& solution, const std::vector<NoiseLevel>& levels,
              const CrossValidation& held_out, CameraIntrinsics& out) {
  const Sensor& camera = solution.rig().sensors[out.sensor];
  const std::vector<const View*> views = camera_views(solution.samples(), out.sensor);
  out.image = image_size(camera, views);
  out.views = static_cast<long>(views.size());
  for (const View* view : views) out.points += static_cast<long>(view->ids.size());
  out.rms = training_rms(solution, out.sensor);
  double squares = 0;  // of the sigmas that the views came to have
  for (const View* view : views)
    squares += static_cast<double>(view->ids.size()) * view->sigma[0] * view->sigma[0];
  out.noise = std::sqrt(squares / static_cast<double>(out.points));
  for (const NoiseLevel& level : levels)
    if (level.sensor == out.sensor) {
      out.stated = out.noise * level.assumed / level.used;
      if (level.seen > kUnsettled * level.used)  // rounds that ended before the noise was found
        out.noise *= level.seen / level.used;
    }
  for (const HeldOutError& error : held_out.sensors)
    if (error.sensor == camera.name) out.held_out = error;
  out.coverage = coverage(solution, out.sensor, out.image);
  const ProjectionError error(solution, out.sensor);
  out.distance = error.distance();
  out.tilt = error.tilt();
  out.near = error.grid(out.image, out.distance);
  out.far = error.grid(out.image, kInfinity);
}

/// Adds what is to be said of a camera, and returns what its fit is worth.
Status judge_camera(const Solution& solution, const CameraIntrinsics& camera, bool mistaken,
                    std::vector<IntrinsicsNote>& notes) {
  const FittedLens fit = {solution,     camera.sensor, camera.model->name, camera.image,
                          camera.views, camera.points, camera.noise,       camera.tilt};
  const std::vector<IntrinsicsNote> said = lens_notes(fit, mistaken);
  notes.insert(notes.end(), said.begin(), said.end());
  if (is_undetermined(fit)) return Status::unobservable;
  return is_unexplained(fit, camera.stated, mistaken) ? Status::unexplained : Status::converged;
}

/// Of two statuses that which goes before the other (exit codes 3, 2, 5, 0).
Status graver(Status a, Status b) {
  for (const Status status : {Status::not_converged, Status::unobservable, Status::unexplained})
    if (a == status || b == status) return status;
  return a;
}

/// Estimates a group with its noise. Where the views determine so little that the plain fit leads
/// nowhere (a focal length runs away from parallel boards), intrinsics are held to where they start
/// by a prior as wide as the focal length: `held` says so.
NoiseEstimate estimate_group(Rig rig, const SharedSamples& samples,
                             const CalibrationOptions& options, bool& held) {
  const std::shared_ptr<const Recording> plain = recording_of(rig, samples);
  NoiseEstimate out = uncancelled(estimate_noise(plain, options));
  held = !out.solution.usable();
  if (!held) return out;
  for (const Sensor& camera : rig.sensors) {
    const double wide = find_block(camera, ParameterKind::intrinsics)->values[0];
    rig.steps[0].priors.push_back(
        {"sensor/" + camera.name + "/intrinsics", wide, wide, false, "intrinsics"});
  }
  NoiseEstimate again = uncancelled(estimate_noise(make_recording(plain->with_rig(rig)), options));
  if (again.solution.usable()) return again;
  held = false;
  return out;
}

/// A group's solution with its noise, and its error on what was held out.
struct GroupFit {
  NoiseEstimate estimate;
  CrossValidation held_out;
  bool held = false;  // as estimate_group()
};

GroupFit fit_group(const Rig& rig, const SharedSamples& samples, const IntrinsicsOptions& options) {
  GroupFit out;
  out.estimate = estimate_group(rig, samples, options, out.held);
  const Solution& solution = out.estimate.solution;
  if (solution.status == Status::undefined_start) throw std::runtime_error(solution.message);
  for (const std::string& lost : solution.lost_starts)
    throw std::runtime_error(lost + ": nothing ties it to the other cameras");
  out.held_out = hold_out(solution, options, options.folds);
  return out;
}

/// A group on its way: its cameras, and what each was found to be.
struct Group {
  std::vector<int> cameras;  // of the given rig
  std::vector<CameraIntrinsics> found;
  std::vector<const LensModel*> lenses;
  Rig rig;                       // to start from
  SharedSamples samples;         // that it sees
  std::vector<OneCamera> alone;  // by sensor, as find_lenses() left them
};

/// Chooses the lens of each camera by itself; `rig` is that of all cameras, its boards flat or as
/// bent as they are to start from.
void find_lenses(const Rig& rig, const std::vector<Sample>& samples, bool bent,
                 const IntrinsicsOptions& options, Group& group,
                 std::vector<IntrinsicsNote>& notes) {
  group.rig = bench(rig, group.cameras);
  group.lenses.clear();
  group.alone.clear();
  for (size_t s = 0; s < group.cameras.size(); ++s) {
    CameraIntrinsics& found = group.found[s];
    found.trials.clear();
    group.alone.push_back(one_camera(rig, samples, group.cameras[s], bent));
    const Sensor start = find_camera(options, group.alone.back(), notes, found);
    group.rig.sensors[s].model = start.model;
    group.rig.sensors[s].parameters = start.parameters;
    group.lenses.push_back(found.model);
  }
  set_steps(group.lenses, group.rig);
}

/// A group with another lens for one of its cameras, and its fit with the rig's sigmas.
struct GroupTrial {
  size_t camera = 0;
  const LensModel* model = nullptr;
  Solution solution;
  double gain = 0;  // what chi2 falls by, in what is left, beyond two for each number more
};

/// The lenses of one camera of a group that surely take something off the chi2 of all, those with
/// the fewest numbers first.
std::vector<GroupTrial> changes(const Group& group, const Solution& now,
                                const CalibrationOptions& options) {
  std::vector<GroupTrial> out;
  for (size_t s = 0; s < group.cameras.size(); ++s)
    for (const LensTrial& t : group.found[s].trials) {
      const int more = t.model->numbers() - group.lenses[s]->numbers();
      if (!t.unusable.empty() || t.model == group.lenses[s] || more < 0) continue;
      GroupTrial trial{s, t.model, {}, 0};
      Rig rig = at_solution(now);
      const Sensor start = best_start(group.alone[s], *t.model);
      rig.sensors[s].model = start.model;
      rig.sensors[s].parameters = start.parameters;
      std::vector<const LensModel*> lenses = group.lenses;
      lenses[s] = t.model;
      set_steps(lenses, rig);
      trial.solution =
          uncancelled(calibrate(make_recording(now.recording->with_rig(std::move(rig))), options));
      if (trial.solution.status != Status::converged) continue;
      trial.gain =
          (now.chi2_data - trial.solution.chi2_data) / trial.solution.chi2_per_dof() - 2 * more;
      if (trial.gain > kSurely) out.push_back(std::move(trial));
    }
  std::stable_sort(out.begin(), out.end(), [](const GroupTrial& a, const GroupTrial& b) {
    const int more = a.model->numbers() - b.model->numbers();
    return more < 0 || (more == 0 && a.gain > b.gain);
  });
  return out;
}

/// Chooses lenses of a group once more by all of its cameras: what one lacks shows in where the
/// others stand, and a number that is too small to be seen by one alone pulls those of the others
/// by many sigmas.
void choose_together(const IntrinsicsOptions& options, Group& group) {
  if (group.cameras.size() < 2 || options.model != "auto") return;
  options.progress.stage("lenses of all cameras together");
  Solution now = uncancelled(calibrate(recording_of(group.rig, group.samples), options));
  std::optional<CrossValidation> held_out;
  bool changed = now.status == Status::converged;
  while (changed) {
    changed = false;
    std::vector<GroupTrial> trials = changes(group, now, options);
    for (GroupTrial& trial : trials) {
      if (!held_out) held_out = hold_out(now, options, options.folds);
      CrossValidation after = hold_out(trial.solution, options, options.folds);
      changed = rms_of(blocks(after)) < rms_of(blocks(*held_out));
      if (!changed) continue;
      held_out = std::move(after);
      now = std::move(trial.solution);
      group.rig = at_solution(now);
      group.lenses[trial.camera] = trial.model;
      group.found[trial.camera].model = trial.model;
      set_steps(group.lenses, group.rig);
      break;
    }
  }
}

/// Fits the group again with boards that may be bent, from where it stands. Where they may
/// (options.warp) and it is better on what was held out, that stays, and the lenses are chosen
/// again with such boards, for a bent board looks like a lens.
void try_warp(const Rig& given, const std::vector<Sample>& samples,
              const IntrinsicsOptions& options, Group& group, GroupFit& fit,
              std::optional<WarpTrial>& trial) {
  Rig rig = at_solution(fit.estimate.solution);
  if (fit.held || fit.held_out.sensors.empty() || !bend_boards(*group.samples, rig)) return;
  const HeldOutBlocks flat = blocks(fit.held_out);
  const auto fit_bent = [&](const Rig& bent) {
    options.progress.stage("boards that may be bent");
    GroupFit warped = fit_group(bent, group.samples, options);
    const HeldOutBlocks after = blocks(warped.held_out);
    if (!warped.estimate.solution.usable() || after.size() != flat.size()) return;
    trial = WarpTrial{rms_of(flat), rms_of(after)};
    std::tie(trial->better, trial->better_sigma) = worse_by(flat, after);
    for (const Target& target : at_solution(warped.estimate.solution).targets)
      trial->largest = std::max(trial->largest, target.warp.cwiseAbs().maxCoeff());
    trial->kept = options.warp && trial->better > trial->better_sigma;
    if (trial->kept) fit = std::move(warped);
  };
  fit_bent(rig);
  if (!trial || !trial->kept || options.model != "auto") return;
  const std::vector<const LensModel*> before = group.lenses;
  Rig bent = given;
  bent.targets = at_solution(fit.estimate.solution).targets;
  std::vector<IntrinsicsNote> said;  // as of flat boards
  find_lenses(bent, samples, true, options, group, said);
  if (group.lenses == before) return;
  bend_boards(*group.samples, group.rig);
  fit_bent(group.rig);
}

/// Says where each camera of a group explains its views by itself, but not all together do; `fit`
/// is of all.
std::vector<IntrinsicsNote> views_apart(const Rig& rig, const std::vector<Sample>& samples,
                                        const IntrinsicsOptions& options, const Group& group,
                                        const Solution& fit) {
  double alone = 0, together = 0;
  std::vector<std::string> names;
  for (size_t s = 0; s < group.cameras.size(); ++s) {
    OneCamera camera = one_camera(rig, samples, group.cameras[s], false);
    const Solution own = fit_lens(*group.lenses[s], options, camera);
    if (!own.usable()) return {};
    alone = std::max(alone, training_rms(own, 0));
    together = std::max(together, training_rms(fit, static_cast<int>(s)));
    names.push_back(quoted(rig.sensors[group.cameras[s]].name));
  }
  return apart(names, alone, together);
}

/// Calibrates cameras together and adds them to the result.
void calibrate_group(const Rig& rig, const std::vector<Sample>& given,
                     const std::vector<int>& cameras, const IntrinsicsOptions& options,
                     IntrinsicsResult& result) {
  Group group{cameras, std::vector<CameraIntrinsics>(cameras.size()), {}, {}, {}, {}};
  std::vector<Sample> samples = given;  // without what does not belong to the others
  std::vector<char> mistaken(cameras.size());
  const auto say = [&](const std::vector<IntrinsicsNote>& notes) {
    result.notes.insert(result.notes.end(), notes.begin(), notes.end());
    for (const IntrinsicsNote& note : notes)
      if (note.spoils) result.status = graver(result.status, Status::unexplained);
  };
  for (size_t s = 0; s < cameras.size(); ++s) {
    group.found[s].camera = cameras[s];
    group.found[s].sensor = static_cast<int>(s);
    group.found[s].group = static_cast<int>(result.groups.size());
    const Rig one = bench(rig, {cameras[s]});
    const std::vector<Sample> seen = seen_by(rig, samples, {cameras[s]});
    const std::vector<IntrinsicsNote> wrong = wrong_views(one, seen, 0);
    mistaken[s] = !wrong.empty();
    say(wrong);
    say(copied_views(one, seen, 0));
    if (mistaken[s]) continue;
    say(take_out_far(rig, cameras[s], options, samples));
  }
  group.samples = std::make_shared<const std::vector<Sample>>(seen_by(rig, samples, cameras));
  bool any = std::count(mistaken.begin(), mistaken.end(), 1) > 0;
  std::vector<IntrinsicsNote> of_lenses;
  find_lenses(rig, samples, false, options, group, of_lenses);
  for (size_t s = 0; s < cameras.size(); ++s) {
    if (mistaken[s]) continue;
    const std::vector<IntrinsicsNote> said =
        views_of_another_lens(*group.lenses[s], options, group.alone[s]);
    mistaken[s] = !said.empty();
    any = any || mistaken[s];
    say(said);
  }
  if (!any) say(of_lenses);  // else the choice of a lens follows from that
  if (!any) choose_together(options, group);
  GroupFit fitted = fit_group(group.rig, group.samples, options);
  std::optional<WarpTrial> warp;
  if (options.warp || !any) try_warp(rig, samples, options, group, fitted, warp);
  if (!options.warp && warp && warp->better > kSurelyBent * warp->better_sigma)
    say({bent_boards(warp->flat, warp->warped, warp->largest)});
  result.groups.push_back(
      {std::move(fitted.estimate.solution), cameras, options.warp ? warp : std::nullopt});
  const Solution& solution = result.groups.back().solution;
  if (!any && cameras.size() > 1) {
    const std::vector<IntrinsicsNote> said = views_apart(rig, samples, options, group, solution);
    any = !said.empty();
    mistaken.assign(cameras.size(), any);
    say(said);
  }
  Status status = fitted.held ? Status::unobservable : solution.status;
  for (size_t s = 0; s < cameras.size(); ++s) {
    CameraIntrinsics& camera = group.found[s];
    describe(solution, fitted.estimate.levels, fitted.held_out, camera);
    status = graver(status, judge_camera(solution, camera, mistaken[s], result.notes));
    result.cameras.push_back(std::move(camera));
  }
  result.status = graver(result.status, status);
}

/// Says of a camera that it was found on the other side of the reference than the rig has it.
void note_exchanged(const Rig& rig, const IntrinsicsResult& result, const CameraIntrinsics& camera,
                    std::vector<IntrinsicsNote>& notes) {
  constexpr double kAlike = 0.4, kLeast = 0.01;  // of the distance; m
  const IntrinsicsGroup& group = result.groups[camera.group];
  const Sensor &reference = rig.sensors[group.cameras[0]], &own = rig.sensors[camera.camera];
  if (camera.sensor == 0 || !reference.pose_given || !own.pose_given) return;
  const ParameterTable table(rig);
  const std::vector<double> readings(rig.tree.joints.size(), 0.0);
  const Configuration at(rig, table, table.initial, readings);
  const Vector3d given =
                     (inverse(at.base_T_sensor(group.cameras[0])) * at.base_T_sensor(camera.camera))
                         .translation,
                 found =
                     at_solution(group.solution).sensors[camera.sensor].link_T_sensor.translation;
  if (given.norm() < kLeast || (given + found).norm() > kAlike * given.norm()) return;
  notes.push_back(
      {"exchanged_cameras",
       quoted(own.name) + " was found on the other side of " + quoted(reference.name) +
           text(" than the rig has it, %.3g m away: the names of the two are exchanged in the "
                "samples, or all images are upside down, or the rig has them the wrong way "
                "round. See which is which, and calibrate again",
                found.norm())});
}

}  // namespace

std::optional<IntrinsicsResult> calibrate_intrinsics(const Rig& rig,
                                                     const std::vector<Sample>& samples,
                                                     const IntrinsicsOptions& given) try {
  IntrinsicsOptions options = given;
  options.noise = NoiseMode::none;
  if (options.model != "auto" && options.model != "rig") find_lens(options.model);
  std::vector<int> cameras;
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    if (has_lens(rig.sensors[s]) && !seen_by(rig, samples, {static_cast<int>(s)}).empty())
      cameras.push_back(static_cast<int>(s));
  if (cameras.empty())
    throw std::invalid_argument(
        "no camera of the rig sees a board: views with at least four points, not on a line, in "
        "training samples are needed");
  IntrinsicsResult out;
  try {
    for (const std::vector<int>& group : camera_groups(rig, samples, cameras))
      calibrate_group(rig, samples, group, options, out);
  } catch (const std::runtime_error& error) {
    if (out.notes.empty()) throw;
    throw std::runtime_error(out.notes[0].text + " (" + error.what() + ")");
  }
  for (const CameraIntrinsics& camera : out.cameras) note_exchanged(rig, out, camera, out.notes);
  std::stable_sort(
      out.cameras.begin(), out.cameras.end(),
      [](const CameraIntrinsics& a, const CameraIntrinsics& b) { return a.camera < b.camera; });
  return out;
} catch (const Cancelled&) {
  return std::nullopt;
}

Sensor calibrated_camera(const Rig& rig, const IntrinsicsResult& result,
                         const CameraIntrinsics& camera) {
  const IntrinsicsGroup& group = result.groups[camera.group];
  const Sensor found = at_solution(group.solution).sensors[camera.sensor];
  Sensor out = rig.sensors[camera.camera];
  const bool undistorted = camera.model->distortion == 0;
  if (!undistorted || !find_block(out, ParameterKind::distortion)) {
    out.model = found.model;
    out.parameters = found.parameters;
  } else {  // the rig's lens with zeros is the same, and what names its distortion still holds
    out.parameters[0].values = found.parameters[0].values;
    for (double& k : out.parameters[1].values) k = 0;
  }
  const Sensor& reference = rig.sensors[group.cameras[0]];
  if (camera.sensor == 0 || !reference.pose_given) return out;
  // On one rigid body: fixed joints only, which need no readings.
  const ParameterTable table(rig);
  const std::vector<double> readings(rig.tree.joints.size(), 0.0);
  const Configuration at(rig, table, table.initial, readings);
  out.link_T_sensor =
      at.a_T_b(out.link, reference.link) * reference.link_T_sensor * found.link_T_sensor;
  out.pose_given = true;
  return out;
}

}  // namespace kincal
