#include "evidence.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "../../kinematics/floating.h"
#include "../../solver/decompositions.h"
#include "../estimation/estimation.h"
#include "../rig/scales.h"
#include "linear_model.h"

namespace kincal {
namespace {

constexpr double kRigidNumbers = 6;  // that can be wrong with a rigid thing

/// A linear model with what its columns and kinds of noise are.
struct DataModel {
  LinearModel model;
  std::vector<Component> columns;
  std::vector<NoiseKind> kinds;
};

/// Kinds by number, in the order in which they are met.
class KindNumbers {
 public:
  int of(const NoiseKind& kind) {
    return numbers_.emplace(kind, static_cast<int>(numbers_.size())).first->second;
  }
  std::vector<NoiseKind> all() const {
    std::vector<NoiseKind> out(numbers_.size());
    for (const auto& entry : numbers_) out[entry.second] = entry.first;
    return out;
  }

 private:
  std::map<NoiseKind, int> numbers_;
};

/// Gives the rows of a group their kinds, weighs what counts as fewer numbers, and adds the
/// reference priors of free targets.
LinearModel::Group group_of(const Tree& tree, const GroupShape& shape, MatrixXd rows,
                            const std::vector<NoiseRows>& noise, KindNumbers& kinds,
                            LinearModel& model) {
  LinearModel::Group out;
  out.private_size = shape.private_size;
  out.columns = shape.columns;
  out.kind.assign(rows.rows(), -1);
  const auto mark = [&](const NoiseKind& kind, int first, int count, double numbers) {
    const int k = kinds.of(kind);
    if (k >= model.numbers.size()) model.numbers.conservativeResize(k + 1), model.numbers(k) = 0;
    std::fill_n(out.kind.begin() + first, count, k);
    model.numbers(k) += numbers;
  };
  int joints = 0;
  for (const NoiseRows& w : noise) {
    if (w.joint >= 0) {
      ++joints;
      model.log_private_prior +=
          std::log(rows.row(w.first).head(out.private_size).cwiseAbs().maxCoeff());
      mark({-1, 0, false, same_noise(tree, w.joint).front()}, w.first, 1, 1);
      continue;
    }
    mark({w.view->sensor, w.part, false, -1}, w.first, w.motion, w.motion);
    const int rest = w.residuals - w.motion;
    if (rest == 0) continue;
    const double weight = std::min(1.0, kRigidNumbers / rest);
    rows.middleRows(w.first + w.motion, w.count - w.motion) *= std::sqrt(weight);
    mark({w.view->sensor, w.part, true, -1}, w.first + w.motion, w.count - w.motion, weight * rest);
  }
  const Eigen::Index targets = out.private_size - joints, measured = rows.rows();
  out.rows = MatrixXd::Zero(measured + targets, rows.cols());
  out.rows.topRows(measured) = rows;
  out.rows.bottomLeftCorner(targets, targets).setIdentity();  // 1 m, 1 rad: reference_width()
  out.kind.resize(measured + targets, -1);
  return out;
}

/// Adds the columns of a trend, behind the `shared` ones, to the group of a sample: with it the row
/// (d - (at c)) / sigma stands for d / sigma.
void add_trend(const ReadingTrend& trend, int sample, int shared,
               const std::vector<NoiseRows>& noise, LinearModel::Group& to) {
  const Eigen::Index first = to.rows.cols() - 1, more = trend.at[sample].cols();
  to.rows.conservativeResize(Eigen::NoChange, first + more + 1);
  to.rows.col(first + more) = to.rows.col(first);
  to.rows.middleCols(first, more).setZero();
  for (int i = 0; i < more; ++i) to.columns.push_back(shared + i);
  for (const NoiseRows& w : noise) {
    const auto axis = std::find(trend.axes.begin(), trend.axes.end(), w.joint);
    if (w.joint < 0 || axis == trend.axes.end()) continue;
    Eigen::Index own = 0;  // the error's unknown
    to.rows.row(w.first).head(to.private_size).cwiseAbs().maxCoeff(&own);
    to.rows.row(w.first).segment(first, more) =
        -to.rows(w.first, own) * trend.at[sample].row(axis - trend.axes.begin());
  }
}

/// The priors of shared unknowns, as the fit has them, else the reference ones.
void add_priors(const Recording& recording, const EstimationSetup& setup, const MatrixXd& rows,
                const GroupShape* shape, DataModel& to) {
  LinearModel& model = to.model;
  const auto n = static_cast<Eigen::Index>(to.columns.size());
  model.prior = MatrixXd::Zero(n, n);
  model.pull = VectorXd::Zero(n);
  model.width.resize(n);
  if (shape) {
    const auto m = static_cast<Eigen::Index>(shape->columns.size());
    const MatrixXd gram = rows.transpose() * rows;
    for (Eigen::Index i = 0; i < m; ++i) {
      model.pull(shape->columns[i]) += gram(i, m);
      for (Eigen::Index j = 0; j < m; ++j)
        model.prior(shape->columns[i], shape->columns[j]) += gram(i, j);
    }
    model.prior_cost = gram(m, m);
  }
  for (Eigen::Index i = 0; i < n; ++i) {
    const Component& c = to.columns[i];
    const auto stated = std::find_if(setup.priors.begin(), setup.priors.end(), [&](const Prior& p) {
      return p.parameter == c.parameter && p.component == c.index;
    });
    const bool open = stated == setup.priors.end();
    model.width(i) =
        open ? reference_width(recording.table, c, recording.table.initial) : stated->sigma;
    if (open) model.prior(i, i) += 1 / (model.width(i) * model.width(i));
  }
}

/// The data at a fit, with further components free.
DataModel data_model(const Recording& recording, const std::vector<int>& samples,
                     EstimationSetup setup, const Values& values,
                     const std::vector<Component>& further, const ReadingTrend* trend = nullptr) {
  for (const Component& c : further) merge(setup.free, {{c.parameter, {c.index}}});
  for (Freed& f : setup.free) std::sort(f.components.begin(), f.components.end());
  Estimation problem(recording, samples, setup);
  const VectorXd state = problem.pack(values);
  problem.renew(state);
  problem.prepare(state);
  DataModel out;
  out.columns = problem.columns();
  KindNumbers kinds;
  MatrixXd rows, priors;
  std::vector<NoiseRows> noise;
  const GroupShape* prior_shape = nullptr;
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const GroupShape& shape = problem.groups()[g];
    problem.noise_rows(static_cast<int>(g), state, rows, noise);
    if (static_cast<int>(g) == problem.prior_group())
      prior_shape = &shape, priors = rows;
    else
      out.model.groups.push_back(
          group_of(recording.rig.tree, shape, rows, noise, kinds, out.model));
    if (trend && static_cast<int>(g) != problem.prior_group())
      add_trend(*trend, problem.sample_of(static_cast<int>(g)), problem.shared_size(), noise,
                out.model.groups.back());
  }
  add_priors(recording, setup, priors, prior_shape, out);
  out.kinds = kinds.all();
  return out;
}

DataModel data_model(const Linearisation& at, const std::vector<Component>& further) {
  return data_model(*at.solution.recording, at.solution.training(), at.problem().setup(),
                    at.solution.values, further);
}

/// Returns data with unknowns of their own as one, with their kinds of noise shared.
DataModel side_by_side(std::vector<DataModel> parts) {
  KindNumbers kinds;
  Eigen::Index unknowns = 0;
  for (const DataModel& part : parts) {
    for (const NoiseKind& kind : part.kinds) kinds.of(kind);
    unknowns += part.model.width.size();
  }
  DataModel out;
  out.kinds = kinds.all();
  LinearModel& model = out.model;
  model.numbers = VectorXd::Zero(static_cast<Eigen::Index>(out.kinds.size()));
  model.prior = MatrixXd::Zero(unknowns, unknowns);
  model.pull.resize(unknowns);
  model.width.resize(unknowns);
  Eigen::Index first = 0;
  for (DataModel& part : parts) {
    const Eigen::Index n = part.model.width.size();
    model.prior.block(first, first, n, n) = part.model.prior;
    model.pull.segment(first, n) = part.model.pull;
    model.width.segment(first, n) = part.model.width;
    model.prior_cost += part.model.prior_cost;
    model.log_private_prior += part.model.log_private_prior;
    for (size_t k = 0; k < part.kinds.size(); ++k)
      model.numbers(kinds.of(part.kinds[k])) += part.model.numbers(static_cast<Eigen::Index>(k));
    for (LinearModel::Group& group : part.model.groups) {
      for (int& column : group.columns) column += static_cast<int>(first);
      for (int& kind : group.kind)
        if (kind >= 0) kind = kinds.of(part.kinds[kind]);
      model.groups.push_back(std::move(group));
    }
    out.columns.insert(out.columns.end(), part.columns.begin(), part.columns.end());
    first += n;
  }
  return out;
}

DataModel data_of(const std::vector<FittedData>& parts) {
  std::vector<DataModel> models;
  for (const FittedData& part : parts)
    models.push_back(data_model(part.recording, part.samples, part.setup, part.values, {}));
  return models.size() == 1 ? models.front() : side_by_side(std::move(models));
}

/// How much larger a covariance is than another, in the principal directions of one relative to the
/// other in which it is.
MatrixXd increase(const MatrixXd& from, const MatrixXd& to) {
  const VectorXd scale = from.diagonal().cwiseSqrt().cwiseInverse();
  const MatrixXd whiten =
      Cholesky(scale.asDiagonal() * from * scale.asDiagonal()).inverse_factor() *
      scale.asDiagonal();
  const SymmetricEigen e = symmetric_eigen(whiten * to * whiten.transpose());
  const VectorXd more = (e.values.array() - 1).cwiseMax(0).sqrt();
  return gram(more.asDiagonal() * (e.vectors.transpose() * whiten * from));
}

ModelEvidence evidence(const DataModel& data) {
  const LinearEvidence found = evidence(data.model);
  return {found.log, data.kinds, found.factor, data.model.numbers, found.fitted};
}

}  // namespace

