// SPDX-License-Identifier: Apache-2.0
// What DDS Security costs (README.md).
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "core/util/error.h"
#include "core/dds/middleware.h"

namespace {

using namespace citylearn;
using std::chrono::milliseconds;
namespace fs = std::filesystem;

const std::vector<std::string> kVendors = {"cyclonedds", "fastdds"};

struct Settings {
  std::vector<std::size_t> sizes = {300, 4536, 49152};
  int trips = 1000, rounds = 3;
  std::uint64_t steps = 40960;
  std::uint32_t domain = 18;
  std::string role;  // of a child: answer:VENDOR:SIZE:KEYS
};

/// A process of this bench, killed at the end unless it ended before; what it prints goes to `output`.
class Process {
 public:
  Process(std::vector<std::string> command, const std::string& output) {
    std::vector<char*> arguments;
    for (std::string& argument : command) arguments.push_back(argument.data());
    arguments.push_back(nullptr);
    process_ = fork();
    if (process_ < 0) throw Error("cannot fork", command[0]);
    if (process_ > 0) return;
    const int file = open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    dup2(file, STDOUT_FILENO);
    dup2(file, STDERR_FILENO);
    execv(arguments[0], arguments.data());
    _exit(127);
  }
  ~Process() {
    if (process_ <= 0) return;
    kill(process_, SIGTERM);
    wait();
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  int wait() {
    int status = 0;
    waitpid(process_, &status, 0);
    process_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  pid_t process_ = 0;
};

std::string contents(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// A folder that goes at the end, with a keystore in it.
class Workplace {
 public:
  Workplace() {
    std::string name = (fs::temp_directory_path() / "citylearn-bench-XXXXXX").string();
    if (!mkdtemp(name.data())) throw Error("no temporary folder");
    path_ = name;
    keystore({"create", keys()});
    for (const auto& [kind, id] :
         std::map<std::string, std::string>{{"env_service", "env"}, {"policy_service", "policy"}})
      keystore({"add", keys(), kind, id});
  }
  ~Workplace() { fs::remove_all(path_); }
  Workplace(const Workplace&) = delete;
  Workplace& operator=(const Workplace&) = delete;
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }
  std::string keys() const { return path_ + "/keys"; }

 private:
  void keystore(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), CITYLEARN_KEYSTORE);
    if (Process(arguments, *this / "said").wait() != 0) throw Error(contents(*this / "said"), "keystore");
  }
  std::string path_;
};

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// --- Round trips
// -----------------------------------------------------------------------------------------------------------

/// Two participants, an env_service's and a policy_service's part; without keys where `keys` is empty.
struct End {
  End(const Settings& settings, const std::string& vendor, const std::string& keys, bool asks, std::size_t size) {
    MiddlewareOptions options;
    options.name = vendor;
    options.domain = settings.domain;
    options.participant = asks ? "env" : "policy";
    if (!keys.empty()) options.security = keys + "/" + options.participant;
    middleware = create_middleware(options);
    const Topic question{"citylearn/observation", "Bytes", Profile::kStream, size},
        answer{"citylearn/action", "Bytes", Profile::kStream, size};
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

/// Microseconds there and back, median.
double round_trip(const Settings& settings, const std::string& vendor, std::size_t size, const std::string& keys) {
  const Process answerer({"/proc/self/exe", "--domain", std::to_string(settings.domain), "--role",
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
// ----------------------------------------------------------------------------------------------------

/// Steps per second of a training over the wire.
double training(const Settings& settings, const std::string& vendor, const std::string& keys, const Workplace& place) {
  const auto command = [&](const std::string& program, const std::string& id, std::vector<std::string> more) {
    more.insert(more.begin(),
                {program, "--id", id, "--middleware", vendor, "--domain", std::to_string(settings.domain)});
    if (!keys.empty()) more.insert(more.end(), {"--security", keys + "/" + id});
    return more;
  };
  const std::string output = place / "out";
  fs::remove_all(output);
  const Process env(
      command(CITYLEARN_ENV_SERVICE, "env",
              {"--traversal", "summer", "--agents", "8", "--synthetic-images", "0", "--synthetic-frames", "160"}),
      place / "env.log");
  Process policy(command(CITYLEARN_POLICY_SERVICE, "policy",
                         {"--agent", "place_filter", "--steps", std::to_string(settings.steps), "--tasks", "8",
                          "--evaluate", "summer", "--wait", "60", "--output", output}),
                 place / "policy.log");
  const bool fine = policy.wait() == 0;
  const std::string said = contents(place / "policy.log");
  const std::size_t end = said.find(" steps/s)"), begin = said.rfind('(', end);
  if (!fine || end == std::string::npos) throw Error(said, "policy_service");
  return std::stod(said.substr(begin + 1));
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
  CLI::App app("What DDS Security costs: round trips and training, with and without, both vendors");
  app.add_option("--sizes", settings.sizes, "bytes there (120 come back)")->delimiter(',')->capture_default_str();
  app.add_option("--trips", settings.trips, "round trips per round")
      ->check(CLI::Range(10, 1000000))
      ->capture_default_str();
  app.add_option("--rounds", settings.rounds, "rounds")->check(CLI::Range(1, 100))->capture_default_str();
  app.add_option("--steps", settings.steps, "environment steps of a training")->capture_default_str();
  app.add_option("--domain", settings.domain, "DDS domain")->check(CLI::Range(0, 230))->capture_default_str();
  app.add_option("--role", settings.role)->group("");
  CLI11_PARSE(app, count, arguments);
  try {
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
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_security: %s\n", error.what());
    return 1;
  }
}
