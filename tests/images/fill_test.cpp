// Proves what only all images of a set tell: a ChArUco board with an odd number of columns that is
// seen in part suits both of OpenCV's layouts, and is read by the one that the other images have;
// where no image tells, that is said. A row too many in the rig, another dictionary and pictures of
// another size are named. What is unusual about images is counted. Not proved: other
// files and tables (program/detect_test.py).
#include "../../io/images/fill.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "../../io/images/print.h"
#include "../fixtures/render.h"
#include "catch2/catch.hpp"

namespace fill_test {

using namespace kincal;
using namespace fixtures;

namespace {

constexpr int kRows = 6, kColumns = 7;

ImageTarget board_of(int rows) {
  ImageTarget out;
  out.kind = ImageTarget::Kind::charuco;
  out.rows = rows, out.columns = kColumns, out.marker = 0.7;
  out.dictionary = 6;  // DICT_5X5_250
  return out;
}

/// The print with a bright upper left square: marker k is in square 2 k, where that with a dark one
/// has it in square 2 k + 1, both counted by rows.
double bright_first(double x, double y) {
  static const Print print = print_of(board_of(kRows + 1));
  const int c = static_cast<int>(std::floor(x)), r = static_cast<int>(std::floor(y));
  if (c < 0 || r < 0 || c >= kColumns || r >= kRows) return 1;
  const int next = r * kColumns + c + 1;
  return print.brightness(next % kColumns + x - c, next / kColumns + y - r);
}

/// A folder with a rig and two images, that goes with its test.
struct Folder {
  std::filesystem::path path;
  PictureCamera whole, part;
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "kincal-fill-XXXXXX").string();
    path = mkdtemp(name.data());
    std::ofstream(path / "rig.yaml")
        << "format: kincal/1\nrobot: {base: base, flange: hand}\ntargets:\n"
           "  board: {type: charuco, rows: 6, columns: 7, square: 0.03, marker: 0.021, "
           "dictionary: DICT_5X5_250, mount: {link: base}}\nsensors:\n"
           "  eye: {type: camera, link: hand, model: pinhole, intrinsics: [600, 600, 320, 240], "
           "image_size: [640, 480], sigma: 0.2}\n";
    whole.rotation = turned(0.2, 0.1, 0.1);
    aim(whole, 3.5, 3, 11);
    part.rotation = turned(0.1, 0, 0.03);
    aim(part, 3.5, 3, 5);  // neither the left nor the right column is in it
    cv::imwrite((path / "part.png").string(), render(part, bright_first));
  }
  /// Changes words of the rig.
  void write_rig(const std::string& from, const std::string& to) const {
    std::stringstream text;
    text << std::ifstream(path / "rig.yaml").rdbuf();
    std::string rig = text.str();
    rig.replace(rig.find(from), from.size(), to);
    std::ofstream(path / "rig.yaml") << rig;
  }
  ~Folder() { std::filesystem::remove_all(path); }
  Filled fill() const {
    FillOptions options;
    options.out = (path / "out.jsonl").string();
    return fill_images(read_rig((path / "rig.yaml").string()), image_files(path.string()), options);
  }
};

/// The largest distance of what a line of samples has from where the corners are, px.
double worst_of(const std::string& line, const PictureCamera& camera) {
  const auto view = nlohmann::json::parse(line)["views"][0];
  double worst = 0;
  for (size_t i = 0; i < view["pixels"].size(); ++i) {
    const int id = view.contains("ids") ? view["ids"][i].get<int>() : static_cast<int>(i);
    const cv::Point2d p =
        project(camera, id % (kColumns - 1) + 1., static_cast<double>(id / (kColumns - 1)) + 1);
    worst = std::max(worst, cv::norm(p - cv::Point2d(view["pixels"][i][0], view["pixels"][i][1])));
  }
  return worst;
}

}  // namespace

TEST_CASE("images: which layout a ChArUco board has is told by all images together") {
  const Folder folder;
  const Filled alone = folder.fill();
  REQUIRE(alone.found == 1);
  REQUIRE(alone.notes.size() >= 1);
  CHECK(alone.notes[0].find("target 'board': the image suits both layouts") == 0);
  cv::imwrite((folder.path / "whole.png").string(), render(folder.whole, bright_first));
  const Filled both = folder.fill();
  REQUIRE(both.found == 2);
  const size_t end = both.text.find('\n');
  CHECK(worst_of(both.text.substr(0, end), folder.part) < 0.2);  // in the order of the names
  CHECK(worst_of(both.text.substr(end + 1), folder.whole) < 0.2);
  bool said = false;
  for (const std::string& note : both.notes)
    said = said || note.find("part.png: board: read again") != std::string::npos;
  CHECK(said);
}

TEST_CASE("images: what no image shows, and what is there instead") {
  const struct {
    const char *from, *to, *note;
  } cases[] = {
      {"rows: 6", "rows: 7", "in 3 the print ends where it should be"},
      {"DICT_5X5_250", "DICT_4X4_50",
       "show markers of DICT_5X5_50, ids 0 to 20: write dictionary: DICT_5X5_50"},
      {"[640, 480]", "[320, 240]",
       "all 4 images of 'eye': each has 640 x 480 pixels, the rig's image_size is 320 x 240. If "
       "they show the same, smaller or larger (scaled, binned), write image_size: [640, "
       "480], intrinsics: [1200, 1200, 640.5, 480.5]; if they are a part of it"}};
  for (const auto& one : cases) {
    const Folder folder;
    for (const char* name : {"1.png", "2.png", "3.png"})
      cv::imwrite((folder.path / name).string(), render(folder.whole, bright_first));
    folder.write_rig(one.from, one.to);
    const Filled filled = folder.fill();
    std::string notes;
    for (const std::string& note : filled.notes) notes += note + "\n";
    INFO(notes);
    CHECK(notes.find(one.note) != std::string::npos);
  }
}

TEST_CASE("images: turns that EXIF asks for are named and counted, and not done") {
  const Folder folder;
  std::filesystem::remove(folder.path / "part.png");
  std::vector<uchar> jpeg;
  cv::imencode(".jpg", render(folder.whole, bright_first), jpeg, {cv::IMWRITE_JPEG_QUALITY, 98});
  for (const char* name : {"plain.jpg", "turned.jpg", "turned_too.JPG"}) {
    const bool plain = name[0] == 'p';
    const std::vector<uchar> bytes = plain ? jpeg : asking_for_a_turn(jpeg);
    std::ofstream(folder.path / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<long>(bytes.size()));
  }
  const Filled filled = folder.fill();
  REQUIRE(filled.found == 3);
  std::istringstream samples(filled.text);
  for (std::string line; std::getline(samples, line);) CHECK(worst_of(line, folder.whole) < 0.2);
  int named = 0;
  for (const std::string& line : filled.lines)
    named += line.find("turned") != std::string::npos &&
             line.find("the image asks to be turned (EXIF)") != std::string::npos;
  CHECK(named == 2);
  REQUIRE(!filled.notes.empty());
  CHECK(std::count_if(filled.notes.begin(), filled.notes.end(), [](const std::string& note) {
          return note.find("2 of 3 images: each asks to be turned (EXIF)") == 0;
        }) == 1);
}

}  // namespace fill_test
