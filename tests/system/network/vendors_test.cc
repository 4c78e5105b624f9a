// SPDX-License-Identifier: Apache-2.0
// Every pairing of the vendors, in two processes: every message, empty and at its largest, there and back unchanged.
#include <gtest/gtest.h>
#include <unistd.h>

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
