// models/sensors/sensors.h: every sensor as the contract of models/sensors/sensor.h states it.
//
// Proves, sensor by sensor: L agrees entry by entry with central differences of r (1e-7 of the
// column's scale), for every group of columns (pose or "behind", sensor's side, joint, own
// parameters, square, points), wherever in L the groups stand and whichever are absent; at random
// poses, next to the identity, next to half a turn, on the optical axis and 1e-10 beside it.
// Cameras' pixels equal formulas coded here; what is behind a camera is refused; own noise equals
// the numeric derivative of the ray's point. A sensor made as the head of sensor.h describes works.
// Does not prove: that a view's J = L M (models/estimation/estimation_test.cpp), nor that what a
// sensor is given is the right pose.
#include <catch2/catch.hpp>
#include <functional>

#include "../../../models/sensors/check_jacobian.h"
#include "../../../models/sensors/pose.h"
#include "../../../models/sensors/sensors.h"
#include "../../../models/sensors/surface.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/transforms.h"

namespace sensors_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// All that a ViewInput points to, and where the columns of L shall be.
struct Stage {
  std::shared_ptr<const SensorModel> owner;
  const SensorModel* model = nullptr;
  Pose pose;
  mutable std::optional<Scan> scan;
  std::vector<double> joint;  // numbers of the scanning joint: offset, scale
  std::vector<double> parameters;
  Eigen::Matrix3Xd points, layout;
  std::vector<int> ids;
  std::vector<double> z;

  ViewInput input() const {
    ViewInput in;
    in.sensor_T_target = pose;
    if (scan) scan->own = joint.data();
    in.scan = scan ? &*scan : nullptr;
    in.parameters = parameters.empty() ? nullptr : parameters.data();
    in.points = &points;
    in.layout = layout.cols() ? &layout : nullptr;
    in.ids = ids.data();
    in.count = static_cast<int>(ids.size());
    in.z = z.empty() ? nullptr : z.data();
    return in;
  }
  int rows() const { return model->blocks(static_cast<int>(ids.size())) * model->rows(); }
  VectorXd residual() const {
    VectorXd r(rows());
    if (!model->evaluate(input(), Columns(), r.data(), nullptr))
      throw std::logic_error("undefined residual");
    return r;
  }
};

Isometry3d turned(const Pose& pose, int component, double h) {
  Vector6d xi = Vector6d::Zero();
  xi(component) = h;
  return exponential(xi) * isometry(pose);
}

/// A number that L has a derivative by: its column and a stage in which it is moved by h.
struct Number {
  std::string name;
  int column;
  std::function<Stage(double)> moved;
  double step;
};

/// Every number, in a layout of columns that starts at 2, has gaps, and stands in an unusual order.
std::vector<Number> numbers(const Stage& s, double step, Columns& c) {
  std::vector<Number> out;
  const bool shape = !s.model->measures_pose();
  c.points = shape ? 2 : -1;
  c.square = shape && s.layout.cols() ? 3 * static_cast<int>(s.points.cols()) + 3 : -1;
  c.pose = 3 * static_cast<int>(s.points.cols()) + 5;
  c.parameters = s.parameters.empty() ? -1 : c.pose + 7;
  c.sensor_side = s.scan ? c.pose + 6 : -1;
  c.joint = s.scan ? c.pose + 13 : -1;
  c.total = c.pose + 30;
  for (int k = 0; k < 6; ++k) {
    out.push_back({"pose " + std::to_string(k), c.pose + k,
                   [&s, k](double h) {
                     Stage m = s;
                     if (m.scan)
                       m.scan->behind_T_target = to_pose(turned(s.scan->behind_T_target, k, h));
                     else
                       m.pose = to_pose(turned(s.pose, k, h));
                     return m;
                   },
                   step});
    if (s.scan)
      out.push_back({"sensor's side " + std::to_string(k), c.sensor_side + k,
                     [&s, k](double h) {
                       Stage m = s;
                       m.scan->sensor_T_before = to_pose(turned(s.scan->sensor_T_before, k, h));
                       return m;
                     },
                     step});
  }
  if (s.scan) {
    out.push_back({"joint offset", c.joint,
                   [&s](double h) {
                     Stage m = s;
                     m.joint[0] += h;
                     return m;
                   },
                   step});
    out.push_back({"joint scale", c.joint + 1,
                   [&s](double h) {
                     Stage m = s;
                     m.joint[1] += h;
                     return m;
                   },
                   step});
  }
  for (size_t k = 0; k < s.parameters.size(); ++k)
    out.push_back({"parameter " + std::to_string(k), c.parameters + static_cast<int>(k),
                   [&s, k](double h) {
                     Stage m = s;
                     m.parameters[k] += h;
                     return m;
                   },
                   1e-3});
  if (c.square >= 0)
    out.push_back({"square", c.square,
                   [&s](double h) {
                     Stage m = s;
                     m.points += h * s.layout;
                     return m;
                   },
                   1e-3});
  for (Eigen::Index k = 0; shape && k < s.points.size(); ++k)
    out.push_back({"point " + std::to_string(k / 3) + "." + std::to_string(k % 3),
                   c.points + static_cast<int>(k),
                   [&s, k](double h) {
                     Stage m = s;
                     m.points.data()[k] += h;
                     return m;
                   },
                   step});
  return out;
}

