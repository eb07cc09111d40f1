// From recordings to samples: rests of the robot are found, what its sensors saw in each is
// averaged, and one sample a rest comes out.
//
//   1. What is in the bags, and which topic is which sensor (streams.h, topics.h).
//   2. When the joints rest (rests.h).
//   3. Images of the rests, and some of the ways between, are searched for targets
//   (still_images.h), scans of the rests likewise (still_scans.h).
//   4. Samples (rest_samples.h): corners of the frames in which they are still are averaged; a
//   rest's interval is what joints and views have in common, and readings are averaged over it.
//   5. Hands that hold free targets (held_targets.h), numbering of boards that look alike from
//   several sides, postures that are there already.
//   6. The offsets in time between joints and cameras (clocks.h). On request stamps are corrected
//   by them, and 4 and 5 done again.
// What was found is put into words at the end (import_words.h).
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "../../solver/progress.h"
#include "../rig/rig_file.h"
#include "import_words.h"

namespace kincal {

struct ImportOptions {
  double rest = 0.5;                                               // s, the shortest rest
  double still_joints = std::numeric_limits<double>::quiet_NaN();  // rad, m: what counts as rest;
                                                                   // NaN: by each joint's own noise
  double still_pixels = std::numeric_limits<double>::quiet_NaN();  // px, likewise
  double distinct = 0;  // rad, m: of postures closer than this one stays; 0: all
  bool offsets = true, apply_offsets = false;
  LookOptions look;
  std::string image_folder;  // for images where nothing can search them
  std::string out;           // the samples file to be: paths of images are relative to it
  bool force = false;
  Progress progress;
};

struct RecordedSamples : ImportWords {
  std::vector<Sample> samples;
  std::vector<std::vector<std::string>> images;  // by sample and view, where images were written
  std::vector<TimeOffset> offsets;
};

/// Makes samples of recordings. `search` null: images are written as files. Streams' joints are
/// taken out. @throws InputError
RecordedSamples import_recordings(const std::vector<std::string>& bags, const RigFile& rig,
                                  RecordedStreams& streams, const TargetSearch* search,
                                  const ImportOptions& options);

}  // namespace kincal
