#include "notice.h"

#include <algorithm>
#include <array>
#include <tuple>

namespace kincal {
namespace {

using NK = NoticeKind;

/// What a kind can be: looked for by the doctor; a cause of a bad fit; a number nobody can mean;
/// said better by the weak directions.
enum Trait : unsigned { kTested = 1, kSpoils = 2, kNumber = 4, kDirections = 8 };

struct Row {
  NK kind;
  const char* id;
  Severity severity;
  const char* meaning;  // one sentence for docs/reference.md, which scripts/reference makes
  unsigned traits = 0;
  std::vector<NK> effects = {};  // about the same thing, which this explains
};

constexpr unsigned kMistake = kTested | kSpoils;

const std::vector<NK> kOfImages = {NK::points_outside, NK::baseline};

/// The one table of kinds, in the order of NoticeKind.
const Row kRows[] = {
    {NK::square, "square", Severity::doubt,
     "A size is wrong, or in the wrong unit: a board's square, a target's points, or the lengths "
     "that a sensor measures.",
     kMistake | kNumber},
    {NK::rows_columns,
     "rows-columns",
     Severity::doubt,
     "The rows and columns of a board are exchanged, or its points are numbered column by "
     "column.",
     kMistake,
     {NK::numbering}},
    {NK::numbering, "numbering", Severity::doubt,
     "The points of a target are numbered from another corner, from 1, in another order, or "
     "without the ids of a partly visible board.",
     kMistake},
    {NK::mirrored,
     "mirrored",
     Severity::doubt,
     "Images are flipped, rows of points run backwards, or measured points, bearings or poses "
     "are left-handed.",
     kMistake,
     {NK::baseline}},
    {NK::joint_sign, "joint-sign", Severity::doubt,
     "The readings of a joint, or its axis in the URDF, have the wrong sign.", kMistake},
    {NK::degrees, "degrees", Severity::doubt,
     "Joint readings or bearings are in degrees instead of radians.", kMistake | kNumber},
    {NK::still_joint, "still-joint", Severity::doubt,
     "A joint with an estimated parameter never moves in the samples, or its log is constant "
     "although it moved.",
     kMistake},
    {NK::inverted_pose, "inverted-pose", Severity::doubt,
     "The pose of a sensor, a mounted target or the flange is the inverse of the pose that is "
     "needed.",
     kMistake},
    {NK::eye_in_hand, "eye-in-hand", Severity::doubt,
     "A camera and a target are each on the other's link.", kMistake},
    {NK::swapped_cameras, "swapped-cameras", Severity::doubt,
     "The views of two cameras are exchanged.", kMistake, kOfImages},
    {NK::rectified, "rectified", Severity::doubt,
     "The rig has distortion but the images are rectified, or the images are raw but the rig has "
     "no distortion.",
     kMistake},
    {NK::same_samples, "duplicates", Severity::doubt,
     "Samples with the same readings and measurements stand in the file under several ids.",
     kTested},
    {NK::disconnected, "disconnected", Severity::doubt,
     "Sensors or poses to be estimated share no view with the rest, or no pose is fixed.",
     kTested},  // a lack, no bad fit
    {NK::bad_samples, "bad-samples", Severity::doubt,
     "The joint readings of some samples do not belong to their views, or a single measured "
     "point is wrong.",
     kMistake},
    {NK::exchanged_axes, "exchanged-axes", Severity::doubt,
     "The pixels of a camera are written as v, u instead of u, v.", kMistake, kOfImages},
    {NK::resolution, "resolution", Severity::doubt,
     "The images have another size than the intrinsics, or were cropped.", kMistake, kOfImages},
    {NK::intrinsics, "intrinsics", Severity::doubt,
     "The intrinsics are in another order, belong to another lens, zoom or resolution, or are in "
     "millimetres.",
     kMistake | kNumber, kOfImages},
    {NK::normalised, "normalised", Severity::doubt,
     "The pixels are normalised coordinates while the intrinsics are in pixels, or the reverse.",
     kMistake, kOfImages},
    {NK::board_columns,
     "board-columns",
     Severity::doubt,
     "The board in the rig has a column too many or too few: inner corners count, not squares.",
     kMistake,
     {NK::numbering}},
    {NK::turned_pose, "turned-pose", Severity::doubt,
     "A fixed pose of a sensor, target or fixed joint is turned by 90 or 180 degrees, or has x "
     "forward for z forward.",
     kMistake},
    {NK::outlier_points, "outlier-points", Severity::doubt,
     "Single points of otherwise good views are far off.", kMistake},
    {NK::units, "units", Severity::doubt,
     "A pose, link, sliding joint or laser range has a length in millimetres, centimetres, "
     "inches or feet.",
     kMistake | kNumber},
    {NK::points_outside, "outside-image", Severity::doubt,
     "Points lie outside of the image size of their camera.", kTested},
    {NK::shifted, "shifted", Severity::doubt,
     "Readings or views belong to the neighbouring sample, or are in another order.", kMistake},
    {NK::lag, "lag", Severity::doubt,
     "Readings are older or newer than the views, or the robot was still moving.", kMistake},
    {NK::wrong_link, "wrong-link", Severity::doubt,
     "A sensor or a mounted target is on another link than the rig states.", kMistake},
    {NK::wrong_sigma, "sigma", Severity::doubt,
     "The stated sigma of a sensor or of joints is wrong by a factor of 5 or more.", kTested},
    {NK::home_position, "home-position", Severity::doubt,
     "The readings of a joint count from a zero that is 90 or 180 degrees from the URDF's.",
     kMistake},
    {NK::exchanged_joints, "exchanged-joints", Severity::doubt,
     "The readings of two joints, of the left and right arm, or of all joints are in another "
     "order.",
     kMistake},
    {NK::exchanged_targets, "exchanged-targets", Severity::doubt,
     "The views of two mounted targets with the same number of points are exchanged.", kMistake},
    {NK::absolute_angle, "absolute-angle", Severity::doubt,
     "The reading of a joint is the sum or difference of its own angle and that of the parallel "
     "joint before it.",
     kMistake},
    {NK::joint_axis, "joint-axis", Severity::doubt,
     "The axis of a turning joint in the URDF is another axis of its frame.", kMistake},
    {NK::gear, "gear", Severity::doubt,
     "A gear ratio or an encoder count is wrong by more than 0.3 %.", kMistake},
    {NK::quaternion, "quaternion", Severity::doubt,
     "A quaternion is written w x y z and read x y z w, or the reverse.", kMistake},
    {NK::baseline, "baseline", Severity::doubt,
     "The baseline of a stereo camera is missing, wrong by 1 % or more, or has the wrong sign.",
     kMistake | kNumber},
    {NK::convention, "convention", Severity::doubt,
     "Poses or laser rays are written in one convention and read in another: angles, axes, "
     "order, units or handedness.",
     kMistake},
    {NK::moved_target, "moved-target", Severity::doubt,
     "A mounted target is in another place from some sample on.", kMistake},
    {NK::views_apart, "views-apart", Severity::doubt,
     "One sensor sees a free target elsewhere than the other sensors on the same body in the "
     "same samples.",
     kMistake},
    {NK::turned_picture, "turned-picture", Severity::doubt,
     "Some images of a camera are turned by 180 degrees against the others.", kMistake},
    {NK::changed, "changed", Severity::doubt,
     "From some sample on, something else differs: a camera, lens, joint zero, target or robot.",
     kMistake},
    {NK::bent, "bent", Severity::doubt,
     "A board is not flat, which biases lenses and mounts (`calibrate` only).", kSpoils},
    {NK::link_length,
     "link-length",
     Severity::doubt,
     "One length of the URDF is wrong, which looks like a wrong board size, baseline or focal "
     "length (`calibrate` without `estimate` only).",
     kSpoils,
     {NK::square, NK::baseline, NK::intrinsics}},
    {NK::not_converged, "not_converged", Severity::fault, "A step did not converge."},
    {NK::unobservable, "unobservable", Severity::fault,
     "The data do not determine a direction that the last step estimates.", kDirections},
    {NK::few_turns, "few_turns", Severity::remark,
     "The flange, camera or target hardly turned, turned about one axis only, or has one or two "
     "poses: a mount is uncertain by 0.3 m or 30 degrees or more."},
    {NK::unexplained, "unexplained", Severity::fault,
     "The model does not explain the data: chi2/dof is above 100, or above 25 with a mistake "
     "that a fit proves."},
    {NK::implausible, "implausible", Severity::doubt,
     "The rig or the samples have values that are far from usual: a unit, an order or a "
     "resolution is wrong.",
     kSpoils},
    {NK::width,
     "width",
     Severity::doubt,
     "Automatic path: the parameters of a group are off by more than 9 times the usual error, or "
     "the URDF seems to describe another robot.",
     0,
     {NK::sigma}},
    {NK::contradicted, "contradicted", Severity::doubt,
     "The residuals of held-out samples are more than 5 times those of the training (5 + 25/n "
     "for n residuals), or no held-out sample can be evaluated."},
    {NK::repeated, "repeated", Severity::remark,
     "Several samples share a posture: they count as independent errors of the joints, so sigmas "
     "are too small."},
    {NK::identity, "identity", Severity::remark,
     "A pose that the rig does not give is estimated in part or has a prior: the rest counts "
     "from the identity.",
     kSpoils},
    {NK::scale, "scale", Severity::doubt,
     "All given lengths between sensors and targets came out wrong by one factor (more than 1.5 "
     "%), and only the sizes of boards determine the scale."},
    {NK::jump,
     "jump",
     Severity::doubt,
     "The errors of a joint's readings, or of flange poses, change at one sample and stay so.",
     0,
     {NK::wrong_sigma, NK::unexplained}},
    {NK::duplicates, "duplicates", Severity::remark,
     "Samples with the same readings and measurements stand under several ids and count several "
     "times."},
    {NK::systematic,
     "systematic",
     Severity::doubt,
     "The errors of a joint's readings, or of flange poses, depend on its position: they are no "
     "noise, and sigmas are too small.",
     0,
     {NK::wrong_sigma, NK::unexplained}},
    {NK::noise, "noise", Severity::remark,
     "The stated noise was changed, is wrong, or could not be estimated; the text gives both "
     "levels."},
    {NK::outlier_sample, "outlier_sample", Severity::doubt,
     "Samples fit much worse than the others (3 times the usual size and beyond chance).", kSpoils},
    {NK::outlier_view, "outlier_view", Severity::doubt,
     "Views fit much worse than the others of their sensor.", kSpoils},
    {NK::outlier_point, "outlier_point", Severity::doubt,
     "Single points fit much worse than the others, by a robust fit.", kSpoils},
    {NK::chi2, "chi2", Severity::doubt,
     "chi2/dof of all data is outside of 0.8 to 1.25, or that of one sensor is above 1.25, by more "
     "than chance explains."},
    {NK::in_use, "in_use", Severity::doubt,
     "With joint readings taken as exact, the result is no better than the rig for any sensor "
     "and at least a tenth worse for one."},
    {NK::joint_error, "joint_error", Severity::doubt,
     "An estimated joint error is larger than 4 of its sigmas (more where there are over 300)."},
    {NK::joint_noise, "joint_noise", Severity::doubt,
     "Joints are at least 3 times noisier than stated."},
    {NK::arm_scale, "arm_scale", Severity::doubt,
     "Automatic path: all lengths of the arm came out wrong by one factor (more than 0.3 %), "
     "against a sensor that measures lengths."},
    {NK::prior, "prior", Severity::doubt,
     "A component is more than 3 prior sigmas from its prior, or the data require a wider "
     "prior."},
    {NK::sigma, "sigma", Severity::doubt, "A component is uncertain by more than 1 cm or 1 degree.",
     kDirections},
    {NK::rescaled, "rescaled", Severity::remark,
     "A target's size came out off by more than 1.5 %, or a focal length by more than 20 %."},
    {NK::outside_image, "outside_image", Severity::remark,
     "Points lie outside of the image, which reaches from -0.5 to width - 0.5 and height - 0.5.",
     kSpoils},
    {NK::few_data, "few_data", Severity::remark,
     "The last step has as many unknowns as the data have measurements, or more."},
    {NK::undefined, "undefined", Severity::remark,
     "A sample cannot be evaluated at the estimate (a point lies behind a camera) and is missing "
     "from the rms."},
    {NK::no_consensus, "no_consensus", Severity::remark,
     "`--reject` would remove more than half of the samples, so it removed none.", kSpoils},
    {NK::quiet_joints, "quiet_joints", Severity::remark,
     "Joints are at most a third as noisy as stated."},
    {NK::held_out, "held_out", Severity::remark,
     "Automatic path: on held-out data this calibration is worse than one that estimates mounts "
     "alone."},
    {NK::rejected, "rejected", Severity::remark,
     "`--reject` removed a fifth of the training samples or more."},
    {NK::minima, "minima", Severity::remark,
     "A restart ended in another minimum that is as good as the result, or better."},
    {NK::given_pose, "given_pose", Severity::remark,
     "The data contradict a pose that the rig gives; the calibration started elsewhere and ended "
     "much better."},
    {NK::unchecked, "unchecked", Severity::remark,
     "Nothing in the data checks the readings of a sliding joint or the sizes of the boards, and "
     "a mount or lens depends on them."},
    {NK::no_start, "no_start", Severity::remark,
     "The data give no starting value for a pose that the rig does not give.", kSpoils},
    {NK::ambiguous_start, "ambiguous_start", Severity::remark,
     "Several solutions for two poses that the rig does not give fit equally well; the best was "
     "taken.",
     kSpoils},
    {NK::moved, "moved", Severity::remark,
     "A pose moved by more than 0.1 m or 10 degrees from the rig's value."},
    {NK::unfinished, "unfinished", Severity::remark,
     "The joint errors or free targets of some samples did not converge, so an error in a table "
     "is not final."},
    {NK::joint_model, "joint_model", Severity::remark,
     "A joint has parameters that a URDF cannot express; the text gives the error of a program "
     "that uses the URDF alone."},
    {NK::no_effect, "no_effect", Severity::remark,
     "A `--free`, `--fix` or `--group` changes nothing."},
    {NK::never_seen, "never_seen", Severity::remark,
     "No training sample shows a sensor or a mounted target whose pose would be estimated."},
    {NK::last_zero, "last_zero", Severity::remark,
     "The zero of the last joint and the pose of the part behind it cannot be distinguished."},
    {NK::base_frame, "base_frame", Severity::remark,
     "The zero or origin of the first joint and the place of the base frame cannot be "
     "distinguished."},
    {NK::gauge, "gauge", Severity::remark,
     "Parameters of mounts cannot be distinguished in any posture; the automatic path fixed one "
     "of them."},
    {NK::open_pose, "open_pose", Severity::remark,
     "`evaluate` estimated a pose that the rig does not give from the samples."},
    {NK::unused_prior, "unused_prior", Severity::remark,
     "A prior is on a parameter that no training measurement depends on."},
    {NK::undefined_before, "undefined_before", Severity::remark,
     "A sample cannot be evaluated at the rig's values."},
};

const Row& row(NK kind) { return kRows[static_cast<size_t>(kind)]; }

}  // namespace

Subjects subjects(Subject::Kind kind, const std::vector<std::string>& names) {
  Subjects out;
  for (const std::string& name : names) out.push_back({kind, name});
  return out;
}

std::vector<std::string> names_of(const Subjects& subjects) {
  std::vector<std::string> out;
  for (const Subject& s : subjects) out.push_back(s.name);
  return out;
}

Notice make_notice(NoticeKind kind, Subjects where, std::string what, std::string why,
                   std::string cure) {
  return {kind,           std::move(where), std::move(what),
          std::move(why), std::move(cure),  row(kind).severity};
}

NoticeKind kind_of_row(int row) { return kRows[static_cast<size_t>(row)].kind; }

const char* id(NoticeKind kind) { return row(kind).id; }

bool is_mistake(NoticeKind kind) { return kind <= NK::link_length; }

std::vector<std::string> tested_mistakes() {
  std::vector<std::string> out;
  for (const Row& r : kRows)
    if (r.traits & kTested) out.emplace_back(r.id);
  return out;
}

bool can_spoil_the_fit(NoticeKind kind) { return row(kind).traits & kSpoils; }

bool can_be_wrong_number(NoticeKind kind) { return row(kind).traits & kNumber; }

bool is_of_directions(NoticeKind kind) { return row(kind).traits & kDirections; }

bool explains(NoticeKind cause, NoticeKind effect) {
  const bool of_sigmas = effect == NK::sigma || effect == NK::wrong_sigma;
  if (is_mistake(cause) && can_spoil_the_fit(cause) && of_sigmas) return true;
  const std::vector<NK>& effects = row(cause).effects;
  return std::count(effects.begin(), effects.end(), effect) > 0;
}

bool before(const Notice& a, const Notice& b) {
  return std::make_tuple(-static_cast<int>(a.severity), a.kind) <
         std::make_tuple(-static_cast<int>(b.severity), b.kind);
}

std::string capital(std::string text) {
  size_t end = 0;
  while (end < text.size() && text[end] >= 'a' && text[end] <= 'z') ++end;
  const bool word = end == text.size() || std::string(" ,;:'").find(text[end]) != std::string::npos;
  if (end > 0 && word) text[0] = static_cast<char>(text[0] - 'a' + 'A');
  return text;
}

std::string sentences(const Notice& n) {
  const bool whole = is_mistake(n.kind);
  std::string out = whole ? capital(n.what) : n.what;
  if (!n.why.empty()) out += ". " + capital(n.why);
  if (!n.cure.empty()) out += whole ? ". " + capital(n.cure) : ". What to do: " + n.cure;
  if (!n.otherwise.empty()) out += "; " + n.otherwise;
  return whole ? out + "." : out;
}

std::string with_id(const Notice& n) { return std::string(id(n.kind)) + ": " + sentences(n); }

}  // namespace kincal
