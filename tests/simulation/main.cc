// SPDX-License-Identifier: Apache-2.0
// Plays trainings of the whole system in simulation, one for each seed, and says which broke an invariant.
#include <fcntl.h>
#include <sched.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/spdlog.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <iostream>
#include <map>
#include <sstream>

#include "core/util/text.h"
#include "core/util/types.h"
#include "core/wire/service.h"
#include "policy_service/run/sweep.h"
#include "tests/simulation/training/invariants.h"
#include "tests/simulation/training/layout.h"
#include "tests/simulation/training/scale.h"
#include "tests/simulation/training/training.h"

namespace {

using namespace citylearn;
using namespace citylearn::simulation;

constexpr unsigned kTimeout = 600;  // real seconds that a simulation may take

struct Options {
  std::uint64_t seed = 1;
  std::string seeds, layout;
  double hours = 0;
  int processes = 2, hosts = 0;
  std::vector<std::string> left_out;  ///< kinds of faults
  double until = 0;                   ///< as in FaultRates; 0: as drawn
  bool log = false, without_faults = false, list = false, traces = false;
};

/// The report of a simulation's process to the one that started it.
struct Report {
  bool failed = true;
  std::uint64_t trace = 0;
  double seconds = 0;
  std::uint64_t kills = 0, messages = 0, lost = 0, episodes = 0;
  std::string agent = "none", text;
};

std::string serialize(const Report& report) {
  std::ostringstream out;
  out << report.failed << ' ' << report.trace << ' ' << report.seconds << ' ' << report.kills << ' ' << report.messages
      << ' ' << report.lost << ' ' << report.episodes << ' ' << report.agent << '\n'
      << report.text;
  return out.str();
}

/// `status` is that of the process, as waitpid() gives it.
Report parse(const std::string& bytes, int status) {
  std::istringstream in(bytes);
  Report report;
  in >> report.failed >> report.trace >> report.seconds >> report.kills >> report.messages >> report.lost >>
      report.episodes >> report.agent;
  in.ignore();
  report.text = std::string(std::istreambuf_iterator<char>(in), {});
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGALRM)
    report.text = "  ended after " + std::to_string(kTimeout) + " s of real time: it hangs, or the machine is busy\n";
  else if (bytes.empty())
    report.text = "  the simulation crashed (status " + std::to_string(status) + ")\n";
  return report;
}

Report summarize(const Outcome& outcome) {
  Report report;
  report.failed = !outcome.violations.empty();
  report.trace = outcome.trace;
  report.seconds = outcome.seconds;
  report.episodes = outcome.episodes;
  if (!outcome.agent.empty()) report.agent = outcome.agent;
  for (const auto& [topic, traffic] : outcome.traffic) {
    report.messages += traffic.published;
    report.lost += traffic.lost + traffic.cut;
  }
  for (const auto& [kind, count] : outcome.faults)
    if (kind.starts_with("kill")) report.kills += static_cast<std::uint64_t>(count);
  for (const std::string& violation : outcome.violations) report.text += "  " + violation + "\n";
  return report;
}

/// Shows which process logs.
class ProcessName : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg&, const std::tm&, spdlog::memory_buf_t& out) override {
    const Process* process = current_process();
    const std::string name = process ? process->name() : "simulation";
    out.append(name.data(), name.data() + name.size());
  }
  std::unique_ptr<custom_flag_formatter> clone() const override { return std::make_unique<ProcessName>(); }
};

