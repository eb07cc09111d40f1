// models/sensors/check_jacobian.h: what compares derivatives with differences finds wrong ones.
//
// Proves: right derivatives of a camera, a pose sensor, a tilting laser with its joint, and a joint
// model pass; a wrong one by the point, by an own number, by a reading or by a joint's own number
// is told with its size; where a residual is undefined the error is infinite. Does not prove: that
// every sensor of kincal is right (sensors_test.cpp).
#include "../../../models/sensors/check_jacobian.h"

#include <catch2/catch.hpp>

#include "../../../models/sensors/sensors.h"

namespace check_jacobian_test {

using namespace kincal;

namespace {

/// A range finder with a bias: r = |p| + bias - z. Its derivatives are off by what is asked for.
struct Range {
  static constexpr int kRows = 1, kMeasurementSize = 1;
  double by_point = 0, by_bias = 0;
  int parameter_count() const { return 1; }
  bool residual(const double* own, const Vector3d& p, const double* z, double* r, double* d_p,
                double* d_own) const {
    if (!(p.z() > 0)) return false;
    r[0] = p.norm() + own[0] - z[0];
    if (d_p) {
      const Vector3d d = p.normalized();
      d_p[0] = d.x(), d_p[1] = d.y() + by_point, d_p[2] = d.z();
      d_own[0] = 1 + by_bias;
    }
    return true;
  }
};

/// A joint with position = offset + scale q + bend q^2. Its derivatives are off likewise.
struct Bent final : JointModel {
  double wrong_reading = 0, wrong_bend = 0;
  int size() const override { return 3; }
  double position(double q, const double* own) const override {
    return own[0] + q * (own[1] + q * own[2]);
  }
  double by_reading(double q, const double* own) const override {
    return own[1] + 2 * own[2] * q + wrong_reading;
  }
  double by_own(int k, double q, const double*) const override {
    return k == 0 ? 1 : k == 1 ? q : q * q + wrong_bend;
  }
};

/// Three points two metres ahead, and what a sensor measures of them.
struct Ahead {
  Eigen::Matrix3Xd points =
      (Eigen::Matrix3Xd(3, 3) << 0, 0.3, -0.1, 0.1, -0.2, 0.4, 0, 0.1, 0.2).finished();
  std::vector<int> ids = {0, 1, 2};
  std::vector<double> parameters, z;
  ViewInput view() const {
    ViewInput in;
    in.sensor_T_target.rotation = exp_so3({0.2, -0.1, 0.4});
    in.sensor_T_target.translation = {0.1, -0.2, 2};
    in.parameters = parameters.data();
    in.points = &points;
    in.ids = ids.data();
    in.count = 3;
    in.z = z.data();
    return in;
  }
};

}  // namespace

TEST_CASE("check_jacobian passes right derivatives") {
  Ahead at;
  at.parameters = {500, 510, 320, 240, -0.1, 0.02, 0.001, -0.002, 0.01, 0.07};
  at.z.assign(6, 100);
  CHECK(check_jacobian(*make_camera(Lens::brown_conrady, 5), at.view(), 10) < 1e-6);
  at.z = {0.1, -0.1, 1.9, 0.1, 0, 0.2, 0.97};
  CHECK(check_jacobian(*make_pose(), at.view()) < 1e-6);

  const std::vector<double> own = {0.02, 1.01, 0.1};
  CHECK(check_jacobian(Bent(), 0.7, own) < 1e-6);
  CHECK(check_jacobian(*linear_joint(), -0.7, {0.02, 1.01}) < 1e-6);

  const Bent bent;
  Scan scan;
  scan.sensor_T_before.translation = {0.05, 0, -0.1};
  scan.behind_T_target = at.view().sensor_T_target;
  scan.axis = Vector3d::UnitY();
  scan.model = &bent;
  scan.own = own.data();
  at.z = {0.3, 0.1, 2, 0.31, 0.2, 2.1, 0.29, -0.1, 1.9};
  ViewInput view = at.view();
  view.scan = &scan;
  CHECK(check_jacobian(*make_tilting_laser(), view) < 1e-6);
}

TEST_CASE("check_jacobian finds wrong derivatives") {
  Ahead at;
  at.parameters = {0.1};
  at.z = {2, 2, 2};
  CHECK(check_jacobian(PointwiseSensor<Range>(), at.view(), 1) < 1e-8);
  const double by_point = check_jacobian(PointwiseSensor<Range>({1e-3, 0}), at.view(), 1);
  CHECK(by_point > 5e-4);
  CHECK(by_point < 1e-2);
  CHECK(check_jacobian(PointwiseSensor<Range>({0, 1e-3}), at.view(), 1) ==
        Approx(1e-3 / 1.001).epsilon(1e-4));
  CHECK(check_jacobian(PointwiseSensor<Range>({0, 1e-3}), at.view()) < 1e-8);  // not asked for

  Bent reading, bend;
  reading.wrong_reading = 1e-3;
  bend.wrong_bend = 1e-3;
  CHECK(check_jacobian(reading, 0.3, {0, 0.5, 0.1}) == Approx(1e-3).epsilon(1e-4));
  CHECK(check_jacobian(bend, 0.3, {0, 0.5, 0.1}) == Approx(1e-3).epsilon(1e-4));

  ViewInput behind = at.view();
  behind.sensor_T_target.translation.z() = -2;
  CHECK(std::isinf(check_jacobian(PointwiseSensor<Range>(), behind, 1)));
}

}  // namespace check_jacobian_test
