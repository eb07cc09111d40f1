// Arrays that begin with a cache line. Packs of 8 numbers are as long as one: where arrays and rows
// begin with one, no pack lies in two, which would have to be fetched or written one after the
// other. For speed only.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace kincal {

constexpr std::size_t kCacheLine = 64;  // bytes

/// An AlignedAllocator is a standard allocator whose memory begins at a cache line.
template <class T>
struct AlignedAllocator {
  using value_type = T;

  AlignedAllocator() = default;
  template <class Other>
  AlignedAllocator(const AlignedAllocator<Other>&) {}
  T* allocate(std::size_t n) {
    return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(kCacheLine)));
  }
  void deallocate(T* p, std::size_t) { ::operator delete(p, std::align_val_t(kCacheLine)); }
  template <class Other>
  bool operator==(const AlignedAllocator<Other>&) const {
    return true;
  }
  template <class Other>
  bool operator!=(const AlignedAllocator<Other>&) const {
    return false;
  }
};

using AlignedNumbers = std::vector<double, AlignedAllocator<double>>;

}  // namespace kincal
