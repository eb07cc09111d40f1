// One image after the other on several threads.
#pragma once

#include <atomic>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace kincal {

/// Runs work(i) for all i below `count`, in any order; `progress` gets the share that is done. What
/// one of them throws ends all and is thrown again.
inline void in_parallel(size_t count, int threads, const std::function<void(size_t)>& work,
                        const std::function<void(double)>& progress) {
  std::atomic<size_t> next{0};
  size_t done = 0;
  std::exception_ptr error;
  std::mutex mutex;
  const auto run = [&] {
    for (size_t i = next++; i < count; i = next++) {
      std::exception_ptr thrown;
      try {
        work(i);
      } catch (...) {
        thrown = std::current_exception();
        next = count;
      }
      const std::lock_guard<std::mutex> lock(mutex);
      if (thrown) error = thrown;
      if (progress) progress(static_cast<double>(++done) / static_cast<double>(count));
    }
  };
  std::vector<std::thread> crew;
  for (int i = 1; i < threads; ++i) crew.emplace_back(run);
  run();
  for (std::thread& one : crew) one.join();
  if (error) std::rethrow_exception(error);
}

}  // namespace kincal
