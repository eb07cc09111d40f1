#include "files.h"

#include <fcntl.h>
#include <nettle/sha2.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <system_error>

#include "error.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kOwnFiles = {
    "robot.urdf",        "rig.yaml",       "result.json",      "changes.yaml",    "covariance.csv",
    "information.csv",   "samples.csv",    "residuals.csv",    "loops.csv",       "batch.json",
    "report.html",       "samples.jsonl",  "truth.json",       "intrinsics.json", "coverage.svg",
    "joints.csv",        "fleet.json",     "robots.csv",       "family.csv",      "drift.csv",
    "robot_unbent.urdf", "rig_rigid.yaml", "certificate.html", "certificate.json"};
const char kWriting[] = ".writing-", kReplaced[] = ".replaced-";  // before a process id

/// The output that a path means: without slashes at its end, which would make a name its own
/// parent, and what a symbolic link leads to in place of the link.
std::string output_name(const std::string& path) {
  std::string name = fs::path(path).lexically_normal().string();
  while (name.size() > 1 && name.back() == '/') name.pop_back();
  std::error_code error;
  if (!fs::is_symlink(fs::symlink_status(name, error))) return name;
  const fs::path real = fs::canonical(name, error);
  if (error) throw InputError(path + ": is a symbolic link to nothing: choose another --out");
  return real.string();
}

fs::path folder_of(const std::string& name) {
  std::error_code ignored;
  return fs::absolute(name, ignored).lexically_normal().parent_path();
}

/// What can be known before hours of work: that there can be such a file or folder.
void check_folder(const std::string& path, const std::string& name) {
  const fs::path folder = folder_of(name);
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored))
    throw InputError(path + ": the folder " + folder.string() + " does not exist");
  if (access(folder.c_str(), W_OK | X_OK) != 0)
    throw InputError(path + ": cannot be written: " + folder.string() + ": " +
                     std::strerror(errno));
}

InputError exists_already(const std::string& path) {
  return InputError(path + ": exists already; --force replaces it, another --out keeps it");
}

InputError not_written(const std::string& path, const std::string& what = "written") {
  return InputError(path + ": cannot be " + what + ": " + std::strerror(errno));
}

/// A file descriptor, closed at the end of its scope.
struct Descriptor {
  explicit Descriptor(int fd) : number(fd) {}
  ~Descriptor() {
    if (number >= 0) close(number);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  const int number;
};

/// Makes a file. Nothing that is there already is written to, nor is a link followed.
int open_new(const std::string& path) {
  return open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
}

int open_folder(const std::string& path) {
  return open(path.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
}

void write_all(int file, std::string_view text, const std::string& path) {
  for (size_t at = 0; at < text.size();) {
    const ssize_t written = write(file, text.data() + at, text.size() - at);
    if (written < 0 && errno != EINTR) throw not_written(path);
    at += std::max<ssize_t>(written, 0);
  }
}

/// Waits until a file or folder is on the disk: a rename must not get there before it.
void sync_to_disk(int file, const std::string& path) {
  if (fsync(file) != 0 && errno != EINVAL && errno != ENOTSUP && errno != EROFS)
    throw not_written(path);
}

/// A name is known to be on the disk when its folder is. Whatever goes wrong here, it is written.
void sync_names(const std::string& name) {
  const Descriptor folder(open_folder(folder_of(name).string()));
  if (folder.number >= 0) fsync(folder.number);
}

/// Whether `path` still is what was opened.
bool is_open(const std::string& path, int file) {
  struct stat one, other;
  return fstat(file, &one) == 0 && lstat(path.c_str(), &other) == 0 && one.st_ino == other.st_ino &&
         one.st_dev == other.st_dev;
}

/// Makes something under a name of its own beside an output and locks it (where there are locks),
/// which tells it from what a run that was killed has left. `open_it` returns a descriptor or -1.
int make_work(const std::string& beside, std::string& work,
              const std::function<int(const std::string&)>& open_it) {
  for (int n = 0;; ++n) {
    work = beside + kWriting + std::to_string(getpid()) + (n ? "." + std::to_string(n) : "");
    const int file = open_it(work);
    if (file < 0 && errno != EEXIST && errno != ENOENT) throw not_written(work, "made");
    if (file < 0 && n == 100) throw not_written(work, "made");
    if (file < 0) continue;
    flock(file, LOCK_EX);
    if (is_open(work, file)) return file;
    close(file);  // a run that clears away was faster
  }
}

/// Removes a folder of kincal's files, but no file of anybody else.
void remove_result(const std::string& folder) {
  for (const std::string& file : kOwnFiles) unlink((folder + "/" + file).c_str());
  rmdir(folder.c_str());
}

bool holds_only_results(const std::string& folder, std::string* other = nullptr,
                        const std::string& keep = "") {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (std::count(kOwnFiles.begin(), kOwnFiles.end(), name) > 0) continue;
    if (!keep.empty() && name == keep && entry.is_directory(error)) continue;
    if (other) *other = name;
    return false;
  }
  return true;
}

enum class Rename : unsigned { no_replace = 1, exchange = 2 };  // as renameat2() has them

/// False with errno; ENOSYS or EINVAL: the system or its file system does not know how.
bool rename_as(Rename how, const std::string& from, const std::string& to) {
#ifdef __linux__
  return renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), static_cast<unsigned>(how)) == 0;