/// Each entry of L against central differences; columns of nobody stay as they were.
void check_derivatives(const Stage& s, double step = 1e-3, double tolerance = 1e-7) {
  Columns c;
  const std::vector<Number> all = numbers(s, step, c);
  const int n = s.rows();
  RowMatrix rows = RowMatrix::Zero(n, c.total);
  VectorXd r(n);
  Eigen::Ref<RowMatrix> l(rows);
  REQUIRE(s.model->evaluate(s.input(), c, r.data(), &l));
  CHECK(r == s.residual());  // the same to the bit with and without derivatives
  std::vector<char> used(c.total, 0);
  for (const Number& x : all) {
    used[x.column] = 1;
    const VectorXd numeric = derivative([&](double h) { return x.moved(h).residual(); }, x.step);
    const double scale = numeric.cwiseAbs().maxCoeff(),
                 rounding = 2e-15 * (1 + r.cwiseAbs().maxCoeff()) / x.step;
    const VectorXd analytic = rows.col(x.column);
    for (int i = 0; i < n; ++i) {
      INFO(x.name << ", row " << i << ": " << analytic(i) << " against " << numeric(i)
                  << ", column scale " << scale);
      CHECK(std::abs(analytic(i) - numeric(i)) < tolerance * scale + rounding);
    }
  }
  for (int k = 0; k < c.total; ++k)
    if (!used[k]) CHECK(rows.col(k).isZero(0));

  Columns few;  // only the pose
  few.pose = 0;
  few.sensor_side = s.scan ? 6 : -1;
  few.total = s.scan ? 12 : 6;
  RowMatrix short_rows = RowMatrix::Zero(n, few.total);
  Eigen::Ref<RowMatrix> short_l(short_rows);
  REQUIRE(s.model->evaluate(s.input(), few, r.data(), &short_l));
  CHECK(short_rows.leftCols(6) == rows.middleCols(c.pose, 6));
  if (s.scan) CHECK(short_rows.rightCols(6) == rows.middleCols(c.sensor_side, 6));
}

/// A 2 x 3 grid of 5 cm, of which four points are seen.
void set_grid(Stage& s) {
  s.layout.resize(3, 6);
  for (int i = 0; i < 6; ++i) {
    const int row = i / 3;
    s.layout.col(i) << i % 3, row, 0;
  }
  s.points = 0.05 * s.layout;
  s.ids = {4, 0, 2, 5};
}

struct Lensed {
  std::string name;
  Lens lens;
  std::vector<double> distortion;
  double baseline;
};
const std::vector<Lensed> kCameras = {
    {"pinhole", Lens::pinhole, {}, 0},
    {"pinhole, baseline", Lens::pinhole, {}, 0.12},
    {"brown_conrady, 5", Lens::brown_conrady, {-0.23, 0.09, 0.002, -0.003, 0.011}, -0.06},
    {"brown_conrady, 8",
     Lens::brown_conrady,
     {0.31, -0.12, -0.002, 0.001, 0.03, 0.42, 0.11, 0.02},
     0.05},
    {"brown_conrady, 12",
     Lens::brown_conrady,
     {0.31, -0.12, -0.002, 0.001, 0.03, 0.42, 0.11, 0.02, 0.003, -0.001, -0.002, 0.004},
     -0.05},
    {"brown_conrady, 14",
     Lens::brown_conrady,
     {0.31, -0.12, -0.002, 0.001, 0.03, 0.42, 0.11, 0.02, 0.003, -0.001, -0.002, 0.004, 0.06,
      -0.09},
     0.05},
    {"unified, mirror", Lens::unified, {1.7, -0.12, 0.05, 0.002, -0.003}, 0.04},
    {"unified, fisheye", Lens::unified, {0.8, 0.05, -0.02, -0.001, 0.002}, 0.04},
    {"double_sphere", Lens::double_sphere, {-0.27, 0.57}, 0.04},
    {"double_sphere, alpha below a half", Lens::double_sphere, {0.15, 0.4}, 0.04},
    {"kannala_brandt", Lens::kannala_brandt, {0.03, -0.012, 0.004, -0.0007}, 0.04},
};

/// The angle from the axis up to which a lens sees: where its image ends or turns back.
double widest(const Lensed& camera) {
  const std::vector<double>& d = camera.distortion;
  if (camera.lens == Lens::kannala_brandt) return kPi;
  if (camera.lens == Lens::unified) return std::acos(-(d[0] > 1 ? 1 / d[0] : d[0]));
  if (camera.lens != Lens::double_sphere) return kPi / 2;
  // The first sphere's angle by that of the second one: t - t2 = asin(xi sin(t2)), where the second
  // is seen up to cos(t2) = -w1.
  const double w1 = d[1] > 0.5 ? (1 - d[1]) / d[1] : d[1] / (1 - d[1]), t2 = std::acos(-w1);
  return t2 + std::asin(d[0] * std::sin(t2));
}

