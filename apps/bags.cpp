// The program kincal-bags, which `kincal import` becomes where a file is a bag: from recordings,
// and tables of joint readings beside them, to samples.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <exception>
#include <iostream>
#include <map>
#include <thread>

#include "../io/document/error.h"
#include "../io/document/files.h"
#include "../io/document/names.h"
#include "../io/exchange/guess.h"
#include "../io/exchange/joint_table.h"
#include "../io/recordings/bag.h"
#include "../io/recordings/bag_files.h"
#include "../io/recordings/bytes.h"
#include "../io/recordings/import.h"
#include "../io/recordings/message.h"
#include "../io/recordings/record_command.h"
#include "../io/recordings/robot_measurement.h"
#include "../io/recordings/streams.h"
#include "../io/recordings/topics.h"
#include "../io/rig/samples_file.h"
#include "bag_options.h"
#include "progress_line.h"
#include "sibling_main.h"
#include "signals.h"
#ifdef KINCAL_SEARCHES_IMAGES
#include "../io/recordings/image_search.h"
#endif

namespace {

using namespace kincal;

/// What a bag has of one topic.
struct Stream {
  std::string type, definition;
  long messages = 0;
  std::int64_t first = 0, last = 0, longest = 0;  // ns; longest: between two messages
};

std::string seconds(std::int64_t ns) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3f s", static_cast<double>(ns) * 1e-9);
  return text;
}

