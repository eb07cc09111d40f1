// What a joint's reading means: the contract of joint models, and the linear one that every joint
// has unless its rig says otherwise.
//
// A model turns a reading (what the encoder says, rad or m) into the position of the joint (rad or
// m) by own numbers that can be calibrated. Every model begins with the same two,
//     position = scale * reading + offset + what the model adds,
//     own = [offset, scale, further numbers ...],
// because the offset is what a URDF's origin takes up and the scale is the gear. A model is
// stateless; its numbers stand one after the other in the vector of values
// (models/rig/parameters.h), from its offset on. All else (columns of the Jacobian, starting
// values, simulation, names of the parameters joint/NAME/...) follows from the functions below:
// nothing outside knows the formula.
//
// To add a model, derive from JointModel in a header here, with a name(), and add it to the list in
// joint_models.cpp: a rig.yaml then names it (`model: NAME`) and gives its further numbers values,
// each under its own name. A program gives a model of its own to JointSettings::model of
// models/rig/rig.h, or to read_rig. Further numbers are parameters of kind joint_shape. Nothing
// here allocates but extra_parameters().
#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

namespace kincal {

/// A JointNumber is a number of a joint model beyond offset and scale.
struct JointNumber {
  std::string name, unit;  // parameter joint/NAME/<name>; not sigma, offset, scale, model or origin
  double value = 0;        // initial, where the rig says nothing
  double usual_error =
      0.05;  // standard deviation of how far it is off in a robot that nobody has calibrated
  double yardstick = 0;  // the sigma above which it counts as weakly determined; 0: 1 cm, 1 degree,
                         // or 0.01, as its unit says
  int count = 1;         // how many there are of this name and kind: components of the parameter
};

class JointModel {
 public:
  virtual ~JointModel() = default;
  /// Returns what a rig.yaml calls the model; empty: it cannot name it.
  virtual std::string name() const { return ""; }
  /// Returns the numbers behind offset and scale, in the order of `own`.
  virtual std::vector<JointNumber> extra_parameters() const { return {}; }
  /// Returns how many own numbers there are, offset and scale included.
  virtual int size() const { return 2; }
  /// Returns the position (rad or m) at a reading.
  virtual double position(double reading, const double* own) const = 0;
  /// Returns d position / d reading.
  virtual double by_reading(double reading, const double* own) const = 0;
  /// Returns d position / d own number k.
  virtual double by_own(int k, double reading, const double* own) const = 0;
  /// Returns in which of several pieces of its range a reading is. Each piece depends on other
  /// parameters (depends()), so distant pieces cost nothing. 0 if all parameters apply everywhere.
  virtual int piece(double /*reading*/) const { return 0; }
  /// Returns whether the position depends on own number k in a piece.
  virtual bool depends(int /*k*/, int /*piece*/) const { return true; }
  /// Returns the reading at which the joint has this position: what a simulated encoder says. It
  /// comes by Newton's method from the linear part; NaN where that does not converge.
  virtual double reading(double position, const double* own) const {
    double q = (position - own[0]) / own[1];
    for (int i = 0; i < 50; ++i) {
      const double step = (this->position(q, own) - position) / by_reading(q, own);
      q -= step;
      if (std::abs(step) <= 1e-15 * (1 + std::abs(q))) return q;
    }
    return std::nan("");
  }
};

/// A LinearJoint has position = scale * reading + offset.
class LinearJoint final : public JointModel {
 public:
  std::string name() const override { return "linear"; }
  double position(double reading, const double* own) const override {
    return own[1] * reading + own[0];
  }
  double by_reading(double, const double* own) const override { return own[1]; }
  double by_own(int k, double reading, const double*) const override {
    return k == 0 ? 1 : reading;
  }
  double reading(double position, const double* own) const override {
    return (position - own[0]) / own[1];
  }
};

/// Returns the one linear model: models have no state, so all joints share it.
inline std::shared_ptr<const JointModel> linear_joint() {
  static const std::shared_ptr<const JointModel> model = std::make_shared<LinearJoint>();
  return model;
}

}  // namespace kincal
