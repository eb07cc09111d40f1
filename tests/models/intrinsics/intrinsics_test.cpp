// models/intrinsics/intrinsics.h and models/analysis/projection.h: cameras from views of boards.
//
// Proves, on simulated views and from guesses that are far off: lenses and relative poses come out
// within their sigmas (Monte Carlo: the mean squared error over the stated covariance is near 1,
// noise estimated included); the choice finds the lens that made the views; the sigma of where a
// point appears is what the scatter over repeated recordings shows, near and far; one view and
// parallel views are told; cameras on different bodies, and boards that the rig mounts, are taken
// as they have to be; a bent board is found bent, with sigmas, a flat one is left flat, and the
// derivatives by a board's shape are those of differences; pictures turned by 180 degrees and those
// of another lens are named, and where there are none nothing is. Does not prove: detection, real
// lenses (images/calibrate_camera_test.cpp).
#include "../../../models/intrinsics/intrinsics.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/fitting/closed_form.h"
#include "../../../models/rig/targets.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"

namespace intrinsics_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

constexpr double kPixel = 0.2;  // noise, px

/// A camera's pixel of a point in its frame, at given own numbers; nullopt: not seen.
std::optional<Eigen::Vector2d> pixel_of(const Sensor& camera, const Vector3d& p) {
  std::vector<double> own;
  for (const ParameterBlock& block : camera.parameters)
    own.insert(own.end(), block.values.begin(), block.values.end());
  const Matrix3Xd points = p;
  const int id = 0;
  const double zero[2] = {0, 0};
  ViewInput in;
  in.parameters = own.data();
  in.points = &points;
  in.ids = &id;
  in.count = 1;
  in.z = zero;
  Eigen::Vector2d out;
  if (p.z() < 0.05 || !camera.model->evaluate(in, Columns(), out.data(), nullptr))
    return std::nullopt;
  return out;
}

/// A hand with cameras and a board that the rig mounts on the floor, which does not matter.
Rig cameras_on_hand(const std::vector<Pose>& poses, Lens lens,
                    const std::vector<double>& distortion) {
  Rig rig;
  add_link(rig, "floor");
  add_joint(rig, JointType::revolute, "wrist", "floor", "hand", {0, 0, 1}, at({0, 0, 0.4}), 0);
  finish_tree(rig.tree);
  add_grid(rig, "board", 7, 10, 0.03, "floor", at({1, 2, 3}));
  for (size_t i = 0; i < poses.size(); ++i)
    add_camera(rig, "eye" + std::to_string(i), "hand", poses[i], lens, distortion, 0, kPixel);
  return rig;
}

/// Poses of a board before the first camera; `tilt` is the largest, in rad; `spread` is how far
/// they lie to the sides.
std::vector<Pose> board_poses(int count, double tilt, unsigned long seed, double spread = 1) {
  Random random(seed);
  std::vector<Pose> out;
  for (int i = 0; i < count; ++i) {
    const double angle = random.uniform(0.6 * tilt, tilt), way = random.uniform(0, 2 * kPi);
    Pose pose;
    pose.rotation = exp_so3(angle * Vector3d(std::cos(way), std::sin(way), 0)) *
                    exp_so3(Vector3d(0, 0, tilt > 0 ? random.uniform(-0.5, 0.5) : 0));
    const double z = random.uniform(0.35, 0.7) / spread;
    const double side = spread * z;
    const Vector3d centre(random.uniform(-0.35, 0.35) * side, random.uniform(-0.25, 0.25) * side,
                          z);
    pose.translation = centre - pose.rotation * Vector3d(0.135, 0.09, 0);
    out.push_back(pose);
  }
  return out;
}

