// A fixed pool of threads for loops whose pieces are independent.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "aligned.h"

namespace kincal {

/// A ThreadPool runs pieces of work on `count` threads, the caller's being one of them. Which
/// thread takes which piece is open: results must depend on the piece only. With count 1 no thread
/// is started.
class ThreadPool {
 public:
  /// @throws std::system_error where the system does not give so many threads.
  explicit ThreadPool(int count) {
    try {
      for (int worker = 1; worker < count; ++worker)
        threads_.emplace_back([this, worker] { serve(worker); });
    } catch (const std::system_error& error) {  // those that were started must end first
      const std::string started = std::to_string(size());
      stop();
      throw std::system_error(error.code(), "only " + started + " of " + std::to_string(count) +
                                                " threads can be started");
    } catch (...) {
      stop();
      throw;
    }
  }
  ~ThreadPool() { stop(); }
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int size() const { return static_cast<int>(threads_.size()) + 1; }

  static constexpr int kMostShares = 4;
  /// Returns the first piece of a share; that of the share behind the last is `pieces`.
  static int first_of(int share, int pieces, int shares) { return share * pieces / shares; }

  /// Calls work(piece, worker) for every piece 0 .. pieces - 1 and returns when all are done.
  /// Pieces stand in 1 .. kMostShares shares of neighbours. Those of a share are taken in their
  /// order; each worker begins with another share and goes on to the next, so that what a piece
  /// leaves in a core's cache is mostly found there by the same piece of the next run: between
  /// cores that share no cache a line takes 400 ns, not 50. Throws what `work` throws; then not
  /// every piece was done.
  template <class Work>
  void run(int pieces, int shares, const Work& work) {
    if (threads_.empty()) {
      for (int piece = 0; piece < pieces; ++piece) work(piece, 0);
      return;
    }
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      work_ = &work;
      call_ = [](const void* w, int piece, int worker) {
        (*static_cast<const Work*>(w))(piece, worker);
      };
      shares_ = shares;
      for (int share = 0; share < shares; ++share) {
        queues_[share].next = first_of(share, pieces, shares);
        queues_[share].end = first_of(share + 1, pieces, shares);
      }
      busy_ = static_cast<int>(threads_.size());
      ++round_;
    }
    wake_.notify_all();
    take(0);
    spin([this] { return busy_ == 0; });
    std::unique_lock<std::mutex> lock(mutex_);
    done_.wait(lock, [this] { return busy_ == 0; });
    if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
  }

 private:
  // Pieces follow each other faster than a thread falls asleep and wakes, which takes some tens of
  // microseconds, 25 of them the caller's. Not a number of pauses: they take 10 to 50 ns.
  static constexpr std::chrono::microseconds kSpin{200};

  struct alignas(kCacheLine) Queue {
    std::atomic<int> next{0};
    int end = 0;
  };

  /// Returns when done() says so, or after kSpin.
  template <class Done>
  static void spin(const Done& done) {
    const auto end = std::chrono::steady_clock::now() + kSpin;
    do {
      for (int i = 0; i < 32; ++i) {
        if (done()) return;
#if defined(__x86_64__) || defined(__i386__)
        __builtin_ia32_pause();
#endif
      }
    } while (std::chrono::steady_clock::now() < end);
  }
  void stop() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stop_ = true;
    }
    wake_.notify_all();
    for (std::thread& t : threads_) t.join();
  }
  void take(int worker) {
    try {
      for (int i = 0, own = worker * shares_ / size(); i < shares_; ++i) {
        Queue& queue = queues_[(own + i) % shares_];
        for (int piece = queue.next++; piece < queue.end; piece = queue.next++)
          call_(work_, piece, worker);
      }
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex_);
      error_ = std::current_exception();
    }
  }
  void serve(int worker) {
    for (long seen = 0;;) {
      spin([&] { return round_ != seen || stop_; });
      std::unique_lock<std::mutex> lock(mutex_);
      wake_.wait(lock, [&] { return stop_ || round_ != seen; });
      if (stop_) return;
      seen = round_;
      lock.unlock();
      take(worker);
      lock.lock();
      if (--busy_ == 0) done_.notify_one();
    }
  }

  std::vector<std::thread> threads_;
  std::mutex mutex_;
  std::condition_variable wake_, done_;
  const void* work_ = nullptr;
  void (*call_)(const void*, int, int) = nullptr;
  Queue queues_[kMostShares];
  int shares_ = 1;
  std::atomic<int> busy_{0};
  std::atomic<long> round_{0};
  std::atomic<bool> stop_{false};
  std::exception_ptr error_;
};

}  // namespace kincal
