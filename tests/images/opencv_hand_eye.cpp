// RIG SAMPLES: what OpenCV's hand-eye methods make of them, for benchmarks/hand_eye.py. One line a
// method: name, then x y z qx qy qz qw of link_T_camera.
#include "opencv_hand_eye.h"

#include <cstdio>

#include "../../io/rig/rig_file.h"
#include "../../io/rig/samples_file.h"

int main(int count, char** arguments) {
  if (count != 3) return 1;
  const kincal::Rig rig = kincal::read_rig(arguments[1]).rig;
  for (const kincal::fixture::HandEye& found :
       kincal::fixture::opencv_hand_eye(rig, kincal::read_samples(arguments[2], rig))) {
    const Eigen::Vector4d q = kincal::quaternion_from_rotation(found.link_T_camera.rotation);
    const kincal::Vector3d& t = found.link_T_camera.translation;
    std::printf("%s,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", found.method.c_str(), t(0), t(1),
                t(2), q(0), q(1), q(2), q(3));
  }
}
