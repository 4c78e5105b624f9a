// SPDX-License-Identifier: Apache-2.0
// See README.md.
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <regex>
#include <sstream>

#include "bench/bench.h"
#include "core/files/files.h"
#include "core/util/error.h"
#include "core/wire/node.h"
#include "tests/support/options.h"
#include "tests/support/processes/hosts.h"

namespace {

using namespace citylearn;
using bench::median;
using testing::Folder;
using testing::Hosts;
using testing::Service;
using Arguments = std::vector<std::string>;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr int kWindows = 5;
constexpr std::uint32_t kDomain = 43;
constexpr seconds kWaitTimeout{90};

/// Set by a signal, so that the hosts are removed before the program ends.
volatile std::sig_atomic_t stop = 0;

/// One layout of services, each on a host of its own.
struct Case {
  int envs = 1, agents = 16, actors = 1, dimension = 64;
  std::string agent = "place_filter";
  bool dashboard = false, encoder = false;
  bool runs = true;            ///< a learner is started; else the services only discover each other
  bool ports = false;          ///< peers are named with their ports
  bool large = false;          ///< an update takes 4,096 trajectories of 16 steps, as on 100 hosts; else 16 of 32
  std::string observing = "";  ///< role both: --observations
};

std::string describe(const Case& c) {
  std::ostringstream text;
  text << c.envs << " x " << c.agents << " agents, " << c.actors << " actors, " << c.dimension << " features, "
       << c.agent << (c.observing.empty() ? "" : ", " + c.observing) << (c.dashboard ? ", dashboard" : "")
       << (c.encoder ? ", encoder" : "") << (c.ports ? ", peers with ports" : "") << (c.large ? ", large updates" : "")
       << (c.runs ? "" : ", no learner");
  return text.str();
}

/// Figures by the names of their columns: times in microseconds, memory in MB, the others are counts.
using Figures = std::map<std::string, double>;

// The columns of a row's figures. CPU time is that of a process' first thread and of all others that live, the DDS
// vendor's; sleeps are voluntary context switches. Bytes and packets count with Ethernet's headers, datagrams are of
// UDP and whole, and those are lost that a full socket had no room for.
const char* const kFigures[] = {
    "main_us",        "others_us",        "main_sleeps",    "others_sleeps",      "sent_bytes", "received_bytes",
    "sent_packets",   "received_packets", "sent_datagrams", "received_datagrams", "lost",       "resident_mb",
    "steps_per_s",    "busy_cores",       "idle_cores",     "episodes_per_step",  "lag",        "received_per_s",
    "repeated_per_s", "resent_per_s"};

/// Returns a counter of /proc/net/snmp, where a line of numbers follows a line of names.
double snmp(const std::string& text, const std::string& protocol, const std::string& wanted) {
  std::istringstream lines(text);
  std::string names, numbers;
  while (std::getline(lines, names)) {
    if (names.rfind(protocol + ":", 0) != 0 || !std::getline(lines, numbers)) continue;
    std::istringstream name(names), number(numbers);
    for (std::string each, value; name >> each && number >> value;)
      if (each == wanted) return std::stod(value);
  }
  throw Error("has no " + protocol + " " + wanted, "/proc/net/snmp");
}

/// Returns what a process has used so far, and what has crossed its host's interface to the network. Throws Error when
/// there is no such process.
Figures usage_of(int process) {
  const std::string folder = "/proc/" + std::to_string(process);
  Figures usage;
  for (const auto& task : std::filesystem::directory_iterator(folder + "/task")) {
    std::ifstream in(task.path() / "schedstat");
    double nanoseconds = 0;
    if (!(in >> nanoseconds)) continue;  // it has just ended
    const std::string thread = task.path().filename() == std::to_string(process) ? "main" : "others";
    usage[thread + "_us"] += nanoseconds / 1e3;
    std::ifstream status(task.path() / "status");
    for (std::string word; status >> word;)
      if (double times = 0; word == "voluntary_ctxt_switches:" && status >> times) usage[thread + "_sleeps"] += times;
  }
  std::istringstream interfaces(read_file(folder + "/net/dev"));
  for (std::string line; std::getline(interfaces, line);) {
    const std::size_t colon = line.find(':');
    if (colon == line.npos || line.substr(0, colon).find("net0") == line.npos) continue;
    double number[16];
    std::istringstream numbers(line.substr(colon + 1));
    for (double& each : number) numbers >> each;
    usage["received_bytes"] = number[0], usage["received_packets"] = number[1];
    usage["sent_bytes"] = number[8], usage["sent_packets"] = number[9];
  }
  const std::string counters = read_file(folder + "/net/snmp");
  usage["sent_datagrams"] = snmp(counters, "Udp", "OutDatagrams");
  usage["received_datagrams"] = snmp(counters, "Udp", "InDatagrams");
  usage["lost"] = snmp(counters, "Udp", "RcvbufErrors");
  std::ifstream statm(folder + "/statm");
  double pages = 0, resident = 0;
  if (statm >> pages >> resident) usage["resident_mb"] = 1e-6 * resident * static_cast<double>(sysconf(_SC_PAGESIZE));
  return usage;
}

/// Returns for how many seconds the processors of this machine were idle so far, in all.
double idle_processor_seconds() {
  std::istringstream in(read_file("/proc/stat"));
  std::string name;
  double user, nice, system, idle, waiting;
  in >> name >> user >> nice >> system >> idle >> waiting;
  return (idle + waiting) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

/// The progress of training, by the newest lines of its metrics.csv.
struct Progress {
  double steps = 0, episodes = 0;
  double lag = 0;  ///< updates, mean of those lines
};

Progress progress_in(const std::string& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  constexpr std::streamoff kTail = 4096;
  in.seekg(std::max<std::streamoff>(0, in.tellg() - kTail));
  Progress progress;
  std::string line;
  int lines = 0;
  for (std::getline(in, line);
       std::getline(in, line) && !in.eof();) {  // neither the first one nor half of the last one
    double update, lesson;
    const std::size_t comma = line.rfind(',');
    if (std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf", &update, &progress.steps, &progress.episodes, &lesson) != 4)
      continue;
    progress.lag += std::stod(line.substr(comma + 1));
    ++lines;
  }
  progress.lag /= std::max(1, lines);
  return progress;
}

/// The services of one case, and a node that listens to their heartbeats.
class Scene {
 public:
  Scene(const Case& c, const std::string& middleware)
      : case_(c), middleware_(middleware), hosts_(c.envs + c.actors + 4) {
    hosts_.enter(0);
    for (int i = 0; i < c.envs; ++i) start_env(i);
    for (int i = 0; i < c.actors; ++i)
      start("actor-" + std::to_string(i), {CITYLEARN_POLICY_SERVICE, "--role", "actor"});
    if (c.dashboard)
      start("dashboard",
            {CITYLEARN_DASHBOARD, "--port", "0", "--store", folder_ / "store.sqlite", "--recognition", folder_.path()});
    if (c.encoder) start("encoder", {CITYLEARN_ENCODER_SERVICE, "--store", folder_ / "features", "--encoder", "hog"});
    node_ = std::make_unique<Node>(NodeOptions{network("watcher"), "watcher", "watcher", run_});
    node_->create_reader<msg::ServiceStatus>();
  }

  /// Waits until all services have been heard.
  void meet() {
    until([this] { return heard_.size() == services_.size(); }, "not all services were heard");
  }
  void learn() {
    Arguments command = {CITYLEARN_POLICY_SERVICE,
                         "--role",
                         case_.actors > 0 ? "learner" : "both",
                         "--agent",
                         case_.agent,
                         "--steps",
                         "1000000000",
                         "--checkpoint-every",
                         "1000000",
                         "--environments",
                         std::to_string(case_.envs),
                         "--evaluate",
                         "summer",
                         "--tasks",
                         "1",
                         "--output",
                         folder_ / "out"};
    if (case_.large)
      command.insert(command.end(), {"--trainer-agents", "256", "--trainer-segment", "256", "--trainer-sequence", "16",
                                     "--ppo-minibatch", "64"});
    if (!case_.observing.empty()) command.insert(command.end(), {"--observations", case_.observing});
    start("policy", command);
    meet();
  }
  Progress progress() const { return progress_in(folder_ / "out/metrics.csv"); }
  void await_steps(double many) {
    until([&] { return progress().steps >= many; }, "training does not go on");
  }
  /// Waits until the next update has ended.
  void await_update() {
    const double before = progress().steps;
    until([&] { return progress().steps > before; }, "training does not go on");
  }
  void hear(Clock::duration how_long) {
    const Clock::time_point end = Clock::now() + how_long;
    while (Clock::now() < end) spin(std::min(end, Clock::now() + milliseconds(5)));
  }
  std::map<std::string, Figures> usage() const {
    std::map<std::string, Figures> all;
    for (const auto& [id, process] : heard_) all[id] = usage_of(process);
    return all;
  }
  const std::map<std::string, msg::ServiceStatus>& statuses() const { return statuses_; }

 private:
  MiddlewareOptions network(const std::string& id) {
    MiddlewareOptions options = testing::middleware_options(middleware_, kDomain, id);
    options.interfaces = {Hosts::interface()};
    options.peers = peers();
    return options;
  }
  Arguments peers() const {
    Arguments all;
    const int count = case_.envs + case_.actors + 4;
    for (int host = 0; host < count; ++host)
      all.push_back(Hosts::address(host) + (case_.ports ? ":" + std::to_string(7400 + 250 * kDomain + 10) : ""));
    return all;
  }
  void start_env(int number) {
    Arguments command = {CITYLEARN_ENV_SERVICE,    "--agents", std::to_string(case_.agents),
                         "--synthetic-frames",     "160",      "--synthetic-images",
                         case_.encoder ? "1" : "0"};
    if (!case_.encoder) command.insert(command.end(), {"--synthetic-dimension", std::to_string(case_.dimension)});
    start("env-" + std::to_string(number), command);
  }
  void start(const std::string& id, Arguments command) {
    std::string list;
    for (const std::string& peer : peers()) list += (list.empty() ? "" : ",") + peer;
    command.insert(command.end(), {"--id", id, "--session", run_, "--middleware", middleware_, "--domain",
                                   std::to_string(kDomain), "--interface", Hosts::interface(), "--peers", list});
    const int host = static_cast<int>(services_.size()) + 1;  // 0: the watcher
    services_[id] = hosts_.start(host, command, folder_ / (id + ".log"));
  }
  void spin(Clock::time_point deadline) {
    if (stop) throw Error("stopped by a signal");
    node_->wait(deadline);
    msg::ServiceStatus status;
    while (node_->take(status)) {
      const std::string id = status.header().sender().c_str();
      heard_[id] = static_cast<int>(status.process());
      statuses_[id] = status;
    }
  }
  template <class Condition>
  void until(const Condition& condition, const std::string& trouble) {
    const Clock::time_point deadline = Clock::now() + kWaitTimeout;
    while (!condition()) {
      if (Clock::now() > deadline) {
        std::string logs;
        for (const auto& [id, service] : services_) {
          const std::string log = service->output();
          logs += "\n" + id + ": " + log.substr(log.size() > 300 ? log.size() - 300 : 0);
        }
        throw Error(trouble + " within " + std::to_string(kWaitTimeout.count()) + " s" + logs, describe(case_));
      }
      spin(Clock::now() + milliseconds(5));
    }
  }

  const Case case_;
  const std::string middleware_, run_ = "scale";
  const Folder folder_;
  Hosts hosts_;
  std::map<std::string, std::unique_ptr<Service>> services_;
  std::map<std::string, int> heard_;
  std::map<std::string, msg::ServiceStatus> statuses_;
  std::unique_ptr<Node> node_;
};

std::string kind_of(const std::string& id) {
  const std::string kind = id.substr(0, id.find('-'));
  return kind == "policy" ? "learner" : kind;
}

/// Figures of one kind of service in one phase: what was used is the mean of its services and the median of the
/// windows, per step of one agent or per second; messages are per second, as the services count.
struct Row {
  std::string phase, kind;
  int count = 0;
  Figures figures;
};

void print_columns() {
  std::printf("middleware,envs,agents,actors,dimension,agent,observing,dashboard,encoder,ports,large,phase,kind,count");
  for (const char* name : kFigures) std::printf(",%s", name);
  std::printf("\n");
}

void print(const std::string& middleware, const Case& c, Row row) {
  std::printf("%s,%d,%d,%d,%d,%s,%s,%d,%d,%d,%d,%s,%s,%d", middleware.c_str(), c.envs, c.agents, c.actors, c.dimension,
              c.agent.c_str(), c.observing.c_str(), c.dashboard, c.encoder, c.ports, c.large, row.phase.c_str(),
              row.kind.c_str(), row.count);
  for (const char* name : kFigures) std::printf(",%.5g", row.figures[name]);
  std::printf("\n");
  std::fflush(stdout);
}

struct Look {
  double when = 0;  ///< seconds
  std::map<std::string, Figures> usage;
  double idle = 0;  ///< of all processors
  Progress progress;
};

/// Returns what was used between successive looks, by kind: per step, or per second where nothing is learned.
std::vector<Row> rows_of(const std::string& phase, const std::vector<Look>& looks, bool learns) {
  std::map<std::string, std::map<std::string, std::vector<double>>> windows;  // by kind and column
  std::map<std::string, int> counts;
  for (const auto& [id, usage] : looks.front().usage) ++counts[kind_of(id)];
  for (std::size_t w = 1; w < looks.size(); ++w) {
    const Look &from = looks[w - 1], &to = looks[w];
    const double elapsed = to.when - from.when;
    const double per = learns ? to.progress.steps - from.progress.steps : elapsed;
    double cores = 0;
    std::map<std::string, Figures> means;
    for (const auto& [id, usage] : to.usage) {
      Figures before = from.usage.at(id);
      for (const auto& [name, value] : usage) {
        const double used = value - before[name];
        if (name.ends_with("_us")) cores += 1e-6 * used;
        means[kind_of(id)][name] += (name == "resident_mb" ? value : used / per) / counts[kind_of(id)];
      }
    }
    const Figures whole = {{"steps_per_s", learns ? per / elapsed : 0},
                           {"busy_cores", cores / elapsed},
                           {"idle_cores", (to.idle - from.idle) / elapsed},
                           {"episodes_per_step", learns ? (to.progress.episodes - from.progress.episodes) / per : 0},
                           {"lag", to.progress.lag}};
    for (auto& [kind, figures] : means) {
      figures.insert(whole.begin(), whole.end());
      for (const auto& [name, value] : figures) windows[kind][name].push_back(value);
    }
  }
  std::vector<Row> rows;
  for (const auto& [kind, columns] : windows) {
    Row& row = rows.emplace_back(Row{phase, kind, counts[kind], {}});
    for (const auto& [name, values] : columns) row.figures[name] = median(values);
  }
  return rows;
}

double seconds_now() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }

/// Looks at the services at the start and after each window; `next` waits for the end of a window.
template <class Next>
std::vector<Row> observe(Scene& scene, const std::string& phase, int windows, bool learns, const Next& next) {
  std::vector<Look> looks;
  const auto look = [&] {
    looks.push_back({seconds_now(), scene.usage(), idle_processor_seconds(), scene.progress()});
  };
  look();
  auto before = scene.statuses();
  for (int window = 0; window < windows; ++window) {
    next();
    look();
  }
  std::vector<Row> rows = rows_of(phase, looks, learns);
  for (Row& row : rows)
    for (const auto& [id, status] : scene.statuses()) {
      const auto first = before.find(id);
      if (kind_of(id) != row.kind || first == before.end()) continue;
      const double elapsed = std::max(1e-3, status.uptime() - first->second.uptime()) * row.count;
      const auto add = [&](const char* name, std::uint64_t now, std::uint64_t then) {
        row.figures[name] += static_cast<double>(now - then) / elapsed;
      };
      add("received_per_s", status.received(), first->second.received());
      add("repeated_per_s", status.repeated(), first->second.repeated());
      add("resent_per_s", status.resent(), first->second.resent());
    }
  return rows;
}

void measure(const Case& c, const std::string& middleware) {
  std::fprintf(stderr, "%s: %s\n", middleware.c_str(), describe(c).c_str());
  Scene scene(c, middleware);
  scene.meet();
  scene.hear(seconds(2));  // discovery may still go on
  // Since each process began: what it takes to start and to discover each other.
  Look before, begun{1, scene.usage(), 0, {}};
  for (const auto& [id, usage] : begun.usage) before.usage[id] = {};
  for (const Row& row : rows_of("start", {before, begun}, false)) print(middleware, c, row);
  for (const Row& row : observe(scene, "idle", 3, false, [&] { scene.hear(seconds(2)); })) print(middleware, c, row);
  if (!c.runs) return;
  scene.learn();
  scene.await_steps(c.large ? 4 * 65536 : 8192);
  scene.await_update();
  const auto rows = observe(scene, "run", kWindows, true, [&] {
    scene.hear(seconds(1));
    scene.await_update();
  });
  for (const Row& row : rows) print(middleware, c, row);
}

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const int envs : {2, 4, 8, 16}) all.push_back({.envs = envs, .agents = 1, .actors = 0, .runs = false});
  all.push_back({.envs = 8, .agents = 1, .actors = 0, .runs = false, .ports = true});
  for (const int envs : {1, 2, 4, 8}) all.push_back({.envs = envs});
  for (const int agents : {1, 4, 64}) all.push_back({.agents = agents});
  for (const auto& [envs, agents, actors] :
       {std::array{8, 1, 1}, {8, 64, 1}, {2, 16, 2}, {4, 16, 2}, {8, 16, 2}, {4, 16, 4}, {8, 16, 4}, {8, 64, 4}})
    all.push_back({.envs = envs, .agents = agents, .actors = actors});
  all.push_back({.envs = 8, .agents = 64, .actors = 4, .large = true});
  all.push_back({.agents = 64, .dimension = 256});  // by reference: 64 KiB do not fit one datagram
  all.push_back({.envs = 4, .agents = 64, .actors = 2, .dimension = 256});
  for (const auto& [agents, dimension] : {std::pair{16, 64}, {64, 256}})
    for (const char* observing : {"whole", "by_reference"})
      all.push_back({.agents = agents, .actors = 0, .dimension = dimension, .observing = observing});
  all.push_back({.agent = "features"});
  all.push_back({.envs = 2, .actors = 2, .agent = "features"});
  all.push_back({.envs = 2, .dashboard = true});
  all.push_back({.envs = 2, .encoder = true});
  return all;
}

}  // namespace

int main(int argc, char** argv) {
  for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { stop = 1; });
  std::string middleware = "cyclonedds", wanted;
  CLI::App app("What each service costs, on hosts that are network namespaces; needs root", "bench_scale");
  app.add_option("middleware", middleware, "cyclonedds or fastdds")->capture_default_str();
  app.add_option("cases", wanted, "regular expression of the cases to measure; all by default");
  return bench::run(app, argc, argv, [&] {
    print_columns();
    for (const Case& c : cases())
      if (std::regex_search(describe(c), std::regex(wanted))) measure(c, middleware);
  });
}
