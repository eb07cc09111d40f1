// Another solver for files of Bundle Adjustment in the Large: a program that prints its final cost.
#pragma once

#include <string>

#include "run.h"

namespace kincal::benchmarks {

struct OtherProgram {
  std::string command;  // for a shell; {} stands for the file
  std::string cost;     // regular expression: the first group of its last match is the final cost
  std::string
      seconds;        // the same of the time; empty: the CPU time of the process, reading included
  double factor = 1;  // of the printed cost to 1/2 sum |r|^2
};

/// Runs it with a plain (not compressed) file. The start's cost is NaN, the iterations are 0.
/// @throws std::runtime_error with its output where it fails or prints no cost or time.
Run run_other(const OtherProgram& program, const std::string& file);

/// A PlainFile is a file as text, for programs that read no .xz: itself, or a temporary copy.
class PlainFile {
 public:
  /// @throws std::runtime_error where it cannot be unpacked.
  explicit PlainFile(const std::string& file);
  ~PlainFile();
  PlainFile(const PlainFile&) = delete;
  PlainFile& operator=(const PlainFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  bool temporary_ = false;
};

}  // namespace kincal::benchmarks
