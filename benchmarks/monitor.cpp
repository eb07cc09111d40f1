// How long Monitor::add() takes, and how often it allocates.
//
//     kincal-monitor-times RESULT SAMPLES [CALLS]
//
// The samples are added in turn; after the last a new monitor begins. Of each monitor the samples
// that show something for the first time are left out: they make what later ones use again. Times
// are those of the processor (CLOCK_THREAD_CPUTIME_ID), allocations those of malloc (glibc).
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>
#include <vector>

#include "../io/document/files.h"
#include "../io/results/read_calibrated.h"
#include "../io/rig/samples_file.h"
#include "../models/monitor/monitor.h"

namespace {
long allocations = 0;
}

extern "C" {
void* __libc_malloc(size_t);
void* __libc_memalign(size_t, size_t);

void* malloc(size_t n) {
  ++allocations;
  return __libc_malloc(n);
}
void* aligned_alloc(size_t alignment, size_t n) {
  ++allocations;
  return __libc_memalign(alignment, n);
}
}

using namespace kincal;

namespace {

double microseconds() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}

/// Whether an earlier sample has the same views of the same points.
std::vector<char> seen_before(const std::vector<Sample>& samples) {
  std::vector<char> out(samples.size(), 0);
  for (size_t i = 0; i < samples.size(); ++i)
    for (size_t k = 0; k < i && !out[i]; ++k)
      out[i] =
          std::equal(samples[i].views.begin(), samples[i].views.end(), samples[k].views.begin(),
                     samples[k].views.end(), [](const View& a, const View& b) {
                       return a.sensor == b.sensor && a.target == b.target && a.ids == b.ids;
                     });
  return out;
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 3) {
    std::fprintf(stderr, "kincal-monitor-times RESULT SAMPLES [CALLS]\n");
    return 1;
  }
  const CalibratedState state = state_of(read_calibrated(arguments[1]));
  const std::vector<Sample> samples =
      parse_samples(read_file(arguments[2]), arguments[2], state.rig);
  const std::vector<char> known = seen_before(samples);
  const auto calls = static_cast<size_t>(count > 3 ? std::atol(arguments[3]) : 10000);
  const Monitor fresh(state);
  std::vector<double> times;
  times.reserve(calls);
  long allocated = 0, allocating = 0;
  while (times.size() < calls) {
    const size_t before = times.size();
    Monitor monitor(fresh);
    Innovation innovation;
    for (size_t i = 0; i < samples.size() && times.size() < calls; ++i) {
      const long earlier = allocations;
      const double start = microseconds();
      monitor.add(samples[i], innovation);
      const double time = microseconds() - start;
      if (!known[i]) continue;
      times.push_back(time);
      allocated += allocations - earlier;
      allocating += allocations > earlier;
    }
    if (times.size() == before) break;  // no sample shows what another one shows
  }
  if (times.empty()) return 1;
  std::sort(times.begin(), times.end());
  const auto share = [&](double of) {
    return times[static_cast<size_t>(of * static_cast<double>(times.size() - 1))];
  };
  std::printf("%zu columns, %zu groups, %zu calls\n", fresh.columns().size(), fresh.groups().size(),
              times.size());
  std::printf("median %.1f us, 99 %% %.1f us, 99.99 %% %.1f us, longest %.1f us\n", share(0.5),
              share(0.99), share(0.9999), times.back());
  std::printf("allocations: %ld, in %ld calls\n", allocated, allocating);
  return 0;
}
