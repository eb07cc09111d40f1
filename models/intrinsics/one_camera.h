// One camera by itself: the lenses that it may have, and how one of them is fitted to its views.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "../calibration/calibration.h"
#include "../sensors/sensors.h"
#include "camera_groups.h"

namespace kincal {

/// A LensModel is a lens with the distortion that is estimated: the first `freed` of its numbers.
struct LensModel {
  std::string name;  // "brown_conrady_2"
  std::string type;  // as a rig calls it
  Lens lens;
  int distortion = 0, freed = 0;
  int numbers() const { return 4 + freed; }
};
/// Returns the lenses that are tried, those with fewer numbers first.
const std::vector<LensModel>& lens_models();
/// Returns those besides, which a user or the rig must ask for.
const std::vector<LensModel>& further_lens_models();
/// Returns whether a camera found to have one lens is a start for the other.
bool start_alike(Lens a, Lens b);
/// Returns the lens of that name. @throws std::invalid_argument: there is none; the names.
const LensModel& find_lens(const std::string& name);
/// Returns the lens that a camera of a rig has, with all of its distortion free.
/// @throws std::invalid_argument: it is none of these.
const LensModel& own_lens(const Sensor& camera);

/// Makes the rig's only step free the lenses, by sensor, and the poses of all cameras but the
/// first.
void set_steps(const std::vector<const LensModel*>& lenses, Rig& rig);
/// Returns the rig of a solution with its values in place, to start from.
Rig at_solution(const Solution& solution);
/// Frees the warp of the boards that samples show; false: they show none.
bool bend_boards(const std::vector<Sample>& samples, Rig& rig);
/// Returns the rms in px of a solution's residuals in a camera's training views.
double training_rms(const Solution& solution, int sensor);

using SharedSamples = std::shared_ptr<const std::vector<Sample>>;

/// Returns the recording of a rig that shares the samples.
std::shared_ptr<const Recording> recording_of(Rig rig, const SharedSamples& samples);

/// One camera by itself: its samples, and the cameras that it was found to be, to start from.
struct OneCamera {
  Rig rig;  // of one sensor
  SharedSamples samples;
  std::vector<const View*> views;  // of the samples
  std::vector<Sensor> starts;
  bool bent = false;  // its boards: their warp is fitted with each lens
};
OneCamera one_camera(const Rig& rig, const std::vector<Sample>& samples, int camera, bool bent);

/// Fits a lens without initial values from each of its usual starting values, and keeps the best as
/// a start: the images of one double sphere are nearly those of another with very different
/// parameters.
void fit_plain_lens(const LensModel& model, const CalibrationOptions& options, OneCamera& camera);

/// Returns the camera with a lens at the best of the starts of its kind.
Sensor best_start(const OneCamera& camera, const LensModel& model);

/// Fits a lens to one camera, and keeps the result as a start for lenses with more parameters.
Solution fit_lens(const LensModel& model, const CalibrationOptions& options, OneCamera& camera);

}  // namespace kincal
