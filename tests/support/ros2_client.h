// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "core/dds/middleware.h"
#include "core/ros2/messages.h"

namespace citylearn::testing {

/// Calls a service of ROS 2 as a client of rmw_cyclonedds does, whose number and call's number stand before the
/// request.
template <class Request, class Response>
class Ros2Client {
 public:
  Ros2Client(const MiddlewareOptions& options, const std::string& service) : middleware_(create_middleware(options)) {
    const auto topic = [&](const std::string& name, const Ros2Type& type) {
      return Topic{name, type.dds, Profile::kRos2Reliable, 1 << 16};
    };
    requests_ = middleware_->create_publisher(topic("rq" + service + "Request", ros2_type_of<Request>()));
    replies_ = middleware_->create_subscription(topic("rr" + service + "Reply", ros2_type_of<Response>()));
  }
  void call(const Request& request) {
    Bytes bytes;
    encode_ros2(request, bytes);
    send(bytes);
  }
  /// Sends a request that has these bytes.
  void send(Bytes bytes) {
    for (int at = 0; at < 16; ++at) bytes.insert(bytes.begin() + 4 + at, std::byte(0xA0 + at));
    requests_->publish(bytes);
  }
  /// Returns the reply to it, where one has come.
  std::optional<Response> reply() {
    Bytes bytes;
    Response response;
    if (!replies_->take(bytes) || bytes.size() < 20) return std::nullopt;
    for (int at = 0; at < 16; ++at)
      if (bytes[4 + at] != std::byte(0xA0 + at)) return std::nullopt;
    bytes.erase(bytes.begin() + 4, bytes.begin() + 20);
    return decode_ros2(bytes, response) ? std::optional(response) : std::nullopt;
  }

 private:
  const std::unique_ptr<Middleware> middleware_;
  std::unique_ptr<Publisher> requests_;
  std::unique_ptr<Subscription> replies_;
};

}  // namespace citylearn::testing
