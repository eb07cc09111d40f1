#include "rows.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "../../solver/decompositions.h"
#include "../rig/targets.h"

namespace kincal {
namespace {

/// Matrices of one size for the compiler: every other size of Eigen's LU is compiled anew.
SmallMatrix inverse_of_small(const SmallMatrix& m) { return m.inverse(); }

SmallMatrix inverse_square_root(const SmallMatrix& c) {
  const SymmetricEigen eigen = symmetric_eigen(c);
  SmallMatrix scaled = eigen.vectors;
  for (Eigen::Index i = 0; i < c.cols(); ++i)
    scaled.col(i) /= std::sqrt(std::max(eigen.values(i), 1e-14 * eigen.values.maxCoeff()));
  return scaled.lazyProduct(eigen.vectors.transpose());
}

/// k rows of `columns` numbers, `ld` apart, times a k x k matrix from the left (K = k, or 0: any k
/// up to 6), in place.
template <int K>
void multiply_rows(const double* matrix, int k, double* rows, Eigen::Index ld,
                   Eigen::Index columns) {
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

/// The inverse root of that, b.rows() squared, column by column.
void root_of_noise(const MatrixXd& b, const Eigen::Ref<const VectorXd>& sigma, double* root) {
  if (b.rows() == 3 && b.cols() == 3)
    Eigen::Map<Matrix3d>(root, 3, 3) =
        Vector3d(sigma).cwiseInverse().asDiagonal() * Matrix3d(b.topLeftCorner<3, 3>().inverse());
  else
    Eigen::Map<MatrixXd>(root, b.rows(), b.rows()) =
        b.rows() == b.cols() ? SmallMatrix(sigma.cwiseInverse().asDiagonal() * inverse_of_small(b))
                             : inverse_square_root(covariance_of(b, sigma));
}

}  // namespace

Rows::Rows(const Layout& layout, const Motion& motion)
    : layout_(layout), motion_(motion), whitenings_(layout.whitenings) {
  set_losses();
}

void Rows::set_losses() {
  losses_.assign(layout_.rig.sensors.size(), layout_.setup.loss);
  for (size_t i = 0; i < layout_.setup.noise_ratios.size(); ++i)
    losses_[i].scale = layout_.setup.loss.scale * layout_.setup.noise_ratios[i];
}

/// The rest of the sensor's input.
void Rows::view_input(const PlacedView& v, const VectorXd& state, Scratch& scratch) const {
  ViewInput& in = scratch.input;
  Eigen::Matrix3Xd& points = scratch.points[v.layout->target_index];
  if (v.layout->target->grid) {
    const int target = v.layout->target_index;
    const double square = state(layout_.table.all[layout_.table.target_square[target]].start);
    points = square * v.layout->target->layout;
    in.layout = &v.layout->target->layout;
    in.plain = nullptr;
    if (const int print = layout_.table.target_print[target]; print >= 0) {
      Eigen::Matrix3Xd &plain = scratch.plain[target], &layout = scratch.layouts[target];
      layout = *in.layout;
      layout.topRows<2>() =
          print_map(state.segment<2>(layout_.table.all[print].start)) * in.layout->topRows<2>();
      plain = points;
      points = square * layout;
      in.layout = &layout;
      in.plain = &plain;
    }
    const int warp = layout_.table.target_warp[target];
    in.bulge = warp >= 0 ? &v.layout->target->bulge : nullptr;
    if (warp >= 0) {
      const double* by = state.data() + layout_.table.all[warp].start;
      points.row(2) += by[0] * in.bulge->row(0) + by[1] * in.bulge->row(1);
    }
  } else {
    const Parameter& p = layout_.table.all[layout_.table.target_points[v.layout->target_index]];
    points = Eigen::Map<const Eigen::Matrix3Xd>(state.data() + p.start, 3, p.size() / 3);
    in.layout = nullptr;
    in.bulge = nullptr;
    in.plain = nullptr;
  }
  in.points = &points;
  in.ids = v.layout->ids.data();
  in.count = static_cast<int>(v.layout->ids.size());
  in.z = v.z();
  in.sigma = v.view->sigma.data();
}

/// Whitened rows [L r] of a view into scratch.rows (derivatives) or r alone into scratch.r, the
/// loss's slopes applied; cost added.
bool Rows::view_rows(const PlacedView& v, const PlacedSample& s, const VectorXd& state,
                     Scratch& scratch, bool derivatives, Cost& cost) const {
  motion_.view_poses(v, s, state, scratch);
  return v.layout->kernel ? kernel_rows(v, state, scratch, derivatives, cost)
                          : plain_rows(v, state, scratch, derivatives, cost);
}

/// What the kernel of a scanning sensor reads of the joint, which is elsewhere at each point.
ScanView Rows::scan_view(const PlacedView& v, const RowMatrix3d& side, bool derivatives,
                         Scratch& scratch) const {
  const Scan& scan = scratch.scan;
  const int stride = v.layout->stride(), count = static_cast<int>(v.layout->ids.size()),
            apart = v.layout->model->measurement_size(), numbers = scan.model->size();
  double* turns = scratch.turned.data();
  double* by_own = turns + kTurns * stride;
  std::fill(turns, by_own + numbers * stride, 0.0);
  for (int i = 0; i < count; ++i) {
    const double reading = v.view->z[static_cast<size_t>(i) * apart],
                 q = scan.direction * scan.position(reading);
    turns[i] = scan.prismatic ? 1 : std::cos(q);
    turns[stride + i] = scan.prismatic ? 0 : std::sin(q);
    turns[2 * stride + i] = scan.prismatic ? q : 0;
    if (!derivatives || v.layout->columns.joint < 0) continue;
    for (int n = 0; n < numbers; ++n)
      by_own[n * stride + i] = scan.direction * scan.model->by_own(n, reading, scan.own);
  }
  return {side.data(),
          scan.sensor_T_before.translation.data(),
          scan.axis.data(),
          scan.prismatic,
          turns,
          by_own,
          numbers,
          whitenings_[v.whitening].roots.data()};
}

/// view_rows() by the sensor's kernel.
bool Rows::kernel_rows(const PlacedView& v, const VectorXd& state, Scratch& scratch,
                       bool derivatives, Cost& cost) const {
  const int stride = v.layout->stride(), w = v.layout->columns.total,
            rows = v.layout->padded_rows(), count = static_cast<int>(v.layout->ids.size());
  const double* points = layout_.seen.data() + v.layout->points;
  if (!v.layout->target->grid) {
    const double* from =
        state.data() + layout_.table.all[layout_.table.target_points[v.layout->target_index]].start;
    for (int i = 0; i < stride; ++i)
      for (int c = 0; c < 3; ++c)
        scratch.gathered[c * stride + i] = from[3 * v.layout->ids[std::min(i, count - 1)] + c];
    points = scratch.gathered.data();
  }
  const Pose& pose = scratch.input.sensor_T_target;
  const RowMatrix3d rotation = pose.rotation;
  double weights[3];  // 1 / sigma of each component
  for (int k = 0; k < v.layout->model->rows(); ++k) weights[k] = 1 / v.view->sigma[k];
  PointView view = {
      points,
      v.layout->target->grid
          ? state(layout_.table.all[layout_.table.target_square[v.layout->target_index]].start)
          : 1.0,
      rotation.data(),
      pose.translation.data(),
      scratch.input.parameters,
      layout_.seen.data() + v.measured,
      weights,
      count,
      stride};
  const PointRows to = {derivatives ? scratch.rows.col(w).data() : scratch.r.data(),
                        derivatives ? scratch.rows.data() : nullptr,
                        scratch.rows.outerStride(),
                        v.layout->own,
                        v.layout->columns.square,
                        v.layout->columns.sensor_side,
                        v.layout->columns.joint};
  RowMatrix3d side;
  ScanView scan;
  if (scratch.input.scan) {
    side = scratch.scan.sensor_T_before.rotation;
    scan = scan_view(v, side, derivatives, scratch);
    view.scan = &scan;
  }
  double squares;
  if (!v.layout->kernel(view, to, squares)) return false;
  cost.chi2 += squares;
  if (layout_.setup.loss.kind == LossKind::none) {
    cost.doubled += squares;
    return true;
  }
  bool scaled = false;
  std::fill_n(scratch.slopes.begin(), rows, 0.0);
  for (int i = 0; i < count; ++i) {
    double squared = 0, slope;
    for (int k = 0; k * stride < rows; ++k) squared += to.r[k * stride + i] * to.r[k * stride + i];
    cost.doubled += losses_[v.layout->sensor_index](squared, slope);
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
bool Rows::plain_rows(const PlacedView& v, const VectorXd& state, Scratch& scratch,
                      bool derivatives, Cost& cost) const {
  view_input(v, state, scratch);
  const int k = v.layout->model->rows(), blocks = v.layout->blocks(), rows = k * blocks,
            w = v.layout->columns.total;
  auto weighted = scratch.evaluated.topLeftCorner(rows, w + 1);
  if (derivatives) {
    weighted.setZero();
    Eigen::Ref<RowMatrix> l(weighted.leftCols(w));
    if (!v.layout->model->evaluate(scratch.input, v.layout->columns, scratch.r.data(), &l))
      return false;
    weighted.col(w) = scratch.r.head(rows);
  } else if (!v.layout->model->evaluate(scratch.input, v.layout->columns, scratch.r.data(),
                                        nullptr)) {
    return false;
  }
  const Whitening& white = whitenings_[v.whitening];
  const bool marginal =
      layout_.setup.noise == NoiseMode::marginal;  // the view's residuals belong together
  for (int b = 0; b < blocks; ++b) {
    auto r = scratch.r.segment(b * k, k);
    if (!white.roots.empty()) {
      const double* const root = white.roots.data() + static_cast<size_t>(b) * k * k;
      double* rows_of_block = weighted.row(b * k).data();
      const Eigen::Index ld = weighted.outerStride();
      if (k == 3) {
        multiply_rows<3>(root, k, r.data(), 1, 1);
        if (derivatives) multiply_rows<3>(root, k, rows_of_block, ld, w + 1);
      } else {
        multiply_rows<0>(root, k, r.data(), 1, 1);
        if (derivatives) multiply_rows<0>(root, k, rows_of_block, ld, w + 1);
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
    cost.doubled += losses_[v.layout->sensor_index](squared, slope);
    if (derivatives && slope != 1) weighted.middleRows(b * k, k) *= std::sqrt(slope);
  }
  if (marginal) {
    auto all = scratch.r.head(rows);
    if (white.noise.size() > 0) {
      const Eigen::Index q = white.noise.cols();
      const auto take_away = [&](auto&& rows_of) {  // rows -= U root U' rows
        auto projected = scratch.projected.topLeftCorner(q, rows_of.cols()),
             rooted = scratch.rooted.topLeftCorner(q, rows_of.cols());
        projected.noalias() = white.noise.transpose().lazyProduct(rows_of);
        rooted.noalias() = white.root.lazyProduct(projected);
        rows_of.noalias() -= white.noise.lazyProduct(rooted);
      };
      if (derivatives) take_away(weighted);
      take_away(all);
    }
    double squared = all.squaredNorm(), slope;
    cost.chi2 += squared;
    cost.doubled += losses_[v.layout->sensor_index](squared, slope);
    if (derivatives && slope != 1) weighted *= std::sqrt(slope);
  }
  if (derivatives) {
    scratch.rows.topLeftCorner(rows, w + 1) = weighted;
    scratch.rows.block(rows, 0, v.layout->padded_rows() - rows, w + 1).setZero();
  }
  return true;
}

/// Row of prior i, derivatives only if asked for: they stand at places place .. place + count - 1
/// of the priors' group. `row` may hold that of prior i - 1: priors of one pose share its
/// logarithm.
void Rows::prior_row(size_t i, const VectorXd& state, bool derivatives, PriorRow& row) const {
  const Prior& prior = layout_.setup.priors[i];
  const Parameter& p = layout_.table.all[prior.parameter];
  const std::vector<int>& touched = layout_.groups.back().columns;
  const std::vector<int>& components = layout_.freed[prior.parameter]->components;
  const bool same = row.parameter == prior.parameter,
             whole = p.pose && layout_.freed[prior.parameter]->whole(p);
  row.parameter = prior.parameter;
  if (p.pose) {
    if (!same)
      row.log = log_se3(inverse(get_pose(layout_.initial(), p.start)) * get_pose(state, p.start));
    if (!same && derivatives && whole)
      row.inverse_jacobian = inverse_of_small(right_jacobian_se3(row.log));
    row.r = row.log(prior.component) / prior.sigma;
  } else {
    row.r = (state(p.start + prior.component) - layout_.initial()(p.start + prior.component)) /
            prior.sigma;
  }
  if (!derivatives) return;
  row.place = static_cast<int>(
      std::lower_bound(touched.begin(), touched.end(), layout_.first_column[prior.parameter]) -
      touched.begin());
  row.count = whole ? 6 : 1;
  if (whole) {
    for (int k = 0; k < 6; ++k)
      row.derivative[k] = row.inverse_jacobian(prior.component, k) / prior.sigma;
  } else {
    row.place += static_cast<int>(std::find(components.begin(), components.end(), prior.component) -
                                  components.begin());
    row.derivative[0] = 1 / prior.sigma;
  }
}

bool Rows::renew(const VectorXd& state, Scratch& scratch) {
  bool depends = false;
  for (const PlacedSample& s : layout_.taking_part()) {
    bool walked = false;
    for (const PlacedView& v : s.views) {
      if (v.whitening < 0) continue;
      const SensorPath& path = s.layout->paths[v.layout->path];
      Whitening& white = whitenings_[v.whitening];
      const View& view = *v.view;
      const int k = v.layout->model->rows(), blocks = v.layout->blocks();
      const Eigen::Map<const VectorXd> sigma(view.sigma.data(),
                                             static_cast<Eigen::Index>(view.sigma.size()));
      const bool own_noise = v.layout->model->has_own_noise(), joints = !path.noise.empty();
      depends = depends || joints ||
                (own_noise && (v.layout->model->noise_sees_target() || path.sensor_side));
      if (!own_noise && sigma.size() == k) white.inverse_sigma = sigma.cwiseInverse();
      white.roots.clear();
      if (!own_noise && !joints && view.covariance.empty()) continue;
      if (!walked) {
        motion_.walk(s, state, scratch, false);
        walked = true;
      }
      motion_.view_poses(v, s, state, scratch);
      view_input(v, state, scratch);
      const bool block_by_block = own_noise || !view.covariance.empty();
      const size_t size = static_cast<size_t>(k) * k;
      const auto root_of = [&](int i) {
        return Eigen::Map<MatrixXd>(white.roots.data() + i * size, k, k);
      };
      // Block after block; for a kernel entry after entry, one number a block.
      const int stride = v.layout->kernel ? v.layout->stride() : 1;
      const size_t apart = v.layout->kernel ? 1 : size;
      if (block_by_block) white.roots.resize(size * (v.layout->kernel ? stride : blocks), 0.0);
      for (int i = 0; block_by_block && i < blocks; ++i) {
        double root[36];
        if (view.covariance.empty()) {
          v.layout->model->own_noise(scratch.input, i, scratch.own_noise);
          root_of_noise(scratch.own_noise, sigma, root);
        } else {
          Eigen::Map<MatrixXd>(root, k, k) = inverse_square_root(view.covariance[i]);
        }
        double* to = white.roots.data() + i * apart;
        for (int r = 0; r < k; ++r)
          for (int c = 0; c < k; ++c)
            to[(v.layout->kernel ? r * k + c : c * k + r) * stride] = root[c * k + r];
      }
      if (!joints) continue;
      // Jq S^1/2 = L Mq sigma, unwhitened.
      RowMatrix l = RowMatrix::Zero(k * blocks, v.layout->columns.total);
      VectorXd r(k * blocks);
      Eigen::Ref<RowMatrix> reference(l);
      if (!v.layout->model->evaluate(scratch.input, v.layout->columns, r.data(), &reference))
        continue;  // undefined: the linearisation will report it
      const int noisy = static_cast<int>(path.noisy.size());
      motion_.path_columns(path, path.noise, noisy, state, scratch, scratch.paths[v.layout->path]);
      motion_.seen_from_sensor(v, s, state, 0, noisy, scratch);
      MatrixXd jq = l.leftCols(path.rows()) * scratch.expand.m.topLeftCorner(path.rows(), noisy);
      for (int i = 0; i < noisy; ++i)
        jq.col(i) *= joint_sigma(layout_.rig, layout_.recorded[s.index], path.noisy[i]);
      if (layout_.setup.noise == NoiseMode::point) {
        white.roots.resize(blocks * size);
        for (int i = 0; i < blocks; ++i) {
          SmallMatrix covariance = jq.middleRows(i * k, k) * jq.middleRows(i * k, k).transpose();
          if (!view.covariance.empty()) {
            covariance += view.covariance[i];
          } else if (own_noise) {
            v.layout->model->own_noise(scratch.input, i, scratch.own_noise);
            covariance += covariance_of(scratch.own_noise, sigma);
          } else {
            covariance.diagonal() += sigma.cwiseAbs2();
          }
          root_of(i) = inverse_square_root(covariance);
        }
      } else {
        for (int i = 0; i < blocks; ++i)
          jq.middleRows(i * k, k) =
              white.roots.empty()
                  ? MatrixXd(white.inverse_sigma.asDiagonal() * jq.middleRows(i * k, k))
                  : MatrixXd(root_of(i) * jq.middleRows(i * k, k));
        white.noise = jq;
        const SymmetricEigen eigen = symmetric_eigen(jq.transpose() * jq);
        const VectorXd w = eigen.values.cwiseMax(0.0);
        const MatrixXd& q = eigen.vectors;
        // 1 - 1 / sqrt(1 + w) over w, without cancellation for small w.
        const VectorXd root =
            w.unaryExpr([](double x) { return 1 / (std::sqrt(1 + x) * (1 + std::sqrt(1 + x))); });
        white.root = q * root.asDiagonal() * q.transpose();
      }
    }
  }
  return depends;
}

}  // namespace kincal
