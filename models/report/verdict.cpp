#include "verdict.h"

#include <algorithm>
#include <cmath>

#include "../rig/distributions.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "input_warnings.h"
#include "noise_warnings.h"
#include "scale_warnings.h"

namespace kincal {
namespace {

constexpr double kEven = 3;       // noise levels of two sensors, in their sigmas: at most so unlike
constexpr double kNoNoise = 1e4;  // chi2/dof: no noise is misstated by a hundred times

const Notice* decisive_finding(const Report& report) {
  if (report.diagnosis)
    for (const Notice& f : report.diagnosis->findings)
      if (f.chi2_corrected && can_spoil_the_fit(f.kind)) return &f;
  return nullptr;
}

/// What is unlike noise of one size in the residuals; "": nothing. (Sensors by their noise levels:
/// a chain's few residuals are small beside many corners that decide where its target is.)
std::string uneven(const Report& report) {
  const NoiseLevel *best = nullptr, *worst = nullptr;
  const auto times = [](const NoiseLevel* l) { return l->seen / l->assumed; };
  for (const NoiseLevel& l : report.noise_levels) {
    if (l.sensor < 0 || !(l.seen > 0 && l.assumed > 0)) continue;
    if (!best || times(&l) < times(best)) best = &l;
    if (!worst || times(&l) > times(worst)) worst = &l;
  }
  std::vector<std::string> apart;
  for (const std::vector<Misfit>* kind : {&report.misfits.samples, &report.misfits.views})
    for (const Misfit& m : *kind) apart.push_back(m.name);
  if (worst && times(worst) > kEven * times(best))
    return "errors of " + worst->of + text(" are %.3g times its sigma, those of ", times(worst)) +
           best->of + text(" %.3g times", times(best));
  if (!apart.empty()) return "far larger residuals than the others have " + listed(apart);
  if (few_are_far(report.solution.samples(), report.residuals.after))
    return "a few points have far larger residuals than the others";
  if (neighbours_err_alike(report.solution.samples(), report.residuals.after))
    return "errors of neighbouring points are correlated";
  return "";
}

std::string sigmas_seen(const Report& report, double misfit) {
  std::vector<std::string> levels;
  for (const NoiseLevel& l : report.noise_levels)
    if (l.differs() && l.seen > l.assumed)
      levels.push_back(l.of + (l.part.empty() ? "" : " " + l.part) + text(" %.2g ", l.seen) +
                       l.unit + text(" (stated %.2g)", l.assumed));
  return levels.empty() ? text("sigmas %.2g times as large", std::sqrt(misfit)) : listed(levels, 5);
}

/// The parameters that the automatic path fixed because the data do not determine them.
std::vector<std::string> undetermined_by_data(const std::vector<AutomaticGroup>& groups) {
  std::vector<std::string> out;
  for (const AutomaticGroup& g : groups) {
    for (const AutomaticNumber& n : g.numbers)
      if (n.held && n.undetermined()) out.push_back(n.name);
    for (const AutomaticNumber& n : g.unseen) out.push_back(n.name);
  }
  return out;
}

/// How many parameters the automatic path fixed, for this or another reason.
size_t kept_at_nominal(const std::vector<AutomaticGroup>& groups) {
  size_t out = 0;
  for (const AutomaticGroup& g : groups) {
    out += g.unseen.size();
    for (const AutomaticNumber& n : g.numbers) out += n.held;
  }
  return out;
}

/// Undetermined parameters and frames of a calibration that converged: parameters that an earlier
/// step freed, without gauges that were fixed after it.
std::vector<std::string> undetermined(const Report& report) {
  std::vector<std::string> out;
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; c < e.sigma.size(); ++c)
      if (const Component component = {e.parameter, static_cast<int>(c)};
          std::isnan(e.sigma[c]) &&
          std::none_of(report.gauges.begin(), report.gauges.end(),
                       [&](const Gauge& gauge) { return gauge.fixed == component; }))
        out.push_back(e.component_name(c));
  for (const FrameReport& f : report.validation.frames)
    for (const FrameSigma& s : f.workspaces)
      if (std::isnan(s.position.rms) || std::isnan(s.rotation.rms)) {
        out.push_back(f.frame);
        break;
      }
  return out;
}

std::string size_words(const Solution& solution) {
  if (!(solution.dof_data > 0)) return "converged; no degrees of freedom are left to check the fit";
  return text("converged; residuals as large as the noise (chi2/dof %.3g)",
              solution.chi2_per_dof());
}

}  // namespace

bool is_of_stated_size(double ratio, double dof) {
  return !(dof > 0) || (ratio > 0.8 && ratio < 1.25) ||
         !(std::abs(chi2_deviate(ratio * dof, dof)) > 4);
}

