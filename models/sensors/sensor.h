// The interface between sensors, kinematics and solver, and the adapter that makes a sensor from a
// function of one point.
//
// A target is rigid, so within one view everything geometric (a joint's offset, gear, link, mount,
// the target's pose) moves all its points by one 6-dof motion of the target in the sensor's
// frame. A view's Jacobian therefore factors:  J = L M.  L (rows x columns of `Columns`) is the
// sensor's own derivative; M, constant in a view, is the kinematics' derivative of that pose. A
// sensor computes r and L for one view, independent of the kinematics.
//
// To add a sensor that sees single points, write a struct with
//     static constexpr int kRows;          // residuals per point
//     static constexpr int kMeasurementSize;  // measured values per point
//     int parameter_count() const;         // own parameters: intrinsics, ... (at most
//     kMaxParameters) bool residual(const double* parameters, const Vector3d& p_sensor, const
//     double* z,
//                   double* r, double* d_r_d_point, double* d_r_d_parameters) const;
// (residual = predicted - measured; derivatives row-major, kRows x 3 and kRows x parameter_count,
// either both given or both null; false where undefined) and wrap it:
// std::make_shared<PointwiseSensor<My>>(...). Everything else (pose, joints, target's shape,
// weights, losses, elimination) follows.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"
#include "../joints/joint_model.h"
#include "view_kernels.h"

namespace kincal {

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A ParameterBlock is a group of a sensor's own parameters, e.g. "intrinsics" with fx fy cx cy.
struct ParameterBlock {
  std::string name;                     // parameter sensor/NAME/<name>
  std::vector<std::string> components;  // component names; {""} if there is only one
  std::vector<std::string> units;       // one per component, "" for none
  std::vector<double> values;           // initial values
};

/// A Scan describes the scanning joint of a sensor, the only joint that moves within a view:
/// p_sensor = sensor_T_before * motion(direction * q) * behind_T_target * p, q = the joint's
/// position at the reading z[0].
struct Scan {
  Pose sensor_T_before;  // from the sensor's frame to the joint, on the sensor's side of it
  Pose behind_T_target;  // from the joint's other side to the target
  Vector3d axis;         // unit, the same seen from both sides
  bool prismatic = false;
  int direction = -1;  // +1: the path from sensor to target goes from parent to child
  const JointModel* model = nullptr;  // of the joint
  const double* own = nullptr;        // its parameters

