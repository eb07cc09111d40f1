// Robots known by the poses of their flange: files to estimate, against an independent truth.
//
// Proves by Monte Carlo, with poses made here with Eigen alone: the camera's and the board's pose
// are found, in the hand and in the room, and are as far off as the covariance says, with exact and
// with noisy poses; noise of the poses that nobody states is found. Not proved: images (tests of
// the program), and robots whose poses are wrong in a systematic way.
#include <unistd.h>

#include <Eigen/Geometry>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "../../../io/rig/rig_file.h"
#include "../../../io/rig/samples_file.h"
#include "../../../kinematics/floating.h"
#include "../../fixtures/study.h"

using namespace kincal;
using Eigen::Isometry3d;

namespace {

constexpr double kPixel = 0.1;

struct Cell {
  bool in_hand = true;
  double translation = 0, rotation = 0;  // sigmas of the poses
  bool stated = true;
};

class Truth {
 public:
  Truth(const Cell& cell, unsigned seed) : cell_(cell), engine_(seed) {
    link_T_camera_ = cell.in_hand ? motion(0.5, 0.05, {0, 0, 0.08})
                                  : Eigen::Translation3d(0.5, 0, 1.1) * half_turn() *
                                        motion(0.1, 0.05, {0, 0, 0});
    link_T_board_ = cell.in_hand ? motion(0.2, 0.02, {0.5, 0, 0}) : motion(0.3, 0.02, {0, 0, 0.05});
  }

  std::string rig() const {
    std::ostringstream out;
    out << "format: kincal/1\nrobot: {base: base, flange: tool0}\n";
    if (cell_.stated)
      out << "joints: {flange: {sigma: {translation: " << cell_.translation
          << ", rotation: " << cell_.rotation << "}}}\n";
    out << "targets: {board: {type: chessboard, rows: 5, columns: 6, square: 0.03, mount: {link: "
        << (cell_.in_hand ? "base" : "tool0") << "}}}\n"
        << "sensors: {cam: {type: camera, link: " << (cell_.in_hand ? "tool0" : "base")
        << ", model: pinhole, image_size: [1280, 960], intrinsics: [900, 900, 640, 480], sigma: "
        << kPixel << "}}\n"
        << "estimate: [{step: all, free: [\"*/pose\"]}]\n";
    return out.str();
  }

  std::string samples(int count) {
    std::ostringstream out;
    out.precision(17);
    for (int made = 0; made < count;) {
      const Isometry3d camera_T_board =
          Eigen::Translation3d(0.1 * normal() - 0.07, 0.08 * normal() - 0.06,
                               0.7 + 0.1 * normal()) *
          Eigen::AngleAxisd(1.2 * normal(), Eigen::Vector3d::UnitZ()) *
          Eigen::AngleAxisd(0.35 * normal(), Eigen::Vector3d::UnitX()) *
          Eigen::AngleAxisd(0.35 * normal(), Eigen::Vector3d::UnitY());
      std::ostringstream pixels;
      pixels.precision(17);
      bool seen = true;
      for (int i = 0; i < 30; ++i) {
        const Eigen::Vector3d p = camera_T_board * Eigen::Vector3d(i % 6 * 0.03, i / 6 * 0.03, 0);
        const double u = 900 * p.x() / p.z() + 640, v = 900 * p.y() / p.z() + 480;
        seen = seen && u > 0 && u < 1279 && v > 0 && v < 959;
        pixels << (i ? ", [" : "[") << u + kPixel * normal() << ", " << v + kPixel * normal()
               << "]";
      }
      if (!seen) continue;
      const Isometry3d base_T_flange =
          cell_.in_hand ? link_T_board_ * camera_T_board.inverse() * link_T_camera_.inverse()
                        : link_T_camera_ * camera_T_board * link_T_board_.inverse();
      const Isometry3d read = base_T_flange * error().inverse();
      const Eigen::Quaterniond q(read.linear());
      out << "{\"id\": \"s" << made << "\", \"joints\": {\"flange\": {\"xyz\": ["
          << read.translation().x() << ", " << read.translation().y() << ", "
          << read.translation().z() << "], \"quat\": [" << q.x() << ", " << q.y() << ", " << q.z()
          << ", " << q.w() << "]}}, \"views\": [{\"sensor\": \"cam\", \"target\": \"board\", "
          << "\"pixels\": [" << pixels.str() << "]}]}\n";
      ++made;
    }
    return out.str();
  }

