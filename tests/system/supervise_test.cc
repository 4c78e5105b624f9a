// SPDX-License-Identifier: Apache-2.0
// ./run keeps the services of a demo alive (tools/supervise.sh).
#include <gtest/gtest.h>
#include <signal.h>

#include "tests/support/service.h"
#include "tests/support/witness.h"

namespace citylearn::testing {
namespace {

using std::chrono::seconds;

constexpr seconds kLong{120};
const std::string kSource = CITYLEARN_SOURCE_DIR;

/// A shell script and all that it starts, which ends with the test.
class Script {
 public:
  Script(const std::string& text, const std::string& log)
      : shell_({"/usr/bin/setsid", "/bin/bash", "-c", "set -euo pipefail\n" + text}, log) {}
  ~Script() {
    if (shell_.process() > 0) ::kill(-shell_.process(), SIGKILL);
  }
  Service* operator->() { return &shell_; }

 private:
  Service shell_;
};

/// What keep_until_one_ends says of a service that does `command`, with pauses too short to wait for. What lives
/// shorter than `at_once` milliseconds has ended at once.
std::string kept(const std::string& command, int at_once = 100'000) {
  const Folder folder;
  Script script("KEEP_FIRST=10 KEEP_AT_ONCE=" + std::to_string(at_once) + "; . " + kSource +
                    "/tools/supervise.sh\nkeep it '' '' bash -c '" + command +
                    "'\nstatus=0; keep_until_one_ends || status=$?; echo \"$ended $status\"",
                folder / "log");
  EXPECT_EQ(script->wait(kLong), 0) << script->output();
  return script->output();
}

TEST(Supervise, WhatEndsByItselfHasEnded) {
  EXPECT_EQ(kept("exit 0"), "it 0\n");
  EXPECT_EQ(kept("exit 2"), "it 2\n") << "a wrong option";
  EXPECT_EQ(kept("exit 1"), "it 1\n") << "an error at once";
  EXPECT_EQ(kept("exit 1", 0), "run: it ended with an error; it starts again in 0.010 s\nit 1\n")
      << "an error later, and again";
}

TEST(Supervise, WhatIsKilledAgainAndAgainIsGivenUp) {
  EXPECT_EQ(kept("kill -9 $$"),
            "run: it was killed by signal 9; it starts again in 0.010 s\n"
            "run: it was killed by signal 9; it starts again in 0.020 s\n"
            "run: it was killed by signal 9; it starts again in 0.040 s\n"
            "run: it was killed by signal 9; it starts again in 0.080 s\n"
            "run: it was killed by signal 9, the 5th time within 60 s: given up\n"
            "it 137\n");
}

TEST(Supervise, LaterStartsHaveOptionsOfTheirOwn) {
  const Folder folder;
  // Dies at its first start, and ends well at the second one, which has the option.
  Script script("KEEP_FIRST=10; . " + kSource +
                    "/tools/supervise.sh\nkeep other '' '' sleep 1000\n"
                    "keep it '' --again bash -c 'echo \"has $*\"; [ $# -gt 0 ] || kill -9 $$' it\nkeep_until_one_ends; "
                    "echo $ended; let_go; echo \"left: ${kept_pid[*]-}\"",
                folder / "log");
  ASSERT_EQ(script->wait(kLong), 0) << script->output();
  EXPECT_EQ(script->output(),
            "has \nrun: it was killed by signal 9; it starts again in 0.010 s\nhas --again\nit\nleft: \n");
}

TEST(Supervise, ADemoGoesOnWhicheverServiceIsKilled) {
  constexpr int kDomain = 226;
  const Folder folder;
  Witness witness("cyclonedds", kDomain);
  Script demo("export CITYLEARN_BUILD=" CITYLEARN_BINARY_DIR " CITYLEARN_RUNS=" + (folder / "runs") +
                  " CITYLEARN_DOMAIN=" + std::to_string(kDomain) + "\nexec " + kSource +
                  "/run demo --frames 0:80 --evaluate summer --steps 1000000000 --checkpoint-every 5 --output " +
                  (folder / "out"),
              folder / "log");
  ASSERT_TRUE(witness.until([&] { return witness.updates >= 10; }, kLong)) << demo->output();
  for (const std::string id : {"env-summer", "encoder", "policy", "dashboard"}) {
    ASSERT_TRUE(witness.status.contains(id)) << demo->output();
    const auto before = witness.incarnation(id);
    ASSERT_EQ(::kill(static_cast<pid_t>(witness.status[id].process()), SIGKILL), 0) << id;
    EXPECT_TRUE(witness.until([&] { return witness.incarnation(id) > before; }, seconds(10))) << id << demo->output();
    const std::uint64_t updates = witness.updates;
    EXPECT_TRUE(witness.until([&] { return witness.updates > updates + 1; }, seconds(10))) << id << demo->output();
  }
  for (const std::string name : {"env-summer", "encoder", "policy_service", "dashboard"})
    EXPECT_NE(demo->output().find("run: " + name + " was killed by signal 9; it starts again in 1.000 s\n"),
              std::string::npos)
        << demo->output();
  EXPECT_NE(demo->output().find("going on after update"), std::string::npos) << "--resume\n" << demo->output();
  demo->send(SIGTERM);
  EXPECT_EQ(demo->wait(kLong), 143) << demo->output();
  for (const auto& [id, status] : witness.status)
    EXPECT_NE(::kill(static_cast<pid_t>(status.process()), 0), 0) << id << " still runs";
}

}  // namespace
}  // namespace citylearn::testing
