#include "shares.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "../../io/document/files.h"
#include "output.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

/// A list of texts in a file: names and paths may hold anything but a zero.
std::vector<std::string> read_texts(const fs::path& path) {
  std::vector<std::string> texts;
  std::istringstream file(read_file(path.string()));
  for (std::string text; std::getline(file, text, '\0');) texts.push_back(text);
  return texts;
}

void write_texts(const fs::path& path, const std::vector<std::string>& texts) {
  std::string all;
  for (const std::string& text : texts) all += text + '\0';
  write_file(path.string(), all, true);
}

/// In one piece, whatever other nodes do.
void append(const fs::path& path, const std::string& line) {
  const int file = open(path.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
  const bool written =
      file >= 0 && write(file, line.data(), line.size()) == static_cast<ssize_t>(line.size());
  if (file < 0 || close(file) != 0 || !written)
    throw InputError(path.string() + ": cannot be written");
}

/// A line of K.done about a set: `SET result SHA256` or `SET failed CODE SECONDS ERROR`.
struct Note {
  size_t set = 0;
  std::string kind, sha, error;
  int code = 0;
  double seconds = 0;
};

std::optional<Note> note_of(const std::string& line, size_t sets) {
  Note note;
  std::istringstream words(line);
  if (!(words >> note.set >> note.kind) || note.set >= sets) return std::nullopt;
  if (note.kind == "result") words >> note.sha;
  if (note.kind == "failed") words >> note.code >> note.seconds >> std::ws;
  if (note.kind == "failed") std::getline(words, note.error);
  if (note.sha.size() != 64 && note.error.empty()) return std::nullopt;
  return note;
}

}  // namespace

std::optional<SlurmJob> read_slurm_job(const fs::path& folder) {
  if (!file_exists((folder / "job").string())) return std::nullopt;
  const std::vector<std::string> texts = read_texts(folder / "job");
  SlurmJob job;
  if (texts.size() != 4) return job;
  job.token = texts[0], job.options = texts[1], job.command = texts[2];
  job.tasks = std::stoul(texts[3]);
  const std::string id = (folder / "id").string();
  if (file_exists(id)) job.id = read_file(id);
  return job;
}

void write_job(const JobFolder& folder, const SlurmJob& job, const std::vector<Set>& sets) {
  remove_job(folder.path);
  std::error_code error;
  fs::create_directories(folder.path / folder.token, error);
  if (error) throw InputError(folder.path.string() + ": cannot be made: " + error.message());
  std::vector<std::vector<std::string>> shares(job.tasks);
  for (size_t i = 0; i < sets.size(); ++i)
    for (const std::string& text : {sets[i].name, sets[i].rig, sets[i].samples})
      shares[i % job.tasks].push_back(text);
  for (size_t task = 0; task < job.tasks; ++task) {
    write_texts(folder.file(task, ".sets"), shares[task]);
    append(folder.file(task, ".done"), "");  // there before anybody looks for it
  }
  write_texts(folder.path / "job",
              {job.token, job.options, job.command, std::to_string(job.tasks)});
}

void write_id(const JobFolder& folder, const std::string& id) {
  write_file((folder.path / "id").string(), id, true);
}

void remove_job(const fs::path& folder) {
  std::error_code ignored;
  fs::remove(folder / "job", ignored);  // what makes it one goes first
  for (int tries = 0; tries < 20 && fs::exists(folder, ignored); ++tries) {
    if (tries > 0) usleep(50000);  // a task that has done its share was removing its own files
    fs::remove_all(folder, ignored);
  }
}

std::vector<Set> read_share(const JobFolder& folder, size_t task) {
  std::vector<Set> sets;
  const std::vector<std::string> texts = read_texts(folder.file(task, ".sets"));
  for (size_t i = 0; i + 2 < texts.size(); i += 3)
    sets.push_back({texts[i], texts[i + 1], texts[i + 2], ""});
  return sets;
}

void note_start(const JobFolder& folder, size_t task) {
  char node[256] = "";
  gethostname(node, sizeof node - 1);
  // A task that was killed may have left a line without an end.
  append(folder.file(task, ".done"), "\nstart " + std::string(node) + "\n");
}

void note_end(const JobFolder& folder, size_t task, size_t set, const SetSummary& summary,
              const fs::path& result) {
  std::ostringstream line;
  line << set;
  if (summary.status == "failed")
    line << " failed " << summary.exit_code << " " << summary.seconds << " " << summary.error;
  else
    line << " result " << sha256(read_file((result / "batch.json").string()));
  append(folder.file(task, ".done"), line.str() + "\n");
}

std::vector<bool> sets_noted(const JobFolder& folder, size_t task, size_t sets) {
  std::vector<bool> known(sets);
  std::istringstream lines(read_file(folder.file(task, ".done").string()));
  for (std::string line; std::getline(lines, line);)
    if (const std::optional<Note> note = note_of(line, sets)) known[note->set] = true;
  return known;
}

JournalReader::JournalReader(const JobFolder& folder, size_t task, const fs::path& out)
    : path_(folder.file(task, ".done")),
      out_(out),
      sets_(read_share(folder, task)),
      seen_(sets_.size()) {}

bool JournalReader::read_line(const std::string& line,
                              const std::function<void(const Set&, SetSummary)>& ended) {
  if (line.rfind("start ", 0) == 0) started_ = true;
  const std::optional<Note> note = note_of(line, sets_.size());
  if (!note || seen_[note->set]) return true;
  const Set& set = sets_[note->set];
  SetSummary summary = failed(set, note->code, note->error);
  summary.seconds = note->seconds;
  if (note->kind == "result") {
    const std::string path = (out_ / set.name / "batch.json").string();
    try {
      if (sha256(read_file(path)) != note->sha) return false;
    } catch (const InputError&) {
      return false;
    }
    const std::optional<BatchRecord> record = read_record(path);
    if (!record) return false;
    summary = record->set;
    summary.name = set.name;
  }
  seen_[note->set] = true;
  ++known_;
  ended(set, std::move(summary));
  return true;
}

bool JournalReader::read(const std::function<void(const Set&, SetSummary)>& ended) {
  std::ifstream file(path_, std::ios::binary);  // anew: only then a network shows what is new
  file.seekg(static_cast<std::streamoff>(at_));
  for (std::string line; std::getline(file, line) && !file.eof();) {
    if (!read_line(line, ended)) return false;
    at_ += line.size() + 1;
  }
  return true;
}

}  // namespace kincal
