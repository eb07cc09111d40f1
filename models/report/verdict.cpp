#include "verdict.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "../analysis/hand_eye.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "free_zeros.h"
#include "input_warnings.h"
#include "noise_warnings.h"
#include "scale_warnings.h"

namespace kincal {
namespace {

constexpr double kEven = 3;     // noise levels of two sensors, in their sigmas: at most so unlike
constexpr double kAlike = 0.3;  // correlation of neighbours above which they err alike
constexpr double kMiddleOfTails = 0.3;
constexpr double kLooseMetres = 0.03, kLooseRadians = 3 * kPi / 180;
constexpr char kFreeLess[] = "record more varied postures, or free less";
const std::string kDo = ". What to do: ";
constexpr double kOftenRepeated = 3.5;  // samples a posture: sigmas are too small by its root
constexpr double kMuchTwice = 3;        // one sample in so many has another one that is the same
constexpr double kOpen = 10;            // times as loose: where it is, is not known at all

const Finding* decisive_finding(const Report& report) {
  if (report.diagnosis)
    for (const Finding& f : report.diagnosis->findings)
      if (f.chi2_corrected && f.id != "sigma") return &f;
  return nullptr;
}

/// What was found without a fit and may be why nothing fits.
const Finding* likely_finding(const Report& report) {
  const Finding* first = first_mistake(report);
  return first && first->id != "disconnected" ? first : nullptr;
}

bool starts_with(const std::string& name, const char* beginning) {
  return name.rfind(beginning, 0) == 0;
}

/// The correlation of the residuals of neighbouring points, over all training views: 0 for noise.
double alike(const Report& report) {
  double products = 0, squares = 0;
  for (const ViewResiduals& v : report.residuals.after) {
    const Eigen::Index points = static_cast<Eigen::Index>(v.view->ids.size());
    if (!report.solution.samples()[v.sample].train || points < 4 || v.raw.size() < points ||
        !v.raw.allFinite())
      continue;
    const Eigen::Index rows = v.raw.size() / points, rest = v.raw.size() - rows;
    products += v.raw.head(rest).dot(v.raw.tail(rest));
    squares += v.raw.head(rest).squaredNorm();
  }
  return squares > 0 ? products / squares : 0;
}

/// Whether a few residuals of a sensor are far larger than its others: the middle one is far below
/// the root mean square. (Of noise it is two thirds of it.)
bool few_are_far(const Report& report) {
  std::map<int, std::pair<std::vector<double>, Mean>> by_sensor;  // sizes, squares
  for (const ViewResiduals& v : report.residuals.after) {
    if (!report.solution.samples()[v.sample].train || !v.whitened.allFinite()) continue;
    auto& sizes = by_sensor[v.view->sensor];
    for (double r : v.whitened) {
      sizes.first.push_back(std::abs(r));
      sizes.second.sum += r * r;
      ++sizes.second.count;
    }
  }
  return std::any_of(by_sensor.begin(), by_sensor.end(), [](const auto& s) {
    return median(s.second.first) < kMiddleOfTails * std::sqrt(s.second.second.value());
  });
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
  if (few_are_far(report)) return "a few points have far larger residuals than the others";
  if (alike(report) > kAlike) return "neighbouring points err alike";
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

/// Whether a number further from its prior than three sigmas is more than the worst of so many: of
/// a prior that the user stated each is, of the numbers of groups one in a hundred calibrations
/// would have such a one by chance.
bool prior_is_doubtful(const Report& report) {
  constexpr double kRarely = 0.01, kSigmas = 3;
  if (report.automatic.empty() || !report.doubted.empty()) return true;
  std::set<std::string> grouped;
  double told = 0, worst = 0;
  for (const AutomaticGroup& g : report.automatic) {
    if (!g.held) told += g.gamma;
    for (const AutomaticNumber& n : g.numbers) {
      grouped.insert(n.name);
      if (!n.held && n.width > 0) worst = std::max(worst, std::abs(n.value) / n.width);
    }
  }
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; c < e.value.size(); ++c)
      if (e.prior[c] > 0 && std::abs(e.value[c] - e.initial[c]) > kSigmas * e.prior[c] &&
          !grouped.count(e.component_name(c)))
        return true;
  return told * std::erfc(worst / std::sqrt(2.0)) < kRarely;
}

/// Whether a size or lens that came out as another did so on the automatic path, where nobody said
/// how well it is known.
bool nobody_freed(const Report& report, const std::string& number) {
  const Solution& solution = report.solution;
  if (report.automatic.empty()) return false;
  for (const PriorSetting& prior : solution.rig().priors)
    for (const Freed& f : solution.table().select(prior.pattern))
      if (number.rfind(solution.table().all[f.parameter].name, 0) == 0) return false;
  return true;
}

/// Everything that a verdict is about, of a result that converged and is explained; `width` too,
/// before all of these.
bool is_doubt(const Report& report, const Warning& w) {
  const std::string& id = w.id;
  if (id == "noise") return noise_is_doubtful(report);
  if (id == "rescaled")
    return std::any_of(w.names.begin(), w.names.end(),
                       [&](const std::string& name) { return nobody_freed(report, name); });
  if (id == "duplicates")  // a few change no sigma
    return kMuchTwice * static_cast<double>(w.names.size()) >
           static_cast<double>(report.solution.samples().size());
  if (id == "repeated") return samples_a_posture(*report.solution.recording) > kOftenRepeated;
  if (id == "identity") return !report.automatic.empty();  // held, by somebody, at where nothing is
  return id == "implausible" || id == "jump" || id == "systematic" || id == "chi2" ||
         id == "unexplained" || id == "joint_error" || id == "joint_noise" || id == "sigma" ||
         (id == "prior" && prior_is_doubtful(report)) || id == "in_use" || id == "scale" ||
         id == "arm_scale" || id == "gears" || id == "contradicted" || starts_with(id, "outlier_");
}

/// Whether residuals were larger than stated, so that all that the model lacks counts as noise.
bool taken_for_noise(const Report& report) {
  return report.noise_estimated && report.noise_estimated->stated > 1;
}

/// What is furthest from what was stated of its noise.
std::string noisiest_words(const Report& report) {
  const NoiseLevel* worst = nullptr;
  for (const NoiseLevel& l : report.noise_levels)
    if (!l.unstated && l.used > l.assumed &&
        (!worst || l.used * worst->assumed > worst->used * l.assumed))
      worst = &l;
  return worst ? text(". Furthest off is %s (%.2g times)", worst->of.c_str(),
                      worst->used / worst->assumed)
               : "";
}

/// A doubt in a sentence of the verdict.
std::string doubt_words(const Report& report, const Warning& w) {
  if (w.id == "noise" && taken_for_noise(report))
    return text("residuals are larger than the stated noise allows (chi2/dof %.3g)",
                report.noise_estimated->stated) +
           " and no mistake explains that; they were taken for noise";
  return w.text.substr(0, w.text.find(kDo));
}

/// Whether a doubt is the cause of another: joints that look noisy with sigmas that are too small.
bool goes_before(const std::string& id, const Warning* other) {
  return !other || id == "width" || id == "identity" || id == "scale" || id == "jump" ||
         id == "duplicates" || id == "repeated" || id == "contradicted" ||
         (id == "systematic" && (other->id == "joint_error" || other->id == "joint_noise" ||
                                 other->id == "chi2" || other->id == "noise")) ||
         (id == "noise" && (other->id == "joint_error" || other->id == "chi2" ||
                            starts_with(other->id, "outlier_")));
}

std::string what_to_do(const Report& report, const std::string& id) {
  if (id == "chi2" && report.solution.chi2_per_dof() < 1)
    return "state the sigmas that are seen, or leave it at that: the errors are smaller than the "
           "sigmas say";
  if (id == "chi2" || id == "unexplained")
    return "look for what is wrong, or state the sigmas that are seen";
  if (id == "noise" && taken_for_noise(report))
    return "are joints and sensors that noisy? Then state it in the rig. Else the robot has what "
           "is "
           "not estimated (gears: the group gears; play, bending, an error of a sensor), and "
           "sigmas are too small for that" +
           noisiest_words(report);
  if (id == "in_use")
    return "state the noise of the joints that is seen, calibrate again, and keep the robot's own "
           "numbers until errors in use are smaller";
  if (id == "noise")
    return "state in the rig what you know of the noise; if that of the joints is right: " +
           sensors_as_seen(report);
  if (id == "scale")
    return "measure the squares, over many fields, and correct the rig; if they are right, correct "
           "the poses";
  if (id == "arm_scale")
    return "measure a known distance with what measures lengths; if that is right, measure a link, "
           "and correct the URDF";
  if (id == "contradicted")
    return "look at the held-out samples: if they are right the calibration holds for the postures "
           "of the training only, or not at all";
  if (id == "duplicates")
    return "leave out all but one of each: what is counted twice looks better known than it is";
  if (id == "repeated")
    return "let the robot move between samples, or keep one of each posture: sigmas count one "
           "error of readings as many";
  if (id == "gears")
    return "let them be estimated (the group gears), unless a board that is not as drawn or "
           "repeated readings look like them";
  if (id == "jump") return kCureOfJumps;
  if (id == "systematic") return cure_of_trends(report);
  if (id == "rescaled")
    return "measure what came out as another (a length of the robot that is wrong looks the same), "
           "and correct the rig, or state how well it is known: priors";
  if (id == "identity")
    return "give the pose in the rig, then hold of it what the data do not tell";
  if (id == "joint_noise")
    return "state the noise that is seen, or have it estimated, if the joints are that noisy; else "
           "look for what the model lacks of them: a gear, play, bending";
  if (id == "joint_error") return "look at these samples, or state the noise of these joints";
  if (id == "implausible") return "correct that, and calibrate again";
  if (id == "width")
    return "compare what the rig says of these numbers with the robot, and the readings with its "
           "own display, and look for the usual mistakes";
  if (id == "prior" && !report.automatic.empty() && report.doubted.empty())
    return "is the robot off there by as much, or does this number take up another mistake? Look "
           "for mistakes";
  if (id == "prior") return "see which of the two is wrong, the prior or the data";
  if (id == "sigma")
    for (const Warning& w : report.warnings)
      if (w.id == id) return w.text.substr(w.text.find(kDo) + kDo.size());
  if (std::any_of(report.warnings.begin(), report.warnings.end(),
                  [](const Warning& w) { return w.id == "joint_noise"; }))
    return "state the noise of the joints that is seen (joint_noise), or have it estimated; if it "
           "is "
           "right, look at these, or leave them out";
  return "look at these, or leave them out";
}

/// What all else may come from: the first mistake that was found, else that the model does not
/// explain the data, or numbers far from what is usual; "": nothing of these.
std::string cause_of_all(const Report& report) {
  std::string out;
  if (const Finding* f = first_mistake(report))
    out = "a mistake was found that the result may have taken up: " + f->id + ": " + f->text;
  else if (!report.unexplained.empty())
    out = report.unexplained;
  for (const Warning& w : report.warnings)
    if (w.id == "width" && out.empty()) out = w.text;
  if (!out.empty() && out.back() == '.') out.pop_back();
  return out;
}

/// What is not determined although everything converged: what an earlier step freed, or a frame.
std::vector<std::string> undetermined(const Report& report) {
  std::vector<std::string> out;
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; c < e.sigma.size(); ++c)
      if (std::isnan(e.sigma[c])) out.push_back(e.component_name(c));
  for (const FrameReport& f : report.validation.frames)
    for (const FrameSigma& s : f.workspaces)
      if (std::isnan(s.position.rms) || std::isnan(s.rotation.rms)) {
        out.push_back(f.frame);
        break;
      }
  return out;
}

/// What the automatic path held because the data do not determine it.
std::string held_words(const std::vector<AutomaticGroup>& groups) {
  std::vector<std::string> held;
  for (const AutomaticGroup& g : groups) {
    for (const AutomaticNumber& n : g.numbers)
      if (n.held && n.undetermined()) held.push_back(n.name);
    for (const AutomaticNumber& n : g.unseen) held.push_back(n.name);
  }
  return held.empty() ? ""
                      : text(
                            "; %zu %s as the rig has %s, for the data do not tell (what is "
                            "predicted counts that): ",
                            held.size(), held.size() == 1 ? "number is" : "numbers are",
                            held.size() == 1 ? "it" : "them") +
                            listed(held);
}

std::string size_words(const Solution& solution) {
  if (!(solution.dof_data > 0)) return "converged; nothing is left over to judge it by";
  return text("converged; residuals as large as the noise (chi2/dof %.3g)",
              solution.chi2_per_dof());
}

}  // namespace

