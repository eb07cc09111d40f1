// The options of `kincal import` for bags, of the program kincal-bags.
#pragma once

#include <CLI/CLI.hpp>
#include <limits>
#include <string>
#include <vector>

namespace kincal {

/// How samples are made of recordings.
struct SettlingArguments {
  double rest = 0.5, distinct = 0;
  double still_joints = std::numeric_limits<double>::quiet_NaN(),
         still_pixels = std::numeric_limits<double>::quiet_NaN();
  int images = 10, threads = 0;
  bool apply_offsets = false, no_offsets = false;
};

struct BagArguments {
  std::vector<std::string> bags, tables;  // tables: of joint readings beside them
  std::string rig, out;
  bool list = false, force = false, quiet = false;
  SettlingArguments settling;
};

/// Adds the options of settling; returns them.
std::vector<CLI::Option*> add_settling_options(CLI::App& command, SettlingArguments& a);
/// The same as words of a command line.
std::vector<std::string> words_of(const SettlingArguments& a);

void add_bag_options(CLI::App& command, BagArguments& a);

}  // namespace kincal