#else
  static_cast<void>(how), static_cast<void>(from), static_cast<void>(to);
  errno = ENOSYS;
  return false;
#endif
}

bool unknown_to_system() { return errno == ENOSYS || errno == EINVAL || errno == ENOTSUP; }

/// Gives a finished folder its name in one moment. With `force` what has that name is exchanged
/// with it, and then removed; without, nothing is replaced. False with errno.
bool place_folder(const std::string& work, const std::string& name, bool force) {
  if (rename_as(Rename::no_replace, work, name)) return true;
  if (errno == EEXIST && force && rename_as(Rename::exchange, work, name)) {
    remove_result(work);
    return true;
  }
  if (!unknown_to_system()) return false;
  // A plain rename replaces no folder that holds anything.
  if (rename(work.c_str(), name.c_str()) == 0) return true;
  if (!force || (errno != EEXIST && errno != ENOTEMPTY)) return false;
  const std::string old = name + kReplaced + std::to_string(getpid());
  if (rename(name.c_str(), old.c_str()) != 0) return false;
  if (rename(work.c_str(), name.c_str()) != 0) {
    const int why = errno;
    rename(old.c_str(), name.c_str());
    errno = why;
    return false;
  }
  remove_result(old);
  return true;
}

bool place_file(const std::string& work, const std::string& name, bool force) {
  if (force) return rename(work.c_str(), name.c_str()) == 0;
  if (rename_as(Rename::no_replace, work, name)) return true;
  if (!unknown_to_system() || link(work.c_str(), name.c_str()) != 0) return false;
  unlink(work.c_str());
  return true;
}

/// Clears away what a run that was killed has left at `path`; "" if it is in use or not kincal's.
std::string clear_one(const std::string& path, const std::string& name, bool replaced) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(path, error);
  const bool folder = fs::is_directory(status);
  if ((!folder && !fs::is_regular_file(status)) || (folder && !holds_only_results(path))) return "";
  const Descriptor file(folder ? open_folder(path)
                               : open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC));
  if (file.number < 0 || flock(file.number, LOCK_EX | LOCK_NB) != 0 || !is_open(path, file.number))
    return "";
  if (replaced && !fs::exists(name, error) && rename(path.c_str(), name.c_str()) == 0)
    return name + ": a run that was killed while replacing it had moved it to " + path +
           ": it is back";
  folder ? remove_result(path) : static_cast<void>(unlink(path.c_str()));
  return fs::exists(path, error) ? "" : path + ": left by a run that was killed: removed";
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
  constexpr size_t kPart = 1 << 16;
  const auto size = std::filesystem::file_size(path, ignored);  // of a pipe: none
  std::string text;
  size_t filled = 0;
  do {  // not by <<, which would take an end of the memory for the end of the file
    text.resize(filled + (filled == 0 && !ignored && size > 0 ? size + 1 : kPart));
    file.read(&text[filled], static_cast<std::streamsize>(text.size() - filled));
    filled += static_cast<size_t>(file.gcount());
  } while (file);
  text.resize(filled);
  if (file.bad())
    throw InputError(path + ": cannot be read: " + std::generic_category().message(EIO));
  return text;
}

bool file_exists(const std::string& path) {
  std::error_code ignored;
  return fs::exists(path, ignored) && !fs::is_directory(path, ignored);
}

