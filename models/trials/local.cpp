#include "local.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>
#include <string>

#include "../../solver/decompositions.h"
#include "../calibration/calibration.h"
#include "../fitting/fit.h"
#include "../rig/configuration.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "../rig/selection.h"

namespace kincal {
namespace {

constexpr double kRank = 1e-9;                     // singular values, relative
constexpr double kGrowth = 1.3;                    // of bandwidths
constexpr double kClaim = 2, kSignificance = 3.5;  // standard errors of a gain; of the offsets
constexpr double kWidest = -1.5;  // of the widest prior, rad or m: logarithm to the base of 10

/// A sample near the posture: z = F delta + noise.
struct Near {
  int sample = -1;
  double distance = 0;
  MatrixXd f;
  VectorXd z;
  bool converged = true;  // the fit of its own unknowns
};

/// NaN: the sample lacks one of the joints.
double distance(const Rig& rig, const ParameterTable& table, const Sample& sample,
                const LocalPosture& posture) {
  const Configuration robot(rig, table, table.initial, sample.readings);
  double largest = 0;
  for (const auto& [joint, at] : posture) {
    double difference = robot.position(joint) - at;
    if (std::isnan(difference)) return kNan;
    if (rig.tree.joints[joint].type == JointType::continuous)
      difference = std::remainder(difference, 2 * kPi);
    largest = std::max(largest, std::abs(difference));
  }
  return largest;
}

/// Rows [F | z] of one sample with the given offsets of the table's parameters in place; no rows
/// where it cannot be evaluated.
void linearise(const Recording& recording, const std::vector<int>& joints, const VectorXd& offsets,
               NoiseMode noise, Near& near) {
  const ParameterTable& table = recording.table;
  const Eigen::Index p = offsets.size();
  near.f.resize(0, p);
  near.z.resize(0);
  EstimationSetup setup;
  setup.noise = noise;
  setup.sensors = indices(recording.rig.sensors.size());
  Values values;
  values.shared = table.initial;
  for (Eigen::Index j = 0; j < p; ++j)
    values.shared(table.all[table.joint_offset[joints[j]]].start) += offsets(j);
  FitOptions options;
  options.leave_out_undefined = true;
  const Fit alone = fit(recording, {near.sample}, setup, std::move(values), options);
  if (!alone.defined()) return;
  near.converged = alone.summary.outcome == Outcome::converged;
  for (int j : joints) setup.free.push_back({table.joint_offset[j], {0}});
  Estimation problem(recording, {near.sample}, setup);
  if (problem.groups().empty()) return;
  const VectorXd state = problem.pack(alone.values);
  problem.renew(state);
  problem.prepare(state);
  MatrixXd rows;
  if (!problem.square_root(0, state, 0, rows)) return;
  const GroupShape& shape = problem.groups()[0];
  const Eigen::Index k = shape.private_size, m = static_cast<Eigen::Index>(shape.columns.size());
  MatrixXd rest = rows.rightCols(m + 1);  // [F r] without the sample's own unknowns
  if (k > 0) {
    const Elimination own(rows.leftCols(k));
    own.rotate(rest);
    rest = rest.bottomRows(rest.rows() - own.rank()).eval();
  }
  if (rest.rows() == 0 || m == 0) return;
  MatrixXd f = MatrixXd::Zero(rest.rows(), p);
  for (Eigen::Index c = 0; c < m; ++c) {
    const int parameter = problem.columns()[shape.columns[c]].parameter;
    for (Eigen::Index j = 0; j < p; ++j)
      if (table.joint_offset[joints[j]] == parameter) f.col(j) = rest.col(c);
  }
  const VectorXd z = f * offsets - rest.col(m);
  const SingularValues svd = singular_values(f, Eigen::ComputeThinU | Eigen::ComputeThinV);
  Eigen::Index rank = 0;
  while (rank < svd.values.size() && svd.values(rank) > kRank * svd.values(0)) ++rank;
  near.f = svd.values.head(rank).asDiagonal() * svd.v.leftCols(rank).transpose();
  near.z = svd.u.leftCols(rank).transpose() * z;
  for (Eigen::Index j = 0; j < p; ++j)  // not to rounding: what it does not depend on
    if (f.col(j).isZero(0)) near.f.col(j).setZero();
}

double weight(double distance, double bandwidth) {
  const double x = distance / bandwidth;
  return x < 1 ? (1 - x * x) * (1 - x * x) : 0;
}

double chi2(const Near& n, const VectorXd& offsets) { return (n.z - n.f * offsets).squaredNorm(); }

/// The weighted sums of a bandwidth.
struct WeightedSums {
  MatrixXd w, b;    // sum w F'F, sum w^2 F'F
  VectorXd g;       // sum w F'z
  double rows = 0;  // sum w rows
};

WeightedSums sum(const std::vector<Near>& near, double bandwidth) {
  const Eigen::Index p = near[0].f.cols();
  WeightedSums out{MatrixXd::Zero(p, p), MatrixXd::Zero(p, p), VectorXd::Zero(p)};
  for (const Near& n : near) {
    const double w = weight(n.distance, bandwidth);
    if (w == 0) continue;
    const MatrixXd gram = n.f.transpose() * n.f;
    out.w += w * gram;
    out.b += w * w * gram;
    out.g += w * (n.f.transpose() * n.z);
    out.rows += w * static_cast<double>(n.z.size());
  }
  return out;
}

/// `ridge`: s^2 / t^2.
MatrixXd regular(const MatrixXd& w, double ridge) {
  return w + ridge * MatrixXd::Identity(w.rows(), w.cols());
}

VectorXd solve_without(const WeightedSums& sums, const Near& n, double bandwidth, double ridge) {
  const double w = weight(n.distance, bandwidth);
  return Cholesky(regular(sums.w - w * (n.f.transpose() * n.f), ridge))
      .solve(sums.g - w * (n.f.transpose() * n.z));
}

/// What is chosen for one bandwidth.
struct Choice {
  double bandwidth = 0, noise = 1, freedom = 0,
         prior = 0;  // h, s, the degrees of freedom s is from, t
  double ridge() const { return noise * noise / (prior * prior); }
};

/// Noise as seen, and the prior of the largest evidence.
Choice choose(const std::vector<Near>& near, const WeightedSums& sums, double bandwidth) {
  Choice out;
  out.bandwidth = bandwidth;
  const MatrixXd inverse = inverse_of_symmetric(regular(sums.w, std::pow(10, -2 * kWidest)));
  const VectorXd offsets = inverse * sums.g;
  double scatter = 0;
  for (const Near& n : near) scatter += weight(n.distance, bandwidth) * chi2(n, offsets);
  const MatrixXd share = inverse * sums.b;
  out.freedom = sums.rows - 2 * share.trace() + (inverse * sums.w * share).trace();
  if (out.freedom > 0) out.noise = std::sqrt(std::max(scatter / out.freedom, 1e-12));
  double best = -kInfinity;
  for (int step = 0; step < 8; ++step) {
    Choice tried = out;
    tried.prior = std::pow(10, kWidest - 0.5 * step);
    const Cholesky cholesky(regular(sums.w, tried.ridge()));
    const VectorXd diagonal = cholesky.diagonal();
    double determinant = 0;  // log |A t^2 / s^2|
    for (Eigen::Index i = 0; i < sums.g.size(); ++i)
      determinant += 2 * std::log(diagonal(i)) - std::log(tried.ridge());
    const double evidence =
        sums.g.dot(cholesky.solve(sums.g)) / (out.noise * out.noise) - determinant;
    if (evidence > best) best = evidence, out.prior = tried.prior;
  }
  return out;
}

/// The bandwidth with the least prediction error at the samples nearest to the posture.
Choice choose(const std::vector<Near>& near, double within) {
  const double smallest = std::max(0.01, 2 * near[kLocalSamples - 1].distance);
  double best = kInfinity;
  Choice out;
  for (double h = smallest; h == smallest || h < kGrowth * kGrowth * within; h *= kGrowth) {
    const WeightedSums sums = sum(near, h);
    const Choice choice = choose(near, sums, h);
    double error = 0;
    for (const Near& n : near) {
      const double w = weight(n.distance, smallest);
      if (w > 0) error += w * chi2(n, solve_without(sums, n, h, choice.ridge()));
    }
    if (error < best) best = error, out = choice;
  }
  return out;
}

/// Variances of the offsets from sample to sample, by joint.
VectorXd variation(const std::vector<Near>& near, const VectorXd& offsets, double bandwidth,
                   double noise) {
  const Eigen::Index p = offsets.size();
  const double precision = 1 / (noise * noise);
  VectorXd out = VectorXd::Zero(p);
  double total = 0;
  for (const Near& n : near) total += weight(n.distance, bandwidth);
  for (Eigen::Index j = 0; j < p; ++j) {  // as large as one sample's noise, to begin with
    double information = 0;
    for (const Near& n : near)
      information += weight(n.distance, bandwidth) * n.f.col(j).squaredNorm() * precision;
    out(j) = information > 0 ? total / information : 1;  // 1: unknown, and so without effect
  }
  for (int iteration = 0; iteration < 100; ++iteration) {
    VectorXd next = VectorXd::Zero(p);
    for (const Near& n : near) {
      const double w = weight(n.distance, bandwidth);
      if (w == 0) continue;
      MatrixXd a = precision * (n.f.transpose() * n.f);
      a.diagonal() += out.cwiseInverse();
      const MatrixXd covariance = inverse_of_symmetric(a);
      const VectorXd mean = precision * (covariance * (n.f.transpose() * (n.z - n.f * offsets)));
      next += w * (mean.cwiseAbs2() + covariance.diagonal());
    }
    out = (next / total).cwiseMax(1e-24);
  }
  return out;
}

/// Squared raw residuals of a sensor, readings exact.
struct Errors {
  double squared = 0, rotation = 0;
  long points = 0;
  bool converged = true;
};

/// Adds the errors of one sample at the rig's offsets plus `values`; false where they are not
/// defined.
bool add_errors(Rig rig, const Sample& sample, const std::vector<LocalOffset>& offsets,
                const VectorXd& values, std::map<std::string, Errors>& errors) {
  for (size_t j = 0; j < offsets.size(); ++j)
    rig.joints[offsets[j].joint].offset += values(static_cast<Eigen::Index>(j));
  Sample alone = sample;
  alone.train = true;
  bool defined = true;
  try {
    const Evaluation evaluation = evaluate(Recording(rig, {alone}), NoiseMode::none, {});
    for (const SensorResult& s : evaluation.sensors) {
      Errors& e = errors[s.name];
      e.converged = e.converged && evaluation.converged;
      const double n = static_cast<double>(s.train.points);
      e.squared += n * s.train.rms * s.train.rms;
      if (s.measures_pose) e.rotation += n * s.train.rotation * s.train.rotation;
      e.points += s.train.points;
    }
  } catch (const std::runtime_error&) {  // a point behind its camera
    defined = false;
  }
  return defined;
}

using ErrorsBySensor = std::map<std::string, Errors>;

/// The errors of samples within the radius.
struct LocalErrors {
  ErrorsBySensor of[2][2];              // training, held out; before, after
  std::set<std::string> not_converged;  // samples

