// SPDX-License-Identifier: Apache-2.0
// Plug-ins that are loaded at run time: what is one, is used; what is none, is refused in one line.
#include "core/plugin/plugins.h"

#include <gtest/gtest.h>

#include "core/files/files.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "tests/paths.h"
#include "tests/support/networks/small_city.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

std::string refusal_of(const std::string& file) {
  return error_of([&] { load_plugin(file); });
}

/// Runs a program and returns its output.
std::string run(std::vector<std::string> arguments, int status, const char* program = CITYLEARN_POLICY_SERVICE) {
  const Folder folder;
  arguments.insert(arguments.begin(), program);
  Service service(arguments, folder / "log");
  const auto ended = service.wait(seconds(60));
  EXPECT_TRUE(ended && *ended == status) << service.output();
  return service.output();
}

TEST(Plugins, AreLoadedAndUsed) {
  load_plugin(SAMPLE_PLUGIN);
  load_plugin(SAMPLE_PLUGIN);  // once more is no harm
  EXPECT_EQ(loaded_plugins(), std::vector<std::string>{SAMPLE_PLUGIN});
  const Traversal city = small_city();
  TrainerOptions options;
  options.agent = "baseline";
  options.network_parameters = {{"hidden", 4}, {"cells", 3}};
  options.learner = "sample";
  options.learner_parameters = {{"rate", 0.25}};
  options.trainer_parameters = {{"segment", 4}, {"sequence", 4}};
  Loop loop(city, options);
  const Vector<float> before = loop.trainer.agent().parameters;
  loop.update();
  loop.update();
  EXPECT_TRUE(loop.trainer.agent().parameters.isApprox((before.array() + 0.5f).matrix()));
  EXPECT_EQ(loop.trainer.progress().updates, 2u);

  Checkpoint checkpoint = loop.trainer.checkpoint();
  checkpoint.tensors.erase("learner.parameters");
  EXPECT_THROW(loop.trainer.load(checkpoint), Error) << "both sides mean the same class Error";
  options.learner_parameters = {{"rate", 2}};
  EXPECT_THROW(Trainer(options, task_of(city)), Error);
}

TEST(Plugins, AreNamedOnTheCommandLineInAFileOrInTheEnvironment) {
  EXPECT_TRUE(contains(run({"--plugin", SAMPLE_PLUGIN, "--list"}, 0), "--sample-rate"));
  EXPECT_TRUE(contains(run({"--help-all", std::string("--plugin=") + SAMPLE_PLUGIN}, 0), "--sample-rate"));
  const Folder folder;
  make_file(folder / "options.toml",
            std::string("plugin = \"") + SAMPLE_PLUGIN + "\"\nlearner = \"sample\"\nsample-rate = 0.125\n");
  EXPECT_TRUE(contains(run({"--config", folder / "options.toml", "--list"}, 0), "--sample-rate"));
  setenv("CITYLEARN_PLUGIN", SAMPLE_PLUGIN, 1);
  EXPECT_TRUE(contains(run({"--list"}, 0), "--sample-rate"));
  unsetenv("CITYLEARN_PLUGIN");
  EXPECT_FALSE(contains(run({"--list"}, 0), "--sample-rate"));
  EXPECT_TRUE(contains(run({"--plugin", SAMPLE_PLUGIN, "--sample-rate", "7", "--list"}, 2), "--sample-rate"));
  run({"--plugin"}, 2);
}

TEST(Plugins, ThatAreNoneAreRefusedInOneLine) {
  const Folder folder;
  EXPECT_TRUE(contains(refusal_of(folder / "nowhere.so"), "nowhere.so: there is no such file"));
  EXPECT_TRUE(contains(refusal_of(folder.path()), "there is no such file"));
  make_file(folder / "text.so", "citylearn plug-in: a text that only says so");
  EXPECT_TRUE(contains(refusal_of(folder / "text.so"), "text.so: is not a plug-in of this program"));
  EXPECT_TRUE(contains(refusal_of("/bin/sh"), "is not a plug-in of this program"));
  EXPECT_TRUE(contains(refusal_of(EMPTY_PLUGIN), "registers nothing"));
  const std::string whole = read_file(SAMPLE_PLUGIN);
  make_file(folder / "half.so", whole.substr(0, whole.size() - 100));
  EXPECT_TRUE(contains(refusal_of(folder / "half.so"), "half.so: is cut short"));
  std::string foreign = whole;
  foreign[18] = 0;  // the processor
  make_file(folder / "foreign.so", foreign);
  EXPECT_TRUE(contains(refusal_of(folder / "foreign.so"), "foreign.so: cannot be loaded: "));

  const std::string said = run({"--plugin", folder / "text.so", "--list"}, 1);
  EXPECT_TRUE(contains(said, "policy_service: plug-in " + folder / "text.so: is not a plug-in"));
  EXPECT_EQ(occurrences(said, "\n"), 1) << said;
  EXPECT_TRUE(contains(run({"--plugin", TAKEN_PLUGIN, "--list"}, 1), "registers 'ppo', which exists already"));
}

TEST(Plugins, AreForProgramsThatHaveWhatTheyBuildOn) {
  const std::string said = run({"--plugin", ENCODER_PLUGIN, "--list"}, 1);
  EXPECT_TRUE(contains(said, "it may be for another program: docs/how-to/load-a-plugin.md"));
  EXPECT_EQ(occurrences(said, "\n"), 1) << said;
  EXPECT_TRUE(contains(run({"--plugin", ENCODER_PLUGIN, "--list"}, 1, CITYLEARN_ENCODER_SERVICE),
                       "registers 'raw84', which exists already"));
}

TEST(Plugins, OfAnotherVersionAreRefusedBeforeTheirCodeRuns) {
  const Folder folder;
  std::string changed = read_file(SAMPLE_PLUGIN);
  const std::string mark = "citylearn plug-in: interface ";
  const std::size_t begin = changed.find(mark);
  ASSERT_NE(begin, std::string::npos);
  changed.replace(begin + mark.size(), 12, "0123456789ab");
  make_file(folder / "older.so", changed);
  const std::string refusal = refusal_of(folder / "older.so");
  EXPECT_TRUE(contains(refusal, "older.so: was built for interface 0123456789ab, "));
  EXPECT_TRUE(contains(refusal, "; this program is interface "));
  EXPECT_TRUE(contains(refusal, "build both from the same sources"));
}

}  // namespace
}  // namespace citylearn::testing
