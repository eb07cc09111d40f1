#include "motion.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>
#include <new>

#include "../../solver/kernels.h"

namespace kincal {

void resize_scratch(const Layout& layout, int count, std::vector<Scratch>& scratch) {
  if (scratch.size() == static_cast<size_t>(count)) return;  // it is that of this layout
  size_t rows = 8, width = 0, columns = 6, paths = 0, steps = 0, path_columns = 0, noisy = 0,
         depth = 6, scanned = 0;  // of the largest view and path
  for (const auto& entry : layout.layouts) {
    const SampleLayout& sample = *entry.second;
    paths = std::max(paths, sample.paths.size());
    for (const SensorPath& path : sample.paths) {
      steps = std::max(steps, path.steps.size());
      depth = std::max(depth, static_cast<size_t>(path.rows()));
      path_columns = std::max({path_columns, path.places.size(), path.noisy.size()});
      noisy = std::max(noisy, path.noisy.size());
    }
    for (const ViewLayout& v : sample.views) {
      rows = std::max(rows, static_cast<size_t>(v.padded_rows()));
      width = std::max(width, static_cast<size_t>(v.columns.total));
      columns = std::max(columns, v.map.kinematic.size() + v.map.own.size());
      if (sample.paths[v.path].scan_step >= 0)
        scanned = std::max(scanned, static_cast<size_t>(v.stride()) *
                                        (kTurns + sample.paths[v.path].scan_numbers));
    }
  }
  scratch.resize(count);
  for (Scratch& s : scratch) {
    for (auto* points : {&s.points, &s.plain, &s.layouts}) {
      points->resize(layout.rig.targets.size());
      for (size_t t = 0; t < points->size(); ++t)
        (*points)[t].resize(3, layout.rig.targets[t].count());
    }
    s.rows_memory.assign(rows * (width + 1), 0.0);
    new (&s.rows) Eigen::Map<MatrixXd>(s.rows_memory.data(), static_cast<Eigen::Index>(rows),
                                       static_cast<Eigen::Index>(width) + 1);
    s.evaluated.resize(rows, width + 1);
    s.r.resize(rows);
    s.slopes.resize(rows);
    s.gathered.resize(3 * rows);
    s.turned.resize(scanned);
    s.projected.resize(noisy, width + 1);
    s.rooted.resize(noisy, width + 1);
    s.expand.reserve(static_cast<int>(width), static_cast<int>(depth),
                     static_cast<int>(std::max(columns, path_columns)));
    s.sums_start.clear();
    size_t sums = 0;
    for (const SharedColumns& shared : layout.sums) {
      s.sums_start.push_back(sums);
      sums += shared.size();
    }
    s.sums.assign(sums + kSlack, 0.0);
    s.sums_start.push_back(sums);
    s.is_begun.assign(layout.sums.size(), 0);
    s.begun.clear();
    s.begun.reserve(layout.sums.size());
    s.motion.resize(layout.rig.tree.joints.size());
    s.moved.resize(layout.rig.tree.joints.size());
    s.reading.resize(layout.rig.tree.joints.size());
    if (layout.rig.elasticity) s.bent.resize(*layout.rig.elasticity->skeleton);
    s.paths.resize(paths);
    for (PathAtState& path : s.paths) {
      path.frames.resize(steps);
      path.twists.setZero(depth, padded(static_cast<int>(path_columns)) + kSlack);
    }
  }
}

Motion::Motion(const Layout& layout) : layout_(layout), charts_(layout.table.all.size()) {
  for (const Freed& f : layout.setup.free)
    if (layout.table.all[f.parameter].pose && !f.whole(layout.table.all[f.parameter]))
      charts_[f.parameter] = MatrixXd::Zero(6, f.components.size());
  const Tree& tree = layout.rig.tree;
  cache_of_.assign(tree.joints.size(), -1);
  for (const auto& entry : layout.layouts)
    for (int j : entry.second->joints) {
      if (cache_of_[j] >= 0) continue;
      cache_of_[j] = static_cast<int>(caches_.size());
      caches_.push_back(
          {j, layout.freed[layout.table.joint_origin[j]] == nullptr && !layout.rig.elasticity,
           tree.joints[j].type == JointType::prismatic, driver(tree, j), Pose(), Matrix3d::Zero(),
           Matrix3d::Zero(), Vector3d::Zero()});
      caches_.back().set_origin(tree.joints[j].parent_T_joint, tree.joints[j].axis);
    }
}

void Motion::prepare(const VectorXd& state) {
  const Eigen::Index shared = layout_.table.initial.size();
  if (prepared_.size() > 0 &&
      std::memcmp(prepared_.data(), state.data(), sizeof(double) * shared) == 0)
    return;
  prepared_ = state.head(shared);
  ++version_;
  for (const Freed& f : layout_.setup.free) {
    MatrixXd& chart = charts_[f.parameter];
    if (chart.size() == 0) continue;
    const int start = layout_.table.all[f.parameter].start;
    const Vector6d xi =
        log_se3(inverse(get_pose(layout_.initial(), start)) * get_pose(state, start));
    const Matrix6d jacobian = right_jacobian_se3(xi);
    for (size_t i = 0; i < f.components.size(); ++i)
      chart.col(static_cast<Eigen::Index>(i)) = jacobian.col(f.components[i]);
  }
  for (JointCache& cache : caches_) {
    if (!cache.held) continue;
    const Pose origin =
        get_pose(state, layout_.table.all[layout_.table.joint_origin[cache.joint]].start);
    if (origin.rotation != cache.origin.rotation || origin.translation != cache.origin.translation)
      cache.set_origin(origin, layout_.rig.tree.joints[cache.joint].axis);
  }
}

void Motion::JointCache::set_origin(const Pose& pose, const Vector3d& axis) {
  origin = pose;
  along = origin.rotation * axis;
  sine = origin.rotation * skew(axis);
  versine = sine * skew(axis);
}

bool Motion::walk(const PlacedSample& s, const VectorXd& state, Scratch& scratch,
                  bool derivatives) const {
  const bool stands = layout_.columns.empty() && s.layout->noisy.empty();
  if (stands && scratch.walked == &s && scratch.version == version_) return true;
  scratch.walked = nullptr;
  const std::vector<SensorPath>& paths = s.layout->paths;
  for (size_t w = 0; w < paths.size(); ++w) {
    const SensorPath& path = paths[w];
    if (w == 0 || path.clock != paths[w - 1].clock || path.line >= 0 || paths[w - 1].line >= 0) {
      motions(s, path, state, scratch);
      if (layout_.rig.elasticity) {
        if (!bend_joints(s, state, scratch)) return false;
        if (derivatives) differentiate(*layout_.rig.elasticity->skeleton, scratch.bent);
      }
    }
    walk_path(path, state, scratch, scratch.paths[w]);
    if (!derivatives) continue;
    path_columns(path, path.motion, static_cast<int>(path.places.size()), state, scratch,
                 scratch.paths[w]);
    if (!path.bending.empty()) bending_columns(path, s, state, scratch, scratch.paths[w]);
  }
  scratch.walked = &s;
  scratch.version = version_;
  return true;
}

/// Puts the deflections of the equilibrium between origins and motions of the sample's joints.
bool Motion::bend_joints(const PlacedSample& s, const VectorXd& state, Scratch& scratch) const {
  const Rig& rig = layout_.rig;
  const Sample& sample = layout_.recorded[s.index];
  BentPosture& bent = scratch.bent;
  set_elasticity(rig, layout_.table, state, sample.conditions.payload, bent);
  for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
    const Joint& joint = rig.tree.joints[j];
    bent.origin[j] =
        get_pose(state, layout_.table.all[layout_.table.joint_origin[j]].start).rotation;
    bent.motion[j] = stands_for_balance(rig, sample.readings, static_cast<int>(j))
                         ? joint_motion(joint, 0).rotation
                         : scratch.motion[j].rotation;
  }
  const Skeleton& skeleton = *rig.elasticity->skeleton;
  if (!bend(skeleton, bent)) return false;
  for (int i = 0; i < skeleton.size(); ++i) {
    const int j = skeleton.bending[i];
    scratch.motion[j].rotation = bent.bend[i] * scratch.motion[j].rotation;
    scratch.moved[j].rotation = bent.origin[j] * scratch.motion[j].rotation;
  }
  return true;
}