std::vector<std::string> clear_leftovers(const std::string& path) {
  std::vector<std::string> said;
  const std::string name = output_name(path), own = fs::path(name).filename().string();
  std::error_code error;
  std::vector<std::string> found;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_of(name), error))
    found.push_back(entry.path().filename().string());
  std::sort(found.begin(), found.end());
  for (const char* kind : {kReplaced, kWriting})
    for (const std::string& file : found) {
      const std::string begin = own + kind;
      if (file.rfind(begin, 0) != 0 || file.size() == begin.size() ||
          file.find_first_not_of("0123456789.", begin.size()) != std::string::npos)
        continue;
      const std::string note =
          clear_one((fs::path(name).parent_path() / file).string(), name, kind == kReplaced);
      if (!note.empty()) said.push_back(note);
    }
  return said;
}

void check_output(const std::string& directory, bool force, const std::string& keep) {
  std::error_code error;
  const std::string name = output_name(directory);
  check_folder(directory, name);
  if (!fs::exists(name, error)) return;
  if (!force)
    throw InputError(directory +
                     ": exists already; --force replaces it, another --out leaves it as it is");
  if (!fs::is_directory(name, error)) throw InputError(directory + ": is not a directory");
  std::string other;
  if (!holds_only_results(name, &other, keep))
    throw InputError(directory + ": holds " + other +
                     ", which is not a file of kincal and would be deleted: move it away or choose "
                     "another --out");
}

void check_output_file(const std::string& path, bool force) {
  std::error_code error;
  const std::string name = output_name(path);
  check_folder(path, name);
  const fs::file_status status = fs::symlink_status(name, error);
  if (!fs::exists(status)) return;
  if (!fs::is_regular_file(status)) throw InputError(path + ": is there and is not a file");
  if (!force) throw exists_already(path);
}

bool write_directory(const std::string& directory,
                     const std::vector<std::pair<std::string, std::string>>& files, bool force,
                     bool (*go_on)(), const std::string& scratch, const std::string& keep) {
  check_output(directory, force, keep);
  const std::string name = output_name(directory);
  // Behind a link there may be another file system.
  const bool beside = scratch.empty() || fs::is_symlink(fs::symlink_status(directory));
  std::string work;
  const Descriptor folder(
      make_work(beside ? name : (fs::path(scratch) / fs::path(name).filename()).string(), work,
                [](const std::string& path) {
                  return mkdir(path.c_str(), 0777) == 0 ? open_folder(path) : -1;
                }));
  try {
    std::vector<std::unique_ptr<Descriptor>> written;
    for (const auto& [file, text] : files) {
      const std::string shown = directory + "/" + file;  // (what is being written has other names)
      written.push_back(std::make_unique<Descriptor>(open_new(work + "/" + file)));
      if (written.back()->number < 0) throw not_written(shown);
      write_all(written.back()->number, text, shown);
    }
    for (size_t i = 0; i < files.size(); ++i)  // all together: one is waited for
      sync_to_disk(written[i]->number, directory + "/" + files[i].first);
    sync_to_disk(folder.number, directory);
    if (go_on && !go_on()) {
      remove_result(work);
      return false;
    }
    const std::string kept = name + "/" + keep, there = work + "/" + keep;
    const bool keeps = !keep.empty() && fs::exists(kept);
    if (keeps && rename(kept.c_str(), there.c_str()) != 0) throw not_written(kept, "kept");
    const bool placed = place_folder(work, name, force);
    if (const int why = errno; keeps && !placed) {
      rename(there.c_str(), kept.c_str());
      errno = why;
    }
    if (!placed)
      throw errno == EEXIST || errno == ENOTEMPTY || errno == ENOTDIR ? exists_already(directory)
                                                                      : not_written(directory);
  } catch (...) {
    remove_result(work);
    throw;
  }
  sync_names(name);
  return true;
}

bool write_file(const std::string& path, const std::string& text, bool force, bool (*go_on)()) {
  return write_file_in_pieces(
      path, [&](const PutBytes& put) { put(0, text); }, force, go_on);
}

bool write_file_in_pieces(const std::string& path, const std::function<void(const PutBytes&)>& fill,
                          bool force, bool (*go_on)()) {
  check_output_file(path, force);
  const std::string name = output_name(path);
  std::string work;
  const Descriptor file(make_work(name, work, open_new));
  try {
    fill([&](std::uint64_t at, std::string_view bytes) {
      if (lseek(file.number, static_cast<off_t>(at), SEEK_SET) < 0) throw not_written(path);
      write_all(file.number, bytes, path);
    });
    sync_to_disk(file.number, path);
    if (go_on && !go_on()) {
      unlink(work.c_str());
      return false;
    }
    if (!place_file(work, name, force))
      throw errno == EEXIST ? exists_already(path) : not_written(path);
  } catch (...) {
    unlink(work.c_str());
    throw;
  }
  sync_names(name);
  return true;
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
