// Proves what becomes of image files that are not plain: turned ones (EXIF) are read as they are
// stored, and say so; 16 bits become 8; what is cut off, empty, no image or of another size is an
// error in words and never an exception. Not proved: every format that OpenCV reads.
#include "../../io/images/load.h"

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "../fixtures/render.h"
#include "catch2/catch.hpp"

namespace load_test {

using namespace kincal;

namespace {

/// A folder that goes with its test.
struct ImageFolder {
  std::filesystem::path path;
  ImageFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "kincal-load-XXXXXX").string();
    path = mkdtemp(name.data());
  }
  ~ImageFolder() { std::filesystem::remove_all(path); }
  std::string write(const std::string& name, const std::vector<uchar>& bytes) const {
    std::ofstream(path / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<long>(bytes.size()));
    return (path / name).string();
  }
};

cv::Mat slope() {
  cv::Mat out(40, 60, CV_8U);
  for (int y = 0; y < out.rows; ++y)
    for (int x = 0; x < out.cols; ++x) out.at<uchar>(y, x) = cv::saturate_cast<uchar>(3 * x + y);
  return out;
}

std::vector<uchar> encoded(const std::string& ending, const cv::Mat& image) {
  std::vector<uchar> out;
  cv::imencode(ending, image, out);
  return out;
}

/// A PNG that asks viewers to turn it: the chunk eXIf behind the header.
std::vector<uchar> png_asking_for_a_turn(std::vector<uchar> png) {
  std::vector<uchar> chunk = {'e',  'X', 'I', 'f', 'M', 'M', 0, 42, 0, 0, 0, 8, 0, 1, 0x01,
                              0x12, 0,   3,   0,   0,   0,   1, 0,  6, 0, 0, 0, 0, 0, 0};
  unsigned crc = 0xFFFFFFFF;
  for (const uchar byte : chunk) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1 ? 0xEDB88320 : 0);
  }
  crc = ~crc;
  const auto length = static_cast<uchar>(chunk.size() - 4);
  chunk.insert(chunk.begin(), {0, 0, 0, length});
  for (const int shift : {24, 16, 8, 0}) chunk.push_back(static_cast<uchar>(crc >> shift));
  png.insert(png.begin() + 33, chunk.begin(), chunk.end());  // signature 8, IHDR 25
  return png;
}

}  // namespace

TEST_CASE("images: a turn that EXIF asks for is said and not done") {
  const ImageFolder folder;
  for (const char* name : {"turned.jpg", "turned.JPG", "turned.png"}) {
    const std::string path =
        folder.write(name, name == std::string("turned.png")
                               ? png_asking_for_a_turn(encoded(".png", slope()))
                               : fixtures::asking_for_a_turn(encoded(".jpg", slope())));
    REQUIRE(cv::imread(path, cv::IMREAD_GRAYSCALE).size() == cv::Size(40, 60));  // it would be done
    const LoadedImage image = load_image(path, 60, 40);
    REQUIRE(image.error.empty());
    CHECK(image.grey.size() == cv::Size(60, 40));
    CHECK(cv::norm(image.grey, slope(), cv::NORM_INF) < 10);
    REQUIRE(image.notes.size() == 1);
    CHECK(image.notes[0].find("EXIF") != std::string::npos);
    CHECK(load_image(path, 40, 60).error == "has 60 x 40 pixels, the rig's image_size is 40 x 60");
  }
  CHECK(load_image(folder.write("plain.png", encoded(".png", slope())), 0, 0).notes.empty());
  CHECK(load_image(folder.write("plain.jpg", encoded(".jpg", slope())), 0, 0).notes.empty());
}

TEST_CASE("images: 16 bits become 8, and it is said") {
  const ImageFolder folder;
  cv::Mat deep;
  slope().convertTo(deep, CV_16U, 16);  // 12 bits
  for (const char* ending : {".png", ".tiff"}) {
    const LoadedImage image =
        load_image(folder.write(std::string("deep") + ending, encoded(ending, deep)), 60, 40);
    REQUIRE(image.error.empty());
    REQUIRE(image.grey.type() == CV_8U);
    CHECK(image.grey.at<uchar>(0, 0) == 0);
    CHECK(image.grey.at<uchar>(39, 59) == 255);
    CHECK(image.notes.size() == 1);
  }
}

TEST_CASE("images: what is no usable image is an error in words") {
  const ImageFolder folder;
  const std::vector<uchar> png = encoded(".png", slope()), half(png.begin(), png.begin() + 60);
  const std::string text = "image,j\na.png,1\n";
  CHECK(load_image(folder.write("half.png", half), 60, 40).grey.empty());
  CHECK(load_image(folder.write("text.png", {text.begin(), text.end()}), 60, 40).error ==
        "cannot be read: broken, or no image");
  CHECK(load_image(folder.write("empty.png", {}), 60, 40).error == "is empty");
  CHECK(load_image((folder.path / "none.png").string(), 60, 40).error == "is not there");
  CHECK(load_image(folder.path.string(), 60, 40).error == "is no file");
  CHECK(load_image(folder.write("whole.png", png), 64, 48).error ==
        "has 60 x 40 pixels, the rig's image_size is 64 x 48");
}

}  // namespace load_test
