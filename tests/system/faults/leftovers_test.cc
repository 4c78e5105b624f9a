// SPDX-License-Identifier: Apache-2.0
// What killed services leave behind: nothing that grows, and nothing that the next start must wait for.
#include <gtest/gtest.h>

#include "dashboard/store/database.h"
#include "tests/support/processes/private_machine.h"
#include "tests/support/processes/trial.h"

namespace citylearn::testing {
namespace {

constexpr seconds kLongWait{60}, kPromptWait{10};
constexpr int kRounds = 10;

/// Files of shared memory, and their bytes.
std::pair<int, std::uintmax_t> shared_memory() {
  std::pair<int, std::uintmax_t> found{0, 0};
  for (const auto& entry : std::filesystem::directory_iterator("/dev/shm")) {
    ++found.first;
    if (entry.is_regular_file()) found.second += entry.file_size();
  }
  return found;
}

/// Sockets that are bound in this machine, but for TCP connections that wait for their end.
std::string sockets() {
  std::string found;
  for (const std::string protocol : {"udp", "udp6", "tcp", "tcp6"}) {
    std::istringstream lines(contents("/proc/net/" + protocol));
    std::string line, number, local, remote, state;
    std::getline(lines, line);
    while (std::getline(lines, line)) {
      std::istringstream fields(line);
      fields >> number >> local >> remote >> state;
      if (protocol.starts_with("udp") || state == "0A") found += protocol + " " + local + "\n";
    }
  }
  return found;
}

std::int64_t recorded(const std::string& store) {
  try {
    return open_database(store).execAndGet("SELECT COUNT(*) FROM episodes").getInt64();
  } catch (const std::exception&) {  // not made yet
    return 0;
  }
}

class Leftovers : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(, Leftovers, ::testing::Values("fastdds"),
                         [](const auto& vendor) { return std::string(vendor.param); });
INSTANTIATE_TEST_SUITE_P(Long, Leftovers, ::testing::Values("cyclonedds"),
                         [](const auto& vendor) { return std::string(vendor.param); });

TEST_P(Leftovers, AllServicesKilledTenTimesLeaveNothing) {
  if (!enter_private_machine()) GTEST_SKIP() << "only root may have a network of its own";
  Trial run(GetParam(), 0);
  const std::string store = run.folder() / "dashboard.sqlite", out = run.folder() / "out";
  std::pair<int, std::uintmax_t> first;
  for (int round = 0; round < kRounds; ++round) {
    const std::string before = run.checkpoint("out").first;
    const std::int64_t rows = recorded(store);
    // The same port each time.
    const auto dashboard = run.dashboard({"--store", store, "--port", "18080"});
    const auto encoder = run.encoder({"--encoder", "hog"});
    const auto env = run.env("summer", {"--recorders", "dashboard", "--dataset", "synthetic", "--frames", "0:80"});
    const auto policy = run.policy({"--agent", "place_filter", "--steps", "1000000000", "--checkpoint-every", "2",
                                    "--output", out, "--evaluate", "summer", "--frames", "0:80", "--resume"});
    const std::vector<Service*> all = {dashboard.get(), encoder.get(), env.get(), policy.get()};
    const auto works = [&] { return run.checkpoint("out").first != before && recorded(store) > rows; };
    ASSERT_TRUE(poll_until(works, round == 0 ? kLongWait : kPromptWait))
        << "start " << round << "\n"
        << dashboard->output() << encoder->output() << env->output() << policy->output();
    for (Service* service : all) service->send(SIGKILL);
    for (Service* service : all) ASSERT_EQ(service->wait(kLongWait), 128 + SIGKILL) << service->output();
    EXPECT_EQ(sockets(), "") << "after start " << round;
    if (round == 0) first = shared_memory();
  }
  EXPECT_EQ(shared_memory(), first);
  // Temporary files of the last one alone, at most: the next start removes them.
  const auto resumed = run.policy({"--agent", "place_filter", "--output", out, "--resume", "--wait", "1"});
  EXPECT_EQ(resumed->wait(kLongWait), 1) << resumed->output();
  for (const auto& entry : std::filesystem::recursive_directory_iterator(out))
    EXPECT_NE(entry.path().extension(), ".tmp") << entry.path();
}

}  // namespace
}  // namespace citylearn::testing
