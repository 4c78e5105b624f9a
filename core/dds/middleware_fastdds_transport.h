// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <utility>

#include "core/dds/middleware_fastdds_api.h"

namespace citylearn::internal {

/// Describes Fast DDS's UDP transport with two differences. It sends to no multicast address that others announce,
/// because Fast DDS 2.9 was seen to end its process beside ordinary readers of other makes. And it cuts what it sends
/// to `largest_sent` bytes, while it receives all that `udp` allows, as peers with other settings send more. Fast's own
/// descriptor has one limit for both.
struct UnicastDescriptor : fast::transport::ChainingTransportDescriptor {
  UnicastDescriptor(std::shared_ptr<TransportDescriptorInterface> udp, std::uint32_t largest,
                    fast::transport::Locator multicast)
      : ChainingTransportDescriptor(std::move(udp)), largest_sent(largest), announced_at(std::move(multicast)) {}
  fast::transport::TransportInterface* create_transport() const override;
  std::uint32_t max_message_size() const override { return largest_sent; }

  std::uint32_t largest_sent;
  /// The one multicast address at which participants are announced; invalid: none.
  fast::transport::Locator announced_at;
};

class UnicastTransport : public fast::transport::ChainingTransport {
 public:
  using Locator = fast::transport::Locator;

  explicit UnicastTransport(const UnicastDescriptor& descriptor)
      : ChainingTransport(descriptor), descriptor_(descriptor) {}
  fast::transport::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }
  /// Fast DDS asks this of every address that it may send to, and leaves out those for which it is false.
  bool transform_remote_locator(const Locator& remote, Locator& result) const override {
    return is_sent_to(remote) && (ChainingTransport::transform_remote_locator(remote, result) ||
                                  ChainingTransport::transform_remote_locator(at_loopback(remote), result));
  }
  /// Hands out UDP's own senders. UDP would not know wrapped ones again and open a second one for each interface.
  bool OpenOutputChannel(fast::transport::SendResourceList& senders, const Locator& locator) override {
    return low_level_transport_->OpenOutputChannel(senders, locator);
  }
#if CITYLEARN_FASTDDS_RELEASE == 2
  using Data = const std::uint8_t*;
#else
  using Data = const std::vector<fast::transport::NetworkBuffer>&;
  bool transform_remote_locator(const Locator& remote, Locator& result, bool remote_localhost,
                                bool local_localhost) const override {
    const auto transforms = [&](const Locator& to) {
      return ChainingTransport::transform_remote_locator(to, result, remote_localhost, local_localhost);
    };
    return is_sent_to(remote) && (transforms(remote) || transforms(at_loopback(remote)));
  }
#endif
  bool send(fast::rtps::SenderResource* sender, Data data, std::uint32_t size, fast::transport::LocatorsIterator* begin,
            fast::transport::LocatorsIterator* end, const std::chrono::steady_clock::time_point& deadline) override {
    return sender->send(data, size, begin, end, deadline);
  }
  void receive(fast::transport::TransportReceiverInterface* next, const std::uint8_t* data, std::uint32_t size,
               const Locator& local, const Locator& remote) override {
    next->OnDataReceived(data, size, local, remote);
  }

 private:
  bool is_sent_to(const Locator& remote) const {
    return !fast::rtps::IPLocator::isMulticast(remote) || remote == descriptor_.announced_at;
  }

  /// Nodes of ROS 2 that stay on this machine (ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST) give the addresses of this
  /// host's other interfaces, which UDP does not send to from loopback. They listen on loopback too.
  static Locator at_loopback(Locator remote) {
    fast::rtps::IPLocator::setIPv4(remote, 127, 0, 0, 1);
    return remote;
  }

  UnicastDescriptor descriptor_;
};

inline fast::transport::TransportInterface* UnicastDescriptor::create_transport() const {
  return new UnicastTransport(*this);
}

}  // namespace citylearn::internal
