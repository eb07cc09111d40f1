// Further models on the automatic path, which a URDF cannot hold: joints that bend under weights
// (kinematics/bending.h), what the samples' conditions add (rig/conditions.h) and error curves over
// the joints' angles (joints/curve_joint.h). They are tried behind the geometry, each on top of
// what was kept before:
//
//   compliance          about the joints' axes, with the loads that the rig begins with
//   compliance across   of the joints' axes, in the stator's frame or the rotor's
//   loads               first moments of the moving links
//   prints, warps       of boards: longer along x than along y, sheared; not flat (rig/targets.h)
//   marker points       of targets that are points
//   backlash            of joints whose direction of approach the samples state
//   time offsets        of sensors that measured while joints moved, if the samples state rates
//   temperature         of joints, if the samples state different ones
//   ripple/NAME         of a joint whose gear ratios the rig states, or the data (ripple_search.h)
//   curve/NAME          of a joint that turns
//   coupling/NAME       of a joint that turns to the readings of those next to it
//   gears               scales of all joints but scanning ones, together
//
// They stand in for each other (a bent arm's error goes with the angles as well), so the order
// matters: what has a physical reason goes first.
//
// A trial. At the fit so far, with noise that has in it what the fit lacks (where the data show
// more than the rig states, that: outliers or a joint that was homed anew are no curve), the groups
// of the further model are freed in the data's quadratic model, each alone with a learned width
// (from its start and from ten times that: the evidence has local maxima; widths.h), beside gears,
// which are the simpler reason for an error that grows with the angle. One that
// gains evidence is added, the largest gain first, if samples that the fit lacks (rig/folds.h) fit
// better with it: evidence alone takes it for what goes with these postures only. With those
// everything is calibrated again, noise and all, and those that lose their evidence on the way are
// left away. Gears are weighed with unknown noise as well (evidence/evidence.h): an error that
// grows with the angle hides in the noise of a joint's readings, if that is not known.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "outcome.h"
#include "width_problem.h"

namespace kincal {

/// Where the width of a group is looked for, in starting widths: its evidence has two maxima (an
/// Aubo). (Of 280 right recordings none was given such a group.)
constexpr double kWidthsTried[] = {1, 10};

/// A FitWithGroups is what further models are tried on.
struct FitWithGroups {
  std::shared_ptr<const Recording> recording;  // with the noise that was found, or is seen
  EstimationSetup setup;
  Values values;
  AutomaticGroups groups;
  VectorXd factor;  // of the groups' widths
};

/// A FurtherModel is a recording with more parameters, which change nothing yet, and their groups.
struct FurtherModel {
  std::shared_ptr<const Recording> recording;
  std::vector<WidthGroup> groups;
  double log_candidates = 0;  // ln of how many it was chosen from: gains are less by that
  double left = 1;            // variance of the noise with it, over that of the fit
};
/// Returns the recording with error curves of these joints.
std::shared_ptr<const Recording> with_curves(const Recording& recording,
                                             const std::vector<int>& joints);
/// Returns the recording with a backlash of the joints that its samples tell one of.
std::shared_ptr<const Recording> with_backlash(const Recording& recording);
/// Returns the recording with a temperature coefficient of every joint that moves.
std::shared_ptr<const Recording> with_temperature(const Recording& recording);
/// Returns the recording with a print of every board that may be out of scale.
std::shared_ptr<const Recording> with_prints(const Recording& recording);
/// Returns the recording with a warp of every board.
std::shared_ptr<const Recording> with_warps(const Recording& recording);
/// Returns the recording with ripples of these joints, at the ratios that the rig states.
std::shared_ptr<const Recording> with_ripple(const Recording& recording,
                                             const std::vector<int>& joints);
/// Returns the recording with these joints coupled to those next to them.
std::shared_ptr<const Recording> with_coupling(const Recording& recording,
                                               const std::vector<int>& joints);
/// Returns the recording with time offsets of the sensors that its samples tell one of.
std::shared_ptr<const Recording> with_time_offsets(const Recording& recording);
/// Returns the recording without what these have added, which nobody stated. Shapes of 0, backlash
/// and temperatures that the rig's priors name stay: they are estimated with these.
std::shared_ptr<const Recording> without_added(const Recording& recording);
/// Returns the recording with an elasticity, compliances of zero; gravity and loads of the rig's
/// own, where it has one.
std::shared_ptr<const Recording> with_elasticity(const Recording& recording, bool rotor);

/// Returns a recording with the further models of another, whose rig is the same otherwise.
Recording with_models_of(const Recording& recording, const Recording& other);

/// Returns shared values in a table with more parameters, which are at their initial values.
VectorXd shared_in(const VectorXd& shared, const ParameterTable& from, const ParameterTable& to);
/// Returns the values of a fit in a recording with more parameters.
Values values_in(const FitWithGroups& fit, const Recording& recording);

/// A FurtherTrial says which groups of a further model pay, and by how much of log evidence all
/// together.
struct FurtherTrial {
  std::vector<std::string> groups;
  std::map<std::string, double> factor;   // of their widths
  std::map<std::string, VectorXd> value;  // of their members, in the order of the columns
  std::map<std::string, double> moves;    // what the fit estimated, by how many sigmas, at most
  double gain = 0;
  std::vector<TriedGroup> tried;  // all groups of the model
};
/// `folded` is the recording with the steps that were run: its folds are those of the trial.
FurtherTrial try_model(const FitWithGroups& fit, const FurtherModel& model,
                       const Recording& folded);

}  // namespace kincal
