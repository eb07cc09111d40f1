#include "fleet_table.h"

#include <algorithm>

#include "table.h"

namespace kincal {
namespace {

std::string signed_with_sigma(double off, double sigma, const std::string& unit) {
  const Unit is = shown(unit);
  return text("%+.3g ± %.2g %s", off * is.factor + 0.0, sigma * is.factor, is.name.c_str());
}

std::string many(size_t count, const char* what) {
  return text("%zu %s%s", count, what, count == 1 ? "" : "s");
}

/// Robots by how far they are out of family: all that are, and some that are next.
std::string family_part(const Fleet& fleet, const FleetFindings& findings,
                        const FleetOptions& options, size_t most) {
  if (!findings.family.judged)
    return text("No comparison with a family: it needs %d robots, there are %zu.\n", kFewestRobots,
                findings.robots.size());
  std::string out =
      text("%d of %zu robots are out of family", findings.out_of_family, findings.robots.size()) +
      text(" (level %g: about %.2g healthy robots are reported by chance)\n", options.level,
           options.level * static_cast<double>(findings.robots.size()));
  std::vector<const FleetRobot*> robots;
  for (const FleetRobot& robot : findings.robots) robots.push_back(&robot);
  std::stable_sort(robots.begin(), robots.end(), [](const FleetRobot* a, const FleetRobot* b) {
    return a->member->p < b->member->p;
  });
  std::vector<std::vector<std::string>> rows = {
      {"robot", "result of", "what would explain it alone", "p", "out"}};
  for (size_t i = 0; i < robots.size() && i < most; ++i) {
    const FamilyMember& member = *robots[i]->member;
    std::string why = "-";
    if (!member.numbers.empty()) {
      const OffNumber& worst = member.numbers[0];
      const FleetNumber& is = fleet.numbers[worst.number];
      why = is.name + " " + signed_with_sigma(worst.off, worst.sigma, is.unit);
    }
    rows.push_back({robots[i]->serial, fleet.results[robots[i]->results.back()].date, why,
                    text("%.2g", member.p), robots[i]->out_of_family ? "yes" : "no"});
  }
  out += align(rows, 3);
  if (robots.size() > most) out += text("  ... and %zu more in robots.csv\n", robots.size() - most);
  return out;
}

std::string drift_part(const Fleet& fleet, const FleetFindings& findings,
                       const FleetOptions& options, size_t most) {
  std::vector<const FleetRobot*> robots;
  size_t several = 0;
  for (const FleetRobot& robot : findings.robots) {
    several += robot.drift.has_value();
    if (robot.drifts()) robots.push_back(&robot);
  }
  if (several == 0) return "No check of drift: no robot has several results.\n";
  std::stable_sort(robots.begin(), robots.end(), [](const FleetRobot* a, const FleetRobot* b) {
    return a->drift->p < b->drift->p;
  });
  std::string out =
      text("%zu of %zu robots with several results have changed", robots.size(), several) +
      text(" (level %g)\n", options.level);
  if (robots.empty()) return out;
  std::vector<std::vector<std::string>> rows = {{"robot", "number", "how", "by", "p"}};
  size_t left = 0;
  for (const FleetRobot* robot : robots)
    for (const Cause& cause : robot->drift->causes) {
      if (rows.size() > most) {
        ++left;
        continue;
      }
      const FleetNumber& is = fleet.numbers[cause.number];
      const std::string& from = fleet.results[robot->results[cause.from]].date;
      rows.push_back({robot->serial, is.name, cause.from ? "at once, by " + from : "steadily",
                      signed_with_sigma(cause.slope.value, cause.slope.sigma, is.unit) +
                          (cause.from ? "" : " a year"),
                      text("%.2g", cause.p)});
    }
  out += align(rows, 4);
  if (left) out += text("  ... and %zu more in fleet.json\n", left);
  return out;
}

}  // namespace

std::string fleet_table(const Fleet& fleet, const FleetFindings& findings,
                        const FleetOptions& options, size_t most) {
  std::string out = many(fleet.results.size(), "result") + " of " +
                    many(findings.robots.size(), "robot") + ", " +
                    many(fleet.numbers.size(), "number") + "\n\n";
  out += family_part(fleet, findings, options, most);
  out += "\n" + drift_part(fleet, findings, options, most);
  const auto list = [&](const char* title,
                        const std::vector<std::pair<std::string, std::string>>& results) {
    for (size_t i = 0; i < results.size() && i <= most; ++i) {
      if (i == 0) out += std::string("\n") + title + "\n";
      out += i < most ? "  " + results[i].first + ": " + results[i].second + "\n"
                      : text("  ... and %zu more in fleet.json\n", results.size() - most);
    }
  };
  list(
      "Made with another rig than most: poorly determined parameters may differ for this reason "
      "alone.\n"
      "Calibrate these robots again with the rig of the others",
      fleet.other_rigs);
  list("Left out", fleet.left_out);
  return out;
}

}  // namespace kincal
