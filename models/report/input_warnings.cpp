#include "input_warnings.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "../../kinematics/floating.h"
#include "../analysis/frames.h"
#include "../estimation/estimation.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/words.h"
#include "warning_items.h"

namespace kincal {
namespace {

constexpr double kRescaled = 2;  // times: no length of a robot is as wrong, but for a unit
constexpr int kRigid = 6;        // so many numbers say where a rigid thing is

/// Whether a parameter says where something is.
bool is_placing(ParameterKind kind) {
  return kind == ParameterKind::joint_offset || kind == ParameterKind::joint_scale ||
         kind == ParameterKind::joint_shape || kind == ParameterKind::backlash ||
         kind == ParameterKind::temperature || kind == ParameterKind::ripple ||
         kind == ParameterKind::coupling || kind == ParameterKind::joint_origin ||
         kind == ParameterKind::sensor_pose || kind == ParameterKind::target_pose;
}

/// How many numbers say where sensors and targets are to each other: at most six a view, less those
/// that a free target takes.
long placing_numbers(const Solution& solution) {
  const std::vector<int>& sensors = solution.setup.sensors;
  long out = 0;
  for (int i : solution.training()) {
    std::map<int, long> by_target;
    for (const View& view : solution.samples()[i].views) {
      if (std::find(sensors.begin(), sensors.end(), view.sensor) == sensors.end()) continue;
      const SensorModel& model = *solution.rig().sensors[view.sensor].model;
      const long rows = model.rows() * model.blocks(static_cast<int>(view.ids.size()));
      by_target[view.target] += model.scans() ? rows : std::min<long>(kRigid, rows);
    }
    for (const auto& target : by_target)
      out += std::max(0L,
                      target.second - (solution.rig().targets[target.first].link < 0 ? kRigid : 0));
  }
  return out;
}

/// What was found before any fit, as one warning, with one cure a kind.
Notice warning_of(NoticeKind kind, const std::vector<const Notice*>& findings) {
  Notice out = make_notice(kind, {}, "");
  std::set<NoticeKind> cured;
  for (const Notice* f : findings) {
    const std::string why = f->why.empty() ? "" : " (" + f->why + ")";
    out.what += (out.what.empty() ? "" : "; ") + f->what + why;
    if (cured.insert(f->kind).second) out.cure += (out.cure.empty() ? "" : "; ") + f->cure;
    out.where.insert(out.where.end(), f->where.begin(), f->where.end());
  }
  return out;
}

/// Whether a size or lens that came out as another did so on the automatic path, where nobody said
/// how well it is known.
bool nobody_freed(const Report& report, const std::string& number) {
  const Solution& solution = report.solution;
  if (report.automatic.empty()) return false;
  for (const PriorSetting& prior : solution.rig().priors)
    for (const Freed& f : solution.table().select(prior.pattern))
      if (number.rfind(solution.table().all[f.parameter].name, 0) == 0) return false;
  return true;
}

}  // namespace

void warn_of_input(const Notices& input, Notices& out) {
  std::vector<const Notice*> implausible, outside;
  for (const Notice& f : input)
    if (f.kind == NoticeKind::same_samples) {
      out.push_back(make_notice(NoticeKind::duplicates, f.where, f.what, f.why, f.cure));
      out.back().severity = f.severity;
    } else {
      (f.kind == NoticeKind::points_outside ? outside : implausible).push_back(&f);
    }
  if (!implausible.empty()) out.push_back(warning_of(NoticeKind::implausible, implausible));
  if (!outside.empty()) out.push_back(warning_of(NoticeKind::outside_image, outside));
}

void warn_of_few_data(const Solution& solution, Notices& out) {
  std::set<Component> held;
  for (const Prior& p : solution.setup.priors) held.insert({p.parameter, p.component});
  long unknowns = 0;
  for (const Component& c : solution.columns)
    unknowns += is_placing(solution.table().all[c.parameter].kind) && !held.count(c);
  const long numbers = placing_numbers(solution);
  const size_t samples = solution.training().size();
  const std::string of_samples =
      std::to_string(samples) + " training sample" + (samples == 1 ? "" : "s");
  if (unknowns > 0 && numbers <= unknowns) {
    out.push_back(
        make_notice(NoticeKind::few_data, {},
                    of_samples +
                        text(": %ld values determine relative poses (at most six per view), for "
                             "%ld unknowns without a prior: ",
                             numbers, unknowns) +
                        (numbers == unknowns ? "no degrees of freedom are left to check them"
                                             : "that is too few"),
                    "", "record more postures, or estimate fewer parameters"));
    out.back().severity = Severity::doubt;  // residuals as large as the noise say nothing then
  } else if (!(solution.dof_data > 0) && !solution.columns.empty()) {
    out.push_back(make_notice(NoticeKind::few_data, {},
                              of_samples + " have no more measured values than there are unknowns: "
                                           "no degrees of freedom are left to check these",
                              "", "record more, or estimate fewer parameters"));
  }
}

namespace {

constexpr double kNearReading = 4;           // sigmas of a difference
constexpr double kNoErrorsOfTheirOwn = 0.5;  // share of the scatter that sigmas allow
constexpr double kOftenRepeated = 3.5;       // samples a posture: sigmas are too small by its root

/// The squared differences of two samples' readings in sigmas of a difference, over the noisy
/// joints; infinite where the robot moved.
Mean reading_difference(const Rig& rig, const Sample& a, const Sample& b) {
  Mean out;
  const auto include = [&](double difference, double sigma) {
    if (std::isnan(difference)) difference = kInfinity;  // absent from one of the two
    if (!(std::abs(difference) <= std::sqrt(2.0) * kNearReading * sigma)) out.sum = kInfinity;
    if (sigma > 0) out.sum += difference * difference / (2 * sigma * sigma), ++out.count;
  };
  for (size_t i = 0; i < rig.joints.size() && out.sum < kInfinity; ++i) {
    const int j = static_cast<int>(i);
    const Joint& joint = rig.tree.joints[i];
    if (joint.axis_of_pose != PoseAxis::none) continue;
    if (joint.type == JointType::floating) {
      const Pose of_a = pose_reading(rig.tree, j, a.readings),
                 of_b = pose_reading(rig.tree, j, b.readings);
      if (!of_a.translation.allFinite() && !of_b.translation.allFinite()) continue;
      const Vector6d difference = log_se3(inverse(of_a) * of_b);
      for (int k = 0; k < kPoseAxes; ++k)
        include(difference(k), joint_sigma(rig, a, joint.first_axis + kPoseAxes + k));
    } else if (!std::isnan(a.readings[i]) || !std::isnan(b.readings[i])) {
      include(a.readings[i] - b.readings[i], joint_sigma(rig, a, j));
    }
  }
  return out;
}

bool same_readings(const Sample& a, const Sample& b) {
  return std::equal(a.readings.begin(), a.readings.end(), b.readings.begin(), b.readings.end(),
                    [](double x, double y) { return x == y || (std::isnan(x) && std::isnan(y)); });
}

/// The reading by which postures are sorted, and how far it may differ within one.
struct PostureOrder {
  size_t reading = 0;
  double window = kInfinity;
};

/// The order that leaves the fewest postures near each other: by the reading whose range is largest
/// beside its window. (The position of a floating joint differs by no more than the translation of
/// the twist between two poses, so by sqrt(3) of what each of its coordinates may.)
PostureOrder posture_order(const Rig& rig, const std::vector<Sample>& samples) {
  PostureOrder out;
  double best = 0;
  for (size_t i = 0; i < rig.joints.size(); ++i) {
    const Joint& joint = rig.tree.joints[i];
    const bool coordinate =
        joint.axis_of_pose == PoseAxis::reading && joint.type == JointType::prismatic;
    if (joint.type == JointType::floating || (joint.axis_of_pose != PoseAxis::none && !coordinate))
      continue;
    double least = kInfinity, most = -kInfinity, sigma = 0;
    for (const Sample& sample : samples) {
      if (std::isnan(sample.readings[i])) continue;
      least = std::min(least, sample.readings[i]);
      most = std::max(most, sample.readings[i]);
      if (!coordinate) sigma = std::max(sigma, joint_sigma(rig, sample, static_cast<int>(i)));
      const int errors = coordinate ? rig.tree.joints[joint.floating].first_axis + kPoseAxes : 0;
      for (int k = 0; coordinate && k < 3; ++k)
        sigma = std::max(sigma, std::sqrt(3.0) * joint_sigma(rig, sample, errors + k));
    }
    const double window = std::sqrt(2.0) * kNearReading * sigma * (1 + 1e-9);
    if (!(most - least > best * window)) continue;
    best = window > 0 ? (most - least) / window : kInfinity;
    out = {i, window};
  }
  return out;
}

/// The postures of the training samples: readings that are equal, or near. `scatter`: of the
/// readings of one posture, over what their sigmas make of it.
size_t distinct_postures(const Recording& recording, Mean& scatter) {
  const PostureOrder order = posture_order(recording.rig, recording.samples);
  std::multimap<double, int> postures;  // by that reading
  std::vector<int> without;             // postures that lack it
  std::vector<int> near;
  for (const int i : recording.training()) {
    const Sample& sample = recording.samples[i];
    const double reading = sample.readings.empty() ? kNan : sample.readings[order.reading];
    near.clear();
    if (std::isnan(reading)) {
      near = without;
    } else {
      const auto end = postures.upper_bound(reading + order.window);
      for (auto at = postures.lower_bound(reading - order.window); at != end; ++at)
        near.push_back(at->second);
      std::sort(near.begin(), near.end());
    }
    const bool known = std::any_of(near.begin(), near.end(), [&](int index) {
      const Sample& other = recording.samples[index];
      if (same_readings(other, sample)) {
        ++scatter.count;
        return true;
      }
      const Mean difference = reading_difference(recording.rig, other, sample);
      const bool same = difference.sum < kInfinity;
      if (same) scatter.sum += difference.sum, scatter.count += difference.count;
      return same;
    });
    if (known) continue;
    if (std::isnan(reading))
      without.push_back(i);
    else
      postures.insert({reading, i});
  }
  return postures.size() + without.size();
}

}  // namespace

void warn_of_repetition(const Recording& recording, Notices& out) {
  const std::vector<JointSettings>& joints = recording.rig.joints;
  const size_t samples = recording.training().size();
  const bool noisy =
      std::any_of(joints.begin(), joints.end(), [](const JointSettings& j) { return j.sigma > 0; });
  if (!noisy) return;
  Mean scatter;
  const size_t distinct = distinct_postures(recording, scatter);
  if (distinct <= 1 || 2 * samples <= 3 * distinct || !(scatter.value() < kNoErrorsOfTheirOwn))
    return;
  const double each = static_cast<double>(samples) / static_cast<double>(distinct);
  out.push_back(make_notice(
      NoticeKind::repeated, {},
      text("%d samples were taken at %d postures, by readings that %s", static_cast<int>(samples),
           static_cast<int>(distinct),
           scatter.sum > 0 ? "differ by far less than their sigmas allow" : "are exactly equal"),
      text("each counts as if its errors were independent, so sigmas may be %.1f times too small",
           std::sqrt(each)),
      "let the robot move between samples, or keep one of each posture"));
  if (each > kOftenRepeated) out.back().severity = Severity::doubt;
}

void warn_of_unseen(const Solution& solution, Notices& out) {
  const UnseenPoses unseen = unseen_poses(solution);
  std::set<int> held_out;
  for (const Sample& sample : solution.samples())
    for (const View& view : sample.views)
      held_out.insert(
          {solution.table().sensor_pose[view.sensor], solution.table().target_pose[view.target]});
  Notice all = make_notice(NoticeKind::never_seen, {}, "");
  const auto add = [&](const std::vector<int>& poses, bool shown, const std::string& words,
                       const std::string& cure) {
    std::vector<std::string> names;
    for (const int p : poses)
      if ((held_out.count(p) > 0) == shown) names.push_back(solution.table().all[p].name);
    if (names.empty()) return;
    all.what += (all.what.empty() ? "" : ". ") + listed(names, kNamed) + ": " + words;
    all.cure += (all.cure.empty() ? "" : "; ") + cure;
    for (const std::string& name : names) all.where.push_back(Subject::parameter(name));
  };
  const std::string none = "no training sample shows the object with this pose; ",
                    test =
                        "only held-out samples show the object with this pose; for the test it is "
                        "estimated from them alone, and the result ";
  add(unseen.open, false,
      none + "it and everything that depends on it are unknown (the result has the identity)",
      "record samples that show it, or delete it from the rig");
  add(unseen.given, false, none + "it keeps the rig's value, which predictions take as exact",
      "to estimate it, record samples that show it");
  add(unseen.open, true, test + "has no pose of it (the identity)",
      "nothing, if it is only for tests; to have its pose estimated, let training samples show it");
  add(unseen.given, true, test + "keeps the rig's value, which predictions take as exact",
      "nothing, if it is only for tests; to have it estimated, let training samples show it");
  if (!all.what.empty()) out.push_back(std::move(all));
}

void warn_of_unused_priors(const Solution& solution, Notices& out) {
  std::vector<PriorSetting> priors = solution.rig().priors;
  for (const Step& step : solution.rig().steps)
    if (!solution.prediction)  // else the steps are not the rig's
      priors.insert(priors.end(), step.priors.begin(), step.priors.end());
  if (priors.empty()) return;
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  setup.sensors = indices(solution.rig().sensors.size());
  const Estimation probe(*solution.recording, solution.training(), setup);
  if (probe.groups().empty()) return;
  const std::vector<char> matters = probe.influencing();
  std::vector<std::string> unused;
  for (const PriorSetting& prior : priors) {
    const std::vector<Freed> covered = solution.table().select(prior.pattern);
    if (std::none_of(covered.begin(), covered.end(),
                     [&](const Freed& f) { return matters[f.parameter]; }) &&
        std::count(unused.begin(), unused.end(), prior.pattern) == 0)
      unused.push_back(prior.pattern);
  }
  if (unused.empty()) return;
  out.push_back(make_notice(NoticeKind::unused_prior, subjects(Subject::Kind::prior, unused),
                            "the prior on " + listed(unused, kNamed) +
                                " has no effect: no training measurement depends on its parameter, "
                                "which keeps the rig's value"));
}

void warn_of_rescaled(const Report& report, Notices& out) {
  const Solution& solution = report.solution;
  std::vector<WarningItem> cases;
  const auto add = [&](ParameterKind kind, const std::string& name, double given, double value) {
    const bool lens = kind == ParameterKind::intrinsics;
    const std::string unit = lens ? " px" : " m";
    const double factor = std::abs(value / given);
    const double times = std::max(factor, 1 / factor);
    if (!(given != 0) || !(times > 1 + scales(kind, lens ? "px" : "m").reported)) return;
    cases.push_back({Subject::parameter(name),
                     name + text(" is %.4g", value) + unit + text(" in the result, %.4g", given) +
                         unit + text(" in the rig (%.4g times): ", factor) +
                         (times > kRescaled ? "correct the rig; the unit may be wrong"
                          : lens ? "give the intrinsics of this camera and resolution in the rig"
                                 : "measure it, and correct the rig"),
                     std::abs(std::log(factor))});
  };
  for (const ParameterEstimate& e : solution.parameters) {
    // (A later step could not start; or a number of no table, as a host program may make it.)
    if (e.value.empty() || e.parameter < 0) continue;
    const ParameterKind kind = solution.table().all[e.parameter].kind;
    const auto length = [](const std::vector<double>& v) {
      double sum = 0;
      for (double x : v) sum += x * x;
      return std::sqrt(sum);
    };
    if (kind == ParameterKind::points)
      add(kind, e.name, length(e.initial), length(e.value));
    else if (kind == ParameterKind::square)
      add(kind, e.name, e.initial[0], e.value[0]);
    else if (kind == ParameterKind::baseline)
      add(kind, e.component_name(0), e.initial[0], e.value[0]);
    else if (kind == ParameterKind::intrinsics)
      for (size_t c = 0; c < 2 && c < e.value.size(); ++c)
        add(kind, e.component_name(c), e.initial[c], e.value[c]);
  }
  if (cases.empty()) return;
  const bool freed_by_nobody = std::any_of(cases.begin(), cases.end(), [&](const WarningItem& c) {
    return nobody_freed(report, c.what.name);
  });
  out.push_back(notice_of(NoticeKind::rescaled, "sizes or focal lengths differ from the rig",
                          std::move(cases), "",
                          "measure the parameter that differs, and correct the rig"));
  out.back().otherwise =
      "or state its uncertainty (priors); a wrong length of the robot has the same effect";
  if (freed_by_nobody) out.back().severity = Severity::doubt;
}

Notice identity_notice(const Solution& solution, const std::string& name) {
  std::vector<std::string> held, prior;
  for (const ParameterEstimate& e : solution.parameters)
    for (size_t c = 0; e.name == name && c < e.components.size(); ++c) {
      if (!e.freed[c]) held.push_back(e.components[c]);
      if (e.prior[c] > 0) prior.push_back(e.components[c]);
    }
  std::string why = "one of its coordinates is fixed, or it has a prior";
  if (!held.empty()) why = "its " + listed(held, 6) + (held.size() > 1 ? " are" : " is") + " fixed";
  if (held.empty() && !prior.empty()) why = "it has a prior";
  return make_notice(NoticeKind::identity, {Subject::parameter(name)},
                     name + " is missing in the rig, and " + why +
                         ": the fixed value or the prior is that of the identity, which is "
                         "unlikely to be its pose",
                     "", "give it a pose in the rig, or estimate all of it without a prior");
}

std::optional<Notice> counts_from_identity(const Solution& solution) {
  if (solution.identity_starts.empty()) return std::nullopt;
  return identity_notice(solution, solution.identity_starts[0]);
}

const Notice* first_mistake(const Report& report) {
  if (!report.diagnosis) return nullptr;
  for (const Notice& f : report.diagnosis->findings)
    if (can_spoil_the_fit(f.kind)) return &f;
  return nullptr;
}

bool has_redescending_loss(const Solution& solution, const std::string& name) {
  for (const Step& step : solution.rig().steps)
    if (step.name == name)
      return step.loss &&
             (step.loss->kind == LossKind::tukey || step.loss->kind == LossKind::cauchy);
  return false;
}

}  // namespace kincal