/// What the cameras see of the board; readings are missing, for they are not needed.
std::vector<Sample> views(const Rig& truth, const std::vector<Pose>& boards, unsigned long seed) {
  Random random(seed);
  std::vector<Sample> out;
  const Matrix3Xd points = target_points(truth.targets[0]);
  for (size_t i = 0; i < boards.size(); ++i) {
    Sample sample;
    sample.id = "view" + std::to_string(i);
    sample.readings.assign(truth.tree.joints.size(), kNan);
    for (size_t s = 0; s < truth.sensors.size(); ++s) {
      const Sensor& camera = truth.sensors[s];
      const Pose pose = inverse(camera.link_T_sensor) * truth.sensors[0].link_T_sensor * boards[i];
      View view;
      view.sensor = static_cast<int>(s);
      view.target = 0;
      view.sigma = camera.sigma;
      for (int k = 0; k < points.cols(); ++k) {
        const auto z = pixel_of(camera, pose * Vector3d(points.col(k)));
        const double nu = kPixel * random.normal(), nv = kPixel * random.normal();
        if (!z || z->x() < 0 || z->y() < 0 || z->x() > 639 || z->y() > 479) continue;
        view.ids.push_back(k);
        view.z.insert(view.z.end(), {z->x() + nu, z->y() + nv});
      }
      if (view.ids.size() >= 12) sample.views.push_back(view);
    }
    if (!sample.views.empty()) out.push_back(sample);
  }
  return out;
}

/// The rig of somebody who knows little of the cameras.
Rig guessed(Rig rig) {
  for (Sensor& camera : rig.sensors) {
    camera.model = make_camera(Lens::pinhole, 0);
    camera.parameters = camera_parameters(Lens::pinhole, {900, 900, 300, 260}, {}, 0);
    camera.sigma = {0.5, 0.5};
    if (&camera != &rig.sensors[0]) camera.link_T_sensor = Pose();
  }
  return rig;
}

IntrinsicsResult calibrated(const Rig& rig, const std::vector<Sample>& samples,
                            const std::string& model) {
  IntrinsicsOptions options;
  options.model = model;
  return *calibrate_intrinsics(rig, samples, options);
}

/// Errors of all columns of a group's covariance, estimate minus truth.
VectorXd errors(const IntrinsicsGroup& group, const Rig& truth) {
  const Solution& solution = group.solution;
  const ParameterTable& table = solution.table();
  VectorXd out(static_cast<Eigen::Index>(solution.columns.size()));
  for (Eigen::Index i = 0; i < out.size(); ++i) {
    const Component& c = solution.columns[i];
    const Parameter& p = table.all[c.parameter];
    if (p.kind == ParameterKind::warp) {
      out(i) = solution.values.shared(p.start + c.index) - truth.targets[p.owner].warp(c.index);
      continue;
    }
    const Sensor& camera = truth.sensors[group.cameras[p.owner]];
    if (p.kind == ParameterKind::sensor_pose) {
      const Pose relative =
          inverse(truth.sensors[group.cameras[0]].link_T_sensor) * camera.link_T_sensor;
      out(i) = -log_se3(inverse(get_pose(solution.values.shared, p.start)) * relative)(c.index);
    } else {
      out(i) =
          solution.values.shared(p.start + c.index) - find_block(camera, p.kind)->values[c.index];
    }
  }
  return out;
}

const std::vector<double> kBarrel = {-0.28, 0.09, 0.001, -0.0008, 0};

}  // namespace

TEST_CASE("intrinsics: lenses come out within their sigmas", "[intrinsics][slow]") {
  const struct {
    const char* model;
    Lens lens;
    std::vector<double> distortion;
  } cases[] = {{"pinhole", Lens::pinhole, {}},
               {"brown_conrady_4", Lens::brown_conrady, kBarrel},
               {"kannala_brandt", Lens::kannala_brandt, {0.03, -0.01, 0.004, -0.001}}};
  for (const auto& one : cases) {
    const Rig truth = cameras_on_hand({at({0.1, 0, 0})}, one.lens, one.distortion);
    constexpr int kTrials = 30;
    double sum = 0, noise = 0;
    Eigen::Index n = 0;
    for (int trial = 0; trial < kTrials; ++trial) {
      const std::vector<Sample> samples =
          views(truth, board_poses(12, 0.7, 100 + trial), 500 + trial);
      const IntrinsicsResult result = calibrated(guessed(truth), samples, one.model);
      REQUIRE(result.status == Status::converged);
      const VectorXd e = errors(result.groups[0], truth);
      n = e.size();
      sum += fixture::dense::weighted_square(e, result.groups[0].solution.covariance);
      noise += result.cameras[0].noise / kTrials;
      CHECK(result.cameras[0].held_out);
    }
    INFO(one.model);
    const double nees = sum / kTrials / static_cast<double>(n);
    CHECK(std::abs(nees - 1) < 4 * std::sqrt(2.0 / (kTrials * static_cast<double>(n))));
    CHECK(noise == Approx(kPixel).epsilon(0.03));
  }
}

