// A notice to the user, as data: its kind, its subject, the fact, the reason, and the action.
// sentences() joins the fields for printing; no code parses a sentence.
//
// All kinds are in one table (notice.cpp): id in files, rank, severity, and possible effects. A
// verdict follows from the first notice by (severity, rank): before().
//
// A text may name an option of the library as `name`, as `estimate_noise`; a program replaces the
// mark by its own switch.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace kincal {

/// The kinds of notices, in the order of their rank. Of two with equal severity the first precedes
/// the other and may be its cause. The doctor finds mistakes; all others are warnings of a result.
enum class NoticeKind {
  // mistakes
  square,
  rows_columns,
  numbering,
  mirrored,
  joint_sign,
  degrees,
  still_joint,
  inverted_pose,
  eye_in_hand,
  swapped_cameras,
  rectified,
  same_samples,
  disconnected,
  bad_samples,
  exchanged_axes,
  resolution,
  intrinsics,
  normalised,
  board_columns,
  turned_pose,
  outlier_points,
  units,
  points_outside,
  shifted,
  lag,
  wrong_link,
  wrong_sigma,
  home_position,
  exchanged_joints,
  exchanged_targets,
  absolute_angle,
  joint_axis,
  gear,
  quaternion,
  baseline,
  convention,
  moved_target,
  views_apart,
  turned_picture,
  changed,
  bent,
  link_length,
  // warnings
  not_converged,
  unobservable,
  few_turns,
  unexplained,
  implausible,
  width,
  contradicted,
  repeated,
  identity,
  scale,
  jump,
  duplicates,
  systematic,
  noise,
  outlier_sample,
  outlier_view,
  outlier_point,
  chi2,
  in_use,
  joint_error,
  joint_noise,
  arm_scale,
  prior,
  sigma,
  rescaled,
  outside_image,
  few_data,
  undefined,
  no_consensus,
  quiet_joints,
  held_out,
  rejected,
  minima,
  given_pose,
  unchecked,
  no_start,
  ambiguous_start,
  moved,
  unfinished,
  joint_model,
  no_effect,
  never_seen,
  last_zero,
  base_frame,
  gauge,
  open_pose,
  unused_prior,
  undefined_before,
};

/// The severity of a notice: a remark changes no verdict, a doubt makes it `doubts`, a fault `no`.
enum class Severity { remark, doubt, fault };

/// A Subject is the object of a notice: its kind, and its name in rig, samples or result.
struct Subject {
  enum class Kind { joint, sensor, target, sample, view, parameter, prior, group, step, part };
  Kind kind;
  std::string name;

  static Subject joint(std::string name) { return {Kind::joint, std::move(name)}; }
  static Subject sensor(std::string name) { return {Kind::sensor, std::move(name)}; }
  static Subject target(std::string name) { return {Kind::target, std::move(name)}; }
  static Subject sample(std::string name) { return {Kind::sample, std::move(name)}; }
  static Subject parameter(std::string name) { return {Kind::parameter, std::move(name)}; }

  bool operator==(const Subject& o) const { return kind == o.kind && name == o.name; }
};
using Subjects = std::vector<Subject>;

/// Returns subjects of one kind.
Subjects subjects(Subject::Kind kind, const std::vector<std::string>& names);
/// Returns the names of subjects, in their order.
std::vector<std::string> names_of(const Subjects& subjects);

struct Notice {
  NoticeKind kind;
  Subjects where;
  std::string what;  // a clause that states the fact (of several the worst), without
                     // full stop
  std::string why;   // evidence or consequence: whole sentences, the last without full stop; or ""
  std::string cure;  // the action: a clause without full stop; or ""
  Severity severity = Severity::remark;  // make_notice(): from the table
  // Of mistakes proved by fits: chi2 with the mistake (none: that fit cannot start) and without.
  std::optional<double> chi2_as_is = {}, chi2_corrected = {};
  std::optional<NoticeKind> cause = {};  // the finding that this one refers to
  std::string otherwise = {};  // another action, or if the cure does not help; like cure; or ""
};

using Notices = std::vector<Notice>;

/// Returns a notice with the table's severity.
Notice make_notice(NoticeKind kind, Subjects where, std::string what, std::string why = "",
                   std::string cure = "");

/// Returns the kind with this row in the table, which is also its enum value.
NoticeKind kind_of_row(int row);
/// Returns the id of a kind in files, e.g. "outlier_sample"; ids of mistakes have dashes, e.g.
/// "joint-sign".
const char* id(NoticeKind kind);
/// Returns whether this is a mistake that the doctor finds; else it is a warning.
bool is_mistake(NoticeKind kind);
/// Returns the ids of all mistakes that the doctor tests, in the table's order.
std::vector<std::string> tested_mistakes();
/// Returns whether this kind can prevent a good fit or the convergence of a step.
bool can_spoil_the_fit(NoticeKind kind);
/// Returns whether this kind can be an implausible value in rig or samples.
bool can_be_wrong_number(NoticeKind kind);
/// Returns whether a result's weak directions describe this warning in more detail.
bool is_of_directions(NoticeKind kind);
/// Returns whether the first notice explains the second, on the same subject, so that the second
/// need not be shown.
bool explains(NoticeKind cause, NoticeKind effect);

/// Returns whether a verdict names the first rather than the second.
bool before(const Notice& a, const Notice& b);

/// Returns a text with a capital first letter, unless it begins with a name.
std::string capital(std::string text);
/// Returns a notice as text: a mistake as whole sentences; a warning without capital and full stop,
/// with its cure after "What to do:".
std::string sentences(const Notice& notice);
/// Returns "ID: " and these sentences.
std::string with_id(const Notice& notice);

}  // namespace kincal
