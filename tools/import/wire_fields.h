// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>

#include <bit>
#include <cstdint>
#include <string_view>

namespace citylearn {

/// A field of a protobuf message, as it is on the wire.
struct WireField {
  int number = 0;
  std::uint64_t value = 0;  ///< of a varint, or the bits of a fixed field
  std::string_view bytes;   ///< of a length-delimited field: a text, a message, packed numbers

  double real() const { return std::bit_cast<double>(value); }
  float real32() const { return std::bit_cast<float>(static_cast<std::uint32_t>(value)); }
};

/// Calls `use(field)` with the fields of a protobuf message in their order. Returns false when it is not one: it is
/// then broken behind the fields that were used.
template <class Use>
bool each_field(std::string_view message, Use use) {
  using Wire = google::protobuf::internal::WireFormatLite;
  google::protobuf::io::CodedInputStream in(reinterpret_cast<const std::uint8_t*>(message.data()),
                                            static_cast<int>(message.size()));
  while (const std::uint32_t tag = in.ReadTag()) {
    WireField field{Wire::GetTagFieldNumber(tag), 0, {}};
    std::uint32_t small = 0;
    switch (Wire::GetTagWireType(tag)) {
      case Wire::WIRETYPE_VARINT:
        if (!in.ReadVarint64(&field.value)) return false;
        break;
      case Wire::WIRETYPE_FIXED64:
        if (!in.ReadLittleEndian64(&field.value)) return false;
        break;
      case Wire::WIRETYPE_FIXED32:
        if (!in.ReadLittleEndian32(&small)) return false;
        field.value = small;
        break;
      case Wire::WIRETYPE_LENGTH_DELIMITED: {
        if (!in.ReadVarint32(&small)) return false;
        const auto begin = static_cast<std::size_t>(in.CurrentPosition());
        if (small > message.size() - begin || !in.Skip(static_cast<int>(small))) return false;
        field.bytes = message.substr(begin, small);
        break;
      }
      default:
        return false;  // groups: nobody writes them any more
    }
    use(field);
  }
  return in.ConsumedEntireMessage();
}

}  // namespace citylearn
