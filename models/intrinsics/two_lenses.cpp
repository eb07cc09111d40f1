#include "two_lenses.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "../../solver/decompositions.h"
#include "../fitting/lens_start.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kLikeNoise = 1.5,
                 kRest = 0.1;  // of what turned pictures, turned back, still leave
constexpr int kMostTurns = 6;
constexpr double kGained = 0.7;     // of what two lenses should take off the cost, by a fit
constexpr int kDirections = 3;      // along which views are parted to start from
constexpr int kMostRounds = 30;     // they end after three or so
constexpr double kNothing = 1e-9;   // of the largest eigenvalue
constexpr double kOneOfAll = 0.75;  // of what the fewer gain: more is that view's own
constexpr double kFarGain = 40,
                 kGainOfView = 2;   // in what is left: noise gives about 25 for 20 views
constexpr double kOwnShare = 0.01;  // of a mean view's information: less is nothing to wish by

/// N^-1/2 of a positive semidefinite matrix, on its range.
MatrixXd inverse_root(const MatrixXd& n, double least) {
  const SymmetricEigen eigen = symmetric_eigen(n);
  VectorXd scale = VectorXd::Zero(n.rows());
  for (Eigen::Index k = 0; k < scale.size(); ++k)
    if (eigen.values(k) > least) scale(k) = 1 / std::sqrt(eigen.values(k));
  return eigen.vectors * scale.asDiagonal() * eigen.vectors.transpose();
}

double cost(const LensEquations& view, const VectorXd& d) {
  return d.dot(view.normal * d) - 2 * d.dot(view.pull);
}

struct Parted {
  std::vector<char> second;
  double gain = 0;
};

/// The lens of the views of one part.
VectorXd common_lens(const std::vector<LensEquations>& views, const std::vector<char>& second,
                     char part) {
  const Eigen::Index n = views[0].pull.size();
  MatrixXd normal = MatrixXd::Zero(n, n);
  VectorXd pull = VectorXd::Zero(n);
  for (size_t i = 0; i < views.size(); ++i)
    if (second[i] == part) normal += views[i].normal, pull += views[i].pull;
  const MatrixXd root = inverse_root(normal, kNothing * normal.trace());
  return root * (root * pull);
}

Parted settle(const std::vector<LensEquations>& views, std::vector<char> second) {
  Parted out;
  for (int round = 0; round < kMostRounds; ++round) {
    const VectorXd a = common_lens(views, second, 0), b = common_lens(views, second, 1);
    out.second.clear();
    out.gain = 0;
    for (const LensEquations& view : views) {
      const double at_a = cost(view, a), at_b = cost(view, b);
      out.second.push_back(at_b < at_a ? 1 : 0);
      out.gain -= std::min(at_a, at_b);
    }
    if (out.second == second) break;
    second = out.second;
  }
  return out;
}

void set_samples(std::vector<Sample> samples, OneCamera& camera) {
  camera.samples = std::make_shared<const std::vector<Sample>>(std::move(samples));
  camera.views = camera_views(*camera.samples, 0);
}

/// Moves the views of samples `chosen`, in ascending order, out of a camera.
OneCamera take_out(const std::vector<int>& chosen, OneCamera& camera) {
  OneCamera out = camera;
  std::vector<Sample> kept, moved;
  for (size_t i = 0; i < camera.samples->size(); ++i)
    (std::binary_search(chosen.begin(), chosen.end(), static_cast<int>(i)) ? moved : kept)
        .push_back((*camera.samples)[i]);
  set_samples(std::move(kept), camera);
  set_samples(std::move(moved), out);
  return out;
}

/// The camera with the pictures of samples `chosen` turned by 180 degrees.
OneCamera turned(const std::vector<int>& chosen, OneCamera camera) {
  const Eigen::Vector2d last =
      image_size(camera.rig.sensors[0], camera.views) - Eigen::Vector2d::Ones();
  std::vector<Sample> samples = *camera.samples;
  for (const int i : chosen)
    for (View& view : samples[i].views)
      for (size_t k = 0; k < view.z.size(); ++k)
        view.z[k] = last(static_cast<Eigen::Index>(k % 2)) - view.z[k];
  set_samples(std::move(samples), camera);
  return camera;
}

/// Of samples 0 to count - 1 the given ones, or the others if these are fewer.
std::vector<int> the_fewer(const std::vector<int>& given, size_t count) {
  if (2 * given.size() <= count) return given;
  std::vector<int> out;
  for (int i = 0; i < static_cast<int>(count); ++i)
    if (!std::binary_search(given.begin(), given.end(), i)) out.push_back(i);
  return out;
}

/// A TurnedBack has the views that were turned, and what fits all with these turned back.
struct TurnedBack {
  std::vector<int> samples;
  double chi2 = kInfinity, rms = kNan;    // of all views; px
  double of_all = kNan, of_noise = kNan;  // what a lens for each view gains, and noise gives that
  Rig lens;
};

/// Fits all views with those of `samples` turned back; false: that is no better than `best`.
bool turn_back(const std::vector<int>& samples, const LensModel& model,
               const CalibrationOptions& options, const OneCamera& camera, TurnedBack& best) {
  OneCamera trial = turned(samples, camera);
  Solution solution = fit_lens(model, options, trial);
  const bool better = solution.usable() && !(solution.chi2_data >= best.chi2);
  if (!better) return false;
  const LensSplit left = split_by_lens(lens_equations(solution, 0));
  best = {samples,
          solution.chi2_data,
          training_rms(solution, 0),
          left.of_all,
          left.of_noise * solution.chi2_data / solution.dof_data,
          at_solution(solution)};
  return true;
}

