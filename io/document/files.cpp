#include "files.h"

#include <nettle/sha2.h>
#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "error.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

/// Without slashes at the end, which would make a name its own parent.
std::string plain_name(const std::string& directory) {
  std::string name = fs::path(directory).lexically_normal().string();
  while (name.size() > 1 && name.back() == '/') name.pop_back();
  return name;
}

void write_whole(const fs::path& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file.write(text.data(), static_cast<std::streamsize>(text.size()));
  file.close();
  if (!file) throw InputError(path.string() + ": cannot be written: " + std::strerror(errno));
}

}  // namespace

std::string read_file(const std::string& path) {
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  std::error_code ignored;
  if (file && std::filesystem::is_directory(path, ignored))
    throw InputError(path + ": cannot be read: is a directory");
  if (!file)
    throw InputError(path +
                     ": cannot be read: " + std::generic_category().message(errno ? errno : EIO));
  std::string text, part(1 << 16, 0);
  do {  // not by <<, which would take an end of the memory for the end of the file
    file.read(part.data(), static_cast<std::streamsize>(part.size()));
    text.append(part, 0, static_cast<size_t>(file.gcount()));
  } while (file);
  if (file.bad())
    throw InputError(path + ": cannot be read: " + std::generic_category().message(EIO));
  return text;
}

void check_output(const std::string& directory, bool force) {
  static const std::vector<std::string> own_files = {
      "robot.urdf",    "rig.yaml",   "result.json", "changes.yaml",  "covariance.csv",
      "residuals.csv", "batch.json", "report.html", "samples.jsonl", "truth.json"};
  std::error_code error;
  const fs::path path(plain_name(directory));
  if (!fs::exists(path, error)) {
    const fs::path parent = fs::absolute(path, error).lexically_normal().parent_path();
    if (!parent.empty() && !fs::is_directory(parent, error))
      throw InputError(directory + ": the folder " + parent.string() + " does not exist");
    return;
  }
  if (!force)
    throw InputError(directory +
                     ": exists already; --force replaces a result, another --out keeps it");
  if (!fs::is_directory(path, error)) throw InputError(directory + ": is not a directory");
  for (const fs::directory_entry& entry : fs::directory_iterator(path, error))
    if (std::find(own_files.begin(), own_files.end(), entry.path().filename().string()) ==
        own_files.end())
      throw InputError(directory + ": --force would delete " + entry.path().filename().string() +
                       ", which is no file of kincal's: move it away or choose another --out");
}

bool write_directory(const std::string& directory,
                     const std::vector<std::pair<std::string, std::string>>& files, bool force,
                     bool (*go_on)(), const std::string& scratch) {
  const std::string name = plain_name(directory), pid = std::to_string(getpid());
  const std::string beside =
      scratch.empty() ? name : (fs::path(scratch) / fs::path(name).filename()).string();
  const fs::path target(name), work(beside + ".writing-" + pid), old(beside + ".replaced-" + pid);
  std::error_code error, ignored;
  try {
    check_output(name, force);
    fs::remove_all(work, ignored);
    if (!fs::create_directory(work, error))
      throw InputError(work.string() + ": cannot be made: " + error.message());
    for (const auto& f : files) write_whole(work / f.first, f.second);
    if (go_on && !go_on()) {
      fs::remove_all(work, ignored);
      return false;
    }
    const bool replace = fs::exists(target, ignored);
    if (replace) {
      fs::rename(target, old, error);
      if (error) throw InputError(name + ": cannot be replaced: " + error.message());
    }
    fs::rename(work, target, error);
    if (error) {
      if (replace) fs::rename(old, target, ignored);
      throw InputError(name + ": cannot be written: " + error.message());
    }
    fs::remove_all(old, ignored);
  } catch (...) {
    fs::remove_all(work, ignored);
    throw;
  }
  return true;
}

void write_file(const std::string& path, const std::string& text) {
  const fs::path work(path + ".writing-" + std::to_string(getpid()));
  std::error_code error, ignored;
  try {
    write_whole(work, text);
  } catch (...) {
    fs::remove(work, ignored);
    throw;
  }
  fs::rename(work, path, error);
  if (error) {
    fs::remove(work, ignored);
    throw InputError(path + ": cannot be written: " + error.message());
  }
}

std::string sha256(const std::string& text) {
  sha256_ctx context;
  uint8_t digest[SHA256_DIGEST_SIZE];
  sha256_init(&context);
  sha256_update(&context, text.size(), reinterpret_cast<const uint8_t*>(text.data()));
  sha256_digest(&context, sizeof digest, digest);
  std::string hex;
  for (const uint8_t byte : digest)
    hex += {"0123456789abcdef"[byte >> 4], "0123456789abcdef"[byte & 15]};
  return hex;
}

}  // namespace kincal
