// Which topic of a recording is which sensor and joint of the rig. `sensors/NAME/topic` and
// `joints: {topic: ...}` of rig.yaml say it; what they leave open is guessed from types, names,
// frames, sizes and lenses (camera_topics.h), and said. What several topics could be stays open,
// and is said too.
#pragma once

#include <string>
#include <vector>

#include "../rig/rig_file.h"
#include "streams.h"

namespace kincal {

/// A PoseSource is where the reading of a floating joint, or what a `pose` sensor sees, is found.
struct PoseSource {
  int stream = -1;           // of the poses; -1: none, unless frames are there
  std::string frame, child;  // in the tree of /tf
  bool known() const { return stream >= 0 || !frame.empty(); }
};

/// A TopicMap says what is what: indices of RecordedStreams, -1: none.
struct TopicMap {
  std::vector<int> images, infos, scans;  // by sensor
  std::vector<PoseSource> poses;          // by sensor, of type `pose`
  std::vector<int> pose_targets;          // by sensor: what it sees
  std::vector<int> joints;                // by joint of the tree
  std::vector<PoseSource> floating;       // by joint of the tree
  std::vector<std::string> lines;  // for each what it is and why: "camera: /camera/image_raw (...)"
  std::vector<std::string> notes;  // what is missing, undecided, or differs from the rig
};

/// Finds out. @throws InputError where the rig names a topic that is not in the recording
TopicMap find_topics(const RigFile& rig, const RecordedStreams& streams);

}  // namespace kincal