/// From the views that two lenses part: all are turned as it suits the lens found so far.
TurnedBack find_turned(const std::vector<int>& parted, const LensModel& model,
                       const CalibrationOptions& options, const OneCamera& camera) {
  std::vector<int> all(camera.samples->size());
  std::iota(all.begin(), all.end(), 0);
  const OneCamera other = turned(all, camera);
  TurnedBack out;
  std::vector<int> chosen = parted;
  for (int round = 0; round < kMostTurns; ++round) {
    if (!turn_back(chosen, model, options, camera, out)) break;
    chosen.clear();
    for (const int i : all)
      if (lens_misfit(out.lens, camera_views({(*other.samples)[i]}, 0)) <
          lens_misfit(out.lens, camera_views({(*camera.samples)[i]}, 0)))
        chosen.push_back(i);
  }
  return out;
}

}  // namespace

LensSplit split_by_lens(const std::vector<LensEquations>& given) {
  LensSplit out;
  if (given.size() < 4) return out;
  // Numbers of a lens have units of their own: all are taken in those of their information.
  MatrixXd all = MatrixXd::Zero(given[0].normal.rows(), given[0].normal.rows());
  for (const LensEquations& view : given) all += view.normal;
  VectorXd scale = all.diagonal();
  for (double& s : scale) s = s > 0 ? 1 / std::sqrt(s) : 0;
  const MatrixXd root =
      inverse_root(scale.asDiagonal() * all * scale.asDiagonal(), kNothing) * scale.asDiagonal();
  std::vector<LensEquations> views;
  MatrixXd scatter = MatrixXd::Zero(root.rows(), root.rows());
  for (const LensEquations& view : given) {
    views.push_back({view.sample, root * view.normal * root.transpose(), root * view.pull});
    scatter += views.back().pull * views.back().pull.transpose();
    const MatrixXd own =
        inverse_root(views.back().normal, kOwnShare / static_cast<double>(given.size()));
    out.of_all += (own * views.back().pull).squaredNorm();
    out.of_noise += (own * views.back().normal * own).trace();
  }
  const MatrixXd directions = symmetric_eigen(scatter).vectors;
  Parted best;
  for (Eigen::Index k = 0; k < std::min<Eigen::Index>(kDirections, directions.cols()); ++k) {
    const VectorXd along = directions.col(directions.cols() - 1 - k);
    std::vector<char> second;
    for (const LensEquations& view : views) second.push_back(along.dot(view.pull) < 0 ? 1 : 0);
    Parted found = settle(views, std::move(second));
    if (found.gain > best.gain) best = std::move(found);
  }
  const auto seconds = std::count(best.second.begin(), best.second.end(), 1);
  const auto views_count = static_cast<long>(views.size());
  if (std::min<long>(seconds, views_count - seconds) < 2) return out;
  const char fewer = 2 * seconds <= views_count ? 1 : 0;
  const VectorXd lens = common_lens(views, best.second, fewer);
  double of_fewer = 0;
  for (size_t i = 0; i < views.size(); ++i) {
    if (best.second[i] != fewer) continue;
    const double gain = std::max(0.0, -cost(views[i], lens));
    out.samples.push_back(views[i].sample);
    out.largest = std::max(out.largest, gain);
    of_fewer += gain;
  }
  out.views = views_count;
  out.gain = best.gain;
  out.largest /= of_fewer;
  return out;
}

bool is_decisive(const LensSplit& split, double left) {
  return split.samples.size() > 1 && split.largest < kOneOfAll &&

         split.gain > left * (kFarGain + kGainOfView * static_cast<double>(split.views));
}

std::vector<IntrinsicsNote> views_of_another_lens(const LensModel& model,
                                                  const CalibrationOptions& options,
                                                  OneCamera camera) {
  const Solution all = fit_lens(model, options, camera);
  if (!all.usable()) return {};
  const LensSplit split = split_by_lens(lens_equations(all, 0));
  const double left = all.chi2_data - split.gain;
  if (!is_decisive(split, left / all.dof_data)) return {};
  const auto gained = [&](double chi2) { return all.chi2_data - chi2 > kGained * split.gain; };
  AnotherLens note = {camera.rig.sensors[0].name, {}, camera.views.size(), training_rms(all, 0)};
  const auto say = [&](std::vector<int> samples) {
    samples = the_fewer(samples, all.samples().size());
    for (const int i : samples) note.samples.push_back(quoted(all.samples()[i].id));
    return std::vector<IntrinsicsNote>{another_lens(note)};
  };
  const TurnedBack back = find_turned(split.samples, model, options, camera);
  // A bent board, or a view that is wrong, leaves much that a lens for each view takes up.
  if (!the_fewer(back.samples, camera.samples->size()).empty() && gained(back.chi2) &&
      (back.of_all < kLikeNoise * back.of_noise || back.of_all < kRest * split.of_all)) {
    note.turned = true;
    note.apart = back.rms;
    return say(back.samples);
  }
  if (split.gain < kNearlyAll * split.of_all) return {};
  OneCamera one = camera, other = take_out(split.samples, one);
  const Solution first = fit_lens(model, options, one), second = fit_lens(model, options, other);
  if (!first.usable() || !second.usable() || !gained(first.chi2_data + second.chi2_data)) return {};
  note.apart = std::sqrt((first.chi2_data + second.chi2_data) / all.chi2_data) * note.together;
  return say(split.samples);
}

}  // namespace kincal
