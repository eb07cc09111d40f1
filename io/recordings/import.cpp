#include "import.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <set>

#include "../../models/automatic/automatic.h"
#include "../../models/fitting/numbering.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/targets.h"
#include "../document/error.h"
#include "../document/files.h"
#include "../document/names.h"
#include "held_targets.h"
#include "raw_image.h"
#include "robot_readings.h"
#include "still_scans.h"

namespace kincal {
namespace {

constexpr double kRestMargin = 0.1, kRestMarginShare = 0.15;  // s, of a rest, cut off at both ends
constexpr double kStillFrames = 3;                            // in scatters
constexpr double kNoNoise = 2;                                // px of scatter
constexpr double kHarmless = 1. / 3;                          // of the rig's sigma
constexpr double kMarginOfTilt = 0.2;                         // s, of readings around a sweep
constexpr double kMostImages = 3000, kImageRate = 5;  // of a camera, where no joints tell; Hz
constexpr double kStillShare = 0.1;                   // of such a recording's frames rest, at least
constexpr size_t kMostNamed = 8;                      // rests in one line
constexpr double kNoFit = 100;                        // chi2/dof that no noise explains
constexpr double kRestOfView = 0.5;                   // of a rest's frames are still at least

std::string at_time(double time) {
  char text[32];
  std::snprintf(text, sizeof text, "(at %.1f s)", time);
  return text;
}

/// The first of some rests.
std::string few_of(std::vector<std::string> rests) {
  const bool more = rests.size() > kMostNamed;
  if (more) rests.resize(kMostNamed);
  return comma_separated(rests) + (more ? ", ..." : "");
}

/// The frames of one target before one camera in one rest.
using FramesOfRest = std::map<int, std::vector<CornerFrame>>;       // by rest
using FramesOfViews = std::map<std::pair<int, int>, FramesOfRest>;  // by sensor and target

struct Importer {
  const std::vector<std::string>& bags;
  const RigFile& rig_file;
  const Rig& rig;
  RecordedStreams& streams;
  const TargetSearch* search;
  const ImportOptions& options;
  TopicMap topics;
  RobotReadings readings;
  Intervals rests;
  LookedAt looked;
  RecordedSamples out;
  std::vector<int> rest_of_sample;
  std::map<int, TimeOffset> applied;  // by sensor

  Importer(const std::vector<std::string>& of, const RigFile& file, RecordedStreams& in,
           const TargetSearch* finder, const ImportOptions& how)
      : bags(of),
        rig_file(file),
        rig(file.rig),
        streams(in),
        search(finder),
        options(how),
        topics(find_topics(file, in)),
        readings(file.rig, in, topics) {
    out.lines = topics.lines;
    out.notes = topics.notes;
    for (const std::string& note : readings.absences()) out.notes.push_back(note);
  }

  const std::string& name(int sensor) const {
    return rig.sensors[static_cast<size_t>(sensor)].name;
  }

  TimeInterval recorded() const {
    TimeInterval all{0, streams.duration};
    for (const ImageStream& s : streams.images)
      for (const double t : s.times)
        all.begin = std::min(all.begin, t), all.end = std::max(all.end, t);
    return readings.any() ? readings.span() : all;
  }

  // ---------------------------------------------------------------------------------------- rests
  void find_rests() {
    if (!readings.any()) {  // the images will tell
      rests = {recorded()};
      return;
    }
    const Intervals still = readings.still(recorded(), options.still_joints);
    std::vector<std::string> creeping;
    for (const TimeInterval& band : still) {
      if (band.length() < options.rest) continue;
      const TimeInterval one = readings.without_slow_ends(band, options.still_joints);
      if (one.length() < options.rest) {
        creeping.push_back(at_time(band.begin));
        continue;
      }
      const double margin = std::min(kRestMargin, kRestMarginShare * one.length());
      rests.push_back({one.begin + margin, one.end - margin});
    }
    char text[120];
    std::snprintf(text, sizeof text, "rests of the joints: %zu of %.3g s at least, of %.4g s",
                  rests.size(), options.rest, streams.duration);
    out.lines.emplace_back(text);
    if (!creeping.empty())
      out.lines.push_back("left out, too short without the slow ends of ways: " + few_of(creeping));
    if (rests.empty()) out.diagnosis = readings.restless(options.rest, options.still_joints);
  }

