// What one minimisation cost and gave; the clocks for it.
#pragma once

#include <ctime>

namespace kincal::benchmarks {

struct Run {
  double start_cost = 0, cost = 0;  // 1/2 sum |r|^2
  int iterations = 0;
  double seconds = 0;  // CPU time of the process
  double wall = 0;     // s
  double setup = 0;    // CPU time before that: building the problem itself
  bool converged = false;
};

inline double seconds_of(clockid_t clock) {
  timespec t;
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}
inline double cpu_seconds() { return seconds_of(CLOCK_PROCESS_CPUTIME_ID); }
inline double wall_seconds() { return seconds_of(CLOCK_MONOTONIC); }

}  // namespace kincal::benchmarks
