// SPDX-License-Identifier: Apache-2.0
#include "core/wire/service.h"

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// Returns what a service with these options writes to standard error when it logs `text`.
std::string logged(const std::string& name, std::vector<std::string> options, const std::string& text) {
  options.insert(options.begin(), name);
  std::vector<char*> arguments;
  for (std::string& option : options) arguments.push_back(option.data());
  Node::Options node;
  node.service = "env_service";
  const auto before = spdlog::default_logger();
  ::testing::internal::CaptureStderr();
  service_main(
      static_cast<int>(arguments.size()), arguments.data(), "A service.",
      [&](CLI::App& app) { add_node_options(app, node); },
      [&] {
        spdlog::warn("{}", text);
        spdlog::default_logger()->flush();
        return 0;
      });
  spdlog::set_default_logger(before);
  return ::testing::internal::GetCapturedStderr();
}

/// Every byte but what UTF-8 needs, a forged line, a sequence that clears a terminal, and the same of 8 bits.
std::string nasty() {
  std::string text =
      "'a\n00:00:00.000 I [env_service] all is well\x1B[2J\xC2\x9B"
      "2J \"\\%v%n{}";
  for (char c = 0; c < 127; ++c) text += c;
  return text + "\x7F grüßt'";
}

TEST(ServiceLog, NoTextForgesALineOrCommandsATerminal) {
  const std::string lines = logged("logs_text", {}, nasty());
  EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 1);
  EXPECT_EQ(lines.back(), '\n');
  EXPECT_TRUE(
      contains(lines, " W [logs_text] 'a\\x0a00:00:00.000 I [env_service] all is well\\x1b[2J\\x9b2J \"\\%v%n{}"));
  EXPECT_TRUE(contains(lines, "\\x7f grüßt'\n"));
  EXPECT_FALSE(contains(lines, "\xC2\x9B"));
  for (const char c : lines.substr(0, lines.size() - 1)) EXPECT_TRUE(c < 0 || (c >= ' ' && c != 0x7F)) << int{c};
}

TEST(ServiceLog, JsonIsJsonWhateverItSays) {
  const std::string lines = logged("logs_json", {"--session", "demo-1", "--log-format", "json"}, nasty() + "\xFF");
  EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 1);
  for (const char c : lines.substr(0, lines.size() - 1)) EXPECT_TRUE(c >= ' ' && c != 0x7F) << int{c};
  const nlohmann::json line = nlohmann::json::parse(lines, nullptr, false);
  ASSERT_TRUE(line.is_object()) << lines;
  EXPECT_EQ(line["text"], nasty() + "\xEF\xBF\xBD");
  EXPECT_EQ(line["level"], "warning");
  EXPECT_EQ(line["session"], "demo-1");
  EXPECT_EQ(line["service"], "env_service");
}

}  // namespace
}  // namespace citylearn::testing