  // ---------------------------------------------------------------------------------------- images
  bool any_images() const {
    return std::any_of(topics.images.begin(), topics.images.end(), [](int i) { return i >= 0; });
  }

  void look() {
    LookOptions how = options.look;
    if (!options.offsets && !options.apply_offsets) how.on_way = 0;
    if (!readings.any()) {
      how.in_rest = std::max(
          how.in_rest, static_cast<int>(std::min(kMostImages, kImageRate * rests[0].length())));
      how.on_way = 0;
      how.all_targets = true;
    }
    how.progress = [&](double share) {
      if (options.stage) options.stage("looking at images", share);
    };
    looked = look_at_images(bags, streams, topics.images, rests, *search, how);
    out.notes.insert(out.notes.end(), looked.notes.begin(), looked.notes.end());
    for (const std::string& note : search->agree(looked.sightings)) out.notes.push_back(note);
    if (!readings.any()) rests_of_images();
    std::map<int, std::set<std::pair<int, int>>> seen;
    for (const Sighting& one : looked.sightings)
      if (one.rest >= 0) seen[one.sensor].insert({one.rest, one.target});
    for (size_t s = 0; s < topics.images.size(); ++s)
      if (topics.images[s] >= 0) {
        std::map<int, int> rests_of_target;
        for (const auto& [rest, target] : seen[static_cast<int>(s)]) ++rests_of_target[target];
        std::string line = name(static_cast<int>(s)) + ": " + std::to_string(looked.images[s]) +
                           " images searched; ";
        if (rests_of_target.empty()) line += "no target seen";
        for (const auto& [target, count] : rests_of_target)
          line += (line.back() == ' ' ? "" : ", ") + rig.targets[static_cast<size_t>(target)].name +
                  " in " + std::to_string(count) + " rests";
        out.lines.push_back(line);
      }
  }

  /// Where no joints say when the robot rests: all targets that are seen stand still at once.
  void rests_of_images() {
    Intervals still{rests[0]};
    double quietest_frames = kInfinity;
    for (const auto& [which, by_rest] : frames()) {
      const std::vector<CornerFrame>& all = by_rest.at(0);
      const double sigma = rig.sensors[static_cast<size_t>(which.first)].sigma[0];
      const double scatter = corner_scatter({all}, kStillShare);
      const double tolerance = std::isnan(options.still_pixels)
                                   ? std::max(kStillFrames * scatter, kHarmless * sigma)
                                   : options.still_pixels;
      quietest_frames = std::min(quietest_frames, scatter);
      std::vector<double> times;
      for (const CornerFrame& frame : all) times.push_back(frame.time);
      const double gap = longest_gap(times);
      still = intersected(still,
                          united(still_frames(all, tolerance, gap),
                                 complement(coverage(times, gap), rests[0].begin, rests[0].end)));
    }
    rests.clear();
    for (const TimeInterval& one : still)
      if (one.length() >= options.rest) rests.push_back(one);
    for (Sighting& one : looked.sightings) {
      const double time = one.frame.time;
      const auto in = std::find_if(rests.begin(), rests.end(),
                                   [&](const TimeInterval& r) { return r.contains(time); });
      one.rest = in == rests.end() ? -1 : static_cast<int>(in - rests.begin());
    }
    char text[160];
    std::snprintf(text, sizeof text, "rests of what cameras see: %zu of %.3g s at least, of %.4g s",
                  rests.size(), options.rest, streams.duration);
    out.lines.emplace_back(text);
    if (!rests.empty()) return;
    if (std::isinf(quietest_frames))
      out.diagnosis = "no target was found in the images";
    else {
      std::snprintf(text, sizeof text,
                    "what cameras see is never still for %.3g s: from image to image it moves by "
                    "%.2g px in the quietest tenth of the time",
                    options.rest, quietest_frames);
      out.diagnosis = text;
    }
  }

