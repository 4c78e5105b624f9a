// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastrtps/utils/IPLocator.h>

#include <memory>
#include <utility>

namespace citylearn::internal {

namespace fast = eprosima::fastdds::rtps;

/// Describes Fast DDS's UDP transport with two differences. It sends to no multicast address that others announce,
/// because Fast DDS 2.9 was seen to end its process beside ordinary readers of other makes. And it cuts what it sends
/// to `largest_sent` bytes, while it receives all that `udp` allows, as peers with other settings send more. Fast's own
/// descriptor has one limit for both.
struct UnicastDescriptor : fast::ChainingTransportDescriptor {
  UnicastDescriptor(std::shared_ptr<TransportDescriptorInterface> udp, std::uint32_t largest, fast::Locator multicast)
      : ChainingTransportDescriptor(std::move(udp)), largest_sent(largest), announced_at(std::move(multicast)) {}
  fast::TransportInterface* create_transport() const override;
  std::uint32_t max_message_size() const override { return largest_sent; }

  std::uint32_t largest_sent;
  fast::Locator announced_at;  ///< the one multicast address at which participants are announced; invalid: none
};

class UnicastTransport : public fast::ChainingTransport {
 public:
  using Locator = fast::Locator;

  explicit UnicastTransport(const UnicastDescriptor& descriptor)
      : ChainingTransport(descriptor), descriptor_(descriptor) {}
  fast::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }
  /// Fast DDS asks this of every address that it may send to, and leaves out those for which it is false.
  bool transform_remote_locator(const Locator& remote, Locator& result) const override {
    const bool sent_to =
        !eprosima::fastrtps::rtps::IPLocator::isMulticast(remote) || remote == descriptor_.announced_at;
    return sent_to && ChainingTransport::transform_remote_locator(remote, result);
  }
  /// Hands out UDP's own senders. UDP would not know wrapped ones again and open a second one for each interface.
  bool OpenOutputChannel(fast::SendResourceList& senders, const Locator& locator) override {
    return low_level_transport_->OpenOutputChannel(senders, locator);
  }
  bool send(eprosima::fastrtps::rtps::SenderResource* sender, const std::uint8_t* data, std::uint32_t size,
            fast::LocatorsIterator* begin, fast::LocatorsIterator* end,
            const std::chrono::steady_clock::time_point& deadline) override {
    return sender->send(data, size, begin, end, deadline);
  }
  void receive(fast::TransportReceiverInterface* next, const std::uint8_t* data, std::uint32_t size,
               const Locator& local, const Locator& remote) override {
    next->OnDataReceived(data, size, local, remote);
  }

 private:
  UnicastDescriptor descriptor_;
};

inline fast::TransportInterface* UnicastDescriptor::create_transport() const { return new UnicastTransport(*this); }

}  // namespace citylearn::internal