namespace {

/// The number of a pose that is known worst, and how much worse than what a mount is good for.
struct LooseNumber {
  const ParameterEstimate* pose = nullptr;
  size_t component = 0;
  double times = 1;
  std::string size = "";  // of a target, that would have to be known
};

LooseNumber loosest(const Report& report) {
  const Untold& unknown = untold(report);
  LooseNumber out;
  for (const ParameterEstimate& e : report.solution.parameters)
    for (size_t c = 0; e.pose && c < e.sigma.size(); ++c) {
      const JudgedSigma judged = judged_sigma(unknown, e, c);
      const double times = judged.sigma / (e.units[c] == "rad" ? kLooseRadians : kLooseMetres);
      if (times > out.times) out = {&e, c, times, judged.size};
    }
  return out;
}

}  // namespace

std::string loose_mount(const Report& report) {
  const LooseNumber loose = loosest(report);
  if (!loose.pose) return "";
  const double sigma = loose.pose->sigma[loose.component];
  const std::string hold = height_to_hold(report, *loose.pose, loose.component);
  if (!hold.empty())
    return loose.pose->component_name(loose.component) + text(" is known to %.3g m only", sigma) +
           ": all that moves turns about one direction only, so along it the places of what is "
           "mounted at the base and at the other end are one number, which no posture tells: " +
           hold_words(hold);
  const std::string known =
      loose.pose->name + " is known to " +
      (loose.pose->units[loose.component] == "rad" ? text("%.3g degrees", sigma * 180 / kPi)
                                                   : text("%.3g m", sigma)) +
      " only";
  if (!loose.size.empty())
    return known + ", for the data do not tell " + loose.size + ": " + measure_words(loose.size);
  const MotionLack lack = motion_lack(*report.solution.recording);
  return known + ": " +
         (lack.why.empty() ? "record more varied postures, or give it a prior"
                           : lack.why + "; so " + lack.cure);
}