  // ---------------------------------------------------------------------------------------- scans
  std::map<int, std::vector<View>> beam_views;  // by rest

  void look_at_scans() {
    if (std::all_of(topics.scans.begin(), topics.scans.end(), [](int i) { return i < 0; })) return;
    if (options.stage) options.stage("looking at scans", kNan);
    std::set<std::string> said;
    std::map<int, int> found, looked_in;                  // by sensor: rests
    std::map<int, std::map<std::string, int>> not_found;  // by sensor and reason: rests
    visit_scans(bags, streams, topics.scans, rests, [&](RestScans& scans) {
      const int joint = rig.sensors[static_cast<size_t>(scans.sensor)].scanning_joint;
      Sweep sweep;
      if (joint >= 0 && !scans.scans.empty()) {
        const Series& tilt = readings.series(joint);
        const TimeInterval& rest = rests[static_cast<size_t>(scans.rest)];
        for (size_t i = 0; i < tilt.size(); ++i)
          if (tilt.times[i] > rest.begin - kMarginOfTilt &&
              tilt.times[i] < rest.end + kMarginOfTilt)
            sweep.tilt.push_back({tilt.times[i], tilt.values[i]});
        sweep.scans = std::move(scans.scans);
      }
      std::vector<View>& views = beam_views[scans.rest];
      const size_t before = views.size();
      std::string why_not;
      for (int t = 0; t < static_cast<int>(rig.targets.size()); ++t) {
        BeamWords words;
        std::vector<View> some;
        if (!sweep.scans.empty() && !sweep.tilt.empty())
          some = search->sweep(scans.sensor, t, sweep, words);
        else if (!scans.cloud.points.empty())
          some = search->cloud(scans.sensor, t, scans.cloud, words);
        views.insert(views.end(), some.begin(), some.end());
        said.insert(words.doubts.begin(), words.doubts.end());
        if (!words.why_not.empty()) why_not = words.why_not;
      }
      ++looked_in[scans.sensor];
      if (views.size() > before)
        ++found[scans.sensor];
      else
        ++not_found[scans.sensor][why_not.empty() ? "no sweep of its joint" : why_not];
    });
    for (const auto& [sensor, count] : looked_in) {
      std::string line = name(sensor) + ": targets found in " + std::to_string(found[sensor]) +
                         " of " + std::to_string(count) + " rests";
      for (const auto& [why_not, rests_of] : not_found[sensor])
        line += "; in " + std::to_string(rests_of) + " not: " + why_not;
      if (found[sensor] < count)
        line +=
            " (where it is in sight: nearer, facing the laser, larger squares or slower sweeps)";
      out.lines.push_back(line);
    }
    out.notes.insert(out.notes.end(), said.begin(), said.end());
  }

  void add_beams(int rest, Sample& sample) {
    const auto found = beam_views.find(rest);
    if (found == beam_views.end()) return;
    for (const View& view : found->second)
      if (has_needed_readings(sample, view.sensor, view.target)) sample.views.push_back(view);
  }

  double stamp(int sensor, double time) const {
    const auto found = applied.find(sensor);
    return found == applied.end() ? time : time - found->second.at(time);
  }

  FramesOfViews frames() const {
    FramesOfViews all;
    for (const Sighting& one : looked.sightings) {
      if (one.rest < 0) continue;
      CornerFrame frame = one.frame;
      frame.time = stamp(one.sensor, frame.time);
      all[{one.sensor, one.target}][one.rest].push_back(std::move(frame));
    }
    for (auto& [view, by_rest] : all)
      for (auto& [rest, frames] : by_rest)
        std::stable_sort(
            frames.begin(), frames.end(),
            [](const CornerFrame& a, const CornerFrame& b) { return a.time < b.time; });
    return all;
  }

  /// What of a rest a view leaves: from its first to its last still frame, where others were not.
  static TimeInterval common(const TimeInterval& rest, const std::vector<CornerFrame>& frames,
                             const ViewRest& view) {
    TimeInterval left = rest;
    if (view.still.begin > frames.front().time) left.begin = std::max(left.begin, view.still.begin);
    if (view.still.end < frames.back().time) left.end = std::min(left.end, view.still.end);
    return left;
  }

