// What was logged: samples, one posture of the robot each, and the views in them.
#pragma once

#include <algorithm>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// A View is what one sensor measured of one target in one sample.
struct View {
  int sensor = -1, target = -1;  // indices
  std::vector<int> ids;          // target points; empty where the sensor measures poses
  std::vector<double> z;         // model->numbers() a point; pose: x y z qx qy qz qw; chain: empty
  std::vector<double> sigma;     // as the sensor's, or the view's own
  std::vector<Matrix3d> covariance;  // `point` sensors: one a point instead of sigma, or empty
  std::string where;                 // file:line: field, for messages
};

/// A Sample is one posture of the robot and everything seen in it.
struct Sample {
  std::string id;
  std::optional<double> time;
  std::vector<double> readings;  // by joint index, NaN: not in the sample
  std::vector<double> noise;     // by joint index: sigma of this reading over the rig's sigma of
                                 // the joint; empty: 1 for all
  std::vector<View> views;
  bool train = true;  // else held out
};

/// Returns the samples' indices by time if all of them have one, else as they stand in the file.
inline std::vector<int> logged_order(const std::vector<Sample>& samples) {
  std::vector<int> out(samples.size());
  std::iota(out.begin(), out.end(), 0);
  if (std::all_of(samples.begin(), samples.end(), [](const Sample& s) { return s.time; }))
    std::stable_sort(out.begin(), out.end(),
                     [&](int a, int b) { return *samples[a].time < *samples[b].time; });
  return out;
}

}  // namespace kincal