bool sees_sideways(const Lensed& camera) { return widest(camera) > kPi / 2 + 1e-9; }

Stage camera_stage(const Lensed& camera, Random& random) {
  Stage s;
  s.owner = make_camera(camera.lens, static_cast<int>(camera.distortion.size()));
  s.model = s.owner.get();
  for (const ParameterBlock& b :
       camera_parameters(camera.lens, {420, 430, 310.5, 244}, camera.distortion, camera.baseline))
    s.parameters.insert(s.parameters.end(), b.values.begin(), b.values.end());
  set_grid(s);
  s.pose = {random.rotation(1.2), Vector3d(random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3),
                                           random.uniform(0.5, 1.2))};
  for (int i = 0; i < 8; ++i) s.z.push_back(random.uniform(0, 500));
  return s;
}

Sensor camera_sensor(const Lensed& camera) {
  Sensor s;
  s.parameters =
      camera_parameters(camera.lens, {420, 430, 310.5, 244}, camera.distortion, camera.baseline);
  return s;
}

Stage laser_stage(Random& random, bool prismatic, int direction) {
  Stage s;
  s.owner = make_tilting_laser();
  s.model = s.owner.get();
  set_grid(s);
  Scan scan;
  scan.sensor_T_before = random.pose(0.3, 3);
  scan.behind_T_target = random.pose(1.5, 3);
  scan.axis = random.direction();
  scan.prismatic = prismatic;
  scan.direction = direction;
  scan.model = linear_joint().get();
  s.joint = {random.uniform(-0.2, 0.2), 0};
  s.joint[1] = random.uniform(0.8, 1.2);
  s.scan = scan;
  for (int i = 0; i < 4; ++i) {
    s.z.push_back(random.uniform(-1, 1));
    s.z.push_back(random.uniform(-2, 2));
    s.z.push_back(random.uniform(0.5, 3));
  }
  return s;
}

/// far_T_sensor of a scan at a reading, far: the other side of the joint.
Isometry3d far_T_sensor(const Stage& s, double reading) {
  const Scan& scan = *s.scan;
  const double q = scan.direction * (s.joint[1] * reading + s.joint[0]);
  Isometry3d motion = Isometry3d::Identity();
  if (scan.prismatic)
    motion = Eigen::Translation3d(q * scan.axis);
  else
    motion = Eigen::AngleAxisd(q, scan.axis);
  return (isometry(scan.sensor_T_before) * motion).inverse();
}

Stage pose_stage(bool measures, const Isometry3d& error, Random& random) {
  Stage s;
  s.owner = measures ? make_pose() : make_chain();
  s.model = s.owner.get();
  set_grid(s);
  s.ids.clear();
  Isometry3d z = Isometry3d::Identity();
  if (measures) {
    z = isometry(random.pose(1, 3));
    const Eigen::Quaterniond q(z.linear());
    s.z = {
        z.translation().x(), z.translation().y(), z.translation().z(), q.x(), q.y(), q.z(), q.w()};
  }
  s.pose = to_pose(z * error);
  return s;
}

Isometry3d error_of(double translation, double angle, Random& random) {
  Isometry3d e = Isometry3d::Identity();
  e.linear() = Eigen::AngleAxisd(angle, random.direction()).toRotationMatrix();
  e.translation() = random.vector(translation);
  return e;
}

}  // namespace

TEST_CASE("sensors tell what they are") {
  for (const Lensed& camera : kCameras) {
    const auto model = make_camera(camera.lens, static_cast<int>(camera.distortion.size()));
    CHECK(model->rows() == 2);
    CHECK(model->measurement_size() == 2);
    CHECK(model->sigmas() == 2);
    CHECK(std::string(model->unit()) == "px");
    CHECK(model->measurement_kind() == MeasurementKind::rays);
    CHECK_FALSE(model->measures_pose());
    CHECK_FALSE(model->scans());
    CHECK_FALSE(model->has_own_noise());
    CHECK(model->point_form() == nullptr);
    CHECK(model->blocks(7) == 7);
  }
  const auto point = make_point(), pose = make_pose(), chain = make_chain(),
             laser = make_tilting_laser();
  CHECK((point->rows() == 3 && point->measurement_size() == 3 &&
         point->measurement_kind() == MeasurementKind::points && point->blocks(4) == 4));
  CHECK((pose->rows() == 6 && pose->measurement_size() == 7 && pose->sigmas() == 6 &&
         pose->measures_pose() && pose->blocks(9) == 1));
  CHECK(pose->measurement_kind() == MeasurementKind::pose);
  CHECK(pose->point_form() == nullptr);
  CHECK((chain->rows() == 6 && chain->measurement_size() == 0 && chain->sigmas() == 6 &&
         chain->measures_pose() && chain->blocks(9) == 1));
  CHECK(chain->measurement_kind() == MeasurementKind::chain);
  REQUIRE(chain->point_form());
  CHECK((chain->point_form()->rows() == 3 && chain->point_form()->sigmas() == 6 &&
         chain->point_form()->blocks(9) == 9));
  CHECK(chain->point_form()->has_own_noise());
  CHECK((laser->rows() == 3 && laser->measurement_size() == 3 && laser->sigmas() == 3 &&
         laser->scans() && laser->has_own_noise()));
  CHECK(laser->measurement_kind() == MeasurementKind::scan);
  CHECK(std::string(laser->unit()) == "m");
  CHECK_THROWS_AS(make_camera(Lens::brown_conrady, 4), std::invalid_argument);
  CHECK_THROWS_AS(make_camera(Lens::kannala_brandt, 5), std::invalid_argument);
  CHECK_THROWS_AS(make_camera(Lens::pinhole, 1), std::invalid_argument);
  for (const int count : {4, 6, 9, 13, 15})
    CHECK_THROWS_AS(make_camera(Lens::brown_conrady, count), std::invalid_argument);
  CHECK_THROWS_AS(make_camera(Lens::unified, 1), std::invalid_argument);
  CHECK_THROWS_AS(make_camera(Lens::double_sphere, 5), std::invalid_argument);
}

