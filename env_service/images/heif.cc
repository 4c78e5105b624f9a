// SPDX-License-Identifier: Apache-2.0
#include "env_service/images/heif.h"

#include <libheif/heif.h>

#include <cstring>
#include <memory>

#include "core/files/image_header.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

struct FreeHeif {
  void operator()(heif_context* it) const { heif_context_free(it); }
  void operator()(heif_image_handle* it) const { heif_image_handle_release(it); }
  void operator()(heif_image* it) const { heif_image_release(it); }
};
template <class T>
using Heif = std::unique_ptr<T, FreeHeif>;

/// The main picture of a file, not decoded yet.
struct MainPicture {
  template <class Read>
  explicit MainPicture(Read read) {
    heif_context_set_max_decoding_threads(context.get(), 0);
    error = read(context.get());
    heif_image_handle* found = nullptr;
    if (error.code == heif_error_Ok) error = heif_context_get_primary_image_handle(context.get(), &found);
    handle.reset(found);
  }
  Heif<heif_context> context{heif_context_alloc()};
  Heif<heif_image_handle> handle;
  heif_error error{};
};

}  // namespace

bool is_heif(std::span<const std::byte> head) {
  const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
  if (text.size() < 12 || text.substr(4, 4) != "ftyp") return false;
  for (const std::string_view brand : {"heic", "heix", "heim", "heis", "mif1", "msf1"})
    if (text.substr(8, 4) == brand) return true;
  return false;
}

cv::Mat decode_heif(const Bytes& file, const std::string& where) {
  const MainPicture picture([&](heif_context* context) {
    return heif_context_read_from_memory_without_copy(context, file.data(), file.size(), nullptr);
  });
  heif_error error = picture.error;
  const auto fail = [&](const std::string& what) {
    throw Error("the HEIF picture cannot be decoded: " + what, where,
                "convert it to JPEG, or install libheif-plugin-libde265 where it is a package");
  };
  if (error.code != heif_error_Ok) fail(error.message);
  const long width = heif_image_handle_get_width(picture.handle.get()),
             height = heif_image_handle_get_height(picture.handle.get());
  if (width < 1 || height < 1 || width > kMaxPixels / height) fail("it has no or too many pixels");
  heif_image* decoded = nullptr;
  error = heif_decode_image(picture.handle.get(), &decoded, heif_colorspace_RGB, heif_chroma_interleaved_RGB, nullptr);
  const Heif<heif_image> image(decoded);
  if (error.code != heif_error_Ok) fail(error.message);
  int step = 0;
  const std::uint8_t* const rows = heif_image_get_plane_readonly(image.get(), heif_channel_interleaved, &step);
  cv::Mat bgr(heif_image_get_height(image.get(), heif_channel_interleaved),
              heif_image_get_width(image.get(), heif_channel_interleaved), CV_8UC3);
  for (int y = 0; rows && y < bgr.rows; ++y)
    for (int x = 0; x < bgr.cols; ++x) {
      const std::uint8_t* const rgb = rows + std::ptrdiff_t{y} * step + 3 * x;
      bgr.at<cv::Vec3b>(y, x) = {rgb[2], rgb[1], rgb[0]};
    }
  return bgr;
}

std::string heif_fault(std::span<const std::byte> head, std::size_t size) {
  const auto number = [&](std::size_t at, std::size_t bytes) {
    std::size_t value = 0;
    while (bytes-- > 0) value = value << 8 | std::to_integer<std::size_t>(head[at++]);
    return value;
  };
  for (std::size_t at = 0; at + 16 <= head.size();) {
    std::size_t length = number(at, 4);
    if (length == 1) length = number(at + 8, 8);
    if (length == 0) break;  // up to the file's end
    if (length < 8 || length > size - at) return "the HEIF file is cut short";
    at += length;
  }
  return "";
}

Bytes heif_exif(const std::string& path) {
  const MainPicture picture(
      [&](heif_context* context) { return heif_context_read_from_file(context, path.c_str(), nullptr); });
  heif_item_id id = 0;
  if (!picture.handle || heif_image_handle_get_list_of_metadata_block_IDs(picture.handle.get(), "Exif", &id, 1) < 1)
    return {};
  Bytes exif(heif_image_handle_get_metadata_size(picture.handle.get(), id));
  if (exif.size() < 4 || heif_image_handle_get_metadata(picture.handle.get(), id, exif.data()).code != heif_error_Ok)
    return {};
  std::size_t begin = 0;  // the first 4 bytes say how many to pass over behind them
  for (int i = 0; i < 4; ++i) begin = begin << 8 | std::to_integer<std::size_t>(exif[static_cast<std::size_t>(i)]);
  if (begin > exif.size() - 4) return {};
  if (exif.size() - 4 - begin >= 6 && std::memcmp(&exif[4 + begin], "Exif", 4) == 0) begin += 6;
  exif.erase(exif.begin(), exif.begin() + static_cast<std::ptrdiff_t>(4 + begin));
  return exif;
}

}  // namespace citylearn