double data_misfit(const Report& report) {
  const Solution& solution = report.solution;
  if (solution.setup.loss.kind == LossKind::none) return solution.chi2_per_dof();
  std::vector<double> views;
  for (const ViewResiduals& v : report.residuals.after)
    if (solution.samples()[v.sample].train && v.whitened.size() > 0 && v.whitened.allFinite())
      views.push_back(v.whitened.squaredNorm() / static_cast<double>(v.whitened.size()));
  return median(std::move(views));
}

double beyond_guess(const Report& report) {
  double out = 1;
  for (const NoiseLevel& level : report.noise_levels)
    if (level.guess > 0) out = std::max(out, std::pow(level.used / level.guess, 2));
  return out;
}

std::optional<Notice> why_unexplained(const Report& report) {
  if (!report.solution.usable()) return std::nullopt;
  const Notice* finding = decisive_finding(report);
  const double
      misfit =  // a mistake that explains the data is likelier than noise far beyond a guess
      finding ? std::max(data_misfit(report), beyond_guess(report)) : data_misfit(report);
  if (!(misfit > (finding ? kMistaken : kBeyondNoise))) return std::nullopt;
  Notice out = make_notice(NoticeKind::unexplained, {},
                           text("the model does not explain the data (chi2/dof %.3g)", misfit));
  if (const std::optional<Notice> identity = counts_from_identity(report.solution);
      !finding && identity) {
    out.why = identity->what;
    out.cure = identity->cure;
    return out;
  }
  if (const Notice* first = first_mistake(report);
      !finding && first && first->kind != NoticeKind::disconnected)
    finding = first;
  if (finding) {
    out.where = finding->where;
    out.cause = finding->kind;
    out.why = std::string("a mistake is likelier than an understated noise: ") + id(finding->kind) +
              ": " + finding->what;
    out.cure = "undo it and calibrate again: " + finding->cure;
    return out;
  }
  const std::string unlike = uneven(report);
  if (unlike.empty() && misfit > kNoNoise) {
    out.why = text(
        "errors are %.0f times the noise stated in the rig, evenly over samples and sensors, and "
        "none of the usual mistakes explains them",
        std::sqrt(misfit));
    out.cure =
        "look for a mistake that is the same in all samples: axes, units, inverted poses, the "
        "order of coordinates";
    out.otherwise = "or for a sigma in another unit (seen: " + sigmas_seen(report, misfit) + ")";
  } else if (unlike.empty()) {
    out.why =
        "an understated noise is likelier than a mistake: the residuals are spread evenly over "
        "samples and sensors";
    out.cure = "let the noise be estimated (`estimate_noise`)";
    out.otherwise = "or state " + sigmas_seen(report, misfit);
  } else if (report.diagnosis && !report.diagnosis->readings.empty()) {
    out.why = "it is not the noise of the sensors (" + unlike +
              "), and none of the usual mistakes. " + report.diagnosis->readings;
    if (out.why.back() == '.') out.why.pop_back();
    out.cure = "state the noise of the joint readings in the rig (joints), if it can be that large";
    out.otherwise =
        "otherwise estimate more of the robot's geometry (lengths, gears), or find loose or "
        "bending parts";
  } else {
    out.why = "a mistake is likelier than an understated noise (" + unlike +
              "), but it is none of the usual ones";
    out.cure =
        "check the part that fits worst, and calibrate without it, before more parameters are "
        "estimated";
    out.otherwise =
        "possible mistakes there: its link, its target, units, late readings, a sigma stated too "
        "small";
  }
  return out;
}

