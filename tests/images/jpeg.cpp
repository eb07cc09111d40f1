// Writes a JPEG for tests that have no encoder: jpeg-of-grey WIDTH HEIGHT QUALITY < pixels > file
#include <cstdio>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <vector>

int main(int count, char** words) {
  if (count != 4) return 2;
  cv::Mat grey(std::atoi(words[2]), std::atoi(words[1]), CV_8U);
  if (std::fread(grey.data, 1, grey.total(), stdin) != grey.total()) return 1;
  std::vector<uchar> file;
  cv::imencode(".jpg", grey, file, {cv::IMWRITE_JPEG_QUALITY, std::atoi(words[3])});
  return std::fwrite(file.data(), 1, file.size(), stdout) == file.size() ? 0 : 1;
}
