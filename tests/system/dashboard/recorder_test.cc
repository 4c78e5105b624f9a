// SPDX-License-Identifier: Apache-2.0
// What only a real vendor shows of the dashboard's recorder.
#include <gtest/gtest.h>

#include "core/wire/node.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/records.h"

namespace citylearn::testing {
namespace {

/// `many` messages to a reader that is there.
template <class... Messages>
void publish_each(Node& node, int many, Messages... messages) {
  for (int i = 0; i < many; ++i) (node.publish(messages), ...);
}

// What a killed recorder leaves behind: readers that acknowledge nothing, until their lease ends. Fast DDS 2.9 by
// itself hangs in one of some hundred deletions of their writers.
TEST(FastDds, AServiceEndsThoughItsRecorderDoesNotAnswer) {
  constexpr int kRounds = 30;
  Trial run("fastdds");
  const auto recorder = run.recorder(run.folder() / "dashboard.sqlite");
  for (int round = 0; round < kRounds; ++round) {
    recorder->send(SIGCONT);
    Node node({run.middleware(), "env_service", "env-summer", "default"});
    const auto matched = [&] {
      return node.readers<msg::EpisodeStat>() > 0 && node.readers<msg::TrainingStat>() > 0 &&
             node.readers<msg::TraversalInfo>() > 0 && node.readers<msg::RunInfo>() > 0;
    };
    ASSERT_TRUE(eventually([&] { node.wait(Clock::now() + milliseconds(10)); }, matched, kLongWait));
    recorder->send(SIGSTOP);
    publish_each(node, 256, episode(1), training_stat(1), traversal_info(), run_info());
  }
}

}  // namespace
}  // namespace citylearn::testing
