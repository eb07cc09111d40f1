#include "sibling_main.h"

#include <cstdio>
#include <exception>
#include <iostream>

#include "signals.h"

namespace kincal {

int run_program(CLI::App& app, int argc, char** argv, const std::function<int()>& work) {
  keep_standard_descriptors();
  end_on_signals();
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
