// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <string>
#include <utility>

#include "core/dds/middleware.h"
#include "core/ros2/messages.h"

namespace citylearn {

/// The server of a service of ROS 2, in CDR bytes. It answers clients of rmw_fastrtps over Fast DDS, and those of
/// rmw_cyclonedds over either vendor. Used by the participant's thread.
class Ros2Server {
 public:
  /// `middleware`: the name of that which `requests` and `replies` are of. `service`: its name, for messages.
  Ros2Server(std::string service, const std::string& middleware, std::unique_ptr<Subscription> requests,
             std::unique_ptr<Publisher> replies);

  /// Takes the next request. Returns false when there is none.
  bool take(Bytes& request);
  /// Answers the request that was taken last.
  void reply(const Bytes& response);
  /// Logs, the first time, that a request cannot be read.
  void log_unreadable();

 private:
  struct Reply {
    Clock::time_point until;
    Bytes bytes;
  };
  void send_replies();

  std::string service_;
  std::size_t identity_bytes_;  // in front of a request that names its call as the middleware does
  std::unique_ptr<Subscription> requests_;
  std::unique_ptr<Publisher> replies_;
  std::deque<Reply> waiting_;
  Bytes identity_;  // of the request that was taken last, after an encapsulation
  bool logged_ = false;
};

/// A service that a node of ROS 2 offers. Used by the participant's thread, and not after it.
template <class Request, class Response>
class Ros2Service {
 public:
  explicit Ros2Service(Ros2Server server) : server_(std::move(server)) {}

  /// Answers each call that has come: `answer(request)` returns the response, also to null: to a request that cannot be
  /// read.
  template <class Answer>
  void serve(const Answer& answer) {
    while (server_.take(bytes_)) {
      Request request;
      bool readable = decode_ros2(bytes_, request);
      if (readable) {
        encode_ros2(request, encoded_);
        readable = bytes_.size() < encoded_.size() + 4;  // some pad to multiples of 4
      }
      if (!readable) server_.log_unreadable();
      const Response response = answer(readable ? &request : nullptr);
      encode_ros2(response, encoded_);
      server_.reply(encoded_);
    }
  }

 private:
  Ros2Server server_;
  Bytes bytes_, encoded_;
};

}  // namespace citylearn
