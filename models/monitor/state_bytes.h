// The state of a monitor as bytes, and back. One function of each class lists its members for both
// directions, so that they cannot differ.
//
// Layout: "KINCALMS", version, byte order, whose state it is, length (8 bytes each), the members,
// and a checksum (FNV-1a) of all before. Numbers are as the machine has them, integers as 8 bytes.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

namespace kincal {

/// Continues the FNV-1a hash of some bytes.
inline std::uint64_t hash_bytes(const void* bytes, size_t count,
                                std::uint64_t hash = 14695981039346656037u) {
  const auto* const at = static_cast<const unsigned char*>(bytes);
  for (size_t i = 0; i < count; ++i) hash = (hash ^ at[i]) * 1099511628211u;
  return hash;
}

class StateBytes {
 public:
  /// Writes the state of what `owner` is the hash of.
  explicit StateBytes(std::uint64_t owner) : writes_(true), bytes_("KINCALMS") {
    for (std::uint64_t x : {kVersion, kOrder, owner, std::uint64_t(0)}) value(x);
  }
  /// Reads it. @throws std::invalid_argument: no such state, truncated, damaged, of another version
  /// or another owner
  StateBytes(std::string bytes, std::uint64_t owner) : writes_(false), bytes_(std::move(bytes)) {
    const auto fail = [](const char* why) {
      throw std::invalid_argument(std::string("state: ") + why);
    };
    if (bytes_.compare(0, 8, "KINCALMS") != 0) fail("it is not that of a monitor");
    if (bytes_.size() < kHead + 8) fail("it is truncated");
    at_ = 8;
    std::uint64_t version = 0, order = 0, saved_by = 0, length = 0;
    value(version);
    value(order);
    value(saved_by);
    value(length);
    if (order != kOrder) fail("it was saved by a machine with another order of bytes");
    if (version != kVersion) fail("it was saved by another version of kincal");
    if (bytes_.size() != length)
      fail(bytes_.size() < length ? "it is truncated" : "it is too long");
    std::uint64_t sum = 0;
    std::memcpy(&sum, bytes_.data() + bytes_.size() - 8, 8);
    bytes_.resize(bytes_.size() - 8);
    if (sum != hash_bytes(bytes_.data(), bytes_.size()))
      fail("its checksum is wrong: it is damaged");
    if (saved_by != owner) fail("it belongs to another calibration, or to other options");
  }

  bool writes() const { return writes_; }

  /// Each writes its argument, or reads it.
  void value(double& x) { raw(&x, sizeof x); }
  void value(std::uint64_t& x) { raw(&x, sizeof x); }
  void value(long& x) { as_integer(x); }
  void value(int& x) { as_integer(x); }
  void value(bool& x) { as_integer(x); }
  void value(std::string& x) {
    x.resize(count(x.size(), 1));
    raw(x.data(), x.size());
  }
  /// Coefficients of a matrix or vector whose size both sides know.
  template <typename Matrix>
  void coefficients(Matrix& x) {
    raw(x.data(), static_cast<size_t>(x.size()) * sizeof(double));
  }
  /// With its size.
  void value(Eigen::VectorXd& x) {
    x.resize(static_cast<Eigen::Index>(count(static_cast<size_t>(x.size()), sizeof(double))));
    coefficients(x);
  }
  void value(Eigen::MatrixXd& x) {
    const size_t rows = count(static_cast<size_t>(x.rows()), 1),
                 cols = count(static_cast<size_t>(x.cols()), 1);
    if (!writes_ && rows > 0 && cols > left() / sizeof(double) / rows) too_short();
    x.resize(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(cols));
    coefficients(x);
  }
  /// Elements, each by `one(element)`.
  template <typename T, typename One>
  void list(std::vector<T>& x, const One& one) {
    x.resize(count(x.size(), 1));
    for (T& element : x) one(element);
  }

  /// Returns what was written.
  std::string finish() {
    const std::uint64_t length = bytes_.size() + 8;
    std::memcpy(&bytes_[kHead - 8], &length, 8);
    std::uint64_t sum = hash_bytes(bytes_.data(), bytes_.size());
    value(sum);
    return std::move(bytes_);
  }
  /// @throws std::invalid_argument: not everything was read
  void expect_end() const {
    if (left() > 0) throw std::invalid_argument("state: it is too long");
  }

 private:
  static constexpr std::uint64_t kVersion = 2, kOrder = 0x0102030405060708u;
  static constexpr size_t kHead = 40;

  size_t left() const { return bytes_.size() - at_; }
  [[noreturn]] static void too_short() { throw std::invalid_argument("state: it is truncated"); }
  /// A number of elements of at least `bytes` each.
  size_t count(size_t now, size_t bytes) {
    std::uint64_t n = now;
    value(n);
    if (!writes_ && n > left() / bytes) too_short();
    return static_cast<size_t>(n);
  }
  template <typename Integer>
  void as_integer(Integer& x) {
    auto wide = static_cast<std::int64_t>(x);
    raw(&wide, sizeof wide);
    x = static_cast<Integer>(wide);
  }
  void raw(void* x, size_t size) {
    if (size == 0) return;
    if (writes_) {
      bytes_.append(static_cast<const char*>(x), size);
    } else {
      if (size > left()) too_short();
      std::memcpy(x, bytes_.data() + at_, size);
      at_ += size;
    }
  }

  bool writes_;
  std::string bytes_;
  size_t at_ = 0;
};

}  // namespace kincal