namespace {

std::vector<std::string> next_for_loose(const Report& report) {
  const LooseNumber loose = loosest(report);
  if (!loose.pose) return {};
  if (const std::string hold = height_to_hold(report, *loose.pose, loose.component); !hold.empty())
    return {hold_words(hold)};
  if (!loose.size.empty()) return {measure_words(loose.size)};
  if (const MotionLack lack = motion_lack(*report.solution.recording); !lack.cure.empty())
    return {lack.cure};
  return {"record more varied postures, or give " + loose.pose->name + " a prior"};
}

constexpr double kNoNoise = 1e4;  // chi2/dof: no noise is misstated by a hundred times

}  // namespace

bool has_open_mount(const Report& report) { return loosest(report).times > kOpen; }

bool hangs_on_a_size(const Report& report) { return !loosest(report).size.empty(); }

double data_misfit(const Report& report) {
  const Solution& solution = report.solution;
  if (solution.setup.loss.kind == LossKind::none) return solution.chi2_per_dof();
  std::vector<double> views;
  for (const ViewResiduals& v : report.residuals.after)
    if (solution.samples()[v.sample].train && v.whitened.size() > 0 && v.whitened.allFinite())
      views.push_back(v.whitened.squaredNorm() / static_cast<double>(v.whitened.size()));
  if (views.empty()) return kNan;
  const auto middle = views.begin() + static_cast<long>(views.size() / 2);
  std::nth_element(views.begin(), middle, views.end());
  return *middle;
}

