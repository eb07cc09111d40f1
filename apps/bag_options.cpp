#include "bag_options.h"

#include <cmath>

#include "../io/document/numbers.h"

namespace kincal {

std::vector<CLI::Option*> add_settling_options(CLI::App& command, SettlingArguments& a) {
  return {
      command.add_option("--rest", a.rest, "recordings: the shortest rest, s")
          ->check(CLI::Range(0.05, 3600.))
          ->capture_default_str(),
      command
          .add_option("--still-joints", a.still_joints,
                      "recordings: a joint is at rest while it stays within this range, rad or m "
                      "(default: from its noise at rest)")
          ->check(CLI::PositiveNumber),
      command
          .add_option("--still-pixels", a.still_pixels,
                      "recordings: a target is at rest while its corners stay within this range, "
                      "px (default: from their noise)")
          ->check(CLI::PositiveNumber),
      command
          .add_option("--distinct", a.distinct,
                      "recordings: of postures closer together than this (rad, m) only the first "
                      "is used; 0: all are used")
          ->check(CLI::NonNegativeNumber)
          ->capture_default_str(),
      command
          .add_option("--images", a.images,
                      "recordings: largest number of images per camera and rest")
          ->check(CLI::Range(1, 1000))
          ->capture_default_str(),
      command.add_flag("--apply-offsets", a.apply_offsets,
                       "recordings: correct the time stamps of images by the time offsets found"),
      command.add_flag("--no-offsets", a.no_offsets,
                       "recordings: do not search for time offsets (the search needs images of the "
                       "moving robot)"),
      command
          .add_option(
              "--threads", a.threads,
              "recordings: number of threads (the result does not depend on it); 0: all processors")
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
  command.add_option("--rig", a.rig, "the rig of the samples");
  command.add_option("--out", a.out, "file for the samples")->type_name("FILE");
  command.add_flag("--list", a.list, "show the contents of the bags and write nothing");
  command.add_flag("--force", a.force, "replace an existing file");
  command.add_flag("--quiet", a.quiet, "no progress");
  add_settling_options(command, a.settling);
}

}  // namespace kincal
