#include "still_images.h"

#include <algorithm>
#include <map>
#include <set>

#include "../images/parallel.h"
#include "bytes.h"

namespace kincal {
namespace {

constexpr size_t kImagesAtOnce = 16;                  // images in memory
constexpr size_t kBytesAtOnce = size_t{48} << 20;     // or fewer, if they are large
constexpr double kMostImages = 3000, kImageRate = 5;  // of a camera, all through; Hz
constexpr int kSearchedForAll = 2;  // images of a rest that are searched for all targets

/// A Wanted image: of which camera, and when.
struct WantedImage {
  int sensor = -1, rest = -1, way_from = -1;
  int nth = 0;  // of its rest
  double time = 0;
};

/// By stream and image: what it is wanted for.
using WantedImages = std::map<std::pair<int, size_t>, WantedImage>;

/// At most `most` of some things, evenly.
std::vector<size_t> evenly(const std::vector<size_t>& of, int most) {
  const auto n = static_cast<size_t>(std::max(0, most));
  if (of.size() <= n) return of;
  std::vector<size_t> out;
  for (size_t i = 0; i < n; ++i) out.push_back(of[(2 * i + 1) * of.size() / (2 * n)]);
  return out;
}

std::vector<size_t> images_in(const ImageStream& stream, const TimeInterval& time) {
  std::vector<size_t> out;
  for (size_t i = 0; i < stream.times.size(); ++i)
    if (time.contains(stream.times[i])) out.push_back(i);
  return out;
}

WantedImages wanted_images(const RecordedStreams& streams, const std::vector<int>& images,
                           const Intervals& rests, const LookOptions& options) {
  WantedImages out;
  const int ways = std::max(1, static_cast<int>(rests.size()) - 1);
  const int on_way = std::min(options.on_way, std::max(1, options.most_on_ways / ways));
  const size_t every = static_cast<size_t>(1 + ways / std::max(1, options.most_on_ways));
  for (size_t s = 0; s < images.size(); ++s) {
    if (images[s] < 0) continue;
    const ImageStream& stream = streams.images[images[s]];
    for (size_t r = 0; r < rests.size(); ++r) {
      int nth = 0;
      for (const size_t i : evenly(images_in(stream, rests[r]), options.in_rest))
        out[{images[s], i}] = {static_cast<int>(s), static_cast<int>(r), -1, nth++,
                               stream.times[i]};
      if (r + 1 == rests.size() || r % every != 0) continue;
      const TimeInterval way{rests[r].end, rests[r + 1].begin};
      for (const size_t i : evenly(images_in(stream, way), on_way))
        out.insert(
            {{images[s], i}, {static_cast<int>(s), -1, static_cast<int>(r), 0, stream.times[i]}});
    }
  }
  return out;
}

using ImageVisit = std::function<void(int, size_t, const BagMessage&, const MessageValue&)>;

/// Calls `visit` for each image of the rig's cameras: stream, which image of it, the message.
void visit_images(const Recorded& recorded, const ImageVisit& visit) {
  std::map<std::string, int> topics;
  for (const int stream : recorded.topics.images)
    if (stream >= 0) topics[recorded.streams.images[stream].topic] = stream;
  read_again(recorded.bags, topics, true, visit);
}

/// An image that waits to be searched.
struct PendingImage {
  WantedImage wanted;
  std::string bytes, type;
  MessageTypes types;
  Wire wire = Wire::ros1;
  std::vector<int> targets;
  LookResult result;
};

/// A Searcher collects images and searches them, some at a time.
class Searcher {
 public:
  Searcher(const TargetSearch& search, const LookOptions& options, size_t sensors)
      : search_(search), options_(options) {
    out_.images.assign(sensors, 0);
  }

  void add(const WantedImage& wanted, const BagMessage& raw) {
    PendingImage one;
    one.wanted = wanted;
    one.bytes = std::string(raw.data);
    one.type = raw.topic->type;
    one.types = read_definition(raw.topic->type, raw.topic->definition);
    one.wire = raw.topic->encoding == "cdr" ? Wire::cdr : Wire::ros1;
    bytes_ += one.bytes.size();
    pending_.push_back(std::move(one));
    if (pending_.size() >= kImagesAtOnce || bytes_ >= kBytesAtOnce) work();
  }

  LookedAt finish() {
    work();
    for (const auto& [text, count] : unusable_)
      out_.notes.push_back(text + " (" + std::to_string(count) + " images)");
    out_.notes.insert(out_.notes.end(), said_.begin(), said_.end());
    return std::move(out_);
  }

 private:
  bool for_all(const WantedImage& wanted) const {
    return wanted.rest >= 0 && (wanted.nth < kSearchedForAll || options_.all_targets);
  }

  std::vector<int> targets_for(const WantedImage& wanted) const {
    if (for_all(wanted)) return search_.targets;
    const auto found =
        seen_.find({wanted.sensor, wanted.rest >= 0 ? wanted.rest : wanted.way_from});
    if (found == seen_.end()) return {};
    return {found->second.begin(), found->second.end()};
  }

