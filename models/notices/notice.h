// What a user should know, as data: which kind it is, what it is about, what is the case, why, and
// what to do. Whoever prints it puts the fields together (sentences()); nobody takes a sentence
// apart.
//
// Every kind stands in one table (notice.cpp): its id in files, its rank, how severe it is, and
// what it can cause or explain. A verdict is a fold over notices by (severity, rank): before().
//
// A text may name an option of the library as `name`, as `estimate_noise`; a program replaces the
// mark by its own switch.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace kincal {

/// The kinds of notices, in the order of their rank: of two that are as severe, the first one goes
/// before the other, whose cause it may be. Mistakes are found by the doctor; all others are
/// warnings of a result.
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
  gears,
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

/// How severe a notice is: a remark changes no verdict, a doubt makes it `doubts`, a fault `no`.
enum class Severity { remark, doubt, fault };

/// A Subject is what a notice is about: a kind of thing and its name in rig, samples or result.
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
  std::string what;  // a clause that says what is the case (of several cases the worst), without
                     // full stop
  std::string why;  // evidence, or what follows: whole sentences, the last without full stop; or ""
  std::string cure;                      // what to do: a clause without full stop; or ""
  Severity severity = Severity::remark;  // make_notice(): as the table has it
  // Of mistakes that were proved by fits: chi2 with the mistake (nothing: that fit cannot start)
  // and without.
  std::optional<double> chi2_as_is = {}, chi2_corrected = {};
  std::optional<NoticeKind> cause = {};  // the finding that this one speaks of
  bool estimated = false;      // no mistake where it is estimated: stands behind the others
  std::string otherwise = {};  // what else to do, or what if the cure is none: as the cure; or ""
};

using Notices = std::vector<Notice>;

/// Returns a notice with the severity of the table.
Notice make_notice(NoticeKind kind, Subjects where, std::string what, std::string why = "",
                   std::string cure = "");

/// Returns the kind of a row of the table, which is that of this value.
NoticeKind kind_of_row(int row);
/// Returns the id of a kind in files, as "outlier_sample"; of mistakes with dashes, as
/// "joint-sign".
const char* id(NoticeKind kind);
/// Returns whether the doctor finds this kind; else it is a warning.
bool is_mistake(NoticeKind kind);
/// Returns the ids of all mistakes that the doctor looks for, in the table's order.
std::vector<std::string> tested_mistakes();
/// Returns whether this can be why nothing fits, or why a step does not converge.
bool can_spoil_the_fit(NoticeKind kind);
/// Returns whether this can be a number of rig or samples that nobody can mean.
bool can_be_wrong_number(NoticeKind kind);
/// Returns whether the weak directions of a result describe more than this warning.
bool is_of_directions(NoticeKind kind);
/// Returns whether the first notice explains the second, about the same thing, which then need not
/// be shown.
bool explains(NoticeKind cause, NoticeKind effect);

/// Returns whether a verdict speaks of the first rather than of the second.
bool before(const Notice& a, const Notice& b);

/// Returns a text as the beginning of a sentence: its first letter is a capital if it begins with a
/// word, not with a name.
std::string capital(std::string text);
/// Returns a notice as text: for a mistake whole sentences; for a warning without capital and full
/// stop, with its cure after "What to do:".
std::string sentences(const Notice& notice);
/// Returns "ID: " and these.
std::string with_id(const Notice& notice);

}  // namespace kincal
