#include "signals.h"

#include <fcntl.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <initializer_list>

namespace kincal {
namespace {

volatile std::sig_atomic_t noted = 0, writing = 0, line_shown = 0;

const char kNothingWritten[] = "kincal: interrupted, nothing written\n",
           kWhileWriting[] = "kincal: interrupted while writing\n";

/// Uses only what a signal may use at any moment.
void print(const char* text) {
  if (line_shown && write(STDERR_FILENO, "\r\033[K", 4) < 0) return;
  if (write(STDERR_FILENO, text, std::strlen(text)) < 0) return;
}

void on_signal(int) {
  if (writing && !noted) {
    noted = 1;
    return;
  }
  print(writing ? kWhileWriting : kNothingWritten);
  _exit(kInterrupted);
}

}  // namespace

void end_on_signals() {
  struct sigaction action = {};
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESTART;  // what is noted only is to disturb nothing
  for (const int signal : {SIGINT, SIGTERM}) sigaddset(&action.sa_mask, signal);
  for (const int signal : {SIGINT, SIGTERM}) sigaction(signal, &action, nullptr);
}

void begin_writing() { writing = 1; }

bool not_interrupted() { return noted == 0; }

int say_interrupted() {
  print(kNothingWritten);
  return kInterrupted;
}

void set_line_shown(bool shown) { line_shown = shown; }

void keep_standard_descriptors() {
  for (const int standard : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (fcntl(standard, F_GETFD) < 0 && open("/", O_RDONLY | O_DIRECTORY) < 0) return;
}

}  // namespace kincal
