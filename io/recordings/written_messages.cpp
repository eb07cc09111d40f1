#include "written_messages.h"

#include <cmath>
#include <map>

namespace kincal {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
              "numbers are written in the byte order of memory");

namespace {

const char* const kLine =
    "\n================================================================================\nMSG: ";

/// What a message uses, by its type.
std::vector<std::string> parts_of(const std::string& type) {
  static const std::map<std::string, std::vector<std::string>> parts = {
      {"std_msgs/String", {}},
      {"sensor_msgs/JointState", {"std_msgs/Header"}},
      {"sensor_msgs/Image", {"std_msgs/Header"}},
      {"sensor_msgs/LaserScan", {"std_msgs/Header"}},
      {"sensor_msgs/CameraInfo", {"std_msgs/Header", "sensor_msgs/RegionOfInterest"}},
      {"geometry_msgs/PoseStamped",
       {"std_msgs/Header", "geometry_msgs/Pose", "geometry_msgs/Point",
        "geometry_msgs/Quaternion"}},
      {"tf2_msgs/TFMessage",
       {"geometry_msgs/TransformStamped", "std_msgs/Header", "geometry_msgs/Transform",
        "geometry_msgs/Vector3", "geometry_msgs/Quaternion"}}};
  return parts.at(type);
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
  return text;
}

/// The definition of one type, without what it uses.
std::string own_definition(Wire wire, const std::string& type) {
  std::string text = "\n" + standard_definition(type) + "\n";
  if (wire == Wire::cdr) {
    text = replaced(text, "\nHeader ", "\nstd_msgs/Header ");
    text = replaced(text, "\ntime ", "\nbuiltin_interfaces/Time ");
    return text.substr(1);
  }
  if (type == "std_msgs/Header") text = "\nuint32 seq" + text;
  if (type == "sensor_msgs/CameraInfo")
    for (const char* name : {"d", "k", "r", "p"}) {
      const std::string capital(1, static_cast<char>(*name - 'a' + 'A'));
      text = replaced(text, "] " + std::string(name) + "\n", "] " + capital + "\n");
    }
  return text.substr(1);
}

}  // namespace

MessageIdentity message_identity(Wire wire, const std::string& type) {
  static const std::map<std::string, std::string> md5sums = {
      {"std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1"},
      {"sensor_msgs/JointState", "3066dcd76a6cfaef579bd0f34173e9fd"},
      {"sensor_msgs/Image", "060021388200f6f0f447d0fcd9c64743"},
      {"sensor_msgs/CameraInfo", "c9a58c1b0b154e0e6da7578cb991d214"},
      {"sensor_msgs/LaserScan", "90c7ef2dc6895d81024acba2ac42f369"},
      {"geometry_msgs/PoseStamped", "d3812c3cbc69362b77dc0b19b345f8f5"},
      {"tf2_msgs/TFMessage", "94810edda583a504dfda3829e70d7eec"}};
  MessageIdentity out;
  out.md5sum = md5sums.at(type);
  out.definition = own_definition(wire, type);
  std::vector<std::string> parts = parts_of(type);
  for (const std::string& part : parts)
    out.definition += kLine + part + "\n" + own_definition(wire, part);
  if (wire == Wire::cdr && !parts.empty())
    out.definition += kLine + std::string("builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n");
  return out;
}

MessageBytes::MessageBytes(Wire wire) : wire_(wire) {
  if (wire == Wire::cdr) bytes_.assign("\0\1\0\0", 4);  // CDR, little-endian
}

void MessageBytes::align(size_t size) {
  if (wire_ == Wire::cdr)
    while ((bytes_.size() - 4) % size) bytes_ += '\0';
}

MessageBytes& MessageBytes::text(std::string_view text) {
  number(static_cast<std::uint32_t>(text.size() + (wire_ == Wire::cdr)));
  bytes_ += text;
  if (wire_ == Wire::cdr) bytes_ += '\0';
  return *this;
}

MessageBytes& MessageBytes::time(std::int64_t nanoseconds) {
  constexpr std::int64_t second = 1000000000;
  return number(static_cast<std::uint32_t>(nanoseconds / second))
      .number(static_cast<std::uint32_t>(nanoseconds % second));
}

MessageBytes& MessageBytes::header(std::int64_t nanoseconds, std::string_view frame) {
  if (wire_ == Wire::ros1) number(std::uint32_t{0});
  return time(nanoseconds).text(frame);
}

MessageBytes& MessageBytes::doubles(const std::vector<double>& numbers) {
  number(static_cast<std::uint32_t>(numbers.size()));
  for (double n : numbers) number(n);
  return *this;
}

MessageBytes& MessageBytes::floats(const std::vector<float>& numbers) {
  number(static_cast<std::uint32_t>(numbers.size()));
  for (float n : numbers) number(n);
  return *this;
}

MessageBytes& MessageBytes::bytes(std::string_view bytes) {
  number(static_cast<std::uint32_t>(bytes.size()));
  bytes_ += bytes;
  return *this;
}

std::string text_message(Wire wire, std::string_view text) {
  return MessageBytes(wire).text(text).str();
}

std::string joint_state_message(Wire wire, std::int64_t time, const std::vector<std::string>& names,
                                const std::vector<double>& readings) {
  MessageBytes out(wire);
  out.header(time, "");
  std::vector<double> known;
  for (double r : readings)
    if (!std::isnan(r)) known.push_back(r);
  out.number(static_cast<std::uint32_t>(known.size()));
  for (size_t i = 0; i < names.size(); ++i)
    if (!std::isnan(readings[i])) out.text(names[i]);
  return out.doubles(known).doubles({}).doubles({}).str();
}

std::string image_message(Wire wire, std::int64_t time, std::string_view frame,
                          const GreyPicture& picture) {
  return MessageBytes(wire)
      .header(time, frame)
      .number(picture.height)
      .number(picture.width)
      .text("mono8")
      .number(std::uint8_t{0})
      .number(picture.width)
      .bytes(picture.pixels)
      .str();
}

std::string camera_info_message(Wire wire, std::int64_t time, std::string_view frame,
                                const CameraNumbers& camera) {
  const double* f = camera.intrinsics;
  MessageBytes out(wire);
  out.header(time, frame).number(camera.height).number(camera.width).text(camera.model);
  out.doubles(camera.distortion);
  const double k[9] = {f[0], 0, f[2], 0, f[1], f[3], 0, 0, 1}, r[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const double p[12] = {f[0], 0, f[2], 0 - f[0] * camera.baseline, 0, f[1], f[3], 0, 0, 0, 1, 0};
  for (double n : k) out.number(n);
  for (double n : r) out.number(n);
  for (double n : p) out.number(n);
  for (int i = 0; i < 2; ++i) out.number(std::uint32_t{0});  // binning
  for (int i = 0; i < 4; ++i) out.number(std::uint32_t{0});  // region of interest: all
  return out.number(std::uint8_t{0}).str();
}

std::string laser_scan_message(Wire wire, std::int64_t time, std::string_view frame,
                               const LaserScan& scan) {
  const auto beams = static_cast<double>(scan.ranges.size());
  MessageBytes out(wire);
  out.header(time, frame);
  for (const double n :
       {scan.angle_min, scan.angle_min + (beams - 1) * scan.angle_increment, scan.angle_increment,
        scan.time_increment, 2 * kPi / scan.angle_increment * scan.time_increment, 0.1, 30.})
    out.number(static_cast<float>(n));
  return out.floats(scan.ranges).floats(scan.intensities).str();
}

}  // namespace kincal
