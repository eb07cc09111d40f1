// Progress of long work, and its cancellation.
//
// A caller may pass a listener. It receives the current stage and its share, and cancels by
// returning false: Cancelled is thrown there. The public functions (solve() of the solver, the
// calibrations, trials and studies of models/) catch it and return their documented result
// (Outcome::cancelled, Status::cancelled, nullopt). Where one of them runs as a part of other work,
// uncancelled() throws Cancelled again.
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>

namespace kincal {

/// Cancelled is thrown when a listener returns false. It is no std::exception, because nothing is
/// wrong.
struct Cancelled {};
/// Throws it. (Headers do not throw, so that they compile without exceptions.) @throws Cancelled
[[noreturn]] void throw_cancelled();

/// Returns the result. @throws Cancelled if it is nullopt: the work was cancelled
template <class T>
T uncancelled(std::optional<T> found) {
  if (!found) throw_cancelled();
  return std::move(*found);
}

/// A Progress is passed to every long computation. By default it has no listener and costs nothing.
/// It allocates only when a part is named or a stage is reported. The listener is called on the
/// caller's thread or on a worker, never by two threads at once.
class Progress {
  static constexpr double kUntold = std::numeric_limits<double>::quiet_NaN();

 public:
  struct News {
    /// The stage that begins or continues; of an iteration the step. The names of its enclosing
    /// parts precede it: "restart 2: everything".
    const std::string& what;
    double share = kUntold;  // completed part of the stage (1: all); NaN: not available, the
                             // stage with a share continues
    int iteration = -1;      // completed iteration; 0: a step begins; -1: a stage
    double chi2 = kUntold, damping = kUntold;  // after that iteration
  };
  using Listener = std::function<bool(const News&)>;  // false cancels

  Progress() = default;
  explicit Progress(Listener listener) : listener_(std::move(listener)) {}

  /// Returns the progress of a part; its name precedes all its reports.
  Progress in(const std::string& part) const {
    Progress out;
    if (!listener_) return out;
    out.listener_ = listener_;
    out.name_ = behind_name(part);
    return out;
  }
  /// Returns the progress of the work between two shares of this one.
  Progress between(double from, double to) const {
    Progress out = *this;
    out.from_ = from_ + (to_ - from_) * from;
    out.to_ = from_ + (to_ - from_) * to;
    return out;
  }

  // All of these throw Cancelled.
  /// Reports a stage of this part.
  void stage(const std::string& what, double share = kUntold) const {
    if (listener_) tell({behind_name(what), share});
  }
  /// Reports the completed share of this part: `done` of `of`.
  void share(double done, double of = 1) const {
    if (listener_) tell({name_, from_ + (to_ - from_) * (of > 0 ? done / of : 1)});
  }
  /// Reports that this part, a step, begins (0) or that one of its iterations ended.
  void iteration(int number, double chi2 = kUntold, double damping = kUntold) const {
    if (listener_) tell({name_, kUntold, number, chi2, damping});
  }
  /// Checks for cancellation without reporting anything new.
  void check() const {
    if (listener_) tell({name_});
  }

 private:
  std::string behind_name(const std::string& what) const {
    return name_.empty() ? what : name_ + ": " + what;
  }
  void tell(const News& news) const {
    if (!listener_(news)) throw_cancelled();
  }

  Listener listener_;
  std::string name_;
  double from_ = 0, to_ = 1;
};

}  // namespace kincal
