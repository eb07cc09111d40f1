#include "estimation.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "../../solver/decompositions.h"

namespace kincal {
namespace {

/// What fills columns of M.
enum class Source { joint_number, error, origin, sensor_pose, target_pose };

}  // namespace

constexpr size_t kWeights = 8;  // numbers in front of the measured ones: 1 / sigma of each component

struct Estimation::MotionColumns {
  Source source;
  int step = -1;       // in the path, for joints
  double factor = 1;   // d position / d position of the driver
  int joint = -1;      // the driver, whose reading and numbers count
  int number = -1;     // which of them
  int parameter = -1;  // of a partly freed pose, for its chart
  int first = 0;       // column
  int count = 1;
};

namespace {

using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6>;  // on the stack

}  // namespace

/// How residuals of a view without a kernel become white.
struct Estimation::Whitening {
  VectorXd inverse_sigma;          // one a row of a block, where nothing else is said
  std::vector<SmallMatrix> block;  // one a block, or empty
  MatrixXd noise;                  // mode marginal: U, whitened own noise assumed; or empty
  MatrixXd root;                   // (1 + U U')^-1/2 = 1 - noise root noise'
};

namespace {

SmallMatrix inverse_square_root(const SmallMatrix& c) {
  const Eigen::SelfAdjointEigenSolver<SmallMatrix> eigen(c);
  SmallMatrix scaled = eigen.eigenvectors();
  for (Eigen::Index i = 0; i < c.cols(); ++i)
    scaled.col(i) /= std::sqrt(std::max(eigen.eigenvalues()(i), 1e-14 * eigen.eigenvalues().maxCoeff()));
  return scaled.lazyProduct(eigen.eigenvectors().transpose());
}

/// k rows of `columns` numbers, `ld` apart, times a k x k matrix from the left (K = k, or 0: any k up to 6), in place.
template <int K>
void multiply_rows(const double* matrix, int k, double* rows, Eigen::Index ld, Eigen::Index columns) {
  const int n = K > 0 ? K : k;
  for (Eigen::Index c = 0; c < columns; ++c) {
    double in[6], out[6];
    for (int i = 0; i < n; ++i) in[i] = rows[i * ld + c];
    for (int i = 0; i < n; ++i) {
      out[i] = matrix[i] * in[0];
      for (int j = 1; j < n; ++j) out[i] += matrix[i + j * n] * in[j];
    }
    for (int i = 0; i < n; ++i) rows[i * ld + c] = out[i];
  }
}

/// B diag(sigma^2) B'
SmallMatrix covariance_of(const SmallMatrix& b, const Eigen::Ref<const VectorXd>& sigma) {
  SmallMatrix scaled = b;
  for (Eigen::Index i = 0; i < b.cols(); ++i) scaled.col(i) *= sigma(i);
  return scaled.lazyProduct(scaled.transpose());
}

}  // namespace

/// The way from a sensor's link to a target's, shared by all views of a sample that go it. Its columns of M are computed once, in the
/// frame of the sensor's link; where a scanning joint lies between, what is behind it is in the frame behind.
struct Estimation::Way {
  int from = -1, to = -1, scanning_joint = -1;
  Path path;
  int scan_step = -1;                 // step of the scanning joint
  int scan_numbers = 0;               // own numbers of its model
  std::vector<MotionColumns> motion;  // M's columns of joints
  std::vector<int> places;            // place in the group of each of these columns
  std::vector<MotionColumns> noise;   // Mq of modes marginal and point: one column a noisy joint
  std::vector<double> noise_sigma;

  int rows() const { return scan_step >= 0 ? 12 + scan_numbers : 6; }
};

/// What all views of a sensor and a target with the same points have in common, whatever they measured.
struct Estimation::ViewPlan {
  int sensor_index, target_index;
  const Sensor* sensor = nullptr;
  const Target* target = nullptr;
  const SensorModel* model = nullptr;
  std::vector<int> ids;
  bool covariances = false;
  int way = 0;
  int target_slot = -1;  // of a free target among the sample's
  Columns columns;       // of the sensor's own L
  ViewColumns map;
  std::vector<MotionColumns> poses;  // M's columns of the target's and the sensor's poses
  std::vector<int> way_column;       // and of the way: column of M of each
  ViewKernel kernel = nullptr;       // if the sensor and its noise allow
  int own[kMaxParameters];           // for the kernel: column of each own number or -1
  size_t points = 0;                 // for the kernel: where in seen_ the layout of the seen points begins

  int blocks() const { return model->blocks(static_cast<int>(ids.size())); }
  int rows() const { return blocks() * model->rows(); }
  int stride() const { return padded(static_cast<int>(ids.size())); }
  /// Rows of [L r] with the padding; residual k of block b is row(b, k).
  int padded_rows() const { return kernel ? model->rows() * stride() : padded(rows()); }
  int row(int b, int k) const { return kernel ? k * stride() + b : b * model->rows() + k; }
};

/// What all samples that show the same have in common.
struct Estimation::SamplePlan {
  std::vector<Way> ways;
  std::vector<ViewPlan> views;
  std::vector<int> targets;  // free ones, in the order of their blocks
  std::vector<int> noisy;    // joints with an error unknown, in order
  std::vector<int> joints;   // joints whose motion some view needs
  GroupShape shape;

  int state_size() const { return static_cast<int>(12 * targets.size() + noisy.size()); }
};

struct Estimation::PlacedView {
  const View* view;
  const ViewPlan* plan;
  size_t measured = 0;  // with a kernel: where in seen_ 1 / sigma of each component, then the measured numbers begin
  int whitening = -1;   // without: in whitenings_
};

struct Estimation::PlacedSample {
  int index = -1;  // in all_
  int start = 0;   // of its part of the state: poses, then errors
  const SamplePlan* plan = nullptr;
  std::vector<PlacedView> views;

