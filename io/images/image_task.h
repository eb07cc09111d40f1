// What one image is looked at for.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "image_target.h"
#include "load.h"

namespace kincal {

using ImageTargets = std::map<std::string, ImageTarget>;

/// An ImageTask is one image and the views that it is to fill.
struct ImageTask {
  std::string path, shown;
  const Sensor* camera = nullptr;
  struct Wanted {
    int sample = 0, view = 0;
    const ImageTarget* target = nullptr;
    Detection found;
  };
  std::vector<Wanted> wanted;
  LoadedImage image;  // without its pixels once it is done
};

/// Returns the places in `wanted` of targets with one print (same_print), a group each, in their
/// order: most groups have one.
std::vector<std::vector<size_t>> by_print(const ImageTask& task);

}  // namespace kincal