/// Motions of all joints of the sample and their readings with errors, at the time of what a path
/// leads to.
void Motion::motions(const PlacedSample& s, const SensorPath& path, const VectorXd& state,
                     Scratch& scratch) const {
  const Sample& sample = layout_.recorded[s.index];
  scratch.sample = &sample;
  const bool late = path.clock >= 0 || path.line >= 0;
  double later = path.clock >= 0 ? state(layout_.table.all[path.clock].start) : 0;
  if (path.line >= 0) {
    scratch.row = s.views[path.of_view].z()[1];
    later += scratch.row * state(layout_.table.all[path.line].start);
  }
  const auto reading = [&](int j) {
    scratch.reading[j] = sample.readings[j];
    if (late) scratch.reading[j] += later * stated(sample.conditions.rates, j);
    if (!s.layout->noisy.empty()) {
      const auto it = std::find(s.layout->noisy.begin(), s.layout->noisy.end(), j);
      if (it != s.layout->noisy.end())
        scratch.reading[j] += state(s.errors() + static_cast<int>(it - s.layout->noisy.begin()));
    }
    return scratch.reading[j];
  };
  const auto position = [&](int j) {
    return position_of(layout_.rig, j, reading, own_numbers(j, state), sample.conditions);
  };
  for (int j : s.layout->joints) {
    const JointCache& cache = caches_[cache_of_[j]];
    assert(!cache.held ||
           get_pose(state, layout_.table.all[layout_.table.joint_origin[j]].start).rotation ==
               cache.origin.rotation);
    const Joint& joint = layout_.rig.tree.joints[j];
    const double q = joint.stands_at
                         ? *joint.stands_at
                         : cache.driver.factor * position(cache.driver.joint) + cache.driver.offset;
    Pose& moved = scratch.moved[j];
    if (!cache.held) {
      scratch.motion[j] = joint_motion(joint, q);
      moved = get_pose(state, layout_.table.all[layout_.table.joint_origin[j]].start) *
              scratch.motion[j];
    } else if (cache.prismatic) {
      moved.rotation = cache.origin.rotation;
      moved.translation = cache.origin.translation + q * cache.along;
    } else {
      const double sine = std::sin(q), versine = 1 - std::cos(q);
      moved.rotation = cache.origin.rotation + sine * cache.sine + versine * cache.versine;
      moved.translation = cache.origin.translation;
    }
  }
}

