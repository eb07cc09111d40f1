#include "decompress.h"

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <memory>

#include "bytes.h"

namespace kincal {

namespace {

constexpr size_t kStep = size_t{1} << 16;

/// Where it is unpacked to: room for `most` bytes and one more, which shows that there are too
/// many. What is said of the size may be wrong, so that it grows as it is filled.
struct Room {
  std::string& out;
  size_t most, filled = 0;

  /// Makes room for more.
  void grow() {
    if (filled > most) throw Damage("it unpacks to more than " + std::to_string(most) + " bytes");
    if (filled == out.size()) out.resize(std::min(most + 1, std::max(2 * filled, kStep)));
  }
};

void unpack_lz4(std::string_view packed, Room& to) {
  LZ4F_dctx* raw = nullptr;
  LZ4F_createDecompressionContext(&raw, LZ4F_VERSION);
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(
      raw, LZ4F_freeDecompressionContext);
  for (size_t hint = 1; hint != 0 || !packed.empty();) {
    to.grow();
    size_t room = to.out.size() - to.filled, used = packed.size();
    hint = LZ4F_decompress(context.get(), to.out.data() + to.filled, &room, packed.data(), &used,
                           nullptr);
    if (LZ4F_isError(hint)) throw Damage(std::string("lz4: ") + LZ4F_getErrorName(hint));
    to.filled += room;
    packed.remove_prefix(used);
    if (room == 0 && used == 0) throw Damage("lz4: it ends too early");
  }
}

void unpack_zstd(std::string_view packed, Room& to) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                     ZSTD_freeDCtx);
  ZSTD_inBuffer in{packed.data(), packed.size(), 0};
  for (size_t hint = 1; hint != 0 || in.pos < in.size;) {
    to.grow();
    ZSTD_outBuffer out{to.out.data(), to.out.size(), to.filled};
    const size_t before = in.pos;
    hint = ZSTD_decompressStream(context.get(), &out, &in);
    if (ZSTD_isError(hint)) throw Damage(std::string("zstd: ") + ZSTD_getErrorName(hint));
    if (hint != 0 && out.pos == to.filled && in.pos == before)
      throw Damage("zstd: it ends too early");
    to.filled = out.pos;
  }
}

void unpack_bz2(std::string_view packed, Room& to) {
  bz_stream stream{};
  if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) throw Damage("bz2: no memory");
  const std::unique_ptr<bz_stream, decltype(&BZ2_bzDecompressEnd)> end(&stream,
                                                                       BZ2_bzDecompressEnd);
  stream.next_in = const_cast<char*>(packed.data());  // it is only read
  stream.avail_in = static_cast<unsigned>(std::min<size_t>(packed.size(), kLargestPart));
  for (int state = BZ_OK; state != BZ_STREAM_END;) {
    to.grow();
    const auto room = static_cast<unsigned>(to.out.size() - to.filled);
    const unsigned before = stream.avail_in;
    stream.next_out = to.out.data() + to.filled;
    stream.avail_out = room;
    state = BZ2_bzDecompress(&stream);
    if (state != BZ_OK && state != BZ_STREAM_END)
      throw Damage("bz2: the data are damaged (" + std::to_string(state) + ")");
    to.filled += room - stream.avail_out;
    if (state == BZ_OK && stream.avail_out == room && stream.avail_in == before)
      throw Damage("bz2: it ends too early");
  }
  if (stream.avail_in > 0) throw Damage("bz2: bytes come after its end");
}

}  // namespace

void decompress(std::string_view how, std::string_view packed, std::uint64_t size,
                std::string& out) {
  if (size > kLargestPart) throw Damage("it unpacks to more than 512 MB");
  // As large as it says, but no larger than the best packing could have it at once.
  out.resize(std::max<size_t>(kStep, std::min<std::uint64_t>(size + 1, 1000 * packed.size())));
  Room to{out, size > 0 ? size : kLargestPart};
  if (how == "lz4")
    unpack_lz4(packed, to);
  else if (how == "zstd")
    unpack_zstd(packed, to);
  else if (how == "bz2")
    unpack_bz2(packed, to);
  else
    throw Damage("compression '" + std::string(how.substr(0, 20)) + "' is not known");
  if (size > 0 && to.filled != size)
    throw Damage("it unpacks to " + std::to_string(to.filled) + " bytes, not to " +
                 std::to_string(size));
  out.resize(to.filled);
}

}  // namespace kincal
