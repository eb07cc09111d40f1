#include "estimation.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace kincal {
namespace {

/// What fills columns of M.
enum class Source { offset, scale, error, origin, sensor_pose, target_pose };

}  // namespace

struct Estimation::MotionColumns {
  Source source;
  int step = -1;       // in the path, for joints
  double factor = 1;   // d position / d position of the driver
  int joint = -1;      // the driver, whose reading and scale count
  int parameter = -1;  // of a partly freed pose, for its chart
  int first = 0;       // column of M
  int count = 1;
};

namespace {

/// How a view's residuals become white.
struct Whitening {
  VectorXd inverse_sigma;       // one a row of a block, where nothing else is said
  std::vector<MatrixXd> block;  // one a block, or empty
  MatrixXd noise;               // mode marginal: U, whitened own noise assumed; or empty
  MatrixXd root;                // (1 + U U')^-1/2 = 1 - noise root noise'
};

MatrixXd inverse_square_root(const MatrixXd& c) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(c);
  const VectorXd w = eigen.eigenvalues().cwiseMax(1e-14 * eigen.eigenvalues().maxCoeff());
  return eigen.eigenvectors() * w.cwiseSqrt().cwiseInverse().asDiagonal() * eigen.eigenvectors().transpose();
}

}  // namespace

struct Estimation::PlacedView {
  const View* view = nullptr;
  const Sensor* sensor = nullptr;
  const Target* target = nullptr;
  const SensorModel* model = nullptr;
  std::vector<int> ids;
  Path path;             // from the sensor's link to the target's link, or to the base
  int scan_step = -1;    // step of the scanning joint
  int target_start = 0;  // of the target's pose in the state
  Columns columns;
  ViewColumns map;
  std::vector<MotionColumns> motion;  // M
  std::vector<MotionColumns> noise;   // Mq of modes marginal and point: one column a noisy joint
  std::vector<double> noise_sigma;
  int kinematic_rows = 6;
  Whitening whitening;

  int blocks() const { return model->blocks(static_cast<int>(ids.size())); }
  int rows() const { return blocks() * model->rows(); }
};

struct Estimation::PlacedSample {
  int index = -1;  // in all_
  std::vector<PlacedView> views;
  std::vector<int> targets;  // free ones, in the order of their blocks
  std::vector<int> noisy;    // joints with an error unknown, in order
  std::vector<int> joints;   // joints whose motion some view needs
  int start = 0;             // of its part of the state: poses, then errors
};

struct Estimation::Scratch {
  std::vector<Pose> motion;     // by joint
  std::vector<double> reading;  // by joint, error included
  std::vector<Pose> frames;     // by step of the path
  ViewInput input;
  Scan scan;
  Eigen::Matrix3Xd points;
  MatrixXd m;      // in its top left corner: M of the view at hand
  RowMatrix rows;  // likewise [L r]
  VectorXd r;
  ExpandScratch expand;
};

Estimation::~Estimation() = default;

