// How the program ends: exit codes, Ctrl-C, SIGTERM.
#pragma once

namespace kincal {

enum ExitCode {
  kConverged = 0,
  kBadInput = 1,
  kUnobservable = 2,
  kNotConverged = 3,
  kToleranceNotMet = 4,
  kNotExplained = 5,
  kMoved = 6,
  kInterrupted = 130
};

/// Makes SIGINT and SIGTERM end the program with exit code 130 wherever it is, in a read from a
/// pipe too: at once, for as long as nothing is being written nothing has to be put in order.
void end_on_signals();

/// What is written is written whole: from here on a first signal is only noted. A second one ends
/// the program.
void begin_writing();

/// False after a signal was noted. It is asked for the last time before a result gets its name.
bool not_interrupted();

/// Prints that nothing was written, and returns the exit code.
int say_interrupted();

/// Says whether a line of progress stands on the terminal, which the end of the program removes.
void set_line_shown(bool shown);

/// Opens the standard descriptors that are closed, so that no file of the program gets their
/// numbers and with them what is printed. They still can be neither read nor written.
void keep_standard_descriptors();

}  // namespace kincal