/// Makes a new folder the current one, and removes it at the end.
class Folder {
 public:
  Folder() : name_((std::filesystem::temp_directory_path() / "citylearn-simulation-XXXXXX").string()) {
    if (!::mkdtemp(name_.data())) throw Error(std::strerror(errno), name_);
    std::filesystem::current_path(name_);
  }
  ~Folder() {
    std::filesystem::current_path("/");
    std::filesystem::remove_all(name_);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

 private:
  std::string name_;
};

/// Plays a scenario in a folder of its own, and silently unless `log`.
Report play_here(Scenario scenario, bool log) {
  const Folder folder;
  if (log) {
    scenario.log = [](const std::string& line) { std::cerr << line << std::endl; };
    auto formatter = std::make_unique<spdlog::pattern_formatter>();
    formatter->add_flag<ProcessName>('*').set_pattern("%H:%M:%S.%e  %*: %l: %v");
    spdlog::set_formatter(std::move(formatter));
  } else {
    spdlog::set_level(spdlog::level::off);
    for (const int stream : {STDOUT_FILENO, STDERR_FILENO}) ::dup2(::open("/dev/null", O_WRONLY), stream);
  }
  Report report;
  try {
    report = summarize(play(scenario));
  } catch (const std::exception& error) {
    report.text = std::string("  the simulation itself failed: ") + error.what() + "\n";
  }
  return report;
}

/// Only one thread of a simulation runs at a time, so they take turns quickest on one processor.
void stay_on_one_processor(int number) {
  cpu_set_t all, one;
  if (::sched_getaffinity(0, sizeof all, &all) != 0) return;
  int left = number % CPU_COUNT(&all);
  for (int processor = 0; processor < CPU_SETSIZE; ++processor) {
    if (!CPU_ISSET(processor, &all) || left-- > 0) continue;
    CPU_ZERO(&one);
    CPU_SET(processor, &one);
    ::sched_setaffinity(0, sizeof one, &one);
    return;
  }
}

/// A simulation that runs in a process of its own, so that nothing is left over from another one.
class Play {
 public:
  Play(const Scenario& scenario, bool log) : scenario_(scenario) {
    static int count = 0;
    ++count;
    int ends[2];
    if (::pipe(ends) != 0) throw Error(std::strerror(errno), "pipe");
    std::cout.flush();
    process_ = ::fork();
    if (process_ < 0) throw Error(std::strerror(errno), "fork");
    if (process_ == 0) {
      ::alarm(kTimeout);
      stay_on_one_processor(count);
      const std::string report = serialize(play_here(scenario, log));
      const bool whole = ::write(ends[1], report.data(), report.size()) == static_cast<ssize_t>(report.size());
      ::_exit(whole ? 0 : 1);
    }
    ::close(ends[1]);
    pipe_ = ends[0];
  }
  const Scenario& scenario() const { return scenario_; }
  std::uint64_t seed() const { return scenario_.seed; }
  /// Waits for its end.
  Report report() {
    std::string bytes;
    char part[4096];
    for (ssize_t count; (count = ::read(pipe_, part, sizeof part)) > 0;) bytes.append(part, static_cast<size_t>(count));
    ::close(pipe_);
    int status = 0;
    ::waitpid(process_, &status, 0);
    return parse(bytes, status);
  }

