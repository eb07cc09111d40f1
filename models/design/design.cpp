#include "design.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>

#include "../../solver/decompositions.h"
#include "../../solver/observability.h"
#include "../estimation/estimation.h"
#include "../rig/configuration.h"
#include "../rig/scales.h"

namespace kincal {
namespace {

using Eigen::Index;

constexpr double kNoWeight = 1e-12;    // of the largest eigenvalue of W
constexpr double kLarge = 1e3;         // "however many": nobody records all candidates so often
constexpr double kIndependent = 1e-9;  // of a variance: uncorrelated, so that there is an inverse
constexpr double kNamedEntries = 0.2;  // entries of a direction over its largest
constexpr double kGain = 1e-3;         // an exchange that lowers the error by less is none
constexpr double kTenth = 0.9;  // of the error: more samples that lower it by less are not worth it
constexpr double kMostly = 0.7;  // of the error: half its square
constexpr int kExchanged = 300;  // candidates that an exchange looks at: the best before

/// L of W = L L', without what is nothing.
MatrixXd root_of(const MatrixXd& weight) {
  const SymmetricEigen eigen = symmetric_eigen(weight);
  const VectorXd& values = eigen.values;
  const double largest = values.size() > 0 ? values(values.size() - 1) : 0;
  Index kept = 0;
  while (kept < values.size() && values(values.size() - 1 - kept) > kNoWeight * largest) ++kept;
  return eigen.vectors.rightCols(kept) * values.tail(kept).cwiseSqrt().asDiagonal();
}

/// The covariance as postures are added, and what each would gain.
class Covariance {
 public:
  Covariance(const MatrixXd& information, const MatrixXd& root)
      : root_(root), c_(inverse_of_symmetric(information)) {
    through_ = c_ * root_;
  }
  double squared_error() const { return root_.cwiseProduct(through_).sum(); }
  double gain(const SampleRows& of) const {
    const MatrixXd some = c_(of.columns, of.columns);
    MatrixXd s = of.rows * some * of.rows.transpose();
    s.diagonal().array() += 1;
    MatrixXd moved = of.rows * through_(of.columns, Eigen::all);
    Eigen::LLT<Eigen::Ref<MatrixXd>> llt(s);
    llt.matrixL().solveInPlace(moved);
    return moved.squaredNorm();
  }
  void add(const SampleRows& of) {
    MatrixXd gain = of.rows * c_(of.columns, Eigen::all);
    MatrixXd s = gain(Eigen::all, of.columns) * of.rows.transpose();
    s.diagonal().array() += 1;
    Eigen::LLT<Eigen::Ref<MatrixXd>> llt(s);
    llt.matrixL().solveInPlace(gain);
    c_.noalias() -= gain.transpose() * gain;
    through_ = c_ * root_;
  }
  const MatrixXd& matrix() const { return c_; }

