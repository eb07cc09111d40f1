#include "bag_options.h"

namespace kincal {

void add_bag_options(CLI::App& command, BagArguments& a) {
  command.add_option("BAG", a.bags, "ROS 1 bags, MCAP, SQLite files or folders of rosbag2")
      ->required();
  command.add_option("--rig", a.rig, "the rig that the samples are of");
  command.add_option("--out", a.out, "the samples to write")->type_name("FILE");
  command.add_flag("--list", a.list, "show what the bags have, and write nothing");
  command.add_flag("--force", a.force, "replace an existing file");
  command.add_flag("--quiet", a.quiet, "no progress");
}

}  // namespace kincal
