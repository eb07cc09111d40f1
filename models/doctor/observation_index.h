// The index of observations in which the usual mistakes are looked for, and what a hypothesis about
// one of them is.
#pragma once

#include <functional>
#include <map>
#include <set>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "../notices/notice.h"
#include "../rig/configuration.h"
#include "../rig/recording.h"

namespace kincal {

/// An Undo changes a rig, or a rig and its samples, as if a mistake had not been made.
class Undo {
 public:
  Undo() = default;
  /// From a function of a rig alone, or of both.
  template <class Change, class = std::enable_if_t<!std::is_same_v<Change, Undo>>>
  Undo(Change change) {
    if constexpr (std::is_invocable_v<Change&, Rig&>)
      rig_ = std::move(change);
    else
      both_ = std::move(change);
  }
  /// Returns the recording without the mistake; it copies no samples that do not change.
  Recording operator()(const Recording& recording) const {
    Rig rig = recording.rig;
    if (!both_) {
      rig_(rig);
      return recording.with_rig(std::move(rig));
    }
    std::vector<Sample> samples = recording.samples;
    both_(rig, samples);
    return {std::move(rig), std::move(samples)};
  }

 private:
  std::function<void(Rig&)> rig_;
  std::function<void(Rig&, std::vector<Sample>&)> both_;
};

/// A Hypothesis is a mistake that may have been made, as the transformation of rig and samples that
/// undoes it.
struct Hypothesis {
  NoticeKind kind = NoticeKind::square;
  Subjects where = {};
  std::string mistake = "";  // a main clause about the mistake, without its full stop
  std::string cure = "";     // what to change, a clause without its full stop
  Undo undo = [](Rig&) {};
  std::vector<int> squares =
      {};  // the sizes of these targets are free besides; undo() makes grids of them
  std::vector<std::string> free = {};  // parameters that are free besides
  bool new_poses =
      false;  // freed poses mean something else now: their values are to be found in closed form
  bool many = false;             // one of a kind that is much: not tried where another explains all
  bool leaves_out = false;       // undo() leaves out what it cannot put right
  bool only_of_misfits = false;  // it explains no parameters that moved: markers identify the
                                 // points, or another lens fits as well
  int ignored_joint = -1;        // joint whose readings do not count, -1: none
  /// What the numbers found for `free` say, the mistake and its cure; no mistake: not believed. An
  /// empty function: `mistake` and `cure` stand as they are.
  std::function<std::pair<std::string, std::string>(const std::vector<double>&)> told = {};
  bool rarer = false;  // than other mistakes
  int rescaled = -1;   // sensor whose measured numbers undo() multiplies by `factor`
  double factor = 1;
};

/// Returns an Undo that changes the views of a sensor; -1: of every sensor.
Undo of_views(int sensor, std::function<void(const Rig&, View&)> change);
/// Returns an Undo that changes one number in so many of a sensor's measured numbers, from one of
/// them.
Undo of_numbers(int sensor, size_t first, size_t stride, std::function<double(double)> change);
/// Returns the subjects of all sensors that see something.
Subjects all_sensors(const Rig& rig, const std::set<int>& sensors);

/// Makes a hypothesis that points are mirrored: `clause` says which, `owner` ("sensor" or "target")
/// whose pose would have to turn, and `place` where their numbers stand. `where` and `undo` are
/// left to the caller.
Hypothesis mirrored_points(const std::string& clause, int axis, const std::string& owner,
                           const std::string& place);

/// FreedNames are what a rig's steps free together.
struct FreedNames {
  std::vector<char> parameter;  // by parameter of the table: any component
  std::vector<char> whole;      // all of a pose
};

/// An ObservationIndex says which sensor sees which target, which joints matter and how they move.
struct ObservationIndex {
  std::set<std::pair<int, int>> pairs;  // (sensor, target) with a view
  std::set<int> sensors, targets;
  std::map<int, std::pair<double, double>>
      ranges;                            // joint that some view needs: least and greatest reading
  std::map<int, std::set<int>> samples;  // joint: indices of the samples that need it
  std::set<int> floating;                // joints with a pose as reading, whose axes are not in
                                         // `ranges`
};

/// Returns the link that carries `link` without a moving joint between, closest to the root
/// (floating and planar joints stand still here).
int immobile_body(const Tree& tree, int link);

/// Makes the index of these samples.
ObservationIndex make_observation_index(const Rig& rig, const std::vector<Sample>& samples);

}  // namespace kincal
