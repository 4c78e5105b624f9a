// SPDX-License-Identifier: Apache-2.0
// What the doctor makes of heartbeats; what it makes of hosts is in tests/system/network/network_test.cc.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <future>
#include <thread>

#include "core/util/wall_clock.h"
#include "core/wire/node.h"
#include "tests/paths.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tools/doctor/findings.h"

namespace citylearn::doctor {
namespace {

using testing::Folder;

constexpr std::uint32_t kDomain = 62;  // and the next one

class Doctor : public ::testing::Test {
 protected:
  /// A heartbeat that its sender wrote so many seconds ago.
  static msg::ServiceStatus heartbeat(const std::string& id, double age, msg::State state = msg::RUNNING) {
    msg::ServiceStatus status;
    status.header().protocol(msg::PROTOCOL);
    status.header().session("walk");
    status.header().sender(id);
    status.header().incarnation(static_cast<std::uint64_t>((seconds_since_epoch() - age - 10) * 1e6));
    status.header().message(1);
    status.service("env_service");
    status.service_state(state);
    status.activity("did what it could");
    status.uptime(10);
    return status;
  }
  void publish(const msg::ServiceStatus& status) {
    Bytes bytes;
    encode(status, bytes);
    publisher_->publish(bytes);
  }
  std::string problem_with(const std::string& text, const Findings& findings) const {
    for (const std::string& line : findings.problems)
      if (line.find(text) != std::string::npos) return line;
    return "";
  }

