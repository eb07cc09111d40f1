// Which column stands where: every view's columns of L and M in its sample's group, every group's
// part of the state, and what the kernels read. Nothing here depends on the state. This header is
// for the sources of this folder only.
#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "../../solver/kernels.h"
#include "../rig/conditions.h"
#include "../rig/elasticity.h"
#include "../rig/recording.h"
#include "expand.h"
#include "setup.h"

namespace kincal {

/// A Source is what fills columns of M.
enum class Source {
  joint_number,
  error,
  time_offset,
  line_time,
  origin,
  compliance,
  load,
  sensor_pose,
  target_pose
};

struct MotionColumns {
  Source source;
  int step = -1;       // in the path, for joints
  double factor = 1;   // d position / d position of the driver
  int joint = -1;      // the driver, whose numbers count
  int by = -1;         // of an error: the joint whose reading has it
  int bent_by = -1;    // through bending: the joint whose turning, load or compliance it is
  int number = -1;     // which of them
  int parameter = -1;  // of a partly freed pose, for its chart
  int first = 0;       // column
  int count = 1;
};

/// A SensorPath has the joints from a sensor's link to a target's, and is shared by all views of a
/// sample between the two. Their columns of M are computed once, in the frame of the sensor's link;
/// where a scanning joint lies between, what is behind it is in the frame behind.
struct SensorPath {
  int from = -1, to = -1, scanning_joint = -1;
  int clock = -1;    // time offset (parameter) of the sensors; -1: they have none
  int line = -1;     // line time (parameter); then the path is that of one view alone,
  int of_view = -1;  // of this one of the sample's, a point at the time of its row
  Path steps;
  int scan_step = -1;                  // step of the scanning joint
  int scan_numbers = 0;                // own numbers of its model
  bool sensor_side = false;            // what is estimated moves the scanning joint, or the sensor
  std::vector<MotionColumns> motion;   // M's columns of joints
  std::vector<MotionColumns> bending;  // what these and others add through bending joints
  std::vector<int> places;             // place in the group of each of these columns, ascending
  std::vector<MotionColumns> noise;    // Mq of modes marginal and point: one column a noisy joint
  std::vector<int> noisy;              // whose columns these are: the joints, once each

  int rows() const { return sensor_side ? 12 + scan_numbers : 6; }
  /// Returns whether something at a step moves the sensor's side of the scanning joint.
  bool on_sensor_side(int step) const {
    return scan_step >= 0 && (step < scan_step || (step == scan_step && steps[step].direction > 0));
  }
};

/// A ViewLayout is shared by all views of a sensor and a target with the same points, whatever they
/// measured.
struct ViewLayout {
  int sensor_index, target_index;
  const Sensor* sensor = nullptr;
  const Target* target = nullptr;
  const SensorModel* model = nullptr;
  std::vector<NoisePart> noise;  // the model's noise_parts()
  std::vector<int> ids;
  bool covariances = false;
  int path = 0;          // among the sample's
  int target_slot = -1;  // of a free target among the sample's
  Columns columns;       // of the sensor's own L
  ViewColumns map;
  std::vector<MotionColumns> poses;  // M's dense columns of the target's and the sensor's poses
  int path_column = 0;               // and of the path: the first column of M
  int sum = -1;  // which of Layout::sums is its shared columns'; -1: none, few views have them
  ViewKernel kernel = nullptr;  // if the sensor and its noise allow
  int halves = -1;              // of a camera's kernel: its columns of fx cx fy cy follow each
                                // other from here, each in rows of one axis alone
  int own[kMaxParameters];      // for the kernel: column of each own number or -1
  size_t points = 0;  // for the kernel: where in Layout::seen the layout of the seen points begins

  int blocks() const { return model->blocks(static_cast<int>(ids.size())); }
  int rows() const { return blocks() * model->rows(); }
  int stride() const { return padded(static_cast<int>(ids.size())); }
  /// Returns the rows of [L r] with the padding; residual k of block b is row(b, k).
  int padded_rows() const { return kernel ? model->rows() * stride() : padded(rows()); }
  int row(int b, int k) const { return kernel ? k * stride() + b : b * model->rows() + k; }
};

/// A SampleLayout is shared by all samples with the same sensors, targets and points, and computed
/// once.
struct SampleLayout {
  std::vector<SensorPath> paths;
  std::vector<ViewLayout> views;
  std::vector<int> targets;  // free ones, in the order of their blocks
  std::vector<int> noisy;    // joints with an error unknown, in order
  std::vector<int> joints;   // joints whose motion some view needs
  std::vector<int> pieces;   // by joint: of its model (JointModel::piece())
  GroupShape shape;

