#include "image_main.h"

#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>

#include <cstdio>
#include <exception>
#include <iostream>

#include "signals.h"

namespace kincal {

int run_image_program(CLI::App& app, int argc, char** argv, const std::function<int()>& work) {
  keep_standard_descriptors();
  end_on_signals();
  cv::setNumThreads(1);  // images go side by side instead
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  app.set_version_flag("--version", "kincal " KINCAL_VERSION);
  try {
    app.parse(argc, argv);
    const int code = work();
    if (std::cout.flush()) return code;
    std::fprintf(stderr, "kincal: error: standard output cannot be written\n");
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    std::fprintf(stderr, "kincal: error: %s\nRun `%s --help` for more.\n", error.what(),
                 app.get_name().c_str());
  } catch (const std::exception& error) {
    std::cout.flush();
    std::fprintf(stderr, "kincal: error: %s\n", error.what());
  }
  return kBadInput;
}

}  // namespace kincal
