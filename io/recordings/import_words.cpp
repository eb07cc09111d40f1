#include "import_words.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "../../models/rig/words.h"
#include "../document/names.h"

namespace kincal {
namespace {

constexpr double kNoNoise = 2;    // px of scatter
constexpr size_t kMostNamed = 8;  // rests in one line

using TextLines = std::vector<std::string>;

void append(TextLines& lines, const TextLines& more) {
  lines.insert(lines.end(), more.begin(), more.end());
}

std::string at_time(double time) { return text("(at %.1f s)", time); }

/// The first of some rests.
std::string few_of(TextLines rests) {
  const bool more = rests.size() > kMostNamed;
  if (more) rests.resize(kMostNamed);
  return comma_separated(rests) + (more ? ", ..." : "");
}

std::string rests_line(const Recorded& recorded, const FoundRests& found, const char* of) {
  return text("rests of %s: %zu of %.3g s at least, of %.4g s", of, found.rests.size(),
              found.shortest, recorded.streams.duration);
}

/// What came of looking at each camera's images.
TextLines look_lines(const Recorded& recorded, const LookedAt& looked) {
  TextLines lines;
  std::map<int, std::set<std::pair<int, int>>> seen;  // by sensor: target and rest
  for (const Sighting& one : looked.sightings)
    if (one.rest >= 0) seen[one.sensor].insert({one.target, one.rest});
  for (int s = 0; s < static_cast<int>(looked.images.size()); ++s) {
    if (recorded.topics.images[s] < 0) continue;
    std::map<int, int> rests;  // by target
    for (const auto& [target, rest] : seen[s]) ++rests[target];
    TextLines targets;
    for (const auto& [target, count] : rests)
      targets.push_back(recorded.rig.targets[target].name + " in " + std::to_string(count) +
                        " rests");
    lines.push_back(recorded.rig.sensors[s].name + ": " + std::to_string(looked.images[s]) +
                    " images searched; " +
                    (targets.empty() ? "no target seen" : comma_separated(targets)));
  }
  return lines;
}

TextLines scan_lines(const Rig& rig, const ScannedRests& scanned) {
  TextLines lines;
  for (const auto& [sensor, of] : scanned.sensors) {
    lines.push_back(rig.sensors[sensor].name + ": targets found in " + std::to_string(of.found) +
                    " of " + std::to_string(of.rests) + " rests");
    for (const auto& [why_not, rests] : of.not_found)
      lines.back() += "; in " + std::to_string(rests) + " not: " + why_not;
    if (of.found < of.rests)
      lines.back() +=
          " (where it is in sight: nearer, facing the laser, larger squares or slower sweeps)";
  }
  return lines;
}

/// What scatters so much is a warning.
void say_scatter(const Rig& rig, const std::vector<SeenTarget>& seen, TextLines& lines,
                 TextLines& notes) {
  for (const SeenTarget& one : seen) {
    const char *sensor = rig.sensors[one.sensor].name.c_str(),
               *target = rig.targets[one.target].name.c_str();
    if (one.scatter > kNoNoise)
      notes.push_back(text(
          "%s: corners of '%s' move by %.2g px from image to image while the joints rest: no "
          "noise, but a board or camera that is not still, readings of another time, or images "
          "of two recordings in one",
          sensor, target, one.scatter));
    else if (one.scatter != 0)
      lines.push_back(
          text("%s: corners of '%s' scatter by %.2g px from image to image; averages "
               "are better, and the rig's %.2g px are added",
               sensor, target, one.scatter, rig.sensors[one.sensor].sigma[0]));
  }
}

TextLines moving_lines(const Rig& rig, const std::vector<SeenTarget>& seen) {
  TextLines lines;
  for (const SeenTarget& one : seen) {
    if (one.moving == 0) continue;
    const char* sensor = rig.sensors[one.sensor].name.c_str();
    lines.push_back(
        (one.moving == one.rests
             ? text("%s is never still while the joints are: it moves by at least %.2g px", sensor,
                    one.least)
             : text("%s: not still in %d of %d rests", sensor, one.moving, one.rests)) +
        text(" (of '%s'; up to %.2g px count as rest)", rig.targets[one.target].name.c_str(),
             one.allowed));
  }
  return lines;
}

TextLines lost_lines(const Rig& rig, const Intervals& rests, const RestSamples& samples) {
  TextLines lines;
  for (const auto& [which, count] : samples.without_reading)
    lines.push_back(rig.sensors[which.first].name + ": " + std::to_string(count) +
                    " views left out, joint '" + which.second + "' has no reading then");
  std::map<std::string, TextLines> by_reason;
  for (const auto& [rest, why] : samples.lost)
    by_reason[why].push_back(rest_name(rest) + " " + at_time(rests[rest].begin));
  for (const auto& [why, names] : by_reason)
    lines.push_back("left out, " + why + ": " + std::to_string(names.size()) + " of " +
                    std::to_string(rests.size()) + " rests: " + few_of(names));
  return lines;
}

/// What is said of cameras whose stamps were moved as the motion tells.
TextLines moved_lines(const Recorded& recorded, const std::vector<CameraClock>& cameras) {
  TextLines lines;
  for (const CameraClock& one : cameras)
    if (one.found)
      lines.push_back(
          recorded.rig.sensors[one.sensor].name +
          text(": its stamps are of another clock, %.3f s %s those of the joints, judging by the "
               "motion: they are shifted",
               std::abs(one.offset), one.offset > 0 ? "after" : "before"));
  return lines;
}

/// Why there are no samples where a camera's stamps contradict the motion; "": none does.
std::string without_clock(const Rig& rig, const std::vector<CameraClock>& cameras) {
  for (const CameraClock& one : cameras) {
    if (!one.contradicted) continue;
    TextLines offsets;
    for (const double offset : one.candidates) offsets.push_back(text("%.1f", offset));
    return "the images of '" + rig.sensors[one.sensor].name +
           "' move while the joints rest, and rest while the joints move: their time stamps come "
           "from different clocks, and several offsets are possible (if images are " +
           few_of(offsets) +
           " s later, both rest at the same times). Synchronise the clocks (chrony), use the "
           "reception times of one recorder, or record rests of different lengths";
  }
  return "";
}

/// Why there are rests but no samples.
std::string without_samples(const Recorded& recorded, const ImportFindings& found) {
  const TopicMap& topics = recorded.topics;
  if (const std::string why = without_clock(recorded.rig, found.cameras); !why.empty()) return why;
  if (!found.samples.without_reading.empty())
    return "joint '" + found.samples.without_reading.begin()->first.second +
           "' has no readings when targets are seen";
  const auto none = [](const auto& numbers, long limit) {
    return std::all_of(numbers.begin(), numbers.end(), [&](long n) { return n <= limit; });
  };
  return none(topics.images, -1)        ? "no sensor of the rig measured anything in any rest"
         : none(found.looked.images, 0) ? "no image was taken during any rest"
                                        : "no target was found in the images of any rest";
}

}  // namespace

ImportWords import_words(const Recorded& recorded, const ImportFindings& found) {
  const Rig& rig = recorded.rig;
  ImportWords out{recorded.topics.lines, recorded.topics.notes, found.rests.why_none};
  append(out.notes, recorded.readings.absences());
  append(out.notes, moved_lines(recorded, found.cameras));
  append(out.notes, found.looked.notes);
  append(out.notes, {found.scanned.doubts.begin(), found.scanned.doubts.end()});
  if (recorded.readings.any())
    out.lines.push_back(rests_line(recorded, found.rests, "the joints"));
  else if (!found.looked.images.empty())
    out.lines.push_back(rests_line(recorded, found.rests, "the views of the cameras"));
  if (!found.rests.creeping.empty()) {
    TextLines begins;
    for (const double begin : found.rests.creeping) begins.push_back(at_time(begin));
    out.lines.push_back("left out, too short without the slow ends of moves: " + few_of(begins));
  }
  append(out.lines, look_lines(recorded, found.looked));
  append(out.lines, scan_lines(rig, found.scanned));
  if (!found.image_folder.empty())
    out.lines.push_back(
        "images are in " + found.image_folder +
        ": this program was built without target detection; run `kincal detect` on the samples");
  TextLines scatter;
  say_scatter(rig, found.samples.seen, scatter, out.notes);
  const TextLines moving = moving_lines(rig, found.samples.seen),
                  lost = lost_lines(rig, found.rests.rests, found.samples);
  if (found.samples.samples.empty()) {
    append(out.lines, lost);
    append(out.lines, moving);
    if (!found.rests.rests.empty()) out.diagnosis = without_samples(recorded, found);
    return out;
  }
  if (!found.clocks.without_steps.empty())
    out.lines.push_back("clocks are compared without the rig's steps: " +
                        found.clocks.without_steps);
  for (const TextLines& some : {scatter, moving, lost, found.held}) append(out.lines, some);
  if (found.turned > 0)
    out.lines.push_back("numbering of boards that look alike from several sides: " +
                        std::to_string(found.turned) + " views were turned, by the joint readings");
  if (found.alike > 0)
    out.lines.push_back("left out as postures that are there already: " +
                        std::to_string(found.alike));
  return out;
}

}  // namespace kincal
