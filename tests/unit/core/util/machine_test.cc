// SPDX-License-Identifier: Apache-2.0
#include "core/util/machine.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <thread>

#include "core/dds/middleware.h"
#include "core/util/error.h"
#include "core/wire/service.h"

namespace citylearn {
namespace {

class SomeMachine : public Machine {
 public:
  std::string host_name() override { return "elsewhere"; }
  int process_number() override { return 7; }
  bool stop_requested() override { return true; }
  std::unique_ptr<Middleware> create_middleware(const MiddlewareOptions& options) override {
    throw Error("is asked for " + options.name, "the machine");
  }
};

TEST(Machine, TheSystemAnswersUnlessTheThreadRunsOnASimulatedOne) {
  SomeMachine machine;
  std::thread([&machine] {
    Machine::simulate(&machine);
    EXPECT_EQ(host_name(), "elsewhere");
    EXPECT_EQ(process_number(), 7);
    EXPECT_TRUE(stop_requested());
    EXPECT_THROW(create_middleware({}), Error);
  }).join();
  EXPECT_NE(host_name(), "elsewhere");
  EXPECT_EQ(process_number(), getpid());
  EXPECT_FALSE(stop_requested());
}

}  // namespace
}  // namespace citylearn
