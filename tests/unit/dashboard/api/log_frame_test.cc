// SPDX-License-Identifier: Apache-2.0
// Points of a log as columns of numbers.
#include "dashboard/api/log_frame.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "core/util/error.h"
#include "dashboard/http/frame.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

LogBatch three_records() {
  LogBatch batch(7);
  batch.source = "tensorboard";
  batch.log = "ab";
  batch.ended = true;
  batch.add("loss", 1, 10.5, 0.1);
  batch.add("spl", 1, 10.5, std::nan(""));
  batch.points_done();
  batch.add("loss", 2, 11.5, -0.0);
  batch.points_done();
  batch.add("spl", 3, 12.5, 1e300);
  batch.points_done();
  return batch;
}

TEST(LogFrame, HasWhatTheBatchHas) {
  const LogBatch batch = three_records();
  const LogBatch read = parse_log_frame(log_frame(batch, 0, 4, true));
  EXPECT_EQ(read.source, "tensorboard");
  EXPECT_EQ(read.log, "ab");
  EXPECT_EQ(read.ended, true);
  EXPECT_EQ(read.first(), 7u);
  EXPECT_EQ(read.end_record(), 10u);
  EXPECT_EQ(read.metrics(), batch.metrics());
  ASSERT_EQ(read.points().size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    const LoggedPoint &is = read.points()[i], &was = batch.points()[i];
    EXPECT_EQ(std::tuple(is.metric, is.record, is.step, is.time),
              std::tuple(was.metric, was.record, was.step, was.time));
    EXPECT_TRUE(is.value == was.value || (std::isnan(is.value) && std::isnan(was.value)));
  }
}

TEST(LogFrame, APartBeginsWithItsFirstRecordAndEndsNothing) {
  const LogBatch read = parse_log_frame(log_frame(three_records(), 2, 4, false));
  EXPECT_EQ(read.first(), 8u);
  EXPECT_EQ(read.end_record(), 10u);
  EXPECT_FALSE(read.ended);
}

void expect_refused(const std::string& naming, const std::string& frame) {
  try {
    parse_log_frame(frame);
    FAIL() << naming;
  } catch (const Error& error) {
    EXPECT_TRUE(contains(error.what(), naming)) << error.what();
  }
}

TEST(LogFrame, WrongOnesAreToldWhatIsWrong) {
  const std::string whole = log_frame(three_records(), 0, 4, true);
  const auto [text, payload] = split_frame(whole).value();
  const auto with = [&, json = Json::parse(text), numbers = std::string(payload)](const char* name, const Json& value) {
    Json header = json;
    header[name] = value;
    return frame_head(header.dump()) + numbers;
  };
  EXPECT_NO_THROW(parse_log_frame(with("first", 1)));
  expect_refused("is cut short", "");
  expect_refused("is cut short", whole.substr(0, 20));
  expect_refused("the header", frame_head("{]"));
  expect_refused("must be an object", frame_head("[]"));
  expect_refused("'first' of the header", with("first", 0));
  expect_refused("'first' of the header", with("first", 1e30));
  expect_refused("'points' of the header", with("points", 5));
  expect_refused("has 128 bytes, not 96", with("points", 3));
  expect_refused("'source' must be one line of at most 64 bytes", with("source", 5));
  expect_refused("'source' must be one line", with("source", "a\nb"));
  expect_refused("'log' must be one line", with("log", std::string(65, 'a')));
  EXPECT_EQ(parse_log_frame(with("log", nullptr)).log, "") << "missing";
  expect_refused("'ended'", with("ended", 1));
  expect_refused("twice", with("metrics", {"loss", "loss"}));
  expect_refused("one line", with("metrics", {"a\nb", "c"}));
  expect_refused("a name is a text", with("metrics", {1}));
  expect_refused("point 1", with("metrics", {"loss"}));  // its metric is the second name of one
  std::string endless = whole, gap = whole;
  const std::size_t numbers = whole.size() - payload.size();
  const double infinite = HUGE_VAL;
  std::memcpy(endless.data() + numbers + 8, &infinite, sizeof infinite);
  expect_refused("point 1", endless);
  gap[numbers + 3 * 4 * 8 + 3 * 4] = 9;  // the record of point 3
  expect_refused("point 3", gap);
}

}  // namespace
}  // namespace citylearn::testing
