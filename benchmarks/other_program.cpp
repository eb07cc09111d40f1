#include "other_program.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <regex>
#include <stdexcept>

namespace kincal::benchmarks {
namespace {

/// CPU seconds of the children that have ended.
double children_seconds() {
  rusage usage{};
  getrusage(RUSAGE_CHILDREN, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

/// The number in the first group of the last match. @throws std::runtime_error
double last_number(const std::string& text, const std::string& expression, const char* option) {
  std::string found;
  const std::regex regex(expression, std::regex::ECMAScript | std::regex::multiline);
  for (std::sregex_iterator i(text.begin(), text.end(), regex), end; i != end; ++i)
    if (i->size() > 1) found = (*i)[1];
  char* end = nullptr;
  const double value = std::strtod(found.c_str(), &end);
  if (found.empty() || *end)
    throw std::runtime_error(std::string(option) + " '" + expression +
                             "': its first group finds no number in the output:\n" + text);
  return value;
}

}  // namespace

Run run_other(const OtherProgram& program, const std::string& file) {
  std::string command = program.command;
  for (size_t at = 0; (at = command.find("{}", at)) != std::string::npos;) {
    command.replace(at, 2, quoted(file));
    at += quoted(file).size();
  }
  std::fflush(stdout);
  const double cpu = children_seconds(), wall = wall_seconds();
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  if (!pipe) throw std::runtime_error("cannot start " + command);
  std::string text;
  std::array<char, 4096> part;
  for (size_t n = 0; (n = std::fread(part.data(), 1, part.size(), pipe)) > 0;)
    text.append(part.data(), n);
  const int status = pclose(pipe);
  if (status != 0) throw std::runtime_error(command + " failed:\n" + text);
  Run run;
  run.wall = wall_seconds() - wall;
  run.seconds = program.seconds.empty() ? children_seconds() - cpu
                                        : last_number(text, program.seconds, "--other-seconds");
  run.start_cost = std::numeric_limits<double>::quiet_NaN();
  run.cost = program.factor * last_number(text, program.cost, "--other-cost");
  run.converged = true;
  return run;
}

PlainFile::PlainFile(const std::string& file) : path_(file) {
  if (file.size() < 3 || file.compare(file.size() - 3, 3, ".xz") != 0) return;
  const char* folder = std::getenv("TMPDIR");
  std::string name = std::string(folder ? folder : "/tmp") + "/kincal-bal-XXXXXX";
  const int made = mkstemp(name.data());
  if (made < 0) throw std::runtime_error(name + ": cannot be made");
  close(made);
  path_ = name;
  temporary_ = true;
  if (std::system(("xz -dc " + quoted(file) + " > " + quoted(path_)).c_str()) != 0) {
    unlink(path_.c_str());
    throw std::runtime_error(file + ": xz cannot unpack it");
  }
}

PlainFile::~PlainFile() {
  if (temporary_) unlink(path_.c_str());
}

}  // namespace kincal::benchmarks
