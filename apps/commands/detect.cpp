// `kincal detect` hands over to the program kincal-detect: only that one needs OpenCV, whose
// libraries take longer to load than many a calibration takes.
#include <unistd.h>

#include <filesystem>
#include <memory>

#include "../../io/document/error.h"
#include "../detect_options.h"
#include "command.h"

namespace kincal {
namespace {

constexpr char kDetectProgram[] = "kincal-detect";

/// Replaces this program; returns only if there is no kincal-detect.
void become_detect(std::vector<std::string> arguments) {
  std::vector<char*> words;
  for (std::string& argument : arguments) words.push_back(argument.data());
  words.push_back(nullptr);
  std::error_code status;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", status);
  if (!status) {
    const std::filesystem::path folder = self.parent_path();
    execv((folder / kDetectProgram).c_str(), words.data());
    execv((folder.parent_path() / "libexec" / "kincal" / kDetectProgram).c_str(), words.data());
  }
  execvp(kDetectProgram, words.data());
}

}  // namespace

Command detect_command(CLI::App& app, std::vector<std::string> arguments) {
  auto a = std::make_shared<DetectArguments>();
  CLI::App* command =
      app.add_subcommand("detect", "Find boards and markers in images and write them as samples");
  add_detect_options(*command, *a);
  return {command, [a, arguments]() -> int {
            become_detect(arguments);
            throw InputError(
                "`kincal detect` is the program kincal-detect, which is neither beside kincal nor "
                "in the PATH. It is built where OpenCV is: apt-get install "
                "libopencv-contrib-dev, then build kincal again (CMake option KINCAL_IMAGES)");
          }};
}

}  // namespace kincal
