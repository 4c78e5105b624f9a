// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fastcdr/Cdr.h>
#include <fastcdr/config.h>

#include <algorithm>
#include <vector>

#include "core/wire/cdr.h"
#include "idl/message_fields.h"

namespace citylearn::testing {

/// Writes a message's fields by Fast CDR, release 1 or 2.
class FastCdrWriter {
 public:
  explicit FastCdrWriter(eprosima::fastcdr::Cdr& cdr) : cdr_(cdr) {}

  template <class Field>
  void operator()(const char*, const Field& field) {
    cdr_ << field;
  }
  template <std::size_t N>
  void operator()(const char*, const FixedString<N>& text) {
    cdr_ << text.to_string();
  }
  template <class T>
  void operator()(const char*, const std::vector<T>& sequence, std::size_t) {
    cdr_ << sequence;
  }
  template <class Enum>
  void enumerator(const char*, Enum value, Enum) {
    cdr_ << static_cast<std::uint32_t>(value);
  }
  void protocol(const char*, std::uint32_t number) { cdr_ << number; }
  template <class Message>
  void nested(const char*, const Message& message) {
    visit(message, *this);
  }

 private:
  eprosima::fastcdr::Cdr& cdr_;
};

/// Returns the bytes that Fast CDR makes of a message or object, over zeros since it leaves padding as it was. Throws
/// its exception when they are more than ours.
template <class Message>
Bytes fast_cdr(const Message& message, bool big_endian = false) {
  namespace fastcdr = eprosima::fastcdr;
  Bytes bytes;
  CdrWriter ours(bytes);
  visit(message, ours);
  std::fill(bytes.begin(), bytes.end(), std::byte{0});
  fastcdr::FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
  const auto order = big_endian ? fastcdr::Cdr::BIG_ENDIANNESS : fastcdr::Cdr::LITTLE_ENDIANNESS;
#if FASTCDR_VERSION_MAJOR == 1
  fastcdr::Cdr cdr(buffer, order, fastcdr::Cdr::DDS_CDR);
#else
  fastcdr::Cdr cdr(buffer, order, fastcdr::CdrVersion::DDS_CDR);
#endif
  cdr.serialize_encapsulation();
  FastCdrWriter writer(cdr);
  visit(message, writer);
#if FASTCDR_VERSION_MAJOR == 1
  bytes.resize(cdr.getSerializedDataLength());
#else
  bytes.resize(cdr.get_serialized_data_length());
#endif
  return bytes;
}

}  // namespace citylearn::testing
