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
#include "bench/round_trips.h"
#include "core/util/error.h"

namespace {

using namespace citylearn;
using bench::median;
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

constexpr std::size_t kAnswer = 120;

/// Options of an env_service or a policy_service. Unsecured when `keys` is empty.
MiddlewareOptions options_of(const Settings& settings, const std::string& vendor, const std::string& keys,
                             const std::string& participant) {
  MiddlewareOptions options;
  options.name = vendor;
  options.domain = settings.domain;
  options.participant = participant;
  if (!keys.empty()) options.security = keys + "/" + participant;
  return options;
}

bench::TripTopics topics_of(std::size_t size) {
  return {{"citylearn/observation", "Bytes", Profile::kCommand, size},
          {"citylearn/action", "Bytes", Profile::kCommand, kAnswer}};
}

/// Returns the median microseconds there and back.
double round_trip(const Settings& settings, const std::string& vendor, std::size_t size, const std::string& keys) {
  const testing::Child answerer({"/proc/self/exe", "--domain", std::to_string(settings.domain), "--role",
                                 "answer:" + vendor + ":" + std::to_string(size) + ":" + keys});
  return median(bench::ask_middleware(options_of(settings, vendor, keys, "env"), topics_of(size), settings.trips));
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
      bench::answer_middleware(options_of(settings, vendor, keys, "policy"), topics_of(std::stoul(size)));
    }
  });
}
