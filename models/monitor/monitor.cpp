#include "monitor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "../../solver/decompositions.h"
#include "../estimation/estimation.h"
#include "../fitting/fit.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/selection.h"
#include "moving_groups.h"
#include "state_bytes.h"

namespace kincal {
namespace {

using Eigen::Index;

constexpr double kLeastVariance = 1e-3;  // over the stated one: data without noise prove nothing
constexpr double kRounding = 1e-10;      // of derivatives, over the largest
// Of the inverse variance of an innovation, over that of the noise. What is expected to 30 sigmas
// or worse tells nothing of how a sensor fits.
constexpr double kUnexpected = 1e-3;

// Of a width: what a window leaves as uncertain as that it does not determine.
constexpr double kUndetermined = 0.5;

/// A NoiseOf is a part of a sensor's noise (SensorModel::noise_parts()); sensor -1: the readings of
/// a joint.
using NoiseOf = std::pair<int, int>;

/// Part of a sample's equations: rows of a sensor (or -1, priors of joint errors), over the private
/// unknowns, all columns, and the residual.
struct Equations {
  MatrixXd rows;              // [J_private J r]
  std::vector<NoiseOf> kind;  // by row
  int private_size = 0;
  std::map<NoiseOf, std::pair<double, double>> rest;  // chi2 and dof of the noise alone
};

/// Returns the rows without private unknowns, [J r]: Q' of those that these leave free.
MatrixXd without_privates(const MatrixXd& rows, int private_size) {
  if (private_size == 0) return rows;
  const Elimination privates(rows.leftCols(private_size));
  MatrixXd rest = rows.rightCols(rows.cols() - private_size);
  privates.rotate(rest);
  return rest.bottomRows(rows.rows() - privates.rank());
}

/// Returns the rows of an upper triangle with the same products, where there are more rows than
/// that: the last one then is what no column changes.
MatrixXd compressed(const MatrixXd& rows) {
  if (rows.rows() <= rows.cols()) return rows;
  return triangle_of(rows);
}

void check(const Rig& rig, const Sample& sample) {
  const auto fail = [](const std::string& what) { throw std::invalid_argument(what); };
  if (sample.readings.size() != rig.tree.joints.size())
    fail("readings: one for every joint of the rig is expected (NaN: not in the sample)");
  if (!sample.noise.empty() && sample.noise.size() != sample.readings.size())
    fail("noise: one for every joint of the rig is expected, or none");
  for (size_t v = 0; v < sample.views.size(); ++v) {
    const View& view = sample.views[v];
    const std::string where = "views[" + std::to_string(v) + "].";
    if (view.sensor < 0 || view.sensor >= static_cast<int>(rig.sensors.size()))
      fail(where + "sensor: the rig has no such sensor");
    if (view.target < 0 || view.target >= static_cast<int>(rig.targets.size()))
      fail(where + "target: the rig has no such target");
    for (const int id : view.ids)
      if (id < 0 || id >= rig.targets[view.target].count())
        fail(where + "ids: the target has no such point");
    const Sensor& sensor = rig.sensors[view.sensor];
    const Target& target = rig.targets[view.target];
    const auto points = static_cast<int>(view.ids.size());
    const size_t expected = static_cast<size_t>(sensor.model->blocks(points)) *
                            static_cast<size_t>(sensor.model->measurement_size());
    if (view.z.size() != expected)
      fail(where + "z: " + std::to_string(expected) + " numbers are expected");
    for (const double z : view.z)
      if (!std::isfinite(z)) fail(where + "z: a number is not finite");
    if (view.covariance.empty() && view.sigma.size() != static_cast<size_t>(sensor.model->sigmas()))
      fail(where + "sigma: " + std::to_string(sensor.model->sigmas()) + " numbers are expected");
    for (const double sigma : view.sigma)
      if (!(sigma > 0) || !std::isfinite(sigma)) fail(where + "sigma: it is positive");
    const int behind = target.link < 0 ? rig.base : target.link;
    for (const PathStep& step : find_path(rig.tree, sensor.link, behind)) {
      const int joint = driver(rig.tree, step.joint).joint;
      if (rig.tree.joints[joint].drives() && joint != sensor.scanning_joint &&
          !std::isfinite(sample.readings[joint]))
        fail("readings: '" + rig.tree.joints[joint].name + "' has none, which " + sensor.name +
             "'s view needs");
    }
  }
}

/// Returns the hash of what a monitor is made of. Numbers count in single precision: another
/// machine may read them with another last digit.
std::uint64_t hash_of(const ParameterTable& table, const CalibratedState& state,
                      const MonitorOptions& options) {
  std::uint64_t out = hash_bytes(nullptr, 0);
  const auto numbers = [&](const auto& matrix) {
    for (Index i = 0; i < matrix.size(); ++i) {
      const auto x = static_cast<float>(matrix.data()[i]);
      out = hash_bytes(&x, sizeof x, out);
    }
  };
  for (const Parameter& p : table.all) out = hash_bytes(p.name.data(), p.name.size() + 1, out);
  numbers(state.values);
  numbers(state.covariance);
  numbers(state.undetermined);
  return hash_bytes(&options.samples_between_alarms, sizeof options.samples_between_alarms, out);
}

}  // namespace

struct Monitor::Parts {
  /// A NoiseFactor is the root mean square of residuals.
  struct NoiseFactor {
    double squares = 0, residuals = 0;
    double variance() const { return std::max(kLeastVariance, (kNoiseKnown + squares) / known()); }
    double known() const { return kNoiseKnown + residuals; }
    void add(double chi2, double dof) {
      squares += chi2;
      residuals += dof;
    }
  };

