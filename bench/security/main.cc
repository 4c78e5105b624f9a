// SPDX-License-Identifier: Apache-2.0
// What DDS Security costs (README.md).
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <map>
#include <sstream>

#include "bench/bench.h"
#include "bench/program.h"
#include "core/dds/middleware.h"
#include "core/util/error.h"

namespace {

using namespace citylearn;
using bench::median;
using std::chrono::milliseconds;
using testing::Service;
namespace fs = std::filesystem;

const std::vector<std::string> kVendors = {"cyclonedds", "fastdds"};

struct Settings {
  std::vector<std::size_t> sizes = {300, 4536, 49152};
  int trips = 1000, rounds = 3;
  std::uint64_t steps = 40960;
  std::uint32_t domain = 18;
  std::string role;  // of a child: answer:VENDOR:SIZE:KEYS
};

/// A temporary folder with a keystore in it.
class Workplace {
 public:
  Workplace() {
    keystore({"create", keys()});
    for (const auto& [kind, id] :
         std::map<std::string, std::string>{{"env_service", "env"}, {"policy_service", "policy"}})
      keystore({"add", keys(), kind, id});
  }
  std::string operator/(const std::string& name) const { return folder_ / name; }
  std::string keys() const { return folder_ / "keys"; }

 private:
  void keystore(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), CITYLEARN_KEYSTORE);
    Service program(arguments, folder_ / "keystore.log");
    bench::finish(program, "keystore");
  }
  testing::Folder folder_;
};

// --- Round trips

/// One of two participants: of an env_service or of a policy_service. Unsecured when `keys` is empty.
struct End {
  End(const Settings& settings, const std::string& vendor, const std::string& keys, bool asks, std::size_t size) {
    MiddlewareOptions options;
    options.name = vendor;
    options.domain = settings.domain;
    options.participant = asks ? "env" : "policy";
    if (!keys.empty()) options.security = keys + "/" + options.participant;
    middleware = create_middleware(options);
    const Topic question{"citylearn/observation", "Bytes", Profile::kCommand, size},
        answer{"citylearn/action", "Bytes", Profile::kCommand, size};
    subscription = middleware->create_subscription(asks ? answer : question);
    publisher = middleware->create_publisher(asks ? question : answer);
  }
  std::unique_ptr<Middleware> middleware;
  std::unique_ptr<Publisher> publisher;
  std::unique_ptr<Subscription> subscription;
};

constexpr std::size_t kAnswer = 120;

void answer(const Settings& settings, const std::string& vendor, std::size_t size, const std::string& keys) {
  End end(settings, vendor, keys, false, size);
  Bytes question, reply(kAnswer);
  while (true) {
    end.middleware->wait(Clock::now() + milliseconds(100));
    while (end.subscription->take(question)) {
      std::copy_n(question.begin(), 8, reply.begin());
      end.publisher->publish(reply);
    }
    if (getppid() == 1) return;
  }
}

/// Returns the median microseconds there and back.
double round_trip(const Settings& settings, const std::string& vendor, std::size_t size, const std::string& keys) {
  const Service answerer({"/proc/self/exe", "--domain", std::to_string(settings.domain), "--role",
                          "answer:" + vendor + ":" + std::to_string(size) + ":" + keys},
                         "/dev/stderr");
  End end(settings, vendor, keys, true, size);
  Bytes question(size), reply;
  question[1] = std::byte{1};
  std::vector<double> times;
  const int warm = settings.trips / 10;
  for (std::uint32_t trip = 0; times.size() < static_cast<std::size_t>(settings.trips); ++trip) {
    std::memcpy(question.data() + 4, &trip, sizeof trip);
    const Clock::time_point begin = Clock::now();
    for (bool answered = false; !answered;) {
      end.publisher->publish(question);
      const Clock::time_point again = Clock::now() + milliseconds(200);
      while (!answered && end.middleware->wait(again))
        while (!answered && end.subscription->take(reply))
          answered = reply.size() >= 8 && std::memcmp(reply.data() + 4, &trip, sizeof trip) == 0;
    }
    if (trip >= static_cast<std::uint32_t>(warm))
      times.push_back(std::chrono::duration<double, std::micro>(Clock::now() - begin).count());
  }
  return median(times);
}

