// How long work is done for Python.
//
// Work is done in a thread of its own that knows nothing of Python. The caller's thread waits
// without the interpreter's lock; twenty times a second, and where there is news for the user's
// callback, it takes the lock, does what signals ask for (KeyboardInterrupt) and calls that. What
// is raised there is raised at once: the work is given up, and ends by itself at its next word of
// progress.
#pragma once

#include <malloc.h>
#include <pthread.h>
#include <pybind11/pybind11.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "../../solver/progress.h"

namespace kincal {

namespace py = pybind11;

/// News is what the user's callback gets.
struct News {
  std::string what;
  double share;
  int iteration;
  double chi2;
};

/// Work is what the thread that works and the one that waits have in common.
struct Work {
  explicit Work(bool callback) : listened(callback) {}
  bool tell(const Progress::News& told) {
    if (listened && !given_up) {
      const std::lock_guard<std::mutex> lock(mutex);
      const bool stage = told.iteration < 0;
      if (stage && !news.empty() && news.back().iteration < 0 && news.back().what == told.what)
        news.pop_back();  // the same, further on
      if (!stage || !std::isnan(told.share) || told.what != last)
        news.push_back({told.what, told.share, told.iteration, told.chi2});
      last = told.what;
      changed.notify_all();
    }
    return !given_up;
  }

  const bool listened;
  std::atomic<bool> given_up{false};
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<News> news;
  std::string last;
  bool done = false;
  std::exception_ptr error;
};
inline std::atomic<int> at_work{0};  // threads

inline void tell(const py::object& callback, const News& news) {
  const auto or_none = [](double number) {
    return std::isnan(number) ? py::object(py::none()) : py::object(py::float_(number));
  };
  callback(news.what, or_none(news.share), news.iteration, or_none(news.chi2));
}

/// Waits until the work is done. @throws what it threw; error_already_set: it was given up
inline void wait_for(Work& work, const py::object& callback) {
  for (bool done = false; !done;) {
    std::vector<News> news;
    {
      const py::gil_scoped_release release;
      std::unique_lock<std::mutex> lock(work.mutex);
      work.changed.wait_for(lock, std::chrono::milliseconds(50),
                            [&] { return work.done || !work.news.empty(); });
      done = work.done;
      news.swap(work.news);
    }
    try {
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
      for (const News& one : news) tell(callback, one);
    } catch (const py::error_already_set&) {
      work.given_up = true;
      throw;
    }
  }
  if (work.error) std::rethrow_exception(work.error);
}

/// Returns what `make` makes of a progress. It holds all that it needs by value, and nothing of
/// Python.
template <class Make>
auto released(const py::object& callback, Make make) {
  using Made = decltype(make(Progress()));
  const auto work = std::make_shared<Work>(!callback.is_none());
  const auto made = std::make_shared<std::optional<Made>>();
  std::thread thread([work, made, make = std::make_unique<Make>(std::move(make))]() mutable {
    try {
      made->emplace(
          (*make)(Progress([&](const Progress::News& news) { return work->tell(news); })));
    } catch (...) {
      work->error = std::current_exception();
    }
    make.reset();
    if (work->given_up) made->reset();
    {
      const std::lock_guard<std::mutex> lock(work->mutex);
      work->done = true;
    }
    work->changed.notify_all();
    --at_work;
  });
  ++at_work;  // it may have ended: then both cancel out
  thread.detach();
  wait_for(*work, callback);
  return std::move(**made);
}

/// Work matrices come and go: their memory is kept, else each is mapped and cleared anew (a tenth
/// of the time of a small calibration). It holds for the whole process: up to 64 MB stay with it.
inline void keep_memory() {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, 1 << 25);
  mallopt(M_TRIM_THRESHOLD, 1 << 26);
  mallopt(M_TOP_PAD, 1 << 20);
#endif
}

/// Waits for work that was given up: nothing may run while the process ends. (A child by fork has
/// none of the threads.)
inline void wait_at_exit() {
  const py::gil_scoped_release release;
  while (at_work > 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

}  // namespace kincal
