// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <string>
#include <string_view>

namespace citylearn {

/// Writes a whole file so that a crash or a full disk leaves either the old one or the new one: a temporary file beside
/// it, fsync, rename, fsync of the folder. Throws Error naming the file; the old file is then untouched and the
/// temporary gone.
void write_file(const std::string& path, std::string_view contents);

/// Creates a folder and those above it, unless they are there. Throws Error naming it.
void create_folder(const std::string& path, const std::string& remedy = "");

/// Returns the whole file. Throws Error naming it when it cannot be read, is a folder or is larger than `most` bytes.
std::string read_file(const std::string& path, std::size_t most = std::numeric_limits<std::size_t>::max());

}  // namespace citylearn