Estimation::Estimation(const Rig& rig, const ParameterTable& table, const std::vector<Sample>& all, const std::vector<int>& samples,
                       EstimationSetup setup)
    : rig_(rig), table_(table), all_(all), setup_(std::move(setup)) {
  first_column_.assign(table.all.size(), -1);
  freed_.assign(table.all.size(), nullptr);
  charts_.resize(table.all.size());
  for (const Freed& f : setup_.free) {
    first_column_[f.parameter] = static_cast<int>(columns_.size());
    freed_[f.parameter] = &f;
    for (int c : f.components) columns_.push_back({f.parameter, c});
    if (table.all[f.parameter].pose && !f.whole(table.all[f.parameter])) charts_[f.parameter] = MatrixXd::Zero(6, f.components.size());
  }
  state_size_ = static_cast<int>(table.initial.size());
  for (int index : samples) {
    PlacedSample s = place_sample(index);
    if (s.views.empty()) continue;
    s.start = state_size_;
    state_size_ += static_cast<int>(12 * s.targets.size() + s.noisy.size());
    samples_.push_back(std::move(s));
  }
  for (PlacedSample& s : samples_) groups_.push_back(place_columns(s));
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

/// The sample's views that take part, their ways between sensor and target, and what the sample's private unknowns are.
Estimation::PlacedSample Estimation::place_sample(int index) const {
  PlacedSample s;
  s.index = index;
  for (const View& view : all_[index].views) {
    if (std::find(setup_.sensors.begin(), setup_.sensors.end(), view.sensor) == setup_.sensors.end() ||
        (setup_.only_target >= 0 && view.target != setup_.only_target))
      continue;
    PlacedView v;
    v.view = &view;
    v.sensor = &rig_.sensors[view.sensor];
    v.target = &rig_.targets[view.target];
    v.model = v.sensor->model.get();
    if (setup_.noise == NoiseMode::point && v.model->point_form()) v.model = v.model->point_form();
    if (view.covariance.empty() && static_cast<int>(view.sigma.size()) != v.model->sigmas())
      throw std::invalid_argument(view.where + ": sensor '" + v.sensor->name + "' takes " + std::to_string(v.model->sigmas()) +
                                  " sigmas, not " + std::to_string(view.sigma.size()));
    v.ids = view.ids;
    if (v.ids.empty() && !v.model->whole_pose())
      for (int i = 0; i < v.target->count(); ++i) v.ids.push_back(i);
    const int far = v.target->link >= 0 ? v.target->link : rig_.base;
    v.path = find_path(rig_.tree, v.sensor->link, far);
    if (v.model->scans()) {
      const auto scan_step = [&] {
        for (size_t k = 0; k < v.path.size(); ++k)
          if (v.path[k].joint == v.sensor->scanning_joint) return static_cast<int>(k);
        return -1;
      };
      v.scan_step = scan_step();
      if (v.scan_step < 0) {  // sensor and target both behind the joint: its reading differs between them, nothing cancels
        v.path = find_path(rig_.tree, v.sensor->link, rig_.base);
        v.scan_step = scan_step();
        for (const PathStep& step : find_path(rig_.tree, rig_.base, far)) v.path.push_back(step);
        if (v.scan_step < 0)
          throw std::invalid_argument("sensor '" + v.sensor->name + "': joint '" + rig_.tree.joints[v.sensor->scanning_joint].name +
                                      "' is not between its link and the base");
      }
    }
    for (size_t k = 0; k < v.path.size(); ++k) {
      const Joint& joint = rig_.tree.joints[v.path[k].joint];
      if (!joint.moves() || static_cast<int>(k) == v.scan_step) continue;
      const int drv = driver(rig_.tree, v.path[k].joint).joint;
      if (v.scan_step >= 0 && drv == v.sensor->scanning_joint && joint.mimic)
        throw std::invalid_argument("sensor '" + v.sensor->name + "': joint '" + joint.name +
                                    "' follows the scanning joint; only one "
                                    "joint may move within a view");
      if (std::find(s.joints.begin(), s.joints.end(), v.path[k].joint) == s.joints.end()) s.joints.push_back(v.path[k].joint);
      if (setup_.noise == NoiseMode::latent && rig_.joints[drv].sigma > 0 &&
          std::find(s.noisy.begin(), s.noisy.end(), drv) == s.noisy.end())
        s.noisy.push_back(drv);
    }
    if (v.target->link < 0 && std::find(s.targets.begin(), s.targets.end(), view.target) == s.targets.end())
      s.targets.push_back(view.target);
    s.views.push_back(std::move(v));
  }
  return s;
}

/// Columns that a group touches, then where each view's columns are among them.
GroupShape Estimation::place_columns(PlacedSample& s) const {
  std::map<int, int> places;  // shared column -> place in the group
  GroupShape shape;
  shape.private_size = static_cast<int>(6 * s.targets.size() + s.noisy.size());
  shape.rows = static_cast<int>(s.noisy.size());
  const auto place_views = [&] {
    for (PlacedView& v : s.views) place_view(v, places, s);
  };
  place_views();  // no column has a place yet: this finds out which there are
  for (const PlacedView& v : s.views) {
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
  place_views();
  return shape;
}

int Estimation::sample_of(int group) const { return group < static_cast<int>(samples_.size()) ? samples_[group].index : -1; }

/// Fills in columns, map and motion. Shared columns without a place yet stand as -column - 1.
void Estimation::place_view(PlacedView& v, const std::map<int, int>& places, const PlacedSample& s) const {
  const View& view = *v.view;
  v.columns = Columns();
  v.map = ViewColumns();
  v.motion.clear();
  v.noise.clear();
  v.noise_sigma.clear();
  const auto shared = [&](int column) {
    const auto it = places.find(column);
    return it == places.end() ? -column - 1 : it->second;
  };
  const auto add_column = [&](MotionColumns m, int place) {  // one column of M, shared with others of the same place
    const auto it = std::find(v.map.kinematic.begin(), v.map.kinematic.end(), place);
    m.first = static_cast<int>(it - v.map.kinematic.begin());
    if (it == v.map.kinematic.end()) v.map.kinematic.push_back(place);
    v.motion.push_back(m);
  };
  const auto add_pose = [&](Source source, int parameter, int step) {
    if (!freed_[parameter]) return;
    MotionColumns m{source, step};
    m.parameter = parameter;
    m.count = static_cast<int>(freed_[parameter]->components.size());
    const int place = shared(first_column_[parameter]);
    const auto it = std::find(v.map.kinematic.begin(), v.map.kinematic.end(), place);  // an uncancelled joint may come twice
    m.first = static_cast<int>(it - v.map.kinematic.begin());
    if (it == v.map.kinematic.end())
      for (int i = 0; i < m.count; ++i) v.map.kinematic.push_back(shared(first_column_[parameter] + i));
    v.motion.push_back(m);
  };

  // Columns of L.
  Columns& c = v.columns;
  if (v.scan_step >= 0) {
    c.sensor_side = 6;
    c.joint = 12;
    c.total = 14;
  }
  v.kinematic_rows = c.total;
  if (table_.sensor_block[view.sensor] >= 0) {
    const int first = table_.sensor_block[view.sensor];
    int own = 0;
    for (size_t b = 0; b < v.sensor->parameters.size(); ++b) {
      const int parameter = first + static_cast<int>(b);
      if (freed_[parameter]) {
        if (c.parameters < 0) c.parameters = c.total;
        for (size_t i = 0; i < freed_[parameter]->components.size(); ++i)
          v.map.own.push_back({c.total + own + freed_[parameter]->components[i], shared(first_column_[parameter] + static_cast<int>(i))});
      }
      own += table_.all[parameter].size();
    }
    if (c.parameters >= 0) c.total += own;
  }
  if (!v.model->whole_pose()) {
    const int square = table_.target_square[view.target], points = table_.target_points[view.target];
    if (square >= 0 && freed_[square]) {
      c.square = c.total++;
      v.map.own.push_back({c.square, shared(first_column_[square])});
    }
    if (points >= 0 && freed_[points]) {
      c.points = c.total;
      c.total += table_.all[points].size();
      for (size_t i = 0; i < freed_[points]->components.size(); ++i)
        v.map.own.push_back({c.points + freed_[points]->components[i], shared(first_column_[points] + static_cast<int>(i))});
    }
  }
  // Columns of M: private ones first.
  const int targets = static_cast<int>(s.targets.size());
  if (v.target->link < 0) {
    const int slot = static_cast<int>(std::find(s.targets.begin(), s.targets.end(), view.target) - s.targets.begin());
    v.target_start = s.start + 12 * slot;
    MotionColumns m{Source::target_pose};
    m.count = 6;
    for (int i = 0; i < 6; ++i) v.map.kinematic.push_back(6 * slot + i);
    v.motion.push_back(m);
  } else {
    v.target_start = table_.all[table_.target_pose[view.target]].start;
    add_pose(Source::target_pose, table_.target_pose[view.target], -1);
  }
  add_pose(Source::sensor_pose, table_.sensor_pose[view.sensor], -1);
  for (int k = 0; k < static_cast<int>(v.path.size()); ++k) {
    const int j = v.path[k].joint;
    add_pose(Source::origin, table_.joint_origin[j], k);
    if (!rig_.tree.joints[j].moves()) continue;
    const Driver drv = driver(rig_.tree, j);
    const int offset = table_.joint_offset[drv.joint], scale = table_.joint_scale[drv.joint];
    MotionColumns m{Source::offset, k, drv.factor, drv.joint};
    if (freed_[offset]) add_column(m, shared(first_column_[offset]));
    m.source = Source::scale;
    if (freed_[scale]) add_column(m, shared(first_column_[scale]));
    if (k == v.scan_step || !(rig_.joints[drv.joint].sigma > 0)) continue;
    m.source = Source::error;
    if (setup_.noise == NoiseMode::latent) {
      const int slot = static_cast<int>(std::find(s.noisy.begin(), s.noisy.end(), drv.joint) - s.noisy.begin());
      add_column(m, 6 * targets + slot);
    } else if (setup_.noise != NoiseMode::none) {
      const auto it = std::find_if(v.noise.begin(), v.noise.end(), [&](const MotionColumns& n) { return n.joint == drv.joint; });
      m.first = it == v.noise.end() ? static_cast<int>(v.noise_sigma.size()) : it->first;
      if (it == v.noise.end()) v.noise_sigma.push_back(rig_.joints[drv.joint].sigma);
      v.noise.push_back(m);
    }
  }
}

void Estimation::set_workers(int count) {
  size_t rows = 0, width = 0, columns = 0, noisy = 0;  // of the largest view
  for (const PlacedSample& s : samples_)
    for (const PlacedView& v : s.views) {
      rows = std::max(rows, static_cast<size_t>(v.rows()));
      width = std::max(width, static_cast<size_t>(v.columns.total));
      columns = std::max(columns, v.map.kinematic.size() + v.map.own.size());
      noisy = std::max(noisy, v.noise_sigma.size());
    }
  scratch_.resize(count);
  for (Scratch& s : scratch_) {
    s.rows.resize(rows, width + 1);
    s.r.resize(rows);
    s.m.resize(std::max<size_t>(width, 6), std::max(columns, noisy));
    s.expand.reserve(static_cast<int>(width), static_cast<int>(columns));
    s.motion.resize(rig_.tree.joints.size());
    s.reading.resize(rig_.tree.joints.size());
  }
}

void Estimation::prepare(const VectorXd& state) {
  for (size_t p = 0; p < charts_.size(); ++p) {
    if (charts_[p].size() == 0) continue;
    const int start = table_.all[p].start;
    const Vector6d xi = log_se3(inverse(get_pose(table_.initial, start)) * get_pose(state, start));
    const Matrix6d jacobian = right_jacobian_se3(xi);
    for (size_t i = 0; i < freed_[p]->components.size(); ++i) charts_[p].col(i) = jacobian.col(freed_[p]->components[i]);
  }
}

VectorXd Estimation::pack(const Values& values) const {
  VectorXd state(state_size_);
  state.head(values.shared.size()) = values.shared;
  for (const PlacedSample& s : samples_) {
    int at = s.start;
    for (int t : s.targets) {
      const auto it = values.targets.find({s.index, t});
      set_pose(state, at, it == values.targets.end() ? Pose() : it->second);
      at += 12;
    }
    for (int j : s.noisy) {
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
    for (int t : s.targets) {
      values.targets[{s.index, t}] = get_pose(state, at);
      at += 12;
    }
    for (int j : s.noisy) values.errors[{s.index, j}] = state(at++);
  }
}

std::vector<char> Estimation::influencing() const {
  std::vector<char> used(table_.all.size(), 0);
  const auto use = [&](int parameter) {
    if (parameter >= 0) used[parameter] = 1;
  };
  for (const PlacedSample& s : samples_)
    for (const PlacedView& v : s.views) {
      use(table_.sensor_pose[v.view->sensor]);
      for (size_t b = 0; b < v.sensor->parameters.size(); ++b) use(table_.sensor_block[v.view->sensor] + static_cast<int>(b));
      use(table_.target_pose[v.view->target]);
      if (!v.sensor->model->whole_pose()) {
        use(table_.target_square[v.view->target]);
        use(table_.target_points[v.view->target]);
      }
      for (const PathStep& step : v.path) {
        use(table_.joint_origin[step.joint]);
        if (!rig_.tree.joints[step.joint].moves()) continue;
        const int drv = driver(rig_.tree, step.joint).joint;
        use(table_.joint_offset[drv]);
        use(table_.joint_scale[drv]);
      }
    }
  return used;
}

/// Motions of all joints of the sample and their readings with errors.
void Estimation::motions(const PlacedSample& s, const VectorXd& state, Scratch& scratch) const {
  const Sample& sample = all_[s.index];
  const auto position = [&](int j) {
    scratch.reading[j] = sample.readings[j];
    if (!s.noisy.empty()) {
      const auto it = std::find(s.noisy.begin(), s.noisy.end(), j);
      if (it != s.noisy.end())
        scratch.reading[j] += state(s.start + 12 * static_cast<int>(s.targets.size()) + static_cast<int>(it - s.noisy.begin()));
    }
    return state(table_.all[table_.joint_scale[j]].start) * scratch.reading[j] + state(table_.all[table_.joint_offset[j]].start);
  };
  for (int j : s.joints) {
    const Driver d = driver(rig_.tree, j);
    scratch.motion[j] = joint_motion(rig_.tree.joints[j], d.factor * position(d.joint) + d.offset);
  }
}

/// Walks the view's path: frames of its joints, and the sensor's input.
void Estimation::geometry(const PlacedView& v, const VectorXd& state, Scratch& scratch) const {
  scratch.frames.resize(v.path.size());
  Pose here = inverse(get_pose(state, table_.all[table_.sensor_pose[v.view->sensor]].start));
  for (int k = 0; k < static_cast<int>(v.path.size()); ++k) {
    const int j = v.path[k].joint;
    const Pose origin = get_pose(state, table_.all[table_.joint_origin[j]].start);
    if (k == v.scan_step) {
      // The joint itself stays out: its motion is the sensor's. Down: origin is on the sensor's side; up: on the far one.
      scratch.scan.sensor_T_before = v.path[k].direction > 0 ? here * origin : here;
      scratch.scan.axis = rig_.tree.joints[j].axis;
      scratch.scan.prismatic = rig_.tree.joints[j].type == JointType::prismatic;
      scratch.scan.direction = v.path[k].direction;
      scratch.scan.offset = state(table_.all[table_.joint_offset[j]].start);
      scratch.scan.scale = state(table_.all[table_.joint_scale[j]].start);
      scratch.frames[k] = v.path[k].direction > 0 ? scratch.scan.sensor_T_before : Pose();
      here = v.path[k].direction > 0 ? Pose() : inverse(origin);  // from the far side on
      continue;
    }
    Pose there;
    walk(v.path[k], origin, scratch.motion[j], here, scratch.frames[k], there);
    here = there;
  }
  const Pose far_T_target = here * get_pose(state, v.target_start);
  ViewInput& in = scratch.input;
  in.sensor_T_target = far_T_target;
  in.scan = nullptr;
  if (v.scan_step >= 0) {
    scratch.scan.behind_T_target = far_T_target;
    in.scan = &scratch.scan;
  }
  const int block = table_.sensor_block[v.view->sensor];
  in.parameters = block >= 0 ? state.data() + table_.all[block].start : nullptr;
  if (v.target->grid) {
    scratch.points = state(table_.all[table_.target_square[v.view->target]].start) * v.target->layout;
    in.layout = &v.target->layout;
  } else {
    const Parameter& p = table_.all[table_.target_points[v.view->target]];
    scratch.points = Eigen::Map<const Eigen::Matrix3Xd>(state.data() + p.start, 3, p.size() / 3);
    in.layout = nullptr;
  }
  in.points = &scratch.points;
  in.ids = v.ids.data();
  in.count = static_cast<int>(v.ids.size());
  in.z = v.view->z.data();
}

/// M (kinematic rows x columns) of a program, at the geometry in `scratch`.
void Estimation::kinematic_matrix(const PlacedView& v, const std::vector<MotionColumns>& program, int columns, const VectorXd& state,
                                  Scratch& scratch) const {
  auto m = scratch.m.topLeftCorner(v.kinematic_rows, columns);
  m.setZero();
  const auto fill = [&](const MotionColumns& column, int row, const Matrix6d& twist_of_increment) {
    const MatrixXd* chart = column.parameter >= 0 && charts_[column.parameter].size() > 0 ? &charts_[column.parameter] : nullptr;
    if (chart)
      m.block(row, column.first, 6, column.count) += twist_of_increment * *chart;
    else
      m.block(row, column.first, 6, 6) += twist_of_increment;
  };
  for (const MotionColumns& column : program) {
    // Rows of L's columns: twist behind the scanning joint (or of the target as seen from the sensor) at 0, sensor's side at 6.
    const bool sensor_side = v.scan_step >= 0 && column.step >= 0 &&
                             (column.step < v.scan_step || (column.step == v.scan_step && v.path[column.step].direction > 0));
    const int row = sensor_side ? 6 : 0;
    switch (column.source) {
      case Source::target_pose:
        fill(column, 0, adjoint(v.scan_step >= 0 ? scratch.scan.behind_T_target : scratch.input.sensor_T_target));
        break;
      case Source::sensor_pose:
        fill(column, v.scan_step >= 0 ? 6 : 0, -Matrix6d::Identity());
        break;
      case Source::origin:
        fill(column, row, v.path[column.step].direction * adjoint(scratch.frames[column.step]));
        break;
      case Source::offset:
      case Source::scale:
      case Source::error: {
        if (column.step == v.scan_step) {  // the scanning joint's own columns of L
          m(column.source == Source::offset ? 12 : 13, column.first) += 1;
          break;
        }
        const double by = column.factor * (column.source == Source::offset  ? 1
                                           : column.source == Source::scale ? scratch.reading[column.joint]
                                                                            : state(table_.all[table_.joint_scale[column.joint]].start));
        const int j = v.path[column.step].joint;
        m.block<6, 1>(row, column.first) +=
            by * position_twist(rig_.tree.joints[j], v.path[column.step].direction, scratch.frames[column.step]);
        break;
      }
    }
  }
}

/// Whitened rows [L r] of a view into scratch.rows (derivatives) or r alone into scratch.r, the loss's slopes applied; cost added.
bool Estimation::view_rows(const PlacedView& v, const VectorXd& state, Scratch& scratch, bool derivatives, Cost& cost) const {
  geometry(v, state, scratch);
  const int k = v.model->rows(), blocks = v.blocks(), rows = k * blocks, w = v.columns.total;
  auto weighted = scratch.rows.topLeftCorner(rows, w + 1);
  if (derivatives) {
    weighted.setZero();
    Eigen::Ref<RowMatrix> l(weighted.leftCols(w));
    if (!v.model->evaluate(scratch.input, v.columns, scratch.r.data(), &l)) return false;
    weighted.col(w) = scratch.r.head(rows);
  } else if (!v.model->evaluate(scratch.input, v.columns, scratch.r.data(), nullptr)) {
    return false;
  }
  const Whitening& white = v.whitening;
  const bool marginal = setup_.noise == NoiseMode::marginal;  // the view's residuals belong together
  for (int b = 0; b < blocks; ++b) {
    auto r = scratch.r.segment(b * k, k);
    if (!white.block.empty()) {
      r = white.block[b].lazyProduct(r).eval();
      if (derivatives) weighted.middleRows(b * k, k) = white.block[b].lazyProduct(weighted.middleRows(b * k, k)).eval();
    } else {
      r = r.cwiseProduct(white.inverse_sigma);
      if (derivatives)
        for (int i = 0; i < k; ++i) weighted.row(b * k + i) *= white.inverse_sigma(i);
    }
    if (marginal) continue;
    const double squared = r.squaredNorm();
    double slope;
    cost.chi2 += squared;
    cost.twice += setup_.loss(squared, slope);
    if (derivatives && slope != 1) weighted.middleRows(b * k, k) *= std::sqrt(slope);
  }
  if (!marginal) return true;
  auto all = scratch.r.head(rows);
  double squared = all.squaredNorm(), slope;
  if (white.noise.size() > 0) {
    if (derivatives) weighted -= (white.noise * (white.root * (white.noise.transpose() * weighted))).eval();
    all -= (white.noise * (white.root * (white.noise.transpose() * all))).eval();
    squared = all.squaredNorm();
  }
  cost.chi2 += squared;
  cost.twice += setup_.loss(squared, slope);
  if (derivatives && slope != 1) weighted *= std::sqrt(slope);
  return true;
}

bool Estimation::evaluate(int group, const VectorXd& state, int worker, Cost& cost) const {
  cost = {};
  if (group == static_cast<int>(samples_.size())) {
    VectorXd r;
    prior_rows(state, nullptr, r);
    cost.twice = cost.chi2 = r.squaredNorm();
    return true;
  }
  const PlacedSample& s = samples_[group];
  Scratch& scratch = scratch_[worker];
  motions(s, state, scratch);
  for (const PlacedView& v : s.views)
    if (!view_rows(v, state, scratch, false, cost)) return false;
  const int errors = s.start + 12 * static_cast<int>(s.targets.size());
  for (size_t i = 0; i < s.noisy.size(); ++i) {
    const double e = state(errors + static_cast<int>(i)) / rig_.joints[s.noisy[i]].sigma;
    cost.twice += e * e;
    cost.chi2 += e * e;
  }
  return true;
}

bool Estimation::linearise(int group, const VectorXd& state, int worker, const GroupEquations& to, Cost& cost) const {
  cost = {};
  if (group == static_cast<int>(samples_.size())) {
    MatrixXd rows;
    VectorXd r;
    prior_rows(state, &rows, r);
    cost.twice = cost.chi2 = r.squaredNorm();
    for (Eigen::Index j = 0; j + 1 < rows.cols(); ++j) {
      for (Eigen::Index i = j; i + 1 < rows.cols(); ++i) to.shared[to.origin[to.row[j]] + to.row[i]] += rows.col(i).dot(rows.col(j));
      to.gradient[to.row[j]] += rows.col(j).dot(rows.col(rows.cols() - 1));
    }
    return true;
  }
  const PlacedSample& s = samples_[group];
  Scratch& scratch = scratch_[worker];
  const int size = groups_[group].size();
  motions(s, state, scratch);
  for (const PlacedView& v : s.views) {
    if (!view_rows(v, state, scratch, true, cost)) return false;
    const int rows = v.rows(), w = v.columns.total + 1, columns = static_cast<int>(v.map.kinematic.size());
    const MatrixXd soa = scratch.rows.topLeftCorner(rows, w);
    MatrixXd padded_rows = MatrixXd::Zero(padded(rows), w);
    padded_rows.topRows(rows) = soa;
    kernels().gram(padded_rows.data(), padded(rows), padded_rows.rows(), w, scratch.expand.gram.data(),
                   static_cast<int>(scratch.expand.gram.outerStride()));
    kinematic_matrix(v, v.motion, columns, state, scratch);
    expand(w - 1, scratch.m.topLeftCorner(v.kinematic_rows, columns), v.map, groups_[group].private_size, size, scratch.expand, to);
  }
  const int errors = s.start + 12 * static_cast<int>(s.targets.size());
  for (size_t i = 0; i < s.noisy.size(); ++i) {
    const double w = 1 / rig_.joints[s.noisy[i]].sigma, e = state(errors + static_cast<int>(i)) * w;
    const size_t at = 6 * s.targets.size() + i;
    to.rows[at * to.stride + at] += w * w;
    to.rows[at * to.stride + size] += w * e;
    cost.twice += e * e;
    cost.chi2 += e * e;
  }
  return true;
}

/// Rows of the priors over the touched columns of their group, and the residual (last column).
bool Estimation::prior_rows(const VectorXd& state, MatrixXd* rows, VectorXd& r) const {
  const std::vector<int>& touched = groups_.back().columns;
  r.resize(static_cast<Eigen::Index>(setup_.priors.size()));
  if (rows) rows->setZero(r.size(), static_cast<Eigen::Index>(touched.size()) + 1);
  for (Eigen::Index i = 0; i < r.size(); ++i) {
    const Prior& prior = setup_.priors[i];
    const Parameter& p = table_.all[prior.parameter];
    const auto place = [&](int k) {
      return std::lower_bound(touched.begin(), touched.end(), first_column_[prior.parameter] + k) - touched.begin();
    };
    const std::vector<int>& components = freed_[prior.parameter]->components;
    if (p.pose) {
      const Vector6d e = log_se3(inverse(get_pose(table_.initial, p.start)) * get_pose(state, p.start));
      r(i) = e(prior.component) / prior.sigma;
      if (rows && freed_[prior.parameter]->whole(p)) {
        const Matrix6d inverse_jacobian = right_jacobian_se3(e).inverse();
        for (int k = 0; k < 6; ++k) (*rows)(i, place(k)) = inverse_jacobian(prior.component, k) / prior.sigma;
        (*rows)(i, rows->cols() - 1) = r(i);
        continue;
      }
    } else {
      r(i) = (state(p.start + prior.component) - table_.initial(p.start + prior.component)) / prior.sigma;
    }
    if (!rows) continue;
    const int k = static_cast<int>(std::find(components.begin(), components.end(), prior.component) - components.begin());
    (*rows)(i, place(k)) = 1 / prior.sigma;
    (*rows)(i, rows->cols() - 1) = r(i);
  }
  return true;
}

bool Estimation::group_rows(int group, const VectorXd& state, int worker, bool compress, MatrixXd& rows) const {
  const GroupShape& shape = groups_[group];
  if (group == static_cast<int>(samples_.size())) {
    VectorXd r;
    return prior_rows(state, &rows, r);
  }
  const PlacedSample& s = samples_[group];
  Scratch& scratch = scratch_[worker];
  const int size = shape.size();
  rows.setZero(shape.rows, size + 1);
  Eigen::Index used = 0;
  Cost cost;
  motions(s, state, scratch);
  for (const PlacedView& v : s.views) {
    if (!view_rows(v, state, scratch, true, cost)) return false;
    MatrixXd view = scratch.rows.topLeftCorner(v.rows(), v.columns.total + 1);
    if (compress && view.rows() > view.cols()) {
      Eigen::HouseholderQR<Eigen::Ref<MatrixXd>> qr(view);
      view = MatrixXd(view.topRows(view.cols()).triangularView<Eigen::Upper>());
    }
    kinematic_matrix(v, v.motion, static_cast<int>(v.map.kinematic.size()), state, scratch);
    const auto m = scratch.m.topLeftCorner(v.kinematic_rows, static_cast<Eigen::Index>(v.map.kinematic.size()));
    MatrixXd kinematic = view.leftCols(v.kinematic_rows) * m;
    const VectorXd parts = m.cwiseAbs2().transpose() * view.leftCols(v.kinematic_rows).colwise().squaredNorm().transpose();
    for (Eigen::Index i = 0; i < kinematic.cols(); ++i)
      if (kinematic.col(i).squaredNorm() <= kCancelled * parts(i)) kinematic.col(i).setZero();
    auto part = rows.middleRows(used, view.rows());
    for (size_t i = 0; i < v.map.kinematic.size(); ++i) part.col(v.map.kinematic[i]) += kinematic.col(i);
    for (const auto& own : v.map.own) part.col(own.second) += view.col(own.first);
    part.col(size) = view.col(view.cols() - 1);
    used += view.rows();
  }
  const int errors = s.start + 12 * static_cast<int>(s.targets.size());
  for (size_t i = 0; i < s.noisy.size(); ++i, ++used) {
    const double w = 1 / rig_.joints[s.noisy[i]].sigma;
    rows(used, static_cast<Eigen::Index>(6 * s.targets.size() + i)) = w;
    rows(used, size) = w * state(errors + static_cast<int>(i));
  }
  rows.conservativeResize(used, size + 1);
  return true;
}

bool Estimation::square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const {
  return group_rows(group, state, worker, true, rows);
}

bool Estimation::explicit_rows(int group, const VectorXd& state, MatrixXd& rows) const { return group_rows(group, state, 0, false, rows); }

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
      const Pose initial = get_pose(table_.initial, p.start);
      Vector6d xi = log_se3(inverse(initial) * get_pose(state, p.start));
      for (size_t i = 0; i < f.components.size(); ++i) xi(f.components[i]) += step(static_cast<Eigen::Index>(i));
      set_pose(moved, p.start, initial * exp_se3(xi));
    }
  }
  Eigen::Index at = 0;
  for (const PlacedSample& s : samples_) {
    int place = s.start;
    for (size_t t = 0; t < s.targets.size(); ++t, place += 12, at += 6)
      set_pose(moved, place, get_pose(state, place) * exp_se3(private_step.segment<6>(at)));
    for (size_t i = 0; i < s.noisy.size(); ++i) moved(place++) += private_step(at++);
  }
}

