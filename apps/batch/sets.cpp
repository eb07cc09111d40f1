#include "sets.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <sstream>

#include "../../io/document/document.h"
#include "../../io/document/files.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

void check_name(const std::string& name, const std::string& where) {
  if (name.empty() || name == "." || name == ".." || name.find('/') != std::string::npos)
    throw InputError(where + ": '" + name + "' cannot be the name of a folder");
  if (name == ".batch" || name == "summary.csv" || name == "summary.json" || name == "report.html")
    throw InputError(where + ": a set cannot be named '" + name + "': this is a file of the batch");
}

/// The words of a line: between tabs if there are any, else between spaces; in double quotes as
/// they are. # begins a comment.
std::vector<std::string> words_of(const std::string& line, const std::string& where) {
  const bool tabs = line.find('\t') != std::string::npos;
  const auto separates = [&](char c) { return tabs ? c == '\t' : c == ' '; };
  std::vector<std::string> words;
  for (size_t i = 0; i < line.size();) {
    if (separates(line[i]) || line[i] == ' ') {
      ++i;
    } else if (line[i] == '#') {
      break;
    } else if (line[i] == '"') {
      const size_t end = line.find('"', i + 1);
      if (end == std::string::npos) throw InputError(where + ": a quote is never closed");
      words.push_back(line.substr(i + 1, end - i - 1));
      i = end + 1;
      if (i < line.size() && line[i] != ' ' && line[i] != '\t')
        throw InputError(where + ": a space or tab is expected after a closing quote");
    } else {
      const size_t begin = i;
      while (i < line.size() && !separates(line[i])) ++i;
      size_t end = i;
      while (line[end - 1] == ' ') --end;
      words.push_back(line.substr(begin, end - begin));
    }
  }
  return words;
}

}  // namespace

std::string plural(size_t n, const std::string& what) {
  return std::to_string(n) + " " + what + (n == 1 ? "" : "s");
}

Sets sets_of_folder(const std::string& directory, const std::string& out) {
  Sets sets;
  std::error_code error, ignored;
  fs::directory_iterator entries(directory, error);
  if (error) throw InputError(directory + ": cannot be read: " + error.message());
  for (const fs::directory_entry& entry : entries) {
    if (!entry.is_directory(ignored) || fs::equivalent(entry.path(), out, ignored)) continue;
    const std::string name = entry.path().filename().string();
    const fs::path rig = entry.path() / "rig.yaml", samples = entry.path() / "samples.jsonl";
    const bool has_rig = fs::exists(rig, ignored), has_samples = fs::exists(samples, ignored);
    if (!has_rig && !has_samples) {
      ++sets.ignored;
      continue;
    }
    check_name(name, entry.path().string());
    std::string wrong;
    if (!has_rig) wrong = entry.path().string() + ": has a samples.jsonl but no rig.yaml";
    if (!has_samples) wrong = entry.path().string() + ": has a rig.yaml but no samples.jsonl";
    sets.all.push_back({name, rig.string(), samples.string(), wrong});
  }
  std::sort(sets.all.begin(), sets.all.end(),
            [](const Set& a, const Set& b) { return a.name < b.name; });
  if (sets.all.empty()) {
    const bool is_set = fs::exists(fs::path(directory) / "samples.jsonl", ignored);
    throw InputError(directory + ": no folder in it has a rig.yaml and a samples.jsonl" +
                     (is_set ? "; it is a set itself: `kincal calibrate` takes a single one"
                      : sets.ignored > 0 ? " (" + plural(sets.ignored, "folder") + " with neither)"
                                         : ""));
  }
  return sets;
}

Sets sets_of_list(const std::string& path) {
  Sets sets;
  const fs::path folder = fs::path(path).parent_path();
  std::map<std::string, int> lines;
  std::istringstream text(read_file(path));
  std::string line;
  for (int n = 1; std::getline(text, line); ++n) {
    const std::string where = path + ":" + std::to_string(n);
    if (n == 1 && line.compare(0, 3, "\xEF\xBB\xBF") == 0) line.erase(0, 3);  // of Windows
    if (!line.empty() && line.back() == '\r') line.pop_back();
    const std::vector<std::string> words = words_of(line, where);
    if (words.empty()) continue;
    if (words.size() < 2 || words.size() > 3)
      throw InputError(where +
                       ": RIG SAMPLES or RIG SAMPLES NAME is expected (paths with spaces in double "
                       "quotes, or tabs between them), not " +
                       plural(words.size(), "word"));
    const fs::path samples = folder / words[1];
    std::string name = samples.stem().string();
    if (words.size() == 3)
      name = words[2];
    else if (samples.filename() == "samples.jsonl")
      name = fs::absolute(samples).lexically_normal().parent_path().filename().string();
    check_name(name, where);
    const auto inserted = lines.emplace(name, n);
    if (!inserted.second)
      throw InputError(where + ": the set is named '" + name + "' like that of line " +
                       std::to_string(inserted.first->second) +
                       "; a third word on the line is its name");
    sets.all.push_back({name, (folder / words[0]).string(), samples.string(), ""});
  }
  if (sets.all.empty()) throw InputError(path + ": lists no sets; each line is RIG SAMPLES");
  return sets;
}

}  // namespace kincal