  // ----------------------------------------------------------------------------------------
  // samples
  /// A view in the making.
  struct ViewOfRest {
    int sensor, target;
    const std::vector<CornerFrame>* frames;
  };

  bool has_needed_readings(const Sample& sample, int sensor, int target) {
    for (const int j : view_readings(rig, sensor, target)) {
      if (!std::isnan(sample.readings[static_cast<size_t>(j)])) continue;
      without_reading = rig.tree.joints[static_cast<size_t>(j)].name;
      ++views_without[{sensor, without_reading}];
      return false;
    }
    return true;
  }
  std::string without_reading;  // the joint that the last such view misses
  std::map<std::pair<int, std::string>, int> views_without;  // by sensor and joint

  void add_cameras(const std::vector<ViewOfRest>& views, const TimeInterval& over, Sample& sample) {
    for (const ViewOfRest& one : views) {
      const Sensor& sensor = rig.sensors[static_cast<size_t>(one.sensor)];
      const SettledCorners corners = average_corners(*one.frames, over);
      if (corners.ids.empty() || !has_needed_readings(sample, one.sensor, one.target)) continue;
      View view;
      view.sensor = one.sensor;
      view.target = one.target;
      view.ids = corners.ids;
      for (const double z : corners.pixels) view.z.push_back(std::round(z * 1e4) / 1e4);
      for (const double sigma : sensor.sigma) view.sigma.push_back(corners.sigma(sigma));
      sample.views.push_back(std::move(view));
    }
  }

  void add_poses(const TimeInterval& over, Sample& sample) {
    for (size_t s = 0; s < topics.poses.size(); ++s) {
      if (topics.poses[s].stream < 0) continue;
      const PoseStream& stream = streams.poses[static_cast<size_t>(topics.poses[s].stream)];
      const AveragePose mean = average_pose(stream, over);
      const int target = topics.pose_targets[s];
      if (mean.count == 0 || !has_needed_readings(sample, static_cast<int>(s), target)) continue;
      View view;
      view.sensor = static_cast<int>(s);
      view.target = target;
      const Eigen::Vector4d q = quaternion_from_rotation(mean.mean.rotation);
      const Vector3d& t = mean.mean.translation;
      view.z = {t.x(), t.y(), t.z(), q[0], q[1], q[2], q[3]};
      const std::vector<double>& sigma = rig.sensors[s].sigma;
      for (size_t k = 0; k < sigma.size(); ++k)
        view.sigma.push_back(
            Average{0, k < 3 ? mean.translation : mean.rotation, mean.count}.sigma(sigma[k]));
      sample.views.push_back(std::move(view));
    }
  }

  /// Takes out of the rest what poses do not stand still in.
  TimeInterval rest_of_poses(const TimeInterval& rest) const {
    TimeInterval left = rest;
    for (size_t s = 0; s < topics.poses.size(); ++s) {
      if (topics.poses[s].stream < 0) continue;
      const PoseStream& stream = streams.poses[static_cast<size_t>(topics.poses[s].stream)];
      const double gap = longest_gap(stream.times);
      Intervals still{left};
      for (const Series& series : pose_series(stream))
        still = intersected(still,
                            still_intervals(series, std::max(1e-9, still_tolerance(series)), gap));
      TimeInterval longest{left.begin, left.begin};
      for (const TimeInterval& one : still)
        if (one.length() > longest.length()) longest = one;
      if (longest.length() > kRestOfView * rest.length()) left = longest;
    }
    return left;
  }

  /// How far frames may be from their median, px. What is small in an image has more noise; but a
  /// rest of more than three times the usual is none.
  double frame_tolerance(double usual, double own, double sigma) const {
    if (!std::isnan(options.still_pixels)) return options.still_pixels;
    return std::max(kStillFrames * std::min(std::max(usual, own), 3 * usual), kHarmless * sigma);
  }

