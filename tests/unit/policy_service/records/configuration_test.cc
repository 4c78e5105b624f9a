// SPDX-License-Identifier: Apache-2.0
// --show-config: what runs, and who says so.
#include "policy_service/records/configuration.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>

#include "policy_service/records/report.h"
#include "policy_service/run/policy_service.h"
#include "tests/paths.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

/// Returns "VALUE, ORIGIN" by the names of the options that take effect.
std::map<std::string, std::string> effective(PolicyServiceOptions options, const std::vector<OptionValue>& parsed) {
  options.configuration = parsed;
  std::map<std::string, std::string> found;
  for (const OptionValue& option : checked_options(options).configuration)
    found[option.name] = option.value + ", " + option.origin;
  return found;
}

const std::vector<OptionValue> kParsed = {{"--agent", "place_filter", "default"},
                                          {"--max-steps", "0", "default"},
                                          {"--steps", "0", "default"},
                                          {"--list", "false", "default"},
                                          {"--ppo-learning-rate", "", "default"},
                                          {"--ppo-epochs", "7", "file a.toml"},
                                          {"--ppo-clip", "", "default"},
                                          {"--relabel-epochs", "", "default"},
                                          {"--baseline-hidden", "", "default"},
                                          {"--trainer-steps", "", "default"},
                                          {"--trainer-noise-episode", "", "default"},
                                          {"--sequence_filter-evidence", "", "default"}};

TEST(Configuration, HasWhatTheAgentRecommendsUnlessSomethingElseIsGiven) {
  PolicyServiceOptions options;
  options.learner_parameters = {{"epochs", 7}};
  auto found = effective(options, kParsed);
  EXPECT_EQ(found["--ppo-learning-rate"], "0.006, recommended by place_filter");
  EXPECT_EQ(found["--trainer-noise-episode"], "1, recommended by place_filter");
  EXPECT_EQ(found["--ppo-epochs"], "7, file a.toml");
  EXPECT_EQ(found["--ppo-clip"].substr(found["--ppo-clip"].find(',')), ", default") << "no agent recommends one";
  EXPECT_EQ(found["--max-steps"], "128, default") << "as many as places";
  EXPECT_EQ(found["--steps"], "160000, recommended by place_filter");
  EXPECT_EQ(found["--trainer-steps"], found["--steps"]);
  for (const char* name : {"--relabel-epochs", "--baseline-hidden", "--sequence_filter-evidence", "--list"})
    EXPECT_FALSE(found.contains(name)) << name << " has no effect";

  options.learner = "relabel";
  options.learner_parameters.clear();
  found = effective(options, kParsed);
  EXPECT_EQ(found["--relabel-epochs"], "8, recommended by place_filter") << "for this learner alone";
  EXPECT_EQ(found["--steps"], "40000, recommended by place_filter");
}

TEST(Configuration, ShowsTheStepsOfEitherOption) {
  PolicyServiceOptions options;
  options.steps = 512;
  auto found = effective(options, {{"--steps", "512", "command line"}, {"--trainer-steps", "", "default"}});
  EXPECT_EQ(found["--steps"], "512, command line");
  EXPECT_EQ(found["--trainer-steps"], "512, command line");
  options.steps = 0;
  options.trainer_parameters = {{"steps", 1024}};
  found = effective(options, {{"--steps", "0", "default"}, {"--trainer-steps", "1024", "file a.toml"}});
  EXPECT_EQ(found["--steps"], "1024, file a.toml");
  EXPECT_EQ(found["--trainer-steps"], "1024, file a.toml");
}

TEST(Configuration, HasNoTrainingOptionsWhereNothingIsLearned) {
  PolicyServiceOptions options;
  options.role = "actor";
  EXPECT_FALSE(effective(options, kParsed).contains("--ppo-learning-rate")) << "its learner knows them";
  options.role = "both";
  options.mode = "evaluate";
  options.agent = "sequence_filter";
  const auto found = effective(options, kParsed);
  EXPECT_FALSE(found.contains("--ppo-learning-rate"));
  EXPECT_TRUE(found.contains("--sequence_filter-evidence"));
}

TEST(Configuration, IsInTheManifest) {
  PolicyServiceOptions options;
  options.learner_parameters = {{"epochs", 7}};
  options.configuration = kParsed;
  const Json origins = manifest_json(checked_options(options), {}, {}, "", 1)["origins"];
  EXPECT_EQ(origins["ppo-epochs"], "file a.toml");
  EXPECT_EQ(origins["steps"], "recommended by place_filter");
  EXPECT_FALSE(origins.contains("agent")) << "it is the default";
}

