// Rotations as three numbers, in the conventions of robot controllers and programs.
#pragma once

#include <array>

#include "transform.h"

namespace kincal {

/// How three numbers (rad) say a rotation. None of the functions allocates or throws.
struct AngleConvention {
  const char* name;     // in the plural, as in "have NAME that were read as NAME"
  const char* formats;  // what --pose-format calls it
  Matrix3d (*rotation)(const Vector3d& numbers);
  /// Both triples that give a rotation (each angle within half a turn; of rotation vectors the
  /// second is longer than half a turn); the first is the one that programs write.
  std::array<Vector3d, 2> (*numbers)(const Matrix3d& rotation);
  /// Whether programs write such a triple.
  bool (*usual)(const Vector3d& numbers);
};

enum class Angles { roll_pitch_yaw, a_b_c, moving_x_y_z, z_y_z, rotation_vector };
constexpr int kAngleConventions = 5;

const AngleConvention& angle_convention(Angles which);

}  // namespace kincal