TEST_CASE("intrinsics: poses of cameras on one body come out within their sigmas", "[intrinsics]") {
  const Rig truth =
      cameras_on_hand({at({0.1, 0, 0}, {0.3, 0, 1}),
                       at({0.1, 0, 0}, {0.3, 0, 1}) * at({0.12, 0.01, 0}, {0, -0.1, 0.02}),
                       at({0.1, 0, 0}, {0.3, 0, 1}) * at({-0.1, 0, 0.02}, {0, 0.1, 0.5})},
                      Lens::brown_conrady, kBarrel);
  constexpr int kTrials = 12;
  double sum = 0;
  Eigen::Index n = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const std::vector<Sample> samples = views(truth, board_poses(12, 0.7, 30 + trial), 70 + trial);
    const Rig rig = guessed(truth);
    const IntrinsicsResult result = calibrated(rig, samples, "brown_conrady_4");
    REQUIRE(result.groups.size() == 1);
    REQUIRE(result.status == Status::converged);
    const VectorXd e = errors(result.groups[0], truth);
    n = e.size();
    CHECK(n == 3 * 8 + 2 * 6);
    sum += fixture::dense::weighted_square(e, result.groups[0].solution.covariance);
    const Pose off = inverse(truth.sensors[2].link_T_sensor) *
                     calibrated_camera(rig, result, result.cameras[2]).link_T_sensor;
    CHECK(log_se3(off).norm() < 0.01);
  }
  const double nees = sum / kTrials / static_cast<double>(n);
  CHECK(std::abs(nees - 1) < 4 * std::sqrt(2.0 / (kTrials * static_cast<double>(n))));
}

TEST_CASE("intrinsics: cameras that move against each other are calibrated apart", "[intrinsics]") {
  Rig truth = cameras_on_hand({at({0, 0, 0}), at({0.1, 0, 0})}, Lens::pinhole, {});
  const std::vector<Sample> samples = views(truth, board_poses(8, 0.7, 3), 4);
  truth.sensors[1].link = 0;  // on the floor: the wrist turns between them
  const IntrinsicsResult result = calibrated(truth, samples, "pinhole");
  CHECK(result.groups.size() == 2);
  CHECK(calibrated_camera(truth, result, result.cameras[1]).link_T_sensor.translation.x() == 0.1);
}

TEST_CASE("intrinsics: the lens that made the views is chosen", "[intrinsics]") {
  const struct {
    const char* model;
    Lens lens;
    std::vector<double> distortion;
  } cases[] = {{"pinhole", Lens::pinhole, {}},
               {"brown_conrady_4", Lens::brown_conrady, {-0.28, 0.09, 0.0006, -0.0004, 0}},
               {"brown_conrady_4", Lens::brown_conrady, {-0.28, 0.09, 0.003, -0.004, 0}},
               {"brown_conrady_5", Lens::brown_conrady, {-0.4, 0.35, 0.002, -0.003, -0.3}},
               {"kannala_brandt", Lens::kannala_brandt, {0.05, -0.02, 0.005, -0.001}}};
  for (const auto& one : cases) {
    INFO(one.model);
    Rig truth = cameras_on_hand({Pose()}, one.lens, one.distortion);
    const bool fisheye = one.lens == Lens::kannala_brandt;
    truth.sensors[0].parameters[0].values = {380, 385, 322, 236};
    if (fisheye) truth.sensors[0].parameters[0].values = {200, 202, 322, 236};
    const std::vector<Sample> samples = views(truth, board_poses(20, 0.7, 11, fisheye ? 3 : 1), 12);
    const IntrinsicsResult result = calibrated(guessed(truth), samples, "auto");
    REQUIRE(result.cameras[0].trials.size() == lens_models().size());
    for (const LensTrial& t : result.cameras[0].trials)
      UNSCOPED_INFO(t.model->name << " " << t.rms << " " << t.held_out << " " << t.worse << " +- "
                                  << t.worse_sigma << " " << t.unusable);
    CHECK(result.cameras[0].model->name == one.model);
  }
}