double reference_width(const ParameterTable& table, const Component& component,
                       const VectorXd& values) {
  constexpr double kAnywhere = 1;  // m, rad
  const ParameterKind kind = table.all[component.parameter].kind;
  const bool placed = kind == ParameterKind::sensor_pose || kind == ParameterKind::target_pose;
  return placed ? kAnywhere : scales(table, component, values).usual;
}

ModelEvidence evidence(const Linearisation& at) { return evidence(data_model(at, {})); }

ModelEvidence evidence(const std::vector<FittedData>& parts) { return evidence(data_of(parts)); }

double log_evidence_at(const std::vector<FittedData>& parts, const ModelEvidence& noise) {
  const DataModel data = data_of(parts);
  VectorXd factor = VectorXd::Ones(data.model.numbers.size());
  for (size_t k = 0; k < data.kinds.size(); ++k)
    for (size_t i = 0; i < noise.kinds.size(); ++i)
      if (!(noise.kinds[i] < data.kinds[k]) && !(data.kinds[k] < noise.kinds[i]))
        factor(static_cast<Eigen::Index>(k)) = noise.factor(static_cast<Eigen::Index>(i));
  return log_evidence_at(data.model, factor);
}

std::vector<double> scores(const Linearisation& at,
                           const std::vector<std::vector<FreeDirection>>& groups) {
  const std::vector<Component>& fitted = at.problem().columns();
  std::vector<Component> further;
  for (const std::vector<FreeDirection>& group : groups)
    for (const FreeDirection& direction : group)
      for (const auto& moved : direction.moved) {
        if (std::count(fitted.begin(), fitted.end(), moved.first))
          throw std::invalid_argument("the fit frees " + at.solution.table().name(moved.first) +
                                      " already");
        further.push_back(moved.first);
      }
  const DataModel data = data_model(at, further);
  const auto all = static_cast<Eigen::Index>(data.columns.size());
  const auto column = [&](const Component& c) {
    return static_cast<int>(std::find(data.columns.begin(), data.columns.end(), c) -
                            data.columns.begin());
  };
  std::vector<int> kept;
  for (const Component& c : fitted) kept.push_back(column(c));
  const LinearEvidence without =
      evidence(with_unknowns(data.model, kept, MatrixXd(all, 0), VectorXd(0)));
  std::vector<double> out;
  for (const std::vector<FreeDirection>& group : groups) {
    const auto more = static_cast<Eigen::Index>(group.size());
    MatrixXd directions = MatrixXd::Zero(all, more);
    VectorXd width(more);
    for (Eigen::Index g = 0; g < more; ++g) {
      width(g) = group[g].width;
      for (const auto& [component, factor] : group[g].moved)
        directions(column(component), g) += factor;
    }
    const LinearEvidence with =
        evidence(with_unknowns(data.model, kept, directions, width), without.factor);
    out.push_back(with.log - without.log);
  }
  return out;
}