  void work() {
    // What an image is searched for may depend on others that wait with it: first those that are
    // searched for everything.
    for (const bool first : {true, false}) {
      std::vector<PendingImage*> some;
      for (PendingImage& one : pending_) {
        if (for_all(one.wanted) != first) continue;
        one.targets = targets_for(one.wanted);
        if (!one.targets.empty()) some.push_back(&one);
      }
      in_parallel(some.size(), options_.threads, [&](size_t i) { look(*some[i]); }, {});
      for (const PendingImage* one : some)
        for (const Sighting& seen : one->result.seen)
          if (one->wanted.rest >= 0)
            seen_[{one->wanted.sensor, one->wanted.rest}].insert(seen.target);
    }
    for (PendingImage& one : pending_) keep(one);
    pending_.clear();
    bytes_ = 0;
  }

  void look(PendingImage& one) const try {
    const MessageValue image = decode_message(one.types, one.wire, one.bytes);
    one.result =
        search_.look(image, one.type != "sensor_msgs/Image", one.wanted.sensor, one.targets);
  } catch (const Damage& damage) {
    one.result.unusable = damage.what();
  }

  void keep(PendingImage& one) {
    if (!one.targets.empty()) ++out_.images[one.wanted.sensor];
    if (!one.result.unusable.empty()) ++unusable_[one.result.unusable];
    said_.insert(one.result.notes.begin(), one.result.notes.end());
    for (Sighting& seen : one.result.seen) {
      seen.sensor = one.wanted.sensor;
      seen.rest = one.wanted.rest;
      seen.way_from = one.wanted.way_from;
      seen.frame.time = one.wanted.time;
      out_.sightings.push_back(std::move(seen));
    }
  }

  const TargetSearch& search_;
  const LookOptions& options_;
  LookedAt out_;
  std::vector<PendingImage> pending_;
  size_t bytes_ = 0;
  std::map<std::pair<int, int>, std::set<int>> seen_;  // by sensor and rest: targets
  std::map<std::string, int> unusable_;
  std::set<std::string> said_;
};

}  // namespace

LookedAt look_at_images(const Recorded& recorded, const Intervals& rests,
                        const TargetSearch& search, const LookOptions& options) {
  const WantedImages wanted =
      wanted_images(recorded.streams, recorded.topics.images, rests, options);
  Searcher searcher(search, options, recorded.topics.images.size());
  size_t done = 0;
  visit_images(recorded, [&](int stream, size_t image, const BagMessage& raw, const auto&) {
    const auto found = wanted.find({stream, image});
    if (found == wanted.end()) return;
    searcher.add(found->second, raw);
    options.progress.share(static_cast<double>(++done), static_cast<double>(wanted.size()));
  });
  return searcher.finish();
}

TimeInterval recorded_time(const RecordedStreams& streams) {
  TimeInterval all{0, streams.duration};
  for (const ImageStream& s : streams.images)
    for (const double t : s.times)
      all.begin = std::min(all.begin, t), all.end = std::max(all.end, t);
  return all;
}

LookOptions look_through(const TimeInterval& whole, LookOptions look) {
  look.on_way = 0;
  look.in_rest =
      std::max(look.in_rest, static_cast<int>(std::min(kMostImages, kImageRate * whole.length())));
  look.all_targets = true;
  return look;
}

FramesOfViews frames_of_views(const std::vector<Sighting>& sightings) {
  FramesOfViews all;
  for (const Sighting& one : sightings)
    if (one.rest >= 0) all[{one.sensor, one.target}][one.rest].push_back(one.frame);
  for (auto& [view, by_rest] : all)
    for (auto& [rest, frames] : by_rest)
      std::stable_sort(frames.begin(), frames.end(),
                       [](const CornerFrame& a, const CornerFrame& b) { return a.time < b.time; });
  return all;
}

void visit_middle_images(const Recorded& recorded, const Intervals& rests, const GetImage& visit) {
  const std::vector<int>& images = recorded.topics.images;
  std::map<std::pair<int, size_t>, std::pair<int, int>> wanted;  // sensor and rest
  for (int s = 0; s < static_cast<int>(images.size()); ++s)
    for (int r = 0; r < static_cast<int>(rests.size()) && images[s] >= 0; ++r) {
      const std::vector<size_t> inside = images_in(recorded.streams.images[images[s]], rests[r]);
      if (!inside.empty()) wanted[{images[s], inside[inside.size() / 2]}] = {s, r};
    }
  visit_images(recorded,
               [&](int stream, size_t image, const BagMessage& raw, const MessageValue& value) {
                 const auto found = wanted.find({stream, image});
                 if (found != wanted.end())
                   visit(found->second.first, found->second.second, value,
                         raw.topic->type != "sensor_msgs/Image");
               });
}

}  // namespace kincal