  void add(const Rig& rig, const Sample& sample, const std::vector<LocalOffset>& offsets,
           const VectorXd& values) {
    ErrorsBySensor one[2];
    if (add_errors(rig, sample, offsets, VectorXd::Zero(values.size()), one[0]) &&
        add_errors(rig, sample, offsets, values, one[1]))
      for (int after : {0, 1})
        for (const auto& e : one[after]) {
          Errors& to = of[sample.train ? 0 : 1][after][e.first];
          to.squared += e.second.squared;
          to.rotation += e.second.rotation;
          to.points += e.second.points;
          if (!e.second.converged) not_converged.insert(sample.id);
        }
  }
  std::vector<SensorResult> by_sensor(const Rig& rig) {
    std::vector<SensorResult> out;
    for (const Sensor& sensor : rig.sensors) {
      SensorResult r;
      r.name = sensor.name;
      r.unit = sensor.model->unit();
      r.measures_pose = sensor.model->measures_pose();
      for (int split : {0, 1}) {
        SplitStatistics& s = split ? r.test : r.train;
        const Errors before = of[split][0][sensor.name], after = of[split][1][sensor.name];
        const auto rms = [&](double squared) {
          return before.points ? std::sqrt(squared / static_cast<double>(before.points)) : kNan;
        };
        s.points = before.points;
        s.rms_before = rms(before.squared);
        s.rms_as_read = rms(after.squared);
        s.rotation_before = rms(before.rotation);
        s.rotation_as_read = rms(after.rotation);
        s.rms = s.rotation = kNan;
      }
      if (r.train.points + r.test.points > 0) out.push_back(r);
    }
    return out;
  }
};

/// The training samples within the limit that depend on the joints, nearest first. `distances`: of
/// all that have the joints, ascending.
std::vector<Near> find_near(const Recording& recording, const LocalPosture& posture,
                            const std::vector<int>& joints, const LocalOptions& options,
                            std::vector<double>& distances) {
  const std::vector<Sample>& samples = recording.samples;
  std::vector<Near> near;
  for (size_t i = 0; i < samples.size(); ++i) {
    const double d = distance(recording.rig, recording.table, samples[i], posture);
    if (std::isnan(d) || !samples[i].train) continue;
    distances.push_back(d);
    if (d > options.within) continue;
    near.push_back({static_cast<int>(i), d, {}, {}});
    linearise(recording, joints, VectorXd::Zero(static_cast<Eigen::Index>(joints.size())),
              options.noise, near.back());
    if (near.back().z.size() == 0) near.pop_back();
  }
  std::sort(distances.begin(), distances.end());
  std::sort(near.begin(), near.end(), [&](const Near& a, const Near& b) {
    return a.distance != b.distance ? a.distance < b.distance
                                    : samples[a.sample].id < samples[b.sample].id;
  });
  return near;
}

/// Those of the joints that some sample near depends on.
std::vector<int> joints_with_effect(const std::vector<Near>& near, const std::vector<int>& joints) {
  std::vector<int> out;
  for (size_t j = 0; j < joints.size(); ++j)
    if (std::any_of(near.begin(), near.end(), [&](const Near& n) {
          return n.f.col(static_cast<Eigen::Index>(j)).norm() > 0;
        }))
      out.push_back(joints[j]);
  return out;
}

/// The offsets of all samples near, and what they were estimated with.
struct Estimate {
  VectorXd offsets;
  Choice choice;
  WeightedSums sums;
};

/// Linearises the samples near at the estimate, three times in all.
Estimate estimate_offsets(const Recording& recording, const std::vector<int>& joints,
                          const LocalOptions& options, std::vector<Near>& near) {
  Estimate out;
  out.offsets = VectorXd::Zero(static_cast<Eigen::Index>(joints.size()));
  size_t done = 0;
  for (int pass = 0; pass < 3; ++pass) {
    for (Near& n : near) {
      options.progress.share(static_cast<double>(done++), 3 * static_cast<double>(near.size()));
      linearise(recording, joints, out.offsets, options.noise, n);
    }
    out.choice = choose(near, options.within);
    out.sums = sum(near, out.choice.bandwidth);
    out.offsets = Cholesky(regular(out.sums.w, out.choice.ridge())).solve(out.sums.g);
  }
  return out;
}

/// What the samples near are predicted with: for each the offsets that it had no part in, and what
/// these gain there.
struct LeftOut {
  std::vector<VectorXd> offsets;
  std::vector<double> gains;  // of chi2

