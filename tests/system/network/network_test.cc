// SPDX-License-Identifier: Apache-2.0
// Hosts of their own, a real packet size, no multicast: how services find each other there, and what loss and
// partitions do. Suites whose name begins with Long are for `./run test --long`.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/paths.h"
#include "tests/support/processes/hosts.h"
#include "tests/support/records/episodes_csv.h"
#include "tests/support/text.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

using namespace std::chrono_literals;

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
    const Arguments command = on_host({NETWORK_PEER, role, "--id", "peer-" + std::to_string(host)}, vendor);
    return hosts.start(host, command + more, folder_ / ("peer-" + std::to_string(++count_) + ".log"));
  }
  /// The command with what every service on a host needs; `peers`: none.
  static Arguments on_host(Arguments command, const std::string& vendor, const std::string& peers = "") {
    command.insert(command.end(), {"--middleware", vendor, "--domain", "2", "--interface", Hosts::interface()});
    if (!peers.empty()) command.insert(command.end(), {"--peers", peers});
    return command;
  }
  const Folder folder_;
  int count_ = 0;
};

class Vendor : public Network, public ::testing::WithParamInterface<std::string> {};
INSTANTIATE_TEST_SUITE_P(Hosts, Vendor, ::testing::Values("cyclonedds", "fastdds"),
                         [](const auto& param_info) { return param_info.param; });

/// Writer's and reader's vendor, or the first and the other hosts'.
class Pairing : public Network, public ::testing::WithParamInterface<std::tuple<std::string, std::string>> {
 protected:
  const std::string& one() const { return std::get<0>(GetParam()); }
  const std::string& other() const { return std::get<1>(GetParam()); }
};
const auto kVendors = ::testing::Values("cyclonedds", "fastdds");
INSTANTIATE_TEST_SUITE_P(Hosts, Pairing, ::testing::Combine(kVendors, kVendors), [](const auto& param_info) {
  return std::get<0>(param_info.param) + "_" + std::get<1>(param_info.param);
});

// A test that was killed leaves namespaces, and what ran there; the next one clears them.
TEST_F(Network, HostsOfAKilledTestAreCleared) {
  const std::string report = folder_ / "child";
  const pid_t child = ::fork();
  if (child == 0) {
    const Hosts hosts(1);
    (void)hosts.start(0, {NETWORK_PEER, "meet", "--domain", "2", "--interface", Hosts::interface()}, report).release();
    ::_exit(0);
  }
  ASSERT_GT(child, 0);
  ::waitpid(child, nullptr, 0);
  const std::string name = "citylearn-" + std::to_string(child) + "-0";
  ASSERT_TRUE(poll_until([&] { return !shell("ip netns pids " + name).empty(); }, 5s));
  const int process = std::stoi(shell("ip netns pids " + name));
  const Hosts hosts(1);
  EXPECT_FALSE(contains(shell("ip netns list"), name));
  EXPECT_TRUE(poll_until([&] { return !std::filesystem::exists("/proc/" + std::to_string(process) + "/exe"); }, 5s));
}

TEST_P(Pairing, ThreeHostsMeetWithinThreeSeconds) {
  const Hosts hosts(3);
  const std::string all = Hosts::address(0) + "," + Hosts::address(1) + "," + Hosts::address(2);
  std::vector<std::unique_ptr<Service>> peers;
  for (int host = 0; host < 3; ++host)
    peers.push_back(peer(hosts, host, host == 0 ? one() : other(), "meet", {"--others", "2", "--peers", all}));
  for (const auto& each : peers) {
    ASSERT_TRUE(each->says("met 2 in ", kMaxWait)) << each->output();
    EXPECT_LT(number_after(each->output(), "met 2 in "), 3) << each->output();
    EXPECT_FALSE(contains(each->output(), "no answer at"));
  }
}

TEST_P(Vendor, AWrongPeerIsNamedWithinFiveSeconds) {
  const Hosts hosts(3);
  const std::string late = Hosts::address(2);
  const auto first = peer(hosts, 0, GetParam(), "meet", {"--peers", Hosts::address(1) + ",10.77.0.99," + late});
  const auto second = peer(hosts, 1, GetParam(), "meet", {"--peers", Hosts::address(0)});
  EXPECT_TRUE(first->says("peer '10.77.0.99': no answer at 10.77.0.99", 5s)) << first->output();
  EXPECT_TRUE(first->says("peer '" + late + "': no answer at", 1s)) << first->output();
  EXPECT_FALSE(contains(first->output(), "peer '" + Hosts::address(1)));
  EXPECT_TRUE(first->says("met 1 in ", kMaxWait)) << first->output();
  const auto third = peer(hosts, 2, GetParam(), "meet", {"--peers", Hosts::address(0)});
  EXPECT_TRUE(first->says("peer '" + late + "': answers at " + late + " after all", kMaxWait)) << first->output();
}