TEST_CASE("cameras: parameters by name") {
  const auto blocks =
      camera_parameters(Lens::brown_conrady, {1, 2, 3, 4}, {5, 6, 7, 8, 9, 10, 11, 12}, 13);
  REQUIRE(blocks.size() == 3);
  CHECK(blocks[0].name == "intrinsics");
  CHECK(blocks[0].components == std::vector<std::string>{"fx", "fy", "cx", "cy"});
  CHECK(blocks[1].name == "distortion");
  CHECK(blocks[1].components ==
        std::vector<std::string>{"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"});
  CHECK(blocks[2].name == "baseline");
  CHECK(blocks[2].units == std::vector<std::string>{"m"});
  CHECK(blocks[2].values == std::vector<double>{13});
  CHECK(camera_parameters(Lens::kannala_brandt, {1, 2, 3, 4}, {5, 6, 7, 8}, 0)[1].components ==
        std::vector<std::string>{"k1", "k2", "k3", "k4"});
  CHECK(camera_parameters(Lens::pinhole, {1, 2, 3, 4}, {}, 0).size() == 2);
  const auto tilted =
      camera_parameters(Lens::brown_conrady, {1, 2, 3, 4}, std::vector<double>(14, 0), 0)[1];
  CHECK(tilted.components == std::vector<std::string>{"k1", "k2", "p1", "p2", "k3", "k4", "k5",
                                                      "k6", "s1", "s2", "s3", "s4", "tau_x",
                                                      "tau_y"});
  CHECK((tilted.units[11].empty() && tilted.units[12] == "rad" && tilted.units[13] == "rad"));
  for (const LensType& type : lens_types())
    for (const int count : type.counts) {  // the names tell the lens
      const auto numbers =
          camera_parameters(type.lens, {1, 2, 3, 4}, std::vector<double>(count), 0);
      CHECK(lens_type(numbers).lens == type.lens);
      CHECK(lens_type(type.lens).name == std::string(type.name));
      CHECK_NOTHROW(make_camera(type.lens, count));
    }
  auto other = camera_parameters(Lens::kannala_brandt, {1, 2, 3, 4}, {5, 6, 7, 8}, 0);
  other[1].components[2] = "k9";
  CHECK_THROWS_AS(lens_type(other), std::invalid_argument);
}

TEST_CASE("cameras: pixels as the formats' formulas give them") {
  Random random(11);
  for (const Lensed& camera : kCameras) {
    const Sensor reference = camera_sensor(camera);
    for (int trial = 0; trial < 50; ++trial) {
      const Stage s = camera_stage(camera, random);
      const VectorXd r = s.residual();
      for (size_t i = 0; i < s.ids.size(); ++i) {
        Vector2d pixel;
        REQUIRE(project(reference, isometry(s.pose) * Vector3d(s.points.col(s.ids[i])), pixel));
        INFO(camera.name << ", trial " << trial << ", point " << i);
        CHECK(std::abs(r(2 * i) - (pixel.x() - s.z[2 * i])) < 1e-9);
        CHECK(std::abs(r(2 * i + 1) - (pixel.y() - s.z[2 * i + 1])) < 1e-9);
      }
    }
  }
}

TEST_CASE("cameras: derivatives at random poses") {
  Random random(12);
  for (const Lensed& camera : kCameras)
    for (int trial = 0; trial < 10; ++trial) {
      INFO(camera.name << ", trial " << trial);
      check_derivatives(camera_stage(camera, random));
    }
}

