// The hand-eye methods of OpenCV on a rig that is known by its flange, for comparisons: what a user
// of theirs would write. Boards are found by solvePnP with the rig's intrinsics, minimised.
#pragma once

#include <opencv2/calib3d.hpp>
#include <string>
#include <vector>

#include "../../kinematics/floating.h"
#include "../../models/rig/rig.h"
#include "../../models/rig/samples.h"
#include "../../models/rig/targets.h"

namespace kincal::fixture {

struct HandEye {
  std::string method;
  Pose link_T_camera;
};

inline cv::Mat cv_matrix(const Matrix3d& r) {
  cv::Mat out(3, 3, CV_64F);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out.at<double>(i, j) = r(i, j);
  return out;
}

inline cv::Mat cv_vector(const Vector3d& v) { return (cv::Mat_<double>(3, 1) << v(0), v(1), v(2)); }

inline Pose pose_of(const cv::Mat& r, const cv::Mat& t) {
  Pose out;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) out.rotation(i, j) = r.at<double>(i, j);
    out.translation(i) = t.at<double>(i);
  }
  return out;
}

/// camera_T_board of a view of the rig's only camera.
inline Pose board_of(const Rig& rig, const View& view) {
  const Eigen::Matrix3Xd points = target_points(rig.targets[view.target]);
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> image;
  for (size_t i = 0; i < view.ids.size(); ++i) {
    const Vector3d p = points.col(view.ids[i]);
    object.push_back({p(0), p(1), p(2)});
    image.push_back({view.z[2 * i], view.z[2 * i + 1]});
  }
  const std::vector<double>& f = rig.sensors[view.sensor].parameters[0].values;
  const cv::Mat k = (cv::Mat_<double>(3, 3) << f[0], 0, f[2], 0, f[1], f[3], 0, 0, 1);
  std::vector<double> d(4, 0.0);
  for (const ParameterBlock& block : rig.sensors[view.sensor].parameters)
    if (block.name == "distortion") d = block.values;
  cv::Mat turn, shift, r;
  cv::solvePnP(object, image, k, d, turn, shift, false, cv::SOLVEPNP_IPPE);
  cv::solvePnPRefineLM(object, image, k, d, turn, shift);
  cv::Rodrigues(turn, r);
  return pose_of(r, shift);
}

/// All methods that OpenCV has.
inline std::vector<HandEye> opencv_hand_eye(const Rig& rig, const std::vector<Sample>& samples) {
  const int flange = 0;  // the joint
  const bool in_hand = rig.sensors[0].link != rig.base;
  std::vector<cv::Mat> r_hand, t_hand, r_inverse, t_inverse, r_board, t_board;
  for (const Sample& sample : samples) {
    const Pose pose = pose_reading(rig.tree, flange, sample.readings),
               base_T_hand =
                   in_hand ? pose : inverse(pose),  // of a camera in the room: turned round
        hand_T_base = inverse(base_T_hand), board = board_of(rig, sample.views[0]);
    r_hand.push_back(cv_matrix(base_T_hand.rotation));
    t_hand.push_back(cv_vector(base_T_hand.translation));
    r_inverse.push_back(cv_matrix(hand_T_base.rotation));
    t_inverse.push_back(cv_vector(hand_T_base.translation));
    r_board.push_back(cv_matrix(board.rotation));
    t_board.push_back(cv_vector(board.translation));
  }
  std::vector<HandEye> out;
  const std::pair<const char*, cv::HandEyeCalibrationMethod> methods[] = {
      {"Tsai", cv::CALIB_HAND_EYE_TSAI},
      {"Park", cv::CALIB_HAND_EYE_PARK},
      {"Horaud", cv::CALIB_HAND_EYE_HORAUD},
      {"Andreff", cv::CALIB_HAND_EYE_ANDREFF},
      {"Daniilidis", cv::CALIB_HAND_EYE_DANIILIDIS}};
  for (const auto& method : methods) {
    cv::Mat r, t;
    cv::calibrateHandEye(r_hand, t_hand, r_board, t_board, r, t, method.second);
    out.push_back({method.first, pose_of(r, t)});
  }
  const std::pair<const char*, cv::RobotWorldHandEyeCalibrationMethod> both[] = {
      {"RobotWorld Shah", cv::CALIB_ROBOT_WORLD_HAND_EYE_SHAH},
      {"RobotWorld Li", cv::CALIB_ROBOT_WORLD_HAND_EYE_LI}};
  for (const auto& method : both) {
    cv::Mat r_world, t_world, r, t;
    cv::calibrateRobotWorldHandEye(r_board, t_board, r_inverse, t_inverse, r_world, t_world, r, t,
                                   method.second);
    out.push_back({method.first, inverse(pose_of(r, t))});
  }
  return out;
}

}  // namespace kincal::fixture
