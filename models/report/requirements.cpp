#include "requirements.h"

#include <cmath>
#include <map>

#include "../rig/numbers.h"
#include "../rig/words.h"

namespace kincal {

std::string judgement_text(const Judgement& j) {
  const Requirement& r = j.requirement;
  std::string out = r.text;
  if (r.quantity == Requirement::Quantity::sensor && r.text.find(r.name) == std::string::npos)
    out += " (" + r.name + ")";
  out += ": ";
  if (std::isfinite(j.measured)) {
    out += text("%.4g", j.measured / r.factor) + (r.unit.empty() ? "" : " " + r.unit);
  } else {
    out += "unknown";
  }
  const std::map<std::string, std::string> words = {
      {"test", "rms as read, held out"},
      {"cross_validation", "rms as read, cross-validated"},
      {"train", "rms as read in training (nothing is held out)"},
      {"samples", "predicted over the samples' postures"},
      {"limits", "predicted over the joints' limits"}};
  const auto found = words.find(j.from);
  if (found != words.end()) out += ", " + found->second;
  return j.why.empty() ? out : out + "; " + j.why;
}

}  // namespace kincal
