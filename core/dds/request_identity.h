// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "core/dds/middleware.h"

namespace citylearn {

/// Names a call of a service of ROS 2: the client's writer or reader, and the sample of its request. Over Fast DDS each
/// sample of a service's topics has it between its encapsulation and its content, in these bytes, as far as the users
/// of a Middleware see it. On the wire it is not in the content but beside it, as rmw_fastrtps has it.
struct RequestIdentity {
  Guid client{};
  std::int64_t sequence = 0;
};
static_assert(sizeof(RequestIdentity) == 24);
inline constexpr std::size_t kIdentityOffset = 4;  ///< where it is in a sample: behind the encapsulation

// The names that ROS 2 gives a service's topics begin so.
inline constexpr std::string_view kRequestPrefix = "rq/", kReplyPrefix = "rr/";

}  // namespace citylearn
