#include "monitor.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>
#include <utility>

#include "../estimation/estimation.h"
#include "../fitting/fit.h"
#include "../rig/distributions.h"
#include "../rig/scales.h"
#include "../rig/selection.h"

namespace kincal {
namespace {

using Eigen::Index;

// Residuals that the stated noise counts as: it is known to a quarter. Of simulated PR2 with 5 the
// first factors scatter so much that there were 6 false alarms where 2.6 were stated; of one with
// twice the noise there was none with 5 and one with 10, in 300 samples.
constexpr double kNoiseKnown = 10;
constexpr double kLeastVariance = 1e-3;  // over the stated one: data without noise prove nothing
constexpr double kOutlier = 1e-6;        // share of samples: a false outlier in a million
constexpr double kRounding = 1e-10;      // of derivatives, over the largest
// Of the inverse variance of an innovation, over that of the noise. What is expected to 30 sigmas
// or worse tells nothing of how a sensor fits.
constexpr double kUnexpected = 1e-3;

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
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(rows.leftCols(private_size));
  MatrixXd rest = rows.rightCols(rows.cols() - private_size);
  rest.applyOnTheLeft(qr.householderQ().adjoint());
  return rest.bottomRows(rows.rows() - qr.rank());
}

/// Returns the rows of an upper triangle with the same products, where there are more rows than
/// that: the last one then is what no column changes.
MatrixXd compressed(const MatrixXd& rows) {
  if (rows.rows() <= rows.cols()) return rows;
  const Eigen::HouseholderQR<MatrixXd> qr(rows);
  return qr.matrixQR().topRows(rows.cols()).triangularView<Eigen::Upper>();
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

/// The links whose joints can show in samples, and the groups of what can move.
class MovingGroups {
 public:
  MovingGroups(const Rig& rig, const ParameterTable& table, const std::vector<Component>& estimated)
      : rig_(rig), table_(table), estimated_(estimated) {}

  std::vector<std::pair<std::string, std::vector<Component>>> make() {
    for (size_t s = 0; s < rig_.sensors.size(); ++s) {
      if (alone_below_origin(static_cast<int>(s)))
        used_.insert(table_.sensor_mount[s]);  // the origin is its mount
      else
        add_parameter(table_.sensor_mount[s]);
      add_own(static_cast<int>(s));
      add_joints(rig_.sensors[s].link);
    }
    for (size_t t = 0; t < rig_.targets.size(); ++t) {
      if (rig_.targets[t].link < 0) continue;
      add_parameter(table_.target_mount[t]);
      add_joints(rig_.targets[t].link);
    }
    // Origins of joints are mounts where the calibration estimated them.
    for (const Component& c : estimated_)
      if (table_.all[c.parameter].kind == ParameterKind::joint_origin) add_parameter(c.parameter);
    for (const int j : joints_) add_parameter(table_.joint_offset[j]);
    return std::move(groups_);
  }

 private:
  bool estimated(int parameter) const {
    return std::any_of(estimated_.begin(), estimated_.end(),
                       [&](const Component& c) { return c.parameter == parameter; });
  }
  /// Returns the joint with an estimated origin that carries a link, with nothing that moves
  /// between; -1: none.
  int carrier(int link) const {
    for (int j = rig_.tree.joint_above[link]; j >= 0;
         j = rig_.tree.joint_above[rig_.tree.joints[j].parent]) {
      if (estimated(table_.joint_origin[j])) return j;
      if (!rig_.tree.joints[j].is_rigid()) break;
    }
    return -1;
  }
  bool alone_below_origin(int sensor) const {
    const int joint = carrier(rig_.sensors[sensor].link);
    if (joint < 0 || estimated(table_.sensor_mount[sensor])) return false;
    return std::count_if(rig_.sensors.begin(), rig_.sensors.end(),
                         [&](const Sensor& other) { return carrier(other.link) == joint; }) == 1;
  }
  void add_joints(int link) {
    for (const PathStep& step : find_path(rig_.tree, rig_.base, link)) {
      const int reading = driver(rig_.tree, step.joint).joint;
      if (table_.joint_offset[reading] >= 0 && !table_.all[table_.joint_offset[reading]].hidden())
        joints_.insert(reading);
    }
  }
  void add_parameter(int p) {
    if (p < 0 || table_.all[p].hidden() || !used_.insert(p).second) return;
    groups_.push_back({table_.all[p].name, components_of({whole(table_, p)})});
  }
  /// A lens is one group; every other block of a sensor's own numbers is one by itself.
  void add_own(int s) {
    std::vector<Component> lens;
    for (size_t b = 0; b < rig_.sensors[s].parameters.size(); ++b) {
      const int p = table_.sensor_block[s] + static_cast<int>(b);
      const ParameterKind kind = table_.all[p].kind;
      if (kind != ParameterKind::intrinsics && kind != ParameterKind::distortion) {
        add_parameter(p);
        continue;
      }
      for (const Component& c : components_of({whole(table_, p)})) lens.push_back(c);
      used_.insert(p);
    }
    if (!lens.empty())
      groups_.push_back({"sensor/" + rig_.sensors[s].name + "/intrinsics", std::move(lens)});
  }

  const Rig& rig_;
  const ParameterTable& table_;
  const std::vector<Component>& estimated_;
  std::set<int> joints_, used_;
  std::vector<std::pair<std::string, std::vector<Component>>> groups_;
};

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
    long sample;
  };

