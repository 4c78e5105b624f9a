// SPDX-License-Identifier: Apache-2.0
// network_peer ROLE: one end of what tests/system/network/network_test.cc sends between hosts. Prints what it saw, and
// ends at SIGTERM.
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstring>
#include <memory>
#include <set>

#include "core/wire/service.h"

namespace {

using namespace citylearn;

struct CommandLine {
  std::string role;
  Node::Options node;
  int others = 1;
  double rate = 30;
  std::uint32_t count = 90;
  std::size_t size = 1'000'000;
};

void say(const std::string& line) {
  fmt::print("{}\n", line);
  std::fflush(stdout);
}

/// Says when it has heard so many others, and when so many have said that they stop.
int meet(const CommandLine& line) {
  const Clock::time_point begin = Clock::now();
  Node node(line.node);
  node.create_reader<msg::ServiceStatus>();
  node.report(msg::RUNNING, "meets");
  std::set<std::string> heard, left;
  msg::ServiceStatus status;
  while (!stop_requested()) {
    node.wait(Clock::now() + std::chrono::milliseconds(20));
    while (node.take(status)) {
      const std::string sender = status.header().sender().to_string();
      if (heard.insert(sender).second && static_cast<int>(heard.size()) == line.others)
        say(fmt::format("met {} in {:.2f} s", line.others, seconds_since(begin)));
      if (status.service_state() == msg::STOPPING && left.insert(sender).second &&
          static_cast<int>(left.size()) == line.others)
        say(fmt::format("{} have left", line.others));
    }
  }
  return 0;
}

/// So many services of one process; each says when it ends that it stops.
int leave(const CommandLine& line) {
  std::vector<std::unique_ptr<Node>> nodes;
  for (std::uint32_t i = 0; i < line.count; ++i) {
    Node::Options options = line.node;
    options.id += "-" + std::to_string(i);
    nodes.push_back(std::make_unique<Node>(options));
    nodes.back()->report(msg::RUNNING, "leaves soon");
  }
  while (!stop_requested())
    for (const auto& node : nodes) node->wait(Clock::now() + std::chrono::milliseconds(5));
  for (auto& node : nodes) {
    node->report(msg::STOPPING, "stopping");
    node.reset();
  }
  return 0;
}

/// The front of a sample. All hosts of a test have one clock.
struct Front {
  std::uint32_t number;
  std::uint32_t count;
  std::int64_t sent;  // ns
};

std::int64_t now_ns() { return std::chrono::nanoseconds(Clock::now().time_since_epoch()).count(); }

std::byte filling(std::uint32_t number, std::size_t at) {
  return static_cast<std::byte>(number * 31 + at * 7 + at / 1000);
}

Topic large(const CommandLine& line) {
  return {"citylearn/test_large", "citylearn::test::Large", Profile::kDurable, line.size};
}

int send(const CommandLine& line) {
  const auto middleware = create_middleware(line.node.middleware);
  const auto publisher = middleware->create_publisher(large(line));
  while (!stop_requested() && publisher->matched() == 0) middleware->wait(Clock::now() + std::chrono::milliseconds(10));
  Bytes sample(line.size);
  Clock::time_point next = Clock::now();
  const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / line.rate));
  for (std::uint32_t number = 0; number < line.count && !stop_requested(); ++number) {
    for (std::size_t at = 0; at < sample.size(); ++at) sample[at] = filling(number, at);
    const Front front{number, line.count, now_ns()};
    const std::uint32_t encapsulation = 0x0100;  // CDR_LE, as every payload begins
    std::memcpy(sample.data(), &encapsulation, sizeof encapsulation);
    std::memcpy(sample.data() + 4, &front, sizeof front);
    publisher->publish(sample);
    next += period;
    while (!stop_requested() && Clock::now() < next) middleware->wait(next);
  }
  say("sent");
  while (!stop_requested()) middleware->wait(Clock::now() + std::chrono::milliseconds(50));
  return 0;
}

int receive(const CommandLine& line) {
  const auto middleware = create_middleware(line.node.middleware);
  const auto subscription = middleware->create_subscription(large(line));
  std::uint32_t whole = 0, damaged = 0, expected = 0;
  std::vector<double> delays;
  Bytes sample;
  while (!stop_requested()) {
    middleware->wait(Clock::now() + std::chrono::milliseconds(50));
    while (subscription->take(sample)) {
      Front front{};
      if (sample.size() >= 4 + sizeof front) std::memcpy(&front, sample.data() + 4, sizeof front);
      bool good = sample.size() == line.size && front.number == expected;
      for (std::size_t at = 4 + sizeof front; good && at < sample.size(); ++at)
        good = sample[at] == filling(front.number, at);
      ++(good ? whole : damaged);
      expected = front.number + 1;
      delays.push_back(static_cast<double>(now_ns() - front.sent) / 1e6);
      if (expected < line.count) continue;
      std::sort(delays.begin(), delays.end());
      say(fmt::format("received {} of {} whole and in order, {} not; median {:.0f} ms, longest {:.0f} ms", whole,
                      line.count, damaged, delays[delays.size() / 2], delays.back()));
    }
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  line.node.service = line.node.id = "network_peer";
  return service_main(
      argc, argv, "One end of the network tests.",
      [&](CLI::App& app) {
        app.add_option("role", line.role)->required()->check(CLI::IsMember({"meet", "leave", "send", "receive"}));
        app.add_option("--others", line.others);
        app.add_option("--rate", line.rate);
        app.add_option("--count", line.count);
        app.add_option("--size", line.size);
        app.add_flag("--own-sizes", line.node.middleware.multicast, "Leaves the vendor's settings as they are");
        add_node_options(app, line.node);
      },
      [&] {
        return line.role == "meet"    ? meet(line)
               : line.role == "leave" ? leave(line)
               : line.role == "send"  ? send(line)
                                      : receive(line);
      });
}
