#include "monitor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "../../solver/decompositions.h"
#include "../../solver/kernels.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/selection.h"
#include "innovation.h"
#include "moving_groups.h"
#include "noise_factors.h"
#include "sample_form.h"
#include "state_bytes.h"

namespace kincal {
namespace {

using Eigen::Index;

constexpr double kRounding = 1e-10;  // of derivatives, over the largest

constexpr size_t kForms = 32;  // of samples, kept
// Of a width: what a window leaves as uncertain as that it does not determine.
constexpr double kUndetermined = 0.5;

/// `needed`: of needed_by_views(). `place` begins the messages.
void check(const Rig& rig, const std::vector<std::vector<int>>& needed, const Sample& sample,
           const std::string& place = "") {
  const auto fail = [&](const std::string& what) { throw std::invalid_argument(place + what); };
  if (sample.readings.size() != rig.tree.joints.size())
    fail("readings: one for every joint of the rig is expected (NaN: not in the sample)");
  if (!sample.noise.empty() && sample.noise.size() != sample.readings.size())
    fail("noise: one for every joint of the rig is expected, or none");
  for (size_t v = 0; v < sample.views.size(); ++v) {
    const View& view = sample.views[v];
    const auto fail_view = [&](const std::string& what) {
      fail("views[" + std::to_string(v) + "]." + what);
    };
    if (view.sensor < 0 || view.sensor >= static_cast<int>(rig.sensors.size()))
      fail_view("sensor: the rig has no such sensor");
    if (view.target < 0 || view.target >= static_cast<int>(rig.targets.size()))
      fail_view("target: the rig has no such target");
    for (const int id : view.ids)
      if (id < 0 || id >= rig.targets[view.target].count())
        fail_view("ids: the target has no such point");
    const Sensor& sensor = rig.sensors[view.sensor];
    const auto points = static_cast<int>(view.ids.size());
    const size_t expected = static_cast<size_t>(sensor.model->blocks(points)) *
                            static_cast<size_t>(sensor.model->measurement_size());
    if (view.z.size() != expected)
      fail_view("z: " + std::to_string(expected) + " numbers are expected");
    for (const double z : view.z)
      if (!std::isfinite(z)) fail_view("z: a number is not finite");
    if (view.covariance.empty() && view.sigma.size() != static_cast<size_t>(sensor.model->sigmas()))
      fail_view("sigma: " + std::to_string(sensor.model->sigmas()) + " numbers are expected");
    for (const double sigma : view.sigma)
      if (!(sigma > 0) || !std::isfinite(sigma)) fail_view("sigma: it is positive");
    const size_t pair =
        static_cast<size_t>(view.sensor) * rig.targets.size() + static_cast<size_t>(view.target);
    for (const int joint : needed[pair])
      if (!std::isfinite(sample.readings[joint]))
        fail("readings: '" + rig.tree.joints[joint].name + "' has none, which " + sensor.name +
             "'s view needs");
  }
}

/// Returns the joints that a view needs readings of, by sensor and target.
std::vector<std::vector<int>> needed_by_views(const Rig& rig) {
  std::vector<std::vector<int>> out;
  for (const Sensor& sensor : rig.sensors)
    for (const Target& target : rig.targets) {
      out.emplace_back();
      for (const PathStep& step :
           find_path(rig.tree, sensor.link, target.link < 0 ? rig.base : target.link)) {
        const int joint = driver(rig.tree, step.joint).joint;
        if (rig.tree.joints[joint].drives() && joint != sensor.scanning_joint)
          out.back().push_back(joint);
      }
    }
  return out;
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
  /// Pending are the equations of an outlier, which count if the next sample is one, too.
  struct Pending {
    bool waits = false;
    std::vector<int> columns;
    MatrixXd rows;  // in the top left corner
    VectorXd right;
    int count = 0;  // rows
    long sample = 0, residuals = 0;
  };

  /// Forms are those of the samples so far. A copy has none.
  struct Forms {
    std::vector<std::unique_ptr<SampleForm>> all;
    size_t next = 0;  // to be replaced

    Forms() = default;
    Forms(const Forms&) {}
  };

  Recording base;                        // without samples
  std::vector<std::vector<int>> needed;  // joints, by sensor and target
  VectorXd values;
  EstimationSetup setup;
  std::vector<Component> columns;
  MatrixXd known;       // covariance of the columns after the calibration
  std::uint64_t owner;  // hash of the calibration and the options
  std::optional<DriftWatch> test;
  NoiseFactors noise;
  long samples = 0, outliers = 0;
  Pending pending;
  bool drifting = false;  // the sample before was one
  Equations at_hand;
  Innovations innovations;
  // Of place_rows(): largest derivative of a row; runs of rows, those of `all_rows` behind the
  // rest.
  std::vector<double> largest;
  std::vector<std::pair<Index, Index>> taken;
  Forms forms;

  explicit Parts(CalibratedState state, const MonitorOptions& options);
  void transfer(StateBytes& bytes);
  void transfer_pending(StateBytes& bytes);
  SampleForm& form_of(const Sample& sample);
  bool equations(const Sample& sample, Equations& out, std::string& why);
  void place_rows(const std::vector<NoiseRows>& of, const MatrixXd& rows, const MatrixXd& all_rows,
                  Equations& out);
  void take_outlier(long number, long residuals, Innovation& out);
  void take_fitting(const Equations& e, const Innovation& seen, long number);
  bool scans(const NoiseRows& of) const {
    return of.view && base.rig.sensors[of.view->sensor].scanning_joint >= 0;
  }
  int kind_of(const NoiseRows& of) const {
    return of.view ? noise.kind_of(of.view->sensor, scans(of) ? 0 : of.part)
                   : noise.kind_of_joint(of.joint);
  }
};

Monitor::Parts::Parts(CalibratedState state, const MonitorOptions& options)
    : base(std::move(state.rig), {}),
      needed(needed_by_views(base.rig)),
      values(state.values),
      noise(base.rig) {
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
  Followed all = followed(base.rig, table, state.columns);
  setup.free = std::move(all.free);
  setup.noise = NoiseMode::latent;
  setup.initial = values;
  for (size_t s = 0; s < base.rig.sensors.size(); ++s) setup.sensors.push_back(static_cast<int>(s));
  columns = std::move(all.columns);
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
  for (const auto& group : all.groups) {
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
  pending.columns.reserve(columns.size());
  pending.rows.resize(static_cast<Index>(columns.size()) + 1, static_cast<Index>(columns.size()));
  pending.right.resize(static_cast<Index>(columns.size()) + 1);
}

/// Returns the form of a sample.
SampleForm& Monitor::Parts::form_of(const Sample& sample) {
  for (const auto& form : forms.all)
    if (form->fits(sample)) return *form;
  auto made = std::make_unique<SampleForm>(base, sample, setup, values);
  if (forms.all.size() < kForms) {
    forms.all.push_back(std::move(made));
    return *forms.all.back();
  }
  forms.next = (forms.next + 1) % kForms;
  return *(forms.all[forms.next] = std::move(made));
}

/// Makes the equations of a sample; false, and why, where they are not defined.
bool Monitor::Parts::equations(const Sample& sample, Equations& out, std::string& why) {
  out.count = out.private_size = 0;
  out.columns.clear();
  out.kind.clear();
  out.sensors.clear();
  out.rest.assign(noise.kinds(), {0, 0});
  SampleForm& form = form_of(sample);
  if (!form.linearise(sample, why)) return false;
  if (form.empty()) return true;
  const GroupShape& shape = form.shape();
  out.private_size = shape.private_size;
  out.columns.assign(shape.columns.begin(), shape.columns.end());
  place_rows(form.kinds(), form.rows(), form.explicit_rows(), out);
  return true;
}

/// Takes the rows that a parameter changes, sensor after sensor, joints last; the others are the
/// noise alone. Of scans all rows of `all_rows`: their derivatives are taken at what was measured,
/// what distinguishes columns that are nearly alike comes from the noise, and a triangle of them is
/// not what no parameter changes.
void Monitor::Parts::place_rows(const std::vector<NoiseRows>& of, const MatrixXd& rows,
                                const MatrixXd& all_rows, Equations& out) {
  const Index size = rows.cols(), count = rows.rows();
  out.stride = padded(static_cast<int>(count + all_rows.rows())) + kSlack;
  const size_t size_of = static_cast<size_t>(out.stride) * static_cast<size_t>(size);
  if (out.rows.size() < size_of) out.rows.resize(size_of);
  largest.assign(static_cast<size_t>(count), 0);
  Eigen::Map<VectorXd> derivative(largest.data(), count);
  for (Index c = 0; c + 1 < size; ++c) derivative = derivative.cwiseMax(rows.col(c).cwiseAbs());
  taken.clear();
  taken.reserve(static_cast<size_t>(count + all_rows.rows()));
  const auto take = [&](Index row, int kind) {
    if (taken.empty() || taken.back().first + taken.back().second != row || row == count)
      taken.push_back({row, 0});
    ++taken.back().second;
    out.kind.push_back(kind);
    ++out.count;
  };
  const int sensors = static_cast<int>(base.rig.sensors.size());
  for (int sensor = 0; sensor <= sensors; ++sensor) {
    const int first_row = out.count;
    int residual = 0;  // of all rows: the first of this kind
    for (const NoiseRows& one : of) {
      const int first_residual = residual;
      residual += one.residuals;
      if ((one.view ? one.view->sensor : sensors) != sensor) continue;
      const int kind = kind_of(one);
      if (scans(one)) {
        for (int i = first_residual; i < residual; ++i) take(count + i, kind);
        continue;
      }
      const double zero = kRounding * derivative.segment(one.first, one.count).maxCoeff();
      int plain = 0;
      double squares = 0;
      for (int i = one.first; i < one.first + one.count; ++i) {
        if (!one.view || derivative(i) > zero) {
          take(i, kind);
          continue;
        }
        ++plain;
        squares += rows(i, size - 1) * rows(i, size - 1);
      }
      if (plain == 0) continue;
      out.rest[kind].first += squares;
      out.rest[kind].second += one.residuals - (one.count - plain);
    }
    if (sensor < sensors && out.count > first_row)
      out.sensors.push_back({sensor, first_row, out.count - first_row});
  }
  for (Index c = 0; c < size; ++c) {
    double* to = out.rows.data() + c * out.stride;
    for (const auto& [first, size_of_run] : taken)
      to = std::copy_n(first < count ? &rows(first, c) : &all_rows(first - count, c), size_of_run,
                       to);
  }
}

Monitor::Monitor(CalibratedState state, const MonitorOptions& options)
    : parts_(std::make_unique<Parts>(std::move(state), options)) {}
Monitor::~Monitor() = default;
Monitor::Monitor(const Monitor& other) : parts_(std::make_unique<Parts>(*other.parts_)) {}
Monitor::Monitor(Monitor&&) noexcept = default;
Monitor& Monitor::operator=(Monitor&&) noexcept = default;

/// Takes the reduced equations of an outlier, or keeps them until the next sample.
void Monitor::Parts::take_outlier(long number, long residuals, Innovation& out) {
  const std::vector<int>& touched = at_hand.columns;
  const auto j = innovations.j();
  const auto y = innovations.y();
  if (!pending.waits && !drifting) {
    pending.waits = true;
    pending.columns.assign(touched.begin(), touched.end());
    pending.rows.topLeftCorner(j.rows(), j.cols()) = j;
    pending.right.head(y.size()) = y;
    pending.count = static_cast<int>(y.size());
    pending.sample = number;
    pending.residuals = residuals;
    return;
  }
  if (pending.waits) {
    test->look(
        pending.columns,
        pending.rows.topLeftCorner(pending.count, static_cast<Index>(pending.columns.size())),
        pending.right.head(pending.count), pending.residuals);
    test->take(false, pending.sample);
  }
  pending.waits = false;
  drifting = true;
  test->look(touched, j, y, residuals);
  test->take(false, number);
  if (!test->alarm()) return;
  const Moved first = test->moved().front();
  out.unexplained = chi2_tail(first.chi2, static_cast<double>(first.residuals)) < kOutlier;
  if (out.unexplained) test->restart({});
}

/// Takes a sample that fits, with the noise that it shows itself: else the first samples of a
/// noisier robot are a drift. (During an alarm what has moved would count as noise.)
void Monitor::Parts::take_fitting(const Equations& e, const Innovation& seen, long number) {
  pending.waits = false;
  drifting = false;
  if (!test->alarm()) noise.learn(innovations, seen);
  noise.find_own(seen);
  const long residuals = innovations.reduce(e, noise.own());
  test->look(e.columns, innovations.j(), innovations.y(), residuals);
  test->take(true, number);
}

void Monitor::prepare(const Sample& like) {
  Parts& p = *parts_;
  check(p.base.rig, p.needed, like);
  std::string why;
  if (!p.equations(like, p.at_hand, why)) return;
  p.noise.find_own(p.at_hand);
  p.innovations.expect(p.at_hand, p.noise.own(), *p.test);
  p.innovations.reduce(p.at_hand, p.noise.own());
}

Innovation Monitor::add(const Sample& sample) {
  Innovation out;
  add(sample, out);
  return out;
}

void Monitor::add(const Sample& sample, Innovation& out) {
  Parts& p = *parts_;
  check(p.base.rig, p.needed, sample);
  out.state = SampleState::fits;
  out.why.clear();
  out.chi2 = out.dof = 0;
  out.probability = 1;
  out.sensors.clear();
  out.unexplained = false;
  Equations& e = p.at_hand;
  const bool defined = p.equations(sample, e, out.why);
  const long number = p.samples++;
  out.log_odds = p.test->log_statistic();
  out.alarm = p.test->alarm();
  if (!defined) {
    out.state = SampleState::undefined;
    return;
  }
  p.noise.find_own(e);
  p.innovations.expect(e, p.noise.own(), *p.test);
  if (p.innovations.dof() == 0 && !e.has_rest()) {
    out.state = SampleState::tells_nothing;
    return;
  }
  p.noise.judge(e, p.innovations, out);
  if (out.probability < kOutlier) {
    out.state = SampleState::outlier;
    ++p.outliers;
    p.noise.find_own(out);
    p.take_outlier(number, p.innovations.reduce(e, p.noise.own()), out);
  } else {
    p.take_fitting(e, out, number);
  }
  out.log_odds = p.test->log_statistic();
  out.alarm = p.test->alarm();
}

std::vector<Moved> Monitor::moved() const { return parts_->test->moved(); }
void Monitor::restart(bool accept) {
  parts_->test->restart(accept ? parts_->test->moved() : std::vector<Moved>());
  parts_->pending.waits = false;
  parts_->drifting = false;
}
const std::vector<DriftGroup>& Monitor::groups() const { return parts_->test->groups(); }
const std::vector<Component>& Monitor::columns() const { return parts_->columns; }
const VectorXd& Monitor::difference() const { return parts_->test->mean(); }
MatrixXd Monitor::covariance() const { return parts_->test->covariance(); }
long Monitor::samples() const { return parts_->samples; }
long Monitor::outliers() const { return parts_->outliers; }
const ParameterTable& Monitor::table() const { return parts_->base.table; }
const Rig& Monitor::rig() const { return parts_->base.rig; }

std::vector<NoiseSeen> Monitor::noise() const { return parts_->noise.seen(); }

/// The rows have all columns in a file.
void Monitor::Parts::transfer_pending(StateBytes& bytes) {
  const auto damaged = [] { throw std::invalid_argument("state: it is damaged"); };
  const auto n = static_cast<Index>(columns.size());
  MatrixXd rows = MatrixXd::Zero(pending.count, n);
  for (size_t c = 0; bytes.writes() && c < pending.columns.size(); ++c)
    rows.col(pending.columns[c]) = pending.rows.col(static_cast<Index>(c)).head(pending.count);
  VectorXd right = pending.right.head(pending.count);
  bytes.value(rows);
  bytes.value(right);
  bytes.value(pending.sample);
  bytes.value(pending.residuals);
  if (bytes.writes()) return;
  if (rows.cols() != n || rows.rows() > n + 1 || right.size() != rows.rows()) damaged();
  pending.count = static_cast<int>(rows.rows());
  pending.columns.clear();
  for (Index c = 0; c < n; ++c) {
    if ((rows.col(c).array() == 0).all()) continue;
    pending.rows.col(static_cast<Index>(pending.columns.size())).head(pending.count) = rows.col(c);
    pending.columns.push_back(static_cast<int>(c));
  }
  pending.right.head(pending.count) = right;
}

void Monitor::Parts::transfer(StateBytes& bytes) {
  bytes.value(samples);
  bytes.value(outliers);
  bytes.value(drifting);
  bytes.value(pending.waits);
  if (pending.waits) transfer_pending(bytes);
  noise.transfer(bytes);
  test->transfer(bytes);
}

Recalibration Monitor::recalibrated(const std::vector<Sample>& window,
                                    const std::vector<int>& groups, int iterations) const {
  const Parts& p = *parts_;
  if (iterations < 1) throw std::invalid_argument("iterations: at least 1 is expected");
  for (const int g : groups)
    if (g < 0 || g >= static_cast<int>(p.test->groups().size()))
      throw std::invalid_argument("groups: there is no such group");
  for (size_t k = 0; k < window.size(); ++k)
    check(p.base.rig, p.needed, window[k], "samples[" + std::to_string(k) + "].");
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
    std::vector<double> rows(window.size(), 0), alone(window.size(), 0);
    MatrixXd information = MatrixXd::Zero(n, n);
    VectorXd pull = VectorXd::Zero(n);
    for (size_t k = 0; k < window.size(); ++k) {
      Equations e;
      std::string why;
      if (!now.equations(window[k], e, why)) continue;
      now.noise.find_own(e);
      alone[k] = now.noise.misfit(e);
      rows[k] = static_cast<double>(now.innovations.reduce(e, now.noise.own()));
      const auto j = now.innovations.j();
      all[k].setZero(j.rows(), n + 1);
      for (Index c = 0; c < j.cols(); ++c) all[k].col(e.columns[c]) = j.col(c);
      all[k].col(n) = -now.innovations.y();
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
      misfit[k] = std::max(alone[k], chi2_tail(chi2, rows[k]) >= kOutlier ? 0 : chi2 / rows[k]);
    }
    const double limit = median(misfit, 0);
    out.samples = 0;
    for (size_t k = 0; k < window.size(); ++k) {
      used[k] = misfit[k] <= limit;
      out.samples += rows[k] > 0 && misfit[k] == 0;
    }
    change += step;
    now.values = changed_values(p.base.table, p.values, p.columns, change);
    now.forms.all.clear();
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
