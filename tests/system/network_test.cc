// Hosts of their own, a real packet size, no multicast: how services find each other there, and what loss and
// partitions do. The longer ones are in network_long_test.cc.
#include <gtest/gtest.h>

#include <regex>

#include "tests/support/hosts.h"
#include "tests/support/wait.h"

namespace citylearn {
namespace {

using namespace std::chrono_literals;
using testing::Folder;
using testing::Hosts;
using testing::kPatience;
using testing::Service;

using Arguments = std::vector<std::string>;

/// The number behind `text` in what a service said; -1 when it did not.
double number_after(const std::string& output, const std::string& text) {
  const std::size_t at = output.find(text);
  return at == std::string::npos ? -1 : std::atof(output.c_str() + at + text.size());
}

class Network : public ::testing::Test {
 protected:
  void SetUp() override {
    if (const std::string reason = Hosts::unavailable(); !reason.empty()) GTEST_SKIP() << reason;
  }

  /// `role` of network_peer, on a host.
  std::unique_ptr<Service> peer(const Hosts& hosts, int host, const std::string& vendor, const std::string& role,
                                const Arguments& more) {
    Arguments command = {
        NETWORK_PEER, role,          "--middleware",    vendor, "--id", "peer-" + std::to_string(host), "--domain",
        "2",          "--interface", Hosts::interface()};
    command.insert(command.end(), more.begin(), more.end());
    return hosts.start(host, command, folder_ / ("peer-" + std::to_string(++count_) + ".log"));
  }
  const Folder folder_;
  int count_ = 0;
};

class Vendor : public Network, public ::testing::WithParamInterface<std::string> {};
INSTANTIATE_TEST_SUITE_P(All, Vendor, ::testing::Values("cyclonedds", "fastdds"),
                         [](const auto& param_info) { return param_info.param; });

/// Writer's and reader's vendor, or the first and the other hosts'.
class Pairing : public Network, public ::testing::WithParamInterface<std::tuple<std::string, std::string>> {
 protected:
  const std::string& one() const { return std::get<0>(GetParam()); }
  const std::string& other() const { return std::get<1>(GetParam()); }
};
const auto kVendors = ::testing::Values("cyclonedds", "fastdds");
INSTANTIATE_TEST_SUITE_P(All, Pairing, ::testing::Combine(kVendors, kVendors), [](const auto& param_info) {
  return std::get<0>(param_info.param) + "_" + std::get<1>(param_info.param);
});

TEST_P(Pairing, ThreeHostsMeetWithinThreeSeconds) {
  const Hosts hosts(3);
  const std::string all = Hosts::address(0) + "," + Hosts::address(1) + "," + Hosts::address(2);
  std::vector<std::unique_ptr<Service>> peers;
  for (int host = 0; host < 3; ++host)
    peers.push_back(peer(hosts, host, host == 0 ? one() : other(), "meet", {"--others", "2", "--peers", all}));
  for (const auto& each : peers) {
    ASSERT_TRUE(each->says("met 2 in ", kPatience)) << each->output();
    EXPECT_LT(number_after(each->output(), "met 2 in "), 3) << each->output();
    EXPECT_EQ(each->output().find("nobody answers"), std::string::npos) << each->output();
  }
}

TEST_P(Vendor, AWrongPeerIsNamedWithinFiveSeconds) {
  const Hosts hosts(3);
  const std::string late = Hosts::address(2);
  const auto first = peer(hosts, 0, GetParam(), "meet", {"--peers", Hosts::address(1) + ",10.77.0.99," + late});
  const auto second = peer(hosts, 1, GetParam(), "meet", {"--peers", Hosts::address(0)});
  EXPECT_TRUE(first->says("peer '10.77.0.99': nobody answers at 10.77.0.99", 5s)) << first->output();
  EXPECT_TRUE(first->says("peer '" + late + "': nobody answers", 1s)) << first->output();
  EXPECT_EQ(first->output().find("peer '" + Hosts::address(1)), std::string::npos) << first->output();
  EXPECT_TRUE(first->says("met 1 in ", kPatience)) << first->output();
  const auto third = peer(hosts, 2, GetParam(), "meet", {"--peers", Hosts::address(0)});
  EXPECT_TRUE(first->says("peer '" + late + "': answers at " + late + " after all", kPatience)) << first->output();
}

TEST_P(Vendor, OnlyInterfacesThatWereNamedAreUsed) {
  const Hosts hosts(2, 3);
  const auto meet = [&](const std::string& interfaces, int network) {
    const auto first =
        peer(hosts, 0, GetParam(), "meet", {"--interface", interfaces, "--peers", Hosts::address(1, network)});
    const auto second =
        peer(hosts, 1, GetParam(), "meet", {"--interface", interfaces, "--peers", Hosts::address(0, network)});
    EXPECT_TRUE(first->says("met 1 in ", kPatience)) << first->output();
    EXPECT_TRUE(second->says("met 1 in ", kPatience)) << second->output();
  };
  meet("net0", 0);
  EXPECT_GT(hosts.packets(0, 0), 0);
  for (int host : {0, 1})
    for (int network : {1, 2}) EXPECT_EQ(hosts.packets(host, network), 0) << host << " " << network;
  meet("net0,net1", 1);
  EXPECT_GT(hosts.packets(0, 1), 0);
  for (int host : {0, 1}) EXPECT_EQ(hosts.packets(host, 2), 0) << host;
}

TEST_F(Network, FastHostsMeetByADiscoveryServer) {
  const std::string program = "/usr/bin/fast-discovery-server";
  if (::access(program.c_str(), X_OK) != 0) GTEST_SKIP() << "no " << program << " (fastdds-tools)";
  const Hosts hosts(3);
  const Arguments by_server = {"--discovery-server", Hosts::address(0) + "," + Hosts::address(0) + ":11999"};
  const auto first = peer(hosts, 1, "fastdds", "meet", by_server);
  EXPECT_TRUE(first->says("peer '" + Hosts::address(0) + "': nobody answers", 5s)) << first->output();
  const auto server =
      hosts.start(0, {program, "-i", "0", "-l", Hosts::address(0), "-p", "11811"}, folder_ / "server.log");
  const auto second = peer(hosts, 2, "fastdds", "meet", {"--discovery-server", Hosts::address(0)});
  for (const auto* each : {&first, &second}) EXPECT_TRUE((*each)->says("met 1 in ", kPatience)) << (*each)->output();
  EXPECT_LT(number_after(second->output(), "met 1 in "), 3);
  EXPECT_TRUE(first->says("after all", kPatience)) << first->output();
}

// 1 MB at 30 Hz for 3 s through packets of 1500 bytes.
TEST_P(Pairing, LargeSamplesArriveWholeThoughOnePacketInTwentyIsLost) {
  Hosts hosts(2);
  hosts.lose(5);
  const auto reader = peer(hosts, 1, other(), "receive", {"--peers", Hosts::address(0)});
  const auto writer = peer(hosts, 0, one(), "send", {"--peers", Hosts::address(1)});
  ASSERT_TRUE(reader->says("received ", 60s)) << reader->output() << writer->output();
  EXPECT_NE(reader->output().find("received 90 of 90 whole and in order, 0 not"), std::string::npos)
      << reader->output();
  RecordProperty("delays", reader->output());
}

}  // namespace
}  // namespace citylearn
