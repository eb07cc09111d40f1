#include "raw_image.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "bytes.h"

namespace kincal {
namespace {

/// How an encoding lays out its pixels.
struct Layout {
  enum class Kind { grey, colours, bayer, yuv } kind = Kind::grey;
  int channels = 1, bytes = 1;  // of a pixel; of a number
  int red = 0, blue = 2;        // channel; of a Bayer pattern the first row's colour: see below
  int luma = 0;                 // yuv: where Y is in a pair
};

/// Where red is in the 2 x 2 pixels of a pattern: column, row. Blue is across.
struct RedPlace {
  int column, row;
};

Layout layout_of(const std::string& encoding) {
  Layout out;
  const std::string& e = encoding;
  out.bytes = e.find("16") != std::string::npos ? 2 : 1;
  if (e == "mono8" || e == "mono16" || e == "8UC1" || e == "16UC1") return out;
  out.kind = Layout::Kind::colours;
  const bool deep = out.bytes == 2;
  const std::string bits = deep ? "16" : "8";
  out.channels = e == "bgra" + bits || e == "rgba" + bits || e == bits + "UC4" ? 4 : 3;
  const bool rgb = e == "rgb" + bits || e == "rgba" + bits;
  out.red = rgb ? 0 : 2;
  out.blue = 2 - out.red;
  if (rgb || e == "bgr" + bits || e == "bgra" + bits || e == bits + "UC3" || e == bits + "UC4")
    return out;
  out.channels = 1;
  out.kind = Layout::Kind::bayer;
  for (const char* pattern : {"rggb", "bggr", "gbrg", "grbg"})
    if (e == "bayer_" + std::string(pattern) + bits) {
      const auto red = static_cast<int>(std::string(pattern).find('r'));
      out.red = red;  // 0 to 3: row * 2 + column
      return out;
    }
  out.kind = Layout::Kind::yuv;
  out.channels = 2;
  out.luma = e == "yuv422_yuy2" || e == "yuyv" ? 0 : 1;
  if (e == "yuv422" || e == "uyvy" || e == "yuv422_yuy2" || e == "yuyv") return out;
  throw Damage("images of encoding '" + encoding +
               "' are not read; mono8, mono16, bgr8, rgb8, bgra8, rgba8, bayer_* and yuv422 are");
}

/// The numbers of an image, whatever their bytes.
struct RawPixels {
  std::string_view bytes;
  size_t step;
  Layout layout;
  bool swapped;

  int at(int row, int column, int channel) const {
    const size_t place = static_cast<size_t>(row) * step +
                         static_cast<size_t>((column * layout.channels + channel) * layout.bytes);
    if (layout.bytes == 1) return static_cast<unsigned char>(bytes[place]);
    return Bytes::number_at<std::uint16_t>(bytes.substr(place, 2), 0, swapped);
  }
};

double grey_of(double red, double green, double blue) {  // as ITU-R BT.601 and OpenCV
  return 0.299 * red + 0.587 * green + 0.114 * blue;
}

/// A pixel of a Bayer pattern: the mean of each colour in the 3 x 3 around it, nearer ones twice.
double bayer_grey(const RawPixels& raw, int row, int column, int width, int height) {
  double sums[3] = {}, weights[3] = {};
  const RedPlace red{raw.layout.red % 2, raw.layout.red / 2};
  for (int dr = -1; dr <= 1; ++dr)
    for (int dc = -1; dc <= 1; ++dc) {
      const int r = row + dr, c = column + dc;
      if (r < 0 || c < 0 || r >= height || c >= width) continue;
      const bool on_red_row = r % 2 == red.row, on_red_column = c % 2 == red.column;
      const int colour = on_red_row == on_red_column ? (on_red_row ? 0 : 2) : 1;
      const double weight = (dr == 0 ? 2 : 1) * (dc == 0 ? 2 : 1);
      sums[colour] += weight * raw.at(r, c, 0);
      weights[colour] += weight;
    }
  for (int i = 0; i < 3; ++i) sums[i] /= std::max(weights[i], 1.);
  return grey_of(sums[0], sums[1], sums[2]);
}

double pixel_grey(const RawPixels& raw, int row, int column, int width, int height) {
  const Layout& layout = raw.layout;
  switch (layout.kind) {
    case Layout::Kind::colours:
      return grey_of(raw.at(row, column, layout.red), raw.at(row, column, 1),
                     raw.at(row, column, layout.blue));
    case Layout::Kind::bayer:
      return bayer_grey(raw, row, column, width, height);
    case Layout::Kind::yuv:
      return raw.at(row, column, layout.luma);
    case Layout::Kind::grey:
      break;
  }
  return raw.at(row, column, 0);
}

}  // namespace

Picture grey_picture(const MessageValue& image) {
  Picture out;
  const double width = number_of(field(image, "width")), height = number_of(field(image, "height")),
               step = number_of(field(image, "step"));
  const Layout layout = layout_of(std::string(text_of(field(image, "encoding"))));
  const NumberArray data = numbers_of(field(image, "data"));
  if (!(width >= 1) || !(height >= 1) || width > 1e5 || height > 1e5 ||
      step < width * layout.channels * layout.bytes ||
      static_cast<double>(data.bytes.size()) <
          step * (height - 1) + width * layout.channels * layout.bytes)
    throw Damage("an image has fewer bytes than pixels");
  out.width = static_cast<int>(width);
  out.height = static_cast<int>(height);
  const RawPixels raw{data.bytes, static_cast<size_t>(step), layout,
                      number_of(field(image, "is_bigendian")) != 0};
  const size_t count = static_cast<size_t>(out.width) * static_cast<size_t>(out.height);
  out.pixels.resize(count);
  if (layout.kind == Layout::Kind::grey && layout.bytes == 1) {
    for (int r = 0; r < out.height; ++r)
      std::copy_n(data.bytes.begin() + static_cast<std::ptrdiff_t>(raw.step) * r, out.width,
                  out.pixels.begin() + static_cast<std::ptrdiff_t>(out.width) * r);
    return out;
  }
  std::vector<float> grey(count);
  for (int r = 0; r < out.height; ++r)
    for (int c = 0; c < out.width; ++c)
      grey[static_cast<size_t>(r) * static_cast<size_t>(out.width) + static_cast<size_t>(c)] =
          static_cast<float>(pixel_grey(raw, r, c, out.width, out.height));
  float low = 0, high = 255;
  if (layout.bytes == 2) {
    const auto [least, greatest] = std::minmax_element(grey.begin(), grey.end());
    low = *least;
    high = std::max(*greatest, low + 1);
  }
  for (size_t i = 0; i < count; ++i)
    out.pixels[i] = static_cast<std::uint8_t>(
        std::lround(std::min(255.F, std::max(0.F, (grey[i] - low) * 255 / (high - low)))));
  return out;
}

std::string compressed_format(std::string_view bytes) {
  if (bytes.substr(0, 3) == std::string_view("\xff\xd8\xff", 3)) return "jpg";
  if (bytes.substr(0, 4) == std::string_view("\x89PNG", 4)) return "png";
  return "";
}

std::string pgm_file(const Picture& picture) {
  std::string out =
      "P5\n" + std::to_string(picture.width) + " " + std::to_string(picture.height) + "\n255\n";
  out.append(reinterpret_cast<const char*>(picture.pixels.data()), picture.pixels.size());
  return out;
}

}  // namespace kincal