  void make_samples() {
    out.samples.clear();
    rest_of_sample.clear();
    moving_lines.clear();
    scatter_lines.clear();
    lost.clear();
    views_without.clear();
    const FramesOfViews all = frames();
    std::map<int, std::vector<ViewOfRest>> views;  // by rest
    std::vector<TimeInterval> over = rests;
    for (const auto& [which, by_rest] : all) {
      std::vector<std::vector<CornerFrame>> list;
      for (const auto& [rest, frames] : by_rest) list.push_back(frames);
      const Sensor& sensor = rig.sensors[static_cast<size_t>(which.first)];
      const double scatter = corner_scatter(list);
      say_scatter(which, scatter);
      int moving = 0;
      double least = kInfinity, allowed = 0;
      for (const auto& [rest, frames] : by_rest) {
        const double tolerance =
            frame_tolerance(scatter, corner_scatter({frames}), sensor.sigma[0]);
        allowed = std::max(allowed, tolerance);
        const ViewRest found = view_rest(frames, tolerance);
        const bool still = static_cast<double>(found.frames) >=
                           std::max(1., kRestOfView * static_cast<double>(frames.size()));
        least = std::min(least, found.motion);
        if (!still) {
          ++moving;
          lost[rest] = "what the cameras see moves";
          continue;
        }
        const auto r = static_cast<size_t>(rest);
        over[r] = common(over[r], frames, found);
        views[rest].push_back({which.first, which.second, &frames});
      }
      if (moving > 0) say_moving(which, moving, static_cast<int>(by_rest.size()), least, allowed);
    }
    for (size_t r = 0; r < rests.size(); ++r) {
      Sample sample;
      const TimeInterval interval = rest_of_poses(over[r]);
      std::string& why = lost.emplace(static_cast<int>(r), "no target is seen").first->second;
      if (interval.length() <= 0) {
        why = "what the sensors see is never still at once";
        continue;
      }
      readings.average(interval, sample);
      without_reading.clear();
      add_cameras(views[static_cast<int>(r)], interval, sample);
      add_poses(interval, sample);
      add_beams(static_cast<int>(r), sample);
      if (!without_reading.empty()) why = "joint '" + without_reading + "' has no reading then";
      if (sample.views.empty()) continue;
      lost.erase(static_cast<int>(r));
      sample.time =
          static_cast<double>(streams.origin) * 1e-9 + (interval.begin + interval.end) / 2;
      out.samples.push_back(std::move(sample));
      rest_of_sample.push_back(static_cast<int>(r));
    }
    number_boards();
    held_lines = add_holding_chains(rig, out.samples);
    for (size_t i = 0; i < out.samples.size(); ++i) {
      char id[32];
      std::snprintf(id, sizeof id, "rest_%04d", rest_of_sample[i] + 1);
      out.samples[i].id = id;
    }
  }

  std::vector<std::string> held_lines, moving_lines, scatter_lines;
  std::map<int, std::string> lost;  // by rest that no sample comes of: why

  std::vector<std::string> lost_lines() const {
    std::map<std::string, std::vector<std::string>> by_reason;
    for (const auto& [rest, why] : lost) {
      char text[32];
      std::snprintf(text, sizeof text, "rest_%04d ", rest + 1);
      by_reason[why].push_back(text + at_time(rests[static_cast<size_t>(rest)].begin));
    }
    std::vector<std::string> lines;
    for (const auto& [which, count] : views_without)
      lines.push_back(name(which.first) + ": " + std::to_string(count) +
                      " views left out, joint '" + which.second + "' has no reading then");
    for (const auto& [why, names] : by_reason)
      lines.push_back("left out, " + why + ": " + std::to_string(names.size()) + " of " +
                      std::to_string(rests.size()) + " rests: " + few_of(names));
    return lines;
  }