TEST_P(Vendor, OnlyInterfacesThatWereNamedAreUsed) {
  const Hosts hosts(2, 3);
  const auto meet = [&](const std::string& interfaces, int network) {
    const auto first =
        peer(hosts, 0, GetParam(), "meet", {"--interface", interfaces, "--peers", Hosts::address(1, network)});
    const auto second =
        peer(hosts, 1, GetParam(), "meet", {"--interface", interfaces, "--peers", Hosts::address(0, network)});
    EXPECT_TRUE(first->says("met 1 in ", kMaxWait)) << first->output();
    EXPECT_TRUE(second->says("met 1 in ", kMaxWait)) << second->output();
  };
  meet("net0", 0);
  EXPECT_GT(hosts.packets(0, 0), 0);
  for (int host : {0, 1})
    for (int network : {1, 2}) EXPECT_EQ(hosts.packets(host, network), 0) << host << " " << network;
  meet("lo,net0", 0);
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
  EXPECT_TRUE(first->says("peer '" + Hosts::address(0) + "': no answer at", 5s)) << first->output();
  const auto server =
      hosts.start(0, {program, "-i", "0", "-l", Hosts::address(0), "-p", "11811"}, folder_ / "server.log");
  const auto second = peer(hosts, 2, "fastdds", "meet", {"--discovery-server", Hosts::address(0)});
  for (const auto* each : {&first, &second}) EXPECT_TRUE((*each)->says("met 1 in ", kMaxWait)) << (*each)->output();
  EXPECT_LT(number_after(second->output(), "met 1 in "), 3);
  EXPECT_TRUE(first->says("after all", kMaxWait)) << first->output();
}

// One lost packet must not keep a service's end from the others.
TEST_P(Pairing, ThoseWhoLeaveAreHeardThoughOnePacketInFiveIsLost) {
  Hosts hosts(2);
  const auto stays = peer(hosts, 0, other(), "meet", {"--others", "12", "--peers", Hosts::address(1)});
  const auto leave = peer(hosts, 1, one(), "leave", {"--count", "12", "--peers", Hosts::address(0)});
  ASSERT_TRUE(stays->says("met 12 in ", kMaxWait)) << stays->output() << leave->output();
  hosts.lose(20);
  leave->send(SIGTERM);
  EXPECT_TRUE(stays->says("12 have left", kMaxWait)) << stays->output() << leave->output();
}

// 1 MB at 30 Hz for 3 s through packets of 1500 bytes.
TEST_P(Pairing, LargeSamplesArriveWholeThoughOnePacketInTwentyIsLost) {
  Hosts hosts(2);
  hosts.lose(5);
  const auto reader = peer(hosts, 1, other(), "receive", {"--peers", Hosts::address(0)});
  const auto writer = peer(hosts, 0, one(), "send", {"--peers", Hosts::address(1)});
  ASSERT_TRUE(reader->says("received ", 60s)) << reader->output() << writer->output();
  EXPECT_TRUE(contains(reader->output(), "received 90 of 90 whole and in order, 0 not"));
  RecordProperty("delays", reader->output());
}

// A peer that was not configured for packets of 1500 bytes sends larger messages, which the kernel cuts.
TEST_P(Vendor, SamplesOfAPeerWithItsOwnSizesComeAtOnce) {
  const Hosts hosts(2);
  const auto reader =
      peer(hosts, 1, GetParam(), "receive", {"--peers", Hosts::address(0), "--size", "8192", "--count", "30"});
  const auto writer = peer(hosts, 0, "cyclonedds", "send",
                           {"--own-sizes", "--peers", Hosts::address(1), "--size", "8192", "--count", "30"});
  ASSERT_TRUE(reader->says("received ", kMaxWait)) << reader->output() << writer->output();
  EXPECT_TRUE(contains(reader->output(), "received 30 of 30 whole and in order, 0 not"));
  EXPECT_LT(number_after(reader->output(), "median "), 50 * kSlowness) << reader->output();
}

