// The program kincal-bags, which `kincal import` becomes where its file is a bag: from recordings
// to samples.
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <exception>
#include <iostream>
#include <map>

#include "../io/document/error.h"
#include "../io/document/files.h"
#include "../io/recordings/bag.h"
#include "../io/recordings/bytes.h"
#include "../io/recordings/message.h"
#include "../io/recordings/robot_measurement.h"
#include "../io/rig/samples_file.h"
#include "bag_options.h"
#include "progress.h"
#include "sibling_main.h"
#include "signals.h"

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

/// @return whether anything could be read
bool list(const std::string& path, Progress& progress) {
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
  const BagContents contents = read_bag(path, visit, [&](std::uint64_t done, std::uint64_t all) {
    progress.stage("reading " + path, static_cast<double>(done) / static_cast<double>(all));
  });
  progress.clear();
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

int list_all(const BagArguments& a) {
  Progress progress(a.quiet);
  bool any = false;
  for (const std::string& bag : a.bags) any = list(bag, progress) || any;
  return any ? kConverged : kBadInput;
}

int import_all(const BagArguments& a) {
  if (a.rig.empty() || a.out.empty())
    throw InputError(std::string(a.rig.empty() ? "--rig" : "--out") +
                     " is missing: a bag becomes samples of a rig: kincal import " + a.bags[0] +
                     " --rig rig.yaml --out samples.jsonl (or --list, to see what it has)");
  check_output_file(a.out, a.force);
  const RigFile rig = read_rig(a.rig);
  Progress progress(a.quiet);
  std::vector<std::string> losses;
  const ImportedSamples found =
      read_robot_measurements(a.bags, rig, losses, [&](std::uint64_t done, std::uint64_t all) {
        progress.stage("reading", static_cast<double>(done) / static_cast<double>(all));
      });
  progress.clear();
  for (const std::string& loss : losses) std::cerr << "kincal: warning: lost: " << loss << "\n";
  for (const std::string& note : found.notes) std::cerr << "kincal: warning: " << note << "\n";
  if (found.samples.empty())
    throw InputError(
        a.bags[0] + ": no message of " + kRobotMeasurement +
        ", which is all that becomes samples by itself so far; --list shows what there "
        "is. Write images and joint readings out, and use `kincal detect`");
  begin_writing();
  if (!not_interrupted()) return say_interrupted();
  write_file(a.out, samples_text(rig.rig, found.samples), a.force);
  std::cout << "Written to " << a.out << ": " << found.samples.size() << " samples\n";
  return kConverged;
}

}  // namespace

int main(int argc, char** argv) try {
  CLI::App app("kincal-bags reads recordings of ROS and writes them as samples.", "kincal import");
  BagArguments a;
  add_bag_options(app, a);
  return run_program(app, argc, argv, [&a] { return a.list ? list_all(a) : import_all(a); });
} catch (const std::exception& error) {  // before the work began; what that throws is said there
  std::fprintf(stderr, "kincal: error: %s\n", error.what());
  return kincal::kBadInput;
}
