// SPDX-License-Identifier: Apache-2.0
// What a node does with messages that nobody of ours would send: it counts them and goes on.
#include "core/wire/node.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <random>
#include <set>

#include "tests/support/options.h"
#include "tests/support/records/samples.h"

namespace citylearn::testing {
namespace {

Node::Options options(const std::string& id) { return {middleware_options("inprocess"), "test", id, "ours"}; }

TEST(Node, LaterStartsHaveLargerIncarnationsAndServicesTheirOwn) {
  std::uint64_t before = 0;
  for (int i = 0; i < 10; ++i) {
    const Node node(options("again"));
    EXPECT_GT(node.incarnation(), before);
    EXPECT_EQ(node.incarnation() % 64, static_cast<std::uint64_t>(getpid()) % 64);
    before = node.incarnation();
  }
  std::set<std::uint64_t> names;
  for (int i = 0; i < 10; ++i) names.insert(Node(options("node-" + std::to_string(i))).incarnation() % 4096);
  EXPECT_GT(names.size(), 1U) << "in containers all have the same process number";
}

TEST(Node, SaysWhatItUsesOfItsMachineAndOfTheWire) {
  Node node(options("busy")), watcher(options("watcher"));
  watcher.create_reader<msg::ServiceStatus>();
  msg::ServiceStatus status;
  const auto heartbeat = [&](msg::State state) {
    node.report(state, "");
    ASSERT_TRUE(watcher.take(status));
  };
  heartbeat(msg::RUNNING);
  EXPECT_GT(status.memory(), 1u << 20);
  EXPECT_EQ(status.sent_bytes(), 0u) << "this one is counted by the next";
  const ProcessUse before = process_use();
  while (process_use().processor_seconds < before.processor_seconds + 0.05) continue;
  heartbeat(msg::STOPPING);
  EXPECT_GT(status.processors(), 0);
  EXPECT_LT(status.processors(), 1000);
  EXPECT_GT(status.sent_bytes(), 100u);
  EXPECT_GT(watcher.traffic.received_bytes, 200u) << "of both heartbeats";
}

/// A node, and somebody who speaks to it past any node.
class Hostile : public ::testing::Test {
 protected:
  Node node_{options("reader")};
  std::unique_ptr<Middleware> enemy_ = create_middleware(options("enemy").middleware);

  /// Sends `bytes` as a Message; true when the node takes them.
  template <class Message>
  bool takes(const Bytes& bytes) {
    const bool of_sender = addressing_of<Message>() == Addressing::kSender;
    const bool to_receiver = addressing_of<Message>() == Addressing::kReceiver;
    const std::string id = of_sender ? "sender" : to_receiver ? "reader" : "";
    const Topic topic = id.empty() ? topic_of<Message>() : topic_at(topic_of<Message>(), "ours", id);
    id.empty() ? node_.create_reader<Message>() : node_.create_reader_at<Message>(id);
    enemy_->create_publisher(topic)->publish(bytes);
    Message message;
    const bool taken = node_.take(message);
    EXPECT_FALSE(node_.take(message)) << "there was one";
    node_.delete_reader_at<Message>(id);
    return taken;
  }
};

/// Returns a message as a node of run "ours" sends it.
template <class Message>
Message good() {
  auto message = sample_of<Message>(Size::kTypical);
  message.header().session("ours");
  return message;
}

TEST_F(Hostile, GarbageOfEveryTypeIsCountedAndTheNextGoodMessageTaken) {
  std::mt19937 random(1);
  for_each_message([&]<class Message>() {
    const Bytes whole = encoded(good<Message>());
    for (int round = 0; round < 20; ++round) {
      Bytes garbage(random() % std::min<std::size_t>(topic_of<Message>().largest, 4000));
      for (std::byte& byte : garbage) byte = static_cast<std::byte>(random());
      const std::uint64_t before = node_.traffic.rejected;
      EXPECT_FALSE(takes<Message>(garbage));
      EXPECT_FALSE(takes<Message>(Bytes(whole.begin(), whole.end() - 1 - static_cast<long>(random() % whole.size()))));
      EXPECT_EQ(node_.traffic.rejected, before + 2) << topic_of<Message>().type;
    }
    const std::uint64_t received = node_.traffic.received;
    EXPECT_TRUE(takes<Message>(whole)) << topic_of<Message>().type;
    EXPECT_EQ(node_.traffic.received, received + 1);
  });
  EXPECT_EQ(node_.traffic.foreign, 0u);
}

TEST_F(Hostile, ForgedRunsAndOtherProtocolsAreCounted) {
  auto settings = good<msg::TaskSettings>();
  for (const std::string run : {"theirs", "our", "OURS", ""}) {
    settings.header().session(run);
    EXPECT_FALSE(takes<msg::TaskSettings>(encoded(settings))) << run;
  }
  EXPECT_EQ(node_.traffic.foreign, 4u);
  EXPECT_EQ(node_.traffic.rejected, 0u);
  settings.header().session("ours ");
  EXPECT_FALSE(takes<msg::TaskSettings>(encoded(settings)));
  EXPECT_EQ(node_.traffic.foreign, 4u);
  EXPECT_EQ(node_.traffic.rejected, 1u);
  settings.header().session("ours");
  settings.header().sender("a,b");
  EXPECT_FALSE(takes<msg::TaskSettings>(encoded(settings)));
  EXPECT_EQ(node_.traffic.rejected, 2u);
  settings.header().sender("policy");
  settings.header().protocol(msg::PROTOCOL - 1);
  EXPECT_FALSE(takes<msg::TaskSettings>(encoded(settings)));
  EXPECT_EQ(node_.traffic.rejected, 3u);
}

}  // namespace
}  // namespace citylearn::testing
