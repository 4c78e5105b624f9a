// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/service.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/dds/request_identity.h"

namespace citylearn {
namespace {

/// What rmw_cyclonedds puts in front of request and reply (cdds_request_header_t): the client's number and the call's.
constexpr std::size_t kCycloneHeader = 16;

/// How long a reply waits for its client's reader, which may be discovered after its writer; as in ROS 2's layers.
constexpr std::chrono::milliseconds kMatchTimeout{100};

bool is_of_cyclonedds(const Bytes& request) {  // RTPS 2.2, 9.3.1.5: a GUID begins with its vendor's number
  return request[kIdentityOffset] == std::byte{0x01} && request[kIdentityOffset + 1] == std::byte{0x10};
}

}  // namespace

Ros2Server::Ros2Server(std::string service, const std::string& middleware, std::unique_ptr<Subscription> requests,
                       std::unique_ptr<Publisher> replies)
    : service_(std::move(service)),
      identity_bytes_(middleware.ends_with("fastdds") ? sizeof(RequestIdentity) : kCycloneHeader),
      requests_(std::move(requests)),
      replies_(std::move(replies)) {}

bool Ros2Server::take(Bytes& request) {
  send_replies();
  while (requests_->take(request)) {
    std::size_t end = kIdentityOffset + identity_bytes_;
    if (request.size() >= end && identity_bytes_ > kCycloneHeader && is_of_cyclonedds(request)) end += kCycloneHeader;
    if (request.size() < end || request[0] != std::byte{0} || request[1] > std::byte{1}) {
      log_unreadable();  // nobody knows whose it is
      continue;
    }
    const auto content = request.begin() + static_cast<std::ptrdiff_t>(end);
    identity_.assign(request.begin() + kIdentityOffset, content);
    if (request[1] == std::byte{0} &&
        end != kIdentityOffset + sizeof(RequestIdentity))  // big endian; replies are little
      for (auto number = identity_.end() - kCycloneHeader; number != identity_.end(); number += 8)
        std::reverse(number, number + 8);
    request.erase(request.begin() + kIdentityOffset, content);
    return true;
  }
  return false;
}

void Ros2Server::reply(const Bytes& response) {
  Reply reply{Clock::now() + kMatchTimeout, response};
  reply.bytes.insert(reply.bytes.begin() + kIdentityOffset, identity_.begin(), identity_.end());
  waiting_.push_back(std::move(reply));
  send_replies();
}

void Ros2Server::send_replies() {
  while (!waiting_.empty() && (replies_->matched() >= requests_->matched() || Clock::now() >= waiting_.front().until)) {
    replies_->publish(waiting_.front().bytes);
    waiting_.pop_front();
  }
}

void Ros2Server::log_unreadable() {
  if (!std::exchange(logged_, true))
    spdlog::warn(
        "{}: a call cannot be read: it is damaged, or of a client over another middleware; call it over this "
        "program's --ros-middleware (more are not logged)",
        service_);
}

}  // namespace citylearn