namespace {

/// The first finding that is more than a remark; null: none.
const Notice* first_finding(const Report& report) {
  if (report.diagnosis)
    for (const Notice& f : report.diagnosis->findings)
      if (f.severity != Severity::remark) return &f;
  return nullptr;
}

/// What is the case in one clause, with the id of a mistake.
std::string in_short(const Notice& n) {
  if (is_mistake(n.kind)) return "a mistake was found, " + std::string(id(n.kind)) + ": " + n.what;
  return n.what + (n.cause ? "; the likeliest mistake is " + std::string(id(*n.cause)) : "");
}

/// What a verdict says that a notice decides.
Verdict decided_by(const char* use, const Notice& n) {
  Verdict out{use, in_short(n)};
  for (const std::string* step : {&n.cure, &n.otherwise})
    if (!step->empty()) out.next.push_back(*step);
  if (!n.why.empty()) out.reasons = {n.why};
  if (is_mistake(n.kind)) out.reasons.emplace_back("the result may have absorbed it");
  out.about = {n.kind};
  if (n.cause) out.about.push_back(*n.cause);
  return out;
}

/// A fault that a doubt explains is said behind that.
Verdict no_because(const Notice& cause, const Notice& fault) {
  Verdict out = decided_by("no", cause);
  out.reasons.push_back("only then consider that " + fault.what);
  return out;
}

/// How far the parameters of groups came out from the rig's, most unusual first, then those of
/// which nothing is usual; "": nothing.
std::string widths_words(std::vector<AutomaticGroup> groups) {
  std::stable_sort(groups.begin(), groups.end(),
                   [](const AutomaticGroup& a, const AutomaticGroup& b) {
                     return std::make_pair(is_bending(b.name), a.factor) >
                            std::make_pair(is_bending(a.name), b.factor);
                   });
  std::vector<std::string> words;
  for (const AutomaticGroup& g : groups)
    if (!g.held && !g.numbers.empty())
      words.push_back(g.name + " " + shown_text(g.numbers[0].width, g.numbers[0].unit) +
                      (is_bending(g.name) ? "" : text(" (%.2g times as much as usual)", g.factor)));
  return words.empty() ? "" : "parameters are off from the rig's by about: " + listed(words);
}

}  // namespace

Verdict verdict(const Report& report) {
  const Solution& solution = report.solution;
  const Notice *finding = first_finding(report), *fault = nullptr, *doubt = nullptr;
  for (const Notice& w : report.warnings) {  // what matters most stands first
    if (w.severity == Severity::fault && !fault) fault = &w;
    if (w.severity == Severity::doubt && !doubt) doubt = &w;
  }
  for (const Notice& w : report.warnings)
    if (finding && explains(w.kind, finding->kind)) finding = &w;
  if (fault) {
    if (finding && explains(finding->kind, fault->kind)) return no_because(*finding, *fault);
    for (const Notice& w : report.warnings)
      if (!fault->cause && explains(w.kind, fault->kind)) return no_because(w, *fault);
    return decided_by("no", *fault);
  }
  if (solution.status != Status::converged) return {"no", solution.message};

  Verdict out{"good", ""};
  if (const Notice* first = finding ? finding : doubt) {
    out = decided_by("doubts", *first);
  } else if (const std::vector<std::string> open = undetermined(report); !open.empty()) {
    out = {"doubts",
           size_words(solution) + ", but not determined: " + listed(open),
           {"record more varied postures, or estimate fewer parameters"}};
  } else {
    out.why = size_words(solution);
    const std::string own_errors = own_errors_words(report);
    for (const std::string& holds :
         {unchecked_words(report), own_errors, widths_words(report.automatic)})
      if (!holds.empty()) out.reasons.push_back(holds);
    if (!own_errors.empty())
      out.next = {
          "if zeros of the robot may be wrong, record its joint readings and calibrate with its "
          "URDF"};
    for (const Notice& w : report.warnings)  // (a good result is used as this says)
      if (w.kind == NoticeKind::joint_model && !w.cure.empty()) out.next.push_back(w.cure);
  }
  for (const Notice& w : report.warnings)
    if (!std::count(out.about.begin(), out.about.end(), w.kind)) out.see.push_back(w.kind);
  out.held = undetermined_by_data(report.automatic);
  out.kept = kept_at_nominal(report.automatic);
  for (const Judgement& j : report.validation.requirements)
    if (!j.met) out.unmet.push_back(j.requirement.text);
  if (out.next.empty() && !out.unmet.empty())
    out.next = {"use it only where these tolerances are not required: " + listed(out.unmet)};
  return out;
}

std::vector<std::string> notes(const Verdict& v) {
  std::vector<std::string> out;
  if (!v.held.empty())
    out.push_back(
        text("%zu of %zu parameters kept at their nominal values %s not determined by the "
             "data (predicted errors account for this): ",
             v.held.size(), v.kept, v.held.size() == 1 ? "is" : "are") +
        listed(v.held));
  for (const std::string& requirement : v.unmet) out.push_back("not met: " + requirement);
  return out;
}

std::string sentences(const Verdict& v) {
  std::string out = v.why;
  for (const std::string& reason : v.reasons) out += ". " + capital(reason);
  for (size_t i = 0; i < v.next.size(); ++i) out += (i ? "; " : ". What to do: ") + v.next[i];
  for (const std::string& note : notes(v)) out += "; " + note;
  std::vector<std::string> ids;
  for (const NoticeKind kind : v.see) ids.emplace_back(id(kind));
  if (!ids.empty())
    out += std::string("; see ") + (v.about.empty() ? "" : "also ") + "the " +
           (ids.size() == 1 ? "warning " : "warnings ") + listed(ids, 5);
  return out;
}

}  // namespace kincal
