#include "far_corners.h"

#include <algorithm>
#include <cmath>

#include "../fitting/lens_start.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "../trials/outliers.h"

namespace kincal {
namespace {

constexpr double kMostOut = 0.1;  // of a camera's corners
constexpr double kMuch = 9;       // times the usual mean square
constexpr size_t kNamedSamples = 5;

/// The fit of the lens that suits a camera best, of those with all usual distortion; nothing
/// usable: none is determined.
Solution plain_fit(const CalibrationOptions& options, OneCamera& camera) {
  Solution best;
  best.status = Status::not_converged;
  for (const char* name : {"brown_conrady_2", "brown_conrady_5", "kannala_brandt"}) {
    Solution found = fit_lens(find_lens(name), options, camera);
    if (found.usable() && (!best.usable() || found.chi2_data < best.chi2_data))
      best = std::move(found);
  }
  return best;
}

/// Leaves out whole views that do fit the lens at another pose of their board: a flat board that is
/// small or far looks the same at two, and the fit may have ended at the wrong one.
void keep_turned_over(const Solution& solution, std::vector<Rejected>& rejected,
                      const OneCamera& camera) {
  const Rig lens = at_solution(solution);
  std::vector<double> all;
  for (const View* view : camera.views) all.push_back(std::expm1(lens_misfit(lens, {view})));
  const double usual = median(std::move(all), 0);
  const auto fits = [&](const Rejected& r) {
    if (!r.ids.empty()) return false;
    for (const Sample& sample : *camera.samples)
      for (const View& view : sample.views)
        if (sample.id == r.sample &&
            (r.target.empty() || lens.targets[view.target].name == r.target))
          return std::expm1(lens_misfit(lens, {&view})) < kMuch * usual;
    return false;
  };
  rejected.erase(std::remove_if(rejected.begin(), rejected.end(), fits), rejected.end());
}

/// Takes what was rejected out of the views of a camera; returns how many corners.
size_t take_out(const Rig& rig, int camera, const std::vector<Rejected>& rejected,
                std::vector<Sample>& samples) {
  size_t out = 0;
  for (Sample& sample : samples)
    for (const Rejected& r : rejected) {
      if (r.sample != sample.id) continue;
      for (View& view : sample.views) {
        if (view.sensor != camera ||
            (!r.target.empty() && rig.targets[view.target].name != r.target))
          continue;
        View kept = view;
        kept.ids.clear(), kept.z.clear(), kept.covariance.clear();
        for (size_t k = 0; !r.ids.empty() && k < view.ids.size(); ++k) {
          if (std::count(r.ids.begin(), r.ids.end(), view.ids[k])) continue;
          kept.ids.push_back(view.ids[k]);
          kept.z.insert(kept.z.end(), {view.z[2 * k], view.z[2 * k + 1]});
          if (!view.covariance.empty()) kept.covariance.push_back(view.covariance[k]);
        }
        out += view.ids.size() - kept.ids.size();
        view = std::move(kept);
      }
    }
  for (Sample& sample : samples)
    sample.views.erase(
        std::remove_if(sample.views.begin(), sample.views.end(),
                       [&](const View& v) { return v.sensor == camera && v.ids.empty(); }),
        sample.views.end());
  return out;
}

std::vector<IntrinsicsNote> notes_of(const std::string& camera,
                                     const std::vector<Rejected>& rejected) {
  std::vector<std::string> views, corners;
  for (const Rejected& r : rejected) {
    std::vector<std::string> ids;
    for (const int id : r.ids) ids.push_back(std::to_string(id));
    if (ids.empty())
      views.push_back(quoted(r.sample));
    else
      corners.push_back(quoted(r.sample) + (ids.size() > 1 ? " (ids " : " (id ") +
                        listed(ids, kNamedSamples) + ")");
  }
  std::vector<IntrinsicsNote> out;
  if (!views.empty())
    out.push_back(
        {"outlier_view",
         "'" + camera + "': " + std::to_string(views.size()) +
             (views.size() == 1 ? " view does not belong to" : " views do not belong to") +
             " the others: sample " + listed(views, kNamedSamples) + ", and took no part" +
             ". Look at these pictures (blurred, another board, corners in another "
             "order), and take the views out of the samples"});
  if (!corners.empty())
    out.push_back({"outlier_point", "'" + camera + "': corners far off the others: sample " +
                                        listed(corners, kNamedSamples) + "; they took no part" +
                                        ". Remove these corners from the samples"});
  return out;
}

}  // namespace

std::vector<IntrinsicsNote> take_out_far(const Rig& rig, int camera,
                                         const CalibrationOptions& options,
                                         std::vector<Sample>& samples) {
  OneCamera alone = one_camera(rig, samples, camera, false);
  const Solution plain = plain_fit(options, alone);
  if (!plain.usable() || !has_far_corners(plain, 0)) return {};
  Cleaned cleaned = uncancelled(calibrate_without_outliers(plain.recording, options));
  if (cleaned.rejected.empty() || !cleaned.no_consensus.empty()) return {};
  std::vector<Rejected> rejected = std::move(cleaned.rejected);
  keep_turned_over(cleaned.solution, rejected, alone);
  if (rejected.empty()) return {};
  size_t corners = 0;
  for (const View* view : alone.views) corners += view->ids.size();
  std::vector<Sample> kept = samples;
  const size_t out = take_out(rig, camera, rejected, kept);
  if (static_cast<double>(out) > kMostOut * static_cast<double>(corners)) return {};
  samples = std::move(kept);
  return notes_of(rig.sensors[camera].name, rejected);
}

}  // namespace kincal
