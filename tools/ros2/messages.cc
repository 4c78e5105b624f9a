// SPDX-License-Identifier: Apache-2.0
#include "tools/ros2/messages.h"

#include "core/wire/cdr.h"
#include "ros2/ros2.h"

namespace citylearn {

template <class Message>
void encode_ros2(const Message& message, Bytes& bytes) {
  write_cdr(message, bytes);
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