 private:
  const Scenario scenario_;
  pid_t process_ = -1;
  int pipe_ = -1;
};

Scenario scenario_of(std::uint64_t seed, const Options& options) {
  Scenario scenario;
  scenario.seed = seed;
  scenario.layout = options.layout.empty() ? draw_layout(seed) : find_layout(options.layout);
  if (!options.without_faults) scenario.faults = draw_faults(seed);
  for (const std::string& kind : options.left_out) scenario.faults.leave_out(kind);
  if (options.until > 0) scenario.faults.until = options.until;
  return scenario;
}

/// Returns the options that choose services and faults, as they are typed.
std::string choices_of(const Options& options) {
  std::ostringstream out;
  if (!options.layout.empty()) out << " --layout " << options.layout;
  for (const std::string& kind : options.left_out) out << " --leave-out " << kind;
  if (options.until > 0) out << " --until " << options.until;
  return out.str();
}

int simulate(const Options& options) {
  std::vector<std::uint64_t> seeds{options.seed};
  if (!options.seeds.empty()) seeds = parse_seeds(options.seeds);
  std::map<std::string, std::string> agents;  // by layout: what its training leads to without faults
  const auto agent_of = [&](const Layout& layout) -> const std::string& {
    std::string& agent = agents[layout.name];
    if (!agent.empty() || !layout.lockstep()) return agent;
    Scenario calm;
    calm.layout = layout;
    const Report report = Play(calm, false).report();
    if (report.failed) throw Error("fails without faults\n" + report.text, "layout " + layout.name);
    return agent = report.agent;
  };
  const Clock::time_point begin = Clock::now();
  Report all;
  std::uint64_t played = 0, failures = 0;
  std::deque<Play> playing;
  const auto finish_one = [&] {
    Play& play = playing.front();
    const Report report = play.report();
    ++played;
    all.seconds += report.seconds;
    all.kills += report.kills;
    all.messages += report.messages;
    all.lost += report.lost;
    all.episodes += report.episodes;
    failures += report.failed;
    if (report.failed || seeds.size() == 1 || options.traces) {
      std::printf("seed %lu, %s: %s, %.1f s simulated, %lu kills, trace %016lx, agent %.16s\n%s", play.seed(),
                  play.scenario().layout.name.c_str(), report.failed ? "FAILED" : "all invariants hold", report.seconds,
                  report.kills, report.trace, report.agent.c_str(), report.text.c_str());
      if (report.failed)
        std::printf("  show it: ./run simulate --seed %lu%s --log\n", play.seed(), choices_of(options).c_str());
    }
    std::fflush(stdout);
    playing.pop_front();
  };
  for (std::size_t i = 0;; ++i) {
    const bool out_of_time = options.hours > 0 && seconds_since(begin) > options.hours * 3600;
    if (stop_requested() || out_of_time || (options.hours <= 0 && i >= seeds.size())) break;
    if (playing.size() >= static_cast<std::size_t>(options.processes)) finish_one();
    Scenario scenario = scenario_of(i < seeds.size() ? seeds[i] : seeds.back() + (i - seeds.size() + 1), options);
    scenario.expected_agent = agent_of(scenario.layout);
    playing.emplace_back(scenario, options.log);
  }
  while (!playing.empty()) finish_one();
  const double wall = seconds_since(begin);
  std::printf(
      "%lu simulations, %lu failed: %.2f h simulated in %.1f s (%.0f times as fast), %lu kills, %lu messages, "
      "%lu of their copies lost, %lu episodes acknowledged\n",
      played, failures, all.seconds / 3600, wall, all.seconds / wall, all.kills, all.messages, all.lost, all.episodes);
  return failures == 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  const auto setup = [&](CLI::App& app) {
    auto* seed = app.add_option("--seed", options.seed, "Seed of the simulation to play")->capture_default_str();
    app.add_option("--seeds", options.seeds, "Play one for each: 1..500 or 1,3,7")->excludes(seed);
    app.add_option(
        "--layout", options.layout,
        "Services that take part: one of " + joined(layouts(), &Layout::name) + "; unless given, each seed draws one");
    app.add_option("--hours", options.hours, "Go on with further seeds for so many hours")
        ->check(CLI::Range(0.001, 10000.0));
    app.add_option("--hosts", options.hosts,
                   "Count what so many hosts of ten env_services and an actor send, without faults, instead")
        ->check(CLI::Range(1, 1000));
    app.add_option("--processes", options.processes, "Simulations at a time")
        ->capture_default_str()
        ->check(CLI::Range(1, 1024));
    app.add_flag("--log", options.log, "Show each fault and what the services log");
    app.add_flag("--without-faults", options.without_faults, "Let nothing go wrong");
    app.add_option("--leave-out", options.left_out, "Kinds of faults that do not occur, such as kill,loss")
        ->delimiter(',');
    app.add_option("--until", options.until, "Seconds of virtual time after which nothing goes wrong (60)")
        ->check(CLI::Range(0.001, 60.0));
    app.add_flag("--traces", options.traces, "Print a line for each seed; compare those of two runs of this program");
    app.add_flag("--list", options.list, "Print the layouts and the invariants, and exit");
  };
  return service_main(argc, argv, "Plays trainings of the whole system in simulation.", setup, [&] {
    if (options.hosts > 0) {
      const Folder folder;
      if (!options.log) spdlog::set_level(spdlog::level::off);
      const auto progress = [](const std::string& line) { std::cerr << line << std::endl; };
      std::cout << measure_scale(options.hosts, progress);
      return 0;
    }
    if (!options.list) return simulate(options);
    std::cout << "layouts:\n";
    for (const Layout& layout : layouts()) std::cout << "  " << layout.name << ": " << layout.meaning << "\n";
    std::cout << "invariants:\n";
    for (const Invariant& invariant : invariants())
      std::cout << "  " << invariant.name << ": " << invariant.meaning << "\n";
    return 0;
  });
}