  void say_scatter(const std::pair<int, int>& view, double scatter) {
    if (scatter == 0) return;
    char text[300];
    if (scatter > kNoNoise) {
      std::snprintf(text, sizeof text,
                    "%s: corners of '%s' move by %.2g px from image to image while the joints "
                    "rest: no noise, but a board or camera that is not still, readings of another "
                    "time, or images of two recordings in one",
                    name(view.first).c_str(),
                    rig.targets[static_cast<size_t>(view.second)].name.c_str(), scatter);
      out.notes.emplace_back(text);
      return;
    }
    std::snprintf(
        text, sizeof text,
        "%s: corners of '%s' scatter by %.2g px from image to image; averages are better, and the "
        "rig's %.2g px are added",
        name(view.first).c_str(), rig.targets[static_cast<size_t>(view.second)].name.c_str(),
        scatter, rig.sensors[static_cast<size_t>(view.first)].sigma[0]);
    scatter_lines.emplace_back(text);
  }

  void say_moving(const std::pair<int, int>& view, int moving, int of, double least,
                  double tolerance) {
    char text[200];
    if (moving == of)
      std::snprintf(text, sizeof text,
                    "%s is never still while the joints are: motion %.2g px at least",
                    name(view.first).c_str(), least);
    else
      std::snprintf(text, sizeof text, "%s: not still in %d of %d rests", name(view.first).c_str(),
                    moving, of);
    std::string line = text;
    std::snprintf(text, sizeof text, " (of '%s'; %.2g px are taken for rest)",
                  rig.targets[static_cast<size_t>(view.second)].name.c_str(), tolerance);
    moving_lines.push_back(line + text);
  }

  void number_boards() {
    if (!search || search->open_turns.empty() || out.samples.size() < 3) return;
    static const int cosines[] = {1, 0, -1, 0};
    int turned = 0;
    for (const ViewTurn& one : agreeing_numbers(rig, out.samples, search->open_turns, {})) {
      if (one.quarters == 0) continue;
      const int c = cosines[one.quarters], s = cosines[(one.quarters + 3) % 4];
      Eigen::Matrix2d turn;
      turn << c, -s, s, c;
      View& view =
          out.samples[static_cast<size_t>(one.sample)].views[static_cast<size_t>(one.view)];
      const Target& target = rig.targets[static_cast<size_t>(view.target)];
      const std::vector<int> places = relabeling(target, turn);
      if (places.empty()) continue;
      relabel(view, target, places);
      ++turned;
    }
    if (turned > 0)
      numbered =
          "numbering of boards that look alike from several sides: " + std::to_string(turned) +
          " views were turned, by the joint readings";
  }
  std::string numbered;

  // ----------------------------------------------------------------------------------------
  // offsets
  std::vector<WaySighting> on_ways(int sensor) const {
    std::map<int, int> sample_of_rest;
    for (size_t i = 0; i < rest_of_sample.size(); ++i)
      sample_of_rest[rest_of_sample[i]] = static_cast<int>(i);
    std::vector<WaySighting> all;
    for (const Sighting& one : looked.sightings) {
      if (one.way_from < 0 || one.sensor != sensor) continue;
      const auto a = sample_of_rest.find(one.way_from), b = sample_of_rest.find(one.way_from + 1);
      if (a == sample_of_rest.end() || b == sample_of_rest.end()) continue;
      WaySighting seen{a->second, b->second, {}, one.frame.time};
      seen.view.sensor = sensor;
      seen.view.target = one.target;
      seen.view.ids = one.frame.ids;
      seen.view.z = one.frame.pixels;
      seen.view.sigma = rig.sensors[static_cast<size_t>(sensor)].sigma;
      all.push_back(std::move(seen));
    }
    return all;
  }

  /// @return why there is no solution; "": there is one
  std::string calibrate_for_offsets(const std::vector<Step>& steps, Solution& solution) const {
    Rig fitted = rig;
    fitted.steps = steps;
    try {
      CalibrationOptions how;
      how.threads = options.look.threads;
      solution = calibrate(make_recording(fitted, out.samples), how);
      return solution.usable() || solution.status == Status::not_converged ? "" : solution.message;
    } catch (const std::exception& error) {
      return error.what();
    }
  }

  /// What there is to say of rests that do not fit each other.
  static std::string unfit_rests(const Solution& solution) {
    const double per_dof = solution.chi2_per_dof();
    if (!(per_dof > kNoFit)) return "";
    char text[160];
    std::snprintf(
        text, sizeof text,
        ". The rests do not fit each other either (chi2/dof %.2g): a target was moved, or "
        "another mistake; `kincal check` looks for it",
        per_dof);
    return text;
  }