std::string why_unexplained(const Report& report) {
  if (!report.solution.usable()) return "";
  const double misfit = data_misfit(report);
  const Finding* finding = decisive_finding(report);
  if (!(misfit > (finding ? kMistaken : kBeyondNoise))) return "";
  const std::string begin = text("the model does not explain the data (chi2/dof %.3g). ", misfit);
  if (const std::string held = counts_from_identity(report.solution); !finding && !held.empty())
    return begin + held;
  if (!finding) finding = likely_finding(report);
  if (finding)
    return begin + "A mistake is likelier than noise stated too small: " + finding->id + ": " +
           finding->text + " Undo it and calibrate again";
  const std::string unlike = uneven(report);
  if (unlike.empty() && misfit > kNoNoise)
    return begin +
           text(
               "Errors are %.0f times the noise that the rig states, evenly over samples and "
               "sensors, and none of the usual mistakes is why: a sigma in another unit (seen: ",
               std::sqrt(misfit)) +
           sigmas_seen(report, misfit) +
           "), or a mistake in what fits worst, whatever is wrong in all samples alike: its axes, "
           "its units, which frame in which, the order of its numbers";
  if (unlike.empty())
    return begin +
           "Noise stated too small is likelier than a mistake, for the residuals are spread evenly "
           "over samples and sensors: state " +
           sigmas_seen(report, misfit) + ", or have the noise estimated";
  if (report.diagnosis && !report.diagnosis->readings.empty())
    return begin + "It is not the noise of the sensors (" + unlike +
           "), and none of the usual mistakes. " + report.diagnosis->readings;
  return begin + "A mistake is likelier than noise stated too small (" + unlike +
         "), but none that is usually made: look at what fits worst (its link, its target, units; "
         "its sigma may be stated too small), calibrate without it, and look for mistakes before "
         "more is freed";
}

