#include "bag_options.h"

#include <cmath>

#include "../io/document/numbers.h"

namespace kincal {

std::vector<CLI::Option*> add_settling_options(CLI::App& command, SettlingArguments& a) {
  return {
      command.add_option("--rest", a.rest, "of recordings: the shortest rest, s")
          ->check(CLI::Range(0.05, 3600.))
          ->capture_default_str(),
      command
          .add_option("--still-joints", a.still_joints,
                      "of recordings: joints rest while they stay within this, rad or m (default: "
                      "by the noise that each has at rest)")
          ->check(CLI::PositiveNumber),
      command
          .add_option("--still-pixels", a.still_pixels,
                      "of recordings: a target rests while its corners stay within this, px "
                      "(default: by their noise)")
          ->check(CLI::PositiveNumber),
      command
          .add_option("--distinct", a.distinct,
                      "of recordings: of postures that are closer than this (rad, m) the first "
                      "stays; 0: all do")
          ->check(CLI::NonNegativeNumber)
          ->capture_default_str(),
      command
          .add_option("--images", a.images, "of recordings: images of a camera in a rest, at most")
          ->check(CLI::Range(1, 1000))
          ->capture_default_str(),
      command.add_flag("--apply-offsets", a.apply_offsets,
                       "of recordings: correct the stamps of images by the offsets in time that "
                       "are found"),
      command.add_flag("--no-offsets", a.no_offsets,
                       "of recordings: do not look for offsets in time, which takes images of the "
                       "moving robot"),
      command
          .add_option("--threads", a.threads,
                      "of recordings: the result is the same for any number; 0: all processors")
          ->check(CLI::Range(0, 1024))
          ->capture_default_str()};
}

std::vector<std::string> words_of(const SettlingArguments& a) {
  std::vector<std::string> out = {
      "--rest",   shortest(a.rest),         "--distinct", shortest(a.distinct),
      "--images", std::to_string(a.images), "--threads",  std::to_string(a.threads)};
  const auto give = [&](const std::string& option, double value) {
    if (!std::isnan(value)) out.insert(out.end(), {option, shortest(value)});
  };
  give("--still-joints", a.still_joints);
  give("--still-pixels", a.still_pixels);
  if (a.apply_offsets) out.emplace_back("--apply-offsets");
  if (a.no_offsets) out.emplace_back("--no-offsets");
  return out;
}

void add_bag_options(CLI::App& command, BagArguments& a) {
  command.add_option("BAG", a.bags, "ROS 1 bags, MCAP, SQLite files or folders of rosbag2")
      ->required();
  command.add_option("--rig", a.rig, "the rig that the samples are of");
  command.add_option("--out", a.out, "the samples to write")->type_name("FILE");
  command.add_flag("--list", a.list, "show what the bags have, and write nothing");
  command.add_flag("--force", a.force, "replace an existing file");
  command.add_flag("--quiet", a.quiet, "no progress");
  add_settling_options(command, a.settling);
}

}  // namespace kincal
