#include "compression.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace kincal {
namespace {

/// Row by row, what place in a block each number of a table in the file has.
constexpr std::array<int, 64> kZigzag = {
    0,  1,  8,  16, 9,  2,  3,  10, 17, 24, 32, 25, 18, 11, 4,  5,  12, 19, 26, 33, 40, 48,
    41, 34, 27, 20, 13, 6,  7,  14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23,
    30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63};

Block make_cosines() {
  Block out;
  for (int u = 0; u < 8; ++u)
    for (int x = 0; x < 8; ++x)
      out(u, x) = std::cos((2 * x + 1) * u * CV_PI / 16) * (u == 0 ? std::sqrt(0.125) : 0.5);
  return out;
}

/// A multiple of a step, as it was found.
struct Multiple {
  double step, times;
};

/// The logarithm of how likely the multiples are for noise of sigma.
double likelihood(const std::vector<Multiple>& all, double sigma) {
  double out = 0;
  for (const Multiple& one : all) {
    const double scale = one.step / (sigma * std::sqrt(2.)), at = std::abs(one.times);
    out += std::log(
        std::max(1e-12, 0.5 * (std::erfc((at - 0.5) * scale) - std::erfc((at + 0.5) * scale))));
  }
  return out;
}

}  // namespace

Compression compression_of(std::string_view bytes) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(bytes[i]); };
  if (bytes.size() < 4 || byte(0) != 0xFF || byte(1) != 0xD8) return {};
  std::array<Compression, 4> tables;
  size_t brightness = 0;  // its table
  for (size_t at = 2; at + 4 <= bytes.size() && byte(at) == 0xFF;) {
    const int mark = byte(at + 1);
    if (mark == 0xFF) {  // a byte that fills
      ++at;
      continue;
    }
    const size_t length = 256 * byte(at + 2) + byte(at + 3), end = at + 2 + length;
    if (length < 2 || end > bytes.size()) return {};
    if (mark == 0xDB)
      for (size_t i = at + 4; i < end;) {
        const size_t size = byte(i) >> 4 ? 2 : 1, table = byte(i) & 3;
        if (++i + 64 * size > end) return {};
        for (size_t k = 0; k < 64; ++k, i += size)
          tables[table].steps[static_cast<size_t>(kZigzag[k])] =
              size == 2 ? 256 * byte(i) + byte(i + 1) : byte(i);
      }
    const bool frame = mark >= 0xC0 && mark <= 0xCF && mark != 0xC4 && mark != 0xC8 && mark != 0xCC;
    if (frame && length >= 11) brightness = byte(at + 12) & 3;
    if (mark == 0xDA) return tables[brightness];
    at = end;
  }
  return {};
}

Block cosine_transform(const Block& pixels) {
  static const Block cosines = make_cosines();
  return cosines * pixels * cosines.t();
}

double noise_before(const cv::Mat& image, const cv::Rect& box, const Compression& compression) {
  constexpr int kLow = 2;         // u + v up to which coefficients say whether a block is flat
  constexpr size_t kFewest = 12;  // blocks
  std::vector<std::pair<double, Block>> blocks;
  for (int top = (box.y + 7) / 8 * 8; top + 8 <= box.y + box.height; top += 8)
    for (int left = (box.x + 7) / 8 * 8; left + 8 <= box.x + box.width; left += 8) {
      Block pixels;
      for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 8; ++x) pixels(x, y) = image.at<uchar>(top + y, left + x);
      const Block c = cosine_transform(pixels);
      double low = 0;
      for (int u = 0; u <= kLow; ++u)
        for (int v = u == 0 ? 1 : 0; u + v <= kLow; ++v) low += c(u, v) * c(u, v);
      blocks.emplace_back(low, c);
    }
  const size_t flat = std::max(kFewest, blocks.size() / 16);
  if (blocks.size() < 2 * flat) return -1;
  std::stable_sort(blocks.begin(), blocks.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Multiple> multiples;
  for (size_t i = 0; i < flat; ++i)
    for (int u = 0; u < 8; ++u)
      for (int v = 0; v < 8; ++v) {
        const double step = compression.steps[static_cast<size_t>(v) * 8 + static_cast<size_t>(u)];
        if (u + v > kLow && step > 0)
          multiples.push_back({step, std::round(blocks[i].second(u, v) / step)});
      }
  double best = 0, most = -1e300;
  for (double sigma = 0.1; sigma < 40; sigma *= 1.06)
    if (const double here = likelihood(multiples, sigma); here > most) most = here, best = sigma;
  return best;
}

}  // namespace kincal