// A participant's announcement is larger than the smallest packets.
TEST_P(Vendor, HostsMeetThroughPacketsOfAnySize) {
  for (const int size : {576, 1280, 9000}) {
    const Hosts hosts(2);
    for (const int host : {0, 1}) hosts.run(host, "ip link set " + Hosts::interface() + " mtu " + std::to_string(size));
    const std::string longest(63, 'x');
    const auto first = peer(hosts, 0, GetParam(), "meet", {"--peers", Hosts::address(1), "--id", longest + "1"});
    const auto second = peer(hosts, 1, GetParam(), "meet", {"--peers", Hosts::address(0), "--id", longest + "2"});
    for (const auto* each : {&first, &second})
      EXPECT_TRUE((*each)->says("met 1 in ", kMaxWait)) << size << (*each)->output();
  }
}

/// Returns what the doctor on host 0 says about a peer. It must report a problem.
std::string diagnosis(const Hosts& hosts, const Folder& folder, const std::string& vendor, const std::string& peer) {
  const auto doctor = hosts.start(0,
                                  {CITYLEARN_DOCTOR, "--seconds", "2", "--middleware", vendor, "--domain", "2",
                                   "--interface", Hosts::interface(), "--peers", peer},
                                  folder / "doctor.log");
  EXPECT_EQ(doctor->wait(kMaxWait), 1) << doctor->output();
  return doctor->output();
}

TEST_P(Vendor, TheDoctorTellsAMissingHostASilentOneAndOneWithoutServices) {
  Hosts hosts(2);
  const std::string there = Hosts::address(1);
  EXPECT_TRUE(contains(diagnosis(hosts, folder_, GetParam(), "10.77.0.99"), "no host answers at 10.77.0.99"));
  const std::string empty = diagnosis(hosts, folder_, GetParam(), there);
  EXPECT_TRUE(contains(empty, "nothing listens on its UDP port 7910"));
  EXPECT_TRUE(contains(empty, "no participant was heard in domain 2"));
  const auto service = peer(hosts, 1, GetParam(), "meet", {"--peers", Hosts::address(0)});
  hosts.wall_off(1);
  const std::string walled = diagnosis(hosts, folder_, GetParam(), there);
  EXPECT_TRUE(contains(walled, "a firewall between? open UDP ports 7910..8005"));
}

TEST_P(Pairing, TheDoctorNamesWhoIsHeard) {
  const Hosts hosts(2);
  const auto service = peer(hosts, 1, other(), "meet", {"--peers", Hosts::address(0), "--session", "stroll"});
  const auto doctor = hosts.start(0,
                                  {CITYLEARN_DOCTOR, "--seconds", "3", "--json", "--middleware", one(), "--domain", "2",
                                   "--interface", Hosts::interface(), "--peers", Hosts::address(1)},
                                  folder_ / "doctor.log");
  ASSERT_EQ(doctor->wait(kMaxWait), 0) << doctor->output();
  const auto found = nlohmann::json::parse(doctor->output());
  ASSERT_EQ(found["participants"].size(), 1u) << found;
  EXPECT_EQ(found["participants"][0]["name"], "peer-1");
  EXPECT_EQ(found["participants"][0]["vendor"], other());
  EXPECT_EQ(found["participants"][0]["addresses"], nlohmann::json({Hosts::address(1)}));
  ASSERT_EQ(found["services"].size(), 1u) << found;
  EXPECT_EQ(found["services"][0]["id"], "peer-1");
  EXPECT_EQ(found["services"][0]["session"], "stroll");
  EXPECT_EQ(found["services"][0]["state"], "running");
  EXPECT_NEAR(found["services"][0]["clock_ahead"].get<double>(), 0, 0.5);
}

