#include "trends.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "../../kinematics/floating.h"
#include "../../solver/decompositions.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "noise_levels.h"

namespace kincal {
namespace {

constexpr double kByNoChance = 4;   // standard deviations
constexpr double kGoodPart = 0.25;  // share of the scatter
constexpr double kJump = 4.8;       // standard deviations, the largest of many
constexpr double kMost = 0.35;      // share of the scatter
constexpr double kSame = 1e-6;      // of columns that depend on each other
constexpr long kLeft = 8;           // samples more than columns and errors

/// The errors of one joint (of a floating one six), by training sample.
struct JointErrors {
  std::vector<int> axes;     // one or six joints
  std::vector<int> samples;  // that have all of them
  MatrixXd values;           // a row a sample
};

std::map<int, JointErrors> errors_by_joint(const Solution& solution) {
  const Tree& tree = solution.rig().tree;
  std::map<int, std::set<int>> axes, samples;  // by joint that has the reading
  std::vector<int> reads(tree.joints.size(), -1);
  for (const auto& e : solution.values.errors) {
    if (!solution.samples()[e.first.first].train) continue;
    int& joint = reads[e.first.second];
    if (joint < 0) joint = tree.find_joint(read_name(tree, e.first.second));
    axes[joint].insert(e.first.second);
    samples[joint].insert(e.first.first);
  }
  std::map<int, JointErrors> out;
  for (const auto& [joint, of] : axes) {
    JointErrors& one = out[joint];
    one.axes.assign(of.begin(), of.end());
    for (const int s : samples[joint])
      if (std::all_of(of.begin(), of.end(), [&, s = s](int axis) {
            return solution.values.errors.count({s, axis}) > 0;
          }))
        one.samples.push_back(s);
    one.values.resize(static_cast<long>(one.samples.size()), static_cast<long>(of.size()));
    for (long r = 0; r < one.values.rows(); ++r)
      for (long c = 0; c < one.values.cols(); ++c)
        one.values(r, c) = solution.values.errors.at(
            {one.samples[static_cast<size_t>(r)], one.axes[static_cast<size_t>(c)]});
  }
  return out;
}

/// Whether the data show a joint's errors: estimates that are small beside their sigma are what the
/// prior leaves of the noise of sensors.
bool shows(const Rig& rig, const JointErrors& errors) {
  for (size_t c = 0; c < errors.axes.size(); ++c) {
    const double sigma = rig.joints[errors.axes[c]].sigma;
    if (errors.values.col(static_cast<long>(c)).squaredNorm() >
        kLeastShare * sigma * sigma * static_cast<double>(errors.values.rows()))
      return true;
  }
  return false;
}

/// Whether the robot cannot have moved in between: readings that errors of their own would have
/// driven further apart.
bool stands_still(const Rig& rig, const Sample& a, const Sample& b) {
  constexpr double kOfSigma = 0.5;
  for (size_t j = 0; j < a.readings.size(); ++j) {
    const double x = a.readings[j], y = b.readings[j];
    if (std::isnan(x) != std::isnan(y) || std::abs(x - y) > kOfSigma * rig.joints[j].sigma)
      return false;
  }
  return true;
}

/// The same with a row for each run of samples between which the robot stood still, of the mean of
/// their errors.
JointErrors standing_still_once(const Solution& solution, const JointErrors& errors) {
  const std::vector<Sample>& samples = solution.samples();
  JointErrors out;
  out.axes = errors.axes;
  out.values.resize(errors.values.rows(), errors.values.cols());
  double run = 0;
  for (size_t r = 0; r < errors.samples.size(); ++r) {
    const auto last = static_cast<Eigen::Index>(out.samples.size()) - 1;
    if (r == 0 ||
        !stands_still(solution.rig(), samples[errors.samples[r]], samples[errors.samples[r - 1]])) {
      out.values.row(last + 1) = errors.values.row(static_cast<Eigen::Index>(r));
      out.samples.push_back(errors.samples[r]);
      run = 1;
    } else {
      out.values.row(last) +=
          (errors.values.row(static_cast<Eigen::Index>(r)) - out.values.row(last)) / ++run;
    }
  }
  out.values.conservativeResize(static_cast<Eigen::Index>(out.samples.size()), Eigen::NoChange);
  return out;
}

/// Where a joint stands in these samples: the columns of the regression.
MatrixXd standing(const Solution& solution, int joint, const JointErrors& errors) {
  const Tree& tree = solution.rig().tree;
  const auto n = static_cast<long>(errors.samples.size());
  const auto readings = [&](long row) -> const std::vector<double>& {
    return solution.samples()[errors.samples[static_cast<size_t>(row)]].readings;
  };
  if (tree.joints[joint].type != JointType::floating) {
    const bool slides = tree.joints[joint].type == JointType::prismatic;
    MatrixXd out = MatrixXd::Ones(n, slides ? 3 : 4);
    for (long row = 0; row < n; ++row) {
      const double q = readings(row)[joint];
      out(row, 1) = q;
      out(row, 2) = slides ? q * q : std::sin(q);
      if (!slides) out(row, 3) = std::cos(q);
    }
    return out;
  }
  const bool few = n < 13 + 6 + kLeft;
  MatrixXd out = MatrixXd::Ones(n, few ? 7 : 13);
  for (long row = 0; row < n; ++row) {
    const Pose pose = pose_reading(tree, joint, readings(row));
    if (few) {
      const Pose first = pose_reading(tree, joint, readings(0));
      out.row(row).tail(6) = log_se3(inverse(first) * pose).transpose();
      continue;
    }
    for (int axis = 0; axis < 3; ++axis)
      out.row(row).segment(1 + 3 * axis, 3) = pose.rotation.col(axis).transpose();
    out.row(row).tail(3) = pose.translation.transpose();
  }
  return out;
}

/// The logarithm of the determinant of a positive semi-definite matrix, of which nothing is zero.
double log_determinant(const MatrixXd& scatter) {
  double out = 0;
  for (const double value : symmetric_eigen(scatter).values)
    out += std::log(std::max(value, 1e-12));
  return out;
}

/// How far neighbours agree in the residuals of a regression.
struct Neighbours {
  double clear = 0;  // standard deviations beyond the expected value
  double share = 0;  // of the scatter that is left
};

/// `left` are the rest of errors, u the regression's orthonormal columns; both in the order of
/// readings.
Neighbours agreement(const VectorXd& left, const MatrixXd& u) {
  const auto beside = [](const MatrixXd& a) {  // S a
    MatrixXd out = MatrixXd::Zero(a.rows(), a.cols());
    out.topRows(a.rows() - 1) += a.bottomRows(a.rows() - 1) / 2;
    out.bottomRows(a.rows() - 1) += a.topRows(a.rows() - 1) / 2;
    return out;
  };
  const auto n = static_cast<double>(left.size()), m = n - static_cast<double>(u.cols());
  const MatrixXd su = beside(u), usu = u.transpose() * su;
  const double trace = -usu.trace(),
               squares = (n - 1) / 2 - 2 * su.squaredNorm() + usu.squaredNorm(), mean = trace / m,
               variance = 2 * (squares - trace * trace / m) / (m * (m + 2)),
               r = left.dot(VectorXd(beside(left))) / left.squaredNorm();
  if (!(variance > 0) || !(r > mean)) return {};
  return {(r - mean) / std::sqrt(variance), std::min(1.0, r - mean)};
}

/// The rows of a matrix in another order.
MatrixXd in_order(const MatrixXd& rows, const std::vector<int>& order) {
  MatrixXd out(rows.rows(), rows.cols());
  for (size_t r = 0; r < order.size(); ++r)
    out.row(static_cast<Eigen::Index>(r)) = rows.row(order[r]);
  return out;
}

/// The trend of errors with these columns; `clear` is 0 where there are too few samples to tell.
Trend trend_of(const Tree& tree, int joint, const JointErrors& errors, const MatrixXd& columns) {
  Trend out{joint, 0};
  const auto n = static_cast<double>(errors.values.rows()),
             p = static_cast<double>(errors.values.cols());
  if (columns.rows() < columns.cols() + errors.values.cols() + kLeft || !columns.allFinite())
    return out;
  const SingularValues basis = singular_values(columns, Eigen::ComputeThinU);
  const long rank = (basis.values.array() > kSame * basis.values(0)).count();
  const auto k = static_cast<double>(rank - 1);
  MatrixXd scatter = errors.values.rowwise() - errors.values.colwise().mean();
  const Eigen::RowVectorXd sizes = scatter.colwise().norm();
  if (rank < 2 || !(sizes.minCoeff() > 0)) return out;
  scatter.array().rowwise() /= sizes.array();  // each error counts alike
  const MatrixXd u = basis.u.leftCols(rank), left = scatter - u * (u.transpose() * scatter);
  Neighbours neighbours;
  if (errors.axes.size() == 1) {
    std::vector<int> order = indices(static_cast<size_t>(columns.rows()));
    std::stable_sort(order.begin(), order.end(),
                     [&](int a, int b) { return columns(a, 1) < columns(b, 1); });
    neighbours = agreement(in_order(left, order), in_order(u, order));
  }
  const double m = p * k + (errors.axes.size() == 1 ? 1 : 0),
               chi2 = neighbours.clear * neighbours.clear -
                      (n - 1 - (p + k + 1) / 2) * (log_determinant(left.transpose() * left) -
                                                   log_determinant(scatter.transpose() * scatter));
  out.clear = chi2_deviate(chi2, m);
  for (long c = 0; c < left.cols(); ++c) {
    const double remains = left.col(c).squaredNorm(),
                 noise = std::min(1.0, remains * (n - 1) / (n - 1 - k)),
                 share = 1 - noise * (1 - neighbours.share);
    out.share = std::max(out.share, share);
    const double size = share * sizes(c) * sizes(c) / n;
    (tree.joints[errors.axes[static_cast<size_t>(c)]].type == JointType::prismatic ? out.shift
                                                                                   : out.turn) +=
        size;
  }
  out.turn = std::sqrt(out.turn);
  out.shift = std::sqrt(out.shift);
  return out;
}

/// The clearest jump of errors y of samples in the order of logging; `clear` is 0 where there are
/// too few to tell.
Jump jump_of(int joint, const std::vector<int>& samples, const VectorXd& errors,
             const MatrixXd& columns) {
  constexpr long kFewest = 4;  // samples before and after it
  Jump out{joint, -1, 0, 0};
  const long n = errors.size();
  if (n < columns.cols() + 1 + kLeft || !columns.allFinite()) return out;
  const SingularValues basis = singular_values(columns, Eigen::ComputeThinU);
  const long rank = (basis.values.array() > kSame * basis.values(0)).count();
  const MatrixXd u = basis.u.leftCols(rank);
  const VectorXd y = errors - u * (u.transpose() * errors);
  const auto nu = static_cast<double>(n - rank - 1);
  // y is orthogonal to u: s'y is a sum of y, and s's what u leaves of the ones.
  const double all = y.squaredNorm();
  Eigen::RowVectorXd along = Eigen::RowVectorXd::Zero(rank);
  double sum = 0, most = 0;
  for (long k = n - 1; k >= kFewest; --k) {
    along += u.row(k);
    sum += y(k);
    if (n - k < kFewest) continue;
    const double size = static_cast<double>(n - k) - along.squaredNorm(), by = sum / size,
                 gone = by * sum, left = all - gone;
    if (!(size > kSame * static_cast<double>(n)) || !(left > 0) || gone < kMost * all) continue;
    if (gone / left < most) continue;
    most = gone / left;
    out = {joint, samples[static_cast<size_t>(k)], by, 0};
  }
  out.clear = student_deviate(std::sqrt(nu * most), nu);
  return out;
}

}  // namespace

std::vector<Trend> trends(const Solution& solution) {
  std::vector<Trend> out;
  for (const auto& [joint, all] : errors_by_joint(solution)) {
    if (!shows(solution.rig(), all)) continue;
    const JointErrors errors = standing_still_once(solution, all);
    const Trend trend =
        trend_of(solution.rig().tree, joint, errors, standing(solution, joint, errors));
    if (trend.clear > kByNoChance && trend.share > kGoodPart) out.push_back(trend);
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const Trend& a, const Trend& b) { return a.clear > b.clear; });
  return out;
}