TEST_CASE("cameras: derivatives at a target whose frame is the camera's, but for 1e-8") {
  Random random(13);
  for (const Lensed& camera : kCameras) {
    Stage s = camera_stage(camera, random);
    s.points.row(2).array() += 0.8;  // so the points are in front of the camera
    s.pose = {Eigen::AngleAxisd(1e-8, random.direction()).toRotationMatrix(), random.vector(1e-8)};
    INFO(camera.name);
    check_derivatives(s);
  }
}

TEST_CASE("cameras: derivatives on the optical axis and beside it") {
  Random random(14);
  for (const Lensed& camera : kCameras)
    for (const double rho : {0.0, 1e-300, 1e-160, 1e-14, 1e-10, 1e-9, 1.1e-9, 1e-7, 1e-5, 1e-4}) {
      Stage s = camera_stage(camera, random);
      s.points.col(0).setZero();
      s.layout.resize(3, 0);
      s.ids = {0};
      s.z.resize(2);
      const double angle = random.uniform(-kPi, kPi);
      s.pose.translation << camera.baseline, 0, 0.9;
      s.pose.translation.head<2>() += rho * Vector2d(std::cos(angle), std::sin(angle));
      INFO(camera.name << ", rho " << rho);
      // Of five-point differences with a step of 1e-3 of a function that is smooth there.
      Columns c;
      const VectorXd r = s.residual();
      CHECK(r.allFinite());
      check_derivatives(s, 1e-3, 3e-7);
    }
}

TEST_CASE("fisheyes: beyond 90 degrees, pixels and derivatives") {
  Random random(15);
  for (const Lensed& camera : kCameras) {
    if (!sees_sideways(camera)) continue;
    const Sensor reference = camera_sensor(camera);
    for (const double degrees : {85.0, 89.9999, 90.0, 95.0, 120.0, 150.0, 170.0}) {
      if (degrees * kPi / 180 > widest(camera) - 0.15) continue;
      Stage s = camera_stage(camera, random);
      const double t = degrees * kPi / 180, angle = random.uniform(-kPi, kPi);
      s.pose.translation =
          1.5 * Vector3d(std::sin(t) * std::cos(angle), std::sin(t) * std::sin(angle), std::cos(t));
      s.pose.translation.x() += camera.baseline;
      Vector2d pixel;
      REQUIRE(project(reference, s.pose.translation, pixel));
      INFO(camera.name << ", " << degrees << " degrees");
      s.ids = {0};  // at the target's origin; the others may be where the lens sees nothing
      s.z.resize(2);
      CHECK(std::abs(s.residual()(0) + s.z[0] - pixel.x()) < 1e-8);
      CHECK(std::abs(s.residual()(1) + s.z[1] - pixel.y()) < 1e-8);
      check_derivatives(s, degrees > 160 || camera.lens != Lens::kannala_brandt ? 2e-4 : 1e-3);
    }
  }
}

TEST_CASE("cameras: defined up to where they see, and one to one there") {
  Random random(24);
  for (const Lensed& camera : kCameras) {
    if (camera.lens == Lens::kannala_brandt) continue;  // all around
    Stage s = camera_stage(camera, random);
    s.ids = {0};
    s.points.col(0).setZero();
    s.layout.resize(3, 0);
    s.z = {0, 0};
    const double limit = widest(camera);
    const auto radius = [&](double t) {  // of the image at an angle from the axis; -1: undefined
      s.pose = {Matrix3d::Identity(), Vector3d(std::sin(t) + camera.baseline, 0, std::cos(t))};
      VectorXd r(2);
      if (!s.model->evaluate(s.input(), Columns(), r.data(), nullptr)) return -1.0;
      return std::hypot(r(0) - 310.5, r(1) - 244);
    };
    INFO(camera.name << ", up to " << limit);
    if (camera.distortion.size() != 14) CHECK(radius(limit - 1e-6) >= 0);  // else of the tilt, too
    CHECK(radius(limit + 1e-6) < 0);
    if (camera.lens == Lens::brown_conrady || camera.lens == Lens::pinhole) continue;
    for (double& k : s.parameters)  // without radtan, of which no end is known
      if (camera.lens == Lens::unified && &k > &s.parameters[4] && &k < &s.parameters[9]) k = 0;
    double before = -1;
    for (int i = 0; i < 200; ++i) {
      const double now = radius((limit - 1e-6) * i / 199);
      CHECK(now > before);
      before = now;
    }
  }
}