 private:
  const MatrixXd& root_;
  MatrixXd c_, through_;  // C, C L
};

/// Picks the best of `from`, at most `count`, in the order in which they help; takes them out of
/// `from`.
std::vector<int> pick(Covariance& covariance, const std::vector<SampleRows>& candidates, int count,
                      const std::function<bool(int)>& allowed, std::vector<int>& from,
                      const Progress& progress) {
  std::priority_queue<std::pair<double, int>> queue;
  for (const int i : from) queue.push({std::numeric_limits<double>::infinity(), -i});
  std::vector<int> out;
  while (static_cast<int>(out.size()) < count && !queue.empty()) {
    progress.share(static_cast<long>(out.size()), count);
    const int best = -queue.top().second;
    queue.pop();
    const double gain = covariance.gain(candidates[best]);
    if (!queue.empty() && gain < queue.top().first) {
      queue.push({gain, -best});
      continue;
    }
    const bool takes = gain > 0 && (!allowed || allowed(best));
    from.erase(std::find(from.begin(), from.end(), best));
    if (!takes) continue;
    covariance.add(candidates[best]);
    out.push_back(best);
  }
  return out;
}

/// Exchanges chosen postures for better ones; returns whether any was.
bool exchange(const MatrixXd& known, const std::vector<SampleRows>& candidates,
              const MatrixXd& root, const DesignOptions& options, std::vector<int>& chosen,
              std::vector<int>& others) {
  bool any = false;
  for (size_t k = 0; k < chosen.size(); ++k) {
    options.progress.share(static_cast<long>(k), static_cast<long>(chosen.size()));
    MatrixXd information = known;
    for (const int i : chosen)
      if (i != chosen[k]) add_information({candidates[i]}, information);
    const Covariance without(information, root);
    const double error = without.squared_error(), own = without.gain(candidates[chosen[k]]);
    double best = own + kGain * (error - own);
    int with = -1;
    for (size_t i = 0; i < others.size() && i < static_cast<size_t>(kExchanged); ++i) {
      const double gain = without.gain(candidates[others[i]]);
      if (gain <= best || (options.allowed && !options.allowed(others[i]))) continue;
      best = gain;
      with = static_cast<int>(i);
    }
    if (with < 0) continue;
    std::swap(chosen[k], others[with]);
    any = true;
  }
  return any;
}

/// The two frames' derivatives, and the positions of both in the base's axes.
MatrixXd relative(const MatrixXd& a, const MatrixXd& b, const Vector3d& from_a_to_b) {
  return b.topRows<3>() - a.topRows<3>() + skew(from_a_to_b) * a.bottomRows<3>();
}

/// Adds one posture of what frame a sees of frame b.
void add_sight(const CalibratedRobot& robot, const Frame& a, const Frame& b,
               const Readings& readings, DesignGoal& goal) {
  const auto derivative = [&](const Frame& f) {
    return frame_derivative(*robot.rig, *robot.table, robot.values, *robot.unknowns, f, readings);
  };
  const auto place = [&](const Frame& f) {
    return base_T_frame(*robot.rig, *robot.table, robot.values, f, readings).translation;
  };
  const FrameDerivative of_a = derivative(a), of_b = derivative(b);
  const Vector3d from_a_to_b = place(b) - place(a);
  const MatrixXd j = relative(of_a.by_unknowns, of_b.by_unknowns, from_a_to_b);
  goal.weight.noalias() += j.transpose() * j;
  const auto joints = static_cast<Index>(robot.rig->tree.joints.size());
  MatrixXd readings_a = MatrixXd::Zero(6, joints), readings_b = readings_a;
  for (size_t i = 0; i < of_a.joints.size(); ++i)
    readings_a.col(of_a.joints[i]) = of_a.by_readings.col(static_cast<Index>(i));
  for (size_t i = 0; i < of_b.joints.size(); ++i)
    readings_b.col(of_b.joints[i]) = of_b.by_readings.col(static_cast<Index>(i));
  goal.readings += relative(readings_a, readings_b, from_a_to_b).squaredNorm();
}

/// Whether it is worth to get from one error to another: `rest` are the squares that stay.
bool is_worth(double from, double to, double rest) {
  return to * to + rest < kTenth * kTenth * (from * from + rest);
}

Frame sensor_frame(const CalibratedRobot& robot, int sensor) {
  return {"", robot.rig->sensors[sensor].link, robot.table->sensor_pose[sensor]};
}

}  // namespace

DesignGoal frame_goal(const CalibratedRobot& robot, const Frame& frame,
                      const std::vector<Readings>& postures) {
  DesignGoal out{"frame/" + frame.name, "m", {}, 0};
  const auto n = static_cast<Index>(robot.unknowns->columns.size());
  out.weight.setZero(n, n);
  for (const Readings& readings : postures) {
    const FrameDerivative d =
        frame_derivative(*robot.rig, *robot.table, robot.values, *robot.unknowns, frame, readings);
    const MatrixXd j = d.by_unknowns.topRows<3>();
    out.weight.noalias() += j.transpose() * j;
    out.readings += d.by_readings.topRows(3).squaredNorm();
  }
  const auto count = static_cast<double>(std::max<size_t>(1, postures.size()));
  out.weight /= count;
  out.readings /= count;
  return out;
}

namespace {

/// sight_goal() with sums over views in place of means; adds the views to `count`.
DesignGoal sums_of_sights(const CalibratedRobot& robot, const std::vector<Sample>& samples,
                          long& count) {
  DesignGoal out{"targets relative to the sensors", "m", {}, 0};
  const auto n = static_cast<Index>(robot.unknowns->columns.size());
  out.weight.setZero(n, n);
  for (const Sample& sample : samples) {
    const Readings readings = completed(sample.readings);  // of a scanning joint there is none
    std::map<int, int> first;  // of a free target: the chain that holds it, or the first sensor
    for (const View& view : sample.views) {
      const auto found = first.emplace(view.target, view.sensor).first;
      if (robot.rig->sensors[view.sensor].model->measurement_kind() == MeasurementKind::chain)
        found->second = view.sensor;
    }
    for (const View& view : sample.views) {
      const Target& target = robot.rig->targets[view.target];
      Frame other{"", target.link, robot.table->target_pose[view.target]};
      if (target.link < 0) {
        if (first[view.target] == view.sensor) continue;
        other = sensor_frame(robot, first[view.target]);
      }
      add_sight(robot, sensor_frame(robot, view.sensor), other, readings, out);
      ++count;
    }
  }
  return out;
}

}  // namespace

DesignGoal sight_goal(const CalibratedRobot& robot, const std::vector<Sample>& samples) {
  long count = 0;
  DesignGoal out = sums_of_sights(robot, samples, count);
  out.weight /= static_cast<double>(std::max(1L, count));
  out.readings /= static_cast<double>(std::max(1L, count));
  return out;
}

DesignGoal component_goal(const CalibratedRobot& robot, const std::vector<Component>& components) {
  DesignGoal out{"parameters", "", {}, 0};
  const std::vector<Component>& columns = robot.unknowns->columns;
  const auto n = static_cast<Index>(columns.size());
  out.weight.setZero(n, n);
  for (Index i = 0; i < n; ++i) {
    if (std::find(components.begin(), components.end(), columns[i]) == components.end()) continue;
    const double yardstick = scales(*robot.table, columns[i], robot.values).yardstick;
    if (std::isfinite(yardstick) && yardstick > 0)
      out.weight(i, i) = 1 / (yardstick * yardstick * static_cast<double>(components.size()));
  }
  return out;
}

std::vector<SampleRows> sample_rows(const CalibratedRobot& robot, const EstimationSetup& setup,
                                    std::vector<Sample> samples,
                                    const std::map<std::pair<int, int>, Pose>& targets,
                                    const Progress& progress) {
  std::vector<SampleRows> out(samples.size());
  EstimationSetup own = setup;
  own.priors.clear();
  own.loss = {};
  own.initial = robot.values;
  for (Sample& s : samples) s.train = true;
  // Some together: all at once take much memory.
  for (size_t begin = 0; begin < samples.size(); begin += kLaidOutTogether) {
    progress.share(static_cast<long>(begin), static_cast<long>(samples.size()));
    const size_t end = std::min(begin + kLaidOutTogether, samples.size());
    const Recording recording(*robot.rig,
                              std::vector<Sample>(samples.begin() + begin, samples.begin() + end));
    std::vector<int> all(end - begin);
    for (size_t i = 0; i < all.size(); ++i) all[i] = static_cast<int>(i);
    Estimation problem(recording, all, own);
    if (problem.empty()) continue;
    Values values;
    values.shared = robot.values;
    for (auto it = targets.lower_bound({static_cast<int>(begin), -1});
         it != targets.end() && it->first.first < static_cast<int>(end); ++it)
      values.targets[{it->first.first - static_cast<int>(begin), it->first.second}] = it->second;
    const VectorXd state = problem.pack(values);
    problem.renew(state);
    problem.prepare(state);
    for (size_t g = 0; g < problem.groups().size(); ++g) {
      const int sample = problem.sample_of(static_cast<int>(g));
      if (sample < 0) continue;
      const MatrixXd rows = reduced_rows(problem, state, g);
      const std::vector<int>& columns = problem.groups()[g].columns;
      const auto touched = static_cast<Index>(columns.size());
      if (rows.cols() <= touched || !rows.allFinite()) continue;
      out[begin + static_cast<size_t>(sample)] = {columns, rows.leftCols(touched)};
    }
  }
  return out;
}

MatrixXd known_before(const CalibratedRobot& robot, const EstimationSetup& setup) {
  const std::vector<Component>& columns = robot.unknowns->columns;
  VectorXd out(static_cast<Index>(columns.size()));
  for (Index i = 0; i < out.size(); ++i) {
    double sigma = scales(*robot.table, columns[i], robot.values).usual;
    for (const Prior& prior : setup.priors)
      if (Component{prior.parameter, prior.component} == columns[i]) sigma = prior.sigma;
    out(i) = std::isfinite(sigma) && sigma > 0 ? 1 / (sigma * sigma) : 1;
  }
  return out.asDiagonal();
}

MatrixXd known_after(const CalibratedRobot& robot, const EstimationSetup& setup,
                     const Unknowns& calibration) {
  const std::vector<Component>&columns = robot.unknowns->columns, &known = calibration.columns;
  std::vector<Index> to, from;  // rows of H_0, and of the covariance
  for (size_t i = 0; i < columns.size(); ++i) {
    const Index row = std::find(known.begin(), known.end(), columns[i]) - known.begin();
    if (row == static_cast<Index>(known.size()) || !calibration.undetermined.row(row).isZero(0))
      continue;
    to.push_back(static_cast<Index>(i));
    from.push_back(row);
  }
  MatrixXd out = known_before(robot, setup);
  // (A prediction may know a combination exactly, as that of a zero and the pose that hides it.)
  MatrixXd covariance = calibration.covariance(from, from);
  covariance.diagonal() *= 1 + kIndependent;
  out(to, to) = inverse_of_symmetric(covariance);
  return out;
}

void add_information(const std::vector<SampleRows>& samples, MatrixXd& information) {
  for (const SampleRows& s : samples) {
    const MatrixXd square = s.rows.transpose() * s.rows;
    for (size_t a = 0; a < s.columns.size(); ++a)
      for (size_t b = 0; b < s.columns.size(); ++b)
        information(s.columns[a], s.columns[b]) +=
            square(static_cast<Index>(a), static_cast<Index>(b));
  }
}

Design choose_postures(const MatrixXd& known, const std::vector<SampleRows>& candidates,
                       const DesignGoal& goal, const DesignOptions& options) {
  const MatrixXd root = root_of(goal.weight);
  std::vector<int> others;
  for (size_t i = 0; i < candidates.size(); ++i)
    if (candidates[i].rows.rows() > 0) others.push_back(static_cast<int>(i));
  Covariance covariance(known, root);
  Design out;
  out.chosen = pick(covariance, candidates, options.count, options.allowed, others,
                    options.progress.in("choosing"));
  // The best of the others first.
  std::vector<std::pair<double, int>> gains;
  for (const int i : others) gains.push_back({-covariance.gain(candidates[i]), i});
  std::sort(gains.begin(), gains.end());
  for (size_t i = 0; i < others.size(); ++i) others[i] = gains[i].second;
  DesignOptions exchanging = options;
  exchanging.progress = options.progress.in("exchanging");
  for (int round = 0; round < options.exchanges; ++round)
    if (!exchange(known, candidates, root, exchanging, out.chosen, others)) break;
  // In the order in which they help.
  Covariance again(known, root);
  std::vector<int> from = out.chosen;
  std::sort(from.begin(), from.end());
  out.chosen = pick(again, candidates, static_cast<int>(from.size()), {}, from, {});
  out.errors = errors_of(known, candidates, goal, out.chosen);
  return out;
}

std::vector<double> errors_of(const MatrixXd& known, const std::vector<SampleRows>& candidates,
                              const DesignGoal& goal, const std::vector<int>& order) {
  const MatrixXd root = root_of(goal.weight);
  Covariance covariance(known, root);
  std::vector<double> out = {std::sqrt(std::max(0.0, covariance.squared_error()))};
  for (const int i : order) {
    covariance.add(candidates[i]);
    out.push_back(std::sqrt(std::max(0.0, covariance.squared_error())));
  }
  return out;
}

namespace {

/// The floor with the covariance that remains.
DesignFloor floor_with(const MatrixXd& c, const MatrixXd& known, const DesignGoal& goal) {
  DesignFloor out;
  const MatrixXd root = root_of(goal.weight);
  const SymmetricEigen eigen = symmetric_eigen(root.transpose() * c * root);
  if (eigen.values.size() == 0) return out;
  out.error = std::sqrt(std::max(0.0, eigen.values.sum()));
  const VectorXd direction = c * root * eigen.vectors.rightCols<1>();
  // In units of what is known before.
  const VectorXd scaled = direction.cwiseProduct(known.diagonal().cwiseSqrt());
  const double largest = scaled.cwiseAbs().maxCoeff();
  for (Index i = 0; i < direction.size(); ++i)
    if (std::abs(scaled(i)) > kNamedEntries * largest)
      out.direction.push_back({static_cast<int>(i), direction(i)});
  return out;
}

/// The covariance after `times` the data that it is from. The automatic path knows more about what
/// it holds than usual errors: with its C = T T', that is T (1 + (times - 1) T' N T)^-1 T', plus
/// what lasts.
MatrixXd covariance_after(double times, const Solution& solution, const DataEquations& data,
                          const MatrixXd& known) {
  if (!solution.prediction) return inverse_of_symmetric(known + times * data.normal);
  const auto n = data.normal.rows();
  const MatrixXd& lasting = solution.prediction->lasting;
  MatrixXd all = solution.prediction->covariance;
  if (lasting.size() > 0) all -= lasting;
  const auto rest = all.rows() - n;  // gauges, along which nothing moves relative to anything else
  MatrixXd now = all.topLeftCorner(n, n);
  if (rest > 0)
    now -= all.topRightCorner(n, rest) *
           solve_symmetric(all.bottomRightCorner(rest, rest), all.bottomLeftCorner(rest, n));
  const MatrixXd t = root_of_covariance(now);
  MatrixXd s = (times - 1) * (t.transpose() * data.normal * t);
  s.diagonal().array() += 1;
  MatrixXd out = t * solve_symmetric(s, t.transpose());
  if (lasting.size() > 0) out += lasting.topLeftCorner(n, n);
  return out;
}

/// A calibration fits its own samples better than others: with the rows R of one sample and the
/// covariance C of all, C without that sample is C + C R' (1 - R C R')^-1 R C (Woodbury).
class OwnInformation {
 public:
  /// Of these samples.
  OwnInformation(const Linearisation& at, const CalibratedRobot& robot,
                 const std::vector<int>& samples) {
    const std::vector<Component>& all = robot.unknowns->columns;
    const Estimation& problem = at.problem();
    for (const Component& c : problem.columns())
      columns_.push_back(static_cast<int>(std::find(all.begin(), all.end(), c) - all.begin()));
    const auto n = static_cast<Index>(columns_.size());
    normal_.setZero(n, n);
    MatrixXd scratch;
    for (size_t g = 0; g < problem.groups().size(); ++g) {
      if (static_cast<int>(g) == problem.prior_group()) continue;
      const std::vector<int>& touched = problem.groups()[g].columns;
      const MatrixXd& kept = at.reduced_rows(g, scratch);
      SampleRows rows{touched, kept.leftCols(static_cast<Index>(touched.size()))};
      add_information({rows}, normal_);
      if (std::count(samples.begin(), samples.end(), problem.sample_of(static_cast<int>(g))) == 0)
        continue;
      const Sample& sample = at.solution.samples()[problem.sample_of(static_cast<int>(g))];
      const long before = views_;
      DesignGoal goal = sums_of_sights(robot, {sample}, views_);
      if (views_ == before) continue;
      samples_.push_back({std::move(rows), goal.weight(columns_, columns_)});
    }
  }
  /// Returns by how much (m^2) the mean square error at the samples grows without their own
  /// information, with `times` the data.
  double hides(double times, const MatrixXd& known) const {
    const MatrixXd c = inverse_of_symmetric(known(columns_, columns_) + times * normal_);
    double out = 0;
    for (const OneSample& s : samples_) {
      const MatrixXd seen = s.rows.rows * c(s.rows.columns, Eigen::all);
      MatrixXd left = -seen(Eigen::all, s.rows.columns) * s.rows.rows.transpose();
      left.diagonal().array() += 1;
      out += solve_symmetric(left, seen * s.weight * seen.transpose()).trace();
    }
    return out / static_cast<double>(std::max(1L, views_));
  }

