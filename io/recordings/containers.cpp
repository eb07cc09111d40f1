#include "containers.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>

namespace kincal {

BagFile::BagFile(const std::string& path) : in_(path, std::ios::binary | std::ios::ate) {
  if (!in_) throw Unreadable(std::strerror(errno));
  size_ = static_cast<std::uint64_t>(in_.tellg());
  in_.seekg(0);
}

void BagFile::seek(std::uint64_t to) {
  position_ = std::min(to, size_);
  in_.clear();
  in_.seekg(static_cast<std::streamoff>(position_));
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

std::shared_ptr<const Topic> BagReading::add(Topic topic) {
  constexpr size_t longest_name = 1000;
  constexpr std::uint64_t most_definitions = std::uint64_t{64} << 20;
  for (const std::string* name : {&topic.name, &topic.type, &topic.encoding})
    if (name->size() > longest_name || std::any_of(name->begin(), name->end(), [](char c) {
          return static_cast<unsigned char>(c) < ' ' || c == 127;
        }))
      throw Damage("a topic has an invalid name");
  definitions += topic.definition.size();
  if (definitions > most_definitions) throw Damage("definitions are larger than 64 MB");
  contents.topics.push_back(std::make_shared<const Topic>(std::move(topic)));
  return contents.topics.back();
}

void BagReading::compare(const Topic& known, const Topic& again) {
  if (known.name != again.name || known.type != again.type ||
      known.definition != again.definition || known.encoding != again.encoding)
    lost("bytes of the description of topic " + known.name +
         " have changed: there are two versions; the first is used");
}

void BagReading::give(const Topic& topic, std::uint64_t received, std::string_view data) {
  if (received > static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max()))
    throw Damage("the time of a message is beyond the year 2262");
  ++given;
  if (!visit({&topic, static_cast<std::int64_t>(received), data})) ended = true;
}

void BagReading::compressed(const std::string& how) {
  std::vector<std::string>& all = contents.compressions;
  if (std::find(all.begin(), all.end(), how) == all.end()) all.push_back(how);
}

void ChunkStarts::skip_damage(const Damage& damage, std::uint64_t start, BagFile& file,
                              BagReading& reading) {
  const auto next = std::upper_bound(starts.begin(), starts.end(), start);
  const std::uint64_t to = next == starts.end() ? file.size() : std::min(*next, file.size());
  reading.lost("bytes " + std::to_string(start) + " to " + std::to_string(to) + ": " +
               damage.what());
  file.seek(to);
}

void ChunkStarts::after_damaged_chunk(std::uint64_t start, BagFile& file) {
  constexpr int most_returns = 100;  // an index made to lead back again and again is not followed
  const auto next = std::upper_bound(starts.begin(), starts.end(), start);
  if (next != starts.end() && *next < file.position() && ++returns <= most_returns)
    file.seek(*next);
}

}  // namespace kincal
