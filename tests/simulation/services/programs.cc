// SPDX-License-Identifier: Apache-2.0
// Runs the tests of a program in simulation.
#include <gtest/gtest.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <csignal>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <map>
#include <mutex>
#include <opencv2/core.hpp>
#include <streambuf>

#include "core/util/log_format.h"
#include "tests/simulation/machine/network.h"
#include "tests/support/env/env_service_thread.h"
#include "tests/support/processes/service.h"

// The main functions of the programs, which CMakeLists.txt renames.
int env_service_main(int argc, char** argv);
int encoder_service_main(int argc, char** argv);
int policy_service_main(int argc, char** argv);
int recorder_process_main(int argc, char** argv);

namespace citylearn::simulation {
namespace {

using testing::Arguments;

constexpr std::chrono::microseconds kLatency{500};  // so that waiting costs few steps
constexpr pid_t kNoProcess = 10'000'000;            // the kernel gives smaller numbers
constexpr Time kAlways = std::chrono::hours(24 * 365);

const std::map<std::string, int (*)(int, char**)> kMains = {{"env_service", env_service_main},
                                                            {"encoder_service", encoder_service_main},
                                                            {"policy_service", policy_service_main},
                                                            {"recorder_process", recorder_process_main}};

/// Returns what each process has written to its outputs.
std::map<const Process*, std::string>& outputs() {
  static std::map<const Process*, std::string> all;
  return all;
}

/// Keeps what programs write to a standard stream. What the test itself writes goes where it always goes.
class Output : public std::streambuf {
 public:
  explicit Output(std::ostream& stream) : stream_(stream), real_(*stream.rdbuf(this)) {}
  ~Output() override { stream_.rdbuf(&real_); }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;

 private:
  int_type overflow(int_type character) override {
    const char written = traits_type::to_char_type(character);
    if (!traits_type::eq_int_type(character, traits_type::eof())) xsputn(&written, 1);
    return traits_type::not_eof(character);
  }
  std::streamsize xsputn(const char* text, std::streamsize count) override {
    const auto found = outputs().find(current_process());
    if (found == outputs().end()) return real_.sputn(text, count);
    if (!found->first->dead()) found->second.append(text, static_cast<std::size_t>(count));
    return count;
  }
  int sync() override { return real_.pubsync(); }

  std::ostream& stream_;
  std::streambuf& real_;
};

/// The log of all programs, as one follows the other.
class Log : public spdlog::sinks::base_sink<std::mutex> {
 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    std::cerr.write(line.data(), static_cast<std::streamsize>(line.size()));
  }
  void flush_() override { std::cerr.flush(); }
};

/// A process with a number that no real one has.
class NumberedProcess : public Process {
 public:
  NumberedProcess(const std::string& program, pid_t number, Scheduler& scheduler, Network& network, Body body)
      : Process(program + "-" + std::to_string(number), scheduler, network, std::move(body)), number_(number) {}
  int process_number() override { return number_; }

 private:
  const pid_t number_;
};

/// The simulated machines on which the programs of a test run.
struct World {
  explicit World(std::uint64_t seed) : scheduler(seed), network(scheduler, seed) { network.faults.latency = kLatency; }
  ~World() { scheduler.end(); }
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  Process& add(const std::string& program, Process::Body body) {
    const pid_t number = kNoProcess + static_cast<pid_t>(processes.size());
    return *processes.emplace_back(
        std::make_unique<NumberedProcess>(program, number, scheduler, network, std::move(body)));
  }

  Scheduler scheduler;
  Network network;
  std::vector<std::unique_ptr<Process>> processes;
};
World* world = nullptr;

/// A program of the project in the simulation.
class SimulatedProgram : public testing::RunningProgram {
 public:
  explicit SimulatedProgram(const Arguments& command) {
    const std::string program = command[0].substr(command[0].rfind('/') + 1);
    const auto found = kMains.find(program);
    if (found == kMains.end()) throw Error("does not run in simulation", program);
    const auto body = [command, run = found->second](const std::function<bool()>&) {
      std::vector<std::string> texts = command;
      std::vector<char*> arguments;
      for (std::string& text : texts) arguments.push_back(text.data());
      return run(static_cast<int>(arguments.size()), arguments.data());
    };
    process_ = &world->add(program, body);
    outputs()[process_];
    process_->start();
  }
  ~SimulatedProgram() override {
    process_->kill();
    wait(std::chrono::seconds(1));
  }
  SimulatedProgram(const SimulatedProgram&) = delete;
  SimulatedProgram& operator=(const SimulatedProgram&) = delete;

  void send(int signal) override {
    switch (signal) {
      case SIGKILL:
        return process_->kill();
      case SIGSTOP:
        return process_->stall(kAlways);
      case SIGCONT:
        process_->stall(Time(0));
        return process_->wake();
      default:
        return process_->request_stop();
    }
  }
  std::optional<int> wait(testing::milliseconds patience) override {
    if (!testing::poll_until([this] { return !process_->running(); }, patience)) return std::nullopt;
    return process_->status() < 0 ? 128 + SIGKILL : process_->status();
  }
  std::string output() const override { return outputs().at(process_); }
  pid_t process() const override { return process_->process_number(); }

 private:
  Process* process_;
};

/// Something that runs beside a test, as a process.
class SimulatedTask : public testing::BackgroundTask {
 public:
  explicit SimulatedTask(const testing::TaskBody& body) {
    const auto run = [body](const std::function<bool()>& stop) {
      body(stop);
      return 0;
    };
    process_ = &world->add("background", run);
    process_->start();
  }
  ~SimulatedTask() override {
    process_->request_stop();
    while (process_->running()) ::poll(nullptr, 0, 5);
  }
  SimulatedTask(const SimulatedTask&) = delete;
  SimulatedTask& operator=(const SimulatedTask&) = delete;

 private:
  Process* process_;
};

std::unique_ptr<testing::BackgroundTask> start_simulated_task(const testing::TaskBody& body) {
  return std::make_unique<SimulatedTask>(body);
}

std::unique_ptr<testing::RunningProgram> start_simulated(const Arguments& command, const std::string&) {
  return std::make_unique<SimulatedProgram>(command);
}

/// Calls `body` as a process of a simulation and returns its exit status. The programs that it starts by
/// testing::Service run there too: env_service, encoder_service and policy_service with their own main functions and
/// command lines, and recorder_process. Their time is virtual, and so is that of `body`. What happens in which order is
/// drawn from CITYLEARN_SIMULATION_SEED (1).
int run_simulated(const std::function<int()>& body) {
  cv::setNumThreads(0);  // one thread a process
  const char* seed = std::getenv("CITYLEARN_SIMULATION_SEED");
  World here(seed ? std::stoull(seed) : 1);
  world = &here;
  testing::start_program = start_simulated;
  testing::start_background = start_simulated_task;
  const Output out(std::cout), error(std::cerr);
  auto log = std::make_shared<spdlog::logger>("simulation", std::make_shared<Log>());
  spdlog::set_default_logger(log);
  use_text_log();
  Process test("test", here.scheduler, here.network, [&](const std::function<bool()>&) { return body(); });
  test.start();
  while (test.running()) here.scheduler.run(here.scheduler.now() + std::chrono::seconds(1));
  return test.status();
}

}  // namespace
}  // namespace citylearn::simulation

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  return citylearn::simulation::run_simulated([] { return RUN_ALL_TESTS(); });
}
