// SPDX-License-Identifier: Apache-2.0
#include "core/recording/compression.h"

#include <lz4frame.h>
#include <zstd.h>

#include <memory>
#include <tuple>
#include <utility>

namespace citylearn {
namespace {

struct FreeDecoder {
  void operator()(ZSTD_DCtx* it) const { ZSTD_freeDCtx(it); }
  void operator()(LZ4F_dctx* it) const { LZ4F_freeDecompressionContext(it); }
};

}  // namespace

std::string decompress(const std::string& format, const std::function<std::string_view()>& read,
                       const std::function<bool(std::string_view)>& write) {
  const bool zstd = format == "zstd";
  if (!zstd && format != "lz4") return "is compressed with '" + format + "'; zstd and lz4 are known";
  const std::unique_ptr<ZSTD_DCtx, FreeDecoder> zstd_decoder(ZSTD_createDCtx());
  LZ4F_dctx* created = nullptr;
  LZ4F_createDecompressionContext(&created, LZ4F_VERSION);
  const std::unique_ptr<LZ4F_dctx, FreeDecoder> lz4_decoder(created);

  std::string buffer(std::size_t{1} << 17, '\0');
  std::size_t left = 1;  // 0: a frame is complete
  for (std::string_view bytes = read(); !bytes.empty(); bytes = read())
    for (bool more = true; more;) {
      std::size_t taken = bytes.size(), given = buffer.size();
      if (zstd) {
        ZSTD_inBuffer in{bytes.data(), taken, 0};
        ZSTD_outBuffer out{buffer.data(), given, 0};
        left = ZSTD_decompressStream(zstd_decoder.get(), &out, &in);
        if (ZSTD_isError(left)) return std::string("is damaged: ") + ZSTD_getErrorName(left);
        std::tie(taken, given) = std::pair(in.pos, out.pos);
      } else {
        left = LZ4F_decompress(lz4_decoder.get(), buffer.data(), &given, bytes.data(), &taken, nullptr);
        if (LZ4F_isError(left)) return std::string("is damaged: ") + LZ4F_getErrorName(left);
      }
      if (!write({buffer.data(), given})) return "is longer than it may be";
      bytes.remove_prefix(taken);
      more = !bytes.empty() || (left != 0 && given == buffer.size());  // the decoder may hold more
    }
  return left == 0 ? "" : "is cut short";
}

std::string decompress(const std::string& format, std::string_view bytes, std::size_t most, std::string& result) {
  result.clear();
  return decompress(
      format, [&] { return std::exchange(bytes, {}); },
      [&](std::string_view part) {
        const bool fits = part.size() <= most - result.size();
        if (fits) result += part;
        return fits;
      });
}

}  // namespace citylearn
