#include "drift.h"

#include <algorithm>
#include <cmath>

#include "../../solver/decompositions.h"
#include "../rig/distributions.h"

namespace kincal {
namespace {

constexpr size_t kMostCauses = 5;

/// A Course is what could have happened: a factor f_t for every result.
struct Course {
  int from;  // 0: a line
  VectorXd factors;
};

std::vector<Course> courses_of(const std::vector<double>& times) {
  const auto count = static_cast<Eigen::Index>(times.size());
  std::vector<Course> out;
  const Eigen::Map<const VectorXd> at(times.data(), count);
  if (times.back() > times.front()) out.push_back({0, (at.array() - at.mean()).matrix()});
  for (Eigen::Index from = count > 2 ? 1 : count; from < count; ++from) {
    if (times[from] == times[from - 1]) continue;  // their order means nothing
    VectorXd factors = VectorXd::Zero(count);
    factors.tail(count - from).setOnes();
    out.push_back({static_cast<int>(from), factors});
  }
  return out;
}

/// What is known if nothing but some causes happened: a column for each beside those of x.
struct Known {
  std::vector<MatrixXd> rows;
  MatrixXd covariance;  // of x and the causes
  VectorXd value;
};

Known know(const std::vector<Evidence>& results, const std::vector<Course>& courses,
           const std::vector<std::pair<int, size_t>>& causes, const VectorXd& scale) {
  const Eigen::Index n = scale.size(), all = n + static_cast<Eigen::Index>(causes.size());
  Known out;
  MatrixXd normal = MatrixXd::Zero(all, all);
  VectorXd pull = VectorXd::Zero(all);
  normal.diagonal().head(n) = (100 * scale).cwiseAbs2().cwiseInverse();
  for (size_t t = 0; t < results.size(); ++t) {
    MatrixXd rows(results[t].rows.rows(), all);
    rows.leftCols(n) = results[t].rows;
    for (size_t k = 0; k < causes.size(); ++k)
      rows.col(n + static_cast<Eigen::Index>(k)) =
          courses[causes[k].second].factors(static_cast<Eigen::Index>(t)) *
          results[t].rows.col(causes[k].first);
    normal.noalias() += rows.transpose() * rows;
    pull.noalias() += rows.transpose() * results[t].seen;
    out.rows.push_back(std::move(rows));
  }
  const VectorXd unit = normal.diagonal().cwiseSqrt().cwiseInverse();
  const MatrixXd root =
      Cholesky(unit.asDiagonal() * normal * unit.asDiagonal()).inverse_factor() * unit.asDiagonal();
  out.covariance = root.transpose() * root;
  out.value = out.covariance * pull;
  return out;
}

/// b of every number along a course, beside what is known.
std::vector<Slope> slopes(const std::vector<Evidence>& results, const Known& known,
                          const Course& course, const VectorXd& scale) {
  const Eigen::Index n = scale.size();
  MatrixXd beside = MatrixXd::Zero(known.value.size(), n);  // g, by number
  VectorXd own = VectorXd::Zero(n), pull = VectorXd::Zero(n);
  for (size_t t = 0; t < results.size(); ++t) {
    const double f = course.factors(static_cast<Eigen::Index>(t));
    if (f == 0) continue;
    const MatrixXd& rows = results[t].rows;
    beside.noalias() += f * known.rows[t].transpose() * rows;
    own += f * f * rows.colwise().squaredNorm().transpose();
    pull.noalias() += f * (rows.transpose() * (results[t].seen - known.rows[t] * known.value));
  }
  const double reach = course.factors.maxCoeff() - course.factors.minCoeff();
  std::vector<Slope> out(static_cast<size_t>(n));
  const MatrixXd through = known.covariance * beside;
  for (Eigen::Index c = 0; c < n; ++c) {
    const double q = own(c) - beside.col(c).dot(through.col(c));
    // What is left of own by rounding tells nothing; nor does what is wider than the scale.
    if (q > 1e-9 * own(c) && q * scale(c) * scale(c) > reach * reach)
      out[c] = {pull(c) / q, 1 / std::sqrt(q)};
  }
  return out;
}

}  // namespace

Evidence without_numbers(const Evidence& evidence, const std::vector<int>& numbers) {
  if (numbers.empty() || evidence.rows.rows() == 0) return evidence;
  MatrixXd block(evidence.rows.rows(), static_cast<Eigen::Index>(numbers.size()));
  for (Eigen::Index k = 0; k < block.cols(); ++k) block.col(k) = evidence.rows.col(numbers[k]);
  const Elimination own(block);
  MatrixXd rows = evidence.rows;
  VectorXd seen = evidence.seen;
  own.rotate(rows);
  own.rotate(seen);
  const Eigen::Index left = rows.rows() - own.rank();
  Evidence out{rows.bottomRows(left), seen.tail(left)};
  for (const int number : numbers) out.rows.col(number).setZero();
  return out;
}

Drift find_drift(const std::vector<Evidence>& results, const std::vector<double>& times,
                 const VectorXd& scale, double level) {
  Drift out;
  if (results.size() < 2) return out;
  const std::vector<Course> courses = courses_of(times);
  std::vector<std::pair<int, size_t>> causes;  // number, course
  std::vector<NumberDrift> numbers(static_cast<size_t>(scale.size()));
  while (causes.size() < kMostCauses) {
    const Known known = know(results, courses, causes, scale);
    std::vector<std::vector<Slope>> slope;
    double most = 0;
    int tried = 0;
    for (size_t k = 0; k < courses.size(); ++k) {
      slope.push_back(slopes(results, known, courses[k], scale));
      for (const auto& [number, course] : causes)  // known beside x: what is left of it is rounding
        if (course == k) slope.back()[number] = {};
      const std::vector<Slope>& found = slope.back();
      for (size_t c = 0; c < found.size(); ++c) {
        if (found[c].sigma == 0) continue;
        ++tried;
        most = std::max(most, std::abs(found[c].in_sigmas()));
        if (!causes.empty()) continue;
        numbers[c].number = static_cast<int>(c);
        if (courses[k].from == 0)
          numbers[c].line = found[c];
        else if (std::abs(found[c].in_sigmas()) >= std::abs(numbers[c].change.in_sigmas()))
          numbers[c].change = found[c], numbers[c].from = courses[k].from;
      }
    }
    if (tried == 0) break;
    // Of those as good as the best the first number, by its best course.
    Cause best;
    size_t course = 0;
    for (size_t c = 0; c < numbers.size() && best.number < 0; ++c)
      for (size_t k = 0; k < courses.size(); ++k) {
        const double here = std::abs(slope[k][c].in_sigmas());
        if (slope[k][c].sigma == 0 || here < kAsWell * most ||
            (best.number >= 0 && here <= std::abs(best.slope.in_sigmas())))
          continue;
        best = {static_cast<int>(c), courses[k].from, slope[k][c], 1};
        course = k;
      }
    best.p = std::min(1.0, 2 * normal_tail(most) * tried);
    if (causes.empty()) out.p = best.p;
    if (best.p >= level) break;
    out.causes.push_back(best);
    causes.push_back({best.number, course});
  }
  for (const NumberDrift& number : numbers)
    if (number.number >= 0) out.numbers.push_back(number);
  return out;
}

}  // namespace kincal