  MiddlewareOptions options_ = testing::middleware_options("inprocess", kDomain);
  const std::unique_ptr<Middleware> middleware_ =
      create_middleware(testing::middleware_options("inprocess", kDomain, "another"));
  const std::unique_ptr<Publisher> publisher_ = middleware_->create_publisher(topic_of<msg::ServiceStatus>());
};

TEST_F(Doctor, AFreshHeartbeatIsHealth) {
  publish(heartbeat("env", 1));
  EXPECT_EQ(check_service(options_, "walk", "env", 5), "");
  EXPECT_EQ(check_service(options_, "", "env", 5), "");
}

TEST_F(Doctor, NoneOrAnOldOneOrAFailureIsNot) {
  EXPECT_EQ(check_service(options_, "walk", "env", 0.2), "service 'env' of session 'walk': no heartbeat within 0.2 s");
  publish(heartbeat("env", 60));
  EXPECT_EQ(check_service(options_, "", "env", 0.2), "service 'env': only an old heartbeat was heard: it hangs");
  EXPECT_EQ(check_service(options_, "run", "env", 0.2), "service 'env' of session 'run': no heartbeat within 0.2 s");
  publish(heartbeat("env", 0, msg::FAILED));
  EXPECT_EQ(check_service(options_, "walk", "env", 0.2), "service 'env' of session 'walk': FAILED: did what it could");
}

TEST_F(Doctor, ASecondHeartbeatTellsThatAnotherClockIsBehind) {
  std::promise<void> done;
  msg::ServiceStatus status = heartbeat("env", 60);
  std::thread sender([&, ended = done.get_future()] {
    do {
      publish(status);
      status.header().message(status.header().message() + 1);
    } while (ended.wait_for(std::chrono::milliseconds(20)) == std::future_status::timeout);
  });
  EXPECT_EQ(check_service(options_, "walk", "env", 10), "");
  const Findings findings = examine(options_, "walk", 0.3);
  done.set_value();
  sender.join();
  ASSERT_FALSE(findings.hints.empty());
  EXPECT_NE(findings.hints[0].find(" was 60."), std::string::npos) << findings.hints[0];
  EXPECT_NE(findings.hints[0].find(" s behind ours"), std::string::npos) << findings.hints[0];
}

TEST_F(Doctor, NobodyIsAProblem) {
  options_.name = "cyclonedds";  // within this process the doctor would meet itself
  options_.domain = kDomain + 1;
  const Findings findings = examine(options_, "", 0.1);
  EXPECT_NE(problem_with("no participant was heard in domain 63 on lo", findings), "");
  EXPECT_NE(as_text(findings).find("PROBLEM: no participant was heard"), std::string::npos);
}

TEST_F(Doctor, WhatOthersSayBeginsNoLineAndCommandsNoTerminal) {
  Findings findings;
  Heartbeats::Service& service = findings.services.emplace_back();
  service.newest = heartbeat("a\nno problems", 0);
  service.newest.activity("\x1B[2J");
  findings.hints = {"service 'b\r\nno problems'"};
  findings.problems = {"service 'c\nno problems\x1B[2J'"};
  const std::string text = as_text(findings);
  EXPECT_EQ(text.find('\x1B'), std::string::npos);
  EXPECT_EQ(text.find('\r'), std::string::npos);
  EXPECT_EQ(text.find("\nno problems"), std::string::npos);
}

TEST_F(Doctor, AlarmsFailuresTypesAndProtocolsAreProblems) {
  msg::ServiceStatus alarmed = heartbeat("alarmed", 0);
  alarmed.alarm("checkpoint: the disk is full");
  publish(alarmed);
  const auto failing = middleware_->create_publisher(topic_of<msg::ServiceStatus>());
  Bytes bytes;
  encode(heartbeat("failed", 0, msg::FAILED), bytes);
  failing->publish(bytes);
  const auto old = middleware_->create_publisher(topic_of<msg::ServiceStatus>());
  bytes[4] = std::byte{4};  // the protocol is the first number of each message
  old->publish(bytes);
  Topic wrong = topic_of<msg::Action>();
  wrong.type = "citylearn::msg::Reaction";
  const auto writer = create_middleware(testing::middleware_options("inprocess", kDomain, "stranger"));
  const auto stranger = writer->create_publisher(wrong);
  const Findings findings = examine(options_, "", 0.3);
  EXPECT_EQ(problem_with("alarmed", findings), "service 'alarmed' of session 'walk': checkpoint: the disk is full");
  EXPECT_EQ(problem_with("'failed'", findings), "service 'failed' of session 'walk': FAILED: did what it could");
  EXPECT_NE(problem_with("the sender speaks protocol 4", findings), "");
  EXPECT_EQ(problem_with("topic", findings),
            "topic citylearn/action: 'stranger' publishes type citylearn::msg::Reaction, expected "
            "citylearn::msg::Action");
  EXPECT_EQ(findings.services.size(), 2u);
}

TEST_F(Doctor, QualitiesThatDoNotMatchAreProblemsOnTopicsOfSingleServicesToo) {
  options_.name = "cyclonedds";
  options_.domain = kDomain + 1;
  options_.participant = "stranger";
  const auto stranger = create_middleware(options_);
  Topic topic = topic_at(topic_of<msg::TaskSettings>(), "walk", "env-summer");
  topic.profile = Profile::kRos2;  // VOLATILE
  const auto publisher = stranger->create_publisher(topic);
  const Findings findings = examine(options_, "", 1);
  EXPECT_EQ(problem_with("topic", findings),
            "topic citylearn/walk/env_msummer/task_settings: 'stranger' publishes VOLATILE, expected TRANSIENT_LOCAL");
}

TEST_F(Doctor, VariablesOfOtherProgramsAreNamed) {
  ::setenv("ROS_DISCOVERY_SERVER", "10.0.0.1:11811", 1);
  const Findings findings = examine(options_, "", 0.1);
  ::unsetenv("ROS_DISCOVERY_SERVER");
  EXPECT_EQ(std::count_if(findings.hints.begin(), findings.hints.end(),
                          [](const std::string& hint) {
                            return hint.starts_with("ROS_DISCOVERY_SERVER is set: ignored, but by what meets");
                          }),
            1);
}

TEST_F(Doctor, TakenPortsHaveANameAndAProcess) {
  const int handle = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(bind(handle, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  socklen_t size = sizeof address;
  ASSERT_EQ(getsockname(handle, reinterpret_cast<sockaddr*>(&address), &size), 0);
  const int port = ntohs(address.sin_port);
  const std::vector<Port> taken = ports_taken(port, port, 0);
  ASSERT_EQ(taken.size(), 1u);
  EXPECT_EQ(taken[0].process, getpid());
  EXPECT_EQ(taken[0].program, "unit_tools");
  EXPECT_TRUE(ports_taken(port, port, getpid()).empty());
  close(handle);
  EXPECT_TRUE(ports_taken(port, port, 0).empty());
}

TEST(DoctorProgram, OneLineAndStatusOneWhenAServiceIsNotThere) {
  const Folder folder;
  for (const std::string vendor : {"cyclonedds", "fastdds"}) {
    testing::Service doctor({CITYLEARN_DOCTOR, "--service", "env", "--seconds", "0.5", "--domain",
                             std::to_string(kDomain), "--middleware", vendor},
                            folder / "log");
    EXPECT_EQ(doctor.wait(std::chrono::seconds(20)), 1);
    EXPECT_EQ(doctor.output(), "citylearn_doctor: service 'env': no heartbeat within 0.5 s\n");
  }
}

TEST(DoctorProgram, FindsAServiceOfTheOtherVendor) {
  const Folder folder;
  Node node({testing::middleware_options("cyclonedds", kDomain), "env_service", "env", "walk"});
  testing::Service doctor({CITYLEARN_DOCTOR, "--service", "env", "--session", "walk", "--seconds", "20", "--domain",
                           std::to_string(kDomain), "--middleware", "fastdds"},
                          folder / "log");
  std::optional<int> status;
  const Clock::time_point deadline = Clock::now() + std::chrono::seconds(30);
  while (!(status = doctor.wait(std::chrono::milliseconds(0))) && Clock::now() < deadline)
    node.wait(Clock::now() + std::chrono::milliseconds(20));
  EXPECT_EQ(status, 0) << doctor.output();
  EXPECT_EQ(doctor.output(), "");
}

}  // namespace
}  // namespace citylearn::doctor
