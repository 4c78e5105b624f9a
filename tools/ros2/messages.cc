// SPDX-License-Identifier: Apache-2.0
#include "tools/ros2/messages.h"

#include <fastcdr/Cdr.h>

#include "ros2/ros2.h"

namespace citylearn {
namespace {

constexpr std::size_t kEncapsulation = 4;

}  // namespace

template <class Message>
void encode_ros2(const Message& message, Bytes& bytes) {
  bytes.resize(kEncapsulation + Message::getCdrSerializedSize(message));
  eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
  eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::LITTLE_ENDIANNESS, eprosima::fastcdr::Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  message.serialize(cdr);
  bytes.resize(cdr.getSerializedDataLength());
}

#define CITYLEARN_ROS2_TYPE(PACKAGE, TYPE, SCHEMA)                                                  \
  template <>                                                                                       \
  const Ros2Type& ros2_type_of<PACKAGE::msg::dds_::TYPE##_>() {                                     \
    static const Ros2Type type{#PACKAGE "/msg/" #TYPE, #PACKAGE "::msg::dds_::" #TYPE "_", SCHEMA}; \
    return type;                                                                                    \
  }                                                                                                 \
  template void encode_ros2(const PACKAGE::msg::dds_::TYPE##_& message, Bytes& bytes);
#include "ros2/ros2_types.inc"

}  // namespace citylearn