  /// Pending are the equations of an outlier, which count if the next sample is one, too.
  struct Pending {
    MatrixXd rows;
    VectorXd right;
    long sample, residuals;
  };

  Recording base;  // without samples
  VectorXd values;
  EstimationSetup setup;
  std::vector<Component> columns;
  MatrixXd known;       // covariance of the columns after the calibration
  std::uint64_t owner;  // hash of the calibration and the options
  std::optional<DriftWatch> test;
  std::map<NoiseOf, NoiseFactor> noise;  // of the noise alone
  long samples = 0, outliers = 0;
  std::optional<Pending> pending;
  bool drifting = false;  // the sample before was one

  explicit Parts(CalibratedState state, const MonitorOptions& options);
  void transfer(StateBytes& bytes);
  bool equations(const Sample& sample, Equations& out, std::string& why) const;
  MatrixXd scaled(const Equations& of) const;
  /// What a sample says of each sensor and each kind of noise.
  struct Expected {
    std::vector<SensorInnovation> sensors;
    std::map<NoiseOf, NoiseFactor> noise;
  };
  Expected expected(const Equations& of, const MatrixXd& rows) const;
};

Monitor::Parts::Parts(CalibratedState state, const MonitorOptions& options)
    : base(std::move(state.rig), {}), values(state.values) {
  const ParameterTable& table = base.table;
  if (values.size() != table.initial.size())
    throw std::invalid_argument(
        "values: as many are expected as the rig's table of parameters has");
  const auto n = static_cast<Index>(state.columns.size());
  if (state.covariance.rows() != n || state.covariance.cols() != n)
    throw std::invalid_argument("covariance: a row and a column for every column is expected");
  for (const Component& c : state.columns)
    if (c.parameter < 0 || c.parameter >= static_cast<int>(table.all.size()))
      throw std::invalid_argument("columns: the rig has no such parameter");
  owner = hash_of(table, state, options);
  // Everything that was estimated or may move; poses as a whole.
  std::vector<std::pair<std::string, std::vector<Component>>> groups =
      moving_groups(base.rig, table, state.columns);
  const auto free = [&](const Component& c) {
    const Parameter& p = table.all[c.parameter];
    merge(setup.free, {p.pose ? whole(table, c.parameter) : Freed{c.parameter, {c.index}}});
  };
  for (const Component& c : state.columns) free(c);
  for (const auto& group : groups)
    for (const Component& c : group.second) free(c);
  setup.noise = NoiseMode::latent;
  setup.initial = values;
  for (size_t s = 0; s < base.rig.sensors.size(); ++s) setup.sensors.push_back(static_cast<int>(s));
  columns = components_of(setup.free);
  const auto place = [&](const Component& c) {
    return static_cast<Index>(std::find(columns.begin(), columns.end(), c) - columns.begin());
  };

  // How the estimated components move the columns.
  MatrixXd moves = MatrixXd::Zero(static_cast<Index>(columns.size()), n);
  VectorXd usual(n);
  for (Index i = 0; i < n; ++i) {
    const Component& c = state.columns[i];
    const double size = scales(table, c, values).usual;
    usual(i) = std::isfinite(size) ? size : 1;
    const auto chart = state.charts.find(c.parameter);
    if (chart == state.charts.end())
      moves(place(c), i) = 1;
    else
      moves.col(i).segment<6>(place({c.parameter, 0})) = chart->second.col(c.index);
  }
  known = state.covariance;
  for (Index k = 0; k < state.undetermined.cols(); ++k) {
    const VectorXd open = usual.cwiseProduct(state.undetermined.col(k));
    known += open * open.transpose();
  }
  std::vector<DriftGroup> drift;
  for (const auto& group : groups) {
    DriftGroup of{group.first, {}, VectorXd(static_cast<Index>(group.second.size()))};
    for (const Component& c : group.second) {
      const double size = scales(table, c, values).usual;
      of.width(static_cast<Index>(of.columns.size())) = std::isfinite(size) && size > 0 ? size : 1;
      of.columns.push_back(static_cast<int>(place(c)));
    }
    drift.push_back(std::move(of));
  }
  known = moves * known * moves.transpose();
  test.emplace(known, std::move(drift), options.samples_between_alarms,
               static_cast<int>(columns.size()) + 1);
}

/// Makes the equations of a sample; false, and why, where they are not defined.
bool Monitor::Parts::equations(const Sample& sample, Equations& out, std::string& why) const {
  Sample one = sample;
  one.train = true;
  const Recording recording = base.with_samples({std::move(one)});
  const std::vector<int> all = {0};
  EstimationSetup own = setup;  // the sample's own unknowns alone
  own.free.clear();
  Values start;
  start.shared = values;
  try {
    const Fit fitted = fit(recording, all, own, start);
    if (!fitted.defined()) {
      why = "a measured point cannot be seen from where it should be";
      return false;
    }
    start = fitted.values;
  } catch (const std::runtime_error& error) {
    why = error.what();
    return false;
  }
  Estimation problem(recording, all, setup);
  if (problem.empty()) return true;
  const VectorXd state = problem.pack(start);
  problem.renew(state);
  MatrixXd rows;
  std::vector<NoiseRows> kinds;
  if (!problem.noise_rows(0, state, rows, kinds)) {
    why = "a residual is not defined";
    return false;
  }
  const GroupShape& shape = problem.groups()[0];
  out.private_size = shape.private_size;
  const auto n = static_cast<Index>(columns.size());
  MatrixXd all_rows;
  const auto scans = [&](const NoiseRows& kind) {
    return kind.view && base.rig.sensors[kind.view->sensor].scanning_joint >= 0;
  };
  if (std::any_of(kinds.begin(), kinds.end(), scans)) problem.explicit_rows(0, state, all_rows);
  out.rows.setZero(rows.rows() + all_rows.rows(), shape.private_size + n + 1);
  Index used = 0;
  const auto take = [&](const auto& row, const NoiseOf& kind) {
    out.rows.row(used).head(shape.private_size) = row.head(shape.private_size);
    for (size_t c = 0; c < shape.columns.size(); ++c)
      out.rows(used, shape.private_size + shape.columns[c]) =
          row(shape.private_size + static_cast<Index>(c));
    out.rows(used, shape.private_size + n) = row(shape.size());
    out.kind.push_back(kind);
    ++used;
  };
  int residual = 0;  // of all rows: the first of this kind
  for (const NoiseRows& kind : kinds) {
    const NoiseOf of(kind.view ? kind.view->sensor : -1, kind.view ? kind.part : kind.joint);
    if (scans(kind)) {
      // Its derivatives are taken at what was measured: what distinguishes columns that are nearly
      // alike comes from the noise, and a triangle of them is not what no parameter changes.
      for (int i = residual; i < residual + kind.residuals; ++i)
        take(all_rows.row(i), {of.first, 0});
      residual += kind.residuals;
      continue;
    }
    residual += kind.residuals;
    const double largest =
        rows.block(kind.first, 0, kind.count, shape.size()).cwiseAbs().maxCoeff();
    int plain = 0;
    double squares = 0;
    for (int i = kind.first; i < kind.first + kind.count; ++i) {
      if (!kind.view ||
          rows.row(i).head(shape.size()).cwiseAbs().maxCoeff() > kRounding * largest) {
        take(rows.row(i), of);
        continue;
      }
      ++plain;
      squares += rows(i, shape.size()) * rows(i, shape.size());
    }
    if (plain > 0) {
      auto& alone = out.rest[of];
      alone.first += squares;
      alone.second += kind.residuals - (kind.count - plain);
    }
  }
  out.rows.conservativeResize(used, Eigen::NoChange);
  return true;
}

/// Returns the rows over their noise factors.
MatrixXd Monitor::Parts::scaled(const Equations& of) const {
  MatrixXd rows = of.rows;
  for (Index i = 0; i < rows.rows(); ++i) {
    const auto found = noise.find(of.kind[i]);
    if (found != noise.end()) rows.row(i) /= std::sqrt(found->second.variance());
  }
  return rows;
}

/// Compares every row with what all others let expect of it. S is the covariance of all rows, with
/// private unknowns N(0, 1): nothing is known of them in m and rad. With u = S^-1 r and H = S^-1,
/// rows s given the others have the covariance (H_ss)^-1 and the innovation (H_ss)^-1 u_s. Where
/// its variance is that of the private unknowns, nothing else tells of them. Row i is H_ii of a
/// residual of its kind of noise: if that noise has the variance 1 + c, u_i has H_ii + c H_ii^2.
Monitor::Parts::Expected Monitor::Parts::expected(const Equations& of, const MatrixXd& rows) const {
  const auto n = static_cast<Index>(columns.size());
  const auto j = rows.middleCols(of.private_size, n);
  const auto privates = rows.leftCols(of.private_size);
  std::vector<int> touched;
  for (Index c = 0; c < n; ++c)
    if ((j.col(c).array() != 0).any()) touched.push_back(static_cast<int>(c));
  const MatrixXd seen = j(Eigen::all, touched);
  MatrixXd s = seen * test->covariance()(touched, touched) * seen.transpose() +
               privates * privates.transpose();
  s.diagonal().array() += 1;
  const MatrixXd h = inverse_of_symmetric(s);
  const VectorXd u = h * (rows.col(of.private_size + n) + j * test->mean());
  Expected out;
  std::map<int, std::vector<int>> places;
  for (Index i = 0; i < rows.rows(); ++i) {
    const NoiseOf& kind = of.kind[i];
    if (kind.first >= 0) places[kind.first].push_back(static_cast<int>(i));
    const auto found = noise.find(kind);
    const double variance = found == noise.end() ? 1 : found->second.variance();
    const double share = h(i, i) * h(i, i);
    out.noise[kind].add(variance * (share + u(i) * u(i) - h(i, i)), share);
  }
  for (const auto& [kind, alone] : of.rest) out.noise[kind].add(alone.first, alone.second);
  for (const auto& [sensor, own] : places) {
    const SymmetricEigen inverse = symmetric_eigen(h(own, own));
    const VectorXd along = inverse.vectors.transpose() * u(own);
    SensorInnovation found;
    found.sensor = sensor;
    for (Index k = 0; k < along.size(); ++k) {
      if (!(inverse.values(k) > kUnexpected)) continue;
      found.chi2 += along(k) * along(k) / inverse.values(k);
      ++found.dof;
    }
    out.sensors.push_back(found);
  }
  return out;
}

Monitor::Monitor(CalibratedState state, const MonitorOptions& options)
    : parts_(std::make_unique<Parts>(std::move(state), options)) {}
Monitor::~Monitor() = default;
Monitor::Monitor(const Monitor& other) : parts_(std::make_unique<Parts>(*other.parts_)) {}
Monitor::Monitor(Monitor&&) noexcept = default;
Monitor& Monitor::operator=(Monitor&&) noexcept = default;

Innovation Monitor::add(const Sample& sample) {
  Parts& p = *parts_;
  check(p.base.rig, sample);
  Innovation out;
  Equations e;
  const bool defined = p.equations(sample, e, out.why);
  const long number = p.samples++;
  out.log_odds = p.test->log_statistic();
  out.alarm = p.test->alarm();
  if (!defined) {
    out.state = SampleState::undefined;
    return out;
  }
  const Index n = static_cast<Index>(p.columns.size());
  const MatrixXd scaled = p.scaled(e), all = without_privates(scaled, e.private_size);
  if (all.rows() == 0 && e.rest.empty()) {
    out.state = SampleState::tells_nothing;
    return out;
  }
  const MatrixXd rows = compressed(all);
  const MatrixXd j = rows.leftCols(n);
  const VectorXd y = -rows.col(n);
  const long residuals = all.rows();
  out.chi2 = p.test->look(j, y, residuals);
  out.dof = static_cast<double>(all.rows());
  Parts::Expected seen = p.expected(e, scaled);
  double least = 1;  // probability of what a sensor shows, where its noise is known as far as it is
  int tried = 0;
  for (SensorInnovation& sensor : seen.sensors) {
    double known = std::numeric_limits<double>::infinity();
    for (const auto& kind : seen.noise)
      if (kind.first.first == sensor.sensor) known = std::min(known, p.noise[kind.first].known());
    sensor.probability = sensor.dof > 0 ? f_tail(sensor.chi2 / sensor.dof, sensor.dof, known) : 1;
    int parts = 1;
    for (const auto& [kind, alone] : e.rest) {
      if (kind.first != sensor.sensor) continue;
      const double own = alone.first / p.noise[kind].variance();
      const double of_part = f_tail(own / alone.second, alone.second, p.noise[kind].known());
      sensor.probability = std::min(sensor.probability, of_part);
      ++parts;
      sensor.chi2 += own;
      sensor.dof += alone.second;
      out.chi2 += own;
      out.dof += alone.second;
    }
    least = std::min(least, sensor.probability);
    tried += parts;
    sensor.probability = std::min(1.0, parts * sensor.probability);
  }
  out.sensors = std::move(seen.sensors);
  out.probability = std::min(1.0, tried * least);

  if (out.probability < kOutlier) {
    out.state = SampleState::outlier;
    ++p.outliers;
    if (!p.pending && !p.drifting) {
      p.pending = {j, y, number, residuals};
    } else {
      if (p.pending) {
        p.test->look(p.pending->rows, p.pending->right, p.pending->residuals);
        p.test->take(false, p.pending->sample);
        p.test->look(j, y, residuals);
      }
      p.pending.reset();
      p.drifting = true;
      p.test->take(false, number);
      if (p.test->alarm()) {
        const Moved first = p.test->moved().front();
        out.unexplained = chi2_tail(first.chi2, static_cast<double>(first.residuals)) < kOutlier;
        if (out.unexplained) p.test->restart({});
      }
    }
  } else {
    p.pending.reset();
    p.drifting = false;
    // (While there is an alarm what has moved would count as noise.)
    if (!p.test->alarm())
      for (const auto& [kind, more] : seen.noise) p.noise[kind].add(more.squares, more.residuals);
    // With what it says of the noise itself: else the first samples of a noisier robot are a drift.
    const MatrixXd again = compressed(without_privates(p.scaled(e), e.private_size));
    p.test->look(again.leftCols(n), -again.col(n), residuals);
    p.test->take(true, number);
  }
  out.log_odds = p.test->log_statistic();
  out.alarm = p.test->alarm();
  return out;
}

std::vector<Moved> Monitor::moved() const { return parts_->test->moved(); }
void Monitor::restart(bool accept) {
  parts_->test->restart(accept ? parts_->test->moved() : std::vector<Moved>());
  parts_->pending.reset();
  parts_->drifting = false;
}
const std::vector<DriftGroup>& Monitor::groups() const { return parts_->test->groups(); }
const std::vector<Component>& Monitor::columns() const { return parts_->columns; }
const VectorXd& Monitor::difference() const { return parts_->test->mean(); }
const MatrixXd& Monitor::covariance() const { return parts_->test->covariance(); }
long Monitor::samples() const { return parts_->samples; }
long Monitor::outliers() const { return parts_->outliers; }
const ParameterTable& Monitor::table() const { return parts_->base.table; }
const Rig& Monitor::rig() const { return parts_->base.rig; }

std::vector<NoiseSeen> Monitor::noise() const {
  std::vector<NoiseSeen> out;
  for (const auto& [kind, seen] : parts_->noise)
    if (seen.residuals > 0)
      out.push_back({kind.first, kind.second, std::sqrt(seen.variance()), seen.residuals});
  return out;
}

void Monitor::Parts::transfer(StateBytes& bytes) {
  bytes.value(samples);
  bytes.value(outliers);
  bytes.value(drifting);
  bool waits = pending.has_value();
  bytes.value(waits);
  if (!bytes.writes()) pending = waits ? std::optional<Pending>(Pending()) : std::nullopt;
  if (pending) {
    bytes.value(pending->rows);
    bytes.value(pending->right);
    bytes.value(pending->sample);
    bytes.value(pending->residuals);
    if (pending->rows.cols() != static_cast<Index>(columns.size()) ||
        pending->rows.rows() > pending->rows.cols() + 1 ||
        pending->right.size() != pending->rows.rows())
      throw std::invalid_argument("state: it is damaged");
  }
  std::vector<std::pair<NoiseOf, NoiseFactor>> factors(noise.begin(), noise.end());
  bytes.list(factors, [&](std::pair<NoiseOf, NoiseFactor>& f) {
    bytes.value(f.first.first);
    bytes.value(f.first.second);
    bytes.value(f.second.squares);
    bytes.value(f.second.residuals);
  });
  noise = {factors.begin(), factors.end()};
  test->transfer(bytes);
}

Recalibration Monitor::recalibrated(const std::vector<Sample>& window,
                                    const std::vector<int>& groups, int iterations) const {
  const Parts& p = *parts_;
  if (iterations < 1) throw std::invalid_argument("iterations: at least 1 is expected");
  for (const int g : groups)
    if (g < 0 || g >= static_cast<int>(p.test->groups().size()))
      throw std::invalid_argument("groups: there is no such group");
  for (const Sample& sample : window) check(p.base.rig, sample);
  const auto n = static_cast<Index>(p.columns.size());
  MatrixXd prior = p.known;
  VectorXd width = VectorXd::Zero(n);
  for (const int g : groups) {
    const DriftGroup& group = p.test->groups()[g];
    for (size_t i = 0; i < group.columns.size(); ++i)
      width(group.columns[i]) = group.width(static_cast<Index>(i));
  }
  prior.diagonal() += width.cwiseAbs2();
  Parts now = p;  // linearises at the values so far
  VectorXd change = VectorXd::Zero(n);
  Recalibration out;
  std::vector<char> used(window.size(), 1);
  for (int i = 0; i < iterations; ++i) {
    std::vector<MatrixXd> all(window.size());
    std::vector<double> rows(window.size(), 0);
    MatrixXd information = MatrixXd::Zero(n, n);
    VectorXd pull = VectorXd::Zero(n);
    for (size_t k = 0; k < window.size(); ++k) {
      Equations e;
      std::string why;
      if (!now.equations(window[k], e, why)) continue;
      all[k] = without_privates(now.scaled(e), e.private_size);
      rows[k] = static_cast<double>(all[k].rows());
      all[k] = compressed(all[k]);
      if (!used[k]) continue;
      information.noalias() += all[k].leftCols(n).transpose() * all[k].leftCols(n);
      pull.noalias() -= all[k].leftCols(n).transpose() * all[k].col(n);
    }
    // The whole change is N(0, prior); this step is what of it is left.
    const MatrixXd covariance = Lu(MatrixXd::Identity(n, n) + prior * information).solve(prior);
    out.state.covariance = 0.5 * (covariance + covariance.transpose());
    const VectorXd step = covariance * (pull + information * change) - change;
    // Of samples that do not fit the better half counts all the same: where some are wrong, the
    // first iterations fit none.
    std::vector<double> misfit(window.size(), 0);  // over that of chance
    for (size_t k = 0; k < window.size(); ++k) {
      if (rows[k] == 0) continue;
      const double chi2 = (all[k].leftCols(n) * step + all[k].col(n)).squaredNorm();
      misfit[k] = chi2_tail(chi2, rows[k]) >= kOutlier ? 0 : chi2 / rows[k];
    }
    const double limit = median(misfit, 0);
    out.samples = 0;
    for (size_t k = 0; k < window.size(); ++k) {
      used[k] = misfit[k] <= limit;
      out.samples += rows[k] > 0 && misfit[k] == 0;
    }
    change += step;
    now.values = changed_values(p.base.table, p.values, p.columns, change);
  }
  out.change = change;
  out.state.rig = p.base.rig;
  out.state.values = now.values;
  out.state.columns = p.columns;
  // Of what was not opened the calibration says what is known.
  for (Index i = 0; i < n; ++i)
    out.undetermined.push_back(width(i) > 0 &&
                               std::sqrt(out.state.covariance(i, i)) > kUndetermined * width(i));
  return out;
}

std::string Monitor::save() const {
  StateBytes bytes(parts_->owner);
  parts_->transfer(bytes);
  return bytes.finish();
}

void Monitor::load(const std::string& from) {
  StateBytes bytes(from, parts_->owner);
  auto loaded = std::make_unique<Parts>(*parts_);
  loaded->transfer(bytes);
  bytes.expect_end();
  parts_ = std::move(loaded);
}

}  // namespace kincal