bool Estimation::renew(const VectorXd& state) {
  prepare(state);
  bool depends = false;
  Scratch& scratch = scratch_[0];
  for (PlacedSample& s : samples_) {
    motions(s, state, scratch);
    for (PlacedView& v : s.views) {
      Whitening& white = v.whitening;
      const View& view = *v.view;
      const int k = v.model->rows(), blocks = v.blocks();
      const Eigen::Map<const VectorXd> sigma(view.sigma.data(), static_cast<Eigen::Index>(view.sigma.size()));
      const bool own_noise = v.model->has_own_noise(), joints = !v.noise.empty();
      depends = depends || own_noise || joints;
      white.block.clear();
      if (!own_noise) white.inverse_sigma = sigma.size() == k ? sigma.cwiseInverse() : VectorXd();
      if (!own_noise && !joints && view.covariance.empty()) continue;
      geometry(v, state, scratch);
      std::vector<MatrixXd> covariance(blocks), inverse_root(blocks);
      MatrixXd b;
      for (int i = 0; i < blocks; ++i) {
        if (!view.covariance.empty()) {
          covariance[i] = view.covariance[i];
          inverse_root[i] = inverse_square_root(covariance[i]);
        } else if (own_noise) {
          v.model->own_noise(scratch.input, i, b);
          covariance[i] = b * sigma.cwiseAbs2().asDiagonal() * b.transpose();
          inverse_root[i] =
              b.rows() == b.cols() ? MatrixXd(sigma.cwiseInverse().asDiagonal() * b.inverse()) : inverse_square_root(covariance[i]);
        } else {
          covariance[i] = sigma.cwiseAbs2().asDiagonal();
        }
      }
      if (own_noise || !view.covariance.empty()) white.block = inverse_root;
      if (!joints) continue;
      // Jq S^1/2 = L Mq sigma, unwhitened.
      RowMatrix l = RowMatrix::Zero(k * blocks, v.columns.total);
      VectorXd r(k * blocks);
      Eigen::Ref<RowMatrix> reference(l);
      if (!v.model->evaluate(scratch.input, v.columns, r.data(), &reference)) continue;  // undefined: the linearisation will say so
      kinematic_matrix(v, v.noise, static_cast<int>(v.noise_sigma.size()), state, scratch);
      MatrixXd jq =
          l.leftCols(v.kinematic_rows) * scratch.m.topLeftCorner(v.kinematic_rows, static_cast<Eigen::Index>(v.noise_sigma.size()));
      for (size_t i = 0; i < v.noise_sigma.size(); ++i) jq.col(i) *= v.noise_sigma[i];
      if (setup_.noise == NoiseMode::point) {
        white.block.resize(blocks);
        for (int i = 0; i < blocks; ++i)
          white.block[i] = inverse_square_root(covariance[i] + jq.middleRows(i * k, k) * jq.middleRows(i * k, k).transpose());
      } else {
        for (int i = 0; i < blocks; ++i)
          jq.middleRows(i * k, k) = white.block.empty() ? MatrixXd(white.inverse_sigma.asDiagonal() * jq.middleRows(i * k, k))
                                                        : MatrixXd(white.block[i] * jq.middleRows(i * k, k));
        white.noise = jq;
        const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(jq.transpose() * jq);
        const VectorXd w = eigen.eigenvalues().cwiseMax(0.0);
        const MatrixXd& q = eigen.eigenvectors();
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
    for (const PlacedView& v : s.views) {
      ViewResiduals r;
      r.view = v.view;
      r.sample = s.index;
      geometry(v, state, scratch);
      const SensorModel& model = *v.sensor->model;  // whatever the mode whitens: what the sensor itself measures
      r.raw.resize(model.rows() * model.blocks(static_cast<int>(v.ids.size())));
      if (!model.evaluate(scratch.input, v.columns, r.raw.data(), nullptr)) r.raw.setConstant(std::nan(""));
      Cost cost;
      view_rows(v, state, scratch, false, cost);
      r.whitened = scratch.r.head(v.rows());
      out.push_back(std::move(r));
    }
  }
  return out;
}

}  // namespace kincal
