// What is in recordings: the small streams (joint readings, poses) as a whole, of images and scans
// only when they were taken. Reading them is the first of two passes over the bags; nothing larger
// than one message stays in memory.
//
// Times are seconds after the recording's `origin`, by the stamps in the messages' headers. A
// message whose stamp is 0 has the time at which it was received instead. Streams whose stamps come
// from another clock are moved such that their messages were as long under way as those of the
// joints, in the median; both is said. Another clock is what differs by more than messages may be
// under way (0.4 s): what is less, and bags whose times of reception are their stamps, the motion
// tells (time_offset.h, clock_search.h).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "../../kinematics/transform.h"
#include "../../solver/progress.h"
#include "bag.h"
#include "message.h"
#include "settle.h"

namespace kincal {

/// A JointStream is what one topic has of one joint.
struct JointStream {
  std::string topic, joint;
  Series readings;  // rad or m
};

/// A PoseStream is what one topic has of one frame: of TransformStamped and TFMessage a_T_b, of
/// PoseStamped that of something without a name.
struct PoseStream {
  std::string topic, frame, child;  // child: "" of PoseStamped
  bool fixed = false;               // of /tf_static: at any time
  std::vector<double> times;
  std::vector<Pose> poses;
};

/// An ImageStream is what one topic has of images, in the order of the bag. A message that is there
/// again (the same stamp and bytes: the same bag twice, bags that overlap) has the time NaN.
struct ImageStream {
  std::string topic, type, frame;
  std::string encoding;       // of the first: bgr8, jpeg, ...
  int width = 0, height = 0;  // of the first, 0: not known before it is decoded
  std::vector<double> times;
  double moved = 0;  // s, by which its times are later than its stamps
};

/// A ScanStream is what one topic has of laser scans or point clouds; times likewise.
struct ScanStream {
  std::string topic, type, frame;
  std::vector<double> times;
};

/// A CameraInfoMessage is the first of a topic.
struct CameraInfoMessage {
  std::string topic, frame, model;
  int width = 0, height = 0;
  std::vector<double> distortion;
  double k[4] = {}, p[4] = {};  // fx fy cx cy of the raw and of the rectified image
  double baseline = 0;          // m, of the rectified one
};

/// RecordedStreams are all of them.
struct RecordedStreams {
  std::int64_t origin = 0;  // ns since 1970
  double duration = 0;      // s, from the first to the last message received
  std::vector<JointStream> joints;
  std::vector<PoseStream> poses;
  std::vector<ImageStream> images;
  std::vector<ScanStream> scans;
  std::vector<CameraInfoMessage> infos;
  std::map<std::string, std::string> videos;  // by topic: what it has, which is not read
  std::vector<std::pair<std::string, std::string>> descriptions;  // topic, URDF
  long robot_measurements = 0;                                    // messages of robot_measurement.h
  std::vector<std::string> notes;                                 // what is strange about them
  std::vector<std::string> losses;  // what the bags lost, and messages that could not be read
};

/// Returns what is in some bags. @throws InputError as read_bag
RecordedStreams read_streams(const std::vector<std::string>& bags, const Progress& progress = {});

/// A MessageReader decodes the messages of one bag; a topic's definition is read once.
class MessageReader {
 public:
  /// The value refers to the message. @throws Damage
  MessageValue read(const BagMessage& message);

 private:
  std::map<const Topic*, MessageTypes> types_;
};

/// Reads the messages of some topics again that the first pass could read: of images or of others.
/// `topics`: by name which stream; `visit` gets that, which message of it, and the message.
/// @throws InputError as read_bag
void read_again(const std::vector<std::string>& bags, const std::map<std::string, int>& topics,
                bool images,
                const std::function<void(int stream, size_t message, const BagMessage& raw,
                                         const MessageValue& value)>& visit);

/// True for sensor_msgs/Image and CompressedImage.
bool is_image_type(const std::string& type);

/// Returns the pose of `child` in `frame` at a time, through any number of frames between, as the
/// poses of /tf and of TransformStamped say; interpolated between messages that are at most
/// `longest_gap` s apart. False: not known then.
bool transform_at(const std::vector<PoseStream>& poses, const std::string& frame,
                  const std::string& child, double time, double longest_gap, Pose& frame_T_child);

/// Returns a pose between two of a stream. False: none near.
bool pose_at(const PoseStream& stream, double time, double longest_gap, Pose& pose);

}  // namespace kincal