namespace {

/// reached * step^-1
Pose back(const Pose& reached, const Pose& step) {
  Pose out;
  out.rotation.noalias() = reached.rotation * step.rotation.transpose();
  out.translation = reached.translation - out.rotation * step.translation;
  return out;
}

}  // namespace

/// Walks a path. A step's frame is that of the joint before its motion where its origin is
/// estimated or it bends; elsewhere one in which the joint's axis is the same.
void Motion::walk_path(const SensorPath& path, const VectorXd& state, const Scratch& scratch,
                       PathAtState& walked) const {
  Pose reached;
  for (int k = 0; k < static_cast<int>(path.steps.size()); ++k) {
    const int j = path.steps[k].joint;
    const bool down = path.steps[k].direction > 0, turns = layout_.rig.tree.joints[j].has_axis();
    const auto origin = [&] {
      return get_pose(state, layout_.table.all[layout_.table.joint_origin[j]].start);
    };
    if (k == path.scan_step) {
      // The joint itself stays out: its motion is the sensor's. Down: origin is on the sensor's
      // side; up: on the far one.
      walked.link_T_before = down ? reached * origin() : reached;
      walked.frames[k] = down ? walked.link_T_before : Pose();
      reached = down ? Pose() : inverse(origin());  // from the far side on
      continue;
    }
    const bool before = layout_.freed[layout_.table.joint_origin[j]] || bends(j);
    if (before)
      walked.frames[k] = down    ? reached * origin()
                         : turns ? reached * inverse(scratch.motion[j])
                                 : reached;
    else if (!down)
      walked.frames[k] = reached;
    const Pose step = turns ? scratch.moved[j] : origin();
    reached = down ? (k == 0 ? step : reached * step) : back(reached, step);
    if (down && !before) walked.frames[k] = reached;
  }
  walked.link_T_far = reached;
}

