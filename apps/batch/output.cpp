#include "output.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <set>

#include "../../io/document/files.h"
#include "../../io/document/json.h"
#include "../job.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

/// Results that a batch which was killed had moved away to replace them, where names cannot be
/// exchanged: they are put back.
void put_back(const fs::path& folder) {
  std::error_code ignored;
  std::vector<fs::path> moved;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    const size_t end = name.rfind(".replaced-");
    if (end != std::string::npos) moved.push_back(folder / name.substr(0, end));
  }
  for (const fs::path& path : moved) say_cleared(clear_leftovers(path.string()));
}

/// Locks a scratch folder for as long as this process or one of its children lives. False: it is
/// locked.
bool lock_folder(const fs::path& scratch) {
  const int lock = open((scratch / "lock").c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666);
  if (lock < 0)
    throw InputError((scratch / "lock").string() + ": cannot be made: " + std::strerror(errno));
  // Children of a batch that was just killed hold the lock for a moment. (A file system without
  // locks goes without.)
  for (int tries = 0; flock(lock, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK; ++tries) {
    if (tries == 50) return false;
    usleep(100000);
  }
  return true;
}

}  // namespace

void Output::clean() const {
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(scratch, ignored))
    if (entry.path().filename() != "lock" && entry.path().filename() != "slurm")
      fs::remove_all(entry.path(), ignored);
}

void Output::tidy() const {
  clean();
  put_back(folder);
}

Output open_output(const std::string& out) {
  const Output output{out, fs::path(out) / ".batch"};
  std::error_code error, ignored;
  if (fs::exists(output.folder, ignored) && !fs::is_directory(output.scratch, ignored)) {
    if (!fs::is_directory(output.folder, ignored)) throw InputError(out + ": is not a directory");
    if (!fs::is_empty(output.folder, ignored))
      throw InputError(out + ": exists already and is not of a batch: choose another --out");
  }
  for (const fs::path& path : {output.folder, output.scratch}) {
    fs::create_directory(path, error);
    if (error) throw InputError(path.string() + ": cannot be made: " + error.message());
  }
  if (!lock_folder(output.scratch)) throw InputError(out + ": another batch is writing here");
  return output;
}

Output open_scratch(const std::string& out, const fs::path& scratch) {
  const Output output{out, scratch};
  std::error_code error;
  fs::create_directory(scratch, error);
  if (error) throw InputError(scratch.string() + ": cannot be made: " + error.message());
  if (!lock_folder(scratch)) throw InputError(scratch.string() + ": another process writes here");
  output.clean();
  return output;
}

std::optional<SetSummary> find_done(const Set& set, const Output& output,
                                    const std::string& options, std::string& why) {
  std::error_code ignored;
  const fs::path folder = output.result(set.name);
  if (!fs::exists(folder / "batch.json", ignored)) return std::nullopt;
  const std::optional<BatchRecord> record = read_record((folder / "batch.json").string());
  if (!record || !fs::exists(folder / "result.json", ignored)) {
    why = "result damaged";
    return std::nullopt;
  }
  const auto same = [](const std::string& path, const std::string& hash) {
    try {
      return sha256(read_file(path)) == hash;
    } catch (const InputError&) {
      return false;  // the calibration will say what is wrong
    }
  };
  const std::string rig = rig_path(set.rig);
  if (record->version != KINCAL_VERSION)
    why = "version of kincal changed";
  else if (record->options != options)
    why = "options changed";
  else if (!same(rig, record->rig))
    why = "rig changed";
  else if (!record->robot.empty() &&  // a robot that is known by its flange is in the rig
           !same((fs::path(rig).parent_path() / record->robot).string(), record->urdf))
    why = "robot changed";
  else if (!same(set.samples, record->samples))
    why = "samples changed";
  if (!why.empty()) return std::nullopt;
  SetSummary summary = record->set;
  summary.name = set.name;
  return summary;
}

std::vector<std::string> results_without_set(const std::vector<Set>& sets, const Output& output) {
  std::set<std::string> names;
  for (const Set& set : sets) names.insert(set.name);
  std::vector<std::string> out;
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(output.folder, ignored)) {
    const std::string name = entry.path().filename().string();
    if (!names.count(name) && fs::exists(entry.path() / "batch.json", ignored)) out.push_back(name);
  }
  std::sort(out.begin(), out.end());
  return out;
}

SetSummary failed(const Set& set, int code, const std::string& error) {
  SetSummary summary;
  summary.name = set.name;
  summary.status = "failed";
  summary.exit_code = code;
  summary.error = error;
  if (!is_utf8(error))  // the bytes of a file: they would make a table that nobody opens
    for (char& c : summary.error)
      if (static_cast<unsigned char>(c) >= 0x80) c = '?';
  return summary;
}

}  // namespace kincal
