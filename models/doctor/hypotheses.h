// The usual mistakes, each as a transformation (rig, samples) -> (rig, samples) that undoes it. A mistake is its own inverse (exchange,
// sign, turn) or is undone by a factor, so undoing needs no knowledge of how it came about. Whether one was made, fits decide: doctor.h.
//
// Relabelings of a grid. Numbering a board from another corner, or its rows backwards, permutes its points by a symmetry of the grid:
// half a turn (n - 1 - i of a chessboard), a reflection, of a square board also a quarter turn. A view by itself cannot show that, for a
// permuted flat board is the same board somewhere else (seen from behind, of a reflection); what holds or else sees the board can.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "../rig/configuration.h"
#include "../rig/targets.h"
#include "../rig/words.h"

namespace kincal {

struct Hypothesis {
  std::string id;                  // as in formats.md
  std::vector<std::string> where;  // sensors, targets, joints, samples
  std::string what;                // a main clause about the mistake, without its full stop
  std::string cure;                // what to change, a sentence
  std::function<void(Rig&, std::vector<Sample>&)> undo;
  std::vector<int> squares;       // the sizes of these targets are free besides; undo() makes grids of them
  std::vector<std::string> free;  // parameters that are free besides
  bool new_poses = false;         // freed poses mean something else now: their values are to be found in closed form
  bool marked = false;            // about the numbering of a target whose markers tell which point is which
  int excused = -1;               // joint whose readings do not count
};

/// What a rig's steps free together.
struct FreedNames {
  std::vector<char> parameter;  // by parameter of the table: any component
  std::vector<char> whole;      // all of a pose
};

/// All but those that need the values of a fit (bad samples, numbering of single views). What is freed anyway is no hypothesis.
std::vector<Hypothesis> hypotheses(const Rig& rig, const ParameterTable& table, const std::vector<Sample>& samples,
                                   const FreedNames& freed);

/// Where the points of a flat target go if it is turned or reflected about its centre by `m` (orthogonal 2 x 2): place i has the index of the
/// point that point i comes to lie on. Empty if it does not come to lie on itself.
std::vector<int> relabeling(const Target& target, const Eigen::Matrix2d& m);

/// Replaces ids of a view (all points in order if it has none) by `places` of them.
void relabel(View& view, const Target& target, const std::vector<int>& places);

}  // namespace kincal