  Recording base;  // without samples
  VectorXd values;
  EstimationSetup setup;
  std::vector<Component> columns;
  std::unique_ptr<DriftWatch> test;
  std::map<NoiseOf, NoiseFactor> noise;  // of the noise alone
  long samples = 0, outliers = 0;
  std::optional<Pending> pending;
  bool drifting = false;  // the sample before was one

  explicit Parts(CalibratedState state, const MonitorOptions& options);
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
    : base(std::move(state.rig), {}), values(std::move(state.values)) {
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
  // Everything that was estimated or may move; poses as a whole.
  std::vector<std::pair<std::string, std::vector<Component>>> groups =
      MovingGroups(base.rig, table, state.columns).make();
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
  MatrixXd known = state.covariance;
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
  test = std::make_unique<DriftWatch>(moves * known * moves.transpose(), std::move(drift),
                                      options.samples_between_alarms,
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
  const MatrixXd h = Eigen::LLT<MatrixXd>(s).solve(MatrixXd::Identity(rows.rows(), rows.rows()));
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
    const Eigen::SelfAdjointEigenSolver<MatrixXd> inverse(h(own, own));
    const VectorXd along = inverse.eigenvectors().transpose() * u(own);
    SensorInnovation found;
    found.sensor = sensor;
    for (Index k = 0; k < along.size(); ++k) {
      if (!(inverse.eigenvalues()(k) > kUnexpected)) continue;
      found.chi2 += along(k) * along(k) / inverse.eigenvalues()(k);
      ++found.dof;
    }
    out.sensors.push_back(found);
  }
  return out;
}

Monitor::Monitor(CalibratedState state, const MonitorOptions& options)
    : parts_(std::make_unique<Parts>(std::move(state), options)) {}
Monitor::~Monitor() = default;
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
  out.chi2 = p.test->look(j, y);
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
      p.pending = {j, y, number};
    } else {
      if (p.pending) {
        p.test->look(p.pending->rows, p.pending->right);
        p.test->take(false, p.pending->sample);
        p.test->look(j, y);
      }
      p.pending.reset();
      p.drifting = true;
      p.test->take(false, number);
      if (p.test->alarm()) {
        const Moved first = p.test->moved().front();
        out.unexplained = chi2_tail(first.chi2, static_cast<double>(first.rows)) < kOutlier;
        if (out.unexplained) p.test->restart({});
      }
    }
  } else {
    p.pending.reset();
    p.drifting = false;
    for (const auto& [kind, more] : seen.noise) p.noise[kind].add(more.squares, more.residuals);
    // With what it says of the noise itself: else the first samples of a noisier robot are a drift.
    const MatrixXd again = compressed(without_privates(p.scaled(e), e.private_size));
    p.test->look(again.leftCols(n), -again.col(n));
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

}  // namespace kincal