  double position(double reading) const { return model->position(reading, own); }
};

/// A ViewInput is the input of a sensor for one view. It points to data owned by others and is
/// valid during one evaluation.
struct ViewInput {
  Pose sensor_T_target;                      // if there is no scanning joint
  const Scan* scan = nullptr;                // if there is one
  const double* parameters = nullptr;        // the sensor's own parameters, block after block
  const Eigen::Matrix3Xd* points = nullptr;  // the target's points in its own frame, m
  const Eigen::Matrix3Xd* layout = nullptr;  // d points / d spacing (grids), else null
  const Eigen::Matrix2Xd* bulge = nullptr;   // d points.z / d warp (boards with a warp), else null
  const Eigen::Matrix3Xd* plain = nullptr;   // boards with a print: the points were it to scale
                                             // and flat, else null
  const int* ids = nullptr;                  // indices of the seen points
  int count = 0;                             // their number
  const double* z = nullptr;  // count x measurement_size() values (a pose: 7, x y z qx qy qz qw)
  const double* sigma = nullptr;  // sigmas() standard deviations, for own_noise(); null: unknown
};

/// Columns are the positions of the columns of L. A group of columns that the caller does not need
/// is absent (-1).
struct Columns {
  int pose = 0;  // 6: twist of the target seen from the sensor; scanning: of the target in front of
                 // the joint's far side ("behind"), then 6 of the sensor's side at `sensor_side`,
                 // then the joint's own parameters at `joint`
  int sensor_side = -1, joint = -1;
  int parameters = -1;  // the sensor's own parameters
  int square = -1;      // spacing of a grid target
  int warp = -1;        // 2, of a board with a warp
  int print = -1;       // 2, of a board whose print may be out of scale
  int points = -1;      // 3 per target point
  int total = 6;        // number of columns
  /// Returns whether a column of the target's shape is needed.
  bool shape() const { return square >= 0 || warp >= 0 || print >= 0 || points >= 0; }
};

/// A MeasurementKind is the kind of measurement that a view has of its target. Starting values and
/// the simulation depend on it.
enum class MeasurementKind {
  rays,    // two residuals a point, of a direction: cameras (PnP)
  points,  // 3-D points in the sensor's frame (rigid fit)
  scan,    // rays of a tilting laser
  pose,    // the pose itself
  chain,   // the target is at link_T_sensor
  none
};

/// A NoisePart is a range of a sensor's sigmas that belong to one kind of noise.
struct NoisePart {
  const char *name, *unit;
  int first, count;
};

/// A SensorModel is a type of sensor. It is stateless and shared; the parameters of an instance are
/// in its parameter blocks.
class SensorModel {
 public:
  virtual ~SensorModel() = default;
  /// Returns the number of residuals per point. A sensor that measures poses has one "point" per
  /// view.
  virtual int rows() const = 0;
  /// Returns the number of measured values per point (per view, if the sensor measures poses).
  virtual int measurement_size() const = 0;
  /// Returns the number of the sensor's sigmas: one per residual, unless it has own_noise.
  virtual int sigmas() const { return rows(); }
  /// Returns the unit of the residuals, "px" or "m".
  virtual const char* unit() const { return "m"; }
  /// Returns whether the sensor measures the target's pose instead of its points. Ids and points
  /// are then ignored.
  virtual bool measures_pose() const { return false; }
  virtual bool scans() const { return false; }
  virtual MeasurementKind measurement_kind() const { return MeasurementKind::none; }
  /// Returns the number of residual blocks of a view of n points: n, or 1 if the sensor measures
  /// poses. A loss acts on each block.
  int blocks(int count) const { return measures_pose() ? 1 : count; }

  /// Computes the raw residuals r (blocks * rows) and, if L is given (same rows, columns.total,
  /// zero-initialised by the caller), their derivatives. Returns false if a residual is undefined
  /// (a point behind the camera). It does not allocate.
  virtual bool evaluate(const ViewInput& view, const Columns& columns, double* r,
                        Eigen::Ref<RowMatrix>* L) const = 0;

