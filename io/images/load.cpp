#include "load.h"

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "../../models/rig/words.h"
#include "../exchange/lens.h"

namespace kincal {
namespace {

std::string size_text(int width, int height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

/// The first bytes of a file.
std::string head_of(const std::string& path, size_t size) {
  std::string head(size, 0);
  std::ifstream in(path, std::ios::binary);
  in.read(head.data(), static_cast<std::streamsize>(size));
  head.resize(static_cast<size_t>(in.gcount()));
  return head;
}

constexpr size_t kBeforeTables = 1 << 18;  // of a JPEG: pictures in EXIF stand before its tables

/// Whether there is EXIF in the head of a JPEG ("Exif") or PNG ("eXIf").
bool has_exif(const std::string& path, std::string_view mark) {
  return head_of(path, 4096).find(mark) != std::string::npos;
}

/// Whether the file asks viewers to turn the image (EXIF): the decoder then returns another one if
/// it may. Only files that can say so are decoded twice.
bool asks_to_be_turned(const std::string& path, const cv::Mat& stored) {
  std::string extension = std::filesystem::path(path).extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  const bool tiff = extension == ".tif" || extension == ".tiff",
             jpeg = extension == ".jpg" || extension == ".jpeg", png = extension == ".png";
  if (!tiff && !(jpeg && has_exif(path, "Exif")) && !(png && has_exif(path, "eXIf"))) return false;
  const cv::Mat turned = cv::imread(path, cv::IMREAD_ANYDEPTH | cv::IMREAD_GRAYSCALE);
  return turned.size() != stored.size() ||
         (!turned.empty() && cv::norm(turned, stored, cv::NORM_INF) > 0);
}

}  // namespace

LoadedImage load_image(const std::string& path, int width, int height) {
  LoadedImage out;
  std::error_code status;
  if (!std::filesystem::is_regular_file(path, status)) {
    out.error = std::filesystem::exists(path, status) ? "is no file" : "is not there";
    return out;
  }
  if (std::filesystem::file_size(path, status) == 0) {
    out.error = "is empty";
    return out;
  }
  cv::Mat image;
  try {
    // IGNORE_ORIENTATION only works with a flag for the colour; what a lens does belongs to the
    // pixels as the sensor has them.
    image = cv::imread(path,
                       cv::IMREAD_ANYDEPTH | cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
    if (!image.empty() && asks_to_be_turned(path, image))
      out.notes.push_back("asks to be turned (EXIF), which was not done: pixels are as stored");
  } catch (const cv::Exception& error) {
    out.error = "cannot be read: " + error.err;
    return out;
  }
  LoadedImage fitting = fitting_image(image, width, height);
  fitting.compression = compression_of(head_of(path, kBeforeTables));
  fitting.notes.insert(fitting.notes.begin(), out.notes.begin(), out.notes.end());
  return fitting;
}

LoadedImage decode_image(std::string_view bytes, int width, int height) {
  LoadedImage out;
  cv::Mat image;
  try {
    const cv::Mat raw(1, static_cast<int>(bytes.size()), CV_8UC1,
                      const_cast<char*>(bytes.data()));  // is only read
    image = cv::imdecode(
        raw, cv::IMREAD_ANYDEPTH | cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& error) {
    out.error = "cannot be read: " + error.err;
    return out;
  }
  LoadedImage fitting = fitting_image(image, width, height);
  fitting.compression = compression_of(bytes);
  return fitting;
}

LoadedImage fitting_image(const cv::Mat& image, int width, int height) {
  LoadedImage out;
  if (image.empty()) {
    out.error = "cannot be read: broken, or no image";
  } else if (width > 0 && (image.cols != width || image.rows != height)) {
    out.error = "has " + size_text(image.cols, image.rows) + " pixels, the rig's image_size is " +
                size_text(width, height);
    out.other_size = image.size();
  } else if (image.depth() != CV_8U) {
    double low = 0, high = 0;
    cv::minMaxLoc(image, &low, &high);
    out.notes.push_back("has more than 8 bits: its range was mapped to 8");
    image.convertTo(out.grey, CV_8U, high > low ? 255 / (high - low) : 1,
                    high > low ? -255 * low / (high - low) : 0);
  } else {
    out.grey = image;
  }
  return out;
}

std::string cure_of_size(const Sensor& camera, const cv::Size& size) {
  const std::string again = "or take pictures of " +
                            size_text(camera.image_width, camera.image_height) + " again",
                    written = "image_size: [" + std::to_string(size.width) + ", " +
                              std::to_string(size.height) + "]";
  const double x = static_cast<double>(size.width) / camera.image_width,
               y = static_cast<double>(size.height) / camera.image_height;
  const std::vector<double> lens = lens_of(camera).intrinsics;
  if (lens.size() != 4 || std::abs(x - y) * std::max(size.width, size.height) > 1)
    return "Write " + written + ", with the intrinsics of images of this size, " + again;
  return text(
      "If they show the same, smaller or larger (scaled, binned), write %s, intrinsics: "
      "[%.7g, %.7g, %.7g, %.7g]; if they are a part of it, that size with cx and cy counted "
      "from its corner; %s",
      written.c_str(), x * lens[0], y * lens[1], x * (lens[2] + 0.5) - 0.5,
      y * (lens[3] + 0.5) - 0.5, again.c_str());
}

}  // namespace kincal