std::vector<Jump> jumps(const Solution& solution) {
  const std::vector<int> order = logged_order(solution.samples());
  std::vector<int> place(order.size());
  for (size_t i = 0; i < order.size(); ++i) place[order[i]] = static_cast<int>(i);
  std::vector<Jump> out;
  for (const auto& [joint, errors] : errors_by_joint(solution)) {
    std::vector<int> rows = indices(errors.samples.size());
    std::stable_sort(rows.begin(), rows.end(), [&, e = &errors](int a, int b) {
      return place[e->samples[a]] < place[e->samples[b]];
    });
    JointErrors sorted = errors;
    for (size_t r = 0; r < rows.size(); ++r) {
      sorted.samples[r] = errors.samples[rows[r]];
      sorted.values.row(static_cast<long>(r)) = errors.values.row(rows[r]);
    }
    sorted = standing_still_once(solution, sorted);
    const MatrixXd columns = standing(solution, joint, sorted);
    const auto look = [&] {
      for (size_t c = 0; c < sorted.axes.size(); ++c) {
        const Jump jump = jump_of(sorted.axes[c], sorted.samples,
                                  sorted.values.col(static_cast<long>(c)), columns);
        if (jump.clear > kJump) out.push_back(jump);
      }
    };
    look();
    if (sorted.axes.size() != kPoseAxes) continue;
    for (size_t r = 0; r < sorted.samples.size(); ++r) {  // of a flange also in its base's axes
      const auto row = static_cast<long>(r);
      const Matrix3d base_R_flange =
          pose_reading(solution.rig().tree, joint, solution.samples()[sorted.samples[r]].readings)
              .rotation;
      for (const int first : {0, 3})
        sorted.values.block<1, 3>(row, first) =
            (base_R_flange * sorted.values.block<1, 3>(row, first).transpose()).transpose().eval();
    }
    look();
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const Jump& a, const Jump& b) { return a.clear > b.clear; });
  return out;
}

}  // namespace kincal
