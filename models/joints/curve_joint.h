// A joint whose error is a curve over its angle: what encoders, gears and couplings make, and what
// comes back at the same angle.
//
//     position = scale * reading + offset + sum_k c_k B(u - k),   u = reading * n / (2 pi),
//
// B the cubic B-spline on the integers, n = 96 values c_k (rad) around the turn, u - k modulo n:
// the curve is smooth, has a period of a turn, and can follow some 30 cycles of it. At a reading
// four values count, so that the data of other angles tell nothing of them: where a joint was not,
// its curve is as uncertain as its prior. The mean of the values stands in for the offset; a prior
// (the automatic path's, or the rig's) tells the two apart.
// de Boor, A Practical Guide to Splines (1978), ch. IX.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "joint_model.h"

namespace kincal {

class CurveJoint final : public JointModel {
 public:
  static constexpr int kValues = 96;

  std::string name() const override { return "curve"; }
  std::vector<JointNumber> extra_parameters() const override {
    JointNumber curve;
    curve.name = "curve";
    curve.unit = "rad";
    curve.usual_error = 3e-4;
    curve.count = kValues;
    return {curve};
  }
  int size() const override { return 2 + kValues; }
  double position(double reading, const double* own) const override {
    return own[1] * reading + own[0] + sum(reading, own, weights);
  }
  double by_reading(double reading, const double* own) const override {
    return own[1] + kPerRadian * sum(reading, own, slopes);
  }
  double by_own(int k, double reading, const double*) const override {
    if (k < 2) return k == 0 ? 1 : reading;
    const int i = place(k, piece(reading));
    if (i > 3) return 0;
    double w[4];
    weights(part(reading), w);
    return w[i];
  }
  int piece(double reading) const override { return piece_of(reading); }
  bool depends(int k, int piece) const override { return k < 2 || place(k, piece) <= 3; }

 private:
  static constexpr double kPerRadian = kValues / 6.283185307179586;

  static int piece_of(double reading) {
    const double turn = std::floor(reading * kPerRadian / kValues);
    const int p = static_cast<int>(std::floor(reading * kPerRadian) - turn * kValues);
    return p >= 0 && p < kValues ? p : 0;  // (NaN: no reading)
  }

  /// Which of the four values that count at a piece an own number is; more than 3: none.
  static int place(int k, int piece) { return (k - 2 - piece + 1 + kValues) % kValues; }
  /// Where in its piece a reading is, 0 to 1.
  static double part(double reading) {
    const double u = reading * kPerRadian;
    return u - std::floor(u);
  }
  static void weights(double t, double* w) {
    const double s = 1 - t;
    w[0] = s * s * s / 6;
    w[1] = (4 - 6 * t * t + 3 * t * t * t) / 6;
    w[2] = (4 - 6 * s * s + 3 * s * s * s) / 6;
    w[3] = t * t * t / 6;
  }
  static void slopes(double t, double* w) {
    const double s = 1 - t;
    w[0] = -s * s / 2;
    w[1] = (3 * t - 4) * t / 2;
    w[2] = (4 - 3 * s) * s / 2;
    w[3] = t * t / 2;
  }
  static double sum(double reading, const double* own, void (*of)(double, double*)) {
    double w[4];
    of(part(reading), w);
    const int p = piece_of(reading);
    double out = 0;
    for (int i = 0; i < 4; ++i) out += w[i] * own[2 + (p + i - 1 + kValues) % kValues];
    return out;
  }
};

}  // namespace kincal
