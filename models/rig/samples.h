// The logged data: samples, each with one posture of the robot, and their views.
#pragma once

#include <algorithm>
#include <initializer_list>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// A SharedList is a list that many views have in common: copies share it until one of them is
/// changed. (With a hundred thousand samples, separate lists would need more memory than the
/// measurements.)
template <typename T>
class SharedList {
 public:
  SharedList() = default;
  SharedList(std::vector<T> list)
      : list_(list.empty() ? nullptr : std::make_shared<std::vector<T>>(std::move(list))) {}
  SharedList(std::initializer_list<T> list) : SharedList(std::vector<T>(list)) {}
  operator const std::vector<T>&() const {
    static const std::vector<T> none;
    return list_ ? *list_ : none;
  }

  size_t size() const { return list_ ? list_->size() : 0; }
  bool empty() const { return size() == 0; }
  const T* data() const { return list_ ? list_->data() : nullptr; }
  const T* begin() const { return data(); }
  const T* end() const { return data() + size(); }
  const T& operator[](size_t i) const { return (*list_)[i]; }
  bool operator==(const SharedList& other) const {
    return list_ == other.list_ || std::equal(begin(), end(), other.begin(), other.end());
  }
  bool operator==(const std::vector<T>& other) const {
    return std::equal(begin(), end(), other.begin(), other.end());
  }
  template <typename Other>
  bool operator!=(const Other& other) const {
    return !(*this == other);
  }

  /// Returns the list for modification; it is no longer shared.
  std::vector<T>& own() {
    if (!list_ || list_.use_count() > 1)
      list_ = std::make_shared<std::vector<T>>(list_ ? *list_ : std::vector<T>());
    return *list_;
  }
  void push_back(const T& value) { own().push_back(value); }
  void clear() { list_.reset(); }

 private:
  std::shared_ptr<std::vector<T>> list_;
};

/// A View is a sensor's measurement of one target in one sample.
struct View {
  int sensor = -1, target = -1;  // indices
  SharedList<int> ids;           // target points; empty where the sensor measures poses
  std::vector<double> z;     // measurement_size() per point; pose: x y z qx qy qz qw; chain: empty
  SharedList<double> sigma;  // the sensor's, or the view's own
  std::vector<Matrix3d> covariance;  // `point` sensors: one per point instead of sigma, or empty
};

/// Conditions are what the positions of a sample's joints depend on beside their readings
/// (conditions.h). Lists are by joint index, or empty.
struct Conditions {
  std::vector<double> approach;  // direction of the last motion, +1 or -1; 0: not stated
  std::vector<double> rates;     // of the readings, rad/s or m/s; 0: it stands, or is not stated

  std::optional<double> temperature = {};  // of the robot, degrees Celsius
  int payload = -1;                        // of the rig's; -1: none

  bool empty() const { return approach.empty() && rates.empty() && !temperature && payload < 0; }
};

/// Returns conditions that state nothing.
inline const Conditions& no_conditions() {
  static const Conditions none;
  return none;
}

/// A Sample is one posture of the robot with all its views.
struct Sample {
  std::string id;
  std::optional<double> time;
  std::vector<double> readings;  // by joint index, NaN: not in the sample
  Conditions conditions;
  std::vector<double> noise;  // by joint index: sigma of this reading over the rig's sigma of
                              // the joint; empty: 1 for all
  std::vector<View> views;
  bool train = true;  // else held out
};

/// Returns the samples' indices in the order of time if all have one, else in the order of the
/// file.
inline std::vector<int> logged_order(const std::vector<Sample>& samples) {
  std::vector<int> out(samples.size());
  std::iota(out.begin(), out.end(), 0);
  if (std::all_of(samples.begin(), samples.end(), [](const Sample& s) { return s.time; }))
    std::stable_sort(out.begin(), out.end(),
                     [&](int a, int b) { return *samples[a].time < *samples[b].time; });
  return out;
}

}  // namespace kincal