TEST_CASE("intrinsics: lenses that auto does not try are found by name", "[intrinsics]") {
  const struct {
    const char* model;
    Lens lens;
    std::vector<double> distortion, intrinsics;
  } cases[] = {{"double_sphere", Lens::double_sphere, {-0.2, 0.6}, {150, 152, 322, 236}},
               {"double_sphere", Lens::double_sphere, {0.1, 0.55}, {200, 202, 322, 236}},
               {"unified", Lens::unified, {1.2, -0.05, 0.01, 0.001, -0.001}, {420, 422, 322, 236}}};
  for (const auto& one : cases) {
    Rig truth = cameras_on_hand({Pose()}, one.lens, one.distortion);
    truth.sensors[0].parameters[0].values = one.intrinsics;
    const std::vector<Sample> samples = views(truth, board_poses(20, 0.7, 11, 3), 12);
    const IntrinsicsResult result = calibrated(guessed(truth), samples, one.model);
    INFO(one.model << " " << one.distortion[0]);
    CHECK(result.cameras[0].model->name == one.model);
    CHECK(result.cameras[0].noise == Approx(kPixel).epsilon(0.06));
    // xi, k1 and k2 do nearly the same, and so do two double spheres of positive and negative xi.
    if (one.distortion[0] > 0) continue;
    const Solution& solution = result.groups[0].solution;
    const VectorXd e = errors(result.groups[0], truth);
    CHECK(fixture::dense::weighted_square(e, solution.covariance) / static_cast<double>(e.size()) <
          4);
  }
}

TEST_CASE("intrinsics: where a point appears is known as stated", "[intrinsics]") {
  const Rig truth = cameras_on_hand({Pose()}, Lens::brown_conrady, kBarrel);
  const Matrix3Xd points = target_points(truth.targets[0]);
  const std::vector<Pose> boards = board_poses(10, 0.6, 5);
  const std::vector<Eigen::Vector2d> pixels = {{320, 240}, {60, 50}, {560, 400}, {320, 60}};
  const std::vector<double> distances = {0.3, 0.55, 3, 1e4};
  constexpr int kTrials = 60;
  MatrixXd squared = MatrixXd::Zero(4, 4), stated = MatrixXd::Zero(4, 4);
  for (int trial = 0; trial < kTrials; ++trial) {
    const std::vector<Sample> samples = views(truth, boards, 900 + trial);
    REQUIRE(samples.size() == boards.size());
    const IntrinsicsResult result = calibrated(truth, samples, "brown_conrady_4");
    const Solution& solution = result.groups[0].solution;
    Sensor found = calibrated_camera(truth, result, result.cameras[0]);
    std::vector<Vector3d> true_points, points_found;
    for (size_t i = 0; i < boards.size(); ++i)
      for (int id : samples[i].views[0].ids) {
        true_points.push_back(boards[i] * Vector3d(points.col(id)));
        points_found.push_back(solution.values.targets.at({static_cast<int>(i), 0}) *
                               Vector3d(points.col(id)));
      }
    const Pose moved_camera = fit_points(columns_of(true_points), columns_of(points_found));
    const ProjectionError error(solution, 0);
    for (int q = 0; q < 4; ++q) {
      // A direction near the pixel: the pixel itself is where the true camera sees it.
      const Vector3d direction =
          Vector3d((pixels[q].x() - 319.5) / 480, (pixels[q].y() - 239.5) / 490, 1).normalized();
      for (int d = 0; d < 4; ++d) {
        const Vector3d p = distances[d] * direction;
        const Eigen::Vector2d seen = *pixel_of(truth.sensors[0], p);
        squared(q, d) += (*pixel_of(found, moved_camera * p) - seen).squaredNorm() / kTrials;
        stated(q, d) += error.covariance(seen, distances[d]).trace() / kTrials;
      }
    }
  }
  const MatrixXd ratio = squared.cwiseQuotient(stated);
  INFO(stated.cwiseSqrt() << "\n\n" << ratio);
  CHECK(ratio.minCoeff() > 0.6);
  CHECK(ratio.maxCoeff() < 1.5);
  CHECK(ratio.mean() == Approx(1).epsilon(0.2));
  CHECK(stated(0, 3) > 2 * stated(0, 1));  // best at the boards' distance
}

