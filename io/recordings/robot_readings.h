// The joints of a robot in a recording: their readings at any time, when they are still, and what
// they are on average then.
#pragma once

#include <string>
#include <vector>

#include "../../models/rig/samples.h"
#include "topics.h"

namespace kincal {

/// A RobotReadings has the readings of all joints of a rig that a recording has, floating ones too.
class RobotReadings {
 public:
  /// Takes the joints' series out of the streams. The rig has to stay.
  RobotReadings(const Rig& rig, RecordedStreams& streams, const TopicMap& topics);

  /// Returns the readings at a time, by joint index, by the cubic through those around it; NaN:
  /// none then.
  std::vector<double> at(double time) const;

  /// Returns when all joints rest that a sensor or target of the rig stands on, but for those that
  /// scan. What has no readings at a time does not count then; where nothing has any for a second
  /// (a pause between two bags) is no rest. `tolerance` is in rad and m, NaN: each joint's own
  /// (still_tolerance() of settle.h).
  Intervals still(const TimeInterval& during, double tolerance) const;

  /// Returns a rest without the slow ends of ways in the readings of single joints. `tolerance` as
  /// for still(): what is given there is what readings may scatter by.
  TimeInterval without_slow_ends(TimeInterval rest, double tolerance) const;

  /// True if there are readings of such joints at all.
  bool any() const { return !watched_.empty() || !floating_.empty(); }

  /// Says which joint moves most in the quietest `length` s of each: for those who find no rest.
  std::string restless(double length, double tolerance) const;

  /// Says which joints have no readings for a second or more while others have.
  std::vector<std::string> absences() const;

  /// Sets readings and noise of a sample to the averages over a time; where there is no message in
  /// it, to what they are in its middle.
  void average(const TimeInterval& over, Sample& sample) const;

  /// Returns the readings of one joint; none: it has none.
  const Series& series(int joint) const { return series_[joint]; }

  /// Returns the first and last time of any reading.
  TimeInterval span() const { return span_; }

 private:
  /// When anything is logged at all: what happens in a pause of a recording nobody knows.
  Intervals logged() const;

  struct Floating {
    int joint;
    PoseStream poses;
    double gap;
    std::vector<Series> series;   // x y z and the quaternion
    std::vector<double> scatter;  // of these, at rest
  };

  const Rig& rig_;
  std::vector<Series> series_;         // by joint
  std::vector<double> gaps_;           // by joint: the longest in which it is interpolated
  std::vector<double> scatter_;        // by joint, at rest; of those that have to rest
  std::vector<double> smallest_step_;  // likewise
  std::vector<int> watched_;           // joints that have to rest
  std::vector<Floating> floating_;
  TimeInterval span_;
};

/// Recorded is what bags have of a rig.
struct Recorded {
  const std::vector<std::string>& bags;
  const Rig& rig;
  const RecordedStreams& streams;
  const TopicMap& topics;
  const RobotReadings& readings;
};

/// Returns the seven numbers of poses as series (x y z, quaternion), without jumps of sign.
std::vector<Series> pose_series(const PoseStream& poses);

/// An AveragePose over a time, with the scatter of translation (m) and rotation (rad) of one.
struct AveragePose {
  Pose mean;
  double translation = 0, rotation = 0;  // rms over the three components
  long count = 0;
};
AveragePose average_pose(const PoseStream& poses, const TimeInterval& over);

}  // namespace kincal
