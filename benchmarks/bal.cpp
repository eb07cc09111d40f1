#include "bal.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <stdexcept>

#include "../solver/levenberg_marquardt.h"
#include "random.h"

namespace kincal::benchmarks {
namespace {

/// The whole file as text.
std::string contents(const std::string& path) {
  const bool packed = path.size() > 3 && path.compare(path.size() - 3, 3, ".xz") == 0;
  FILE* file = nullptr;
  if (packed) {
    std::string quoted = "'";
    for (char c : path) quoted += c == '\'' ? "'\\''" : std::string(1, c);
    if (FILE* there = std::fopen(path.c_str(), "rb")) {
      std::fclose(there);
      file = popen(("xz -dc -- " + quoted + "'").c_str(), "r");
    }
  } else {
    file = std::fopen(path.c_str(), "rb");
  }
  if (!file) throw std::runtime_error(path + ": cannot be read");
  std::string text;
  char buffer[1 << 16];
  for (size_t n; (n = std::fread(buffer, 1, sizeof buffer, file)) > 0;) text.append(buffer, n);
  if ((packed ? pclose(file) : std::fclose(file)) != 0)
    throw std::runtime_error(path + ": cannot be unpacked");
  return text;
}

Vector3d in_camera(const double* camera, const Vector3d& p) {
  return exp_so3(Vector3d(camera[0], camera[1], camera[2])) * p +
         Vector3d(camera[3], camera[4], camera[5]);
}

}  // namespace

BundleAdjustmentData read_bal(const std::string& path) {
  const std::string text = contents(path);
  const char* at = text.c_str();
  const auto number = [&] {
    char* end;
    const double v = std::strtod(at, &end);
    if (end == at)
      throw std::runtime_error(
          path + ": ends too early, or there is something else than a number at byte " +
          std::to_string(at - text.c_str()));
    at = end;
    return v;
  };
  const auto whole = [&](const char* what, double least, double most) {
    const double v = number();
    if (!(v >= least && v <= most) || v != std::floor(v))
      throw std::runtime_error(path + ": " + std::to_string(v) + " is no " + what);
    return static_cast<int>(v);
  };
  const int cameras = whole("number of cameras", 1, 1e6),
            points = whole("number of points", 1, 1e8),
            observations = whole("number of observations", 1, 1e9);
  BundleAdjustmentData data;
  for (int i = 0; i < observations; ++i) {
    data.camera_of.push_back(whole("camera", 0, cameras - 1));
    data.point_of.push_back(whole("point", 0, points - 1));
    data.pixels.push_back(number());
    data.pixels.push_back(number());
  }
  for (int i = 0; i < 9 * cameras; ++i) data.cameras.push_back(number());
  for (int i = 0; i < 3 * points; ++i) data.points.push_back(number());
  return data;
}

BundleAdjustmentData synthetic_bal(int cameras, int points, std::uint64_t seed) {
  constexpr double kTurn = 6.283185307179586, kSpacing = 1.25;
  const double radius = kSpacing * cameras / kTurn;
  Random random(seed);
  BundleAdjustmentData data;
  std::vector<double> truth;
  for (int c = 0; c < cameras; ++c) {
    const double bearing = kTurn * c / cameras;
    // The camera looks along -z; its x axis points along the ring (clockwise), y up.
    const Vector3d back(-std::cos(bearing), -std::sin(bearing), 0), up(0, 0, 1),
        right = up.cross(back);
    Matrix3d camera_R_world;
    camera_R_world << right.transpose(), up.transpose(), back.transpose();
    camera_R_world = exp_so3(random.vector(0.03)) * camera_R_world;
    const Vector3d position = -radius * back + random.vector(0.1);
    const Vector3d w = log_so3(camera_R_world), t = -(camera_R_world * position);
    truth.insert(truth.end(), {w.x(), w.y(), w.z(), t.x(), t.y(), t.z()});
    truth.insert(truth.end(), {900 + random.normal(20), -0.05 + random.normal(0.01),
                               0.01 + random.normal(0.002)});
  }
  for (int p = 0; p < points; ++p) {
    const int seen = 3 + static_cast<int>(random.uniform() * 7.44);  // 3 .. 10
    const int first = static_cast<int>(random.uniform() * cameras);
    const double bearing = kTurn * (first + 0.5 * (seen - 1) + random.uniform(-0.5, 0.5)) / cameras;
    const double distance = radius + random.uniform(8, 14);
    const Vector3d at(distance * std::cos(bearing), distance * std::sin(bearing),
                      random.uniform(-2.5, 2.5));
    for (int k = 0; k < seen; ++k) {
      const int c = (first + k) % cameras;
      const double* camera = &truth[9 * c];
      const Vector3d q = in_camera(camera, at);
      const double u = -q.x() / q.z(), v = -q.y() / q.z(), s = u * u + v * v;
      const double scale = camera[6] * (1 + s * (camera[7] + s * camera[8]));
      data.camera_of.push_back(c);
      data.point_of.push_back(p);
      data.pixels.push_back(scale * u + random.normal(0.5));
      data.pixels.push_back(scale * v + random.normal(0.5));
    }
    const Vector3d start = at + random.vector(0.05);
    data.points.insert(data.points.end(), {start.x(), start.y(), start.z()});
  }
  const double sigma[9] = {0.002, 0.002, 0.002, 0.02, 0.02, 0.02, 5, 0.005, 0.002};
  for (size_t i = 0; i < truth.size(); ++i)
    data.cameras.push_back(truth[i] + random.normal(sigma[i % 9]));
  return data;
}

std::string describe(const BundleAdjustmentData& data) {
  return std::to_string(data.cameras.size() / 9) + " cameras, " +
         std::to_string(data.points.size() / 3) + " points, " +
         std::to_string(data.camera_of.size()) + " observations";
}

KincalBalRun solve_with_kincal(const BundleAdjustmentData& data, const KincalBalOptions& options) {
  KincalBalRun run;
  const double before = cpu_seconds();
  BundleAdjustment problem(data);
  VectorXd state = problem.initial();
  const double cpu = cpu_seconds(), wall = wall_seconds();
  SolverOptions solver;
  solver.threads = options.threads;
  solver.max_iterations = options.max_iterations;
  solver.relative_decrease = options.relative_decrease;
  solver.linear_solver = options.linear_solver;
  LevenbergMarquardt lm(problem, solver);
  const SolveSummary summary = lm.solve(state);
  run.seconds = cpu_seconds() - cpu;
  run.wall = wall_seconds() - wall;
  run.setup = cpu - before;
  run.iterations = summary.iterations;
  run.converged = summary.outcome == Outcome::converged;
  for (const auto& h : summary.history) run.costs.push_back(0.5 * h.first);
  run.start_cost = run.costs.empty() ? 0 : run.costs.front();
  run.cost = 0.5 * summary.cost.doubled;
  run.linear_solver = lm.linear_solver();
  return run;
}

}  // namespace kincal::benchmarks