TEST_CASE("cameras: what is behind them is refused") {
  Random random(16);
  for (const Lensed& camera : kCameras) {
    INFO(camera.name);
    Stage s = camera_stage(camera, random);
    VectorXd r(s.rows());
    RowMatrix rows = RowMatrix::Zero(s.rows(), 6);
    Eigen::Ref<RowMatrix> l(rows);
    const auto defined = [&](const Vector3d& origin) {
      s.pose = {Matrix3d::Identity(), origin};
      const bool without = s.model->evaluate(s.input(), Columns(), r.data(), nullptr);
      const bool with = s.model->evaluate(s.input(), Columns(), r.data(), &l);
      CHECK(with == without);
      return without;
    };
    const bool fisheye = sees_sideways(camera);
    CHECK(defined({0.3, 0.2, 0.5}));
    CHECK(defined({0.3, 0.2, -0.5}) == (camera.lens == Lens::kannala_brandt));
    CHECK(defined({0.3, 0.2, 0}) == fisheye);
    CHECK_FALSE(defined({camera.baseline, 0, -0.5}));  // id 0 at the point opposite to +z
    CHECK_FALSE(defined({camera.baseline, 0, 0}));     // in the very centre
    s.pose = {rpy(0, 1.2, 0), Vector3d(0, 0, 0.05)};   // only the far column of the grid is behind
    CHECK(s.model->evaluate(s.input(), Columns(), r.data(), nullptr) ==
          (camera.lens == Lens::kannala_brandt));
  }
}

TEST_CASE("point: value and derivatives") {
  Random random(17);
  Stage s;
  s.owner = make_point();
  s.model = s.owner.get();
  set_grid(s);
  for (int i = 0; i < 12; ++i) s.z.push_back(random.uniform(-1, 1));
  for (int trial = 0; trial < 6; ++trial) {
    s.pose = trial == 0   ? Pose()
             : trial == 1 ? to_pose(error_of(1e-8, 1e-8, random))
             : trial == 2 ? to_pose(error_of(1, kPi, random))
                          : random.pose(2, 3);
    const VectorXd r = s.residual();
    for (int i = 0; i < 4; ++i)
      CHECK((r.segment<3>(3 * i) - (isometry(s.pose) * Vector3d(s.points.col(s.ids[i])) -
                                    Vector3d(s.z[3 * i], s.z[3 * i + 1], s.z[3 * i + 2])))
                .norm() < 1e-14);
    check_derivatives(s);
  }
}

TEST_CASE("point with a range: value, derivatives, the sensor's origin") {
  Random random(25);
  Stage s;
  s.owner = make_ranged_point();
  s.model = s.owner.get();
  CHECK((s.model->rows() == 3 && s.model->measurement_kind() == MeasurementKind::points));
  set_grid(s);
  for (int i = 0; i < 12; ++i) s.z.push_back(random.uniform(-1, 1));
  for (const std::vector<double>& numbers :
       {std::vector<double>{1, 0}, {1.02, 0.015}, {0.97, -0.03}}) {
    s.parameters = numbers;
    for (int trial = 0; trial < 5; ++trial) {
      s.pose = random.pose(1, 3);
      s.pose.translation.z() += 2;
      const VectorXd r = s.residual();
      for (int i = 0; i < 4; ++i) {
        const Vector3d p = isometry(s.pose) * Vector3d(s.points.col(s.ids[i]));
        const Vector3d seen = p.normalized() * (numbers[0] * p.norm() + numbers[1]);
        CHECK((r.segment<3>(3 * i) - (seen - Vector3d(s.z[3 * i], s.z[3 * i + 1], s.z[3 * i + 2])))
                  .norm() < 1e-14);
      }
      check_derivatives(s);
    }
  }
  // A tip in the sensor's own origin has no ray: it measures 0 where no offset says otherwise.
  s.ids = {0};
  s.z.resize(3);
  s.pose = Pose();
  VectorXd r(3);
  CHECK_FALSE(s.model->evaluate(s.input(), Columns(), r.data(), nullptr));
  s.parameters = {1.02, 0};
  REQUIRE(s.model->evaluate(s.input(), Columns(), r.data(), nullptr));
  CHECK(r == -Eigen::Map<const VectorXd>(s.z.data(), 3));
}

TEST_CASE("surface: value and derivatives") {
  Random random(26);
  const std::shared_ptr<const SensorModel> model = make_surface();
  CHECK((model->rows() == 1 && model->measurement_size() == 3 && model->sigmas() == 1 &&
         sees_surfaces(*model) && !sees_surfaces(*make_point())));
  for (int trial = 0; trial < 20; ++trial) {
    const Pose pose = random.pose(1.5, 3);
    Eigen::Matrix3Xd origin = Vector3d::Zero();
    if (trial % 2) origin << 0.3, -0.2, 0;  // any point of the plane does
    const std::vector<int> ids = {0, 0, 0, 0};
    std::vector<double> z;
    for (int i = 0; i < 12; ++i) z.push_back(random.uniform(-1, 1));
    ViewInput in;
    in.sensor_T_target = pose;
    in.points = &origin;
    in.ids = ids.data();
    in.count = 4;
    in.z = z.data();
    VectorXd r(4);
    REQUIRE(model->evaluate(in, Columns(), r.data(), nullptr));
    for (int i = 0; i < 4; ++i) {
      const Vector3d in_plane =
          isometry(pose).inverse() * Vector3d(z[3 * i], z[3 * i + 1], z[3 * i + 2]);
      CHECK(std::abs(r(i) + in_plane.z()) < 1e-14);
    }
    CHECK(check_jacobian(*model, in) < 1e-8);
  }
}

