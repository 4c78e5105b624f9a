// SPDX-License-Identifier: Apache-2.0
#include "core/exchange/blob.h"

namespace citylearn {

Taken Blob::take(std::uint32_t chunk, std::span<const std::uint8_t> data) {
  if (chunk >= here_.size() || here_[chunk]) return Taken::kNotWanted;
  if (data.size() != chunk_size(chunk, bytes_.size())) return Taken::kDamaged;
  const auto from = std::as_bytes(data);
  std::copy(from.begin(), from.end(),
            bytes_.begin() + static_cast<std::ptrdiff_t>(std::size_t{chunk} * msg::MAX_CHUNK));
  here_[chunk] = true;
  --missing_;
  while (first_missing_ < here_.size() && here_[first_missing_]) ++first_missing_;
  return Taken::kYes;
}

std::vector<std::uint32_t> Blob::first_missing(std::size_t most) const {
  std::vector<std::uint32_t> chunks;
  for (std::uint32_t chunk = first_missing_; chunk < here_.size() && chunks.size() < most; ++chunk)
    if (!here_[chunk]) chunks.push_back(chunk);
  return chunks;
}

}  // namespace citylearn
