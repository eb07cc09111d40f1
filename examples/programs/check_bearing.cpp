// Checks the derivatives of bearing.h: see docs/adding-a-sensor.md.
#include <cstdio>

#include "bearing.h"

int main() {
  const kincal::PointwiseSensor<Bearing> sensor;
  const double gain = 1.01, zeros[6] = {};
  const int ids[] = {0, 1, 2};
  Eigen::Matrix3Xd points(3, 3);
  points << 0.3, -1, 1e-8, -0.2, 0, 1e-8, 0, -1.5, 1;
  kincal::ViewInput view;
  view.sensor_T_target.translation.z() = 2;
  view.parameters = &gain;
  view.points = &points;
  view.ids = ids;
  view.count = 3;
  view.z = zeros;
  const double worst = kincal::check_jacobian(sensor, view, 1);
  if (worst > 1e-6) return std::printf("derivative off by %g\n", worst), 1;
}
