// Bytes as they were before a recorder made them fewer.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace kincal {

/// No part of a bag is taken that is larger than this, unpacked: a damaged length asks for
/// anything.
constexpr std::uint64_t kLargestPart = std::uint64_t{512} << 20;

/// Unpacks into `out`, whose memory is used again. `how`: lz4 (frames), bz2, zstd; `size`: the
/// unpacked size that the recording says; 0: not known. @throws Damage
void decompress(std::string_view how, std::string_view packed, std::uint64_t size,
                std::string& out);

}  // namespace kincal
