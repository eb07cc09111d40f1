// One camera alone: its possible lenses, and the fit of one of them to its views.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "../calibration/calibration.h"
#include "../sensors/sensors.h"
#include "camera_groups.h"

namespace kincal {

/// A LensModel is a lens with the number of its distortion coefficients and of those estimated (the
/// first `freed`).
struct LensModel {
  std::string name;  // "brown_conrady_4"
  std::string type;  // its name in rig.yaml
  Lens lens;
  int distortion = 0, freed = 0;
  int numbers() const { return 4 + freed; }
};
/// Returns the lenses that are tried, in the order of preference: those with fewer parameters
/// first, but kannala_brandt as if it had the two of tangential distortion, too. All others but the
/// pinhole estimate these: fixed at 0, a usual 5e-4 moves the centre by 6 sigmas, and the held-out
/// error does not show it.
const std::vector<LensModel>& lens_models();
/// Returns the other lenses, which are used only if a user or the rig requests them.
const std::vector<LensModel>& further_lens_models();
/// Returns whether the result of one lens is a starting value for the other.
bool start_alike(Lens a, Lens b);
/// Returns the lens with this name. @throws std::invalid_argument listing the names: there is none.
const LensModel& find_lens(const std::string& name);
/// Returns the lens of a rig's camera, with all of its distortion estimated.
/// @throws std::invalid_argument: it is none of these.
const LensModel& own_lens(const Sensor& camera);

/// Sets the rig's only step: it estimates the lenses, by sensor, and the poses of all cameras but
/// the first.
void set_steps(const std::vector<const LensModel*>& lenses, Rig& rig);
/// Returns the rig of a solution with the estimated values as starting values.
Rig at_solution(const Solution& solution);
/// Adds the warp of the boards in the samples to the estimated parameters. Returns false if the
/// samples contain no board.
bool bend_boards(const std::vector<Sample>& samples, Rig& rig);
/// Returns the rms in px of a solution's residuals in a camera's training views.
double training_rms(const Solution& solution, int sensor);

using SharedSamples = std::shared_ptr<const std::vector<Sample>>;

/// Returns the recording of a rig, which shares the samples.
std::shared_ptr<const Recording> recording_of(Rig rig, const SharedSamples& samples);

/// One camera alone: its samples, and its earlier fits as starting values.
struct OneCamera {
  Rig rig;  // of one sensor
  SharedSamples samples;
  std::vector<const View*> views;  // of the samples
  std::vector<Sensor> starts;
  bool bent = false;  // the warp of its boards is fitted with each lens
};
OneCamera one_camera(const Rig& rig, const std::vector<Sample>& samples, int camera, bool bent);

/// Fits a lens without initial values from each of its usual starting values, and adds the best to
/// the starts. (A double sphere's images are nearly those of another with very different
/// parameters.)
void fit_plain_lens(const LensModel& model, const CalibrationOptions& options, OneCamera& camera);

/// Returns the camera with this lens model and the best starting values found for it.
Sensor best_start(const OneCamera& camera, const LensModel& model);

/// Fits a lens to one camera, and adds the result to the starts for lenses with more parameters.
Solution fit_lens(const LensModel& model, const CalibrationOptions& options, OneCamera& camera);

}  // namespace kincal