/// d position of the column's joint / d its unknown.
double Motion::by_column(const MotionColumns& column, const VectorXd& state,
                         const Scratch& scratch) const {
  const int j = column.joint;
  const double* own = own_numbers(j, state);
  const double reading = scratch.reading[j];
  const Conditions& at = scratch.sample->conditions;
  if (column.source == Source::error) return by_reading_of(layout_.rig, j, column.by, reading, own);
  if (column.source == Source::time_offset || column.source == Source::line_time) {
    double out = 0;
    for_each_reading(layout_.rig, j, [&](int by) {
      out += by_reading_of(layout_.rig, j, by, reading, own) * stated(at.rates, by);
    });
    return column.source == Source::line_time ? scratch.row * out : out;
  }
  return by_own_number(
      layout_.rig, j, column.number, [&](int i) { return scratch.reading[i]; }, own, at);
}

/// Columns of a path, in the frame of the sensor's link (rows 0-5; with a scanning joint 6-11,
/// behind it 0-5, its own numbers from 12 on).
void Motion::path_columns(const SensorPath& path, const std::vector<MotionColumns>& program,
                          int count, const VectorXd& state, Scratch& scratch,
                          PathAtState& walked) const {
  auto m = walked.twists.topLeftCorner(path.rows(), count);
  m.setZero();
  Vector6d twist = Vector6d::Zero();
  int twist_step = -1;  // whose it is
  for (const MotionColumns& column : program) {
    const PathStep& step = path.steps[column.step];
    const int row = path.on_sensor_side(column.step) ? 6 : 0;
    if (column.source == Source::origin) {
      const Matrix6d moved = step.direction * adjoint(walked.frames[column.step]);
      if (charts_[column.parameter].size() > 0)
        m.block(row, column.first, 6, column.count) += moved.lazyProduct(charts_[column.parameter]);
      else
        m.block<6, 6>(row, column.first) += moved;
      continue;
    }
    if (column.step == path.scan_step) {  // the scanning joint's own columns of L
      m(12 + column.number, column.first) += 1;
      continue;
    }
    const double by = column.factor * by_column(column, state, scratch);
    if (column.step != twist_step) {
      Pose frame = walked.frames[column.step];
      if (bends(step.joint))
        frame.rotation =
            frame.rotation * scratch.bent.bend[layout_.rig.elasticity->skeleton->index[step.joint]];
      twist = position_twist(layout_.rig.tree.joints[step.joint], step.direction, frame);
      twist_step = column.step;
    }
    m.block<6, 1>(row, column.first) += by * twist;
  }
}

void Motion::bending_columns(const SensorPath& path, const PlacedSample& s, const VectorXd& state,
                             Scratch& scratch, PathAtState& walked) const {
  const Rig& rig = layout_.rig;
  const Skeleton& skeleton = *rig.elasticity->skeleton;
  const BentPosture& bent = scratch.bent;
  const BendingColumns& through = scratch.through_bending;
  const int rows = std::min(path.rows(), 12);
  scratch.by_delta.setZero(rows, 3 * skeleton.size());
  for (size_t k = 0; k < path.steps.size(); ++k) {
    const int i = skeleton.index[path.steps[k].joint];
    if (i >= 0)
      scratch.by_delta.block<6, 3>(path.on_sensor_side(static_cast<int>(k)) ? 6 : 0, 3 * i) =
          deflection_twists(bent, i, path.steps[k].direction, walked.frames[k]);
  }
  through_equilibrium(bent, scratch.by_delta, scratch.through_bending);
  for (const MotionColumns& column : path.bending) {
    const int j = column.bent_by;
    auto m = walked.twists.block(0, column.first, rows, column.count);
    switch (column.source) {
      case Source::origin: {
        const ThreeColumns turned = bent_by_origin(skeleton, bent, through, j);
        if (charts_[column.parameter].size() > 0)
          m += turned.lazyProduct(charts_[column.parameter].bottomRows<3>());
        else
          m.rightCols(3) += turned;
        break;
      }
      case Source::compliance:
      case Source::load: {
        const ThreeColumns moved = column.source == Source::load
                                       ? bent_by_load(skeleton, bent, through, j)
                                       : bent_by_compliance(skeleton, bent, through, j);
        const std::vector<int>& components = layout_.freed[column.parameter]->components;
        for (int c = 0; c < column.count; ++c) m.col(c) += moved.col(components[c]);
        break;
      }
      default: {
        if (stands_for_balance(rig, layout_.recorded[s.index].readings, j)) break;
        m += column.factor * by_column(column, state, scratch) *
             bent_by_position(skeleton, bent, through, j, rig.tree.joints[j].axis);
      }
    }
  }
}