  int state_size() const { return static_cast<int>(12 * targets.size() + noisy.size()); }
};

struct PlacedView {
  const View* view;
  const ViewLayout* layout;
  int point = -1;       // the only one of the view's points, where each has its own time; -1: all
  size_t measured = 0;  // with a kernel: where in Layout::seen what it compares with begins
  int whitening = -1;   // without, or with own noise: which of the whitenings

  /// Returns what was measured of the first point.
  const double* z() const {
    return view->z.data() + (point < 0 ? 0 : point * layout->model->measurement_size());
  }
};

struct PlacedSample {
  int index = -1;  // in Layout::recorded
  int start = 0;   // of its part of the state: poses, then errors
  const SampleLayout* layout = nullptr;
  std::vector<PlacedView> views;

  int errors() const { return start + 12 * static_cast<int>(layout->targets.size()); }
};

template <typename T>
struct Range {
  T *first, *last;
  T* begin() const { return first; }
  T* end() const { return last; }
};

/// A Layout is that of a whole problem. Its public numbers are read by the other sources of this
/// folder, which do not change them.
struct Layout {
  /// `indices` are those of the samples that take part.
  /// @throws std::invalid_argument where a path needs a floating joint or a joint that follows a
  /// scanning one.
  Layout(const Recording& of, const std::vector<int>& indices, EstimationSetup given);
  Layout(const Layout&) = delete;
  Layout& operator=(const Layout&) = delete;

  /// Returns the shared values that priors and partly freed poses count from.
  const VectorXd& initial() const {
    return setup.initial.size() > 0 ? setup.initial : table.initial;
  }
  /// Returns the samples that take part: all, or with `apart` the one that is taken.
  Range<const PlacedSample> taking_part() const {
    if (!setup.apart) return {samples.data(), samples.data() + samples.size()};
    return {samples.data() + taken, samples.data() + std::min(taken + 1, samples.size())};
  }
  /// Returns the sample of a group; null for the group of the priors.
  const PlacedSample* sample(int group) const {
    const Range<const PlacedSample> all = taking_part();
    return group < all.last - all.first ? all.first + group : nullptr;
  }
  /// Copies the measured numbers of the samples to where the kernels read them.
  void reload();

  const Recording recording;
  const Rig& rig;  // these three are the recording's
  const ParameterTable& table;
  const std::vector<Sample>& recorded;
  EstimationSetup setup;
  std::vector<Component> columns;
  std::vector<int> first_column;                                      // by parameter, -1: held
  std::vector<const Freed*> freed;                                    // by parameter, null: held
  std::map<std::vector<int>, std::unique_ptr<SampleLayout>> layouts;  // by what samples show
  std::vector<PlacedSample> samples;
  std::vector<GroupShape>
      groups;        // the samples' (with `apart` of the taken one), then that of the priors
  size_t taken = 0;  // with `apart`: which sample is the problem
  std::vector<SharedColumns> sums;  // shared columns that many views have, each set once
  AlignedNumbers seen;              // what the kernels read: layouts, measured numbers
  int whitenings = 0;               // views without a kernel, or with own noise
  int state_size = 0;

 private:
  void place_sample(int index);
  const SensorModel& model_of(const Sensor& sensor) const;
  std::vector<int> pieces_of(const Sample& sample) const;
  SampleLayout make_layout(const PlacedSample& placed, std::vector<int> pieces) const;
  int place_path(SampleLayout& sample, const ViewLayout& v) const;
  void place_times(const SensorPath& path,
                   const std::function<void(Source source, int column)>& add) const;
  GroupShape place_columns(SampleLayout& sample) const;
  void place_joints(SensorPath& path, const std::map<int, int>& places,
                    const SampleLayout& sample) const;
  void place_errors(SensorPath& path, MotionColumns m, const SampleLayout& sample) const;
  void place_bending(SensorPath& path, const std::map<int, int>& places,
                     const SampleLayout& sample) const;
  void place_view(ViewLayout& v, const std::map<int, int>& places,
                  const SampleLayout& sample) const;
  int place_sum(const ViewLayout& v, const GroupShape& shape);
  void drop_rare_sums();
  void place_data();
  void place_priors();
};

}  // namespace kincal
