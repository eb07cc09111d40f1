// Names: how long they may be, and in messages the nearest ones to a misspelt one, and lists.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace kincal {

/// Names of links, joints, sensors and targets have at most so many bytes: they become keys of
/// YAML, which end at 1024 characters, escapes and what stands around them included.
constexpr size_t kLongestName = 200;

/// Returns what is wrong with a name that is longer: "a name of 5000 bytes, ...", with its
/// beginning.
std::string long_name(const std::string& name);

/// Returns "; nearest: a, b, c" by edit distance, or "" if nothing is near. Case, what stands
/// between words and a prefix do not count: robot1_joint_2 and Joint2 are near joint_2.
std::string nearest_names(const std::string& name, const std::vector<std::string>& names);
/// Returns the same, or if nothing is near "; the robot has: a, b, c and 4 more" (`there_are`: "the
/// robot has").
std::string nearest_or_all(const std::string& name, const std::vector<std::string>& names,
                           const std::string& there_are);

/// Returns the share of the words of a name that are in another one; of one without separators
/// between its words (headcam) whether it is in it at all.
double name_likeness(const std::string& name, const std::string& in);

/// Returns all names in their order: "a, b, c".
std::string comma_separated(const std::vector<std::string>& names);

}  // namespace kincal