std::vector<WeighedTrend> weigh_trend(const Linearisation& at, const ReadingTrend& trend,
                                      const std::vector<VectorXd>& widths) {
  const DataModel plain = data_model(at, {});
  const LinearEvidence without = evidence(plain.model);
  const MatrixXd known = covariance_at(plain.model, without.factor);
  DataModel data = data_model(*at.solution.recording, at.solution.training(), at.problem().setup(),
                              at.solution.values, {}, &trend);
  const Eigen::Index n = plain.model.width.size(), more = widths.front().size(), all = n + more;
  LinearModel& model = data.model;
  model.prior.conservativeResizeLike(MatrixXd::Zero(all, all));
  model.pull.conservativeResizeLike(VectorXd::Zero(all));
  model.width.conservativeResize(all);
  VectorXd start = without.factor;
  std::vector<WeighedTrend> out;
  for (const VectorXd& width : widths) {
    model.width.tail(more) = width;
    model.prior.diagonal().tail(more) = width.cwiseAbs2().cwiseInverse();
    const LinearEvidence with = evidence(model, start);
    WeighedTrend& one = out.emplace_back();
    one.gain = with.log - without.log;
    const MatrixXd covariance = std::isfinite(one.gain) ? covariance_at(model, with.factor) : known;
    if (known.size() == 0 || covariance.rows() != all) {
      one.gain = std::numeric_limits<double>::quiet_NaN();
      continue;
    }
    start = with.factor;
    one.moved = with.step.head(n);
    one.wider = increase(known, covariance.topLeftCorner(n, n));
  }
  return out;
}

ModelProbabilities posterior(const std::vector<WeighedModel>& models) {
  double best = -std::numeric_limits<double>::infinity(), sum = 0;
  for (const WeighedModel& m : models) best = std::max(best, m.log_evidence + m.log_odds);
  ModelProbabilities out;
  for (const WeighedModel& m : models) {
    out.of_model.push_back(std::exp(m.log_evidence + m.log_odds - best));
    sum += out.of_model.back();
  }
  for (size_t i = 0; i < models.size(); ++i) {
    out.of_model[i] /= sum;
    out.of_kind[models[i].kind] += out.of_model[i];
  }
  return out;
}

}  // namespace kincal