TEST_CASE("intrinsics: what the views do not determine is told", "[intrinsics]") {
  const Rig truth = cameras_on_hand({Pose()}, Lens::pinhole, {});
  const auto ids = [](const IntrinsicsResult& result) {
    std::string out;
    for (const IntrinsicsNote& note : result.notes) out += note.id + " ";
    return out;
  };
  const IntrinsicsResult one =
      calibrated(truth, views(truth, board_poses(1, 0.5, 1), 2), "pinhole");
  CHECK(one.status == Status::unobservable);
  CHECK(ids(one) == "undetermined ");
  CHECK(one.notes[0].text.find("at least three times") != std::string::npos);
  const IntrinsicsResult parallel =
      calibrated(truth, views(truth, board_poses(8, 0, 1), 2), "pinhole");
  REQUIRE(!parallel.notes.empty());
  CHECK(parallel.notes[0].text.find("parallel") != std::string::npos);
  const IntrinsicsResult few = calibrated(truth, views(truth, board_poses(2, 0.6, 1), 2), "auto");
  CHECK(ids(few).find("model") != std::string::npos);
  CHECK(few.cameras[0].model->name == "pinhole");
  CHECK_THROWS_WITH(calibrated(truth, {}, "auto"), Catch::Contains("no camera of the rig sees"));
  CHECK_THROWS_WITH(calibrated(truth, {}, "fish"), Catch::Contains("no lens 'fish'"));
}

TEST_CASE("intrinsics: corners are counted where they are", "[intrinsics]") {
  const Rig truth = cameras_on_hand({Pose()}, Lens::pinhole, {});
  const std::vector<Sample> samples = views(truth, board_poses(4, 0.5, 1), 2);
  const IntrinsicsResult result = calibrated(truth, samples, "pinhole");
  const Grid& grid = result.cameras[0].coverage;
  long all = 0, top_left = 0;
  for (const Sample& sample : samples)
    for (size_t k = 0; k < sample.views[0].z.size(); k += 2) {
      ++all;
      top_left += sample.views[0].z[k] < 319.5 && sample.views[0].z[k + 1] < 239.5;
    }
  double sum = 0, corner = 0;
  for (int r = 0; r < grid.rows; ++r)
    for (int c = 0; c < grid.columns; ++c) {
      sum += grid.values[r * grid.columns + c];
      if (r < grid.rows / 2 && c < grid.columns / 2) corner += grid.values[r * grid.columns + c];
    }
  CHECK(sum == static_cast<double>(all));
  CHECK(corner == static_cast<double>(top_left));
}

