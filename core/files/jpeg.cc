// SPDX-License-Identifier: Apache-2.0
#include <turbojpeg.h>

#include <cstdio>
#include <memory>

#include "core/files/image_header.h"
#include "core/util/error.h"

namespace citylearn {

bool decode_jpeg(std::span<const std::byte> file, const ImageHeader& header, const std::string& where,
                 unsigned char* pixels) {
  constexpr unsigned kMaxSurplusBytes = 16;  // bytes
  const auto* bytes = reinterpret_cast<const unsigned char*>(file.data());
  const std::unique_ptr<void, int (*)(tjhandle)> decoder(tjInitDecompress(), tjDestroy);
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (header.format != "jpeg" || !decoder ||
      tjDecompressHeader3(decoder.get(), bytes, file.size(), &width, &height, &subsampling, &colours) != 0 ||
      (colours != TJCS_YCbCr && colours != TJCS_RGB && colours != TJCS_GRAY) || width != header.width ||
      height != header.height)
    return false;
  if (tjDecompress2(decoder.get(), bytes, file.size(), pixels, width, 0, height, TJPF_BGR, 0) == 0) return true;
  if (tjGetErrorCode(decoder.get()) != TJERR_WARNING) return false;
  const std::string warning = tjGetErrorStr2(decoder.get());
  unsigned surplus = kMaxSurplusBytes + 1;
  std::sscanf(warning.c_str(), "Corrupt JPEG data: %u extraneous", &surplus);
  if (surplus > kMaxSurplusBytes) throw Error(warning, where, "replace the file");
  return true;
}

}  // namespace citylearn
