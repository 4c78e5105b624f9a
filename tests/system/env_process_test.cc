// SPDX-License-Identifier: Apache-2.0
// The program env_service: command line, exit status, one line for a person, signals.
#include <gtest/gtest.h>

#include "tests/paths.h"
#include "tests/support/env/env.h"
#include "tests/support/env/scripted_policy.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class EnvProcess : public ::testing::Test {
 protected:
  std::unique_ptr<Service> start(Arguments arguments, const std::string& log = "log") const {
    arguments.insert(arguments.begin(), CITYLEARN_ENV_SERVICE);
    return std::make_unique<Service>(arguments, folder_ / log);
  }
  std::string write(const std::string& name, const std::string& text) const {
    make_file(folder_ / name, text);
    return folder_ / name;
  }
  /// Returns what it prints; it must end by itself with `status`.
  std::string output(const Arguments& arguments, int status) const {
    const auto service = start(arguments);
    EXPECT_EQ(service->wait(seconds(10)), status);
    return service->output();
  }
  /// Returns its one line, without the program's name.
  std::string complaint(const Arguments& arguments, int status = 1) const {
    const std::string text = output(arguments, status);
    EXPECT_EQ(occurrences(text, "\n"), 1) << text;
    const std::string program = "env_service: ";
    EXPECT_EQ(text.rfind(program, 0), 0u) << text;
    return text.substr(program.size(), text.size() - program.size() - 1);
  }
  Arguments plain(const std::string& traversal) const {
    return {"--dataset", "plain", "--data", folder_.path(), "--traversal", traversal};
  }

  Folder folder_;
};

TEST_F(EnvProcess, ListsWhatThereIs) {
  const std::string list = output({"--list"}, 0);
  for (const char* word : {"plain", "synthetic", "--synthetic-frames", "--synthetic-dimension", "--synthetic-seed",
                           "cyclonedds", "fastdds", "inprocess"})
    EXPECT_TRUE(contains(list, word));
  EXPECT_EQ(output({"--list-traversals"}, 0), "summer\nfall\nwinter\nnight\novercast\nrain\nshifted\n");
  EXPECT_EQ(output({"--list-traversals", "--synthetic-images", "0"}, 0), "summer\nfall\nwinter\nnight\n");
  EXPECT_EQ(output({"--show", "--frames", "3:20"}, 0),
            "dataset synthetic\ntraversal summer\nframes 17\nimages yes\nfeatures 0\nmatched by index\n");
  EXPECT_EQ(output({"--show", "--frames", "3:20", "--slip", "0.1"}, 0),
            "dataset synthetic\ntraversal summer-slip0.1\nframes 17\nimages yes\nfeatures 0\nmatched by index\n");
  EXPECT_TRUE(contains(output({"--list-traversals", "--data", folder_.path()}, 1), "no traversals found; expected"));
  write("b b.csv", "1\n2\n");
  EXPECT_TRUE(contains(output({"--show", "--data", folder_.path(), "--traversal", "b b", "--kidnappings", "1"}, 0),
                       "\ntraversal b_b-kidnap1\n"));
  write("b.csv", "1\n2\n");
  write("a.csv", "1\n2\n");
  EXPECT_EQ(output({"--list-traversals", "--dataset", "plain", "--data", folder_.path()}, 0), "a\nb\nb b\n");
  const std::string all = output({"--list-traversals", "--show", "--data", folder_.path()}, 0);
  EXPECT_TRUE(contains(all, "matched by index\nrecording b b\ndataset plain\ntraversal b_b\nframes 2\n")) << all;
  EXPECT_EQ(output({"--list-traversals", "--data", folder_.path()}, 0), "a\nb\nb b\n") << "as what it is recognised";
  write("a.csv", "1\n");
  const std::string others = output({"--list-traversals", "--show", "--data", folder_.path()}, 1);
  EXPECT_TRUE(contains(others, "recording a\n")) << others;
  EXPECT_TRUE(contains(others, "a.csv: has only one frame, a route needs two")) << others;
  EXPECT_TRUE(contains(others, "recording b b\ndataset plain\ntraversal b_b\n")) << others;
  const std::string help = output({"--help-all"}, 0);
  for (const char* words : {"--synthetic-frames", "NAME-left, NAME-right: NAME as a"})
    EXPECT_TRUE(contains(help, words));
  EXPECT_FALSE(output({"--version"}, 0).empty());
}

TEST_F(EnvProcess, BadDataEndWithOneLineThatNamesFileAndLine) {
  const std::string ragged = write("ragged.csv", "1,2\n3,4\n5\n");
  EXPECT_EQ(complaint(plain("ragged")), ragged + ":3: 1 columns, the lines before have 2");
  EXPECT_EQ(complaint(plain("spring")), folder_.path() + ": no traversal 'spring' (there are: ragged)");
  EXPECT_EQ(complaint({"--dataset", "plain"}),
            "dataset plain: needs a folder of NAME.csv files (give it with --data DIR)");
}

