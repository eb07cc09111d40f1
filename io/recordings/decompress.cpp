#include "decompress.h"

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <memory>

#include "bytes.h"

namespace kincal {

namespace {

constexpr size_t kStep = size_t{1} << 20;

/// Room for more; what is said of the size may be wrong, so that it grows as it is filled.
void grow(std::string& out, size_t filled) {
  if (filled >= kLargestPart) throw Damage("it unpacks to more than 512 MB");
  if (filled == out.size()) out.resize(std::min<size_t>(kLargestPart, std::max(2 * filled, kStep)));
}

size_t unpack_lz4(std::string_view packed, std::string& out) {
  LZ4F_dctx* raw = nullptr;
  LZ4F_createDecompressionContext(&raw, LZ4F_VERSION);
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(
      raw, LZ4F_freeDecompressionContext);
  size_t filled = 0, hint = 1;
  while (hint != 0) {
    grow(out, filled);
    size_t room = out.size() - filled, used = packed.size();
    hint =
        LZ4F_decompress(context.get(), out.data() + filled, &room, packed.data(), &used, nullptr);
    if (LZ4F_isError(hint)) throw Damage(std::string("lz4: ") + LZ4F_getErrorName(hint));
    filled += room;
    packed.remove_prefix(used);
    if (hint != 0 && room == 0 && used == 0) throw Damage("lz4: it ends too early");
  }
  return filled;
}

size_t unpack_zstd(std::string_view packed, std::string& out) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                     ZSTD_freeDCtx);
  ZSTD_inBuffer in{packed.data(), packed.size(), 0};
  size_t filled = 0, hint = 1;
  while (hint != 0) {
    grow(out, filled);
    ZSTD_outBuffer to{out.data(), out.size(), filled};
    const size_t before = in.pos;
    hint = ZSTD_decompressStream(context.get(), &to, &in);
    if (ZSTD_isError(hint)) throw Damage(std::string("zstd: ") + ZSTD_getErrorName(hint));
    if (hint != 0 && to.pos == filled && in.pos == before) throw Damage("zstd: it ends too early");
    filled = to.pos;
  }
  return filled;
}

size_t unpack_bz2(std::string_view packed, std::string& out) {
  bz_stream stream{};
  if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) throw Damage("bz2: no memory");
  const std::unique_ptr<bz_stream, decltype(&BZ2_bzDecompressEnd)> end(&stream,
                                                                       BZ2_bzDecompressEnd);
  stream.next_in = const_cast<char*>(packed.data());  // it is only read
  stream.avail_in = static_cast<unsigned>(std::min<size_t>(packed.size(), kLargestPart));
  size_t filled = 0;
  for (int state = BZ_OK; state != BZ_STREAM_END;) {
    grow(out, filled);
    const auto room = static_cast<unsigned>(std::min<size_t>(out.size() - filled, kLargestPart));
    const unsigned before = stream.avail_in;
    stream.next_out = out.data() + filled;
    stream.avail_out = room;
    state = BZ2_bzDecompress(&stream);
    if (state != BZ_OK && state != BZ_STREAM_END)
      throw Damage("bz2: the data are damaged (" + std::to_string(state) + ")");
    filled += room - stream.avail_out;
    if (state == BZ_OK && stream.avail_out == room && stream.avail_in == before)
      throw Damage("bz2: it ends too early");
  }
  return filled;
}

}  // namespace

void decompress(std::string_view how, std::string_view packed, std::uint64_t size,
                std::string& out) {
  if (size > kLargestPart) throw Damage("it unpacks to more than 512 MB");
  // As large as it says, but no larger than the best packing could have it at once.
  out.resize(std::max<size_t>(kStep, std::min<std::uint64_t>(size, 1000 * packed.size())));
  size_t filled = 0;
  if (how == "lz4")
    filled = unpack_lz4(packed, out);
  else if (how == "zstd")
    filled = unpack_zstd(packed, out);
  else if (how == "bz2")
    filled = unpack_bz2(packed, out);
  else
    throw Damage("compression '" + std::string(how) + "' is not known");
  if (size > 0 && filled != size)
    throw Damage("it unpacks to " + std::to_string(filled) + " bytes, not to " +
                 std::to_string(size));
  out.resize(filled);
}

}  // namespace kincal
