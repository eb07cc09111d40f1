#include "validation.h"

#include <cmath>

#include "../analysis/residuals.h"
#include "../rig/numbers.h"

namespace kincal {
namespace {

const HeldOutError* find_sensor(const std::vector<HeldOutError>& all, const std::string& name) {
  for (const HeldOutError& e : all)
    if (e.sensor == name && e.points + e.missing > 0) return &e;
  return nullptr;
}

}  // namespace

Judgement judge_requirement(const Requirement& requirement, const Validation& validation,
                            const std::vector<SensorResult>& sensors, double chi2_per_dof) {
  Judgement out;
  out.requirement = requirement;
  out.measured = kNan;
  if (requirement.quantity == Requirement::Quantity::sensor) {
    const HeldOutError* e = find_sensor(validation.test, requirement.name);
    out.from = "test";
    if (!e && validation.cross_validation) {
      e = find_sensor(validation.cross_validation->sensors, requirement.name);
      out.from = "cross_validation";
    }
    if (e) {
      out.measured = requirement.rotation ? e->rotation_as_read : e->rms_as_read;
      if (e->missing > 0)
        out.why = std::to_string(e->missing) + " held-out views cannot be evaluated";
    } else {
      out.from = "train";
      for (const SensorResult& s : sensors)
        if (s.name == requirement.name)
          out.measured = requirement.rotation ? s.train.rotation_as_read : s.train.rms_as_read;
      if (!std::isfinite(out.measured)) out.why = "the sensor sees nothing";
    }
  } else if (requirement.quantity == Requirement::Quantity::frame) {
    for (const FrameReport& f : validation.frames)
      if (f.frame == requirement.name && !f.workspaces.empty()) {
        const FrameSigma& sigma = f.workspaces.front();
        out.from = sigma.workspace;
        out.measured = requirement.rotation ? sigma.rotation.rms : sigma.position.rms;
      }
    if (!std::isfinite(out.measured)) out.why = "the data do not determine it";
  } else {
    out.measured = chi2_per_dof;
    if (!std::isfinite(chi2_per_dof)) out.why = "there are no degrees of freedom";
  }
  out.met = out.why.empty() && out.measured < requirement.limit;
  return out;
}

}  // namespace kincal