TEST_F(EnvProcess, BadOptionsEndWithOneLine) {
  EXPECT_TRUE(contains(complaint({"--traversal", "spring"}), "there are: summer, fall, winter, night"));
  const std::string unknown = complaint({"--dataset", "oxford"});
  EXPECT_TRUE(contains(unknown, "unknown dataset 'oxford' (known: "));
  EXPECT_TRUE(contains(unknown, "oxford_robotcar"));
  EXPECT_TRUE(contains(complaint({"--dataset", "synthetic", "--data", folder_.path()}), "reads no folder"));
  EXPECT_TRUE(contains(complaint({"--synthetic-frames", "1"}, 2), "--synthetic-frames"));
  EXPECT_TRUE(contains(complaint({"--synthetic-frames", "2.5"}), "whole number"));
  EXPECT_TRUE(contains(complaint({"--agents", "0"}, 2), "--agents"));
  EXPECT_TRUE(contains(complaint({"--agents", "257"}, 2), "--agents"));
  EXPECT_TRUE(contains(complaint({"--synthetic-colour", "3"}, 2), "--synthetic-colour"));
  EXPECT_TRUE(contains(complaint({"--slip", "1.1"}, 2), "--slip"));
  EXPECT_TRUE(contains(complaint({"--slip", "nan"}, 2), "--slip: nan is not a number"));
  EXPECT_TRUE(contains(complaint({"--middleware", "rtps"}), "rtps"));
  EXPECT_TRUE(contains(complaint({"--domain", "233"}, 2), "--domain"));
  EXPECT_TRUE(contains(complaint({"--max-lost", "0.5"}), "--max-lost: is of a robot (add --dataset live"));
}

TEST_F(EnvProcess, ReadsAConfigurationFileAndRefusesUnknownKeys) {
  const std::string good = write(
      "good.toml",
      "\xEF\xBB\xBFtraversal = \"night\"\nagents = 3\nsynthetic-frames = 30\nsynthetic-images = 0\ndomain = 45\n");
  const auto service = start({"--config", good}, "good.log");
  ASSERT_TRUE(service->says("traversal night of synthetic, 30 frames x 64 features, 3 agents", seconds(10)))
      << service->output();
  EXPECT_EQ(service->end(SIGTERM, seconds(2)), 0);
  for (const auto& [text, words] : std::map<std::string, std::string>{
           {"agens = 3\n", "unknown option 'agens'"},
           {"[env]\nagents = 3\n", "has a section [env]: write its options without one"},
           {"agents = 3\ndomain = 4\nagents = 4\n", "agents stands there twice"},
           {"agents = 4 5\n", "agents has 2 values: give one, in quotes if it is a text"},
           {"agents = 4\nagents = 4\n", "agents has 2 values: give one, in quotes if it is a text"},
           {"traversal = a, b\n", "traversal has 2 values: give one, in quotes if it is a text"},
           {"agents = [4\n", "agents has no value"},
           {"list = true\n", "list is for the command line alone"},
           {"agents = 300\n", "--agents: Value 300 not in range 1 to 256"}}) {
    const std::string bad = write("bad.toml", text);
    EXPECT_TRUE(contains(complaint({"--config", bad}, 2), bad + ": " + words)) << text;
  }
  EXPECT_TRUE(contains(complaint({"--config", folder_ / "missing.toml"}, 2), "missing.toml"));
}

class EnvSignals : public EnvProcess, public ::testing::WithParamInterface<std::string> {
 protected:
  Arguments wire() const {
    return {"--middleware", GetParam(),           "--domain", std::to_string(domain()), "--session",
            run_,           "--synthetic-frames", "100",      "--synthetic-images",     "0"};
  }
  int domain() const { return GetParam() == "fastdds" ? 47 : 46; }
  std::unique_ptr<ScriptedPolicy> policy() {
    const MiddlewareOptions options = middleware_options(GetParam(), static_cast<std::uint32_t>(domain()));
    auto policy = std::make_unique<ScriptedPolicy>(options, run_, "env-summer");
    policy->walker = &blind_;
    return policy;
  }
  /// Lets `recorded` of `tasks` tasks end, of which the policy acknowledges none.
  void work_unacknowledged(std::uint32_t tasks, std::uint64_t recorded) {
    service_ = start(wire());
    driver_ = policy();
    driver_->acknowledge = false;
    driver_->command(evaluation(tasks, 32, 64));
    ASSERT_TRUE(driver_->until([&] { return driver_->recorded >= recorded; }));
  }

  std::unique_ptr<Service> service_;
  std::unique_ptr<ScriptedPolicy> driver_;
  BlindSweep blind_{32};
  const std::string run_ = "env-signals-" + std::to_string(getpid());
};

TEST_P(EnvSignals, TerminateWhileNobodyIsThere) {
  for (const int signal : {SIGTERM, SIGINT}) {
    const auto service = start(wire());
    ASSERT_TRUE(service->says("'env-summer' in session", seconds(10)));
    service->send(signal);
    EXPECT_EQ(service->wait(seconds(2)), 0) << service->output();
  }
}

TEST_P(EnvSignals, TerminateAtWorkWithEpisodesNobodyAcknowledges) {
  work_unacknowledged(200, 21);
  EXPECT_EQ(service_->end(SIGTERM, seconds(2)), 0) << service_->output();
  EXPECT_TRUE(contains(service_->output(), "not acknowledged"));
}

TEST_P(EnvSignals, TerminateWaitsShortlyForAcknowledgements) {
  work_unacknowledged(30, 30);
  service_->send(SIGTERM);
  ASSERT_TRUE(driver_->until([&] { return driver_->status.service_state() == msg::STOPPING; }));
  // As recorders do, again and again: the first may be sent before the two have found each other.
  const auto ended = [&] {
    driver_->send_acknowledgement(30);
    return service_->wait(milliseconds(1)).has_value();
  };
  ASSERT_TRUE(driver_->until(ended, seconds(2))) << service_->output();
  EXPECT_EQ(service_->wait(seconds(0)), 0) << service_->output();
  EXPECT_TRUE(contains(service_->output(), "30 episodes, all acknowledged"));
}

INSTANTIATE_TEST_SUITE_P(Vendors, EnvSignals, ::testing::Values("cyclonedds", "fastdds"),
                         [](const auto& vendor) { return vendor.param; });

}  // namespace
}  // namespace citylearn::testing