TEST_CASE(
    "pose and chain: value and derivatives at random, next to the identity and next to half a "
    "turn") {
  Random random(18);
  for (const bool measures : {true, false})
    for (int trial = 0; trial < 5; ++trial)
      for (const double angle :
           {0.0, 1e-12, 1e-8, 1e-4, 0.7, 2.2, 3.0, kPi - 1e-3, kPi - 1e-5, kPi - 1e-7}) {
        const Isometry3d e = error_of(angle < 1e-3 ? angle : 0.5, angle, random);
        const Stage s = pose_stage(measures, e, random);
        const VectorXd r = s.residual();
        INFO((measures ? "pose" : "chain") << ", angle " << angle);
        CHECK((r.head<3>() - e.translation()).norm() < 1e-14 + 1e-15);
        CHECK(std::abs(r.tail<3>().norm() - angle) < 2e-15 + 1e-8 * (angle > kPi - 1e-6));
        if (angle > 1e-3) CHECK((r.tail<3>() - rotation_vector(e.linear())).norm() < 1e-12);
        // The Log jumps at half a turn: steps stay on this side.
        const double room = kPi - angle;
        check_derivatives(s, std::min(1e-3, room / 4),
                          room < 1e-6   ? 1e-4
                          : room < 1e-4 ? 1e-6
                                        : 1e-7);
      }
}

TEST_CASE("pose with a scale: value and derivatives") {
  Random random(27);
  const std::shared_ptr<const SensorModel> model = make_scaled_pose();
  CHECK((model->rows() == 6 && model->measurement_kind() == MeasurementKind::pose));
  for (const double scale : {1.0, 1.05, 0.4})
    for (int trial = 0; trial < 5; ++trial) {
      Stage s = pose_stage(true, error_of(0.5, 0.7, random), random);
      s.owner = model;
      s.model = model.get();
      s.parameters = {scale};
      Isometry3d longer = isometry(s.pose);
      longer.translation() *= scale;
      Isometry3d z(Eigen::Quaterniond(s.z[6], s.z[3], s.z[4], s.z[5]));
      z.translation() << s.z[0], s.z[1], s.z[2];
      const Isometry3d e = z.inverse() * longer;
      const VectorXd r = s.residual();
      CHECK((r.head<3>() - e.translation()).norm() < 1e-14);
      CHECK((r.tail<3>() - rotation_vector(e.linear())).norm() < 1e-12);
      check_derivatives(s);
      CHECK((measured_pose(s.z.data(), scale).translation * scale - z.translation()).norm() <
            1e-15);
    }
}

TEST_CASE("chain in noise mode point: value, derivatives, own noise") {
  Random random(19);
  for (int trial = 0; trial < 12; ++trial) {
    Stage s = pose_stage(false,
                         trial == 0 ? Isometry3d::Identity()
                                    : error_of(trial == 1 ? 1e-8 : 0.5,
                                               trial == 1   ? 1e-8
                                               : trial == 2 ? kPi - 1e-9
                                                            : 2,
                                               random),
                         random);
    s.model = s.owner->point_form();
    REQUIRE(s.model);
    s.ids = {0, 1, 2, 3, 4, 5};
    if (trial % 2) {
      s.layout.resize(3, 0);
      s.points = s.points.unaryExpr([&](double) { return random.uniform(-0.3, 0.3); }).eval();
      s.ids = {3, 1};
    }
    const VectorXd r = s.residual();
    for (size_t i = 0; i < s.ids.size(); ++i) {
      const Vector3d p = s.points.col(s.ids[i]);
      CHECK((r.segment<3>(3 * static_cast<int>(i)) - (isometry(s.pose) * p - p)).norm() < 1e-14);
      // The grip's error e moves the target to link_T_target exp(e): where that puts the point, by
      // e.
      MatrixXd numeric(3, 6);
      for (int k = 0; k < 6; ++k)
        numeric.col(k) = derivative(
            [&](double h) { return VectorXd(exponential(h * Vector6d::Unit(k)) * p); }, 1e-3);
      MatrixXd b;
      s.model->own_noise(s.input(), static_cast<int>(i), b);
      REQUIRE((b.rows() == 3 && b.cols() == 6));
      const Vector6d sigma = (Vector6d() << 1, 2, 3, 4, 5, 6).finished();
      const Matrix3d analytic = b * sigma.cwiseAbs2().asDiagonal() * b.transpose();
      CHECK((analytic - numeric * sigma.cwiseAbs2().asDiagonal() * numeric.transpose()).norm() <
            1e-9);
    }
    check_derivatives(s);
  }
}

