#include "estimation.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "../../solver/decompositions.h"
#include "../../solver/kernels.h"
#include "rows.h"

namespace kincal {

struct Estimation::Parts {
  Parts(const Recording& recording, const std::vector<int>& samples, EstimationSetup setup)
      : layout(recording, samples, std::move(setup)), motion(layout), whitened(layout, motion) {}

  /// Rows of a group. `compress`: each view's to at most as many as it has columns; `kinds`, unless
  /// null: which rows are which noise's.
  bool group_rows(int group, const VectorXd& state, int worker, bool compress, MatrixXd& rows,
                  std::vector<NoiseRows>* kinds);
  Eigen::Map<MatrixXd> rows_of_view(const ViewLayout& v, Scratch& local, const NoisePart& part,
                                    int most) const;
  Eigen::Map<MatrixXd> compressed_view(const PlacedView& v, int kinematic_rows, bool compress,
                                       Scratch& local, std::vector<NoiseRows>* kinds) const;

  Layout layout;
  Motion motion;
  Rows whitened;
  std::vector<Scratch> scratch;  // by worker
};

Estimation::Estimation(const Recording& recording, const std::vector<int>& samples,
                       EstimationSetup setup)
    : parts_(std::make_unique<Parts>(recording, samples, std::move(setup))) {
  parts_->layout.reload();
  set_workers(1);
}
Estimation::~Estimation() = default;

bool Estimation::empty() const {
  return groups().empty() || (groups().size() == 1 && !setup().priors.empty());
}
const EstimationSetup& Estimation::setup() const { return parts_->layout.setup; }
const VectorXd& Estimation::initial() const { return parts_->layout.initial(); }
std::string Estimation::column_name(int column) const {
  return parts_->layout.table.name(columns()[column]);
}
const std::vector<Component>& Estimation::columns() const { return parts_->layout.columns; }
int Estimation::shared_size() const { return static_cast<int>(columns().size()); }
const std::vector<GroupShape>& Estimation::groups() const { return parts_->layout.groups; }
int Estimation::prior_group() const {
  return setup().priors.empty() ? -1 : static_cast<int>(parts_->layout.samples.size());
}

void Estimation::reload() {
  parts_->layout.reload();
  parts_->motion.forget();
}

void Estimation::set_loss(const Loss& loss) {
  parts_->layout.setup.loss = loss;
  parts_->whitened.set_losses();
}

void Estimation::set_noise_ratios(const std::vector<double>& noise_ratios) {
  parts_->layout.setup.noise_ratios = noise_ratios;
  parts_->whitened.set_losses();
}

void Estimation::set_workers(int count) { resize_scratch(parts_->layout, count, parts_->scratch); }

void Estimation::prepare(const VectorXd& state) { parts_->motion.prepare(state); }

bool Estimation::renew(const VectorXd& state) {
  prepare(state);
  return parts_->whitened.renew(state, parts_->scratch[0]);
}

int Estimation::sample_count() const { return static_cast<int>(parts_->layout.samples.size()); }

void Estimation::take_alone(int i) {
  Layout& layout = parts_->layout;
  layout.taken = static_cast<size_t>(i);
  const SampleLayout& one = *layout.samples[layout.taken].layout;
  layout.groups = {one.shape};
  layout.state_size = static_cast<int>(layout.table.initial.size()) + one.state_size();
}

int Estimation::sample_of(int group) const {
  const PlacedSample* const s = parts_->layout.sample(group);
  return s ? s->index : -1;
}

VectorXd Estimation::pack(const Values& values) const {
  const Layout& layout = parts_->layout;
  VectorXd state(layout.state_size);
  state.head(values.shared.size()) = values.shared;
  for (const PlacedSample& s : layout.taking_part()) {
    int at = s.start;
    for (int t : s.layout->targets) {
      const auto it = values.targets.find({s.index, t});
      set_pose(state, at, it == values.targets.end() ? Pose() : it->second);
      at += 12;
    }
    for (int j : s.layout->noisy) {
      const auto it = values.errors.find({s.index, j});
      state(at++) = it == values.errors.end() ? 0 : it->second;
    }
  }
  return state;
}

void Estimation::unpack(const VectorXd& state, Values& values) const {
  const Layout& layout = parts_->layout;
  values.shared = state.head(layout.table.initial.size());
  for (const PlacedSample& s : layout.taking_part()) {
    int at = s.start;
    for (int t : s.layout->targets) {
      values.targets[{s.index, t}] = get_pose(state, at);
      at += 12;
    }
    for (int j : s.layout->noisy) values.errors[{s.index, j}] = state(at++);
  }
}

std::vector<char> Estimation::influencing() const {
  const Layout& layout = parts_->layout;
  std::vector<char> used(layout.table.all.size(), 0);
  const auto use = [&](int parameter) {
    if (parameter >= 0) used[parameter] = 1;
  };
  for (const auto& entry : layout.layouts)
    for (const ViewLayout& v : entry.second->views) {
      use(layout.table.sensor_pose[v.sensor_index]);
      for (size_t b = 0; b < v.sensor->parameters.size(); ++b)
        use(layout.table.sensor_block[v.sensor_index] + static_cast<int>(b));
      use(layout.table.time_offset[v.sensor_index]);
      use(layout.table.line_time[v.sensor_index]);
      use(layout.table.target_pose[v.target_index]);
      if (!v.sensor->model->measures_pose()) {
        use(layout.table.target_square[v.target_index]);
        use(layout.table.target_warp[v.target_index]);
        use(layout.table.target_print[v.target_index]);
        use(layout.table.target_points[v.target_index]);
      }
      for (const PathStep& step : entry.second->paths[v.path].steps) {
        use(layout.table.joint_origin[step.joint]);
        if (!layout.rig.tree.joints[step.joint].moves()) continue;
        const int drv = driver(layout.rig.tree, step.joint).joint;
        for (int p = layout.table.joint_offset[drv]; p < layout.table.joint_origin[drv]; ++p)
          use(p);
        use(layout.table.compliance[step.joint]);
        for (size_t j = 0; layout.rig.elasticity && j < layout.table.load.size(); ++j)
          if (layout.rig.elasticity->skeleton->index[step.joint] >= 0 &&
              layout.rig.elasticity->skeleton->carries(step.joint, static_cast<int>(j)))
            use(layout.table.load[j]);
      }
    }
  return used;
}

bool Estimation::evaluate(int group, const VectorXd& state, int worker, Cost& cost) const {
  const Layout& layout = parts_->layout;
  const Rows& whitened = parts_->whitened;
  cost = {};
  const PlacedSample* const placed = layout.sample(group);
  if (!placed) {
    PriorRow row;
    for (size_t i = 0; i < layout.setup.priors.size(); ++i) {
      whitened.prior_row(i, state, false, row);
      cost.doubled = cost.chi2 += row.r * row.r;
    }
    return true;
  }
  const PlacedSample& s = *placed;
  Scratch& scratch = parts_->scratch[worker];
  if (!parts_->motion.walk(s, state, scratch, false)) return false;
  for (const PlacedView& v : s.views)
    if (!whitened.view_rows(v, s, state, scratch, false, cost)) return false;
  const int errors = s.errors();
  const Sample& sample = layout.recorded[s.index];
  for (size_t i = 0; i < s.layout->noisy.size(); ++i) {
    const double e =
        state(errors + static_cast<int>(i)) / joint_sigma(layout.rig, sample, s.layout->noisy[i]);
    cost.doubled += e * e;
    cost.chi2 += e * e;
  }
  return true;
}

bool Estimation::linearise(int group, const VectorXd& state, int worker, const GroupEquations& to,
                           Cost& cost) const {
  const Layout& layout = parts_->layout;
  const Motion& motion = parts_->motion;
  const Rows& whitened = parts_->whitened;
  cost = {};
  const PlacedSample* const placed = layout.sample(group);
  if (!placed) {
    PriorRow row;
    for (size_t i = 0; i < layout.setup.priors.size(); ++i) {
      whitened.prior_row(i, state, true, row);
      cost.doubled = cost.chi2 += row.r * row.r;
      for (int a = 0; a < row.count; ++a) {
        for (int b = 0; b <= a; ++b)
          to.shared[to.origin[to.row[row.place + b]] + to.row[row.place + a]] +=
              row.derivative[a] * row.derivative[b];
        to.gradient[to.row[row.place + a]] += row.derivative[a] * row.r;
      }
    }
    return true;
  }
  const PlacedSample& s = *placed;
  Scratch& scratch = parts_->scratch[worker];
  const int size = layout.groups[group].size();
  if (!parts_->motion.walk(s, state, scratch, true)) return false;
  for (const PlacedView& v : s.views) {
    if (!whitened.view_rows(v, s, state, scratch, true, cost)) return false;
    const int w = v.layout->columns.total + 1;
    const double* l = scratch.rows.data();
    MatrixXd& gram = scratch.expand.gram;
    const int rows = v.layout->padded_rows(), ld = static_cast<int>(gram.outerStride());
    if (v.layout->halves >= 0)
      kernels().gram_of_halves(l, rows, scratch.rows.outerStride(), w, v.layout->halves,
                               gram.data(), ld);
    else
      kernels().gram(l, rows, scratch.rows.outerStride(), w, gram.data(), ld);
    motion.kinematic_matrix(v, s, state, scratch);
    const int depth = s.layout->paths[v.layout->path].rows(), sum = v.layout->sum;
    if (!scratch.summing || sum < 0) {
      expand(depth, v.layout->map, layout.groups[group], scratch.expand, to, nullptr);
      continue;
    }
    double* const sum_at = scratch.sums.data() + scratch.sums_start[sum];
    if (!scratch.is_begun[sum]) {
      std::fill(sum_at, scratch.sums.data() + scratch.sums_start[sum + 1], 0.0);
      scratch.is_begun[sum] = 1;
      scratch.begun.push_back(sum);
    }
    const SharedSums sums(layout.sums[sum], sum_at);
    expand(depth, v.layout->map, layout.groups[group], scratch.expand, to, &sums);
  }
  const int errors = s.errors();
  const Sample& sample = layout.recorded[s.index];
  for (size_t i = 0; i < s.layout->noisy.size(); ++i) {
    const double w = 1 / joint_sigma(layout.rig, sample, s.layout->noisy[i]),
                 e = state(errors + static_cast<int>(i)) * w;
    const size_t at = 6 * s.layout->targets.size() + i;
    to.rows[at * to.stride + at] += w * w;
    to.rows[at * to.stride + size] += w * e;
    cost.doubled += e * e;
    cost.chi2 += e * e;
  }
  return true;
}

void Estimation::begin_piece(int worker) const {
  Scratch& scratch = parts_->scratch[worker];
  for (const int i : scratch.begun) scratch.is_begun[i] = 0;
  scratch.begun.clear();
  scratch.summing = true;
}

void Estimation::end_piece(int worker, const GroupEquations& to) const {
  Scratch& scratch = parts_->scratch[worker];
  const std::vector<SharedColumns>& sums = parts_->layout.sums;
  std::sort(scratch.begun.begin(), scratch.begun.end());
  for (const int i : scratch.begun)
    add_shared(sums[i], {sums[i], scratch.sums.data() + scratch.sums_start[i]}, to);
  scratch.summing = false;
}

namespace {

/// Makes rows an upper triangle with the same Gram matrix; they end with zeros to a multiple of 8,
/// and those behind the triangle are scratch afterwards.
void make_triangle(Eigen::Ref<MatrixXd> rows) {
  const int width = static_cast<int>(rows.cols());
  kernels().triangularise(rows.data(), static_cast<int>(rows.rows()), width, width,
                          rows.outerStride());
  for (int c = 0; c + 1 < width; ++c) rows.col(c).segment(c + 1, width - c - 1).setZero();
}

/// Returns how many rows are left where more than `most` become a triangle.
int rows_left(int rows, int most, int width) { return rows > most ? std::min(rows, width) : rows; }

double* room(AlignedNumbers& in, Eigen::Index count) {
  if (in.size() < static_cast<size_t>(count)) in.resize(static_cast<size_t>(count));
  return in.data();
}

constexpr int kRigidMotion = 6;  // degrees of freedom of a rigid motion

/// Copies a triangle whose first `kinematic` columns are how a view moves: rows that depend on the
/// motion of a rigid thing come first. Returns how many these are. A scanning sensor's view has
/// more columns, which move it in no more ways but for next to nothing.
int copy_motion_first(int kinematic, const Eigen::Ref<const MatrixXd>& triangle,
                      std::vector<std::pair<double, int>>& order, Eigen::Ref<MatrixXd> to) {
  const int rows = static_cast<int>(triangle.rows()), all = std::min(rows, kinematic);
  to = triangle;
  if (all <= kRigidMotion) return all;
  order.clear();  // by what is left of a column, relative to all of it
  for (int i = 0; i < all; ++i)
    order.push_back({-std::abs(triangle(i, i)) / std::max(1e-300, triangle.col(i).norm()), i});
  std::sort(order.begin(), order.end());
  for (int i = 0; i < all; ++i) to.row(i) = triangle.row(order[i].second);
  return kRigidMotion;
}

}  // namespace

/// What is in the scratch of a view, [L r], of the rows of a part in each block. More than `most`
/// rows become a triangle. In Scratch::part.
Eigen::Map<MatrixXd> Estimation::Parts::rows_of_view(const ViewLayout& v, Scratch& local,
                                                     const NoisePart& part, int most) const {
  const int width = v.columns.total + 1, rows = v.blocks() * part.count;
  const bool compress = rows > most;
  const int height = compress ? padded(std::max(rows, width)) : rows;
  Eigen::Map<MatrixXd> out(room(local.part, static_cast<Eigen::Index>(height) * width), height,
                           width);
  out.setZero();
  for (int b = 0; b < v.blocks(); ++b)
    for (int i = 0; i < part.count; ++i)
      out.row(b * part.count + i) = local.rows.row(v.row(b, part.first + i)).head(width);
  if (compress) make_triangle(out);
  return out;
}

/// Compresses the rows of a view in the scratch, each kind of noise by itself if `kinds` are asked
/// for; their first rows count from 0. In Scratch::view.
Eigen::Map<MatrixXd> Estimation::Parts::compressed_view(const PlacedView& v, int kinematic_rows,
                                                        bool compress, Scratch& local,
                                                        std::vector<NoiseRows>* kinds) const {
  const ViewLayout& layout_of = *v.layout;
  const int width = layout_of.columns.total + 1;
  const auto view_of = [&](int count) {
    return Eigen::Map<MatrixXd>(room(local.view, static_cast<Eigen::Index>(count) * width), count,
                                width);
  };
  if (kinds && layout_of.noise.size() > 1) {
    const int most = std::min(kRigidMotion, kinematic_rows);
    int all = 0;
    for (const NoisePart& part : layout_of.noise)
      all += rows_left(layout_of.blocks() * part.count, most, width);
    Eigen::Map<MatrixXd> view = view_of(all);
    int filled = 0;
    for (size_t p = 0; p < layout_of.noise.size(); ++p) {
      const NoisePart& part = layout_of.noise[p];
      const int rows = layout_of.blocks() * part.count, count = rows_left(rows, most, width);
      const Eigen::Map<MatrixXd> of_part = rows_of_view(layout_of, local, part, most);
      const int moved = copy_motion_first(kinematic_rows, of_part.topRows(count), local.by_share,
                                          view.middleRows(filled, count));
      kinds->push_back({v.view, static_cast<int>(p), -1, filled, count, rows, moved});
      filled += count;
    }
    return view;
  }
  const int rows = layout_of.rows();
  int count = rows;
  if (compress && rows > width) {
    count = width;
    const auto seen = local.rows.topLeftCorner(layout_of.padded_rows(), width);
    make_triangle(seen);
    view_of(count) = seen.topRows(count);
  } else {
    const int most = kinds ? kinematic_rows : rows;
    count = rows_left(rows, most, width);
    view_of(count) =
        rows_of_view(layout_of, local, {"", "", 0, layout_of.model->rows()}, most).topRows(count);
  }
  if (kinds) kinds->push_back({v.view, 0, -1, 0, count, rows, std::min(count, kinematic_rows)});
  return view_of(count);
}

bool Estimation::Parts::group_rows(int group, const VectorXd& state, int worker, bool compress,
                                   MatrixXd& rows, std::vector<NoiseRows>* kinds) {
  const GroupShape& shape = layout.groups[group];
  const int size = shape.size();
  if (kinds) kinds->clear();
  const PlacedSample* const placed = layout.sample(group);
  if (!placed) {
    rows.setZero(shape.rows, size + 1);
    PriorRow row;
    for (size_t i = 0; i < layout.setup.priors.size(); ++i) {
      whitened.prior_row(i, state, true, row);
      for (int k = 0; k < row.count; ++k)
        rows(static_cast<Eigen::Index>(i), row.place + k) = row.derivative[k];
      rows(static_cast<Eigen::Index>(i), size) = row.r;
    }
    if (kinds) kinds->push_back({nullptr, 0, -1, 0, shape.rows});
    return true;
  }
  const PlacedSample& s = *placed;
  Scratch& local = scratch[worker];
  Eigen::Index all = static_cast<Eigen::Index>(s.layout->noisy.size()), used = 0;
  for (const ViewLayout& v : s.layout->views) {
    const int width = v.columns.total + 1, kinematic_rows = s.layout->paths[v.path].rows();
    if (kinds && v.noise.size() > 1) {
      for (const NoisePart& part : v.noise)
        all += rows_left(v.blocks() * part.count, std::min(kRigidMotion, kinematic_rows), width);
    } else {
      const int most = compress && v.rows() > width ? width : kinds ? kinematic_rows : v.rows();
      all += rows_left(v.rows(), most, width);
    }
  }
  rows.setZero(all, size + 1);
  Cost cost;
  if (!motion.walk(s, state, local, true)) return false;
  for (const PlacedView& v : s.views) {
    if (!whitened.view_rows(v, s, state, local, true, cost)) return false;
    const int kinematic_rows = s.layout->paths[v.layout->path].rows();
    const size_t before = kinds ? kinds->size() : 0;
    const Eigen::Map<MatrixXd> view = compressed_view(v, kinematic_rows, compress, local, kinds);
    for (size_t i = before; kinds && i < kinds->size(); ++i)
      (*kinds)[i].first += static_cast<int>(used);
    motion.kinematic_matrix(v, s, state, local);
    const auto m = local.expand.m.topLeftCorner(
        kinematic_rows, static_cast<Eigen::Index>(v.layout->map.kinematic.size()));
    const int columns = static_cast<int>(m.cols()), ld = padded(columns) + kSlack;
    Eigen::Map<RowMatrix> kinematic(room(local.moved_rows, view.rows() * ld), view.rows(), ld);
    kernels().multiply(view.data(), 1, view.outerStride(), static_cast<int>(view.rows()),
                       kinematic_rows, m.data(), static_cast<int>(m.outerStride()), columns,
                       kinematic.data(), ld);
    double* const norms = room(local.part, kinematic_rows);
    for (int k = 0; k < kinematic_rows; ++k) norms[k] = view.col(k).squaredNorm();
    for (int i = 0; i < columns; ++i) {
      double parts = 0;
      for (int k = 0; k < kinematic_rows; ++k) parts += m(k, i) * m(k, i) * norms[k];
      if (kinematic.col(i).squaredNorm() <= kCancelled * parts) kinematic.col(i).setZero();
    }
    auto part = rows.middleRows(used, view.rows());
    for (size_t i = 0; i < v.layout->map.kinematic.size(); ++i)
      part.col(v.layout->map.kinematic[i]) += kinematic.col(i);
    for (const OwnColumn& own : v.layout->map.own)
      part.col(own.place) += own.sign * view.col(own.column);
    part.col(size) = view.col(view.cols() - 1);
    used += view.rows();
  }
  const int errors = s.errors();
  const Sample& sample = layout.recorded[s.index];
  for (size_t i = 0; i < s.layout->noisy.size(); ++i, ++used) {
    const double w = 1 / joint_sigma(layout.rig, sample, s.layout->noisy[i]);
    if (kinds) kinds->push_back({nullptr, 0, s.layout->noisy[i], static_cast<int>(used), 1});
    rows(used, static_cast<Eigen::Index>(6 * s.layout->targets.size() + i)) = w;
    rows(used, size) = w * state(errors + static_cast<int>(i));
  }
  return true;
}

bool Estimation::square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const {
  return parts_->group_rows(group, state, worker, true, rows, nullptr);
}

bool Estimation::noise_rows(int group, const VectorXd& state, MatrixXd& rows,
                            std::vector<NoiseRows>& kinds) const {
  return parts_->group_rows(group, state, 0, true, rows, &kinds);
}

bool Estimation::explicit_rows(int group, const VectorXd& state, MatrixXd& rows) const {
  return parts_->group_rows(group, state, 0, false, rows, nullptr);
}

void Estimation::retract(const VectorXd& state, const VectorXd& shared_step,
                         const VectorXd& private_step, VectorXd& moved) const {
  const Layout& layout = parts_->layout;
  moved = state;
  for (const Freed& f : layout.setup.free) {
    const Parameter& p = layout.table.all[f.parameter];
    const auto step = shared_step.segment(layout.first_column[f.parameter],
                                          static_cast<Eigen::Index>(f.components.size()));
    if (!p.pose) {
      for (size_t i = 0; i < f.components.size(); ++i)
        moved(p.start + f.components[i]) += step(static_cast<Eigen::Index>(i));
    } else if (f.whole(p)) {
      set_pose(moved, p.start, get_pose(state, p.start) * exp_se3(step));
    } else {
      const Pose origin = get_pose(layout.initial(), p.start);
      Vector6d xi = log_se3(inverse(origin) * get_pose(state, p.start));
      for (size_t i = 0; i < f.components.size(); ++i)
        xi(f.components[i]) += step(static_cast<Eigen::Index>(i));
      set_pose(moved, p.start, origin * exp_se3(xi));
    }
  }
  Eigen::Index at = 0;
  for (const PlacedSample& s : layout.taking_part()) {
    int place = s.start;
    for (size_t t = 0; t < s.layout->targets.size(); ++t, place += 12, at += 6)
      set_pose(moved, place, get_pose(state, place) * exp_se3(private_step.segment<6>(at)));
    for (size_t i = 0; i < s.layout->noisy.size(); ++i) moved(place++) += private_step(at++);
  }
}

namespace {

/// Adds the residuals of a view's next point.
void append(const ViewResiduals& next, ViewResiduals& view) {
  const std::pair<VectorXd*, const VectorXd*> parts[] = {{&view.raw, &next.raw},
                                                         {&view.whitened, &next.whitened}};
  for (const auto& [to, from] : parts) {
    to->conservativeResize(to->size() + from->size());
    to->tail(from->size()) = *from;
  }
}

}  // namespace

std::vector<ViewResiduals> Estimation::residuals(const VectorXd& state) const {
  const Layout& layout = parts_->layout;
  const Motion& motion = parts_->motion;
  const Rows& whitened = parts_->whitened;
  std::vector<ViewResiduals> out;
  size_t views = 0;
  for (const PlacedSample& s : layout.taking_part()) views += s.views.size();
  out.reserve(views);
  Scratch& scratch = parts_->scratch[0];
  for (const PlacedSample& s : layout.taking_part()) {
    const bool stands = motion.walk(s, state, scratch, false);
    for (const PlacedView& v : s.views) {
      ViewResiduals r;
      r.view = v.view;
      r.sample = s.index;
      Cost cost;
      const bool defined = whitened.view_rows(v, s, state, scratch, false, cost) && stands;
      r.whitened.resize(v.layout->rows());
      const int k = v.layout->model->rows(), blocks = v.layout->blocks();
      for (int b = 0; b < blocks; ++b)
        for (int i = 0; i < k; ++i) r.whitened(b * k + i) = scratch.r(v.layout->row(b, i));
      const SensorModel& model =
          *v.layout->sensor->model;  // whatever the mode whitens: what the sensor itself measures
      r.raw.resize(model.rows() * model.blocks(static_cast<int>(v.layout->ids.size())));
      const std::vector<double>& sigma = v.view->sigma;
      const bool divides = std::all_of(sigma.begin(), sigma.end(), [](double x) { return x > 0; });
      if (v.layout->kernel && !model.has_own_noise() && divides) {  // whitened one by one
        for (int b = 0; b < blocks; ++b)
          for (int i = 0; i < k; ++i) r.raw(b * k + i) = r.whitened(b * k + i) * sigma[i];
        if (!defined) r.raw.setConstant(std::nan(""));
      } else {
        whitened.view_input(v, state, scratch);
        if (!model.evaluate(scratch.input, v.layout->columns, r.raw.data(), nullptr))
          r.raw.setConstant(std::nan(""));
      }
      if (v.point > 0)
        append(r, out.back());
      else
        out.push_back(std::move(r));
    }
  }
  return out;
}

}  // namespace kincal
