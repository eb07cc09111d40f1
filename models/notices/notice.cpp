#include "notice.h"

#include <algorithm>
#include <array>
#include <tuple>

namespace kincal {
namespace {

using K = NoticeKind;

/// What a kind can be: looked for by the doctor; a cause of a bad fit; a number nobody can mean;
/// said better by the weak directions.
enum Trait : unsigned { kTested = 1, kSpoils = 2, kNumber = 4, kDirections = 8 };

struct Row {
  K kind;
  const char* id;
  Severity severity;
  unsigned traits = 0;
  std::vector<K> effects = {};  // about the same thing, which this explains
};

constexpr Severity kRemark = Severity::remark, kDoubt = Severity::doubt, kFault = Severity::fault;
constexpr unsigned kMistake = kTested | kSpoils;

/// The one table of kinds, in the order of NoticeKind.
const std::vector<Row>& rows() {
  static const std::vector<K> kOfImages = {K::points_outside, K::baseline};
  static const std::vector<Row> out = {
      {K::square, "square", kDoubt, kMistake | kNumber},
      {K::rows_columns, "rows-columns", kDoubt, kMistake, {K::numbering}},
      {K::numbering, "numbering", kDoubt, kMistake},
      {K::mirrored, "mirrored", kDoubt, kMistake, {K::baseline}},
      {K::joint_sign, "joint-sign", kDoubt, kMistake},
      {K::degrees, "degrees", kDoubt, kMistake | kNumber},
      {K::still_joint, "still-joint", kDoubt, kMistake},
      {K::inverted_pose, "inverted-pose", kDoubt, kMistake},
      {K::eye_in_hand, "eye-in-hand", kDoubt, kMistake},
      {K::swapped_cameras, "swapped-cameras", kDoubt, kMistake, kOfImages},
      {K::rectified, "rectified", kDoubt, kMistake},
      {K::same_samples, "duplicates", kDoubt, kTested},
      {K::disconnected, "disconnected", kDoubt, kMistake},
      {K::bad_samples, "bad-samples", kDoubt, kMistake},
      {K::exchanged_axes, "exchanged-axes", kDoubt, kMistake, kOfImages},
      {K::resolution, "resolution", kDoubt, kMistake, kOfImages},
      {K::intrinsics, "intrinsics", kDoubt, kMistake | kNumber, kOfImages},
      {K::normalised, "normalised", kDoubt, kMistake, kOfImages},
      {K::board_columns, "board-columns", kDoubt, kMistake, {K::numbering}},
      {K::turned_pose, "turned-pose", kDoubt, kMistake},
      {K::outlier_points, "outlier-points", kDoubt, kMistake},
      {K::units, "units", kDoubt, kMistake | kNumber},
      {K::points_outside, "outside-image", kDoubt, kTested},
      {K::shifted, "shifted", kDoubt, kMistake},
      {K::lag, "lag", kDoubt, kMistake},
      {K::wrong_link, "wrong-link", kDoubt, kMistake},
      {K::wrong_sigma, "sigma", kDoubt, kTested},
      {K::home_position, "home-position", kDoubt, kMistake},
      {K::exchanged_joints, "exchanged-joints", kDoubt, kMistake},
      {K::exchanged_targets, "exchanged-targets", kDoubt, kMistake},
      {K::absolute_angle, "absolute-angle", kDoubt, kMistake},
      {K::joint_axis, "joint-axis", kDoubt, kMistake},
      {K::gear, "gear", kDoubt, kMistake},
      {K::quaternion, "quaternion", kDoubt, kMistake},
      {K::baseline, "baseline", kDoubt, kMistake | kNumber},
      {K::convention, "convention", kDoubt, kMistake},
      {K::moved_target, "moved-target", kDoubt, kMistake},
      {K::turned_picture, "turned-picture", kDoubt, kMistake},
      {K::changed, "changed", kDoubt, kMistake},
      {K::bent, "bent", kDoubt, kSpoils},
      {K::link_length, "link-length", kDoubt, kSpoils, {K::square, K::baseline, K::intrinsics}},
      {K::not_converged, "not_converged", kFault},
      {K::unobservable, "unobservable", kFault, kDirections},
      {K::few_turns, "few_turns", kRemark},
      {K::unexplained, "unexplained", kFault},
      {K::implausible, "implausible", kDoubt, kSpoils},
      {K::width, "width", kDoubt, 0, {K::sigma}},
      {K::contradicted, "contradicted", kDoubt},
      {K::repeated, "repeated", kRemark},
      {K::identity, "identity", kRemark, kSpoils},
      {K::scale, "scale", kDoubt},
      {K::jump, "jump", kDoubt},
      {K::duplicates, "duplicates", kRemark},
      {K::systematic, "systematic", kDoubt},
      {K::noise, "noise", kRemark},
      {K::outlier_sample, "outlier_sample", kDoubt, kSpoils},
      {K::outlier_view, "outlier_view", kDoubt, kSpoils},
      {K::outlier_point, "outlier_point", kDoubt, kSpoils},
      {K::chi2, "chi2", kDoubt},
      {K::in_use, "in_use", kDoubt},
      {K::joint_error, "joint_error", kDoubt},
      {K::joint_noise, "joint_noise", kDoubt},
      {K::arm_scale, "arm_scale", kDoubt},
      {K::prior, "prior", kDoubt},
      {K::sigma, "sigma", kDoubt, kDirections},
      {K::rescaled, "rescaled", kRemark},
      {K::gears, "gears", kDoubt},
      {K::outside_image, "outside_image", kRemark, kSpoils},
      {K::few_data, "few_data", kRemark},
      {K::undefined, "undefined", kRemark},
      {K::no_consensus, "no_consensus", kRemark, kSpoils},
      {K::quiet_joints, "quiet_joints", kRemark},
      {K::held_out, "held_out", kRemark},
      {K::rejected, "rejected", kRemark},
      {K::minima, "minima", kRemark},
      {K::given_pose, "given_pose", kRemark},
      {K::unchecked, "unchecked", kRemark},
      {K::no_start, "no_start", kRemark, kSpoils},
      {K::ambiguous_start, "ambiguous_start", kRemark, kSpoils},
      {K::moved, "moved", kRemark},
      {K::unfinished, "unfinished", kRemark},
      {K::joint_model, "joint_model", kRemark},
      {K::no_effect, "no_effect", kRemark},
      {K::few_poses, "few_poses", kRemark},
      {K::never_seen, "never_seen", kRemark},
      {K::last_zero, "last_zero", kRemark},
      {K::base_frame, "base_frame", kRemark},
      {K::open_pose, "open_pose", kRemark},
      {K::unused_prior, "unused_prior", kRemark},
      {K::undefined_before, "undefined_before", kRemark},
  };
  return out;
}

const Row& row(K kind) { return rows()[static_cast<size_t>(kind)]; }

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

bool is_mistake(NoticeKind kind) { return kind <= K::link_length; }

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
  if (is_mistake(cause) && can_spoil_the_fit(cause) && effect == K::sigma) return true;
  const std::vector<K>& effects = row(cause).effects;
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
  return whole ? out + "." : out;
}

std::string with_id(const Notice& n) { return std::string(id(n.kind)) + ": " + sentences(n); }

}  // namespace kincal
