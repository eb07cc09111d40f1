#include "wrong_length.h"

#include <algorithm>
#include <cmath>

#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/words.h"

namespace kincal {
namespace {

std::string joint_of(const AutomaticNumber& n) { return n.name.substr(0, n.name.rfind('/')); }

/// The one length of the arm that is off by `least` and by so many times as much as those of other
/// joints, in a calibration that holds what the first one changed; null: there is none.
const AutomaticNumber* sticks_out(const AutomaticCalibration& found, double least, double times) {
  std::vector<const AutomaticNumber*> lengths;
  for (const AutomaticGroup& g : found.groups)
    for (const AutomaticNumber& n : g.numbers)
      if (!g.held && n.unit == "m" && n.name.find("/origin.") != std::string::npos)
        lengths.push_back(&n);
  std::sort(lengths.begin(), lengths.end(), [](const AutomaticNumber* a, const AutomaticNumber* b) {
    return std::abs(a->value) > std::abs(b->value);
  });
  if (lengths.empty() || std::abs(lengths[0]->value) < least) return nullptr;
  for (const AutomaticNumber* n : lengths)
    if (joint_of(*n) != joint_of(*lengths[0]) &&
        times * std::abs(n->value) > std::abs(lengths[0]->value))
      return nullptr;
  return lengths[0];
}

}  // namespace

void look_for_a_wrong_length(const Rig& given, std::set<std::string> sizes,
                             AutomaticOptions options, Report& report) {
  constexpr double kLone = 4, kLeast = 0.003, kAsWell = 1.2, kLessLikely = -1;
  const Solution& solution = report.solution;
  const bool lengths = std::any_of(
      report.automatic.begin(), report.automatic.end(),
      [](const AutomaticGroup& g) { return !g.held && g.name.rfind("lengths", 0) == 0; });
  const bool lone = report.lone && report.lone->gain > kLessLikely;
  if (lone) sizes.insert(report.lone->sizes.begin(), report.lone->sizes.end());
  if (sizes.empty() || !lengths || !given.nominal.empty()) return;
  options.fix.insert(options.fix.end(), sizes.begin(), sizes.end());
  Rig rig = given;  // with the noise of the result
  for (size_t i = 0; i < rig.sensors.size(); ++i)
    rig.sensors[i].sigma = solution.rig().sensors[i].sigma;
  for (size_t j = 0; j < rig.joints.size(); ++j)
    rig.joints[j].sigma = solution.rig().joints[j].sigma;
  const AutomaticCalibration found =
      uncancelled(calibrate_automatically(solution.recording->with_rig(std::move(rig)), options));
  const double first = solution.chi2_per_dof(), second = found.solution.chi2_per_dof();
  const AutomaticNumber* length =
      lone ? sticks_out(found, scales(ParameterKind::joint_origin, "m").least, kLoneTimes)
           : sticks_out(found, kLeast, kLone);
  if (found.solution.status != Status::converged || !(second < kAsWell * first) || !length) return;
  const std::string joint = length->name.substr(6, length->name.find("/origin.") - 6);
  if (!report.diagnosis) report.diagnosis.emplace();
  Notices& findings = report.diagnosis->findings;
  Notice both = make_notice(
      NoticeKind::link_length, {Subject::joint(joint)},
      "either " + length->name + text(" is off by %.1f mm in the URDF", 1e3 * length->value) +
          ", alone among the lengths of the arm, or " + listed({sizes.begin(), sizes.end()}) +
          text(" is wrong in the rig: both explain the data alike (chi2/dof %.3g and %.3g)", second,
               first),
      "board and arm have one scale",
      "measure the board over several squares with a ruler, and how far joint " + quoted(joint) +
          " is from the joint before it; correct the one that is wrong, in the URDF or in the rig. "
          "Where the board is right, hold " +
          *sizes.begin());
  both.chi2_corrected = found.solution.chi2_data;
  for (const std::string& size : sizes)
    both.where.push_back({Subject::Kind::part, size.substr(size.find('/') + 1)});
  for (auto f = findings.begin(); f != findings.end();)
    if (explains(both.kind, f->kind)) {
      both.chi2_as_is = f->chi2_as_is;
      f = findings.erase(f);
    } else {
      ++f;
    }
  findings.insert(findings.begin(), std::move(both));
}

}  // namespace kincal
