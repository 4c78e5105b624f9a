// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace citylearn {

/// Writes a whole file so that a crash or a full disk leaves either the old one or the new one: a temporary file beside
/// it, fsync, rename, fsync of the folder. Throws Error naming the file; the old file is then untouched and the
/// temporary gone.
void write_file(const std::string& path, std::string_view contents);

/// Waits until the folder of this file is on the disk: a new file's name may not survive a loss of power before.
void sync_folder_of(const std::string& path);

/// Creates a folder and those above it, unless they are there. Throws Error naming it.
void create_folder(const std::string& path, const std::string& remedy = "");

/// Throws Error naming what `path` leads to when that is a folder, a FIFO or a device. Opening a FIFO waits for its
/// writer, and a device may have no end. A path that leads nowhere passes: opening it will say so.
void refuse_special_file(const std::string& path);

/// Bytes that no file is meant to have: reading more would rather exhaust the memory.
inline constexpr std::size_t kMaxFileBytes = std::size_t{16} << 30;

/// Returns the whole file. Throws Error naming it when it cannot be read, refuse_special_file() does or it is larger
/// than `most` bytes.
std::string read_file(const std::string& path, std::size_t most = kMaxFileBytes);

}  // namespace citylearn
