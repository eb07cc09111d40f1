// Which topics of a recording are the cameras of the rig, for topics.h: their images, and what the
// recording says of their lenses.
#pragma once

#include <string>
#include <vector>

#include "../rig/rig_file.h"
#include "streams.h"

namespace kincal {

/// CameraTopics are indices of RecordedStreams, by sensor of the rig; -1: none.
struct CameraTopics {
  std::vector<int> images, infos;
  std::vector<std::string> lines, notes;  // as those of a TopicMap
};

/// Finds them. What several topics could be stays open.
CameraTopics find_camera_topics(const RigFile& rig, const RecordedStreams& streams);

/// Says of each camera whose lens or size is another in the recording than in the rig how they
/// differ.
std::vector<std::string> other_lenses(const RigFile& rig, const RecordedStreams& streams,
                                      const CameraTopics& cameras);

}  // namespace kincal
