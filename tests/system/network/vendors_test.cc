// SPDX-License-Identifier: Apache-2.0
// Every pairing of the vendors, in two processes: every message, empty and at its largest, there and back unchanged.
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <map>

#include "core/files/files.h"
#include "core/wire/node.h"
#include "tests/paths.h"
#include "tests/support/options.h"
#include "tests/support/processes/domain.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/readers.h"
#include "tests/support/text.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

/// Names as long as they may be.
std::string longest(const std::string& begin) {
  std::string name = begin + std::to_string(getpid());
  name.resize(64, '-');
  return name;
}

class Vendors : public ::testing::TestWithParam<std::tuple<std::string, std::string>> {
 protected:
  Node::Options options() {
    return {middleware_options(std::get<0>(GetParam()), domain_), "vendors_test", longest("test"), longest("run")};
  }
  const std::uint32_t domain_ = own_domain();
};

const auto kVendors = ::testing::Values("cyclonedds", "fastdds");
INSTANTIATE_TEST_SUITE_P(All, Vendors, ::testing::Combine(kVendors, kVendors), [](const auto& param_info) {
  return std::get<0>(param_info.param) + "_" + std::get<1>(param_info.param);
});

/// Sends `sent` until the peer's copy is here. What still comes of earlier messages is passed over.
template <class Message>
void expect_echo(Node& node, const Message& sent) {
  const Clock::time_point deadline = Clock::now() + kMaxWait;
  Clock::time_point send_again{};
  Message out = sent, back;
  while (Clock::now() < deadline) {
    if (Clock::now() >= send_again) {
      out = sent;
      node.publish(out);
      send_again = Clock::now() + milliseconds(200);
    }
    node.wait(send_again);
    while (node.take(back)) {
      EXPECT_EQ(back.header().sender().to_string(), longest("peer"));
      EXPECT_EQ(back.header().session().to_string(), longest("run"));
      back.header(sent.header());
      if (equal(back, sent)) return;
    }
  }
  FAIL() << topic_of<Message>().type << " did not come back";
}

TEST_P(Vendors, EveryMessageGoesThereAndBack) {
  Node node(options());
  Child peer({VENDORS_PEER, std::get<1>(GetParam()), std::to_string(domain_), longest("run"), longest("peer"),
              longest("test")});
  for_each_message([&]<class Message>() {
    create_readers_of_samples<Message>(node, longest("peer"));
    node.create_writer<Message>();
  });
  for (Size size : {Size::kMin, Size::kTypical, Size::kMax})
    for_each_message([&]<class Message>() { expect_echo(node, sample_of<Message>(size)); });
  EXPECT_EQ(node.traffic.rejected, 0u);
  EXPECT_TRUE(node.discovery().wrong_types().empty());
  EXPECT_EQ(peer.finish(seconds(5)), 0);
}