 private:
  struct OneSample {
    SampleRows rows;
    MatrixXd weight;  // sum of J'J over its views
  };
  std::vector<int> columns_;  // of the problem, among all
  MatrixXd normal_;
  std::vector<OneSample> samples_;
  long views_ = 0;
};

}  // namespace

DesignFloor floor_of(const MatrixXd& known, const MatrixXd& data, const DesignGoal& goal) {
  return floor_with(inverse_of_symmetric(known + kLarge * data), known, goal);
}

int enough_postures(const std::vector<double>& errors, double floor, const DesignGoal& goal) {
  for (size_t n = 1; n < errors.size(); ++n) {
    const double rest = floor * floor + goal.readings,
                 own = std::max(0.0, errors[n] * errors[n] - floor * floor);
    if (!is_worth(std::sqrt(own), std::sqrt(own / 3), rest)) return static_cast<int>(n);
  }
  return -1;
}

std::optional<MoreData> more_data(const Linearisation& at, const DataEquations& data) {
  constexpr size_t kSamples =
      20;  // that the mean is taken over: 100 would take 3 % of a calibration
  const Solution& solution = at.solution;
  Unknowns unknowns;
  unknowns.columns = data.columns;
  const CalibratedRobot robot{&solution.rig(), &solution.table(), solution.values.shared, unknowns};
  const std::vector<int> training = solution.training();
  std::vector<int> some;
  std::vector<Sample> samples;
  for (size_t i = 0; i < std::min(kSamples, training.size()); ++i) {
    some.push_back(training[i * training.size() / std::min(kSamples, training.size())]);
    samples.push_back(solution.samples()[some.back()]);
  }
  const DesignGoal goal = sight_goal(robot, samples);
  if (!goal.weight.allFinite() || goal.weight.isZero(0)) return std::nullopt;
  const MatrixXd known = known_before(robot, solution.setup), root = root_of(goal.weight);
  const OwnInformation own(at, robot, some);
  const auto error = [&](double times) {
    const MatrixXd c = covariance_after(times, solution, data, known);
    return std::sqrt(std::max(0.0, root.cwiseProduct(c * root).sum() + own.hides(times, known)));
  };
  MoreData out;
  out.now = error(1);
  out.thrice = error(3);
  out.readings = std::sqrt(goal.readings);
  out.worth = is_worth(out.now, out.thrice, goal.readings);
  const DesignFloor floor =
      floor_with(covariance_after(kLarge, solution, data, known), known, goal);
  if (!out.worth && floor.error > kMostly * std::hypot(out.now, out.readings))
    for (const auto& [column, coefficient] : floor.direction)
      out.open.push_back(robot.table->name(data.columns[column]));
  return out;
}

}  // namespace kincal