std::string date(std::int64_t ns) {
  const std::time_t s = static_cast<std::time_t>(ns / 1000000000);
  std::tm utc{};
  gmtime_r(&s, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%S UTC", &utc);
  return text;
}

/// The fields of a type that is none of those that are read.
std::string fields(const std::string& type, const std::string& definition) {
  try {
    const MessageTypes types = read_definition(type, definition);
    std::string out;
    for (const MessageField& one : types[0].fields)
      out += (out.empty() ? "" : ", ") + one.name + (one.array ? "[]" : "");
    return out;
  } catch (const Damage& damage) {
    return damage.what();
  }
}

/// Returns whether anything could be read.
bool list(const std::string& path, ProgressLine& line) {
  std::map<std::string, Stream> streams;
  std::int64_t first = 0, last = 0;
  long messages = 0;
  const auto visit = [&](const BagMessage& m) {
    Stream& s = streams[m.topic->name];
    if (s.messages > 0) s.longest = std::max(s.longest, m.received - s.last);
    if (s.messages++ == 0) s.first = m.received;
    s.last = m.received;
    first = messages == 0 ? m.received : std::min(first, m.received);
    last = std::max(last, m.received);
    ++messages;
    return true;
  };
  const BagContents contents = read_bag(path, visit, line.progress().in("reading " + path));
  line.clear();
  size_t width = 5, type_width = 4;
  for (const auto& topic : contents.topics) {
    Stream& s = streams[topic->name];
    s.type = topic->type;
    s.definition = topic->definition;
    width = std::max(width, topic->name.size());
    type_width = std::max(type_width, topic->type.size());
  }
  std::cout << path << ": " << contents.container;
  for (const std::string& how : contents.compressions) std::cout << ", " << how;
  std::cout << "; " << messages << " messages";
  if (messages > 0) std::cout << " in " << seconds(last - first) << " from " << date(first);
  std::cout << "\n";
  std::printf("  %-*s %-*s %9s %9s %12s %12s\n", static_cast<int>(width), "topic",
              static_cast<int>(type_width), "type", "messages", "Hz", "first at", "longest gap");
  for (const auto& [name, s] : streams) {
    const double span = static_cast<double>(s.last - s.first) * 1e-9;
    char rate[32] = "-";
    if (s.messages > 1 && span > 0)
      std::snprintf(rate, sizeof rate, "%.1f", static_cast<double>(s.messages - 1) / span);
    std::printf("  %-*s %-*s %9ld %9s %12s %12s\n", static_cast<int>(width), name.c_str(),
                static_cast<int>(type_width), s.type.c_str(), s.messages, rate,
                s.messages ? seconds(s.first - first).c_str() : "-",
                s.messages > 1 ? seconds(s.longest).c_str() : "-");
  }
  for (const auto& [name, s] : streams)
    if (standard_definition(s.type).empty())
      std::cout << "  " << s.type << " (" << name << ") has: " << fields(s.type, s.definition)
                << "\n";
  for (const std::string& loss : contents.losses) std::cout << "  LOST: " << loss << "\n";
  if (contents.more_losses > 0) std::cout << "  LOST: and " << contents.more_losses << " more\n";
  return messages > 0;
}

void say_losses(const std::vector<std::string>& losses) {
  for (const std::string& loss : losses) std::cerr << "kincal: warning: lost: " << loss << "\n";
}

void say_notes(const std::vector<std::string>& notes) {
  for (const std::string& note : notes) std::cerr << "kincal: warning: " << note << "\n";
}

/// Takes the readings of joints from a table beside the bags; what bags have of them is left out.
void take_readings(const std::string& path, const RigFile& rig, RecordedStreams& streams) {
  std::map<std::string, std::map<double, double>> readings;  // by joint and time, s
  for (const JointRow& row : read_joint_table(path, rig.rig, {}).rows) {
    if (!row.time)
      throw InputError(row.where +
                       ": with a recording, a column `time` is expected, in seconds since 1970 "
                       "like the time stamps of the images");
    const double ns = std::abs(*row.time) > 1e15 ? 1 : 1e9;  // as ROS writes stamps, or s
    const double time = (*row.time - static_cast<double>(streams.origin) / ns) * ns * 1e-9;
    for (const auto& [joint, value] : row.joints) readings[joint].emplace(time, value);
  }
  const std::string prefix = given_joint_prefix(rig);
  for (const auto& [joint, by_time] : readings) {
    const std::string name = prefix + joint;
    auto& all = streams.joints;
    all.erase(std::remove_if(all.begin(), all.end(),
                             [&](const JointStream& s) { return s.joint == name; }),
              all.end());
    JointStream stream{path, name, {}};
    for (const auto& [time, value] : by_time) {
      stream.readings.times.push_back(time);
      stream.readings.values.push_back(value);
    }
    all.push_back(std::move(stream));
  }
}

/// What bags have, and the tables beside them.
RecordedStreams read_all(const BagArguments& a, const RigFile& rig, ProgressLine& line) {
  RecordedStreams streams = read_streams(a.bags, line.progress().in("reading"));
  for (const std::string& table : a.tables) take_readings(table, rig, streams);
  return streams;
}

/// Which topic is which sensor of the rig.
void list_topics(const BagArguments& a, ProgressLine& line) {
  const RigFile rig = read_rig(a.rig);
  const RecordedStreams streams = read_all(a, rig, line);
  line.clear();
  const TopicMap topics = find_topics(rig, streams);
  std::cout << "for " << a.rig << ":\n";
  for (const std::string& said : topics.lines) std::cout << "  " << said << "\n";
  for (const std::string& note : streams.notes) std::cout << "  NOTE: " << note << "\n";
  for (const std::string& note : topics.notes) std::cout << "  NOTE: " << note << "\n";
}

int list_all(const BagArguments& a) {
  ProgressLine line(a.quiet);
  bool any = false;
  for (const std::string& bag : a.bags) any = list(bag, line) || any;
  if (!any) throw InputError(comma_separated(a.bags) + ": no messages that could be read");
  if (!a.rig.empty()) list_topics(a, line);
  return kConverged;
}

std::string milliseconds(double offset, double sigma) {
  char text[64];
  std::snprintf(text, sizeof text, "%.2f +- %.2f ms", 1e3 * offset, 1e3 * sigma);
  return text;
}

/// What is to be said of a camera's clock.
std::string offset_line(const Rig& rig, const TimeOffset& one, bool applied) {
  std::string line =
      "offset in time of " + rig.sensors[static_cast<size_t>(one.sensor)].name + ": ";
  if (!one.why_not.empty())
    return line + "not known" + (applied ? ", and nothing is applied: " : ": ") + one.why_not;
  line += "images are stamped " + milliseconds(one.offset, one.sigma) + " later than readings (" +
          std::to_string(one.images) + " images on " + std::to_string(one.ways) + " ways)";
  char text[128];
  if (one.clock == TimeOffset::Clock::drifts) {
    std::snprintf(text, sizeof text, "; THE CLOCK DRIFTS by %.3g +- %.2g ms a minute",
                  6e4 * one.drift, 6e4 * one.drift_sigma);
    line += text;
  } else if (one.clock == TimeOffset::Clock::jumps) {
    std::snprintf(text, sizeof text, "; THE CLOCK JUMPS %.1f s after the start by ", one.jump_time);
    line += text + milliseconds(one.jump, one.jump_sigma);
  }
  return line + (applied ? "; applied" : "");
}

int write_samples(const BagArguments& a, const Rig& rig, const std::vector<Sample>& samples,
                  const std::vector<std::vector<std::string>>& images = {}) {
  begin_writing();
  if (!not_interrupted()) return say_interrupted();
  write_file(a.out, samples_text(rig, samples, images), a.force);
  std::cout << "Written to " << a.out << ": " << samples.size() << " samples\n";
  return kConverged;
}

/// Samples of messages that have all of a posture.
int import_measurements(const BagArguments& a, const RigFile& rig, ProgressLine& line) {
  std::vector<std::string> losses;
  const ImportedSamples found =
      read_robot_measurements(a.bags, rig, losses, line.progress().in("reading"));
  line.clear();
  say_losses(losses);
  say_notes(found.notes);
  return write_samples(a, rig.rig, found.samples);
}

int import_all(const BagArguments& a) {
  if (a.rig.empty() || a.out.empty())
    throw InputError(std::string(a.rig.empty() ? "--rig" : "--out") +
                     " is missing: converting a bag into samples needs a rig: kincal import " +
                     a.bags[0] +
                     " --rig rig.yaml --out samples.jsonl (or --list to see its contents)");
  check_output_file(a.out, a.force);
  const RigFile rig = read_rig(a.rig);
  ProgressLine line(a.quiet);
  RecordedStreams streams = read_all(a, rig, line);
  if (streams.robot_measurements > 0) return import_measurements(a, rig, line);
  ImportOptions options;
  const SettlingArguments& settling = a.settling;
  options.rest = settling.rest;
  options.still_joints = settling.still_joints;
  options.still_pixels = settling.still_pixels;
  options.distinct = settling.distinct;
  options.offsets = !settling.no_offsets;
  options.apply_offsets = settling.apply_offsets;
  options.look.in_rest = settling.images;
  options.look.threads = settling.threads > 0
                             ? settling.threads
                             : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  options.out = a.out;
  options.image_folder = a.out + ".images";
  options.force = a.force;
  options.progress = line.progress();
#ifdef KINCAL_SEARCHES_IMAGES
  const TargetSearch search = image_search(rig);
  const RecordedSamples found = import_recordings(a.bags, rig, streams, &search, options);
#else
  const RecordedSamples found = import_recordings(a.bags, rig, streams, nullptr, options);
#endif
  line.clear();
  say_losses(streams.losses);
  say_notes(streams.notes);
  say_notes(found.notes);
  for (const std::string& said : found.lines) std::cout << said << "\n";
  for (const TimeOffset& one : found.offsets)
    std::cout << offset_line(rig.rig, one, settling.apply_offsets) << "\n";
  if (found.samples.empty())
    throw InputError(a.bags[0] + ": no samples: " + found.diagnosis +
                     "; nothing is written (kincal import " + a.bags[0] + " --list --rig " + a.rig +
                     " shows the assignment of topics)");
  return write_samples(a, rig.rig, found.samples, found.images);
}

}  // namespace

int main(int argc, char** argv) try {
  CLI::App app("kincal-bags converts ROS recordings to samples.", "kincal import");
  BagArguments a;
  add_bag_options(app, a);
  return run_program(app, argc, argv, [&a] {
    const auto is_beside = [](const std::string& f) { return !is_bag(f) && is_table(f); };
    const auto tables = std::stable_partition(a.bags.begin(), a.bags.end(),
                                              [&](const std::string& f) { return !is_beside(f); });
    a.tables.assign(tables, a.bags.end());
    a.bags.erase(tables, a.bags.end());
    return a.list ? list_all(a) : import_all(a);
  });
} catch (const std::exception& error) {  // before the work began; what that throws is said there
  std::fprintf(stderr, "kincal: error: %s\n", error.what());
  return kincal::kBadInput;
}
