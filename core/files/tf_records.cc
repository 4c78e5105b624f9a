// SPDX-License-Identifier: Apache-2.0
#include "core/files/tf_records.h"

#include <bit>
#include <boost/crc.hpp>
#include <cstring>

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie in memory");

/// Returns the masked CRC of the TFRecord format. The mask keeps a record that contains records from looking like one.
std::uint32_t masked_crc(const void* bytes, std::size_t count) {
  const std::uint32_t crc = crc32c(bytes, count);
  return (crc >> 15 | crc << 17) + 0xA282EAD8u;
}

}  // namespace

std::uint32_t crc32c(const void* bytes, std::size_t count) {
  boost::crc_optimal<32, 0x1EDC6F41, 0xFFFFFFFF, 0xFFFFFFFF, true, true> crc;
  crc.process_bytes(bytes, count);
  return crc.checksum();
}

std::string tf_record(std::string_view payload) {
  const std::uint64_t length = payload.size();
  const std::uint32_t of_length = masked_crc(&length, sizeof length);
  const std::uint32_t of_payload = masked_crc(payload.data(), payload.size());
  std::string bytes;
  bytes.append(reinterpret_cast<const char*>(&length), sizeof length);
  bytes.append(reinterpret_cast<const char*>(&of_length), sizeof of_length);
  bytes += payload;
  bytes.append(reinterpret_cast<const char*>(&of_payload), sizeof of_payload);
  return bytes;
}

std::size_t read_tf_records(std::string_view bytes, const std::function<bool(std::string_view payload)>& use) {
  constexpr std::size_t kAround = 16;  // length and two checksums
  std::size_t at = 0;
  while (bytes.size() - at >= kAround) {
    const char* record = bytes.data() + at;
    std::uint64_t length;
    std::uint32_t of_length, of_payload;
    std::memcpy(&length, record, 8);
    std::memcpy(&of_length, record + 8, 4);
    if (of_length != masked_crc(record, 8) || length > bytes.size() - at - kAround) break;
    std::memcpy(&of_payload, record + 12 + length, 4);
    if (of_payload != masked_crc(record + 12, length) || !use({record + 12, length})) break;
    at += kAround + length;
  }
  return at;
}

}  // namespace citylearn