TEST_CASE("intrinsics: a bent board is found bent, a flat one is left flat", "[intrinsics]") {
  Rig truth = cameras_on_hand({Pose()}, Lens::brown_conrady, kBarrel);
  const Rig flat = truth;
  truth.targets[0].bulge = warp_shapes(truth.targets[0].layout);
  truth.targets[0].warp = {0.0012, -0.0007};
  IntrinsicsOptions options;
  options.model = "brown_conrady_4";
  options.warp = true;
  constexpr int kTrials = 12;
  double sum = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const std::vector<Sample> samples = views(truth, board_poses(14, 0.7, 40 + trial), 80 + trial);
    const IntrinsicsResult result = *calibrate_intrinsics(guessed(flat), samples, options);
    REQUIRE(result.groups[0].warp);
    CHECK(result.groups[0].warp->kept);
    CHECK(result.groups[0].warp->warped < 0.9 * result.groups[0].warp->flat);
    const VectorXd e = errors(result.groups[0], truth);
    REQUIRE(e.size() == 10);
    sum += fixture::dense::weighted_square(e, result.groups[0].solution.covariance);
  }
  CHECK(std::abs(sum / kTrials / 10 - 1) < 4 * std::sqrt(2.0 / (kTrials * 10)));
  const IntrinsicsResult result =
      *calibrate_intrinsics(guessed(flat), views(flat, board_poses(14, 0.7, 40), 80), options);
  REQUIRE(result.groups[0].warp);
  CHECK(!result.groups[0].warp->kept);
}

TEST_CASE("intrinsics: derivatives by a board's shape are those of differences", "[intrinsics]") {
  // Spacing, warp and print, all away from their nominal values.
  Rig rig = cameras_on_hand({Pose()}, Lens::brown_conrady, kBarrel);
  Target& board = rig.targets[0];
  board.bulge = warp_shapes(board.layout);
  CHECK(board.bulge.maxCoeff() <= 1);
  CHECK(board.bulge.col(0).norm() == 0);  // a corner stays
  board.print.emplace(0, 0);
  const std::vector<int> ids = {0, 3, 17, 34, 69};
  const ParameterTable table(rig);
  const std::vector<double> z(3 * ids.size(), 0.0);
  const std::shared_ptr<const SensorModel> chain = make_chain();
  VectorXd shape(5);
  shape << board.square, 0.002, 0.001, 0.02, -0.03;
  const VectorXd steps = (VectorXd(5) << 1e-7, 1e-6, 1e-6, 1e-6, 1e-6).finished();
  for (const SensorModel* model : {rig.sensors[0].model.get(), chain->point_form()}) {
    ViewInput in;
    in.sensor_T_target = at({-0.1, -0.05, 0.6}, {0.3, -0.4, 0.2});
    in.parameters = table.initial.data() + table.all[table.sensor_block[0]].start;
    in.bulge = &board.bulge;
    in.ids = ids.data();
    in.count = static_cast<int>(ids.size());
    in.z = z.data();
    Columns columns;
    columns.square = 6;
    columns.warp = 7;
    columns.print = 9;
    columns.total = 11;
    const auto residuals = [&](const VectorXd& by, RowMatrix* rows) {
      board.square = by(0);
      board.warp = by.segment<2>(1);
      board.print = by.tail<2>();
      const Matrix3Xd points = target_points(board), plain = board.square * board.layout;
      Matrix3Xd layout = board.layout;
      layout.topRows<2>() = print_map(*board.print) * board.layout.topRows<2>();
      in.points = &points;
      in.plain = &plain;
      in.layout = &layout;
      VectorXd r(model->rows() * in.count);
      if (rows) *rows = RowMatrix::Zero(r.size(), 11);
      if (rows) {
        Eigen::Ref<RowMatrix> l(*rows);
        REQUIRE(model->evaluate(in, columns, r.data(), &l));
      } else {
        REQUIRE(model->evaluate(in, columns, r.data(), nullptr));
      }
      return r;
    };
    RowMatrix rows;
    residuals(shape, &rows);
    for (int k = 0; k < 5; ++k) {
      VectorXd above = shape, below = shape;
      above(k) += steps(k);
      below(k) -= steps(k);
      const VectorXd difference =
          (residuals(above, nullptr) - residuals(below, nullptr)) / (2 * steps(k));
      INFO("component " << k);
      CHECK((difference - rows.col(6 + k)).norm() < 1e-6 * (1 + difference.norm()));
    }
  }
}

