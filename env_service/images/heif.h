// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>
#include <span>
#include <string>

#include "core/util/types.h"

namespace citylearn {

/// Returns whether a file that begins so is a HEIF picture (ISO/IEC 23008-12), as telephones write: HEIC.
bool is_heif(std::span<const std::byte> head);
/// Decodes the main picture of a HEIF file, BGR. The file's own turns are applied; its EXIF orientation says them once
/// more and is not. Throws Error naming `where` and what to do when it cannot be decoded or is too large.
cv::Mat decode_heif(const Bytes& file, const std::string& where);
/// Returns why a HEIF file of `size` bytes that begins so is broken, as far as that shows; empty when it seems fine.
std::string heif_fault(std::span<const std::byte> head, std::size_t size);
/// Returns the EXIF data of a file's main picture, from "II*" or "MM" on; empty when it has none or is broken.
Bytes heif_exif(const std::string& path);

}  // namespace citylearn