  int errors() const { return start + 12 * static_cast<int>(plan->targets.size()); }
};

/// What a way looks like at the state at hand.
struct Estimation::WalkedWay {
  std::vector<Pose> frames;  // by step of the path
  Pose link_T_far;           // from the sensor's link to the target's
  Pose link_T_before;        // with a scanning joint: to it, on the sensor's side; link_T_far is then seen from behind it
  MatrixXd twists;           // in its top left corner: the way's columns
};

struct Estimation::Scratch {
  std::vector<Pose> motion;     // by joint
  std::vector<Pose> moved;      // by joint: origin * motion, parent_T_child
  std::vector<double> reading;  // by joint, error included
  std::vector<WalkedWay> ways;
  ViewInput input;
  Scan scan;
  std::vector<Eigen::Matrix3Xd> points;  // by target
  std::vector<double> gathered;          // points of a view for its kernel
  RowMatrix evaluated;                   // L as sensors without a kernel write it
  MatrixXd rows;                         // in its top left corner: [L r]; residuals alone in the last column
  VectorXd r;                            // residuals of sensors without a kernel
  std::vector<double> slopes;            // roots of the loss's slopes, by row
  MatrixXd projected, rooted;            // mode marginal: noise' [L r], and that times the root
  MatrixXd own_noise;
  ExpandScratch expand;
};

Estimation::~Estimation() = default;

Estimation::Estimation(const Recording& recording, const std::vector<int>& samples, EstimationSetup setup)
    : rig_(recording.rig),
      table_(recording.table),
      all_(recording.samples),
      setup_(std::move(setup)) {
  set_levels(std::vector<double>(setup_.levels));
  first_column_.assign(table_.all.size(), -1);
  freed_.assign(table_.all.size(), nullptr);
  charts_.resize(table_.all.size());
  for (const Freed& f : setup_.free) {
    first_column_[f.parameter] = static_cast<int>(columns_.size());
    freed_[f.parameter] = &f;
    for (int c : f.components) columns_.push_back({f.parameter, c});
    if (table_.all[f.parameter].pose && !f.whole(table_.all[f.parameter])) charts_[f.parameter] = MatrixXd::Zero(6, f.components.size());
  }
  state_size_ = static_cast<int>(table_.initial.size());
  for (int index : samples) place_sample(index);
  place_data();
  if (!setup_.priors.empty()) {
    GroupShape shape;
    for (const Prior& prior : setup_.priors)  // a prior on a component of a partly freed pose depends on all its freed ones
      for (size_t i = 0; i < freed_[prior.parameter]->components.size(); ++i)
        shape.columns.push_back(first_column_[prior.parameter] + static_cast<int>(i));
    std::sort(shape.columns.begin(), shape.columns.end());
    shape.columns.erase(std::unique(shape.columns.begin(), shape.columns.end()), shape.columns.end());
    shape.rows = static_cast<int>(setup_.priors.size());
    groups_.push_back(std::move(shape));
  }
  set_workers(1);
}

void Estimation::set_levels(const std::vector<double>& levels) {
  setup_.levels = levels;
  losses_.assign(rig_.sensors.size(), setup_.loss);
  for (size_t i = 0; i < levels.size(); ++i) losses_[i].scale = setup_.loss.scale * levels[i];
}

/// A sample's views that take part. Its plan is that of an earlier sample that shows the same, or a new one.
void Estimation::place_sample(int index) {
  PlacedSample s;
  s.index = index;
  std::vector<int> key;  // sensor, target, with covariances, ids of each view
  for (const View& view : all_[index].views) {
    if (std::find(setup_.sensors.begin(), setup_.sensors.end(), view.sensor) == setup_.sensors.end() ||
        (setup_.only_target >= 0 && view.target != setup_.only_target))
      continue;
    const Sensor& sensor = rig_.sensors[view.sensor];
    if (view.covariance.empty() && static_cast<int>(view.sigma.size()) != model_of(sensor).sigmas())
      throw std::invalid_argument(view.where + ": sensor '" + sensor.name + "' takes " + std::to_string(model_of(sensor).sigmas()) +
                                  " sigmas, not " + std::to_string(view.sigma.size()));
    key.insert(key.end(), {view.sensor, view.target, !view.covariance.empty(), static_cast<int>(view.ids.size())});
    key.insert(key.end(), view.ids.begin(), view.ids.end());
    s.views.push_back({&view, nullptr});
  }
  if (s.views.empty()) return;
  std::unique_ptr<SamplePlan>& plan = plans_[key];
  if (!plan) plan = std::make_unique<SamplePlan>(make_plan(s));
  s.plan = plan.get();
  s.start = state_size_;
  state_size_ += s.plan->state_size();
  for (size_t v = 0; v < s.views.size(); ++v) s.views[v].plan = &s.plan->views[v];
  groups_.push_back(s.plan->shape);
  samples_.push_back(std::move(s));
}

const SensorModel& Estimation::model_of(const Sensor& sensor) const {
  const SensorModel* point_form = setup_.noise == NoiseMode::point ? sensor.model->point_form() : nullptr;
  return point_form ? *point_form : *sensor.model;
}

/// The ways between sensors and targets, what the sample's private unknowns are, and all columns.
Estimation::SamplePlan Estimation::make_plan(const PlacedSample& placed) const {
  SamplePlan s;
  for (const PlacedView& p : placed.views) {
    ViewPlan v;
    v.sensor_index = p.view->sensor;
    v.target_index = p.view->target;
    v.sensor = &rig_.sensors[v.sensor_index];
    v.target = &rig_.targets[v.target_index];
    v.model = &model_of(*v.sensor);
    v.covariances = !p.view->covariance.empty();
    v.ids = p.view->ids;
    if (v.ids.empty() && !v.model->whole_pose())
      for (int i = 0; i < v.target->count(); ++i) v.ids.push_back(i);
    v.way = place_way(s, v);
    if (v.target->link < 0) {
      const auto it = std::find(s.targets.begin(), s.targets.end(), v.target_index);
      v.target_slot = static_cast<int>(it - s.targets.begin());
      if (it == s.targets.end()) s.targets.push_back(v.target_index);
    }
    s.views.push_back(std::move(v));
  }
  s.shape = place_columns(s);
  return s;
}

/// The view's way among the sample's, a new one if there is none yet.
int Estimation::place_way(SamplePlan& s, const ViewPlan& v) const {
  Way way;
  way.from = v.sensor->link;
  way.to = v.target->link >= 0 ? v.target->link : rig_.base;
  if (v.model->scans()) way.scanning_joint = v.sensor->scanning_joint;
  for (size_t i = 0; i < s.ways.size(); ++i)
    if (s.ways[i].from == way.from && s.ways[i].to == way.to && s.ways[i].scanning_joint == way.scanning_joint) return static_cast<int>(i);
  way.path = find_path(rig_.tree, way.from, way.to);
  if (v.model->scans()) {
    way.scan_numbers = rig_.joints[way.scanning_joint].model->size();
    const auto scan_step = [&] {
      for (size_t k = 0; k < way.path.size(); ++k)
        if (way.path[k].joint == way.scanning_joint) return static_cast<int>(k);
      return -1;
    };
    way.scan_step = scan_step();
    if (way.scan_step < 0) {  // sensor and target both behind the joint: its reading differs between them, nothing cancels
      way.path = find_path(rig_.tree, way.from, rig_.base);
      way.scan_step = scan_step();
      for (const PathStep& step : find_path(rig_.tree, rig_.base, way.to)) way.path.push_back(step);
      if (way.scan_step < 0)
        throw std::invalid_argument("sensor '" + v.sensor->name + "': joint '" + rig_.tree.joints[way.scanning_joint].name +
                                    "' is not between its link and the base");
    }
  }
  for (size_t k = 0; k < way.path.size(); ++k) {
    const int j = way.path[k].joint;
    const Joint& joint = rig_.tree.joints[j];
    if (!joint.moves() || static_cast<int>(k) == way.scan_step) continue;
    const int drv = driver(rig_.tree, j).joint;
    if (way.scan_step >= 0 && drv == way.scanning_joint && joint.mimic)
      throw std::invalid_argument("sensor '" + v.sensor->name + "': joint '" + joint.name +
                                  "' follows the scanning joint; only one joint may move within a view");
    if (std::find(s.joints.begin(), s.joints.end(), j) == s.joints.end()) s.joints.push_back(j);
    if (setup_.noise == NoiseMode::latent && rig_.joints[drv].sigma > 0 && std::find(s.noisy.begin(), s.noisy.end(), drv) == s.noisy.end())
      s.noisy.push_back(drv);
  }
  s.ways.push_back(std::move(way));
  return static_cast<int>(s.ways.size()) - 1;
}

/// Columns that a group touches, then where each view's columns are among them.
GroupShape Estimation::place_columns(SamplePlan& s) const {
  std::map<int, int> places;  // shared column -> place in the group
  GroupShape shape;
  shape.private_size = static_cast<int>(6 * s.targets.size() + s.noisy.size());
  shape.rows = static_cast<int>(s.noisy.size());
  const auto place_all = [&] {
    for (Way& way : s.ways) place_joints(way, places, s);
    for (ViewPlan& v : s.views) place_view(v, places, s);
  };
  place_all();  // no column has a place yet: this finds out which there are
  for (const ViewPlan& v : s.views) {
    for (int c : v.map.kinematic)
      if (c < 0) places[-c - 1] = 0;
    for (const auto& o : v.map.own)
      if (o.second < 0) places[-o.second - 1] = 0;
    shape.rows += v.rows();
  }
  int place = shape.private_size;
  for (auto& p : places) {
    p.second = place++;
    shape.columns.push_back(p.first);
  }
  place_all();
  return shape;
}

int Estimation::sample_of(int group) const { return group < static_cast<int>(samples_.size()) ? samples_[group].index : -1; }

namespace {

/// Place of a shared column in its group; without a place yet -column - 1.
int place_of(const std::map<int, int>& places, int column) {
  const auto it = places.find(column);
  return it == places.end() ? -column - 1 : it->second;
}

}  // namespace

/// The way's columns of M: joints' offsets, scales, errors and origins.
void Estimation::place_joints(Way& way, const std::map<int, int>& places, const SamplePlan& s) const {
  way.motion.clear();
  way.places.clear();
  way.noise.clear();
  way.noise_sigma.clear();
  const auto add = [&](MotionColumns m, int place) {  // a column, or several that follow each other; what comes twice shares them
    const auto it = std::find(way.places.begin(), way.places.end(), place);
    m.first = static_cast<int>(it - way.places.begin());
    if (it == way.places.end())
      for (int i = 0; i < m.count; ++i) way.places.push_back(place < 0 ? place - i : place + i);
    way.motion.push_back(m);
  };
  for (int k = 0; k < static_cast<int>(way.path.size()); ++k) {
    const int j = way.path[k].joint, origin = table_.joint_origin[j];
    if (freed_[origin]) {
      MotionColumns m{Source::origin, k};
      m.parameter = origin;
      m.count = static_cast<int>(freed_[origin]->components.size());
      add(m, place_of(places, first_column_[origin]));
    }
    if (!rig_.tree.joints[j].moves()) continue;
    const Driver drv = driver(rig_.tree, j);
    MotionColumns m{Source::joint_number, k, drv.factor, drv.joint};
    for (int n = 0; n < rig_.joints[drv.joint].model->size(); ++n) {
      const int parameter = table_.joint_offset[drv.joint] + n;
      m.number = n;
      if (freed_[parameter]) add(m, place_of(places, first_column_[parameter]));
    }
    if (k == way.scan_step || !(rig_.joints[drv.joint].sigma > 0)) continue;
    m.source = Source::error;
    if (setup_.noise == NoiseMode::latent) {
      const int slot = static_cast<int>(std::find(s.noisy.begin(), s.noisy.end(), drv.joint) - s.noisy.begin());
      add(m, static_cast<int>(6 * s.targets.size()) + slot);
    } else if (setup_.noise != NoiseMode::none) {
      const auto it = std::find_if(way.noise.begin(), way.noise.end(), [&](const MotionColumns& n) { return n.joint == drv.joint; });
      m.first = it == way.noise.end() ? static_cast<int>(way.noise_sigma.size()) : it->first;
      if (it == way.noise.end()) way.noise_sigma.push_back(rig_.joints[drv.joint].sigma);
      way.noise.push_back(m);
    }
  }
}

/// Columns of L and of M, and where they are in the group.
void Estimation::place_view(ViewPlan& v, const std::map<int, int>& places, const SamplePlan& s) const {
  const Way& way = s.ways[v.way];
  v.map = ViewColumns();
  v.poses.clear();
  const auto shared = [&](int column) { return place_of(places, column); };

  // M: the target's pose, the sensor's, the joints.
  const auto add_pose = [&](Source source, int parameter) {
    if (!freed_[parameter]) return;
    MotionColumns m{source};
    m.parameter = parameter;
    m.count = static_cast<int>(freed_[parameter]->components.size());
    m.first = static_cast<int>(v.map.kinematic.size());
    for (int i = 0; i < m.count; ++i) v.map.kinematic.push_back(shared(first_column_[parameter] + i));
    v.poses.push_back(m);
  };
  if (v.target_slot >= 0) {
    MotionColumns m{Source::target_pose};
    m.count = 6;
    for (int i = 0; i < 6; ++i) v.map.kinematic.push_back(6 * v.target_slot + i);
    v.poses.push_back(m);
  } else {
    add_pose(Source::target_pose, table_.target_pose[v.target_index]);
  }
  add_pose(Source::sensor_pose, table_.sensor_pose[v.sensor_index]);
  const std::vector<int> poses = v.map.kinematic;
  v.map.kinematic.insert(v.map.kinematic.end(), way.places.begin(), way.places.end());
  std::sort(v.map.kinematic.begin(), v.map.kinematic.end());
  const auto column_at = [&](int place) {
    return static_cast<int>(std::lower_bound(v.map.kinematic.begin(), v.map.kinematic.end(), place) - v.map.kinematic.begin());
  };
  for (MotionColumns& m : v.poses) m.first = column_at(poses[m.first]);
  v.way_column.clear();
  for (int place : way.places) v.way_column.push_back(column_at(place));

  // L: the pose, the sensor's own numbers, the target's shape. Kernels leave out numbers that are held.
  v.columns = Columns();
  Columns& c = v.columns;
  const int square = v.model->whole_pose() ? -1 : table_.target_square[v.target_index];
  const int points = v.model->whole_pose() ? -1 : table_.target_points[v.target_index];
  const bool points_freed = points >= 0 && freed_[points];
  v.kernel = !v.covariances && !points_freed && (setup_.noise == NoiseMode::latent || setup_.noise == NoiseMode::none) ? v.model->kernel()
                                                                                                                       : nullptr;
  if (way.scan_step >= 0) {
    c.sensor_side = 6;
    c.joint = 12;
    c.total = way.rows();
  }
  std::fill(std::begin(v.own), std::end(v.own), -1);
  if (table_.sensor_block[v.sensor_index] >= 0) {
    const int first = table_.sensor_block[v.sensor_index];
    int own = 0, column = c.total;
    for (size_t b = 0; b < v.sensor->parameters.size(); ++b) {
      const int parameter = first + static_cast<int>(b);
      if (freed_[parameter]) {
        if (c.parameters < 0) c.parameters = c.total;
        for (size_t i = 0; i < freed_[parameter]->components.size(); ++i) {
          const int number = own + freed_[parameter]->components[i];
          v.own[number] = v.kernel ? column++ : c.total + number;
          v.map.own.push_back({v.own[number], shared(first_column_[parameter] + static_cast<int>(i))});
        }
      }
      own += table_.all[parameter].size();
    }
    if (c.parameters >= 0) c.total = v.kernel ? column : c.total + own;
  }
  if (square >= 0 && freed_[square]) {
    c.square = c.total++;
    v.map.own.push_back({c.square, shared(first_column_[square])});
  }
  if (points_freed) {
    c.points = c.total;
    c.total += table_.all[points].size();
    for (size_t i = 0; i < freed_[points]->components.size(); ++i)
      v.map.own.push_back({c.points + freed_[points]->components[i], shared(first_column_[points] + static_cast<int>(i))});
  }
}

/// What the kernels read: layouts of grids, each set of seen points once, and room for weights and measured numbers, view after view.
void Estimation::place_data() {
  std::map<std::pair<int, std::vector<int>>, size_t> layouts;
  for (auto& entry : plans_)
    for (ViewPlan& v : entry.second->views) {
      if (!v.kernel || !v.target->grid) continue;
      const auto placed = layouts.insert({{v.target_index, v.ids}, seen_.size()});
      v.points = placed.first->second;
      if (!placed.second) continue;
      for (int c = 0; c < 3; ++c)
        for (int i = 0; i < v.stride(); ++i) seen_.push_back(v.target->layout(c, v.ids[std::min<size_t>(i, v.ids.size() - 1)]));
    }
  for (PlacedSample& s : samples_)
    for (PlacedView& v : s.views) {
      if (v.plan->kernel) {
        v.measured = seen_.size();
        seen_.resize(seen_.size() + kWeights + static_cast<size_t>(v.plan->stride()) * v.plan->model->numbers(), 0.0);
      } else {
        v.whitening = static_cast<int>(whitenings_.size());
        whitenings_.emplace_back();
      }
    }
  reload();
}

void Estimation::reload() {
  for (PlacedSample& s : samples_)
    for (PlacedView& v : s.views) {
      if (!v.plan->kernel) continue;
      const int numbers = v.plan->model->numbers(), stride = v.plan->stride();
      double* to = seen_.data() + v.measured;
      for (int k = 0; k < v.plan->model->rows(); ++k) to[k] = 1 / v.view->sigma[k];
      for (size_t i = 0; i < v.plan->ids.size(); ++i)
        for (int k = 0; k < numbers; ++k) to[kWeights + static_cast<size_t>(k) * stride + i] = v.view->z[i * numbers + k];
    }
}

void Estimation::set_workers(int count) {
  size_t rows = 8, width = 0, columns = 6, ways = 0, steps = 0, way_columns = 0, noisy = 0, depth = 6;  // of the largest view and way
  for (const auto& entry : plans_) {
    const SamplePlan& plan = *entry.second;
    ways = std::max(ways, plan.ways.size());
    for (const Way& way : plan.ways) {
      steps = std::max(steps, way.path.size());
      depth = std::max(depth, static_cast<size_t>(way.rows()));
      way_columns = std::max({way_columns, way.places.size(), way.noise_sigma.size()});
      noisy = std::max(noisy, way.noise_sigma.size());
    }
    for (const ViewPlan& v : plan.views) {
      rows = std::max(rows, static_cast<size_t>(v.padded_rows()));
      width = std::max(width, static_cast<size_t>(v.columns.total));
      columns = std::max(columns, v.map.kinematic.size() + v.map.own.size());
    }
  }
  scratch_.resize(count);
  for (Scratch& s : scratch_) {
    s.points.resize(rig_.targets.size());
    for (size_t t = 0; t < s.points.size(); ++t) s.points[t].resize(3, rig_.targets[t].count());
    s.rows.resize(rows, width + 1);
    s.evaluated.resize(rows, width + 1);
    s.r.resize(rows);
    s.slopes.resize(rows);
    s.gathered.resize(3 * rows);
    s.projected.resize(noisy, width + 1);
    s.rooted.resize(noisy, width + 1);
    s.expand.reserve(static_cast<int>(width), static_cast<int>(depth), static_cast<int>(std::max(columns, way_columns)));
    s.motion.resize(rig_.tree.joints.size());
    s.moved.resize(rig_.tree.joints.size());
    s.reading.resize(rig_.tree.joints.size());
    s.ways.resize(ways);
    for (WalkedWay& way : s.ways) {
      way.frames.resize(steps);
      way.twists.resize(depth, way_columns);
    }
  }
}

void Estimation::prepare(const VectorXd& state) {
  for (size_t p = 0; p < charts_.size(); ++p) {
    if (charts_[p].size() == 0) continue;
    const int start = table_.all[p].start;
    const Vector6d xi = log_se3(inverse(get_pose(initial(), start)) * get_pose(state, start));
    const Matrix6d jacobian = right_jacobian_se3(xi);
    for (size_t i = 0; i < freed_[p]->components.size(); ++i) charts_[p].col(i) = jacobian.col(freed_[p]->components[i]);
  }
}

VectorXd Estimation::pack(const Values& values) const {
  VectorXd state(state_size_);
  state.head(values.shared.size()) = values.shared;
  for (const PlacedSample& s : samples_) {
    int at = s.start;
    for (int t : s.plan->targets) {
      const auto it = values.targets.find({s.index, t});
      set_pose(state, at, it == values.targets.end() ? Pose() : it->second);
      at += 12;
    }
    for (int j : s.plan->noisy) {
      const auto it = values.errors.find({s.index, j});
      state(at++) = it == values.errors.end() ? 0 : it->second;
    }
  }
  return state;
}

void Estimation::unpack(const VectorXd& state, Values& values) const {
  values.shared = state.head(table_.initial.size());
  for (const PlacedSample& s : samples_) {
    int at = s.start;
    for (int t : s.plan->targets) {
      values.targets[{s.index, t}] = get_pose(state, at);
      at += 12;
    }
    for (int j : s.plan->noisy) values.errors[{s.index, j}] = state(at++);
  }
}

std::vector<char> Estimation::influencing() const {
  std::vector<char> used(table_.all.size(), 0);
  const auto use = [&](int parameter) {
    if (parameter >= 0) used[parameter] = 1;
  };
  for (const PlacedSample& s : samples_)
    for (const PlacedView& v : s.views) {
      use(table_.sensor_pose[v.plan->sensor_index]);
      for (size_t b = 0; b < v.plan->sensor->parameters.size(); ++b) use(table_.sensor_block[v.plan->sensor_index] + static_cast<int>(b));
      use(table_.target_pose[v.plan->target_index]);
      if (!v.plan->sensor->model->whole_pose()) {
        use(table_.target_square[v.plan->target_index]);
        use(table_.target_points[v.plan->target_index]);
      }
      for (const PathStep& step : s.plan->ways[v.plan->way].path) {
        use(table_.joint_origin[step.joint]);
        if (!rig_.tree.joints[step.joint].moves()) continue;
        const int drv = driver(rig_.tree, step.joint).joint;
        for (int n = 0; n < rig_.joints[drv].model->size(); ++n) use(table_.joint_offset[drv] + n);
      }
    }
  return used;
}

/// Motions of all joints of the sample and their readings with errors.
void Estimation::motions(const PlacedSample& s, const VectorXd& state, Scratch& scratch) const {
  const Sample& sample = all_[s.index];
  const auto position = [&](int j) {
    scratch.reading[j] = sample.readings[j];
    if (!s.plan->noisy.empty()) {
      const auto it = std::find(s.plan->noisy.begin(), s.plan->noisy.end(), j);
      if (it != s.plan->noisy.end()) scratch.reading[j] += state(s.errors() + static_cast<int>(it - s.plan->noisy.begin()));
    }
    return rig_.joints[j].model->position(scratch.reading[j], state.data() + table_.all[table_.joint_offset[j]].start);
  };
  for (int j : s.plan->joints) {
    const Driver d = driver(rig_.tree, j);
    scratch.motion[j] = joint_motion(rig_.tree.joints[j], d.factor * position(d.joint) + d.offset);
    scratch.moved[j] = get_pose(state, table_.all[table_.joint_origin[j]].start) * scratch.motion[j];
  }
}

/// Walks the sample's ways. A step's frame is that of the joint before its motion where its origin is estimated; elsewhere one in which
/// the joint's axis is the same.
void Estimation::walk_ways(const PlacedSample& s, const VectorXd& state, Scratch& scratch) const {
  for (size_t w = 0; w < s.plan->ways.size(); ++w) {
    const Way& way = s.plan->ways[w];
    WalkedWay& walked = scratch.ways[w];
    Pose here;
    for (int k = 0; k < static_cast<int>(way.path.size()); ++k) {
      const int j = way.path[k].joint;
      const bool down = way.path[k].direction > 0, moves = rig_.tree.joints[j].moves();
      const auto origin = [&] { return get_pose(state, table_.all[table_.joint_origin[j]].start); };
      if (k == way.scan_step) {
        // The joint itself stays out: its motion is the sensor's. Down: origin is on the sensor's side; up: on the far one.
        walked.link_T_before = down ? here * origin() : here;
        walked.frames[k] = down ? walked.link_T_before : Pose();
        here = down ? Pose() : inverse(origin());  // from the far side on
        continue;
      }
      if (freed_[table_.joint_origin[j]])
        walked.frames[k] = down ? here * origin() : moves ? here * inverse(scratch.motion[j]) : here;
      else if (!down)
        walked.frames[k] = here;
      const Pose step = moves ? scratch.moved[j] : origin();
      here = k == 0 ? (down ? step : inverse(step)) : here * (down ? step : inverse(step));
      if (down && !freed_[table_.joint_origin[j]]) walked.frames[k] = here;
    }
    walked.link_T_far = here;
  }
}

/// Columns of a way, in the frame of the sensor's link (rows 0-5; with a scanning joint 6-11, behind it 0-5, its own numbers from 12 on).
void Estimation::way_columns(const Way& way, const std::vector<MotionColumns>& program, int count, const VectorXd& state, Scratch& scratch,
                             WalkedWay& walked) const {
  auto m = walked.twists.topLeftCorner(way.rows(), count);
  m.setZero();
  for (const MotionColumns& column : program) {
    const PathStep& step = way.path[column.step];
    const bool sensor_side = way.scan_step >= 0 && (column.step < way.scan_step || (column.step == way.scan_step && step.direction > 0));
    const int row = sensor_side ? 6 : 0;
    if (column.source == Source::origin) {
      const Matrix6d twist = step.direction * adjoint(walked.frames[column.step]);
      if (charts_[column.parameter].size() > 0)
        m.block(row, column.first, 6, column.count) += twist.lazyProduct(charts_[column.parameter]);
      else
        m.block<6, 6>(row, column.first) += twist;
      continue;
    }
    if (column.step == way.scan_step) {  // the scanning joint's own columns of L
      m(12 + column.number, column.first) += 1;
      continue;
    }
    const JointModel& model = *rig_.joints[column.joint].model;
    const double* own = state.data() + table_.all[table_.joint_offset[column.joint]].start;
    const double reading = scratch.reading[column.joint];
    const double by =
        column.factor * (column.source == Source::joint_number ? model.by_own(column.number, reading, own) : model.by_reading(reading, own));
    m.block<6, 1>(row, column.first) += by * position_twist(rig_.tree.joints[step.joint], step.direction, walked.frames[column.step]);
  }
}

/// Where the pose of the view's target stands in the state.
int Estimation::target_start(const PlacedView& v, const PlacedSample& s) const {
  return v.plan->target_slot >= 0 ? s.start + 12 * v.plan->target_slot : table_.all[table_.target_pose[v.plan->target_index]].start;
}

/// Poses of the view into scratch.input (and scratch.scan).
void Estimation::view_poses(const PlacedView& v, const PlacedSample& s, const VectorXd& state, Scratch& scratch) const {
  const Way& way = s.plan->ways[v.plan->way];
  const WalkedWay& walked = scratch.ways[v.plan->way];
  const Pose sensor_T_link = inverse(get_pose(state, table_.all[table_.sensor_pose[v.plan->sensor_index]].start));
  const Pose link_T_target = walked.link_T_far * get_pose(state, target_start(v, s));
  ViewInput& in = scratch.input;
  const int block = table_.sensor_block[v.plan->sensor_index];
  in.parameters = block >= 0 ? state.data() + table_.all[block].start : nullptr;
  in.scan = nullptr;
  if (way.scan_step < 0) {
    in.sensor_T_target = sensor_T_link * link_T_target;
    return;
  }
  const int j = way.path[way.scan_step].joint;
  Scan& scan = scratch.scan;
  scan.sensor_T_before = sensor_T_link * walked.link_T_before;
  scan.behind_T_target = in.sensor_T_target = link_T_target;
  scan.axis = rig_.tree.joints[j].axis;
  scan.prismatic = rig_.tree.joints[j].type == JointType::prismatic;
  scan.direction = way.path[way.scan_step].direction;
  scan.model = rig_.joints[j].model.get();
  scan.own = state.data() + table_.all[table_.joint_offset[j]].start;
  in.scan = &scan;
}

/// The rest of the sensor's input.
void Estimation::view_input(const PlacedView& v, const VectorXd& state, Scratch& scratch) const {
  ViewInput& in = scratch.input;
  Eigen::Matrix3Xd& points = scratch.points[v.plan->target_index];
  if (v.plan->target->grid) {
    points = state(table_.all[table_.target_square[v.plan->target_index]].start) * v.plan->target->layout;
    in.layout = &v.plan->target->layout;
  } else {
    const Parameter& p = table_.all[table_.target_points[v.plan->target_index]];
    points = Eigen::Map<const Eigen::Matrix3Xd>(state.data() + p.start, 3, p.size() / 3);
    in.layout = nullptr;
  }
  in.points = &points;
  in.ids = v.plan->ids.data();
  in.count = static_cast<int>(v.plan->ids.size());
  in.z = v.view->z.data();
}

/// Columns of the way as the sensor sees them, column c to column at[c] of M.
void Estimation::seen_from_sensor(const PlacedView& v, const PlacedSample& s, const VectorXd& state, const int* at, int count,
                                  Scratch& scratch) const {
  const Way& way = s.plan->ways[v.plan->way];
  const Pose link_T_sensor = get_pose(state, table_.all[table_.sensor_pose[v.plan->sensor_index]].start);
  const Matrix3d sensor_R_link = link_T_sensor.rotation.transpose();
  const MatrixXd& twists = scratch.ways[v.plan->way].twists;
  RowMatrix& m = scratch.expand.m;
  const int moved = way.scan_step >= 0 ? 6 : 0;  // rows that are seen from the sensor's link
  for (int c = 0; c < count; ++c) {
    const Vector3d w = twists.block<3, 1>(moved + 3, c), x = twists.block<3, 1>(moved, c) + w.cross(link_T_sensor.translation);
    if (moved) {
      m.block<6, 1>(0, at[c]) = twists.block<6, 1>(0, c);
      for (int row = 12; row < way.rows(); ++row) m(row, at[c]) = twists(row, c);
    }
    m.block<3, 1>(moved, at[c]).noalias() = sensor_R_link * x;
    m.block<3, 1>(moved + 3, at[c]).noalias() = sensor_R_link * w;
  }
}

/// M (way's rows x columns) of a view into the top left corner of scratch.m; view_poses() and way_columns() have been called.
void Estimation::kinematic_matrix(const PlacedView& v, const PlacedSample& s, const VectorXd& state, Scratch& scratch) const {
  const Way& way = s.plan->ways[v.plan->way];
  RowMatrix& m = scratch.expand.m;
  if (way.scan_step >= 0) m.setZero();
  for (const MotionColumns& column : v.plan->poses) {
    const bool sensor_side = column.source == Source::sensor_pose;
    Matrix6d twist;
    if (sensor_side)
      twist = -Matrix6d::Identity();
    else
      twist = adjoint(scratch.input.sensor_T_target);
    const int row = sensor_side && way.scan_step >= 0 ? 6 : 0;
    if (column.parameter >= 0 && charts_[column.parameter].size() > 0)
      m.block(row, column.first, 6, column.count) = twist.lazyProduct(charts_[column.parameter]);
    else
      m.block<6, 6>(row, column.first) = twist;
  }
  seen_from_sensor(v, s, state, v.plan->way_column.data(), static_cast<int>(v.plan->way_column.size()), scratch);
}

/// Whitened rows [L r] of a view into scratch.rows (derivatives) or r alone into scratch.r, the loss's slopes applied; cost added.
bool Estimation::view_rows(const PlacedView& v, const PlacedSample& s, const VectorXd& state, Scratch& scratch, bool derivatives,
                           Cost& cost) const {
  view_poses(v, s, state, scratch);
  return v.plan->kernel ? kernel_rows(v, state, scratch, derivatives, cost) : plain_rows(v, state, scratch, derivatives, cost);
}

/// view_rows() by the sensor's kernel.
bool Estimation::kernel_rows(const PlacedView& v, const VectorXd& state, Scratch& scratch, bool derivatives, Cost& cost) const {
  const int stride = v.plan->stride(), w = v.plan->columns.total, rows = v.plan->padded_rows(),
            count = static_cast<int>(v.plan->ids.size());
  const double* points = seen_.data() + v.plan->points;
  if (!v.plan->target->grid) {
    const double* from = state.data() + table_.all[table_.target_points[v.plan->target_index]].start;
    for (int i = 0; i < stride; ++i)
      for (int c = 0; c < 3; ++c) scratch.gathered[c * stride + i] = from[3 * v.plan->ids[std::min(i, count - 1)] + c];
    points = scratch.gathered.data();
  }
  const Pose& pose = scratch.input.sensor_T_target;
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rotation = pose.rotation;
  const PointView view = {points,
                          v.plan->target->grid ? state(table_.all[table_.target_square[v.plan->target_index]].start) : 1.0,
                          rotation.data(),
                          pose.translation.data(),
                          scratch.input.parameters,
                          seen_.data() + v.measured + kWeights,
                          seen_.data() + v.measured,
                          count,
                          stride};
  const PointRows to = {derivatives ? scratch.rows.col(w).data() : scratch.r.data(), derivatives ? scratch.rows.data() : nullptr,
                        scratch.rows.outerStride(), v.plan->own, v.plan->columns.square};
  double squares;
  if (!v.plan->kernel(view, to, squares)) return false;
  cost.chi2 += squares;
  if (setup_.loss.kind == LossKind::none) {
    cost.twice += squares;
    return true;
  }
  bool scaled = false;
  std::fill_n(scratch.slopes.begin(), rows, 0.0);
  for (int i = 0; i < count; ++i) {
    double squared = 0, slope;
    for (int k = 0; k * stride < rows; ++k) squared += to.r[k * stride + i] * to.r[k * stride + i];
    cost.twice += losses_[v.plan->sensor_index](squared, slope);
    scaled = scaled || slope != 1;
    for (int k = 0; k * stride < rows; ++k) scratch.slopes[k * stride + i] = std::sqrt(slope);
  }
  if (!derivatives || !scaled) return true;
  for (int c = 0; c <= w; ++c) {
    double* column = scratch.rows.col(c).data();
    for (int i = 0; i < rows; ++i) column[i] *= scratch.slopes[i];
  }
  return true;
}

/// view_rows() by the sensor's evaluate().
bool Estimation::plain_rows(const PlacedView& v, const VectorXd& state, Scratch& scratch, bool derivatives, Cost& cost) const {
  view_input(v, state, scratch);
  const int k = v.plan->model->rows(), blocks = v.plan->blocks(), rows = k * blocks, w = v.plan->columns.total;
  auto weighted = scratch.evaluated.topLeftCorner(rows, w + 1);
  if (derivatives) {
    weighted.setZero();
    Eigen::Ref<RowMatrix> l(weighted.leftCols(w));
    if (!v.plan->model->evaluate(scratch.input, v.plan->columns, scratch.r.data(), &l)) return false;
    weighted.col(w) = scratch.r.head(rows);
  } else if (!v.plan->model->evaluate(scratch.input, v.plan->columns, scratch.r.data(), nullptr)) {
    return false;
  }
  const Whitening& white = whitenings_[v.whitening];
  const bool marginal = setup_.noise == NoiseMode::marginal;  // the view's residuals belong together
  for (int b = 0; b < blocks; ++b) {
    auto r = scratch.r.segment(b * k, k);
    if (!white.block.empty()) {
      double* rows_of_block = weighted.row(b * k).data();
      const Eigen::Index ld = weighted.outerStride();
      if (k == 3) {
        multiply_rows<3>(white.block[b].data(), k, r.data(), 1, 1);
        if (derivatives) multiply_rows<3>(white.block[b].data(), k, rows_of_block, ld, w + 1);
      } else {
        multiply_rows<0>(white.block[b].data(), k, r.data(), 1, 1);
        if (derivatives) multiply_rows<0>(white.block[b].data(), k, rows_of_block, ld, w + 1);
      }
    } else {
      r = r.cwiseProduct(white.inverse_sigma);
      if (derivatives)
        for (int i = 0; i < k; ++i) weighted.row(b * k + i) *= white.inverse_sigma(i);
    }
    if (marginal) continue;
    const double squared = r.squaredNorm();
    double slope;
    cost.chi2 += squared;
    cost.twice += losses_[v.plan->sensor_index](squared, slope);
    if (derivatives && slope != 1) weighted.middleRows(b * k, k) *= std::sqrt(slope);
  }
  if (marginal) {
    auto all = scratch.r.head(rows);
    if (white.noise.size() > 0) {
      const Eigen::Index q = white.noise.cols();
      const auto take_away = [&](auto&& rows_of) {  // rows -= U root U' rows
        auto projected = scratch.projected.topLeftCorner(q, rows_of.cols()), rooted = scratch.rooted.topLeftCorner(q, rows_of.cols());
        projected.noalias() = white.noise.transpose().lazyProduct(rows_of);
        rooted.noalias() = white.root.lazyProduct(projected);
        rows_of.noalias() -= white.noise.lazyProduct(rooted);
      };
      if (derivatives) take_away(weighted);
      take_away(all);
    }
    double squared = all.squaredNorm(), slope;
    cost.chi2 += squared;
    cost.twice += losses_[v.plan->sensor_index](squared, slope);
    if (derivatives && slope != 1) weighted *= std::sqrt(slope);
  }
  if (derivatives) {
    scratch.rows.topLeftCorner(rows, w + 1) = weighted;
    scratch.rows.block(rows, 0, v.plan->padded_rows() - rows, w + 1).setZero();
  }
  return true;
}

bool Estimation::evaluate(int group, const VectorXd& state, int worker, Cost& cost) const {
  cost = {};
  if (group == static_cast<int>(samples_.size())) {
    PriorRow row;
    for (size_t i = 0; i < setup_.priors.size(); ++i) {
      prior_row(i, state, false, row);
      cost.twice = cost.chi2 += row.r * row.r;
    }
    return true;
  }
  const PlacedSample& s = samples_[group];
  Scratch& scratch = scratch_[worker];
  motions(s, state, scratch);
  walk_ways(s, state, scratch);
  for (const PlacedView& v : s.views)
    if (!view_rows(v, s, state, scratch, false, cost)) return false;
  const int errors = s.errors();
  for (size_t i = 0; i < s.plan->noisy.size(); ++i) {
    const double e = state(errors + static_cast<int>(i)) / rig_.joints[s.plan->noisy[i]].sigma;
    cost.twice += e * e;
    cost.chi2 += e * e;
  }
  return true;
}

bool Estimation::linearise(int group, const VectorXd& state, int worker, const GroupEquations& to, Cost& cost) const {
  cost = {};
  if (group == static_cast<int>(samples_.size())) {
    PriorRow row;
    for (size_t i = 0; i < setup_.priors.size(); ++i) {
      prior_row(i, state, true, row);
      cost.twice = cost.chi2 += row.r * row.r;
      for (int a = 0; a < row.count; ++a) {
        for (int b = 0; b <= a; ++b)
          to.shared[to.origin[to.row[row.place + b]] + to.row[row.place + a]] += row.derivative[a] * row.derivative[b];
        to.gradient[to.row[row.place + a]] += row.derivative[a] * row.r;
      }
    }
    return true;
  }
  const PlacedSample& s = samples_[group];
  Scratch& scratch = scratch_[worker];
  const int size = groups_[group].size();
  motions(s, state, scratch);
  walk_ways(s, state, scratch);
  for (size_t w = 0; w < s.plan->ways.size(); ++w)
    way_columns(s.plan->ways[w], s.plan->ways[w].motion, static_cast<int>(s.plan->ways[w].places.size()), state, scratch, scratch.ways[w]);
  for (const PlacedView& v : s.views) {
    if (!view_rows(v, s, state, scratch, true, cost)) return false;
    const int w = v.plan->columns.total + 1;
    kernels().gram(scratch.rows.data(), v.plan->padded_rows(), scratch.rows.outerStride(), w, scratch.expand.gram.data(),
                   static_cast<int>(scratch.expand.gram.outerStride()));
    kinematic_matrix(v, s, state, scratch);
    expand(w - 1, s.plan->ways[v.plan->way].rows(), v.plan->map, groups_[group].private_size, size, scratch.expand, to);
  }
  const int errors = s.errors();
  for (size_t i = 0; i < s.plan->noisy.size(); ++i) {
    const double w = 1 / rig_.joints[s.plan->noisy[i]].sigma, e = state(errors + static_cast<int>(i)) * w;
    const size_t at = 6 * s.plan->targets.size() + i;
    to.rows[at * to.stride + at] += w * w;
    to.rows[at * to.stride + size] += w * e;
    cost.twice += e * e;
    cost.chi2 += e * e;
  }
  return true;
}

/// Row of prior i, derivatives only if asked for: they stand at places place .. place + count - 1 of the priors' group. `row` may hold
/// that of prior i - 1: priors of one pose share its logarithm.
void Estimation::prior_row(size_t i, const VectorXd& state, bool derivatives, PriorRow& row) const {
  const Prior& prior = setup_.priors[i];
  const Parameter& p = table_.all[prior.parameter];
  const std::vector<int>& touched = groups_.back().columns;
  const std::vector<int>& components = freed_[prior.parameter]->components;
  const bool same = row.parameter == prior.parameter, whole = p.pose && freed_[prior.parameter]->whole(p);
  row.parameter = prior.parameter;
  if (p.pose) {
    if (!same) row.log = log_se3(inverse(get_pose(initial(), p.start)) * get_pose(state, p.start));
    if (!same && derivatives && whole) row.inverse_jacobian = right_jacobian_se3(row.log).inverse();
    row.r = row.log(prior.component) / prior.sigma;
  } else {
    row.r = (state(p.start + prior.component) - initial()(p.start + prior.component)) / prior.sigma;
  }
  if (!derivatives) return;
  row.place = static_cast<int>(std::lower_bound(touched.begin(), touched.end(), first_column_[prior.parameter]) - touched.begin());
  row.count = whole ? 6 : 1;
  if (whole) {
    for (int k = 0; k < 6; ++k) row.derivative[k] = row.inverse_jacobian(prior.component, k) / prior.sigma;
  } else {
    row.place += static_cast<int>(std::find(components.begin(), components.end(), prior.component) - components.begin());
    row.derivative[0] = 1 / prior.sigma;
  }
}

namespace {

/// An upper triangle with the same Gram matrix, where that has fewer rows.
MatrixXd compressed(MatrixXd rows) {
  if (rows.rows() <= rows.cols()) return rows;
  triangularise(rows);
  return MatrixXd(rows.topRows(rows.cols()).triangularView<Eigen::Upper>());
}

}  // namespace

bool Estimation::group_rows(int group, const VectorXd& state, int worker, bool compress, MatrixXd& rows,
                            std::vector<NoiseRows>* whose) const {
  const GroupShape& shape = groups_[group];
  const int size = shape.size();
  rows.setZero(shape.rows, size + 1);
  if (whose) whose->clear();
  if (group == static_cast<int>(samples_.size())) {
    PriorRow row;
    for (size_t i = 0; i < setup_.priors.size(); ++i) {
      prior_row(i, state, true, row);
      for (int k = 0; k < row.count; ++k) rows(static_cast<Eigen::Index>(i), row.place + k) = row.derivative[k];
      rows(static_cast<Eigen::Index>(i), size) = row.r;
    }
    if (whose) whose->push_back({nullptr, 0, -1, 0, shape.rows});
    return true;
  }
  const PlacedSample& s = samples_[group];
  Scratch& scratch = scratch_[worker];
  Eigen::Index used = 0;
  Cost cost;
  motions(s, state, scratch);
  walk_ways(s, state, scratch);
  for (size_t w = 0; w < s.plan->ways.size(); ++w)
    way_columns(s.plan->ways[w], s.plan->ways[w].motion, static_cast<int>(s.plan->ways[w].places.size()), state, scratch, scratch.ways[w]);
  for (const PlacedView& v : s.views) {
    if (!view_rows(v, s, state, scratch, true, cost)) return false;
    const int k = v.plan->model->rows(), kinematic_rows = s.plan->ways[v.plan->way].rows();
    MatrixXd view(v.plan->rows(), v.plan->columns.total + 1);
    for (int b = 0; b < v.plan->blocks(); ++b)
      for (int i = 0; i < k; ++i) view.row(b * k + i) = scratch.rows.row(v.plan->row(b, i)).head(view.cols());
    if (whose) {
      const std::vector<NoisePart> parts = v.plan->model->noise_parts();
      MatrixXd all(view.rows(), view.cols());
      Eigen::Index filled = 0;
      for (size_t p = 0; p < parts.size(); ++p) {
        const int count = parts.size() == 1 ? k : parts[p].count;
        MatrixXd part(v.plan->blocks() * count, view.cols());
        for (int b = 0; b < v.plan->blocks(); ++b) part.middleRows(b * count, count) = view.middleRows(b * k + parts[p].first, count);
        part = compressed(std::move(part));
        all.middleRows(filled, part.rows()) = part;
        whose->push_back({v.view, static_cast<int>(p), -1, static_cast<int>(used + filled), static_cast<int>(part.rows())});
        filled += part.rows();
      }
      view = all.topRows(filled).eval();
    } else if (compress) {
      view = compressed(std::move(view));
    }
    kinematic_matrix(v, s, state, scratch);
    const auto m = scratch.expand.m.topLeftCorner(kinematic_rows, static_cast<Eigen::Index>(v.plan->map.kinematic.size()));
    MatrixXd kinematic = view.leftCols(kinematic_rows) * m;
    const VectorXd parts = m.cwiseAbs2().transpose() * view.leftCols(kinematic_rows).colwise().squaredNorm().transpose();
    for (Eigen::Index i = 0; i < kinematic.cols(); ++i)
      if (kinematic.col(i).squaredNorm() <= kCancelled * parts(i)) kinematic.col(i).setZero();
    auto part = rows.middleRows(used, view.rows());
    for (size_t i = 0; i < v.plan->map.kinematic.size(); ++i) part.col(v.plan->map.kinematic[i]) += kinematic.col(i);
    for (const auto& own : v.plan->map.own) part.col(own.second) += view.col(own.first);
    part.col(size) = view.col(view.cols() - 1);
    used += view.rows();
  }
  const int errors = s.errors();
  for (size_t i = 0; i < s.plan->noisy.size(); ++i, ++used) {
    const double w = 1 / rig_.joints[s.plan->noisy[i]].sigma;
    if (whose) whose->push_back({nullptr, 0, s.plan->noisy[i], static_cast<int>(used), 1});
    rows(used, static_cast<Eigen::Index>(6 * s.plan->targets.size() + i)) = w;
    rows(used, size) = w * state(errors + static_cast<int>(i));
  }
  rows.conservativeResize(used, size + 1);
  return true;
}

bool Estimation::square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const {
  return group_rows(group, state, worker, true, rows, nullptr);
}

bool Estimation::noise_rows(int group, const VectorXd& state, MatrixXd& rows, std::vector<NoiseRows>& whose) const {
  return group_rows(group, state, 0, true, rows, &whose);
}

bool Estimation::explicit_rows(int group, const VectorXd& state, MatrixXd& rows) const {
  return group_rows(group, state, 0, false, rows, nullptr);
}

void Estimation::retract(const VectorXd& state, const VectorXd& shared_step, const VectorXd& private_step, VectorXd& moved) const {
  moved = state;
  for (const Freed& f : setup_.free) {
    const Parameter& p = table_.all[f.parameter];
    const auto step = shared_step.segment(first_column_[f.parameter], static_cast<Eigen::Index>(f.components.size()));
    if (!p.pose) {
      for (size_t i = 0; i < f.components.size(); ++i) moved(p.start + f.components[i]) += step(static_cast<Eigen::Index>(i));
    } else if (f.whole(p)) {
      set_pose(moved, p.start, get_pose(state, p.start) * exp_se3(step));
    } else {
      const Pose origin = get_pose(initial(), p.start);
      Vector6d xi = log_se3(inverse(origin) * get_pose(state, p.start));
      for (size_t i = 0; i < f.components.size(); ++i) xi(f.components[i]) += step(static_cast<Eigen::Index>(i));
      set_pose(moved, p.start, origin * exp_se3(xi));
    }
  }
  Eigen::Index at = 0;
  for (const PlacedSample& s : samples_) {
    int place = s.start;
    for (size_t t = 0; t < s.plan->targets.size(); ++t, place += 12, at += 6)
      set_pose(moved, place, get_pose(state, place) * exp_se3(private_step.segment<6>(at)));
    for (size_t i = 0; i < s.plan->noisy.size(); ++i) moved(place++) += private_step(at++);
  }
}

bool Estimation::renew(const VectorXd& state) {
  prepare(state);
  bool depends = false;
  Scratch& scratch = scratch_[0];
  for (PlacedSample& s : samples_) {
    bool walked = false;
    for (PlacedView& v : s.views) {
      if (v.plan->kernel) continue;
      const Way& way = s.plan->ways[v.plan->way];
      Whitening& white = whitenings_[v.whitening];
      const View& view = *v.view;
      const int k = v.plan->model->rows(), blocks = v.plan->blocks();
      const Eigen::Map<const VectorXd> sigma(view.sigma.data(), static_cast<Eigen::Index>(view.sigma.size()));
      const bool own_noise = v.plan->model->has_own_noise(), joints = !way.noise.empty();
      depends = depends || own_noise || joints;
      if (!own_noise && sigma.size() == k) white.inverse_sigma = sigma.cwiseInverse();
      white.block.clear();
      if (!own_noise && !joints && view.covariance.empty()) continue;
      if (!walked) {
        motions(s, state, scratch);
        walk_ways(s, state, scratch);
        walked = true;
      }
      view_poses(v, s, state, scratch);
      view_input(v, state, scratch);
      if (own_noise || !view.covariance.empty()) white.block.resize(blocks);
      for (int i = 0; i < static_cast<int>(white.block.size()); ++i) {
        SmallMatrix& root = white.block[i];
        if (!view.covariance.empty()) {
          root = inverse_square_root(view.covariance[i]);
          continue;
        }
        v.plan->model->own_noise(scratch.input, i, scratch.own_noise);
        const SmallMatrix b = scratch.own_noise;
        if (b.rows() == 3 && b.cols() == 3)
          root = sigma.cwiseInverse().asDiagonal() * Matrix3d(Matrix3d(b).inverse());
        else
          root = b.rows() == b.cols() ? SmallMatrix(sigma.cwiseInverse().asDiagonal() * SmallMatrix(b.inverse()))
                                      : inverse_square_root(covariance_of(b, sigma));
      }
      if (!joints) continue;
      // Jq S^1/2 = L Mq sigma, unwhitened.
      RowMatrix l = RowMatrix::Zero(k * blocks, v.plan->columns.total);
      VectorXd r(k * blocks);
      Eigen::Ref<RowMatrix> reference(l);
      if (!v.plan->model->evaluate(scratch.input, v.plan->columns, r.data(), &reference))
        continue;  // undefined: the linearisation will say so
      const int noisy = static_cast<int>(way.noise_sigma.size());
      way_columns(way, way.noise, noisy, state, scratch, scratch.ways[v.plan->way]);
      std::vector<int> in_order(noisy);
      std::iota(in_order.begin(), in_order.end(), 0);
      seen_from_sensor(v, s, state, in_order.data(), noisy, scratch);
      MatrixXd jq = l.leftCols(way.rows()) * scratch.expand.m.topLeftCorner(way.rows(), noisy);
      for (int i = 0; i < noisy; ++i) jq.col(i) *= way.noise_sigma[i];
      if (setup_.noise == NoiseMode::point) {
        white.block.resize(blocks);
        for (int i = 0; i < blocks; ++i) {
          SmallMatrix covariance = jq.middleRows(i * k, k) * jq.middleRows(i * k, k).transpose();
          if (!view.covariance.empty()) {
            covariance += view.covariance[i];
          } else if (own_noise) {
            v.plan->model->own_noise(scratch.input, i, scratch.own_noise);
            covariance += covariance_of(scratch.own_noise, sigma);
          } else {
            covariance.diagonal() += sigma.cwiseAbs2();
          }
          white.block[i] = inverse_square_root(covariance);
        }
      } else {
        for (int i = 0; i < blocks; ++i)
          jq.middleRows(i * k, k) = white.block.empty() ? MatrixXd(white.inverse_sigma.asDiagonal() * jq.middleRows(i * k, k))
                                                        : MatrixXd(white.block[i] * jq.middleRows(i * k, k));
        white.noise = jq;
        const SymmetricEigen eigen = symmetric_eigen(jq.transpose() * jq);
        const VectorXd w = eigen.values.cwiseMax(0.0);
        const MatrixXd& q = eigen.vectors;
        // 1 - 1 / sqrt(1 + w) over w, without cancellation for small w.
        const VectorXd root = w.unaryExpr([](double x) { return 1 / (std::sqrt(1 + x) * (1 + std::sqrt(1 + x))); });
        white.root = q * root.asDiagonal() * q.transpose();
      }
    }
  }
  return depends;
}

std::vector<ViewResiduals> Estimation::residuals(const VectorXd& state) const {
  std::vector<ViewResiduals> out;
  Scratch& scratch = scratch_[0];
  for (const PlacedSample& s : samples_) {
    motions(s, state, scratch);
    walk_ways(s, state, scratch);
    for (const PlacedView& v : s.views) {
      ViewResiduals r;
      r.view = v.view;
      r.sample = s.index;
      Cost cost;
      view_rows(v, s, state, scratch, false, cost);
      r.whitened.resize(v.plan->rows());
      const int k = v.plan->model->rows();
      for (int b = 0; b < v.plan->blocks(); ++b)
        for (int i = 0; i < k; ++i) r.whitened(b * k + i) = scratch.r(v.plan->row(b, i));
      view_input(v, state, scratch);
      const SensorModel& model = *v.plan->sensor->model;  // whatever the mode whitens: what the sensor itself measures
      r.raw.resize(model.rows() * model.blocks(static_cast<int>(v.plan->ids.size())));
      if (!model.evaluate(scratch.input, v.plan->columns, r.raw.data(), nullptr)) r.raw.setConstant(std::nan(""));
      out.push_back(std::move(r));
    }
  }
  return out;
}

}  // namespace kincal
