#include "bag_files.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <set>
#include <string_view>

#include "../document/document.h"
#include "../document/error.h"
#include "../document/files.h"
#include "../document/yaml.h"

namespace kincal {

namespace fs = std::filesystem;

namespace {

bool has_ending(const fs::path& path) {
  const std::string ending = path.extension().string();
  return ending == ".db3" || ending == ".mcap" || ending == ".bag" ||
         ((ending == ".zstd" || ending == ".zst") && has_ending(path.stem()));
}

}  // namespace

Container container_of(const std::string& path) {
  std::error_code status;
  if (!fs::is_regular_file(path, status)) return Container::none;  // a pipe is read once only
  std::ifstream in(path, std::ios::binary);
  std::string first(16, '\0');
  in.read(first.data(), 16);
  const std::string_view got = std::string_view(first).substr(0, static_cast<size_t>(in.gcount()));
  const auto starts = [&](std::string_view magic) { return got.substr(0, magic.size()) == magic; };
  if (starts("#ROSBAG V")) return Container::ros1;
  if (starts({"\x89MCAP0\r\n", 8})) return Container::mcap;
  if (starts({"SQLite format 3\0", 16})) return Container::sqlite;
  if (starts({"\x28\xb5\x2f\xfd", 4})) return Container::zstd;
  return Container::none;
}

BagParts bag_parts(const std::string& path) {
  std::error_code status;
  if (!fs::is_directory(path, status)) return {{{path, false}}};
  BagParts out;
  const fs::path metadata = fs::path(path) / "metadata.yaml";
  if (fs::exists(metadata, status)) {
    const std::string where = metadata.string();
    const Node node = parse_yaml(read_file(where), where);
    const Field about = top(node, where)["rosbag2_bagfile_information"];
    std::string mode = about.has("compression_mode") ? about["compression_mode"].string() : "";
    std::transform(mode.begin(), mode.end(), mode.begin(), [](unsigned char c) {
      return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : static_cast<char>(c);
    });
    std::set<fs::path> seen;
    for (const std::string& name : about["relative_file_paths"].strings()) {
      const fs::path file =
          fs::path(name).filename();  // the first rosbag2 has its folder before it
      if (file.empty() || file == "." || file == "..")
        throw InputError(where + ": relative_file_paths: '" + name + "' is no name of a file");
      if (!seen.insert(file).second)
        throw InputError(where + ": relative_file_paths: '" + name + "' is there twice");
      out.parts.push_back({(fs::path(path) / file).string(), mode == "message"});
    }
    if (about.has("message_count"))
      out.messages = about["message_count"].integer(0, std::numeric_limits<int>::max());
    return out;
  }
  for (const fs::directory_entry& entry : fs::directory_iterator(path, status))
    if (has_ending(entry.path())) out.parts.push_back({entry.path().string(), false});
  std::sort(out.parts.begin(), out.parts.end(),
            [](const BagPart& a, const BagPart& b) { return a.path < b.path; });
  return out;
}

bool is_bag(const std::string& path) {
  std::error_code status;
  return fs::is_directory(path, status) ? !bag_parts(path).parts.empty()
                                        : container_of(path) != Container::none;
}

}  // namespace kincal