/// Binds a socket to the port at which the second participant of a domain reads what is not discovery.
int second_data_port(std::uint32_t domain) {
  const int handle = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  at.sin_port = htons(static_cast<std::uint16_t>(7413 + 250 * domain));
  const timeval patience{kMaxWait.count(), 0};
  setsockopt(handle, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  EXPECT_EQ(bind(handle, reinterpret_cast<const sockaddr*>(&at), sizeof at), 0);
  return handle;
}

TEST(FastDds, AsksAPeerThatWasKilledSeldom) {
  const std::uint32_t domain = own_domain();
  Node node({middleware_options("fastdds", domain), "vendors_test", longest("test"), longest("run")});
  Child peer({VENDORS_PEER, "cyclonedds", std::to_string(domain), longest("run"), longest("peer"), longest("test")});
  node.create_reader<msg::ActorStatus>();
  node.create_writer<msg::ActorStatus>();
  expect_echo(node, sample_of<msg::ActorStatus>(Size::kMin));  // the peer announced its writer of Scene before
  peer.send(SIGKILL);
  ASSERT_EQ(peer.finish(kMaxWait), 128 + SIGKILL);
  const int port = second_data_port(domain);
  node.create_reader<msg::Scene>();
  // ACKNACKs, behind the head of 20 bytes and the receiver's name of 16: one each 10 ms.
  constexpr std::size_t kAt = 36, kEndpoints = kAt + 4, kEnd = kEndpoints + 8, kAsked = 7;
  std::map<std::string, std::vector<Clock::time_point>> asked;  // by reader and writer
  std::vector<Clock::time_point>* times = nullptr;
  std::array<char, 1500> packet;
  while (!times || times->size() < kAsked) {
    const ssize_t size = recv(port, packet.data(), packet.size(), 0);
    ASSERT_GT(size, 0);
    if (size < static_cast<ssize_t>(kEnd) || packet[kAt] != 6) continue;
    times = &asked[std::string(packet.begin() + kEndpoints, packet.begin() + kEnd)];
    times->push_back(Clock::now());
  }
  EXPECT_GT(times->back() - times->front(), milliseconds(30));
  close(port);
}

/// Two services of a vendor in a shell in which others have configured it.
class Surrounded : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    write_file(folder_ / "cyclone.xml",
               "<CycloneDDS><Domain id=\"any\"><General><Interfaces><NetworkInterface name=\"nowhere\"/></Interfaces>"
               "</General></Domain></CycloneDDS>");
    // A publisher in a partition of its own, in a participant that listens at no address of ours.
    const std::string profiles =
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><dds><profiles "
        "xmlns=\"http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles\">"
        "<publisher profile_name=\"p\" "
        "is_default_profile=\"true\"><qos><partition><names><name>elsewhere</name></names>"
        "</partition></qos></publisher></profiles></dds>";
    write_file(folder_ / "fast.xml", profiles);
    for (const char* release : {"FASTRTPS", "FASTDDS"})  // as releases 2 and 3 of Fast DDS name it
      write_file(folder_ / ("DEFAULT_" + std::string(release) + "_PROFILES.xml"), profiles);
    write_file(folder_ / "fast.json", "{\"ROS_DISCOVERY_SERVER\": \"127.0.0.1:11998\"}");
  }
  std::unique_ptr<Service> start(const std::string& id, const Arguments& variables) {
    const Arguments peer = {NETWORK_PEER,   "meet",     "--id",     id,
                            "--middleware", GetParam(), "--domain", std::to_string(domain_)};
    return std::make_unique<Service>(Arguments{"/usr/bin/env", "-C", folder_.path()} + variables + peer,
                                     folder_ / (id + ".log"));
  }
  const Folder folder_;
  const std::uint32_t domain_ = own_domain();
};
INSTANTIATE_TEST_SUITE_P(All, Surrounded, ::testing::Values("cyclonedds", "fastdds"),
                         [](const auto& param_info) { return param_info.param; });

TEST_P(Surrounded, ServicesMeetWhateverTheEnvironmentSays) {
  const std::vector<Arguments> settings = {
      {"ROS_DISCOVERY_SERVER=127.0.0.1:11999"},
      {"FASTRTPS_DEFAULT_PROFILES_FILE=" + folder_ / "fast.xml",
       "FASTDDS_DEFAULT_PROFILES_FILE=" + folder_ / "fast.xml", "SKIP_DEFAULT_XML_FILE=1"},
      {"FASTDDS_ENVIRONMENT_FILE=" + folder_ / "fast.json", "SKIP_DEFAULT_XML_FILE=0",
       "FASTDDS_STATISTICS=HISTORY_LATENCY_TOPIC;NETWORK_LATENCY_TOPIC", "FASTDDS_BUILTIN_TRANSPORTS=SHM",
       "CYCLONEDDS_URI=" + folder_ / "cyclone.xml", "ROS_DOMAIN_ID=3", "ROS_LOCALHOST_ONLY=1",
       "RMW_IMPLEMENTATION=rmw_none", "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF", "ROS_STATIC_PEERS=10.1.1.1",
       "ROS_SUPER_CLIENT=TRUE"},
      {"CYCLONEDDS_URI=<General><MaxMessageSize>1"}};
  for (std::size_t i = 0; i < settings.size(); ++i) {
    const auto plain = start("plain-" + std::to_string(i), {"--ignore-environment"});
    const auto set = start("set-" + std::to_string(i), settings[i]);
    for (const auto* each : {&plain, &set})
      EXPECT_TRUE((*each)->says("met 1 in ", kMaxWait)) << settings[i].front() << (*each)->output();
  }
}

}  // namespace
}  // namespace citylearn::testing
