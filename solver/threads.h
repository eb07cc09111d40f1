// A fixed crew of threads for loops whose pieces are independent.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace kincal {

/// Runs pieces of work on `count` threads, the caller's being one of them. Which thread takes which piece is open: results must
/// depend on the piece only. With count 1 no thread is started.
class Crew {
 public:
  explicit Crew(int count) {
    for (int worker = 1; worker < count; ++worker) threads_.emplace_back([this, worker] { serve(worker); });
  }
  ~Crew() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stop_ = true;
    }
    wake_.notify_all();
    for (std::thread& t : threads_) t.join();
  }
  Crew(const Crew&) = delete;
  Crew& operator=(const Crew&) = delete;

  int size() const { return static_cast<int>(threads_.size()) + 1; }

  /// work(piece, worker) for every piece 0 .. pieces - 1; returns when all are done. `work` must not throw.
  void run(int pieces, const std::function<void(int, int)>& work) {
    if (threads_.empty()) {
      for (int piece = 0; piece < pieces; ++piece) work(piece, 0);
      return;
    }
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      work_ = &work;
      pieces_ = pieces;
      next_ = 0;
      busy_ = static_cast<int>(threads_.size());
      ++round_;
    }
    wake_.notify_all();
    take(0);
    std::unique_lock<std::mutex> lock(mutex_);
    done_.wait(lock, [this] { return busy_ == 0; });
  }

 private:
  void take(int worker) {
    for (int piece = next_++; piece < pieces_; piece = next_++) (*work_)(piece, worker);
  }
  void serve(int worker) {
    for (long seen = 0;;) {
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
  const std::function<void(int, int)>* work_ = nullptr;
  std::atomic<int> next_{0};
  int pieces_ = 0, busy_ = 0;
  long round_ = 0;
  bool stop_ = false;
};

}  // namespace kincal
