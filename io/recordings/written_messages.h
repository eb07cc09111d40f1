// The usual messages as bytes, for bag_writer.h.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "message.h"
#include "sweep.h"

namespace kincal {

/// What one of the usual messages is as a bag tells: its whole definition, with all that it uses,
/// and of ROS 1 the MD5 sum that names this definition.
struct MessageIdentity {
  std::string definition, md5sum;
};
MessageIdentity message_identity(Wire wire, const std::string& type);

/// MessageBytes appends the fields of a message in their order.
class MessageBytes {
 public:
  explicit MessageBytes(Wire wire);

  template <class Number>
  MessageBytes& number(Number n) {
    align(sizeof n);
    bytes_.append(reinterpret_cast<const char*>(&n), sizeof n);  // little-endian: see the .cpp
    return *this;
  }
  MessageBytes& text(std::string_view text);
  /// A time in ns since 1970.
  MessageBytes& time(std::int64_t nanoseconds);
  /// std_msgs/Header.
  MessageBytes& header(std::int64_t nanoseconds, std::string_view frame);
  MessageBytes& doubles(const std::vector<double>& numbers);  ///< an array of any length
  MessageBytes& floats(const std::vector<float>& numbers);    ///< likewise, of float32
  MessageBytes& bytes(std::string_view bytes);                ///< likewise, of uint8
  const std::string& str() const { return bytes_; }

 private:
  void align(size_t size);

  Wire wire_;
  std::string bytes_;
};

std::string text_message(Wire wire, std::string_view text);
/// Readings by name; those that are NaN are left out.
std::string joint_state_message(Wire wire, std::int64_t time, const std::vector<std::string>& names,
                                const std::vector<double>& readings);

/// A picture in 8 bits, grey, row by row.
struct GreyPicture {
  std::uint32_t width = 0, height = 0;
  std::string_view pixels;
};
std::string image_message(Wire wire, std::int64_t time, std::string_view frame,
                          const GreyPicture& picture);

/// What sensor_msgs/CameraInfo says of a camera.
struct CameraNumbers {
  std::uint32_t width = 0, height = 0;
  std::string model;               // plumb_bob, rational_polynomial, equidistant
  std::vector<double> distortion;  // in that model's order
  double intrinsics[4] = {};       // fx fy cx cy, px
  double baseline = 0;             // m, of a right camera of a rectified pair
};
std::string camera_info_message(Wire wire, std::int64_t time, std::string_view frame,
                                const CameraNumbers& camera);

/// One turn of a scanner, of ranges from 0.1 to 30 m.
std::string laser_scan_message(Wire wire, std::int64_t time, std::string_view frame,
                               const LaserScan& scan);

}  // namespace kincal
