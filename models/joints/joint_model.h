// The interface of joint models, and the linear model that every joint
// has unless its rig says otherwise.
//
// A model converts a reading (output of the encoder, rad or m) to the position of the joint (rad or
// m), with parameters that can be calibrated. Every model begins with the same two,
//     position = scale * reading + offset + further terms of the model,
//     own = [offset, scale, further parameters ...],
// because a URDF's origin absorbs the offset, and the scale is the gear. A model is
// stateless; its parameters are adjacent in the vector of values
// (models/rig/parameters.h), from its offset on. All else (columns of the Jacobian, starting
// values, simulation, names of the parameters joint/NAME/...) follows from the functions below:
// no other code depends on the formula.
//
// To add a model, derive from JointModel in a header here, with a name(), and add it to the list in
// joint_models.cpp: a rig.yaml then names it (`model: NAME`) and gives values for its further
// parameters, each under its own name. A program passes a model of its own to JointSettings::model
// of models/rig/rig.h, or to read_rig. Further parameters have the kind joint_shape. Only
// extra_parameters() allocates.
#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

namespace kincal {

/// A JointNumber is a parameter of a joint model beyond offset and scale.
struct JointNumber {
  std::string name, unit;  // parameter joint/NAME/<name>; not sigma, offset, scale, model or origin
  double value = 0;        // initial, unless the rig states one
  double usual_error =
      0.05;              // standard deviation of the error in a robot that nobody has calibrated
  double yardstick = 0;  // the sigma above which it counts as weakly determined; 0: 1 cm, 1 degree
                         // or 0.01, depending on its unit
  int count = 1;         // number of components of the parameter
};

class JointModel {
 public:
  virtual ~JointModel() = default;
  /// Returns the name by which rig.yaml selects the model; empty if rig.yaml cannot select it.
  virtual std::string name() const { return ""; }
  /// Returns the parameters after offset and scale, in the order of `own`.
  virtual std::vector<JointNumber> extra_parameters() const { return {}; }
  /// Returns the size of `own`, offset and scale included.
  virtual int size() const { return 2; }
  /// Returns the position (rad or m) at a reading.
  virtual double position(double reading, const double* own) const = 0;
  /// Returns d position / d reading.
  virtual double by_reading(double reading, const double* own) const = 0;
  /// Returns d position / d own[k].
  virtual double by_own(int k, double reading, const double* own) const = 0;
  /// Returns the index of the piece of the joint's range that contains a reading. Each piece
  /// depends on some parameters only (depends()), so distant pieces cost nothing. 0 if all
  /// parameters apply everywhere.
  virtual int piece(double /*reading*/) const { return 0; }
  /// Returns whether the position depends on own[k] in a piece.
  virtual bool depends(int /*k*/, int /*piece*/) const { return true; }
  /// Returns the reading at which the joint has this position, for simulated encoders. It uses
  /// Newton's method, starting from the linear part; NaN if this does not converge.
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

/// Returns the one linear model; models have no state, so all joints share it.
inline std::shared_ptr<const JointModel> linear_joint() {
  static const std::shared_ptr<const JointModel> model = std::make_shared<LinearJoint>();
  return model;
}

}  // namespace kincal
