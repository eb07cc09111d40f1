// One image after the other on several threads.
#pragma once

#include <atomic>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "../../solver/progress.h"

namespace kincal {

/// Runs work(i) for all i below `count`, in any order. What one of them throws, or `progress`
/// (Cancelled), ends all and is thrown again.
inline void in_parallel(size_t count, int threads, const std::function<void(size_t)>& work,
                        const Progress& progress) {
  std::atomic<size_t> next{0};
  size_t done = 0;
  std::exception_ptr error;
  std::mutex mutex;
  const auto run = [&] {
    for (size_t i = next++; i < count; i = next++) {
      try {
        work(i);
        const std::lock_guard<std::mutex> lock(mutex);
        progress.share(static_cast<double>(++done), static_cast<double>(count));
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex);
        error = std::current_exception();
        next = count;
      }
    }
  };
  std::vector<std::thread> crew;
  for (int i = 1; i < threads; ++i) crew.emplace_back(run);
  run();
  for (std::thread& one : crew) one.join();
  if (error) std::rethrow_exception(error);
}

}  // namespace kincal
