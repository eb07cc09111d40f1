#include "stated_sigmas.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "../../kinematics/floating.h"
#include "../analysis/residuals.h"
#include "../estimation/estimation.h"
#include "../evidence/linear_model.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kWrong = 5;         // times as large or small as stated
constexpr double kSampleApart = 10;  // times the median sample's mean square
constexpr double kKnown = 0.3;       // relative uncertainty of a level
constexpr double kAsStated = 2;      // times the stated size: a sensor that needs no explanation

/// The noise of a part of a sensor, or of a joint, as stated and as found.
struct SizeOfNoise {
  Subject of;
  std::string part, unit;
  double stated = 0, factor = 1;
  double uncertainty = kInfinity;      // of the factor, relative to it
  bool guessed = false, apart = true;  // apart: points of a view that err one by one are known to
  double size() const { return stated * factor; }
  std::string words() const {
    return (of.kind == Subject::Kind::joint ? "joint/" : "sensor/") + of.name +
           (part.empty() ? "" : " " + part) + text(" %.3g ", size()) + unit +
           (guessed ? "" : text(" (stated %.3g)", stated));
  }
};

std::vector<SizeOfNoise> sizes_of_noise(const Recording& recording, const ModelEvidence& found) {
  const Rig& rig = recording.rig;
  std::vector<SizeOfNoise> out;
  for (size_t k = 0; k < found.kinds.size(); ++k) {
    const NoiseKind& kind = found.kinds[k];
    const auto i = static_cast<Eigen::Index>(k);
    SizeOfNoise noise{Subject::joint(""), "", ""};
    noise.factor = found.factor(i);
    noise.uncertainty = std::sqrt(0.5 / std::max(1e-6, found.numbers(i) - found.fitted(i)));
    if (kind.joint >= 0) {
      const Joint& joint = rig.tree.joints[kind.joint];
      noise.of = Subject::joint(read_name(rig.tree, kind.joint));
      noise.unit = joint.type == JointType::prismatic ? "m" : "rad";
      if (joint.floating >= 0) noise.part = noise.unit == "m" ? "translation" : "rotation";
      noise.stated = rig.joints[kind.joint].sigma;
      noise.guessed = rig.joints[kind.joint].noise_guess > 0;
    } else {
      const Sensor& sensor = rig.sensors[kind.sensor];
      const NoisePart part = sensor.model->noise_parts().at(kind.part);
      NoiseKind rest = kind;
      rest.rest = true;
      noise.apart = kind.rest;
      if (!kind.rest &&
          std::count_if(found.kinds.begin(), found.kinds.end(),
                        [&](const NoiseKind& other) { return !(other < rest) && !(rest < other); }))
        continue;
      noise.of = Subject::sensor(sensor.name);
      noise.part = part.name;
      noise.unit = part.unit;
      noise.stated = sensor.sigma[part.first];
      noise.guessed = !sensor.noise_guess.empty();
    }
    out.push_back(std::move(noise));
  }
  return out;
}

/// Whether the residuals of a fit are spread as noise is.
bool spread_evenly(const Recording& recording, const TrialContext& context, const TrialFit& now) {
  std::vector<double> squares;
  for (double s : now.sample)
    if (!std::isnan(s)) squares.push_back(s);
  if (squares.empty() ||
      *std::max_element(squares.begin(), squares.end()) > kSampleApart * median(squares))
    return false;
  EstimationSetup setup;
  setup.noise = context.noise;
  setup.sensors = context.all.sensors;
  for (const std::string& name : context.all.free) merge(setup.free, recording.table.select(name));
  Estimation problem(recording, indices(recording.samples.size()), setup);
  const VectorXd state = problem.pack(now.values);
  problem.renew(state);
  const std::vector<ViewResiduals> views = problem.residuals(state);
  return !neighbours_err_alike(recording.samples, views) && !few_are_far(recording.samples, views);
}

}  // namespace

std::optional<Notice> wrong_sigmas(const Recording& recording, const TrialContext& context,
                                   const TrialFit& now, const ModelEvidence& found) {
  if ((context.noise != NoiseMode::latent && context.noise != NoiseMode::none) ||
      context.all.loss.kind != LossKind::none || !now.complete())
    return std::nullopt;
  Subjects where;
  std::string sizes;
  bool larger = false;
  for (const SizeOfNoise& noise : sizes_of_noise(recording, found)) {
    const bool above = noise.factor >= kWrong;
    const bool none = noise.factor < 1.1 * kLeastFactor;  // simulated without noise
    if (noise.guessed || none || noise.uncertainty > kKnown ||
        !(above || noise.factor <= 1 / kWrong))
      continue;
    if (above && noise.of.kind == Subject::Kind::sensor && !noise.apart) return std::nullopt;
    larger = larger || above;
    where.push_back(noise.of);
    sizes += (sizes.empty() ? "" : ", ") + noise.words();
  }
  if (where.empty() || (larger && !spread_evenly(recording, context, now))) return std::nullopt;
  Notice out =
      make_notice(NoticeKind::wrong_sigma, std::move(where),
                  "stated sigmas differ from those found in the data: " + sizes,
                  text("chi2/dof is %.3g as stated; with these it is about 1", now.per_dof()),
                  "state these in the rig, or let the noise be estimated (`estimate_noise`)");
  out.chi2_as_is = now.chi2;
  out.chi2_corrected = static_cast<double>(now.dof);
  return out;
}

std::string joint_noise(const Recording& recording, const ModelEvidence& found, double least) {
  std::string joints;
  for (const SizeOfNoise& noise : sizes_of_noise(recording, found)) {
    const bool of_sensor = noise.of.kind == Subject::Kind::sensor;
    if (noise.factor < (of_sensor ? kAsStated : least)) continue;
    if (of_sensor) return "";
    joints += (joints.empty() ? "" : ", ") + noise.words();
  }
  return joints.empty() ? ""
                        : "Errors of the joint readings would: " + joints +
                              ". So the readings are that noisy (state it in the rig: joints), or "
                              "the rig cannot express the robot's geometry.";
}

}  // namespace kincal
