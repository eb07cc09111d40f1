#include "import.h"

#include <algorithm>

#include "../../models/rig/numbers.h"
#include "held_targets.h"

namespace kincal {
namespace {

constexpr double kMoving = 0.25;  // of the rests of a view, in which it is not still

bool any_stream(const std::vector<int>& by_sensor) {
  return std::any_of(by_sensor.begin(), by_sensor.end(), [](int stream) { return stream >= 0; });
}

/// Looks at the images of rests; where no joints say when these are, the images do.
void look(const Recorded& recorded, const TargetSearch& search, const ImportOptions& options,
          ImportFindings& found) {
  const bool by_joints = recorded.readings.any();
  const TimeInterval whole = found.rests.rests[0];
  LookOptions how = options.look;
  if (!by_joints || (!options.offsets && !options.apply_offsets)) how.on_way = 0;
  if (!by_joints) how = look_through(whole, how);
  how.progress = options.progress.in("looking at images");
  found.looked = look_at_images(recorded, found.rests.rests, search, how);
  for (const std::string& note : search.agree(found.looked.sightings))
    found.looked.notes.push_back(note);
  if (!by_joints)
    found.rests = rests_of_images(recorded.rig, whole, options.rest, options.still_pixels,
                                  found.looked.sightings);
}

void make_samples(const Recorded& recorded, const TargetSearch* search, double still_pixels,
                  ImportFindings& found) {
  found.samples = samples_of_rests(recorded, found.rests.rests, found.looked.sightings,
                                   found.scanned.views, still_pixels);
  std::vector<Sample>& samples = found.samples.samples;
  found.turned = search ? turn_boards(recorded.rig, search->open_turns, samples) : 0;
  found.held = add_holding_chains(recorded.rig, samples);
}

ImportFindings find_samples(const Recorded& recorded, const TargetSearch* search,
                            const ImportOptions& options) {
  ImportFindings found;
  const bool by_joints = recorded.readings.any(), images = any_stream(recorded.topics.images);
  if (by_joints)
    found.rests = rests_of_joints(recorded.readings, options.rest, options.still_joints);
  else
    found.rests.rests = {recorded_time(recorded.streams)};  // images will tell
  if (images && !search && !found.rests.rests.empty()) {
    found.image_folder = options.image_folder;
    found.samples = samples_with_images(recorded, found.rests.rests, options.image_folder,
                                        options.out, options.force);
    return found;
  }
  if (images && !found.rests.rests.empty()) look(recorded, *search, options, found);
  if (found.rests.rests.empty()) return found;
  if (search && any_stream(recorded.topics.scans)) {
    options.progress.stage("looking at scans");
    found.scanned = look_at_scans(recorded, found.rests.rests, *search);
  }
  make_samples(recorded, search, options.still_pixels, found);
  if (found.samples.samples.empty()) return found;
  if (options.offsets && images && by_joints) {
    options.progress.stage("comparing clocks");
    found.clocks = compare_clocks(recorded, found.samples, found.looked.sightings,
                                  search->open_turns, options.look.threads);
  }
  if (options.apply_offsets) {
    correct_times(found.clocks.offsets, found.looked.sightings);
    make_samples(recorded, search, options.still_pixels, found);
  }
  found.alike = leave_out_alike(recorded.rig, options.distinct, found.samples.samples);
  return found;
}

/// True if a camera's clock may be off by more than was looked for.
bool clock_in_doubt(const ImportFindings& found, int sensor) {
  for (const TimeOffset& one : found.clocks.offsets)
    if (one.sensor == sensor && one.misfit) return true;
  for (const SeenTarget& seen : found.samples.seen)
    if (seen.sensor == sensor && seen.moving > kMoving * seen.rests) return true;
  return found.samples.samples.empty() || found.clocks.unfit();
}

/// Looks for clocks of cameras that are further off, and moves their stamps. Returns whether any
/// was moved.
bool move_clocks(const Recorded& recorded, RecordedStreams& streams, const TargetSearch& search,
                 const ImportOptions& options, ImportFindings& found) {
  std::vector<int> doubted;
  for (int s = 0; s < static_cast<int>(recorded.topics.images.size()); ++s)
    if (recorded.topics.images[s] >= 0 && clock_in_doubt(found, s)) doubted.push_back(s);
  if (doubted.empty()) return false;
  LookOptions look = options.look;
  look.progress = options.progress.in("comparing clocks by the motion");
  found.cameras =
      search_clocks(recorded, found.rests.rests, doubted, search, look, options.still_pixels);
  bool moved = false;
  for (const CameraClock& clock : found.cameras) {
    if (!clock.found) continue;
    ImageStream& stream = streams.images[recorded.topics.images[clock.sensor]];
    for (double& time : stream.times) time -= clock.offset;
    stream.moved -= clock.offset;
    moved = true;
  }
  return moved;
}

}  // namespace

RecordedSamples import_recordings(const std::vector<std::string>& bags, const RigFile& rig,
                                  RecordedStreams& streams, const TargetSearch* search,
                                  const ImportOptions& options) {
  const bool empty = streams.joints.empty() && streams.poses.empty() && streams.images.empty() &&
                     streams.scans.empty();
  const TopicMap topics = find_topics(rig, streams);
  const RobotReadings readings(rig.rig, streams, topics);
  const Recorded recorded{bags, rig.rig, streams, topics, readings};
  ImportFindings found;
  if (empty)
    found.rests.why_none = "it has no messages of joints, poses, images or scans";
  else
    found = find_samples(recorded, search, options);
  if (search && options.offsets && readings.any() && found.rests.rests.size() > 1 &&
      move_clocks(recorded, streams, *search, options, found)) {
    const std::vector<CameraClock> cameras = std::move(found.cameras);
    found = find_samples(recorded, search, options);
    found.cameras = cameras;
  }
  for (const CameraClock& clock : found.cameras)
    if (clock.contradicted) found.samples.samples.clear();
  for (TimeOffset& one : found.clocks.offsets)
    one.offset -= streams.images[topics.images[one.sensor]].moved;
  return {import_words(recorded, found), std::move(found.samples.samples),
          std::move(found.samples.images), std::move(found.clocks.offsets)};
}

}  // namespace kincal