  void find_offsets() {
    if (options.stage) options.stage("comparing clocks", kNan);
    Solution solution;
    std::string why_not = rig.steps.empty() ? "" : calibrate_for_offsets(rig.steps, solution);
    if (rig.steps.empty() || !why_not.empty()) {  // the steps may free what is not seen here
      std::string without;
      try {
        without = calibrate_for_offsets(
            automatic_steps(Recording(rig, out.samples), AutomaticOptions{}), solution);
      } catch (const std::exception& error) {
        without = error.what();
      }
      if (without.empty() && !why_not.empty())
        out.lines.push_back("clocks are compared without the rig's steps: " + why_not);
      if (without.empty() || why_not.empty()) why_not = without;
    }
    for (size_t s = 0; s < topics.images.size(); ++s) {
      if (topics.images[s] < 0) continue;
      TimeOffset offset;
      offset.sensor = static_cast<int>(s);
      offset.why_not = why_not;
      if (why_not.empty()) {
        OffsetInput input{*solution.recording, solution.values,
                          [&](double time) { return readings.at(time); }, search->open_turns};
        offset = time_offset(input, static_cast<int>(s), on_ways(static_cast<int>(s)));
        if (!offset.why_not.empty()) offset.why_not += unfit_rests(solution);
      }
      out.offsets.push_back(offset);
    }
  }

  // ---------------------------------------------------------------------------------------- the
  // rest
  /// Postures that are there already: the same readings, and every view nearly the same.
  void leave_out_duplicates() {
    if (!(options.distinct > 0)) return;
    std::vector<Sample> kept;
    std::vector<int> kept_rests;
    for (size_t i = 0; i < out.samples.size(); ++i) {
      const bool there = std::any_of(kept.begin(), kept.end(), [&](const Sample& other) {
        return near(out.samples[i], other);
      });
      if (there) continue;
      kept.push_back(out.samples[i]);
      kept_rests.push_back(rest_of_sample[i]);
    }
    if (kept.size() < out.samples.size())
      out.lines.push_back("left out as postures that are there already: " +
                          std::to_string(out.samples.size() - kept.size()));
    out.samples = std::move(kept);
    rest_of_sample = std::move(kept_rests);
  }

  /// The joints that the views of a sample depend on.
  std::set<size_t> joints_of(const Sample& sample) const {
    std::set<size_t> all;
    for (const View& view : sample.views)
      for (const int j : view_readings(rig, view.sensor, view.target))
        all.insert(static_cast<size_t>(j));
    return all;
  }

  bool near(const Sample& a, const Sample& b) const {
    for (const size_t j : joints_of(a))
      if (std::isnan(a.readings[j]) != std::isnan(b.readings[j]) ||
          std::abs(a.readings[j] - b.readings[j]) > options.distinct)
        return false;
    if (a.views.size() != b.views.size()) return false;
    for (size_t v = 0; v < a.views.size(); ++v) {
      const View &x = a.views[v], &y = b.views[v];
      const Sensor& sensor = rig.sensors[static_cast<size_t>(x.sensor)];
      if (x.sensor != y.sensor || x.target != y.target || x.ids != y.ids) return false;
      const ParameterBlock* lens = find_block(sensor, ParameterKind::intrinsics);
      const double unit = lens ? lens->values[0] : 1;  // px a rad
      for (size_t k = 0; k < x.z.size(); ++k)
        if (std::abs(x.z[k] - y.z[k]) > options.distinct * unit) return false;
    }
    return true;
  }