/// A training of place_filter: env_services of the drawn city on hosts of their own, a policy_service on host 0.
class Training : public Network, public ::testing::WithParamInterface<std::tuple<std::string, std::string>> {
 protected:
  std::unique_ptr<Service> env(const Hosts& hosts, int host) {
    const std::string id = "env-" + std::to_string(++count_);
    const Arguments command = {
        CITYLEARN_ENV_SERVICE, "--traversal", "summer", "--id", id, "--agents", "8", "--synthetic-images", "0",
        "--synthetic-frames",  "160"};
    return hosts.start(host, on_host(command, std::get<0>(GetParam()), Hosts::address(0)), folder_ / (id + ".log"));
  }
  std::unique_ptr<Service> policy(const Hosts& hosts, const std::string& output, int steps,
                                  const Arguments& more = {}) {
    const Arguments command = on_host(
        {CITYLEARN_POLICY_SERVICE, "--agent", "place_filter", "--environments", "4", "--steps", std::to_string(steps),
         "--tasks", "200", "--evaluate", "summer", "--wait", "60", "--output", folder_ / output},
        std::get<1>(GetParam()), Hosts::address(1) + "," + Hosts::address(2));
    return hosts.start(0, command + more, folder_ / (output + ".log"));
  }
  /// Steps trained up to now.
  double progress(const std::string& output) const {
    auto rows = csv_rows(folder_ / (output + "/metrics.csv"));
    if (!contents(folder_ / (output + "/metrics.csv")).ends_with('\n') && !rows.empty()) rows.pop_back();
    return rows.empty() ? 0 : std::stod(rows.back().at(1));
  }
  void expect_rejoined(std::chrono::seconds apart) {
    Hosts hosts(2);
    const auto environment = env(hosts, 1);
    const auto learner = policy(hosts, "out", 1,
                                {"--environments", "1", "--steps", "100000000", "--time-limit",
                                 std::to_string(apart.count() + 8), "--peers", Hosts::address(1)});
    ASSERT_TRUE(poll_until([&] { return progress("out") > 0; }, 60s)) << learner->output();
    hosts.cut(0, 1);
    ASSERT_FALSE(learner->wait(apart)) << learner->output();
    const double before = progress("out");
    ASSERT_FALSE(learner->wait(200ms));
    EXPECT_EQ(progress("out"), before);  // it was cut off
    hosts.heal();
    const Clock::time_point healed = Clock::now();
    EXPECT_TRUE(poll_until([&] { return progress("out") > before; }, 10s)) << learner->output();
    RecordProperty("rejoined_after", std::to_string(std::chrono::duration<double>(Clock::now() - healed).count()));
    ASSERT_EQ(learner->wait(60s), 0) << learner->output();
    EXPECT_GE(expect_all_episodes("out"), 200);
    EXPECT_FALSE(environment->wait(0ms)) << environment->output();
  }

  /// Every env_service's episodes are there, numbered without a gap, none twice; returns how many.
  int expect_all_episodes(const std::string& output) const {
    const std::string log = folder_ / (output + "/episodes.csv");
    expect_no_gaps(in_csv(log));
    const auto rows = csv_rows(log);
    EXPECT_EQ(std::count_if(rows.begin(), rows.end(), [](const auto& row) { return row.at(5) == "1"; }), 200);
    return static_cast<int>(rows.size());
  }
};
const auto kPairings = ::testing::Values(std::tuple("cyclonedds", "cyclonedds"), std::tuple("fastdds", "fastdds"),
                                         std::tuple("cyclonedds", "fastdds"));
std::string pairing_name(const ::testing::TestParamInfo<std::tuple<std::string, std::string>>& info) {
  return std::get<0>(info.param) + "_" + std::get<1>(info.param);
}
INSTANTIATE_TEST_SUITE_P(Hosts, Training, kPairings, pairing_name);

TEST_P(Training, LosesNoEpisodeWhenOnePacketInTwentyIsLost) {
  Hosts hosts(3);
  std::vector<std::unique_ptr<Service>> envs;
  for (const int host : {1, 2, 1, 2}) envs.push_back(env(hosts, host));
  const auto learner = policy(hosts, "out", 100'000);
  ASSERT_TRUE(poll_until([&] { return progress("out") > 0; }, 60s)) << learner->output();
  hosts.lose(5);
  ASSERT_EQ(learner->wait(60s), 0) << learner->output();
  EXPECT_GE(expect_all_episodes("out"), 400);
}

// The only env_service is cut off from the policy_service. Both stay, and go on when they hear each other again.
TEST_P(Training, GoesOnAfterAPartition) { expect_rejoined(4s); }

class LongPartition : public Training {};
INSTANTIATE_TEST_SUITE_P(Hosts, LongPartition, kPairings, pairing_name);

// Longer than the participants' leases: each has forgotten the other.
TEST_P(LongPartition, OfThirtySecondsIsOverWithinTen) { expect_rejoined(30s); }

}  // namespace
}  // namespace citylearn::testing