TEST_CASE("tilting laser: value, derivatives and own noise") {
  Random random(20);
  for (int trial = 0; trial < 40; ++trial) {
    const Stage s = laser_stage(random, trial % 2, trial % 4 < 2 ? -1 : 1);
    const VectorXd r = s.residual();
    for (int i = 0; i < 4; ++i) {
      const double* z = s.z.data() + 3 * i;
      const Isometry3d far_T = far_T_sensor(s, z[0]);
      const Vector3d p =
          far_T.inverse() * isometry(s.scan->behind_T_target) * Vector3d(s.points.col(s.ids[i]));
      INFO("trial " << trial << ", ray " << i);
      CHECK((r.segment<3>(3 * i) - (p - ray_point(z[1], z[2]))).norm() < 1e-13);

      // The point the ray hits, seen from the far side, by joint reading, bearing and range; turned
      // back into the sensor's frame.
      Matrix3d numeric;
      numeric.col(0) = derivative(
          [&](double h) { return VectorXd(far_T_sensor(s, z[0] + h) * ray_point(z[1], z[2])); },
          1e-3);
      numeric.col(1) =
          derivative([&](double h) { return VectorXd(far_T * ray_point(z[1] + h, z[2])); }, 1e-3);
      numeric.col(2) =
          derivative([&](double h) { return VectorXd(far_T * ray_point(z[1], z[2] + h)); }, 1e-3);
      numeric = (far_T.linear().transpose() * numeric).eval();
      MatrixXd b;
      s.model->own_noise(s.input(), i, b);
      REQUIRE((b.rows() == 3 && b.cols() == 3));
      const Vector3d squared(1, 4, 9);
      CHECK((b * squared.asDiagonal() * b.transpose() -
             numeric * squared.asDiagonal() * numeric.transpose())
                .norm() < 1e-8);
    }
    check_derivatives(s);
  }
}

TEST_CASE("tilting laser: a ray along the joint's axis has noise across its plane all the same") {
  Random random(23);
  Stage s = laser_stage(random, false, -1);
  s.scan->sensor_T_before = Pose();  // the joint turns about x: a ray at bearing 0 lies on its axis
  s.scan->axis = Vector3d::UnitX();
  const double sigma[3] = {0.0005, 0.002, 0.005};
  for (const double bearing : {0.0, 1e-14, 1e-6, 0.001, 0.0021, 0.5, kPi}) {
    s.z = {0.3, bearing, 2.0};
    s.ids = {0};
    ViewInput in = s.input();
    MatrixXd plain, b;
    s.model->own_noise(in, 0, plain);
    in.sigma = sigma;
    s.model->own_noise(in, 0, b);
    INFO("bearing " << bearing);
    CHECK(b.rightCols(2) == plain.rightCols(2));
    // As far across as one sigma of the bearing beside the axis; beyond that nothing changes.
    const double off_axis = 2.0 * std::abs(std::sin(bearing));
    CHECK(std::abs(b(2, 0)) ==
          Approx(std::max(off_axis, 2.0 * sigma[1]) * s.joint[1]).epsilon(0.2));
    if (off_axis > 2.0 * sigma[1] * 1.3) CHECK(b == plain);
  }
}

TEST_CASE("tilting laser: derivatives with everything at the identity but for 1e-8") {
  Random random(21);
  for (const bool prismatic : {false, true}) {
    Stage s = laser_stage(random, prismatic, -1);
    s.scan->sensor_T_before = to_pose(error_of(1e-8, 1e-8, random));
    s.scan->behind_T_target = to_pose(error_of(1e-8, 1e-8, random));
    s.joint[0] = 0;
    for (size_t i = 0; i < s.z.size(); i += 3) s.z[i] = i == 0 ? 0 : 1e-8;
    check_derivatives(s);
  }
}

namespace {

/// Somebody's own sensor, after the recipe at the head of sensor.h: a radar's range with a bias.
struct Radar {
  static constexpr int kRows = 1, kMeasurementSize = 1;
  int parameter_count() const { return 1; }
  bool residual(const double* bias, const Vector3d& p, const double* z, double* r, double* d_p,
                double* d_own) const {
    const double range = p.norm();
    if (range < 1e-6) return false;
    r[0] = range + bias[0] - z[0];
    if (d_p) {
      for (int i = 0; i < 3; ++i) d_p[i] = p(i) / range;
      d_own[0] = 1;
    }
    return true;
  }
};

}  // namespace

TEST_CASE("a sensor of one's own through the adapter") {
  Random random(22);
  Stage s;
  s.owner = std::make_shared<PointwiseSensor<Radar>>();
  s.model = s.owner.get();
  CHECK((s.model->rows() == 1 && s.model->measurement_size() == 1 && s.model->sigmas() == 1 &&
         s.model->measurement_kind() == MeasurementKind::none));
  set_grid(s);
  s.parameters = {0.02};
  s.z = {1, 1.1, 1.2, 1.3};
  s.pose = random.pose(1, 3);
  check_derivatives(s);
  MatrixXd b;
  s.model->own_noise(s.input(), 0, b);
  CHECK(b == MatrixXd::Identity(1, 1));
  s.pose = {Matrix3d::Identity(), Vector3d::Zero()};  // id 0 is in the sensor itself
  VectorXd r(4);
  CHECK_FALSE(s.model->evaluate(s.input(), Columns(), r.data(), nullptr));
}

}  // namespace sensors_test
