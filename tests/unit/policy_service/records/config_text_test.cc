// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/config_text.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <CLI/CLI.hpp>

#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

TEST(ConfigText, SaysWhereEachValueComesFrom) {
  const Folder folder;
  make_file(folder / "run.toml", "tasks = 7\n");
  const std::vector<std::string> arguments = {"--seed=3", "--ppo-epochs", "2", "--config", folder / "run.toml"};
  CLI::App app;
  int seed = 1, tasks = 2000, frames = 128;
  std::uint64_t steps = 0;
  double value = 0;
  app.add_option("--seed", seed)->capture_default_str();
  app.add_option("--tasks", tasks)->capture_default_str();
  app.add_option("--frames", frames)->capture_default_str();
  app.add_option("--steps", steps)->capture_default_str();
  for (const char* name : {"--ppo-epochs", "--ppo-rate", "--ppo-clip"}) app.add_option(name, value)->group("ppo");
  app.add_option("--vtrace-rate", value)->group("vtrace");
  app.set_config("--config");
  std::vector<std::string> reversed(arguments.rbegin(), arguments.rend());
  app.parse(reversed);

  const PluginValues defaults = {{"ppo", {{"epochs", 4}, {"rate", 0.001}, {"clip", 0.2}}},
                                 {"trainer", {{"steps", 40}}}};
  const PluginValues effective = {{"ppo", {{"epochs", 8}, {"rate", 0.006}, {"clip", 0.2}}},
                                  {"trainer", {{"steps", 160}}}};
  const std::string text = config_text(app, arguments, effective, defaults, "features");
  const std::map<std::string, std::string> expected = {
      {"--seed", "3 command line"},       {"--tasks", "7 file " + (folder / "run.toml")},
      {"--frames", "128 default"},        {"--steps", "160 recommended by features"},
      {"--ppo-epochs", "2 command line"}, {"--ppo-rate", "0.006 recommended by features"},
      {"--ppo-clip", "0.2 default"},
  };
  std::map<std::string, std::string> lines;
  for (const std::string& line : lines_of(text)) {
    std::istringstream words(line);
    std::string name, shown, rest;
    words >> name >> shown;
    std::getline(words >> std::ws, rest);
    lines[name] = shown + " " + rest;
  }
  for (const auto& [name, line] : expected) EXPECT_EQ(lines[name], line) << text;
  EXPECT_FALSE(lines.contains("--vtrace-rate")) << "takes no part";
}

TEST(ConfigText, NamesTheVariableOfTheEnvironment) {
  ::setenv("CITYLEARN_TEST_DOMAIN", "9", 1);
  CLI::App app;
  int domain = 0;
  app.add_option("--domain", domain)->capture_default_str()->envname("CITYLEARN_TEST_DOMAIN");
  app.parse(std::vector<std::string>{});
  EXPECT_TRUE(contains(config_text(app, {}, {}, {}, "features"), "environment, CITYLEARN_TEST_DOMAIN"));
  ::unsetenv("CITYLEARN_TEST_DOMAIN");
}

}  // namespace
}  // namespace citylearn::testing
