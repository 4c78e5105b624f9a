// SPDX-License-Identifier: Apache-2.0
// Every pairing of the vendors, in two processes: every message, empty and at its largest, there and back unchanged.
#include <gtest/gtest.h>
#include <unistd.h>

#include "core/wire/node.h"
#include "tests/paths.h"
#include "tests/support/options.h"
#include "tests/support/processes/domain.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/readers.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

/// Names as long as they may be.
std::string longest(const std::string& begin) {
  std::string name = begin + std::to_string(getpid());
  name.resize(64, '-');
  return name;
}

class Vendors : public ::testing::TestWithParam<std::tuple<std::string, std::string>> {
 protected:
  Node::Options options() {
    return {middleware_options(std::get<0>(GetParam()), domain_), "vendors_test", longest("test"), longest("run")};
  }
  const std::uint32_t domain_ = own_domain();
};

const auto kVendors = ::testing::Values("cyclonedds", "fastdds");
INSTANTIATE_TEST_SUITE_P(All, Vendors, ::testing::Combine(kVendors, kVendors), [](const auto& param_info) {
  return std::get<0>(param_info.param) + "_" + std::get<1>(param_info.param);
});

/// Sends `sent` until the peer's copy is here. What still comes of earlier messages is passed over.
template <class Message>
void expect_echo(Node& node, const Message& sent) {
  const Clock::time_point deadline = Clock::now() + kPatience;
  Clock::time_point send_again{};
  Message out = sent, back;
  while (Clock::now() < deadline) {
    if (Clock::now() >= send_again) {
      out = sent;
      node.publish(out);
      send_again = Clock::now() + milliseconds(200);
    }
    node.wait(send_again);
    while (node.take(back)) {
      EXPECT_EQ(back.header().sender().to_string(), longest("peer"));
      EXPECT_EQ(back.header().session().to_string(), longest("run"));
      back.header(sent.header());
      if (equal(back, sent)) return;
    }
  }
  FAIL() << topic_of<Message>().type << " did not come back";
}

TEST_P(Vendors, EveryMessageGoesThereAndBack) {
  Node node(options());
  Child peer({VENDORS_PEER, std::get<1>(GetParam()), std::to_string(domain_), longest("run"), longest("peer"), "0",
              longest("test")});
  for_each_message([&]<class Message>() {
    create_readers_of_samples<Message>(node, longest("peer"));
    node.create_writer<Message>();
  });
  for (Size size : {Size::kLeast, Size::kTypical, Size::kMost})
    for_each_message([&]<class Message>() { expect_echo(node, sample_of<Message>(size)); });
  EXPECT_EQ(node.traffic.rejected, 0u);
  EXPECT_TRUE(node.faults().empty());
  EXPECT_EQ(peer.finish(seconds(5)), 0);
}

TEST_P(Vendors, ADifferentTypeIsToldWithinFiveSeconds) {
  Node node(options());
  Child peer({VENDORS_PEER, std::get<1>(GetParam()), std::to_string(domain_), longest("run"), longest("peer"), "1",
              longest("test")});
  MiddlewareOptions raw = options().middleware;
  raw.participant = "raw";
  const auto middleware = create_middleware(raw);
  Topic wrong = topic_of<msg::TrainingStat>();
  wrong.type = "citylearn::msg::Reaction";
  const auto publisher = middleware->create_publisher(wrong);
  create_readers_of_samples<msg::Observation>(node, longest("peer"));
  create_readers_of_samples<msg::TrainingStat>(node, longest("peer"));
  expect_echo(node, sample_of<msg::Observation>(Size::kTypical));
  std::vector<std::string> faults;
  EXPECT_TRUE(eventually(
      *middleware,
      [&] {
        for (const std::string& line : middleware->discovery().faults())
          if (line.find(longest("peer")) != std::string::npos) faults.push_back(line);
        return faults.size() >= 2;
      },
      seconds(5)));
  std::sort(faults.begin(), faults.end());
  EXPECT_EQ(faults, (std::vector<std::string>{
                        "topic citylearn/training_stat: '" + longest("peer") +
                            "' publishes type citylearn::msg::TrainingStat, expected citylearn::msg::Reaction",
                        "topic citylearn/training_stat: '" + longest("peer") +
                            "' reads type citylearn::msg::TrainingStat, expected citylearn::msg::Reaction"}));
  expect_echo(node, sample_of<msg::TrainingStat>(Size::kTypical));  // nobody else is disturbed
  EXPECT_EQ(peer.finish(seconds(10)), 0);
}

}  // namespace
}  // namespace citylearn::testing
