// Memory of a monitor, by the sizes of its calibration. With n columns, s starts of a change and
// rows of at most n + 1 numbers it is near (s + 11) n^2 numbers: each start keeps half of a
// covariance and of a sum of J'J. The formulas below follow the constructors, array by array.
#include <algorithm>
#include <stdexcept>

#include "../../solver/kernels.h"
#include "drift_watch.h"
#include "monitor.h"
#include "moving_groups.h"

namespace kincal {
namespace {

constexpr size_t kBytesOfNumber = sizeof(double);

constexpr size_t kBlock = 16;  // bytes of an allocation beyond those asked for

size_t triangle(size_t n) { return n * (n + 1) / 2; }

/// The table of parameters and the rig behind it: what lists and texts hold, roughly.
size_t memory_of(const Rig& rig, const ParameterTable& table) {
  size_t out = sizeof(Rig) + sizeof(ParameterTable);
  for (const Parameter& p : table.all)
    out += sizeof(Parameter) + p.name.size() + 6 * kBlock +
           2 * static_cast<size_t>(p.size()) * sizeof(std::string);
  out += 3 * kBytesOfNumber *
         static_cast<size_t>(table.initial.size());  // initial, of state and setup
  out += rig.tree.joints.size() * (sizeof(Joint) + 2 * sizeof(std::string) + 8 * sizeof(int));
  out += rig.joints.size() * sizeof(rig.joints[0]);
  out += rig.sensors.size() * (sizeof(Sensor) + 8 * sizeof(std::string));
  const size_t needed = sizeof(std::vector<int>) + kBlock + rig.tree.joints.size() * sizeof(int);
  out += rig.sensors.size() * rig.targets.size() * needed;
  for (const Target& target : rig.targets)
    out += sizeof(Target) +
           kBytesOfNumber * static_cast<size_t>(target.points.size() + target.layout.size());
  return out;
}

}  // namespace

size_t DriftWatch::memory(int columns, const std::vector<int>& groups, int most_rows) {
  const auto n = static_cast<size_t>(columns), m = static_cast<size_t>(most_rows);
  const auto stride = [](size_t count) {
    const int numbers = padded(static_cast<int>(count)) + kSlack;
    return static_cast<size_t>(numbers);
  };
  const size_t of_start = 2 * (n + triangle(n));
  size_t numbers = kStarts * of_start;
  numbers += stride(n) * (n + 1) + 2 * n + triangle(n);            // covariance, means, sums, step
  numbers += stride(n + 1) * (m + n + 1);                          // j, gram
  numbers += (stride(2 * n + 1) + stride(n)) * m + stride(n) * n;  // rows, seen, p
  numbers += stride(m) * (n + m);                                  // turned, s
  size_t widest = 0;
  for (const int size : groups) {
    const auto width = static_cast<size_t>(size);
    numbers += kLanes * (triangle(width) + width + 1) + width;
    widest = std::max(widest, width);
  }
  numbers += kSlack * (triangle(widest) + 2 * widest) + triangle(widest) + widest;
  const size_t blocks = 4 * kStarts + 5 * groups.size() + 20;
  return sizeof(DriftWatch) + kBytesOfNumber * numbers + kStarts * sizeof(Start) +
         7 * n * sizeof(int) + groups.size() * (sizeof(DriftGroup) + sizeof(GroupSums)) +
         kBlock * blocks;
}

size_t monitor_memory(const CalibratedState& state) {
  const ParameterTable table(state.rig);
  for (const Component& c : state.columns)
    if (c.parameter < 0 || c.parameter >= static_cast<int>(table.all.size()))
      throw std::invalid_argument("columns: the rig has no such parameter");
  const Followed all = followed(state.rig, table, state.columns);
  std::vector<int> groups;
  size_t names = 0;
  for (const auto& group : all.groups) {
    groups.push_back(static_cast<int>(group.second.size()));
    names += group.first.size() + kBlock;
  }
  const size_t n = all.columns.size();
  const size_t sum = DriftWatch::memory(static_cast<int>(n), groups, static_cast<int>(n) + 1) +
                     kBytesOfNumber * (2 * n * n + 2 * n) +  // known, and an outlier that waits
                     n * (sizeof(Component) + 2 * sizeof(Freed)) +  // columns and freed components
                     names + memory_of(state.rig, table);
  return sum + sum / 100;  // blocks are rounded
}

}  // namespace kincal
