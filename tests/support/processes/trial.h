// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/paths.h"
#include "tests/support/options.h"
#include "tests/support/processes/domain.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {

inline constexpr seconds kLongWait{120};  ///< for what takes a whole run
inline constexpr seconds kShortWait{10};  ///< for what services do at once

/// Options of an env_service: pictures of the drawn city.
inline const Arguments kDrawn = {"--dataset", "synthetic", "--frames", "0:128"};

/// Runs the tests TEST_P(Suite, ...) once over each vendor.
using VendorTest = ::testing::TestWithParam<const char*>;
#define CITYLEARN_EACH_VENDOR(Suite)                                            \
  INSTANTIATE_TEST_SUITE_P(, Suite, ::testing::Values("fastdds", "cyclonedds"), \
                           [](const auto& vendor) { return std::string(vendor.param); })

/// One run in a domain of its own: a folder, its env_services, its policy_service.
class Trial {
 public:
  explicit Trial(std::string middleware, std::uint32_t domain = own_domain())
      : middleware_(std::move(middleware)), domain_(domain) {}

  std::uint32_t domain() const { return domain_; }
  MiddlewareOptions middleware() const { return middleware_options(middleware_, domain_); }
  /// Another program of the project; its log is NAME-n.log.
  std::unique_ptr<Service> program(const std::string& path, const std::string& name, const Arguments& more) {
    return start({path}, more, name + "-" + std::to_string(++count_) + ".log");
  }
  std::unique_ptr<Service> dashboard(const Arguments& more) { return program(CITYLEARN_DASHBOARD, "dashboard", more); }
  std::unique_ptr<Service> start_recorder(const std::string& store) {
    return program(RECORDER_PROCESS, "recorder", {"--store", store});
  }
  /// A recorder with this store, once it records.
  std::unique_ptr<Service> recorder(const std::string& store) {
    auto recorder = start_recorder(store);
    EXPECT_TRUE(recorder->says("records", seconds(60))) << recorder->output();
    return recorder;
  }

  std::unique_ptr<Service> env(const std::string& traversal, const Arguments& more = {}) {
    Arguments command = {CITYLEARN_ENV_SERVICE, "--traversal", traversal, "--agents", "8"};
    if (std::find(more.begin(), more.end(), "--dataset") == more.end())
      command.insert(command.end(), {"--synthetic-images", "0", "--synthetic-frames", "160"});
    return start(command, more, traversal + "-" + std::to_string(++count_) + ".log");
  }
  std::unique_ptr<Service> encoder(const Arguments& more) {
    return start({CITYLEARN_ENCODER_SERVICE, "--store", folder_ / "store"}, more,
                 "encoder-" + std::to_string(++count_) + ".log");
  }
  std::unique_ptr<Service> policy(const Arguments& more) {
    return start({CITYLEARN_POLICY_SERVICE, "--wait", "60"}, more, "policy-" + std::to_string(++count_) + ".log");
  }
  /// Training of `updates` updates of 8 agents x 64 steps; options in `more` come last, so they count.
  std::unique_ptr<Service> train(int updates, const std::string& output, const Arguments& more = {}) {
    return policy(Arguments{"--agent", "place_filter", "--steps", std::to_string(updates * 512L)} +
                  Arguments{"--checkpoint-every", "20", "--output", folder_ / output, "--tasks", "16"} +
                  Arguments{"--evaluate", "summer"} + more);
  }
  /// Name and bytes of the newest checkpoint.
  std::pair<std::string, std::string> checkpoint(const std::string& output) const {
    std::vector<std::string> found;
    if (std::filesystem::exists(folder_ / (output + "/checkpoints")))
      for (const auto& entry : std::filesystem::directory_iterator(folder_ / (output + "/checkpoints")))
        if (entry.path().extension() != ".tmp") found.push_back(entry.path());
    if (found.empty()) return {};
    std::sort(found.begin(), found.end());
    return {std::filesystem::path(found.back()).filename(), contents(found.back())};
  }
  bool has_checkpoint(const std::string& output, milliseconds patience) const {
    return poll_until([&] { return !checkpoint(output).first.empty(); }, patience);
  }
  const Folder& folder() const { return folder_; }

 private:
  std::unique_ptr<Service> start(const Arguments& command, const Arguments& more, const std::string& log) {
    const Arguments node = {"--domain", std::to_string(domain_), "--middleware", middleware_};
    return std::make_unique<Service>(command + node + more, folder_ / log);
  }
  Folder folder_;
  std::string middleware_;
  std::uint32_t domain_;
  int count_ = 0;
};

/// A policy_service's wrong arguments and what its complaint must name, by name.
using WrongInputs = std::map<std::string, std::pair<Arguments, std::string>>;

/// Each ends the policy_service soon, with one line of complaint.
inline void expect_one_clear_line(Trial& trial, const WrongInputs& cases, seconds patience = seconds(8)) {
  for (const auto& [name, wrong] : cases) {
    const auto policy = trial.policy(wrong.first);
    const auto status = policy->wait(patience);
    ASSERT_TRUE(status.has_value()) << name;
    EXPECT_TRUE(*status == 1 || *status == 2) << name << ": " << *status;
    const std::string output = policy->output();
    EXPECT_TRUE(contains(output, wrong.second)) << name;
    EXPECT_EQ(occurrences("\n" + output, "\npolicy_service: "), 1) << name << ": " << output;
  }
}

}  // namespace citylearn::testing
