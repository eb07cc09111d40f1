#include "lens_fields.h"

#include <algorithm>

#include "../document/names.h"

namespace kincal {

void set_brown_conrady(const Field& field, std::vector<double> d, LensNumbers& lens) {
  const auto zeros_from = [&](size_t first) {
    return std::all_of(d.begin() + static_cast<std::ptrdiff_t>(first), d.end(),
                       [](double v) { return v == 0; });
  };
  if (d.empty()) return;  // a pinhole
  if (d.size() == 4) d.push_back(0);
  if (d.size() != 5 && d.size() != 8 && d.size() != 12 && d.size() != 14)
    field.fail(
        "4, 5, 8, 12 or 14 numbers are expected (k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x "
        "tau_y]]]]), not " +
        std::to_string(d.size()));
  if (d.size() == 14 && zeros_from(12)) d.resize(12);
  if (d.size() == 12 && zeros_from(8)) d.resize(8);
  lens.model = "brown_conrady";
  lens.distortion = d;
}

void set_kannala_brandt(const Field& field, const std::vector<double>& d, LensNumbers& lens) {
  if (d.size() != 4)
    field.fail("4 numbers are expected (k1 k2 k3 k4), not " + std::to_string(d.size()));
  lens.model = "kannala_brandt";
  lens.distortion = d;
}

void read_size(const Field& width, const Field& height, LensNumbers& lens) {
  constexpr int kMost = 1'000'000;
  lens.width = width.integer(0, kMost);
  lens.height = height.integer(0, kMost);
  if (lens.width == 0 || lens.height == 0) lens.width = lens.height = 0;  // unknown
}

std::string chosen_camera(const Field& file, const std::vector<std::string>& cameras,
                          const std::string& wanted) {
  if (cameras.empty()) file.fail("has no camera");
  if (wanted.empty() && cameras.size() > 1)
    file.fail("has several cameras: take --camera NAME with one of " + comma_separated(cameras));
  const std::string name = wanted.empty() ? cameras[0] : wanted;
  if (std::find(cameras.begin(), cameras.end(), name) == cameras.end())
    file.fail("there is no camera '" + name + "'; valid: " + comma_separated(cameras));
  return name;
}

std::string pose_not_taken(const std::string& key) {
  return key + " was not used: the calibration estimates the poses of the cameras";
}

}  // namespace kincal
