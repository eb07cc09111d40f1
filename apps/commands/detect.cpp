// `kincal detect` hands over to the program kincal-detect: only that one needs OpenCV, whose
// libraries take longer to load than many a calibration takes.
#include <memory>

#include "../detect_options.h"
#include "../sibling.h"
#include "command.h"

namespace kincal {

Command detect_command(CLI::App& app, const std::vector<std::string>& arguments) {
  auto a = std::make_shared<DetectArguments>();
  CLI::App* command =
      app.add_subcommand("detect", "Find boards and markers in images and write samples");
  add_detect_options(*command, *a);
  return {command, [a, arguments]() -> int {
            become(find_sibling("kincal-detect", "`kincal detect`", kBuiltWithImages), arguments);
          }};
}

}  // namespace kincal