/// Where the pose of the view's target stands in the state.
int Motion::target_start(const PlacedView& v, const PlacedSample& s) const {
  return v.layout->target_slot >= 0
             ? s.start + 12 * v.layout->target_slot
             : layout_.table.all[layout_.table.target_pose[v.layout->target_index]].start;
}

/// Poses of the view into scratch.input (and scratch.scan).
void Motion::view_poses(const PlacedView& v, const PlacedSample& s, const VectorXd& state,
                        Scratch& scratch) const {
  const SensorPath& path = s.layout->paths[v.layout->path];
  const PathAtState& walked = scratch.paths[v.layout->path];
  const Pose sensor_T_link = inverse(
      get_pose(state, layout_.table.all[layout_.table.sensor_pose[v.layout->sensor_index]].start));
  const Pose link_T_target = walked.link_T_far * get_pose(state, target_start(v, s));
  ViewInput& in = scratch.input;
  const int block = layout_.table.sensor_block[v.layout->sensor_index];
  in.parameters = block >= 0 ? state.data() + layout_.table.all[block].start : nullptr;
  in.scan = nullptr;
  if (path.scan_step < 0) {
    in.sensor_T_target = sensor_T_link * link_T_target;
    return;
  }
  const int j = path.steps[path.scan_step].joint;
  Scan& scan = scratch.scan;
  scan.sensor_T_before = sensor_T_link * walked.link_T_before;
  scan.behind_T_target = in.sensor_T_target = link_T_target;
  scan.axis = layout_.rig.tree.joints[j].axis;
  scan.prismatic = layout_.rig.tree.joints[j].type == JointType::prismatic;
  scan.direction = path.steps[path.scan_step].direction;
  scan.model = layout_.rig.joints[j].model.get();
  scan.own = state.data() + layout_.table.all[layout_.table.joint_offset[j]].start;
  in.scan = &scan;
}

/// Columns of the path as the sensor sees them, to columns of M from `first` on.
void Motion::seen_from_sensor(const PlacedView& v, const PlacedSample& s, const VectorXd& state,
                              int first, int count, Scratch& scratch) const {
  const SensorPath& path = s.layout->paths[v.layout->path];
  const RowMatrix& twists = scratch.paths[v.layout->path].twists;
  RowMatrix& m = scratch.expand.m;
  int moved = 0;  // first of the rows that are seen from the sensor's link
  if (path.scan_step >= 0) {
    m.block(0, first, 6, count) = twists.topLeftCorner(6, count);
    if (!path.sensor_side) return;
    moved = 6;
    m.block(12, first, path.rows() - 12, count) = twists.block(12, 0, path.rows() - 12, count);
  }
  const Pose link_T_sensor =
      get_pose(state, layout_.table.all[layout_.table.sensor_pose[v.layout->sensor_index]].start);
  const Matrix6d sensor_from_link = adjoint(inverse(link_T_sensor));
  kernels().multiply(sensor_from_link.data(), 1, 6, 6, 6, twists.row(moved).data(),
                     static_cast<int>(twists.outerStride()), count, m.row(moved).data() + first,
                     static_cast<int>(m.outerStride()));
}

/// K (path's rows x kinematic columns) of a view into the top left corner of scratch.m;
/// view_poses() and path_columns() have been called.
void Motion::kinematic_matrix(const PlacedView& v, const PlacedSample& s, const VectorXd& state,
                              Scratch& scratch) const {
  const SensorPath& path = s.layout->paths[v.layout->path];
  RowMatrix& m = scratch.expand.m;
  // First: it may write behind the path's columns.
  seen_from_sensor(v, s, state, v.layout->path_column, static_cast<int>(path.places.size()),
                   scratch);
  for (const MotionColumns& column : v.layout->poses) {
    const bool sensor_side = column.source == Source::sensor_pose;
    Matrix6d twist;
    if (sensor_side)
      twist = -Matrix6d::Identity();
    else
      twist = adjoint(scratch.input.sensor_T_target);
    const int row = sensor_side && path.scan_step >= 0 ? 6 : 0;
    m.block(0, column.first, path.rows(), column.count).setZero();
    if (column.parameter >= 0 && charts_[column.parameter].size() > 0)
      m.block(row, column.first, 6, column.count) = twist.lazyProduct(charts_[column.parameter]);
    else
      m.block<6, 6>(row, column.first) = twist;
  }
}

}  // namespace kincal
