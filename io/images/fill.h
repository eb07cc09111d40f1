// From images to samples: views that have an image and no pixels get them.
#pragma once

#include <string>
#include <vector>

#include "../../solver/progress.h"
#include "../exchange/joint_table.h"
#include "../rig/rig_file.h"

namespace kincal {

struct FillOptions {
  std::string out;     // the samples file to be: relative paths of images are rewritten for it
  std::string sensor;  // of a folder of images; "": the only camera
  std::string joints;  // file of readings; "": none
  std::string pose_format, unit;  // of a file of the flange's poses; "": it has joint readings
  JointWords words;               // of a file of joint readings
  std::string draw;               // folder of annotated pictures; "": none
  bool sigma = false;             // write what each view's sigma is by the picture
  double tolerance = 0.05;        // s, between an image and its readings
  int threads = 1;                // the result is the same for any number
  Progress progress;
};

/// Filled is what came of it.
struct Filled {
  std::string text;                // of the samples file
  std::vector<std::string> lines;  // a verdict for each image and target
  std::vector<std::string> notes;  // about all of them
  int views = 0, found = 0;        // looked for, and found
  int unusable = 0;                // images that cannot be used at all
  int samples = 0;                 // in the text
  std::vector<std::string> lost;   // samples of which nothing is left, and images without readings
};

/// Fills in the samples of a file. @throws InputError
Filled fill_samples(const RigFile& rig, const std::string& path, const FillOptions& options);

/// Makes a sample of each image. @throws InputError
Filled fill_images(const RigFile& rig, const std::vector<std::string>& images,
                   const FillOptions& options);

/// Returns the images that are meant: of a folder, of a pattern with * and ? in its last part, or
/// the one file. They are in the order of their names, numbers as numbers.
std::vector<std::string> image_files(const std::string& path);

}  // namespace kincal