TEST_CASE("intrinsics: a print's stretch and shear are those of lengths and of the angle") {
  Rig rig = cameras_on_hand({Pose()}, Lens::brown_conrady, kBarrel);
  Target& board = rig.targets[0];
  const auto length = [&](const Matrix3Xd& points, int axis) {  // of the board's diagonal part
    return points.row(axis).maxCoeff() - points.row(axis).minCoeff();
  };
  const Matrix3Xd to_scale = target_points(board);
  board.print.emplace(0.01, 0);
  CHECK(length(target_points(board), 0) == Approx(1.005 * length(to_scale, 0)));
  CHECK(length(target_points(board), 1) == Approx(0.995 * length(to_scale, 1)));
  board.print.emplace(0, 0.01);
  const Eigen::Matrix2d sheared = print_map(*board.print);
  CHECK(std::acos(sheared.col(0).dot(sheared.col(1)) / sheared.col(0).norm() /
                  sheared.col(1).norm()) == Approx(kPi / 2 - 0.01).epsilon(1e-5));
  const ParameterTable table(rig);
  REQUIRE(table.target_print[0] >= 0);
  CHECK((target_points(rig, table, table.initial, 0) - target_points(board)).norm() == 0);
}

TEST_CASE("intrinsics: views of another lens, and turned pictures, are named", "[intrinsics]") {
  // What is too small to be seen is not named, and pulls the lens: a principal point 5 px off the
  // middle turned in two of five views by up to 8 sigmas in the one of 20 that is missed, and a
  // focal length that is another by 1 % by 6. That is a limit of the method, not of the test.
  const struct {
    double focal,
        off;  // of the second lens, in those of the first; the principal point's place, px
    bool turned;
    int fewest;  // named, of 20
  } cases[] = {{1, 0, false, 0}, {1, 20, false, 0},    {1, 20, true, 20},
               {1, 5, true, 15}, {1.01, 10, false, 0}, {1.1, 10, false, 20}};
  for (const auto& one : cases) {
    Rig truth = cameras_on_hand({at({0.1, 0, 0})}, Lens::brown_conrady, kBarrel);
    std::vector<double>& lens = truth.sensors[0].parameters[0].values;
    lens[2] = 319.5 + one.off, lens[3] = 239.5 - 0.6 * one.off;
    Rig other = truth;
    for (int k = 0; k < 2; ++k) other.sensors[0].parameters[0].values[k] *= one.focal;
    const bool mixed = one.turned || one.focal != 1;
    int named = 0;
    double worst = 0;
    for (int trial = 0; trial < 20; ++trial) {
      const std::vector<Pose> boards = board_poses(20, 0.7, 900 + trial);
      std::vector<Sample> samples = views(truth, boards, 300 + trial);
      const std::vector<Sample> second = views(other, boards, 300 + trial);
      REQUIRE(samples.size() == second.size());
      std::string fewer;
      for (size_t i = 0; mixed && i < samples.size(); ++i) {
        if (i % 5 > 1) continue;  // two of five
        samples[i] = second[i];
        std::vector<double>& z = samples[i].views[0].z;
        for (size_t k = 0; one.turned && k < z.size(); ++k) z[k] = (k % 2 ? 479 : 639) - z[k];
        fewer += fewer.empty() ? "'" + samples[i].id + "'" : "";
      }
      const IntrinsicsResult result = calibrated(guessed(truth), samples, "brown_conrady_4");
      bool said = false;
      for (const IntrinsicsNote& note : result.notes)
        if (note.id == (one.turned ? "turned" : "two_lenses")) {
          said = true;
          if (one.off > 5)
            CHECK(note.text.find("8 of 20 views (sample " + fewer) != std::string::npos);
          CHECK(result.status == Status::unexplained);
        } else {
          CHECK(note.id == "never");
        }
      named += said;
      const VectorXd e = errors(result.groups[0], truth);
      for (Eigen::Index i = 0; !said && i < e.size(); ++i)
        worst =
            std::max(worst, std::abs(e(i)) / std::sqrt(result.groups[0].solution.covariance(i, i)));
    }
    INFO(one.focal << " " << one.off << " " << one.turned << " worst " << worst);
    CHECK(named >= one.fewest);
    CHECK(named <= (mixed ? 20 : 0));
    CHECK(worst < (one.fewest == 20 || !mixed ? 4 : 9));
  }
}

}  // namespace intrinsics_test
