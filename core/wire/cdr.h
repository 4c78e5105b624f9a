// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fastcdr/Cdr.h>

#include <cstddef>

#include "core/util/types.h"

namespace citylearn {

inline constexpr std::size_t kEncapsulation = 4;  ///< bytes in front of CDR that name its kind

/// Writes the CDR bytes of a generated message into `bytes` (its capacity is used again). Checks nothing. Padding is
/// zero, because Fast CDR leaves it as it was: the same message has the same bytes, and nothing of another one.
template <class Message>
void write_cdr(const Message& message, Bytes& bytes) {
  bytes.assign(kEncapsulation + Message::getCdrSerializedSize(message), std::byte{0});
  eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
  eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::LITTLE_ENDIANNESS, eprosima::fastcdr::Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  message.serialize(cdr);
  bytes.resize(cdr.getSerializedDataLength());
}

}  // namespace citylearn
