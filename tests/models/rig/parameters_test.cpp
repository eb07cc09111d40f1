// models/rig/parameters.h: what names and globs select, against fnmatch on every name.
#include "../../../models/rig/parameters.h"

#include <fnmatch.h>

#include <algorithm>
#include <catch2/catch.hpp>

#include "../../fixtures/rigs.h"

namespace parameters_test {

using namespace kincal;

TEST_CASE("parameters: a name means itself, a glob what fnmatch says of each name") {
  Rig rig = fixture::nasty_robot();
  rig.sensors[0].name = "odd[1]*name";
  const ParameterTable table(rig);
  std::vector<std::string> patterns = {"*",
                                       "joint/*",
                                       "joint/*/offset",
                                       "*/offset",
                                       "*.rx",
                                       "*/origin.?",
                                       "joint/*/origin.[xy]",
                                       "*/[so]*t",
                                       "?oint/*scale",
                                       "[!j]*",
                                       "sensor/*/pose.r[xyz]",
                                       "*[",
                                       "[",
                                       "*]",
                                       "sensor/odd[[]1]*",
                                       "sensor/odd[1]*name/pose",
                                       "sensor/odd[1]*",
                                       "*/po*e",
                                       "joint/*/*/*",
                                       "*.",
                                       "nothing",
                                       "nothing*",
                                       "",
                                       "joint",
                                       "target/*/points.1*"};
  for (const std::string& name : table.names()) patterns.push_back(name);
  for (const std::string& pattern : patterns) {
    INFO(pattern);
    const std::vector<std::string> names = table.names();
    const bool exact = std::find(names.begin(), names.end(), pattern) != names.end();
    CHECK(table.is_plain_name(pattern) == exact);
    const auto matches = [&](const std::string& name) {
      return exact ? name == pattern : fnmatch(pattern.c_str(), name.c_str(), FNM_NOESCAPE) == 0;
    };
    std::vector<std::pair<int, int>> expected, found;
    for (int p = 0; p < static_cast<int>(table.all.size()); ++p)
      for (int c = 0; c < table.all[p].size(); ++c)
        if (matches(table.all[p].name) || matches(table.all[p].component_name(c)))
          expected.push_back({p, c});
    for (const Freed& freed : table.select(pattern))
      for (int c : freed.components) found.push_back({freed.parameter, c});
    CHECK(found == expected);
  }
}

}  // namespace parameters_test
