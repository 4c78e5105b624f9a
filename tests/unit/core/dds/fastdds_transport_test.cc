// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "core/dds/middleware_fastdds_transport.h"

namespace citylearn::internal {
namespace {

namespace rtps = fast::transport;

rtps::Locator at(const std::string& address, std::uint32_t port) {
  rtps::Locator locator;
  fast::rtps::IPLocator::createLocator(LOCATOR_KIND_UDPv4, address, port, locator);
  return locator;
}

std::unique_ptr<rtps::TransportInterface> transport(const rtps::Locator& announced_at = {}) {
  const auto udp = std::make_shared<rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList = {"127.0.0.1"};
  std::unique_ptr<rtps::TransportInterface> made(UnicastDescriptor(udp, 1472, announced_at).create_transport());
  EXPECT_TRUE(made->init());
  return made;
}

/// Asks as Fast DDS asks: release 3 says in addition that both sides may use the loopback.
bool is_sent_to(const rtps::TransportInterface& transport, const rtps::Locator& locator) {
  rtps::Locator result;
#if CITYLEARN_FASTDDS_RELEASE == 2
  const bool sent = transport.transform_remote_locator(locator, result);
#else
  const bool sent = transport.transform_remote_locator(locator, result, true, true);
#endif
  return sent && result == locator;
}

TEST(FastddsTransport, PassesOnUnicastAddressesAlone) {
  const auto unicast = transport();
  EXPECT_TRUE(is_sent_to(*unicast, at("10.1.2.3", 7411)));
  EXPECT_TRUE(is_sent_to(*unicast, at("127.0.0.1", 7411)));
  for (const char* multicast : {"239.255.0.1", "224.0.0.1", "239.255.255.255", "225.1.2.3"})
    for (const std::uint32_t port : {7400u, 7401u})
      EXPECT_FALSE(is_sent_to(*unicast, at(multicast, port))) << multicast;
}

TEST(FastddsTransport, AnnouncesAtTheOneMulticastAddressThatItWasGiven) {
  const auto announcing = transport(at("239.255.0.1", 7400));
  EXPECT_TRUE(is_sent_to(*announcing, at("239.255.0.1", 7400)));
  EXPECT_TRUE(is_sent_to(*announcing, at("10.1.2.3", 7411)));
  EXPECT_FALSE(is_sent_to(*announcing, at("239.255.0.1", 7401))) << "where readers of other vendors want samples";
  EXPECT_FALSE(is_sent_to(*announcing, at("239.255.0.2", 7400)));
}

TEST(FastddsTransport, ReceivesMoreThanItSends) {
  const auto both = transport();
  EXPECT_EQ(both->get_configuration()->max_message_size(), 1472u);
  EXPECT_EQ(both->max_recv_buffer_size(), 65500u);
}

TEST(FastddsTransport, OpensNoSecondSenderWhenItLooksForInterfacesAgain) {
  const auto transport_of_lo = transport();
  rtps::SendResourceList senders;
  ASSERT_TRUE(transport_of_lo->OpenOutputChannel(senders, at("127.0.0.1", 7411)));
  EXPECT_EQ(senders.size(), 1u);
  transport_of_lo->update_network_interfaces();
  ASSERT_TRUE(transport_of_lo->OpenOutputChannel(senders, at("127.0.0.1", 7413)));
  EXPECT_EQ(senders.size(), 1u);
}

}  // namespace
}  // namespace citylearn::internal
