// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace citylearn {

/// CRC-32C (Castagnoli, as in RFC 3720).
std::uint32_t crc32c(const void* bytes, std::size_t count);

/// Returns a TFRecord, as TensorBoard's event files are made of: length, masked CRC-32C of the length, payload, masked
/// CRC-32C of the payload.
std::string tf_record(std::string_view payload);

/// Calls `use` with the payload of each TFRecord, until it returns false. Returns the bytes up to the first record that
/// `use` does not take, or that is damaged or cut short.
std::size_t read_tf_records(std::string_view bytes, const std::function<bool(std::string_view payload)>& use);

}  // namespace citylearn
