#include "sibling.h"

#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <sstream>

#include "../io/document/error.h"

namespace kincal {

std::string find_sibling(const std::string& name, const std::string& what,
                         const std::string& built) {
  namespace fs = std::filesystem;
  std::vector<fs::path> folders;
  std::error_code status;
  const fs::path self = fs::read_symlink("/proc/self/exe", status);
  if (!status)
    folders = {self.parent_path(), self.parent_path().parent_path() / "libexec" / "kincal"};
  const char* path = std::getenv("PATH");
  std::istringstream search(path ? path : "");
  for (std::string folder; std::getline(search, folder, ':');) folders.emplace_back(folder);
  for (const fs::path& folder : folders)
    if (access((folder / name).c_str(), X_OK) == 0) return (folder / name).string();
  throw InputError(what + " is the program " + name +
                   ", which is neither beside kincal nor in the PATH. It is built " + built);
}

void become(const std::string& path, std::vector<std::string> arguments) {
  std::vector<char*> words;
  for (std::string& argument : arguments) words.push_back(argument.data());
  words.push_back(nullptr);
  execv(path.c_str(), words.data());
  throw InputError(path + ": cannot be run: " + std::strerror(errno));
}

}  // namespace kincal
