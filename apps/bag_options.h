// The options of `kincal import` for bags, of the program kincal-bags.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace kincal {

struct BagArguments {
  std::vector<std::string> bags;
  std::string rig, out;
  bool list = false, force = false, quiet = false;
};

void add_bag_options(CLI::App& command, BagArguments& a);

}  // namespace kincal
