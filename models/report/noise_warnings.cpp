#include "noise_warnings.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "../../kinematics/floating.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "warning_items.h"

namespace kincal {
namespace {

constexpr double kOneFactor = 1.001;  // shares of what was stated that differ by less are the same

std::string level_name(const NoiseLevel& level) {
  return level.of + (level.part.empty() ? "" : " " + level.part);
}

/// "joint/elbow: 0.0002 rad, stated 0.0001".
std::string level_text(const NoiseLevel& level) {
  constexpr double kMostTried = 9.99;
  const std::string value = level_name(level) + text(": %.3g ", level.used) + level.unit;
  return value + text(", stated %.3g", level.assumed) +
         (std::abs(std::log(level.used / level.assumed)) > std::log(kMostTried)
              ? " (at most a factor of ten is tried: state a value nearer to the truth)"
              : "");
}

/// Two digits without an exponent, which some readers of YAML take for a text.
std::string plain_digits(double value) {
  return text("%.*f", std::max(0, 1 - static_cast<int>(std::floor(std::log10(value)))), value);
}

/// How many times noisier than it is used a stated level may be: as the data show it, or as much as
/// they leave open (95 %), at most as stated.
double times_noisier(const NoiseLevel& level) {
  const double stated = level.assumed / level.used;
  if (!std::isfinite(level.seen)) return stated;
  const double seen = level.seen / level.used;
  return std::max(seen, std::min(stated, seen * std::exp(2 * level.uncertainty)));
}

/// Stated levels that may be twice as noisy as one factor for all sigmas makes them: only others
/// have been stated too noisy then, and sigmas of the result are too small. `most`: how many times.
std::vector<std::string> noisier_levels(const Report& report, double& most) {
  constexpr double kNoisier = 2;
  std::vector<std::string> out;
  most = 1;
  for (const NoiseLevel& level : report.noise_levels) {
    if (level.guess > 0 || !(times_noisier(level) > kNoisier)) continue;
    most = std::max(most, times_noisier(level));
    out.push_back(level_name(level) + text(" (up to %.2g ", times_noisier(level) * level.used) +
                  level.unit + ")");
  }
  return out;
}

std::string noisier_text(const Report& report) {
  double most;
  const std::vector<std::string> levels = noisier_levels(report, most);
  return levels.empty() ? ""
                        : text(
                              ". Sigmas of the result may be up to %.2g times too small, because "
                              "the data allow more noise than that: ",
                              most) +
                              listed(levels, kNamed) +
                              ". State the true sigmas, or let the noise be estimated "
                              "(`estimate_noise`)";
}

/// How much of what was stated is used, of the levels of a report: the least and the most.
std::pair<double, double> used_shares(const Report& report) {
  std::pair<double, double> out{kInfinity, 0};
  for (const NoiseLevel& level : report.noise_levels) {
    if (level.guess > 0) continue;
    const double share = level.used / level.assumed;
    out = {std::min(out.first, share), std::max(out.second, share)};
  }
  return out;
}

/// Whether predicted errors allow for errors of poses that depend on the pose: of this floating
/// joint.
bool is_predicted(const Report& report, int joint) {
  return std::any_of(report.pose_errors.begin(), report.pose_errors.end(),
                     [&](const PoseErrors& e) { return e.joint == joint; });
}

/// Whether the rig states the noise of a floating joint.
bool states_noise(const Report& report, int joint) {
  const Rig& rig = report.solution.rig();
  return rig.joints[rig.tree.joints[joint].first_axis + kPoseAxes].noise_guess == 0;
}

/// Of poses of a flange whose noise nobody stated: what was found and is more than robots repeat
/// by.
std::string beyond_repeating(const Report& report) {
  constexpr double kRepeats = 2e-4;  // m, rad
  std::string out;
  for (const NoiseLevel& level : report.noise_levels)
    if (level.guess > 0 && level.joint >= 0 &&
        report.solution.rig().tree.joints[level.joint].floating >= 0 && level.used > kRepeats)
      out += (out.empty() ? "" : " and ") + text("%.2g m", 1e3 * level.used) + level.unit;
  return out;
}

/// Whether noise that somebody stated was found to be larger, by more than such an estimate is off.
bool any_stated_is_larger(const Report& report) {
  constexpr double kLarger = 1.1;
  return std::any_of(report.noise_levels.begin(), report.noise_levels.end(),
                     [](const NoiseLevel& level) {
                       return level.guess == 0 && level.used > kLarger * level.assumed;
                     });
}

/// Whether residuals were larger than stated, so that all that the model lacks counts as noise.
bool taken_for_noise(const Report& report) {
  return report.noise_estimated && report.noise_estimated->stated > 1;
}

/// What is furthest from what was stated of its noise.
std::string noisiest_words(const Report& report) {
  const NoiseLevel* worst = nullptr;
  for (const NoiseLevel& l : report.noise_levels)
    if (l.guess == 0 && l.used > l.assumed &&
        (!worst || l.used * worst->assumed > worst->used * l.assumed))
      worst = &l;
  return worst ? text(". Furthest off is %s (%.2g times)", worst->of.c_str(),
                      worst->used / worst->assumed)
               : "";
}

/// Of the automatic path: that noise is not as stated, then level by level, or all by one factor.
std::vector<std::string> stated_noise_texts(const Report& report, Subjects& where) {
  std::string all;
  const auto [least, most] = used_shares(report);
  for (const NoiseLevel& level : report.noise_levels) {
    if (level.guess > 0 || level.used == level.assumed) continue;
    where.push_back({Subject::Kind::part, level_name(level)});
    all += (all.empty() ? "" : "; ") + level_text(level);
  }
  if (all.empty()) return {};
  const std::string begin =
      text("with the stated sigmas chi2/dof is %.3g", report.noise_estimated->stated);
  if (most < 1 && most < kOneFactor * least)
    return {begin + ": errors are smaller than stated",
            text("all sigmas were multiplied by %.2g (", most) + all +
                "); the rig of the result has the scaled sigmas. Stated and scaled sigmas give the "
                "same estimates" +
                (noise_is_doubtful(report) ? noisier_text(report) : "")};
  return {
      (taken_for_noise(report) ? "residuals are larger than the stated noise allows (" + begin + ")"
                               : begin) +
          ", and no mistake explains this",
      "sigmas were estimated from the data, and the rig of the result has these. Are they "
      "plausible? " +
          all};
}

/// Noise that nobody states, as it was found: each level with the interval that has it with 95 %.
std::string guessed_noise_text(const Report& report, Subjects& where) {
  constexpr double kHides = 0.75;  // of a logarithm; half of what the guess alone leaves open
  std::vector<std::string> all;
  for (const NoiseLevel& level : report.noise_levels) {
    const auto [low, high] = level.interval();
    if (level.guess == 0 || level.uncertainty > kHides) continue;  // (behind that of others)
    where.push_back({Subject::Kind::part, level_name(level)});
    all.push_back(level_name(level) + text(" %.2g ", level.used) + level.unit +
                  text(" (%.2g to %.2g)", low, high));
  }
  return all.empty() ? ""
                     : "the rig does not state the noise, so it was found from the data: " +
                           listed(all, kNamed);
}

/// A level that came out so much larger than such noise is that it is hardly noise; null: none.
const NoiseLevel* beyond_noise(const Report& report) {
  // Times the guess: 6 px, 6 mrad. No sensor or joint that works is so noisy; true noise of ten
  // times the guess came out above it in none of 300 recordings (benchmarks/README.md).
  constexpr double kLargest = 30;
  for (const NoiseLevel& level : report.noise_levels)
    if (level.guess > 0 && level.used > kLargest * level.guess) return &level;
  return nullptr;
}

bool is_kept(const NoiseLevel& level) { return std::isnan(level.seen) && level.assumed > 0; }

/// The sensor that --estimate-noise found far noisier than stated while it kept the noise of
/// joints, which these data do not determine: it may have theirs. Null: none.
const NoiseLevel* blamed_for_joints(const Report& report) {
  constexpr double kFarNoisier = 1.5;
  const bool explicitly = report.noise_estimated && !std::isfinite(report.noise_estimated->stated);
  if (!explicitly || std::none_of(report.noise_levels.begin(), report.noise_levels.end(),
                                  [](const NoiseLevel& l) { return l.joint >= 0 && is_kept(l); }))
    return nullptr;
  const NoiseLevel* out = nullptr;
  for (const NoiseLevel& l : report.noise_levels)
    if (l.sensor >= 0 && l.used > kFarNoisier * l.assumed &&
        (!out || l.used * out->assumed > out->used * l.assumed))
      out = &l;
  return out;
}

/// What to write into a rig for the noise of its sensors, as the data show it.
std::string sensors_as_seen(const Report& report) {
  std::map<std::string, std::string> sigmas;  // of a sensor
  for (const NoiseLevel& level : report.noise_levels) {
    if (level.sensor < 0) continue;
    std::string& sigma = sigmas[level.of.substr(level.of.find('/') + 1)];
    sigma += (sigma.empty() ? "" : ", ") + (level.part.empty() ? "" : level.part + ": ") +
             plain_digits(std::isfinite(level.seen) ? level.seen : level.used);
  }
  std::string out;
  for (const auto& [sensor, sigma] : sigmas)
    out += (out.empty() ? "" : ", ") + sensor +
           ": {sigma: " + (sigma.find(':') == std::string::npos ? sigma : "{" + sigma + "}") + "}";
  const bool own = std::any_of(report.noise_levels.begin(), report.noise_levels.end(),
                               [](const NoiseLevel& l) { return l.own_views > 0; });
  return "sensors: {" + out + "}" +
         (own ? ", and create the samples again with it (import, detect --sigma), because their "
                "views have their own sigmas"
              : "");
}

/// Whether a trend is of the poses of a flange, not of a joint's readings.
bool tells_flange(const Trend& trend, const Tree& tree) {
  return tree.joints[trend.joint].type == JointType::floating;
}

}  // namespace

std::string own_errors_words(const Report& report) {
  const std::string by = beyond_repeating(report);
  if (by.empty()) return "";
  return report.pose_errors.empty()
             ? "this is valid if the error of the flange poses (" + by +
                   ") is noise and not the robot's own inaccuracy"
             : "the error of the flange poses (" + by +
                   ") may be the robot's own inaccuracy, which more poses do not average out: "
                   "predicted errors allow for this";
}

bool noise_is_doubtful(const Report& report) {
  constexpr double kLarger = 1.25;  // chi2/dof
  if (blamed_for_joints(report)) return true;
  if (!report.noise_estimated || !std::isfinite(report.noise_estimated->stated)) return false;
  if (report.noise_estimated->stated > kLarger && any_stated_is_larger(report)) return true;
  std::set<std::string> kinds;  // that are stated apart: of joints, of sensors by their unit
  for (const NoiseLevel& level : report.noise_levels)
    if (level.guess == 0) kinds.insert(level.joint >= 0 ? "joints" : level.unit);
  const auto [least, most] = used_shares(report);
  double times;
  return kinds.size() > 1 && most < 1 && most < kOneFactor * least &&
         !noisier_levels(report, times).empty();
}

void warn_of_trends(const Report& report, Notices& out) {
  const Tree& tree = report.solution.rig().tree;
  std::vector<WarningItem> cases;
  for (const Trend& trend : report.trends) {
    const Joint& joint = tree.joints[trend.joint];
    const bool flange = tells_flange(trend, tree);
    const std::string shift = trend.shift > 0 ? text("%.3g mm", 1e3 * trend.shift) : "",
                      turn = trend.turn > 0 ? text("%.3g mrad", 1e3 * trend.turn) : "",
                      both = shift.empty() || turn.empty() ? "" : ", ";
    cases.push_back({Subject::joint(joint.name),
                     std::string("the errors of the ") + (flange ? "poses" : "readings") +
                         " of joint " + quoted(joint.name) + " depend on its position (" + shift +
                         both + turn + text(", up to %.0f %% of their scatter)", 100 * trend.share),
                     trend.clear});
  }
  if (cases.empty()) return;
  const bool flange = tells_flange(report.trends.front(), tree),
             predicted =
                 std::all_of(report.trends.begin(), report.trends.end(),
                             [&](const Trend&trend) { return is_predicted(report, trend.joint); });
  out.push_back(notice_of(
      NoticeKind::systematic, "joints have errors that depend on their position", std::move(cases),
      std::string("this is not noise but ") +
          (flange ? "the robot's own inaccuracy, for example wrong joint zeros, which more poses "
                    "do not average out"
                  : "an effect that the rig does not model: a gear, sag, bending or play") +
          (predicted
               ? ". Predicted errors allow for this"
               : ". It is counted as noise, so the sigmas of the result are too small even if "
                 "chi2/dof is near 1: errors may be several sigmas, most of all away from the "
                 "recorded postures"),
      flange
          ? "record the joint readings and calibrate with the robot's URDF, so that its zeros "
            "are estimated too, or set the robot's zeros again"
          : "estimate the effects that the rig can express (gears: `joint/*/scale`; error curves: "
            "`model: curve`), and look for bending or loose parts"));
  // (Stated noise that they contradict stays in doubt, and this is why.)
  if (predicted && !states_noise(report, report.trends.front().joint))
    out.back().severity = Severity::remark;
  else if (!predicted)
    out.back().otherwise = "otherwise use the result only near the recorded poses";
}

void warn_of_jumps(const Report& report, Notices& out) {
  if (report.jumps.empty()) return;
  const Tree& tree = report.solution.rig().tree;
  const Jump& first = report.jumps.front();
  std::vector<std::string> joints;
  for (const Jump& jump : report.jumps) {
    const std::string name = tree.joints[tree.find_joint(read_name(tree, jump.joint))].name;
    if (!std::count(joints.begin(), joints.end(), name)) joints.push_back(name);
  }
  const bool slides = tree.joints[first.joint].type == JointType::prismatic;
  out.push_back(make_notice(
      NoticeKind::jump, subjects(Subject::Kind::joint, joints),
      "the errors of joint " + quoted(joints.front()) + " jump by at least " +
          text("%.3g %s", 1e3 * std::abs(first.by), slides ? "mm" : "mrad") + " from sample " +
          quoted(report.solution.samples()[first.sample].id) + " on" +
          (joints.size() > 1
               ? " (and those of " + listed({joints.begin() + 1, joints.end()}, kNamed) + ")"
               : std::string()),
      "something changed there: a joint was homed again, a sensor or target was bumped, or it is "
      "another robot. The change is counted as noise, so the sigmas of the result are too small",
      "calibrate the samples before that one and those from it on separately, and compare the two "
      "(diff)"));
}

void warn_of_quiet_joints(const Report& report, Notices& out) {
  std::vector<std::string> joints;
  Subjects where;
  for (const NoiseLevel& level : report.noise_levels) {
    if (level.joint < 0 || level.guess > 0 || level.used != level.assumed || !level.differs() ||
        !(kNoisy * level.seen < level.assumed))
      continue;
    where.push_back({Subject::Kind::part, level_name(level)});
    joints.push_back(level_name(level) +
                     text(" (stated %.3g, seen %.2g ", level.assumed, level.seen) + level.unit +
                     ")");
  }
  if (joints.empty()) return;
  out.push_back(make_notice(
      NoticeKind::quiet_joints, std::move(where),
      std::to_string(joints.size()) + (joints.size() == 1 ? " joint is" : " joints are") +
          " at most a third as noisy as stated: " + listed(joints, kNamed),
      "overstated noise hides information about the robot",
      "state the estimated noise, or let it be estimated (`estimate_noise`), and calibrate again"));
}

void warn_of_guessed_noise(const Report& report, Notices& out) {
  Subjects where;
  std::string found = guessed_noise_text(report, where);
  if (found.empty()) return;
  Notice notice = make_notice(NoticeKind::noise, std::move(where), std::move(found));
  if (const NoiseLevel* level = beyond_noise(report)) {
    notice.severity = Severity::doubt;
    notice.why = std::move(notice.what);
    notice.what =
        level_name(*level) + text(" is %.2g ", level->used) + level->unit +
        text(" off, %.0f times the usual noise, if it is noise", level->used / level->guess);
    notice.cure =
        "state the noise in the rig if it is that large; otherwise look for a mistake (`check`)";
  } else if (const std::string by = beyond_repeating(report); !by.empty()) {
    notice.why =
        "robots repeat better than that: if it is not noise but the robot's own inaccuracy (zeros "
        "of its joints, lengths), more poses do not average it out" +
        std::string(report.pose_errors.empty() ? ", and the sigmas of the result are too small"
                                               : ". Predicted errors allow for this");
  }
  out.push_back(std::move(notice));
}

void warn_of_noise(const Report& report, Notices& out) {
  warn_of_guessed_noise(report, out);
  if (!report.noise_estimated) return;
  Subjects where;
  std::vector<std::string> all;  // what is the case, then why
  if (std::isfinite(report.noise_estimated->stated)) all = stated_noise_texts(report, where);
  std::vector<std::string> kept;
  for (const NoiseLevel& level : report.noise_levels)
    if (is_kept(level) && !std::isfinite(report.noise_estimated->stated)) {
      kept.push_back(level_name(level) + text(" (%.3g ", level.assumed) + level.unit + ")");
      where.push_back({Subject::Kind::part, level_name(level)});
    }
  if (!kept.empty()) {
    all.push_back("these data do not determine the noise of " + listed(kept, kNamed) +
                  ": the stated value was kept");
    if (const NoiseLevel* blamed = blamed_for_joints(report))
      all.push_back(level_name(*blamed) +
                    text(" came out %.2g times as noisy as stated: if this is noise of these "
                         "joints, sigmas of the result are far too small",
                         blamed->used / blamed->assumed));
  }
  if (!report.noise_estimated->converged)
    all.push_back(
        "the estimate of the noise did not converge: model errors are attributed to noise of "
        "changing sources");
  for (const NoiseLevel& level : report.noise_levels)
    if (level.own_views > 0 && level.used != level.assumed && level.first == 0)
      all.push_back(level.of + ": " + std::to_string(level.own_views) +
                    (level.own_views == 1 ? " view has" : " views have") +
                    " their own sigmas in the samples file; they were multiplied by the sensor's "
                    "factor. The file is unchanged and overrides the rig's sigma: create it again "
                    "with the new sigma (import, detect --sigma)");
  if (all.empty()) return;
  Notice noise = make_notice(NoticeKind::noise, std::move(where), all[0]);
  for (size_t i = 1; i < all.size(); ++i) noise.why += (i > 1 ? ". " : "") + capital(all[i]);
  if (noise_is_doubtful(report)) {
    noise.severity = Severity::doubt;
    const bool lacks = taken_for_noise(report);
    noise.cure = lacks ? "state the noise in the rig, if joints and sensors are that noisy"
                       : "state the known noise in the rig";
    noise.otherwise = lacks ? "otherwise the robot has errors that are not estimated (play, "
                              "bending, late readings, a sensor error), and sigmas are too small" +
                                  noisiest_words(report)
                            : "if that of the joints is right: " + sensors_as_seen(report);
    if (lacks && neighbours_err_alike(report.solution.samples(), report.residuals.after))
      say_no_noise(noise);
  }
  out.push_back(std::move(noise));
}

}  // namespace kincal
