#include "containers.h"

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "../document/error.h"

namespace kincal {

BagFile::BagFile(const std::string& path) : in_(path, std::ios::binary | std::ios::ate) {
  if (!in_) throw InputError(path + ": " + std::strerror(errno));
  size_ = static_cast<std::uint64_t>(in_.tellg());
  in_.seekg(0);
}

void BagFile::seek(std::uint64_t to) {
  position_ = to;
  in_.clear();
  in_.seekg(static_cast<std::streamoff>(to));
}

std::string_view BagFile::read(std::uint64_t count, std::string& into) {
  if (count > size_ - position_) throw Damage("it ends too early");
  if (into.size() < count) into.resize(count);
  if (!in_.read(into.data(), static_cast<std::streamsize>(count)))
    throw Damage("the disk cannot read it");
  position_ += count;
  return std::string_view(into).substr(0, count);
}

void BagReading::lost(const std::string& what) {
  constexpr size_t most = 20;
  if (contents.losses.size() < most)
    contents.losses.push_back(what);
  else
    ++contents.more_losses;
}

void BagReading::compressed(const std::string& how) {
  std::vector<std::string>& all = contents.compressions;
  if (std::find(all.begin(), all.end(), how) == all.end()) all.push_back(how);
}

void go_on_behind(const Damage& damage, std::uint64_t start,
                  const std::vector<std::uint64_t>& chunks, BagFile& file, BagReading& reading) {
  const auto next = std::upper_bound(chunks.begin(), chunks.end(), start);
  const std::uint64_t to = next == chunks.end() ? file.size() : std::min(*next, file.size());
  reading.lost("bytes " + std::to_string(start) + " to " + std::to_string(to) + ": " +
               damage.what());
  file.seek(to);
}

}  // namespace kincal