  /// Where no images can be searched here: one of each rest and camera as a file, for `kincal
  /// detect`.
  void write_images() {
    namespace fs = std::filesystem;
    const fs::path folder = fs::absolute(options.out).lexically_normal().parent_path();
    fs::create_directories(options.image_folder);
    std::map<int, std::map<int, std::string>> written;  // by rest and sensor
    visit_middle_images(
        bags, streams, topics.images, rests,
        [&](int sensor, int rest, const MessageValue& image, bool compressed) {
          std::string text, ending = "pgm";
          if (compressed) {
            text = std::string(numbers_of(field(image, "data")).bytes);
            ending = compressed_format(text);
            if (ending.empty()) return;
          } else {
            text = pgm_file(grey_picture(image));
          }
          char file[64];
          std::snprintf(file, sizeof file, "rest_%04d_", rest + 1);
          const fs::path path =
              fs::path(options.image_folder) / (file + name(sensor) + "." + ending);
          write_file(path.string(), text, options.force);
          written[rest][sensor] = fs::absolute(path).lexically_normal().lexically_relative(folder);
        },
        nullptr);
    for (size_t r = 0; r < rests.size(); ++r) {
      Sample sample;
      char id[32];
      std::snprintf(id, sizeof id, "rest_%04zu", r + 1);
      sample.id = id;
      const TimeInterval interval = rest_of_poses(rests[r]);
      readings.average(interval, sample);
      std::vector<std::string> images;
      for (const auto& [sensor, path] : written[static_cast<int>(r)])
        for (size_t t = 0; t < rig.targets.size(); ++t) {
          if (rig.targets[t].type == "points") continue;
          View view;
          view.sensor = sensor;
          view.target = static_cast<int>(t);
          view.sigma = rig.sensors[static_cast<size_t>(sensor)].sigma;
          sample.views.push_back(std::move(view));
          images.push_back(path);
        }
      add_poses(interval, sample);
      if (sample.views.empty()) continue;
      sample.time =
          static_cast<double>(streams.origin) * 1e-9 + (interval.begin + interval.end) / 2;
      out.samples.push_back(std::move(sample));
      out.images.push_back(std::move(images));
    }
    out.lines.push_back("images are in " + options.image_folder +
                        ": this program was built without what searches them; `kincal detect` "
                        "does, in the samples");
  }

  void run() {
    find_rests();
    if (rests.empty()) return;
    if (!search && any_images()) return write_images();
    if (any_images()) look();
    if (rests.empty()) return;
    if (search) look_at_scans();
    make_samples();
    if (out.samples.empty()) {
      const std::vector<std::string> left_out = lost_lines();
      out.lines.insert(out.lines.end(), left_out.begin(), left_out.end());
      out.diagnosis = !views_without.empty() ? "joint '" + views_without.begin()->first.second +
                                                   "' has no readings when targets are seen"
                      : any_images() ? std::all_of(looked.images.begin(), looked.images.end(),
                                                   [](long count) { return count == 0; })
                                           ? "no image was taken during any rest"
                                           : "no target was found in the images of any rest"
                                     : "no sensor of the rig measured anything in any rest";
      out.lines.insert(out.lines.end(), moving_lines.begin(), moving_lines.end());
      return;
    }
    if (options.offsets && any_images() && readings.any()) find_offsets();
    if (options.apply_offsets) {
      for (const TimeOffset& one : out.offsets)
        if (one.why_not.empty()) applied[one.sensor] = one;
      make_samples();
    }
    out.lines.insert(out.lines.end(), scatter_lines.begin(), scatter_lines.end());
    out.lines.insert(out.lines.end(), moving_lines.begin(), moving_lines.end());
    const std::vector<std::string> left_out = lost_lines();
    out.lines.insert(out.lines.end(), left_out.begin(), left_out.end());
    out.lines.insert(out.lines.end(), held_lines.begin(), held_lines.end());
    if (!numbered.empty()) out.lines.push_back(numbered);
    leave_out_duplicates();
  }
};

}  // namespace

RecordedSamples import_recordings(const std::vector<std::string>& bags, const RigFile& rig,
                                  RecordedStreams& streams, const TargetSearch* search,
                                  const ImportOptions& options) {
  const bool empty = streams.joints.empty() && streams.poses.empty() && streams.images.empty() &&
                     streams.scans.empty();
  Importer importer(bags, rig, streams, search, options);
  if (empty)
    importer.out.diagnosis = "it has no messages of joints, poses, images or scans";
  else
    importer.run();
  return std::move(importer.out);
}

}  // namespace kincal
