// SPDX-License-Identifier: Apache-2.0
// Round trips Observation -> Action between two processes over this project's Node, and the same bytes over a socket.
// See README.md.
#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>

#include "bench/bench.h"
#include "bench/figures.h"
#include "bench/program.h"
#include "core/wire/node.h"
#include "tests/support/options.h"
#include "tests/support/processes/peer.h"

namespace {

using namespace citylearn;  // NOLINT
using std::chrono::milliseconds;

struct Settings {
  int agents = 16;
  int dimension = 64;
  int trips = 5000;  // measured, after a tenth of them for warming up
  int rounds = 3;
  std::uint32_t domain = 120;
  bool secured = false;          // compares secured middleware with open middleware instead
  std::string keys;              // keystore; empty: nothing is secured
  std::string role = "measure";  // what a child is: "answer:VENDOR:PATH"
};

const std::vector<std::string> kVendors = {"cyclonedds", "fastdds"};

msg::Observation make_observation(const Settings& settings) {
  const std::size_t agents = static_cast<std::size_t>(settings.agents);
  msg::Observation observation;
  observation.traversal("summer");
  observation.feature_dimension(static_cast<std::uint32_t>(settings.dimension));
  observation.frame(std::vector<std::uint32_t>(agents, 1));
  observation.position(observation.frame());
  observation.goal(observation.frame());
  observation.previous_action(std::vector<std::uint8_t>(agents, 1));
  observation.allowed(std::vector<std::uint8_t>(agents, 7));
  observation.flags(std::vector<std::uint8_t>(agents, 0));
  observation.reward(std::vector<float>(agents, 0));
  observation.features(std::vector<float>(agents * static_cast<std::size_t>(settings.dimension), 0.5f));
  return observation;
}

msg::Action make_action(const Settings& settings) {
  msg::Action action;
  action.environment("asker");
  action.choice(std::vector<std::uint8_t>(static_cast<std::size_t>(settings.agents), 1));
  return action;
}

template <class Message>
std::size_t size_of(Message message) {
  message.header().session("bench");
  message.header().sender("asker");
  Bytes bytes;
  encode(message, bytes);
  return bytes.size();
}

/// The number of a trip, in the first bytes after a sample's encapsulation.
std::uint32_t number_in(std::span<const std::byte> sample) {
  std::uint32_t number;
  std::memcpy(&number, sample.data() + 4, sizeof number);
  return number;
}
void set_number(Bytes& sample, std::uint32_t number) { std::memcpy(sample.data() + 4, &number, sizeof number); }

/// Returns the times of trips one after another, in microseconds, after a tenth of them for warming up. `ask` sends a
/// question, and `answered` waits for its answer until a deadline: a question unanswered for 200 ms is sent again.
std::vector<double> time_trips(int trips, const std::function<void(std::uint32_t number)>& ask,
                               const std::function<bool(std::uint32_t number, Clock::time_point deadline)>& answered) {
  std::vector<double> times;
  for (int number = 0; number < trips + trips / 10; ++number) {
    const auto wanted = static_cast<std::uint32_t>(number);
    const Clock::time_point begin = Clock::now();
    do ask(wanted);
    while (!answered(wanted, Clock::now() + milliseconds(200)));
    if (number >= trips / 10) times.push_back(seconds_since(begin) * 1e6);
  }
  return times;
}

// --- The reference: a socket

/// Returns a socket that sends to the answering end, or is it. Throws Error.
int open_socket(const Settings& settings, bool asks) {
  const int handle = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in end{};
  end.sin_family = AF_INET;
  end.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  end.sin_port = htons(static_cast<std::uint16_t>(20000 + settings.domain));
  if ((asks ? ::connect : ::bind)(handle, reinterpret_cast<const sockaddr*>(&end), sizeof end) != 0)
    throw Error("cannot be opened", "UDP port " + std::to_string(20000 + settings.domain));
  return handle;
}

/// Waits until something came, at most until `deadline`. Returns whether it did.
bool wait_for(int handle, Clock::time_point deadline) {
  pollfd input{handle, POLLIN, 0};
  const auto left = std::chrono::ceil<milliseconds>(deadline - Clock::now()).count();
  return left > 0 && ::poll(&input, 1, static_cast<int>(left)) > 0;
}

void answer_udp(const Settings& settings) {
  const int handle = open_socket(settings, false);
  Bytes question(size_of(make_observation(settings))), answer(size_of(make_action(settings)));
  sockaddr_in asker{};
  socklen_t size = sizeof asker;
  while (!testing::input_ended())
    for (const auto limit = Clock::now() + milliseconds(100); wait_for(handle, limit);) {
      ::recvfrom(handle, question.data(), question.size(), 0, reinterpret_cast<sockaddr*>(&asker), &size);
      set_number(answer, number_in(question));
      ::sendto(handle, answer.data(), answer.size(), 0, reinterpret_cast<const sockaddr*>(&asker), size);
    }
}

std::vector<double> ask_udp(const Settings& settings) {
  const int handle = open_socket(settings, true);
  Bytes question(size_of(make_observation(settings))), answer(size_of(make_action(settings)));
  auto times = time_trips(
      settings.trips,
      [&](std::uint32_t number) {
        set_number(question, number);
        ::send(handle, question.data(), question.size(), 0);
      },
      [&](std::uint32_t number, Clock::time_point deadline) {
        while (wait_for(handle, deadline))  // refused while nobody listens yet
          if (::recv(handle, answer.data(), answer.size(), 0) > 0 && number_in(answer) == number) return true;
        return false;
      });
  ::close(handle);
  return times;
}

// --- This project

MiddlewareOptions middleware_options(const Settings& settings, const std::string& vendor,
                                     const std::string& participant) {
  MiddlewareOptions options = testing::middleware_options(vendor, settings.domain, participant);
  if (!settings.keys.empty()) options.security = settings.keys + "/" + participant;
  return options;
}

/// The topics of an environment and its policy_service, which alone a keystore's permissions allow.
struct Topics {
  explicit Topics(const Settings& settings)
      : question{"citylearn/observation", "Bytes", Profile::kCommand, size_of(make_observation(settings))},
        answer{"citylearn/action", "Bytes", Profile::kCommand, size_of(make_action(settings))} {}
  Topic question, answer;
};

void answer_middleware(const Settings& settings, const std::string& vendor) {
  const Topics topics(settings);
  const auto middleware = create_middleware(middleware_options(settings, vendor, "answerer"));
  Bytes question(topics.question.largest), answer(topics.answer.largest);
  answer[1] = std::byte{1};
  const auto publisher = middleware->create_publisher(topics.answer);
  const auto subscription = middleware->create_subscription(topics.question);
  while (!testing::input_ended())  // until the program that started this one has ended
    for (const auto limit = Clock::now() + milliseconds(100); middleware->wait(limit);)
      while (subscription->take(question)) {
        set_number(answer, number_in(question));
        publisher->publish(answer);
      }
}

std::vector<double> ask_middleware(const Settings& settings, const std::string& vendor) {
  const Topics topics(settings);
  const auto middleware = create_middleware(middleware_options(settings, vendor, "asker"));
  Bytes question(topics.question.largest), answer(topics.answer.largest);
  question[1] = std::byte{1};
  const auto publisher = middleware->create_publisher(topics.question);
  const auto subscription = middleware->create_subscription(topics.answer);
  return time_trips(
      settings.trips,
      [&](std::uint32_t number) {
        set_number(question, number);
        publisher->publish(question);
      },
      [&](std::uint32_t number, Clock::time_point deadline) {
        while (middleware->wait(deadline))
          while (subscription->take(answer))
            if (number_in(answer) == number) return true;
        return false;
      });
}

Node::Options node_options(const Settings& settings, const std::string& vendor, const std::string& id) {
  return {middleware_options(settings, vendor, id), "bench", id, "bench"};
}

void answer_node(const Settings& settings, const std::string& vendor) {
  Node node(node_options(settings, vendor, "answerer"));
  node.create_reader_at<msg::Observation>("asker");
  msg::Observation question;
  msg::Action answer = make_action(settings);
  answer.environment("asker");
  while (!testing::input_ended())  // until the program that started this one has ended
    for (const auto limit = Clock::now() + milliseconds(100); node.wait(limit);)
      while (node.take(question)) {
        answer.step(question.step());
        node.publish(answer);
      }
}

std::vector<double> ask_node(const Settings& settings, const std::string& vendor) {
  Node node(node_options(settings, vendor, "asker"));
  node.create_writer<msg::Observation>();
  node.create_reader<msg::Action>();
  msg::Observation question = make_observation(settings);
  msg::Action answer;
  return time_trips(
      settings.trips,
      [&](std::uint32_t number) {
        question.step(number);
        node.publish(question);
      },
      [&](std::uint32_t number, Clock::time_point deadline) {
        while (node.wait(deadline))
          while (node.take(answer))
            if (answer.step() == number) return true;
        return false;
      });
}

// --- Measurement

void answer(const Settings& settings, const std::string& vendor, const std::string& path) {
  if (path == "udp") return answer_udp(settings);
  path == "node" ? answer_node(settings, vendor) : answer_middleware(settings, vendor);
}

/// Times in microseconds, of trips to a fresh process and back.
std::vector<double> measure(Settings settings, const std::string& vendor, const std::string& path) {
  if (path != "secured") settings.keys.clear();
  const testing::Child answerer({"/proc/self/exe", "--role", "answer:" + vendor + ":" + path, "--agents",
                                 std::to_string(settings.agents), "--dimension", std::to_string(settings.dimension),
                                 "--domain", std::to_string(settings.domain), "--keys", settings.keys});
  if (path == "udp") return ask_udp(settings);
  return path == "node" ? ask_node(settings, vendor) : ask_middleware(settings, vendor);
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

void compare(const Settings& settings) {
  std::printf("Observation of %zu bytes there, Action of %zu bytes back; %d rounds of %d trips each; microseconds\n\n",
              size_of(make_observation(settings)), size_of(make_action(settings)), settings.rounds, settings.trips);
  std::printf("%-12s %-18s %9s %9s %9s\n", "vendor", "path", "median", "p99", "ratio");
  using Paths = std::vector<std::string>;
  const Paths paths = settings.secured ? Paths{"middleware", "secured"} : Paths{"udp", "middleware", "node"};
  for (const std::string& vendor : kVendors) {
    std::map<std::string, std::vector<double>> medians, p99;
    for (int round = 0; round < settings.rounds; ++round)
      for (const std::string& path : paths) {  // in turn, so that a change of the machine's load meets all alike
        const std::vector<double> times = measure(settings, vendor, path);
        medians[path].push_back(quantile(times, 0.5));
        p99[path].push_back(quantile(times, 0.99));
      }
    const double reference = quantile(medians[paths[0]], 0.5);
    for (const std::string& path : paths) {
      const double each = quantile(medians[path], 0.5);
      std::printf("%-12s %-18s %9.1f %9.1f %9.2f\n", vendor.c_str(), path.c_str(), each, quantile(p99[path], 0.5),
                  each / reference);
      bench::record_figure(
          {.name = vendor + ", " + path, .value = each, .unit = "us", .better = bench::Better::kLower});
    }
  }
  std::printf("\nratio: median against %s. Each figure is the median over the rounds.\n",
              settings.secured ? "middleware that is not secured" : "the socket");
}

}  // namespace

int main(int count, char** arguments) {
  Settings settings;
  CLI::App app("Round trips Observation -> Action between two processes, beside the same bytes over a socket",
               "bench_roundtrip");
  app.add_option("--agents", settings.agents, "agents per observation")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  app.add_option("--dimension", settings.dimension, "features per agent")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  app.add_option("--trips", settings.trips, "round trips per round")
      ->check(CLI::Range(10, 1000000))
      ->capture_default_str();
  app.add_option("--rounds", settings.rounds, "rounds")->check(CLI::Range(1, 100))->capture_default_str();
  app.add_option("--domain", settings.domain, "DDS domain")->check(CLI::Range(0, 232))->capture_default_str();
  app.add_flag("--secured", settings.secured, "compare secured middleware with open middleware instead");
  app.add_option("--keys", settings.keys)->group("");
  app.add_option("--role", settings.role)->group("");
  return bench::run(app, count, arguments, [&] {
    const std::size_t first = settings.role.find(':'), second = settings.role.rfind(':');
    if (first == std::string::npos) {
      const testing::Folder folder;
      if (settings.secured)
        bench::make_keystore(settings.keys = folder / "keys",
                             {{"env_service", "asker"}, {"policy_service", "answerer"}});
      compare(settings);
      return;
    }
    answer(settings, settings.role.substr(first + 1, second - first - 1), settings.role.substr(second + 1));
  });
}