TEST(Configuration, ManifestHasTheWholeCommand) {
  PolicyServiceOptions options;
  options.command = {"policy_service", "--train", "my drive"};
  const Json manifest = manifest_json(checked_options(options), {}, {}, "", 1);
  EXPECT_EQ(manifest["command"]["words"], Json(options.command));
  EXPECT_EQ(manifest["command"]["folder"], std::filesystem::current_path().string());
}

TEST(Configuration, OfARunThatEndedIsInItsManifest) {
  PolicyServiceOptions options;
  options.command = {"policy_service"};
  options.configuration = {{"--frames", "0:128", "default"}, {"--seed", "5", "file a.toml"}};
  options.first_frame = 4;
  options.frames = 20;  // of a short traversal
  const Folder folder;
  make_file(folder / "manifest.json", manifest_json(options, {}, {}, "", 1).dump());
  std::string text;
  for (const OptionValue& one : recorded_configuration(folder.path()))
    text += one.name + " " + one.value + ", " + one.origin + "\n";
  EXPECT_EQ(text, "--frames 4:24, default\n--max-detour 0, default\n--max-steps 0, default\n--seed 5, file a.toml\n");
  EXPECT_TRUE(contains(error_of([&] { recorded_configuration(folder / "none"); }), "/none: has no manifest.json"));
  make_file(folder / "manifest.json", "{}");
  EXPECT_TRUE(contains(error_of([&] { recorded_configuration(folder.path()); }), "does not say what options"));
}

/// Runs policy_service and returns its output.
std::string output_of(Arguments arguments) {
  const Folder folder;
  arguments.insert(arguments.begin(), CITYLEARN_POLICY_SERVICE);
  Service service(arguments, folder / "log");
  EXPECT_EQ(service.wait(seconds(30)), 0) << service.output();
  return service.output();
}

TEST(Configuration, IsShownWithoutDds) {
  const Folder folder;
  make_file(folder / "options.toml", "seed = 5\nppo-gamma = 0.5\n");
  for (const char* agent : {"baseline", "features", "place_filter", "raw_images"}) {
    const std::string text = output_of({"--agent", agent, "--show-config", "--interface", "no-such-interface"});
    for (const std::string& line : lines_of(text)) EXPECT_LE(line.size(), 100u) << line;
    EXPECT_TRUE(contains(text, std::string("recommended by ") + agent));
  }
  const std::string text =
      output_of({"--show-config", "--config", folder / "options.toml", "--steps", "4096", "--train", "fall,winter"});
  const auto origin_of = [&text](const std::string& name) {
    for (const std::string& line : lines_of(text))
      if (line.starts_with(name + " ")) return std::string(line, line.find_first_not_of(' ', name.size()));
    return std::string();
  };
  EXPECT_TRUE(contains(origin_of("--ppo-learning-rate"), "0.006 "));
  EXPECT_TRUE(origin_of("--ppo-learning-rate").ends_with("  recommended by place_filter"));
  EXPECT_TRUE(contains(origin_of("--trainer-agents"), "32 "));
  EXPECT_TRUE(origin_of("--seed").ends_with("  file " + (folder / "options.toml")));
  EXPECT_TRUE(origin_of("--ppo-gamma").ends_with("  file " + (folder / "options.toml")));
  EXPECT_TRUE(origin_of("--steps").ends_with("  command line"));
  EXPECT_TRUE(contains(origin_of("--train"), "fall,winter "));
  EXPECT_TRUE(origin_of("--tasks").ends_with("  default"));
  std::size_t column = 0;
  for (const std::string& line : lines_of(text))
    if (line.ends_with("  default")) {
      if (column == 0) column = line.size();
      EXPECT_EQ(line.size(), column) << "not aligned: " << line;
    }
}

TEST(Configuration, HelpAndListNameRecommendations) {
  const std::string help = output_of({"--help-all"});
  for (const char* name : {"--ppo-learning-rate ", "--trainer-noise-episode ", "--trainer-agents ", "--steps "}) {
    const std::size_t at = help.find(std::string("\n  ") + name);
    ASSERT_NE(at, help.npos) << name;
    const std::string text = help.substr(at, help.find("\n  --", at + 1) - at);
    const std::string line = std::regex_replace(text, std::regex("\\s+"), " ");
    EXPECT_TRUE(contains(line, "what the agent recommends, see --show-config"));
  }
  const std::string list = output_of({"--list"});
  EXPECT_EQ(occurrences(list, "      recommends "), 4) << list;
  EXPECT_TRUE(contains(list, "relabel.steps 40000"));
}

}  // namespace
}  // namespace citylearn::testing
