#include "image_main.h"

#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>

#include "sibling_main.h"

namespace kincal {

int run_image_program(CLI::App& app, int argc, char** argv, const std::function<int()>& work) {
  cv::setNumThreads(1);  // images go side by side instead
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  return run_program(app, argc, argv, work);
}

}  // namespace kincal
