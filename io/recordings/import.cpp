#include "import.h"

#include <algorithm>

#include "../../models/rig/numbers.h"
#include "held_targets.h"

namespace kincal {
namespace {

constexpr double kMostImages = 3000, kImageRate = 5;  // of a camera, where no joints tell; Hz

bool any_stream(const std::vector<int>& by_sensor) {
  return std::any_of(by_sensor.begin(), by_sensor.end(), [](int stream) { return stream >= 0; });
}

TimeInterval recorded_time(const RecordedStreams& streams) {
  TimeInterval all{0, streams.duration};
  for (const ImageStream& s : streams.images)
    for (const double t : s.times)
      all.begin = std::min(all.begin, t), all.end = std::max(all.end, t);
  return all;
}

/// Looks at the images of rests; where no joints say when these are, the images do.
void look(const Recorded& recorded, const TargetSearch& search, const ImportOptions& options,
          ImportFindings& found) {
  const bool by_joints = recorded.readings.any();
  const TimeInterval whole = found.rests.rests[0];
  LookOptions how = options.look;
  if (!by_joints || (!options.offsets && !options.apply_offsets)) how.on_way = 0;
  if (!by_joints) {
    how.in_rest =
        std::max(how.in_rest, static_cast<int>(std::min(kMostImages, kImageRate * whole.length())));
    how.all_targets = true;
  }
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
  return {import_words(recorded, found), std::move(found.samples.samples),
          std::move(found.samples.images), std::move(found.clocks.offsets)};
}

}  // namespace kincal
