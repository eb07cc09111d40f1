#include "wrong_length.h"

#include <utility>

#include "../rig/numbers.h"
#include "../rig/words.h"

namespace kincal {

void find_wrong_length(std::set<std::string> sizes, Report& report) {
  const OtherModel* model = nullptr;
  for (const OtherModel* told : told_models(report.other_models, NoticeKind::link_length))
    if (told->replaces_sizes()) model = told;
  if (!model) return;
  const std::string& length = model->where[0].name;
  for (size_t i = 1; i < model->where.size(); ++i) sizes.insert(model->where[i].name);
  const std::string joint = length.substr(6, length.find("/origin.") - 6);
  if (!report.diagnosis) report.diagnosis.emplace();
  Notices& findings = report.diagnosis->findings;
  Notice both = make_notice(
      NoticeKind::link_length, {Subject::joint(joint)},
      "either " + length + text(" is off by %.1f mm in the URDF", 1e3 * model->value) +
          ", only this length of the arm, or " + listed({sizes.begin(), sizes.end()}) +
          text(" is wrong in the rig: both explain the data equally well (log odds of the length "
               "%+.2g)",
               model->log_odds),
      "board and arm have one scale",
      "measure the board over several squares with a ruler, and how far joint " + quoted(joint) +
          " is from the joint before it; correct the wrong one, in the URDF or in the rig. If the "
          "board is right, fix " +
          *sizes.begin());
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