  /// Standard error of the sum of the first gains.
  double standard_error(int count) const {
    double mean = 0, squares = 0;
    for (int i = 0; i < count; ++i) mean += gains[i] / count;
    for (int i = 0; i < count; ++i) squares += (gains[i] - mean) * (gains[i] - mean);
    return std::sqrt(squares * count / (count - 1));
  }
};

/// Finds the radius, and whether there is a gain within it.
LeftOut judge_gain(const std::vector<Near>& near, const Estimate& estimate, double within,
                   LocalCalibration& out) {
  const Choice& choice = estimate.choice;
  const WeightedSums& sums = estimate.sums;
  LeftOut left_out;
  double total = 0, best = 0;
  for (size_t i = 0; i < near.size(); ++i) {
    left_out.offsets.push_back(solve_without(sums, near[i], choice.bandwidth, choice.ridge()));
    left_out.gains.push_back(near[i].z.squaredNorm() - chi2(near[i], left_out.offsets[i]));
    total += left_out.gains[i];
    const bool last_of_its_distance =
        i + 1 == near.size() || near[i + 1].distance > near[i].distance;
    if (last_of_its_distance && i + 1 >= kLocalSamples && total > best)
      best = total, out.samples = static_cast<int>(i) + 1;
  }
  long determined = 0;
  const VectorXd solved = shortest_least_squares(sums.b, sums.g, &determined);
  const double rank = static_cast<double>(determined);
  if (choice.freedom > 0)
    out.significance =
        f_deviate(sums.g.dot(solved) / rank / (choice.noise * choice.noise), rank, choice.freedom);
  out.gain = out.samples > 0 && out.significance > kSignificance &&
             best >= kClaim * left_out.standard_error(out.samples);
  if (out.gain) {
    out.radius = near[out.samples - 1].distance;
    out.ends = out.samples < out.near;
  } else {
    out.radius = std::min(out.bandwidth, within);
    out.samples = static_cast<int>(std::count_if(
        near.begin(), near.end(), [&](const Near& n) { return n.distance <= out.radius; }));
  }
  out.gain_sigma = left_out.standard_error(out.samples);
  return left_out;
}

/// Sets the offsets and their sigmas.
void set_offsets(const std::vector<Near>& near, const Estimate& estimate,
                 std::vector<LocalOffset>& offsets) {
  const Choice& choice = estimate.choice;
  const WeightedSums& sums = estimate.sums;
  const Eigen::Index p = estimate.offsets.size();
  const double s = choice.noise, s0 = std::min(1.0, s);
  const VectorXd varies = variation(near, estimate.offsets, choice.bandwidth, s0);
  MatrixXd middle = s0 * s0 * sums.b + regular(MatrixXd::Zero(p, p), s * s * choice.ridge());
  for (const Near& n : near) {
    const double w = weight(n.distance, choice.bandwidth);
    const MatrixXd gram = n.f.transpose() * n.f;
    middle += w * w * (gram * varies.asDiagonal() * gram);
  }
  const MatrixXd inverse = inverse_of_symmetric(regular(sums.w, choice.ridge())),
                 covariance = inverse * middle * inverse;
  for (Eigen::Index j = 0; j < p; ++j) {
    offsets[j].offset = estimate.offsets(j);
    offsets[j].sigma = std::sqrt(covariance(j, j) + varies(j));
    offsets[j].variation = std::sqrt(varies(j));
    offsets[j].determined = inverse(j, j) * choice.ridge() < 0.81;
  }
}

/// An offset that no sample within the bandwidth tells of is unknown: no number, not even 0.
void forget_unreached(const WeightedSums& sums, std::vector<LocalOffset>& offsets) {
  for (size_t j = 0; j < offsets.size(); ++j) {
    const auto place = static_cast<Eigen::Index>(j);
    if (sums.w(place, place) > 0) continue;
    offsets[j].offset = offsets[j].sigma = offsets[j].variation = kNan;
    offsets[j].determined = false;
  }
}

/// Sets chi2 and the errors within the radius, with the robot's readings as they are.
void set_errors(const Recording& recording, const LocalPosture& posture,
                const std::vector<Near>& near, const LeftOut& left_out, const VectorXd& offsets,
                LocalCalibration& out) {
  LocalErrors errors;
  for (int i = 0; i < out.samples; ++i) {
    out.chi2_before += near[i].z.squaredNorm();
    out.chi2 += chi2(near[i], left_out.offsets[i]);
    errors.add(recording.rig, recording.samples[near[i].sample], out.offsets, left_out.offsets[i]);
  }
  std::vector<std::pair<std::string, const Sample*>> held_out;
  for (const Sample& s : recording.samples)
    if (!s.train && distance(recording.rig, recording.table, s, posture) <= out.radius)
      held_out.push_back({s.id, &s});
  std::sort(held_out.begin(), held_out.end());
  for (const auto& s : held_out) errors.add(recording.rig, *s.second, out.offsets, offsets);
  for (const Near& n : near)
    if (!n.converged) errors.not_converged.insert(recording.samples[n.sample].id);
  out.not_converged.assign(errors.not_converged.begin(), errors.not_converged.end());
  out.sensors = errors.by_sensor(recording.rig);
}

/// The rig without steps, and with the poses that it leaves open estimated from all training
/// samples, everything else held. `names` gets those.
Rig with_open_poses(const Recording& given, NoiseMode noise, std::vector<std::string>& names) {
  Rig rig = given.rig;
  clear_steps(rig);
  const ParameterTable table(rig);
  Step step;
  step.name = "open poses";
  step.sensors = indices(rig.sensors.size());
  for (int p : open_poses(rig, table))
    for (const Sample& s : given.samples)
      if (s.train && std::any_of(s.views.begin(), s.views.end(), [&](const View& v) {
            return table.sensor_pose[v.sensor] == p || table.target_pose[v.target] == p;
          })) {
        step.free.push_back(table.all[p].name);
        break;
      }
  if (step.free.empty()) return rig;
  Rig with_step = rig;
  with_step.steps = {step};
  CalibrationOptions options;
  options.noise = noise;
  const Solution solution =
      calibrate(make_recording(given.with_rig(std::move(with_step))), options);
  if (!solution.usable())
    throw std::runtime_error("poses that the rig does not give cannot be estimated: " +
                             solution.message);
  names = step.free;
  for (const std::string& name : names) {
    const Parameter& p = table.all[table.select(name).at(0).parameter];
    const bool sensor = p.kind == ParameterKind::sensor_pose;
    (sensor ? rig.sensors[p.owner].link_T_sensor : rig.targets[p.owner].link_T_target) =
        solution.pose(name);
    (sensor ? rig.sensors[p.owner].pose_given : rig.targets[p.owner].pose_given) = true;
  }
  return rig;
}

}  // namespace

LocalPosture posture_of(const Rig& rig, const Sample& sample) {
  LocalPosture out;
  const ParameterTable table(rig);
  const Configuration robot(rig, table, table.initial, sample.readings);
  for (const View& v : sample.views)
    for (int j : needed_readings(rig, v.sensor, v.target))
      if (!std::isnan(sample.readings[j])) out[j] = robot.position(j);
  return out;
}

LocalCalibration calibrate_locally(const Rig& given, const std::vector<Sample>& samples,
                                   const LocalPosture& posture, const LocalOptions& options) {
  if (posture.empty()) throw std::invalid_argument("the posture has no joint");
  for (const auto& [joint, at] : posture)  // named again: no binding is captured in C++17
    if (std::none_of(samples.begin(), samples.end(),
                     [j = joint](const Sample& s) { return !std::isnan(s.readings[j]); }))
      throw std::invalid_argument("no sample has a reading of joint '" +
                                  given.tree.joints[joint].name + "'");
  LocalCalibration out;
  const Recording as_given(given, samples);
  const Recording recording = as_given.with_rig(with_open_poses(as_given, options.noise, out.open));
  std::vector<int> joints;
  for (const auto& at : posture) joints.push_back(at.first);

  std::vector<Near> near = find_near(recording, posture, joints, options, out.distances);
  out.near = static_cast<int>(near.size());
  out.enough = out.near >= kLocalSamples;
  if (!out.enough) return out;
  joints = joints_with_effect(near, joints);
  for (int j : joints) out.offsets.push_back({j, 0, kNan, kNan, false});

  const Estimate estimate = estimate_offsets(recording, joints, options, near);
  out.bandwidth = estimate.choice.bandwidth;
  out.prior = estimate.choice.prior;
  out.noise = estimate.choice.noise;
  const LeftOut left_out = judge_gain(near, estimate, options.within, out);
  if (out.gain) set_offsets(near, estimate, out.offsets);
  set_errors(recording, posture, near, left_out, estimate.offsets, out);
  forget_unreached(estimate.sums, out.offsets);
  return out;
}

}  // namespace kincal
