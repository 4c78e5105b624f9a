// SPDX-License-Identifier: Apache-2.0
// Round trips Observation -> Action between two processes over this project's Node, and the same bytes over each
// vendor's bare API. See README.md.
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <mutex>

#include "bench/bench.h"
#include "bench/figures.h"
#include "bench/program.h"
#include "bench/roundtrip/bare.h"
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
const std::vector<std::string> kBare = {"listener", "waitset"};

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

/// Times of the trips asked for, one after another, after a tenth of them for warming up. A question unanswered for 200
/// ms is sent again.
class Trips {
 public:
  explicit Trips(int trips) : warm_(trips / 10), last_(warm_ + trips) {
    times.reserve(static_cast<std::size_t>(trips));
  }
  std::uint32_t number() const { return static_cast<std::uint32_t>(number_); }
  bool finished() const { return number_ >= last_; }
  void begin() { begin_ = Clock::now(); }
  void end() {
    if (number_ >= warm_) times.push_back(seconds_since(begin_) * 1e6);
    ++number_;
  }
  std::vector<double> times;  ///< microseconds

 private:
  int warm_, last_, number_ = 0;
  Clock::time_point begin_;
};

// --- Bare vendors

std::unique_ptr<roundtrip::Port> open_port(const std::string& vendor, const roundtrip::PortOptions& options) {
  return vendor == "fastdds" ? roundtrip::open_fastdds(options) : roundtrip::open_cyclonedds(options);
}

roundtrip::PortOptions port_options(const Settings& settings, const std::string& path, bool asks) {
  return {asks,
          path == "listener" ? roundtrip::Mode::kListener : roundtrip::Mode::kWaitset,
          settings.domain,
          size_of(make_observation(settings)),
          size_of(make_action(settings)),
          {}};
}

void answer_bare(const Settings& settings, const std::string& vendor, const std::string& path) {
  roundtrip::PortOptions options = port_options(settings, path, false);
  Bytes answer(options.answer);
  std::mutex ready;  // the first question may come before open_port returns
  std::unique_ptr<roundtrip::Port> port;
  ready.lock();
  options.received = [&](std::span<const std::byte> question) {
    std::lock_guard lock(ready);
    set_number(answer, number_in(question));
    port->send(answer);
  };
  port = open_port(vendor, options);
  ready.unlock();
  pollfd input{STDIN_FILENO, POLLIN, 0};
  poll(&input, 1, -1);
}

std::vector<double> ask_bare(const Settings& settings, const std::string& vendor, const std::string& path) {
  roundtrip::PortOptions options = port_options(settings, path, true);
  Bytes question(options.question);
  Trips trips(settings.trips);
  std::mutex mutex;
  std::condition_variable done;
  std::unique_ptr<roundtrip::Port> port;
  const auto ask = [&] {
    set_number(question, trips.number());
    trips.begin();
    port->send(question);
  };
  options.received = [&](std::span<const std::byte> answer) {
    std::lock_guard lock(mutex);
    if (trips.finished() || number_in(answer) != trips.number()) return;
    trips.end();
    if (trips.finished())
      done.notify_one();
    else
      ask();
  };
  std::unique_lock lock(mutex);
  port = open_port(vendor, options);
  std::uint32_t seen = trips.number();
  ask();
  while (!done.wait_for(lock, milliseconds(200), [&] { return trips.finished(); })) {
    if (trips.number() == seen) ask();
    seen = trips.number();
  }
  lock.unlock();
  port.reset();
  return trips.times;
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
  Trips trips(settings.trips);
  while (!trips.finished()) {
    set_number(question, trips.number());
    trips.begin();
    for (bool answered = false; !answered;) {
      publisher->publish(question);
      const auto limit = Clock::now() + milliseconds(200);
      while (!answered && middleware->wait(limit))
        while (!answered && subscription->take(answer)) answered = number_in(answer) == trips.number();
    }
    trips.end();
  }
  return trips.times;
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
  Trips trips(settings.trips);
  while (!trips.finished()) {
    question.step(trips.number());
    trips.begin();
    for (bool answered = false; !answered;) {
      node.publish(question);
      const auto limit = Clock::now() + milliseconds(200);
      while (!answered && node.wait(limit))
        while (!answered && node.take(answer)) answered = answer.step() == trips.number();
    }
    trips.end();
  }
  return trips.times;
}

// --- Measurement

bool is_bare(const std::string& path) { return std::find(kBare.begin(), kBare.end(), path) != kBare.end(); }

void answer(const Settings& settings, const std::string& vendor, const std::string& path) {
  if (is_bare(path)) return answer_bare(settings, vendor, path);
  path == "node" ? answer_node(settings, vendor) : answer_middleware(settings, vendor);
}

/// Times in microseconds, of trips to a fresh process and back.
std::vector<double> measure(Settings settings, const std::string& vendor, const std::string& path) {
  if (path != "secured") settings.keys.clear();
  const testing::Child answerer({"/proc/self/exe", "--role", "answer:" + vendor + ":" + path, "--agents",
                                 std::to_string(settings.agents), "--dimension", std::to_string(settings.dimension),
                                 "--domain", std::to_string(settings.domain), "--keys", settings.keys});
  if (is_bare(path)) return ask_bare(settings, vendor, path);
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
  std::vector<std::string> paths = {"middleware", "secured"};
  if (!settings.secured) paths = {kBare[0], kBare[1], "middleware", "node"};
  for (const std::string& vendor : kVendors) {
    std::map<std::string, std::vector<double>> medians, p99;
    for (int round = 0; round < settings.rounds; ++round)
      for (const std::string& path : paths) {  // in turn, so that a change of the machine's load meets all alike
        const std::vector<double> times = measure(settings, vendor, path);
        medians[path].push_back(quantile(times, 0.5));
        p99[path].push_back(quantile(times, 0.99));
      }
    double reference = quantile(medians[paths[0]], 0.5);
    if (!settings.secured) reference = std::min(reference, quantile(medians[paths[1]], 0.5));
    for (const std::string& path : paths) {
      const double each = quantile(medians[path], 0.5);
      const std::string what = is_bare(path) ? "bare, " + path : path;
      std::printf("%-12s %-18s %9.1f %9.1f %9.2f\n", vendor.c_str(), what.c_str(), each, quantile(p99[path], 0.5),
                  each / reference);
      bench::record_figure(
          {.name = vendor + ", " + what, .value = each, .unit = "us", .better = bench::Better::kLower});
    }
  }
  std::printf("\nratio: median against %s. Each figure is the median over the rounds.\n",
              settings.secured ? "middleware that is not secured" : "the faster of the two bare ways");
}

}  // namespace

int main(int count, char** arguments) {
  Settings settings;
  CLI::App app("Round trips Observation -> Action between two processes, ours against the vendors' bare APIs",
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
