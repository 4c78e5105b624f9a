// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>

namespace citylearn {

/// Decompresses frames of `format`, "zstd" or "lz4". `read` returns the next bytes, none at the end; `write` takes what
/// they hold, piece by piece, and returns false when that is enough. Needs at most 128 MiB, whatever the bytes say.
/// Returns what is wrong with them, as "is cut short"; empty when nothing is.
std::string decompress(const std::string& format, const std::function<std::string_view()>& read,
                       const std::function<bool(std::string_view)>& write);
/// Decompresses bytes into `result`, at most `most` bytes; more are a fault too.
std::string decompress(const std::string& format, std::string_view bytes, std::size_t most, std::string& result);

}  // namespace citylearn
