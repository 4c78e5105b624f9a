// SPDX-License-Identifier: Apache-2.0
// With a credit window; tests/unit/env_service/episode_outbox_test.cc has what many readers do.
#include "core/exchange/log_sender.h"

#include <gtest/gtest.h>

#include "idl/common.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

using Acknowledged = LogSender::Acknowledged;

/// A log of one reader that gives credit, with a clock of the test's own.
class LogSenderCredit : public ::testing::Test {
 protected:
  void add(int count) {
    for (int i = 0; i < count; ++i) log_.add();
  }
  /// Returns how many records go out now for the first time, and how many again.
  std::pair<int, int> sent() {
    std::pair<int, int> count;
    while (const auto next = log_.next(now_)) ++(next->again ? count.second : count.first);
    return count;
  }
  Acknowledged acknowledge(std::uint64_t number, std::uint64_t limit) { return deliver(++message_, number, limit); }
  Acknowledged deliver(std::uint64_t message, std::uint64_t number, std::uint64_t limit) {
    msg::LogAcknowledgement acknowledgement;
    acknowledgement.header().sender() = "learner";
    acknowledgement.header().incarnation() = 7;
    acknowledgement.header().message() = message;
    acknowledgement.number() = number;
    acknowledgement.limit() = limit;
    return log_.acknowledge(acknowledgement, now_);
  }

  LogSender log_{{.resend_window = 16, .send_window = 0, .credit_window = 48}, {"learner"}, 101};
  Clock::time_point now_ = Clock::time_point() + std::chrono::hours(1);
  std::uint64_t message_ = 0;
};

TEST_F(LogSenderCredit, SendsWhatTheReaderHasRoomForAndNoMoreThanTheWindow) {
  add(100);
  EXPECT_EQ(log_.last(), 200u);
  EXPECT_EQ(sent(), std::pair(0, 0)) << "no room is known yet";
  EXPECT_EQ(acknowledge(100, 110), Acknowledged::kYes);
  EXPECT_EQ(sent(), std::pair(10, 0));
  EXPECT_EQ(acknowledge(105, 1000), Acknowledged::kYes);
  EXPECT_EQ(sent(), std::pair(43, 0)) << "48 are on their way";
  EXPECT_EQ(log_.sent(), 153u);
  EXPECT_EQ(acknowledge(201, 1000), Acknowledged::kImpossible);
  EXPECT_EQ(acknowledge(104, 1000), Acknowledged::kRepeated);
  EXPECT_EQ(log_.kept(), 95u);
}

TEST_F(LogSenderCredit, ALateAcknowledgementDoesNotTakeRoomBack) {
  add(20);
  EXPECT_EQ(acknowledge(100, 120), Acknowledged::kYes);
  EXPECT_EQ(deliver(message_ + 2, 100, 115), Acknowledged::kYes) << "the newest counts, also with less room";
  EXPECT_EQ(deliver(message_ + 1, 100, 102), Acknowledged::kRepeated);
  EXPECT_EQ(log_.limit(), 115u);
  EXPECT_EQ(sent(), std::pair(15, 0));
}

TEST_F(LogSenderCredit, WhatWaitedForRoomGoesOutOnce) {
  acknowledge(100, 110);
  add(20);
  EXPECT_EQ(sent(), std::pair(10, 0));
  acknowledge(110, 110);
  now_ += std::chrono::seconds(30);  // the reader is busy
  EXPECT_EQ(sent(), std::pair(0, 0));
  acknowledge(110, 120);
  EXPECT_EQ(sent(), std::pair(10, 0));
  EXPECT_EQ(log_.due(), now_ + kLogResend);
}

TEST_F(LogSenderCredit, WaitsTwiceAsLongAsTheLastAcknowledgementTook) {
  acknowledge(100, 1000);
  add(40);
  EXPECT_EQ(sent(), std::pair(40, 0));
  for (const int interval : {200, 400, 800, 1600, 2000, 2000}) {
    now_ += milliseconds(interval - 1);
    EXPECT_EQ(sent(), std::pair(0, 0));
    now_ += milliseconds(1);
    EXPECT_EQ(sent(), std::pair(0, 16)) << "after " << interval << " ms";
  }
  acknowledge(140, 1000);
  add(1);
  sent();
  now_ += milliseconds(450);
  EXPECT_EQ(sent(), std::pair(0, 0)) << "the last one took long";
  acknowledge(141, 1000);
  add(1);
  EXPECT_EQ(sent(), std::pair(1, 0));
  EXPECT_EQ(log_.due(), now_ + milliseconds(900));
}

}  // namespace
}  // namespace citylearn::testing
