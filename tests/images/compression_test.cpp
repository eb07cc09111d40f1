// Proves what is read of a JPEG's tables: the steps of brightness, row by row, of plain and
// progressive files, of tables of 8 and 16 bits, in any of the four places, behind EXIF and bytes
// that fill; and that what is cut off, or no JPEG, has none. Not proved: what is made of the steps
// (detect_test.cpp, and benchmarks/detectors).
#include "../../io/images/compression.h"

#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "../fixtures/render.h"
#include "catch2/catch.hpp"

namespace compression_test {

using namespace kincal;

namespace {

/// The table of brightness of the standard (annex K), which quality 50 has.
constexpr std::array<int, 64> kStandard = {
    16, 11, 10, 16, 24,  40,  51,  61,  12, 12, 14, 19, 26,  58,  60,  55,
    14, 13, 16, 24, 40,  57,  69,  56,  14, 17, 22, 29, 51,  87,  80,  62,
    18, 22, 37, 56, 68,  109, 103, 77,  24, 35, 55, 64, 81,  104, 113, 92,
    49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99};

std::vector<uchar> jpeg(int type, std::vector<int> words) {
  cv::Mat image(40, 60, type);
  cv::randu(image, 0, 255);
  std::vector<uchar> out;
  cv::imencode(".jpg", image, out, words);
  return out;
}

Compression read(const std::vector<uchar>& bytes) {
  return compression_of({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

std::string bytes_of(std::initializer_list<int> all) {
  std::string out;
  for (const int one : all) out += static_cast<char>(one);
  return out;
}

/// A table of 1, 2, 3 ... in the order of the file, of so many bytes each, in a place.
std::string table(int bytes, int place) {
  std::string out = bytes_of({0xFF, 0xDB, 0, 3 + 64 * bytes, (bytes - 1) * 16 + place});
  for (int k = 1; k <= 64; ++k) {
    if (bytes == 2) out += static_cast<char>(k == 64 ? 2 : 0);
    out += static_cast<char>(k);
  }
  return out;
}

/// The head of a frame of one component with the table at a place, and the begin of its scan.
std::string frame(int place) {
  return bytes_of({0xFF, 0xC0, 0, 11, 8, 0, 8, 0, 8, 1, 1, 0x11, place}) +
         bytes_of({0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 63, 0});
}

const std::string kBegin = bytes_of({0xFF, 0xD8});

}  // namespace

TEST_CASE("images: the steps of a JPEG are those of its brightness") {
  CHECK(read(jpeg(CV_8U, {cv::IMWRITE_JPEG_QUALITY, 50})).steps == kStandard);
  CHECK(read(jpeg(CV_8UC3, {cv::IMWRITE_JPEG_QUALITY, 50})).steps == kStandard);
  CHECK(read(jpeg(CV_8U, {cv::IMWRITE_JPEG_QUALITY, 50, cv::IMWRITE_JPEG_PROGRESSIVE, 1})).steps ==
        kStandard);
  CHECK(read(fixtures::asking_for_a_turn(jpeg(CV_8U, {cv::IMWRITE_JPEG_QUALITY, 50}))).steps ==
        kStandard);
  std::array<int, 64> ones;
  ones.fill(1);
  CHECK(read(jpeg(CV_8U, {cv::IMWRITE_JPEG_QUALITY, 100})).steps == ones);
}

TEST_CASE("images: tables of a JPEG by place and by size of their numbers") {
  // The third number of the file is the first of the second row, the last one the last.
  const Compression one = compression_of(kBegin + table(1, 0) + frame(0));
  CHECK(one.steps[0] == 1);
  CHECK(one.steps[1] == 2);
  CHECK(one.steps[8] == 3);
  CHECK(one.steps[63] == 64);
  const Compression two =
      compression_of(kBegin + bytes_of({0xFF, 0xFF}) + table(1, 0) + table(2, 3) + frame(3));
  CHECK(two.steps[8] == 3);
  CHECK(two.steps[63] == 2 * 256 + 64);
  CHECK(!compression_of(kBegin + table(1, 0) + frame(2)).any());  // it has no such table
}

TEST_CASE("images: what is cut off, or no JPEG, has no steps") {
  const std::vector<uchar> whole = jpeg(CV_8U, {cv::IMWRITE_JPEG_QUALITY, 50});
  for (size_t size = 0; size < whole.size(); ++size) {
    const Compression found = read({whole.begin(), whole.begin() + static_cast<long>(size)});
    if (found.any()) CHECK(found.steps == kStandard);
  }
  std::vector<uchar> png;
  cv::imencode(".png", cv::Mat::zeros(40, 60, CV_8U), png);
  CHECK(!read(png).any());
  CHECK(!compression_of("").any());
  CHECK(!compression_of(kBegin + table(1, 0)).any());  // no scan
  std::string lying = kBegin + table(1, 0) + frame(0);
  lying[5] = 60;  // the length of the table: fewer than 64 numbers
  CHECK(!compression_of(lying).any());
  lying[5] = 1;  // less than the length itself takes
  CHECK(!compression_of(lying).any());
}

}  // namespace compression_test
