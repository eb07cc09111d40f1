#include "layout.h"

#include <algorithm>
#include <stdexcept>

#include "../rig/targets.h"

namespace kincal {
namespace {

// Views of one set of shared columns from which it has sums of its own. A sum is filled and brought
// to its places once a piece, of which there are up to 16: it pays if views are more than that.
constexpr int kViewsOfSum = 16;

}  // namespace

Layout::Layout(const Recording& of, const std::vector<int>& indices, EstimationSetup given)
    : recording(of),
      rig(recording.rig),
      table(recording.table),
      recorded(recording.samples),
      setup(std::move(given)) {
  first_column.assign(table.all.size(), -1);
  freed.assign(table.all.size(), nullptr);
  for (const Freed& f : setup.free) {
    first_column[f.parameter] = static_cast<int>(columns.size());
    freed[f.parameter] = &f;
    for (int c : f.components) columns.push_back({f.parameter, c});
  }
  state_size = static_cast<int>(table.initial.size());
  for (int index : indices) place_sample(index);
  drop_rare_sums();
  place_data();
  if (!setup.priors.empty()) place_priors();
  if (setup.apart && !columns.empty())
    throw std::logic_error("samples that are solved apart share nothing that is estimated");
}

/// The last group: it has no private unknowns.
void Layout::place_priors() {
  GroupShape shape;
  for (const Prior& prior :
       setup.priors)  // a prior on a component of a partly freed pose depends on all its freed ones
    for (size_t i = 0; i < freed[prior.parameter]->components.size(); ++i)
      shape.columns.push_back(first_column[prior.parameter] + static_cast<int>(i));
  std::sort(shape.columns.begin(), shape.columns.end());
  shape.columns.erase(std::unique(shape.columns.begin(), shape.columns.end()), shape.columns.end());
  shape.rows = static_cast<int>(setup.priors.size());
  groups.push_back(std::move(shape));
}

/// A sample's views that take part. Its layout is that of an earlier sample that shows the same, or
/// a new one.
void Layout::place_sample(int index) {
  PlacedSample s;
  s.index = index;
  std::vector<int> key;  // sensor, target, with covariances, ids of each view
  s.views.reserve(recorded[index].views.size());
  for (const View& view : recorded[index].views) {
    if (std::find(setup.sensors.begin(), setup.sensors.end(), view.sensor) == setup.sensors.end() ||
        (setup.only_target >= 0 && view.target != setup.only_target))
      continue;
    const Sensor& sensor = rig.sensors[view.sensor];
    if (view.covariance.empty() && static_cast<int>(view.sigma.size()) != model_of(sensor).sigmas())
      throw std::invalid_argument("sample '" + recorded[index].id + "', views[" +
                                  std::to_string(&view - recorded[index].views.data()) +
                                  "]: sensor '" + sensor.name + "' takes " +
                                  std::to_string(model_of(sensor).sigmas()) + " sigmas, not " +
                                  std::to_string(view.sigma.size()));
    key.insert(key.end(), {view.sensor, view.target, !view.covariance.empty(),
                           static_cast<int>(view.ids.size())});
    key.insert(key.end(), view.ids.begin(), view.ids.end());
    if (!sensor.line_time) {
      s.views.push_back({&view, nullptr});
      continue;
    }
    if (setup.noise == NoiseMode::marginal)
      throw std::invalid_argument("sensor '" + sensor.name +
                                  "' has a line_time: noise 'marginal' takes all points of a view "
                                  "for seen at one time; valid: latent, point, none");
    const auto count = static_cast<int>(view_ids(view, rig.targets[view.target]).size());
    for (int k = 0; k < count; ++k) s.views.push_back({&view, nullptr, k});
  }
  if (s.views.empty()) return;
  const std::vector<int> pieces = pieces_of(recorded[index]);
  key.insert(key.end(), pieces.begin(), pieces.end());
  std::unique_ptr<SampleLayout>& layout = layouts[key];
  if (!layout) {
    layout = std::make_unique<SampleLayout>(make_layout(s, pieces));
    for (ViewLayout& v : layout->views) v.sum = place_sum(v, layout->shape);
  }
  s.layout = layout.get();
  const int shared = static_cast<int>(table.initial.size());
  s.start = setup.apart ? shared : state_size;
  state_size = std::max(state_size, s.start + s.layout->state_size());
  for (size_t v = 0; v < s.views.size(); ++v) s.views[v].layout = &s.layout->views[v];
  if (!setup.apart || groups.empty()) groups.push_back(s.layout->shape);
  samples.push_back(std::move(s));
}

const SensorModel& Layout::model_of(const Sensor& sensor) const {
  const SensorModel* point_form =
      setup.noise == NoiseMode::point ? sensor.model->point_form() : nullptr;
  return point_form ? *point_form : *sensor.model;
}

/// By joint: the piece of its model that the reading is in, 0 where no further number is freed.
std::vector<int> Layout::pieces_of(const Sample& sample) const {
  std::vector<int> out(rig.joints.size(), 0);
  for (size_t j = 0; j < out.size(); ++j)
    if (table.joint_offset[j] >= 0 &&
        std::any_of(freed.begin() + table.joint_offset[j] + 2,
                    freed.begin() + table.joint_origin[j], [](const Freed* f) { return f; }))
      out[j] = rig.joints[j].model->piece(sample.readings[j]);
  return out;
}

/// The paths between sensors and targets, what the sample's private unknowns are, and all columns.
SampleLayout Layout::make_layout(const PlacedSample& placed, std::vector<int> pieces) const {
  SampleLayout s;
  s.pieces = std::move(pieces);
  for (const PlacedView& p : placed.views) {
    ViewLayout v;
    v.sensor_index = p.view->sensor;
    v.target_index = p.view->target;
    v.sensor = &rig.sensors[v.sensor_index];
    v.target = &rig.targets[v.target_index];
    v.model = &model_of(*v.sensor);
    v.noise = v.model->noise_parts();
    v.covariances = !p.view->covariance.empty();
    if (!v.model->measures_pose()) v.ids = view_ids(*p.view, *v.target);
    if (p.point >= 0) v.ids = {v.ids[p.point]};
    v.path = place_path(s, v);
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

/// The view's path among the sample's, a new one if there is none yet.
int Layout::place_path(SampleLayout& s, const ViewLayout& v) const {
  SensorPath path;
  path.from = v.sensor->link;
  path.to = v.target->link >= 0 ? v.target->link : rig.base;
  if (v.model->scans()) path.scanning_joint = v.sensor->scanning_joint;
  path.clock = table.time_offset[v.sensor_index];
  path.line = table.line_time[v.sensor_index];
  if (path.line >= 0) path.of_view = static_cast<int>(s.views.size());
  for (size_t i = 0; i < s.paths.size() && path.line < 0; ++i)
    if (s.paths[i].line < 0 && s.paths[i].from == path.from && s.paths[i].to == path.to &&
        s.paths[i].scanning_joint == path.scanning_joint && s.paths[i].clock == path.clock)
      return static_cast<int>(i);
  path.steps = find_path(rig.tree, path.from, path.to);
  if (v.model->scans()) {
    path.scan_numbers = rig.joints[path.scanning_joint].model->size();
    const auto scan_step = [&] {
      for (size_t k = 0; k < path.steps.size(); ++k)
        if (path.steps[k].joint == path.scanning_joint) return static_cast<int>(k);
      return -1;
    };
    path.scan_step = scan_step();
    if (path.scan_step < 0) {  // sensor and target both behind the joint: its reading differs
                               // between them, nothing cancels
      path.steps = find_path(rig.tree, path.from, rig.base);
      path.scan_step = scan_step();
      for (const PathStep& step : find_path(rig.tree, rig.base, path.to))
        path.steps.push_back(step);
      if (path.scan_step < 0)
        throw std::invalid_argument("sensor '" + v.sensor->name + "': joint '" +
                                    rig.tree.joints[path.scanning_joint].name +
                                    "' is not between its link and the base");
    }
  }
  for (size_t k = 0; k < path.steps.size(); ++k) {
    const int j = path.steps[k].joint;
    const Joint& joint = rig.tree.joints[j];
    if (!joint.has_axis() || static_cast<int>(k) == path.scan_step) continue;
    const int drv = driver(rig.tree, j).joint;
    if (path.scan_step >= 0 && drv == path.scanning_joint && joint.mimic)
      throw std::invalid_argument(
          "sensor '" + v.sensor->name + "': joint '" + joint.name +
          "' follows the scanning joint; only one joint may move within a view");
    if (std::find(s.joints.begin(), s.joints.end(), j) == s.joints.end()) s.joints.push_back(j);
    if (joint.moves() && setup.noise == NoiseMode::latent)
      for_each_reading(rig, drv, [&](int by) {
        if (rig.joints[by].sigma > 0 &&
            std::find(s.noisy.begin(), s.noisy.end(), by) == s.noisy.end())
          s.noisy.push_back(by);
      });
  }
  if (rig.elasticity)  // what any joint carries may bend another
    for (size_t j = 0; j < rig.tree.joints.size(); ++j)
      if (rig.tree.joints[j].has_axis() &&
          std::find(s.joints.begin(), s.joints.end(), static_cast<int>(j)) == s.joints.end())
        s.joints.push_back(static_cast<int>(j));
  s.paths.push_back(std::move(path));
  return static_cast<int>(s.paths.size()) - 1;
}

/// Columns that a group touches, then where each view's columns are among them.
GroupShape Layout::place_columns(SampleLayout& s) const {
  std::map<int, int> places;  // shared column -> place in the group
  GroupShape shape;
  shape.private_size = static_cast<int>(6 * s.targets.size() + s.noisy.size());
  shape.rows = static_cast<int>(s.noisy.size());
  const auto place_all = [&] {
    for (SensorPath& path : s.paths) place_joints(path, places, s);
    for (const ViewLayout& v : s.views)
      if (SensorPath& path = s.paths[v.path];
          path.scan_step >= 0 && freed[table.sensor_pose[v.sensor_index]])
        path.sensor_side = true;
    for (ViewLayout& v : s.views) place_view(v, places, s);
  };
  place_all();  // no column has a place yet: this finds out which there are
  for (const ViewLayout& v : s.views) {
    for (int c : v.map.kinematic)
      if (c < 0) places[-c - 1] = 0;
    for (const auto& o : v.map.own)
      if (o.place < 0) places[-o.place - 1] = 0;
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

/// The view's shared columns among those of all views.
int Layout::place_sum(const ViewLayout& v, const GroupShape& shape) {
  const int k = shape.private_size;
  SharedColumns found;
  found.width = v.columns.total;
  for (int place : v.map.kinematic)
    if (place >= k) found.kinematic.push_back(shape.columns[place - k]);
  for (const OwnColumn& own : v.map.own)
    found.own.push_back({own.column, shape.columns[own.place - k], own.sign});
  const auto it = std::find(sums.begin(), sums.end(), found);
  if (it != sums.end()) return static_cast<int>(it - sums.begin());
  const std::vector<int>& kinematic = found.kinematic;
  found.runs.assign(kinematic.size(), 1);
  for (size_t i = kinematic.size(); i-- > 1;)
    if (kinematic[i] == kinematic[i - 1] + 1) found.runs[i - 1] = found.runs[i] + 1;
  sums.push_back(std::move(found));
  return static_cast<int>(sums.size()) - 1;
}

/// Leaves out the sums of few views. (Where columns depend on the reading, as those of error curves
/// do, nearly every sample has a set of its own.)
void Layout::drop_rare_sums() {
  std::vector<int> views(sums.size(), 0), place(sums.size(), -1);
  for (const PlacedSample& s : samples)
    for (const PlacedView& v : s.views) ++views[v.layout->sum];
  std::vector<SharedColumns> kept;
  for (size_t i = 0; i < sums.size(); ++i) {
    if (views[i] < kViewsOfSum) continue;
    place[i] = static_cast<int>(kept.size());
    kept.push_back(std::move(sums[i]));
  }
  for (auto& entry : layouts)
    for (ViewLayout& v : entry.second->views) v.sum = place[v.sum];
  sums = std::move(kept);
}

namespace {

/// Place of a shared column in its group; without a place yet -column - 1.
int place_of(const std::map<int, int>& places, int column) {
  const auto it = places.find(column);
  return it == places.end() ? -column - 1 : it->second;
}

}  // namespace

namespace {

/// Adds a column, or several that follow each other; what comes twice shares them.
void add_columns(MotionColumns m, int place, std::vector<MotionColumns>& to, SensorPath& path) {
  const auto it = std::find(path.places.begin(), path.places.end(), place);
  m.first = static_cast<int>(it - path.places.begin());
  if (it == path.places.end())
    for (int i = 0; i < m.count; ++i) path.places.push_back(place < 0 ? place - i : place + i);
  to.push_back(m);
}

}  // namespace

/// The path's columns of M: joints' offsets, scales, errors and origins.
void Layout::place_joints(SensorPath& path, const std::map<int, int>& places,
                          const SampleLayout& s) const {
  path.motion.clear();
  path.bending.clear();
  path.places.clear();
  path.noise.clear();
  path.noisy.clear();
  path.sensor_side = false;
  const auto add = [&](MotionColumns m, int place) { add_columns(m, place, path.motion, path); };
  for (int k = 0; k < static_cast<int>(path.steps.size()); ++k) {
    const int j = path.steps[k].joint, origin = table.joint_origin[j];
    if (freed[origin]) {
      path.sensor_side = path.sensor_side || path.on_sensor_side(k);
      MotionColumns m{Source::origin, k};
      m.parameter = origin;
      m.count = static_cast<int>(freed[origin]->components.size());
      add(m, place_of(places, first_column[origin]));
    }
    if (!rig.tree.joints[j].moves()) continue;
    const Driver drv = driver(rig.tree, j);
    MotionColumns m{Source::joint_number, k, drv.factor, drv.joint};
    int first = 0;  // own number of the parameter's first component
    for (int p = table.joint_offset[drv.joint]; p < table.joint_origin[drv.joint]; ++p) {
      for (size_t i = 0; freed[p] && i < freed[p]->components.size(); ++i) {
        m.number = first + freed[p]->components[i];
        const JointModel& model = *rig.joints[drv.joint].model;
        if (k == path.scan_step  // whose readings are the view's points
                ? m.number >= model.size()
                : !depends_on(model, m.number, s.pieces[drv.joint]))
          continue;
        path.sensor_side = path.sensor_side || path.on_sensor_side(k) || k == path.scan_step;
        add(m, place_of(places, first_column[p] + static_cast<int>(i)));
      }
      first += table.all[p].size();
    }
    if (k != path.scan_step)
      place_times(path, [&](Source source, int column) {
        path.sensor_side = path.sensor_side || path.on_sensor_side(k);
        m.source = source;
        add(m, place_of(places, column));
      });
    if (k != path.scan_step) place_errors(path, m, s);
  }
  if (rig.elasticity) place_bending(path, places, s);
  // Into the order of their places. Columns of one origin follow each other there as well.
  const std::vector<int> found = path.places;
  std::sort(path.places.begin(), path.places.end());
  for (std::vector<MotionColumns>* program : {&path.motion, &path.bending})
    for (MotionColumns& m : *program)
      m.first = static_cast<int>(
          std::lower_bound(path.places.begin(), path.places.end(), found[m.first]) -
          path.places.begin());
}

/// The columns of the times at which the path's views were measured.
void Layout::place_times(const SensorPath& path,
                         const std::function<void(Source source, int column)>& add) const {
  if (path.clock >= 0 && freed[path.clock]) add(Source::time_offset, first_column[path.clock]);
  if (path.line >= 0 && freed[path.line]) add(Source::line_time, first_column[path.line]);
}

/// Columns of the errors of the readings on which the position of the column's joint depends.
void Layout::place_errors(SensorPath& path, MotionColumns m, const SampleLayout& s) const {
  if (setup.noise == NoiseMode::none) return;
  m.source = Source::error;
  for_each_reading(rig, m.joint, [&](int by) {
    if (!(rig.joints[by].sigma > 0)) return;
    path.sensor_side = path.sensor_side || path.on_sensor_side(m.step);
    m.by = by;
    if (setup.noise == NoiseMode::latent) {
      const int slot =
          static_cast<int>(std::find(s.noisy.begin(), s.noisy.end(), by) - s.noisy.begin());
      add_columns(m, static_cast<int>(6 * s.targets.size()) + slot, path.motion, path);
      return;
    }
    const auto it = std::find(path.noisy.begin(), path.noisy.end(), by);
    m.first = static_cast<int>(it - path.noisy.begin());
    if (it == path.noisy.end()) path.noisy.push_back(by);
    path.noise.push_back(m);
  });
}

/// What moves the path because some of its joints bend: compliances, loads, and whatever turns a
/// joint that carries one of them or is carried. (Of the noise of readings only mode `latent` has
/// it: elsewhere it would change covariances by a thousandth.)
void Layout::place_bending(SensorPath& path, const std::map<int, int>& places,
                           const SampleLayout& s) const {
  const Skeleton& skeleton = *rig.elasticity->skeleton;
  std::vector<int> bending;
  for (const PathStep& step : path.steps)
    if (skeleton.index[step.joint] >= 0) bending.push_back(step.joint);
  const auto any = [&](auto related) {
    return std::any_of(bending.begin(), bending.end(), related);
  };
  const auto add = [&](MotionColumns m, int joint, int place) {
    m.bent_by = joint;
    path.sensor_side = path.sensor_side || path.scan_step >= 0;
    add_columns(m, place, path.bending, path);
  };
  const auto add_all = [&](Source source, int joint, int parameter) {
    if (parameter < 0 || !freed[parameter]) return;
    MotionColumns m{source};
    m.parameter = parameter;
    m.count = static_cast<int>(freed[parameter]->components.size());
    add(m, joint, place_of(places, first_column[parameter]));
  };
  for (int j = 0; j < static_cast<int>(rig.tree.joints.size()); ++j) {
    if (any([&](int i) { return skeleton.carries(i, j); }))
      add_all(Source::load, j, table.load[j]);
    else if (!any([&](int i) { return skeleton.carries(j, i); }))
      continue;
    add_all(Source::compliance, j, table.compliance[j]);
    add_all(Source::origin, j, table.joint_origin[j]);
    const Joint& joint = rig.tree.joints[j];
    if (!joint.moves() || joint.type == JointType::prismatic) continue;
    const Driver drv = driver(rig.tree, j);
    MotionColumns m{Source::joint_number, -1, drv.factor, drv.joint};
    int first = 0;  // own number of the parameter's first component
    for (int p = table.joint_offset[drv.joint]; p < table.joint_origin[drv.joint]; ++p) {
      for (size_t i = 0; freed[p] && i < freed[p]->components.size(); ++i) {
        m.number = first + freed[p]->components[i];
        if (depends_on(*rig.joints[drv.joint].model, m.number, s.pieces[drv.joint]))
          add(m, j, place_of(places, first_column[p] + static_cast<int>(i)));
      }
      first += table.all[p].size();
    }
    place_times(path, [&](Source source, int column) {
      m.source = source;
      add(m, j, place_of(places, column));
    });
    m.source = Source::error;
    for_each_reading(rig, drv.joint, [&](int by) {
      const auto noisy = std::find(s.noisy.begin(), s.noisy.end(), by);
      m.by = by;
      if (noisy != s.noisy.end())
        add(m, j, static_cast<int>(6 * s.targets.size() + (noisy - s.noisy.begin())));
    });
  }
}

namespace {

/// Columns of a sensor's freed numbers, from v.columns.total on. Those of a camera's fx cx fy cy
/// begin with a tile, if so many others are freed that can stand before them.
void place_for_kernel(const std::vector<std::pair<int, int>>& numbers, ViewLayout& v) {
  constexpr int kFirst = 4;  // numbers of a camera: fx fy cx cy, then all others
  std::vector<int> order;
  for (const auto& n : numbers) order.push_back(n.first);
  const int before = (kTile - v.columns.total % kTile) % kTile,
            others = static_cast<int>(
                std::count_if(order.begin(), order.end(), [](int n) { return n >= kFirst; }));
  if (v.model->rows() == 2 && static_cast<int>(order.size()) == others + kFirst &&
      others >= before) {
    std::rotate(order.begin(), order.begin() + kFirst, order.begin() + kFirst + before);
    const auto halves = order.begin() + before;  // fx fy cx cy
    std::swap(halves[1], halves[2]);
    v.halves = v.columns.total + before;
  }
  for (size_t i = 0; i < order.size(); ++i) v.own[order[i]] = v.columns.total + static_cast<int>(i);
}

}  // namespace

/// Columns of L and of M, and where they are in the group.
void Layout::place_view(ViewLayout& v, const std::map<int, int>& places,
                        const SampleLayout& s) const {
  const SensorPath& path = s.paths[v.path];
  v.map.kinematic.clear();
  v.map.own.clear();
  v.poses.clear();
  const auto shared = [&](int column) { return place_of(places, column); };

  // K: a free target's pose, the path's columns, other poses. What is private comes first.
  const auto add_pose = [&](Source source, int parameter) {
    MotionColumns m{source};
    m.parameter = parameter;
    m.count = static_cast<int>(freed[parameter]->components.size());
    m.first = static_cast<int>(v.map.kinematic.size());
    for (int i = 0; i < m.count; ++i)
      v.map.kinematic.push_back(shared(first_column[parameter] + i));
    v.poses.push_back(m);
  };
  const int target_pose = table.target_pose[v.target_index],
            sensor_pose = table.sensor_pose[v.sensor_index];
  if (v.target_slot >= 0) {
    MotionColumns m{Source::target_pose};
    m.count = 6;
    for (int i = 0; i < 6; ++i) v.map.kinematic.push_back(6 * v.target_slot + i);
    v.poses.push_back(m);
  }
  v.path_column = static_cast<int>(v.map.kinematic.size());
  v.map.kinematic.insert(v.map.kinematic.end(), path.places.begin(), path.places.end());
  if (v.target_slot < 0 && freed[target_pose]) add_pose(Source::target_pose, target_pose);
  if (freed[sensor_pose]) {
    if (freed[sensor_pose]->whole(table.all[sensor_pose]))
      for (int i = 0; i < 6; ++i)  // what is seen moves the other way
        v.map.own.push_back(
            {(path.scan_step >= 0 ? 6 : 0) + i, shared(first_column[sensor_pose] + i), -1});
    else
      add_pose(Source::sensor_pose, sensor_pose);
  }

  // L: the pose, the sensor's own numbers, the target's shape. Kernels leave out numbers that are
  // held.
  v.columns = Columns();
  Columns& c = v.columns;
  const int square = v.model->measures_pose() ? -1 : table.target_square[v.target_index];
  const int points = v.model->measures_pose() ? -1 : table.target_points[v.target_index];
  const int warp = v.model->measures_pose() ? -1 : table.target_warp[v.target_index];
  const int print = v.model->measures_pose() ? -1 : table.target_print[v.target_index];
  const bool points_freed = points >= 0 && freed[points];
  v.kernel = !v.covariances && !points_freed && warp < 0 && print < 0 &&
                     (setup.noise == NoiseMode::latent || setup.noise == NoiseMode::none)
                 ? v.model->kernel()
                 : nullptr;
  if (path.sensor_side) {
    c.sensor_side = 6;
    c.joint = 12;
    c.total = path.rows();
  }
  std::fill(std::begin(v.own), std::end(v.own), -1);
  v.halves = -1;
  if (table.sensor_block[v.sensor_index] >= 0) {
    const int first = table.sensor_block[v.sensor_index];
    std::vector<std::pair<int, int>> numbers;  // freed: which of the sensor's, its shared column
    int own = 0;
    for (size_t b = 0; b < v.sensor->parameters.size(); ++b) {
      const int parameter = first + static_cast<int>(b);
      if (freed[parameter])
        for (size_t i = 0; i < freed[parameter]->components.size(); ++i)
          numbers.push_back({own + freed[parameter]->components[i],
                             first_column[parameter] + static_cast<int>(i)});
      own += table.all[parameter].size();
    }
    const int column = c.total;
    if (!numbers.empty()) c.parameters = c.total;
    if (v.kernel) place_for_kernel(numbers, v);
    for (const auto& [number, in] : numbers) {
      if (!v.kernel) v.own[number] = column + number;
      v.map.own.push_back({v.own[number], shared(in), 1});
    }
    if (c.parameters >= 0) c.total += v.kernel ? static_cast<int>(numbers.size()) : own;
  }
  if (square >= 0 && freed[square]) {
    c.square = c.total++;
    v.map.own.push_back({c.square, shared(first_column[square]), 1});
  }
  for (const auto& [shape, column] : {std::pair(warp, &c.warp), std::pair(print, &c.print)}) {
    if (shape < 0 || !freed[shape]) continue;
    *column = c.total;
    c.total += 2;
    for (size_t i = 0; i < freed[shape]->components.size(); ++i)
      v.map.own.push_back({*column + freed[shape]->components[i],
                           shared(first_column[shape] + static_cast<int>(i)), 1});
  }
  if (points_freed) {
    c.points = c.total;
    c.total += table.all[points].size();
    for (size_t i = 0; i < freed[points]->components.size(); ++i)
      v.map.own.push_back({c.points + freed[points]->components[i],
                           shared(first_column[points] + static_cast<int>(i)), 1});
  }
  v.map.width = c.total;
}

/// What the kernels read: layouts of grids, each set of seen points once, and room for measured
/// numbers, view after view.
void Layout::place_data() {
  size_t most = 0;
  for (const auto& entry : layouts)
    for (const ViewLayout& v : entry.second->views) most += 3 * static_cast<size_t>(v.stride());
  for (const PlacedSample& s : samples)
    for (const PlacedView& v : s.views) most += static_cast<size_t>(v.layout->padded_rows());
  seen.reserve(most);
  std::map<std::pair<int, std::vector<int>>, size_t> grids;
  for (auto& entry : layouts)
    for (ViewLayout& v : entry.second->views) {
      if (!v.kernel || !v.target->grid) continue;
      const auto placed = grids.insert({{v.target_index, v.ids}, seen.size()});
      v.points = placed.first->second;
      if (!placed.second) continue;
      for (int c = 0; c < 3; ++c)
        for (int i = 0; i < v.stride(); ++i)
          seen.push_back(v.target->layout(c, v.ids[std::min<size_t>(i, v.ids.size() - 1)]));
    }
  for (PlacedSample& s : samples)
    for (PlacedView& v : s.views) {
      const ViewLayout& layout = *v.layout;
      if (!layout.kernel || layout.model->has_own_noise()) v.whitening = whitenings++;
      if (!layout.kernel) continue;
      v.measured = seen.size();
      seen.resize(seen.size() + static_cast<size_t>(layout.padded_rows()), 0.0);
    }
}

void Layout::reload() {
  for (PlacedSample& s : samples)
    for (PlacedView& v : s.views) {
      if (!v.layout->kernel) continue;
      const SensorModel& model = *v.layout->model;
      model.compared(v.z(), static_cast<int>(v.layout->ids.size()), v.layout->stride(),
                     seen.data() + v.measured);
    }
}

}  // namespace kincal
