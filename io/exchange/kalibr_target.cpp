#include "kalibr_target.h"

#include <algorithm>

#include "../document/document.h"
#include "../document/numbers.h"
#include "../rig/types.h"
#include "foreign.h"

namespace kincal {
namespace {

constexpr int kMostCells = 10'000;  // rows or columns

constexpr char kExchanged[] =
    "in Kalibr x runs along the columns of this board, in kincal along the rows: poses of it "
    "differ "
    "accordingly, its points do not";

/// rows and columns, as kincal counts them.
RigKeys cells(const Field& file, const char* rows, const char* columns, const char* type) {
  return {{"type", type},
          {"rows", std::to_string(file[rows].integer(1, kMostCells))},
          {"columns", std::to_string(file[columns].integer(1, kMostCells))}};
}

RigKeys described(const Field& file, std::vector<std::string>& notes) {
  const std::string type = file["target_type"].string();
  RigKeys keys;
  if (type == "checkerboard") {
    keys = cells(file, "targetRows", "targetCols", "chessboard");
    const double square = file["rowSpacingMeters"].positive();
    if (file.has("colSpacingMeters") && file["colSpacingMeters"].positive() != square)
      file["colSpacingMeters"].fail(
          "differs from rowSpacingMeters; kincal's boards have only squares");
    keys.emplace_back("square", shortest(square));
    notes.emplace_back(kExchanged);
  } else if (type == "circlegrid") {
    keys = cells(file, "targetRows", "targetCols", "circles");
    keys.emplace_back("spacing", shortest(file["spacingMeters"].positive()));
    if (file.has("asymmetricGrid") && file["asymmetricGrid"].boolean())
      keys.emplace_back("asymmetric", "true");
    else
      notes.emplace_back(kExchanged);
  } else if (type == "aprilgrid") {
    keys = cells(file, "tagRows", "tagCols", "apriltag_grid");
    if (file.has("codeOffset") && file["codeOffset"].integer(0, kMostCells) != 0)
      file["codeOffset"].fail("kincal's grids begin with tag 0");
    keys.emplace_back("tag", shortest(file["tagSize"].positive()));
    keys.emplace_back("spacing", shortest(file["tagSpacing"].number_at_least(0)));
    keys.emplace_back("family", "tag36h11");
  } else {
    file["target_type"].fail("unknown target '" + type +
                             "'; valid: checkerboard, circlegrid, aprilgrid");
  }
  return keys;
}

}  // namespace

bool is_kalibr_target(const std::string& path) {
  return read_foreign(path).find("target_type") != nullptr;
}

RigKeys read_kalibr_target(const std::string& path, std::vector<std::string>& notes) {
  const Node node = read_foreign(path);
  RigKeys keys = described(top(node, path), notes);
  for (const TargetKeys& type : target_types())
    for (const Names& names : {type.required, type.optional})
      for (const std::string& name : names)
        if (std::none_of(keys.begin(), keys.end(), [&](const auto& k) { return k.first == name; }))
          keys.emplace_back(name, "");
  return keys;
}

}  // namespace kincal