namespace {

/// What to do about data that the model does not explain, where no finding says it.
std::vector<std::string> next_for_unexplained(const Report& report) {
  if (report.unexplained.empty() || decisive_finding(report) || likely_finding(report)) return {};
  const std::string worst =
      "look at what fits worst: its link, its target, units, samples whose readings are late";
  if (uneven(report).empty())
    return {"state " + sigmas_seen(report, data_misfit(report)) + ", or have the noise estimated"};
  if (report.diagnosis && !report.diagnosis->readings.empty())
    return {"state the noise of the joint readings in the rig (joints), if they can be that bad",
            "else free what may be wrong of the robot's geometry (lengths, gears), or find what is "
            "loose or bends"};
  return {worst, "calibrate without it, before more is freed"};
}

}  // namespace

Verdict verdict(const Report& report) {
  const Solution& solution = report.solution;
  const auto is_cause = [&](const Warning& w) {
    return (solution.status == Status::not_converged && w.id == "not_converged") ||
           (solution.status == Status::unobservable &&
            (w.id == "unobservable" || w.id == "few_turns"));
  };
  for (const Warning& w : report.warnings)
    if (is_cause(w)) return {"no", w.text};
  const std::string loose = loose_mount(report), cause = cause_of_all(report);
  // (More postures do not help where a mistake makes the poses loose.)
  if (!loose.empty() && !cause.empty() &&
      (solution.status == Status::converged || solution.message == loose))
    return {"no", cause + ". Only then does it count that " + loose};
  if (solution.status != Status::converged && solution.message != loose)
    return {"no", solution.message, next_for_unexplained(report)};
  if (!loose.empty()) return {"no", loose, next_for_loose(report)};

  std::string found;
  if (report.diagnosis && !report.diagnosis->findings.empty()) {
    const Finding& first = report.diagnosis->findings.front();
    found = "converged, but a mistake was found that the result may have taken up: " + first.id +
            ": " + first.text;
    if (found.back() == '.') found.pop_back();
  }
  std::string unmet;
  for (const Judgement& j : report.validation.requirements)
    if (!j.met) unmet += "; not met: " + j.requirement.text;
  std::vector<std::string> others;
  const Warning* doubt = nullptr;
  for (const Warning& w : report.warnings)
    if (w.id == "width" || (is_doubt(report, w) && goes_before(w.id, doubt))) doubt = &w;
  for (const Warning& w : report.warnings)
    if (&w != doubt) others.push_back(w.id);
  const std::string more = others.empty() ? ""
                                          : "; see " + std::string(doubt ? "also " : "") + "the " +
                                                (others.size() == 1 ? "warning " : "warnings ") +
                                                listed(others, 5);
  const std::vector<std::string> open = undetermined(report);
  if (!found.empty()) return {"doubts", found + more + held_words(report.automatic) + unmet};
  if (doubt)
    return {"doubts",
            "converged, but " + doubt_words(report, *doubt) + ". What to do: " +
                what_to_do(report, doubt->id) + more + held_words(report.automatic) + unmet,
            {what_to_do(report, doubt->id)}};
  if (!open.empty())
    return {"doubts",
            size_words(solution) + ", but not determined: " + listed(open) +
                ". What to do: " + kFreeLess + more + unmet,
            {kFreeLess}};
  return {"good", size_words(solution) + unchecked_words(report) + own_errors_words(report) +
                      held_words(report.automatic) + more + unmet};
}

}  // namespace kincal
