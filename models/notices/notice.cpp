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
  unsigned traits = 0;
  std::vector<NK> effects = {};  // about the same thing, which this explains
};

constexpr unsigned kMistake = kTested | kSpoils;

const std::vector<NK> kOfImages = {NK::points_outside, NK::baseline};

/// The one table of kinds, in the order of NoticeKind.
const std::vector<Row>& rows() {
  static const std::vector<Row> out = {
      {NK::square, "square", Severity::doubt, kMistake | kNumber},
      {NK::rows_columns, "rows-columns", Severity::doubt, kMistake, {NK::numbering}},
      {NK::numbering, "numbering", Severity::doubt, kMistake},
      {NK::mirrored, "mirrored", Severity::doubt, kMistake, {NK::baseline}},
      {NK::joint_sign, "joint-sign", Severity::doubt, kMistake},
      {NK::degrees, "degrees", Severity::doubt, kMistake | kNumber},
      {NK::still_joint, "still-joint", Severity::doubt, kMistake},
      {NK::inverted_pose, "inverted-pose", Severity::doubt, kMistake},
      {NK::eye_in_hand, "eye-in-hand", Severity::doubt, kMistake},
      {NK::swapped_cameras, "swapped-cameras", Severity::doubt, kMistake, kOfImages},
      {NK::rectified, "rectified", Severity::doubt, kMistake},
      {NK::same_samples, "duplicates", Severity::doubt, kTested},
      {NK::disconnected, "disconnected", Severity::doubt, kTested},  // a lack, no bad fit
      {NK::bad_samples, "bad-samples", Severity::doubt, kMistake},
      {NK::exchanged_axes, "exchanged-axes", Severity::doubt, kMistake, kOfImages},
      {NK::resolution, "resolution", Severity::doubt, kMistake, kOfImages},
      {NK::intrinsics, "intrinsics", Severity::doubt, kMistake | kNumber, kOfImages},
      {NK::normalised, "normalised", Severity::doubt, kMistake, kOfImages},
      {NK::board_columns, "board-columns", Severity::doubt, kMistake, {NK::numbering}},
      {NK::turned_pose, "turned-pose", Severity::doubt, kMistake},
      {NK::outlier_points, "outlier-points", Severity::doubt, kMistake},
      {NK::units, "units", Severity::doubt, kMistake | kNumber},
      {NK::points_outside, "outside-image", Severity::doubt, kTested},
      {NK::shifted, "shifted", Severity::doubt, kMistake},
      {NK::lag, "lag", Severity::doubt, kMistake},
      {NK::wrong_link, "wrong-link", Severity::doubt, kMistake},
      {NK::wrong_sigma, "sigma", Severity::doubt, kTested},
      {NK::home_position, "home-position", Severity::doubt, kMistake},
      {NK::exchanged_joints, "exchanged-joints", Severity::doubt, kMistake},
      {NK::exchanged_targets, "exchanged-targets", Severity::doubt, kMistake},
      {NK::absolute_angle, "absolute-angle", Severity::doubt, kMistake},
      {NK::joint_axis, "joint-axis", Severity::doubt, kMistake},
      {NK::gear, "gear", Severity::doubt, kMistake},
      {NK::quaternion, "quaternion", Severity::doubt, kMistake},
      {NK::baseline, "baseline", Severity::doubt, kMistake | kNumber},
      {NK::convention, "convention", Severity::doubt, kMistake},
      {NK::moved_target, "moved-target", Severity::doubt, kMistake},
      {NK::views_apart, "views-apart", Severity::doubt, kMistake},
      {NK::turned_picture, "turned-picture", Severity::doubt, kMistake},
      {NK::changed, "changed", Severity::doubt, kMistake},
      {NK::bent, "bent", Severity::doubt, kSpoils},
      {NK::link_length,
       "link-length",
       Severity::doubt,
       kSpoils,
       {NK::square, NK::baseline, NK::intrinsics}},
      {NK::not_converged, "not_converged", Severity::fault},
      {NK::unobservable, "unobservable", Severity::fault, kDirections},
      {NK::few_turns, "few_turns", Severity::remark},
      {NK::unexplained, "unexplained", Severity::fault},
      {NK::implausible, "implausible", Severity::doubt, kSpoils},
      {NK::width, "width", Severity::doubt, 0, {NK::sigma}},
      {NK::contradicted, "contradicted", Severity::doubt},
      {NK::repeated, "repeated", Severity::remark},
      {NK::identity, "identity", Severity::remark, kSpoils},
      {NK::scale, "scale", Severity::doubt},
      {NK::jump, "jump", Severity::doubt},
      {NK::duplicates, "duplicates", Severity::remark},
      {NK::systematic, "systematic", Severity::doubt},
      {NK::noise, "noise", Severity::remark},
      {NK::outlier_sample, "outlier_sample", Severity::doubt, kSpoils},
      {NK::outlier_view, "outlier_view", Severity::doubt, kSpoils},
      {NK::outlier_point, "outlier_point", Severity::doubt, kSpoils},
      {NK::chi2, "chi2", Severity::doubt},
      {NK::in_use, "in_use", Severity::doubt},
      {NK::joint_error, "joint_error", Severity::doubt},
      {NK::joint_noise, "joint_noise", Severity::doubt},
      {NK::arm_scale, "arm_scale", Severity::doubt},
      {NK::prior, "prior", Severity::doubt},
      {NK::sigma, "sigma", Severity::doubt, kDirections},
      {NK::rescaled, "rescaled", Severity::remark},
      {NK::gears, "gears", Severity::doubt},
      {NK::outside_image, "outside_image", Severity::remark, kSpoils},
      {NK::few_data, "few_data", Severity::remark},
      {NK::undefined, "undefined", Severity::remark},
      {NK::no_consensus, "no_consensus", Severity::remark, kSpoils},
      {NK::quiet_joints, "quiet_joints", Severity::remark},
      {NK::held_out, "held_out", Severity::remark},
      {NK::rejected, "rejected", Severity::remark},
      {NK::minima, "minima", Severity::remark},
      {NK::given_pose, "given_pose", Severity::remark},
      {NK::unchecked, "unchecked", Severity::remark},
      {NK::no_start, "no_start", Severity::remark, kSpoils},
      {NK::ambiguous_start, "ambiguous_start", Severity::remark, kSpoils},
      {NK::moved, "moved", Severity::remark},
      {NK::unfinished, "unfinished", Severity::remark},
      {NK::joint_model, "joint_model", Severity::remark},
      {NK::no_effect, "no_effect", Severity::remark},
      {NK::never_seen, "never_seen", Severity::remark},
      {NK::last_zero, "last_zero", Severity::remark},
      {NK::base_frame, "base_frame", Severity::remark},
      {NK::gauge, "gauge", Severity::remark},
      {NK::open_pose, "open_pose", Severity::remark},
      {NK::unused_prior, "unused_prior", Severity::remark},
      {NK::undefined_before, "undefined_before", Severity::remark},
  };
  return out;
}

const Row& row(NK kind) { return rows()[static_cast<size_t>(kind)]; }

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

NoticeKind kind_of_row(int row) { return rows()[static_cast<size_t>(row)].kind; }

const char* id(NoticeKind kind) { return row(kind).id; }

bool is_mistake(NoticeKind kind) { return kind <= NK::link_length; }

std::vector<std::string> tested_mistakes() {
  std::vector<std::string> out;
  for (const Row& r : rows())
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