  /// The estimate's error of both poses, in sigmas squared.
  double nees(const Solution& solution) const {
    VectorXd e(12);
    e << error_of(solution, solution.table().sensor_pose[0], link_T_camera_),
        error_of(solution, solution.table().target_pose[0], link_T_board_);
    REQUIRE(solution.columns.size() == 12);
    return e.dot(solution.covariance.ldlt().solve(e));
  }

 private:
  double normal() { return normal_(engine_); }
  static Isometry3d half_turn() {
    return Isometry3d(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitX()));
  }
  Isometry3d motion(double turn, double shift, const Eigen::Vector3d& from) {
    const Eigen::Vector3d w = turn * Eigen::Vector3d(normal(), normal(), normal());
    Isometry3d out(Eigen::AngleAxisd(w.norm(), w.normalized()));
    out.translation() = from + shift * Eigen::Vector3d(normal(), normal(), normal());
    return out;
  }
  Isometry3d error() {
    return cell_.rotation > 0 ? motion(cell_.rotation, cell_.translation, Eigen::Vector3d::Zero())
                              : Isometry3d::Identity();
  }
  static Vector6d error_of(const Solution& solution, int parameter, const Isometry3d& truth) {
    const Pose found = get_pose(solution.values.shared, solution.table().all[parameter].start);
    // The covariance is that of increments from the step's start; at it, up to second order.
    return log_se3(inverse(found) * Pose{truth.linear(), truth.translation()});
  }

  Cell cell_;
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
  Isometry3d link_T_camera_, link_T_board_;
};

struct Input {
  Rig rig;
  std::vector<Sample> samples;
};

Input read(Truth& truth, int count) {
  const std::filesystem::path path = std::filesystem::temp_directory_path() /
                                     ("kincal_flange_" + std::to_string(getpid()) + ".yaml");
  std::ofstream(path) << truth.rig();
  Input out;
  out.rig = read_rig(path.string()).rig;
  std::filesystem::remove(path);
  out.samples = parse_samples(truth.samples(count), "samples.jsonl", out.rig);
  return out;
}

}  // namespace

TEST_CASE("flange poses: mounts are found, as far off as the covariance says") {
  constexpr int kSeeds = 60;
  for (const Cell& cell : {Cell{true, 0, 0}, Cell{true, 2e-4, 4e-4}, Cell{false, 1e-3, 1e-3}}) {
    double nees = 0, chi2 = 0;
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
      Truth truth(cell, seed);
      const Input input = read(truth, 12);
      const Solution solution = fixture::solution_of(input.rig, input.samples);
      REQUIRE(solution.status == Status::converged);
      nees += truth.nees(solution) / 12 / kSeeds;
      chi2 += solution.chi2_per_dof() / kSeeds;
    }
    INFO("NEES/dof " << nees << ", chi2/dof " << chi2);
    // 12 x 60 and 700 x 60 numbers: 99 % intervals
    CHECK(nees > 1 - 2.6 * std::sqrt(2.0 / (12 * kSeeds)));
    CHECK(nees < 1 + 2.6 * std::sqrt(2.0 / (12 * kSeeds)));
    CHECK(chi2 == Approx(1).margin(2.6 * std::sqrt(2.0 / (700 * kSeeds))));
  }
}

TEST_CASE("flange poses: noise that nobody states is found, and zero where it says exact") {
  const Cell noisy{true, 6e-4, 1.2e-3, false}, exact{false, 0, 0, false};
  for (const Cell& cell : {noisy, exact}) {
    Truth truth(cell, 5);
    Input input = read(truth, 25);
    input.rig.steps.clear();
    const Report report = fixture::study_of(input.rig, input.samples);
    REQUIRE(report.solution.status == Status::converged);
    const std::vector<JointSettings>& joints = report.solution.rig().joints;
    const int first = input.rig.tree.joints[0].first_axis + kPoseAxes;
    if (cell.translation > 0) {
      CHECK(joints[first].sigma == Approx(cell.translation).epsilon(0.4));
      CHECK(joints[first + 3].sigma == Approx(cell.rotation).epsilon(0.4));
    } else {
      CHECK(joints[first].sigma < 5e-5);
      CHECK(joints[first + 3].sigma < 5e-5);
    }
    CHECK(joints[first + 2].sigma == joints[first].sigma);
    CHECK(report.solution.chi2_per_dof() == Approx(1).margin(0.15));
  }
}
