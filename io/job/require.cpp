#include "require.h"

#include <algorithm>
#include <map>

#include "../../models/rig/selection.h"
#include "../document/document.h"
#include "../document/names.h"
#include "../results/comparison.h"

namespace kincal {
namespace {

struct LimitUnit {
  const char* of;  // m, rad or px
  double factor;
};
const std::map<std::string, LimitUnit> kUnits = {{"px", {"px", 1}},
                                                 {"m", {"m", 1}},
                                                 {"mm", {"m", 1e-3}},
                                                 {"um", {"m", 1e-6}},
                                                 {"rad", {"rad", 1}},
                                                 {"mrad", {"rad", 1e-3}},
                                                 {"deg", {"rad", 0.017453292519943295}}};

std::string without_spaces(const std::string& text) {
  const size_t begin = text.find_first_not_of(' ');
  return begin == std::string::npos ? ""
                                    : text.substr(begin, text.find_last_not_of(' ') - begin + 1);
}

std::string units_of(const std::vector<std::string>& kinds) {
  std::string out;
  for (const char* name : {"px", "m", "mm", "um", "rad", "mrad", "deg"})
    if (std::count(kinds.begin(), kinds.end(), kUnits.at(name).of))
      out += (out.empty() ? "" : ", ") + std::string(name);
  return out;
}

}  // namespace

std::vector<Requirement> parse_requirement(const std::string& text, const Recording& recording,
                                           Words words, const std::string& option) {
  const Rig& rig = recording.rig;
  const std::string where = option_name(option, words) + " '" + text + "': ";
  const size_t less = text.find('<');
  const std::string quantity = without_spaces(text.substr(0, less)),
                    limit = less == std::string::npos ? "" : without_spaces(text.substr(less + 1));
  const size_t digits = std::min(limit.find_first_not_of("0123456789.+-eE"), limit.size());
  Requirement requirement;
  requirement.text = text;
  requirement.unit = without_spaces(limit.substr(digits));
  const auto malformed = [&] {
    return InputError(
        where + "QUANTITY<LIMIT is expected: sensor/NAME<0.2mm, frame/LINK<0.5mm or chi2/dof<1.5");
  };
  if (less == std::string::npos || quantity.empty()) throw malformed();
  Node number;
  number.kind = Node::Kind::scalar;
  number.text = limit.substr(0, digits);
  try {
    requirement.limit = top(number, where).positive();
  } catch (const InputError&) {
    throw InputError(where + "'" + limit +
                     "' is no limit: a number above 0 and a unit are expected, as in 0.2mm");
  }
  const std::string unit_names = units_of({"px", "m", "rad"});
  const auto unit = kUnits.find(requirement.unit);
  if (quantity != "chi2/dof" && unit == kUnits.end())
    throw InputError(where +
                     (requirement.unit.empty() ? "a unit is missing after the limit"
                                               : "unknown unit '" + requirement.unit + "'") +
                     "; valid: " + unit_names);
  // `kinds`: m, rad, px that the quantity can have.
  const auto take_unit = [&](const std::string& name, const std::vector<std::string>& kinds) {
    if (!std::count(kinds.begin(), kinds.end(), unit->second.of))
      throw InputError(where + "'" + requirement.unit + "' is no unit of " + name +
                       "; valid: " + units_of(kinds));
    requirement.factor = unit->second.factor;
    requirement.rotation = unit->second.of == std::string("rad");
  };

  std::vector<Requirement> out;
  const double given = requirement.limit;
  if (quantity == "chi2/dof") {
    if (!requirement.unit.empty()) throw InputError(where + "chi2/dof has no unit");
    requirement.quantity = Requirement::Quantity::chi2_per_dof;
    out.push_back(requirement);
  } else if (quantity.rfind("frame/", 0) == 0) {
    requirement.quantity = Requirement::Quantity::frame;
    requirement.name = quantity.substr(6);
    frame_named(rig, recording.table, requirement.name, where.substr(0, where.size() - 2));
    take_unit("a frame", {"m", "rad"});
    requirement.limit = given * requirement.factor;
    out.push_back(requirement);
  } else if (quantity.rfind("sensor/", 0) == 0) {
    const std::string pattern = quantity.substr(7);
    std::vector<std::string> names;
    for (const Sensor& s : rig.sensors) names.push_back(s.name);
    const bool plain = std::count(names.begin(), names.end(), pattern) > 0;
    for (size_t s = 0; s < rig.sensors.size(); ++s) {
      if (plain ? names[s] != pattern : !glob_matches(pattern, names[s])) continue;
      const SensorModel& model = *rig.sensors[s].model;
      std::vector<std::string> kinds = {model.unit()};
      if (model.measures_pose()) kinds.push_back("rad");
      requirement.name = names[s];
      take_unit("sensor '" + names[s] + "'", kinds);
      requirement.limit = given * requirement.factor;
      out.push_back(requirement);
    }
    if (out.empty())
      throw InputError(where + "unknown sensor '" + pattern + "'" +
                       nearest_or_all(pattern, names, "the rig has"));
  } else {
    throw malformed();
  }
  return out;
}

}  // namespace kincal