// --- Training

/// Returns the steps per second of a training over the wire.
double training(const Settings& settings, const std::string& vendor, const std::string& keys, const Workplace& place) {
  const auto command = [&](const std::string& program, const std::string& id, std::vector<std::string> more) {
    more.insert(more.begin(), {program, "--id", id});
    if (!keys.empty()) more.insert(more.end(), {"--security", keys + "/" + id});
    return bench::on_wire(std::move(more), vendor, static_cast<int>(settings.domain));
  };
  const std::string output = place / "out";
  fs::remove_all(output);
  const Service env(
      command(CITYLEARN_ENV_SERVICE, "env",
              {"--traversal", "summer", "--agents", "8", "--synthetic-images", "0", "--synthetic-frames", "160"}),
      place / "env.log");
  Service policy(command(CITYLEARN_POLICY_SERVICE, "policy",
                         {"--agent", "place_filter", "--steps", std::to_string(settings.steps), "--tasks", "8",
                          "--evaluate", "summer", "--wait", "60", "--output", output}),
                 place / "policy.log");
  const std::string output_text = bench::finish(policy, "policy_service");
  const std::size_t end = output_text.find(" steps/s)"), begin = output_text.rfind('(', end);
  if (end == std::string::npos) throw Error("prints no steps/s:\n" + output_text, "policy_service");
  return std::stod(output_text.substr(begin + 1));
}

void compare(const Settings& settings) {
  const Workplace place;
  std::printf("%d rounds, each figure the median over them; open and secured take turns\n\n", settings.rounds);
  std::printf("%-12s %-28s %12s %12s %8s\n", "vendor", "what", "open", "secured", "ratio");
  for (const std::string& vendor : kVendors) {
    const auto row = [&](const std::string& what, const char* format, const auto& measure) {
      std::map<bool, std::vector<double>> figures;
      for (int round = 0; round < settings.rounds; ++round)
        for (const bool secured : {false, true}) figures[secured].push_back(measure(secured ? place.keys() : ""));
      const double open = median(figures[false]), secured = median(figures[true]);
      std::printf("%-12s %-28s ", vendor.c_str(), what.c_str());
      std::printf(format, open, secured);
      std::printf(" %8.2f\n", secured / open);
      std::fflush(stdout);
    };
    for (const std::size_t size : settings.sizes)
      row("round trip, " + std::to_string(size) + " B, us", "%12.1f %12.1f",
          [&](const std::string& keys) { return round_trip(settings, vendor, size, keys); });
    row("training, steps/s", "%12.0f %12.0f",
        [&](const std::string& keys) { return training(settings, vendor, keys, place); });
  }
  std::printf("\nratio: secured against open. Of round trips less is better, of steps/s more.\n");
}

}  // namespace

int main(int count, char** arguments) {
  Settings settings;
  CLI::App app("What DDS Security costs: round trips and training, with and without, both vendors", "bench_security");
  app.add_option("--sizes", settings.sizes, "bytes there (120 come back)")->delimiter(',')->capture_default_str();
  app.add_option("--trips", settings.trips, "round trips per round")
      ->check(CLI::Range(10, 1000000))
      ->capture_default_str();
  app.add_option("--rounds", settings.rounds, "rounds")->check(CLI::Range(1, 100))->capture_default_str();
  app.add_option("--steps", settings.steps, "environment steps of a training")->capture_default_str();
  app.add_option("--domain", settings.domain, "DDS domain")->check(CLI::Range(0, 230))->capture_default_str();
  app.add_option("--role", settings.role)->group("");
  return bench::run(app, count, arguments, [&] {
    if (settings.role.empty()) {
      compare(settings);
    } else {
      std::istringstream parts(settings.role);
      std::string word, vendor, size, keys;
      std::getline(parts, word, ':');
      std::getline(parts, vendor, ':');
      std::getline(parts, size, ':');
      std::getline(parts, keys);
      answer(settings, vendor, std::stoul(size), keys);
    }
  });
}
