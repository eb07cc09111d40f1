#include "slurm.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <sstream>

#include "../../io/document/error.h"

namespace kincal {
namespace {

/// What a command of Slurm's said. code: its exit code, or -1: it was ended, the time was over.
struct Said {
  int code = -1;
  std::string out, error;

  /// What is wrong, in one line.
  std::string words() const {
    std::string text;
    std::istringstream lines(error.empty() ? out : error);
    for (std::string line; std::getline(lines, line);)
      if (!line.empty()) text += (text.empty() ? "" : "; ") + line;
    return text.empty() ? (code < 0 ? "no answer" : "exit code " + std::to_string(code)) : text;
  }
};

/// Runs a command and waits at most so many seconds for its end. Ctrl-C ends it too, unless it is
/// one that must not be ended half way.
Said call(const std::vector<std::string>& command, int seconds, bool to_its_end = false) {
  Said said;
  int out[2], error[2];
  if (pipe2(out, O_CLOEXEC) != 0) return said;
  if (pipe2(error, O_CLOEXEC) != 0) return close(out[0]), close(out[1]), said;
  std::vector<char*> words;
  for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    if (to_its_end) setpgid(0, 0);
    sigset_t none;
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, nullptr);
    const int nothing = open("/dev/null", O_RDONLY);
    dup2(nothing, STDIN_FILENO);
    dup2(out[1], STDOUT_FILENO);
    dup2(error[1], STDERR_FILENO);
    execvp(words[0], words.data());
    _exit(127);
  }
  close(out[1]), close(error[1]);
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(seconds);
  pollfd pipes[] = {{out[0], POLLIN, 0}, {error[0], POLLIN, 0}};
  std::string* const texts[] = {&said.out, &said.error};
  bool ended = child < 0;
  for (int open_ones = 2; open_ones > 0 && !ended;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        end - std::chrono::steady_clock::now());
    const int ready = poll(pipes, 2, static_cast<int>(std::max<long>(left.count(), 0)));
    if (ready == 0 || (ready < 0 && errno != EINTR)) ended = true;
    for (int i = 0; i < 2 && ready > 0; ++i) {
      if (pipes[i].revents == 0) continue;
      char part[4096];
      const ssize_t size = read(pipes[i].fd, part, sizeof part);
      if (size > 0) texts[i]->append(part, static_cast<size_t>(size));
      if (size <= 0) pipes[i].fd = -1, --open_ones;
    }
  }
  close(out[0]), close(error[0]);
  if (child < 0) return said;
  int status = 0;
  if (ended) kill(child, SIGTERM);
  for (int tries = 0; ended && tries < 20 && waitpid(child, &status, WNOHANG) == 0; ++tries) {
    if (tries == 19) kill(child, SIGKILL);
    usleep(100000);
  }
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
  if (WIFEXITED(status) && !ended) said.code = WEXITSTATUS(status);
  return said;
}

bool in_path(const std::string& program) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (access((folder + "/" + program).c_str(), X_OK) == 0) return true;
  return false;
}

/// "NAME=value" in a line of scontrol's.
std::string field(const std::string& line, const std::string& name) {
  const size_t begin = (" " + line).find(" " + name + "=");
  if (begin == std::string::npos) return "";
  const size_t value = begin + name.size() + 1;
  return line.substr(value, line.find(' ', value) - value);
}

}  // namespace

void check_slurm(const SlurmOptions& options) {
  for (const char* program : {"sbatch", "squeue", "scancel"})
    if (!in_path(program))
      throw InputError(std::string("--slurm: ") + program +
                       " is not in PATH: run this where the cluster takes jobs (a login node)");
  words_for_sbatch(options);
}

std::vector<std::string> words_for_sbatch(const SlurmOptions& options) {
  std::vector<std::string> words;
  bool in_word = false;
  char quote = 0;
  for (const char c : options.sbatch) {
    if (quote && c == quote) {
      quote = 0;
    } else if (!quote && std::strchr(" \t\n", c)) {
      in_word = false;
    } else {
      if (!in_word) words.emplace_back();
      in_word = true;
      if (!quote && (c == '"' || c == '\''))
        quote = c;
      else
        words.back() += c;
    }
  }
  if (quote) throw InputError("--sbatch: a quote is never closed: " + options.sbatch);
  if (!options.partition.empty()) words.push_back("--partition=" + options.partition);
  return words;
}

std::string submit(const Array& a) {
  std::vector<std::string> command = {"sbatch", "--job-name=kincal",
                                      "--cpus-per-task=" + std::to_string(a.cpus)};
  command.insert(command.end(), a.options.begin(), a.options.end());
  for (const std::string& option :
       {std::string("--parsable"), "--array=0-" + std::to_string(a.tasks - 1),
        "--output=" + a.output, std::string("--open-mode=append"),
        "--chdir=" + std::filesystem::current_path().string(), a.script})
    command.push_back(option);
  const Said said = call(command, 300, true);
  const std::string id = said.out.substr(0, said.out.find_first_of(";\n"));
  if (said.code == 0 && !id.empty() && id.find_first_not_of("0123456789") == std::string::npos)
    return id;
  throw InputError("--slurm: no job was submitted: " + said.words());
}

std::string seen_by_a_node(const std::string& path, const std::vector<std::string>& options) {
  std::vector<std::string> command = {"srun", "--immediate=3", "--ntasks=1"};
  command.insert(command.end(), options.begin(), options.end());
  for (const char* word : {"sh", "-c", "test -e \"$1\" && echo there || echo missing", "sh"})
    command.push_back(word);
  command.push_back(path);
  const Said said = call(command, 8);
  for (const char* word : {"there", "missing"})
    if (said.out == std::string(word) + "\n") return word;
  return "";
}

JobState look_at_job(const std::string& id) {
  const Said said = call({"squeue", "--noheader", "--array", "--job=" + id, "--format=%t %r"}, 20);
  JobState state;
  if (said.code != 0) {
    state.words = "squeue: " + said.words();
    state.over = said.error.find("Invalid job id") != std::string::npos;
    return state;
  }
  std::istringstream lines(said.out);
  for (std::string line; std::getline(lines, line);) {
    const bool waits = line.rfind("PD ", 0) == 0;
    ++(waits ? state.waiting : state.running);
    if (waits && line.find("JobArrayTaskLimit") == std::string::npos) state.words = line.substr(3);
  }
  state.over = state.running + state.waiting == 0;
  return state;
}

std::vector<TaskEnd> ends_of_tasks(const std::string& id) {
  std::vector<TaskEnd> ends;
  std::istringstream lines(call({"scontrol", "--oneliner", "show", "job", id}, 20).out);
  for (std::string line; std::getline(lines, line);) {
    const std::string task = field(line, "ArrayTaskId"), state = field(line, "JobState");
    if (task.empty() || task.find_first_not_of("0123456789") != std::string::npos) continue;
    ends.push_back({std::stoul(task), state, field(line, "BatchHost")});
  }
  std::sort(ends.begin(), ends.end(),
            [](const TaskEnd& a, const TaskEnd& b) { return a.task < b.task; });
  return ends;
}

std::string cancel(const std::string& id) {
  const Said said = call({"scancel", id}, 30, true);
  return said.code == 0 ? "" : "scancel: " + said.words();
}

}  // namespace kincal