  /// True if the sensor's own noise depends on the predicted view: block i has the covariance B
  /// diag(sigma^2) B'.
  virtual bool has_own_noise() const { return false; }
  /// True if the own noise depends on the target's pose. Otherwise, for a scanning sensor, it
  /// depends only on parameters on the sensor side of the scanning joint and on that joint's own
  /// parameters.
  virtual bool noise_sees_target() const { return has_own_noise(); }
  /// Computes B, rows() x sigmas(), of block i.
  virtual void own_noise(const ViewInput& view, int i, Eigen::MatrixXd& b) const;
  /// Returns the parts of the noise that the residuals can distinguish, in the order of the sigmas.
  /// If there are several parts, whitened residual i of a block has the part with sigma i.
  virtual std::vector<NoisePart> noise_parts() const { return {{"", unit(), 0, sigmas()}}; }
  /// Returns the inner loop of evaluate() for several points at a time; null if the sensor has
  /// none.
  virtual ViewKernel kernel() const { return nullptr; }
  /// Computes the values that the kernel compares its predictions with, from the measurements z of
  /// n points: rows() values per point, component after component, `stride` apart.
  virtual void compared(const double* z, int n, int stride, double* to) const;
  /// Returns the same sensor in noise mode `point` if it differs there (a chain then has residuals
  /// at each target point); else null.
  virtual const SensorModel* point_form() const { return nullptr; }
};

constexpr int kMaxParameters = 20;

/// Derivatives of a residual by the point in the sensor's frame, row-major.
using PointDerivatives =
    Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>>;

/// Returns the derivatives of a board's point in its plane, p were the print to scale, by stretch
/// and shear of the print (rig/targets.h).
inline Eigen::Matrix2d d_print(const Eigen::Vector2d& p) {
  return (Eigen::Matrix2d() << p.x(), p.y(), -p.y(), p.x()).finished() / 2;
}

/// Fills in the derivatives of one point's residuals with respect to the target's shape; d_r_d_p
/// are their derivatives with respect to the point.
inline void point_rows(const ViewInput& view, const Columns& c, int i,
                       const PointDerivatives& d_r_d_p, const Matrix3d& sensor_R_target,
                       Eigen::Ref<RowMatrix>& L) {
  for (int k = 0; k < d_r_d_p.rows(); ++k) {
    const Eigen::RowVector3d a = d_r_d_p.row(k);
    const int row = i * static_cast<int>(d_r_d_p.rows()) + k;
    if (c.square >= 0 && view.layout)
      L(row, c.square) = a.dot(sensor_R_target * view.layout->col(view.ids[i]));
    if (c.warp >= 0 && view.bulge)
      L.block<1, 2>(row, c.warp) =
          a.dot(sensor_R_target.col(2)) * view.bulge->col(view.ids[i]).transpose();
    if (c.print >= 0 && view.plain)
      L.block<1, 2>(row, c.print) =
          a * sensor_R_target.leftCols<2>() * d_print(view.plain->col(view.ids[i]).head<2>());
    if (c.points >= 0) L.block<1, 3>(row, c.points + 3 * view.ids[i]) = a * sensor_R_target;
  }
}

/// A PointwiseSensor makes a SensorModel from a pointwise residual (see the top of this file).
template <class S>
class PointwiseSensor final : public SensorModel {
 public:
  explicit PointwiseSensor(S sensor = S(), const char* unit = "m", ViewKernel view_kernel = nullptr)
      : sensor_(sensor), unit_(unit), kernel_(view_kernel) {}
  int rows() const override { return S::kRows; }
  int measurement_size() const override { return S::kMeasurementSize; }
  const char* unit() const override { return unit_; }
  MeasurementKind measurement_kind() const override {
    return S::kRows == 2                               ? MeasurementKind::rays
           : S::kRows == 3 && S::kMeasurementSize == 3 ? MeasurementKind::points
                                                       : MeasurementKind::none;
  }
  const S& sensor() const { return sensor_; }
  ViewKernel kernel() const override { return kernel_; }

  bool evaluate(const ViewInput& view, const Columns& c, double* r,
                Eigen::Ref<RowMatrix>* L) const override {
    const int own = sensor_.parameter_count();
    double d_p[S::kRows * 3], d_own[S::kRows * kMaxParameters];
    for (int i = 0; i < view.count; ++i) {
      const Vector3d p = view.sensor_T_target * Vector3d(view.points->col(view.ids[i]));
      if (!sensor_.residual(view.parameters, p, view.z + i * S::kMeasurementSize, r + i * S::kRows,
                            L ? d_p : nullptr, L ? d_own : nullptr))
        return false;
      if (!L) continue;
      for (int k = 0; k < S::kRows; ++k) {  // a' (v + w x p) = [a | p x a]' [v | w]
        const Vector3d a(d_p[3 * k], d_p[3 * k + 1], d_p[3 * k + 2]);
        const int row = i * S::kRows + k;
        L->template block<1, 3>(row, c.pose) = a.transpose();
        L->template block<1, 3>(row, c.pose + 3) = p.cross(a).transpose();
        if (c.parameters >= 0)
          for (int j = 0; j < own; ++j) (*L)(row, c.parameters + j) = d_own[k * own + j];
      }
      if (c.shape())
        point_rows(view, c, i, PointDerivatives(d_p, S::kRows, 3), view.sensor_T_target.rotation,
                   *L);
    }
    return true;
  }

 private:
  S sensor_;
  const char* unit_;
  ViewKernel kernel_;
};

}  // namespace kincal
