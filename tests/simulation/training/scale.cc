// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/training/scale.h"

#include <spdlog/fmt/fmt.h>

#include <memory>
#include <set>
#include <vector>

#include "core/util/error.h"
#include "core/wire/messages.h"
#include "core/wire/service.h"
#include "tests/simulation/machine/network.h"
#include "tests/simulation/training/services.h"

namespace citylearn::simulation {
namespace {

constexpr int kEnvironments = 10;                // of a host
constexpr std::uint64_t kUpdates = 10;           // before what is measured, and in it
constexpr std::uint64_t kMaxStartUpdates = 200;  // updates in which all env_services come to work
constexpr double kMaxSeconds = 600;              // seconds of virtual time
constexpr Time kStep = std::chrono::milliseconds(100);
constexpr Time kStart = std::chrono::milliseconds(5);  // between the starts of two services
constexpr Time kLatency = std::chrono::milliseconds(10);

Layout layout_of(int hosts) {
  Layout layout;
  layout.environments = hosts * kEnvironments;
  layout.agents = 16;
  layout.actors = hosts;
  layout.dashboards = 2;
  layout.updates = 1'000'000;  // it is cut off
  layout.segment = 8;
  layout.learned_agents = 256;
  return layout;
}

class Scale {
 public:
  explicit Scale(const Layout& layout);
  ~Scale() { scheduler_.end(); }
  std::string measure(const std::function<void(const std::string&)>& progress);

 private:
  struct Snapshot {
    std::uint64_t updates = 0;
    Time time{};
    std::map<std::string, Traffic> traffic;
  };
  Snapshot snapshot() const { return {updates_, scheduler_.now(), network_.traffic()}; }
  void add(const std::string& id, Process::Body body) {
    processes_.push_back(std::make_unique<Process>(id, scheduler_, network_, std::move(body)));
  }
  void start();
  /// Goes on for a tenth of a second. Throws Error(`problem`) after `last`, and when it is stopped.
  void step(Time last, const std::string& problem) {
    if (stop_requested() || scheduler_.now() > last) throw Error(problem, "simulation");
    scheduler_.run(scheduler_.now() + kStep);
  }
  bool all_at_work() const { return static_cast<int>(at_work_.size()) == layout_.environments; }
  static double seconds_of(Time time) { return static_cast<double>(time.count()) * 1e-9; }
  std::string table(const Snapshot& before, const Snapshot& after) const;
  std::string measure_late_actor();

  const Layout layout_;
  const Traversal traversal_;
  Scheduler scheduler_{1};
  Network network_{scheduler_, 1};
  std::vector<std::unique_ptr<Process>> processes_;
  std::uint64_t updates_ = 0;
  std::set<std::string> at_work_;  // env_services of which the learner was sent something
};

Scale::Scale(const Layout& layout) : layout_(layout), traversal_(traversal_of(layout_)) {
  network_.faults.even = true;
  network_.faults.latency = kLatency;
  network_.published = [this](Process&, const Topic& topic, std::span<const std::byte> sample) {
    if (topic.type == topic_of<msg::TrainingStat>().type) {
      msg::TrainingStat stat;
      decode(sample, stat);
      updates_ = std::max<std::uint64_t>(updates_, stat.update());
    } else if (topic.type == topic_of<msg::Trajectory>().type) {
      msg::Trajectory trajectory;
      decode(sample, trajectory);
      at_work_.insert(trajectory.environment().c_str());
    }
  };
  for (const auto& [id, body] : dashboards_of(layout_)) add(id, body);
  add(kPolicy, policy_service(layout_, layout_.updates));
  for (const auto& [id, body] : env_services_of(layout_, traversal_)) add(id, body);
  for (const auto& [id, body] : actors_of(layout_)) add(id, body);
}

void Scale::start() {
  // Incarnations of services that start at one moment may be equal.
  Time begin{};
  for (const auto& process : processes_) scheduler_.at(begin += kStart, [&process] { process->start(); });
}

std::string Scale::measure(const std::function<void(const std::string&)>& progress) {
  start();
  Snapshot before;
  while (updates_ < before.updates + kUpdates || before.updates == 0) {
    step(from_seconds(kMaxSeconds), fmt::format("ends after update {}", updates_));
    if (before.updates == 0 && updates_ >= (all_at_work() ? kUpdates : kMaxStartUpdates)) before = snapshot();
    std::uint64_t copies = 0;
    for (const auto& [topic, traffic] : network_.traffic()) copies += traffic.copies;
    progress(fmt::format("{:.1f} s simulated, {} env_services at work, update {}, {:.1f} million copies",
                         seconds_of(scheduler_.now()), at_work_.size(), updates_, static_cast<double>(copies) * 1e-6));
  }
  const std::string counted = table(before, snapshot());
  return counted + measure_late_actor();
}

/// Starts one more actor, and returns what it was sent until it acted.
std::string Scale::measure_late_actor() {
  Layout more = layout_;
  ++more.actors;
  const auto [id, body] = actors_of(more).back();
  std::map<std::string, std::size_t> sent;  // bytes, by message
  bool acted = false;
  const auto is_late = [&id](const Process& process) { return process.name() == id; };
  network_.arrived = [&](Process& receiver, const Topic& topic, std::span<const std::byte> sample) {
    const std::string all = base_topic(topic.name);
    if (is_late(receiver) && !acted) sent[all.substr(all.find('/') + 1)] += sample.size();
  };
  network_.published = [&](Process& sender, const Topic& topic, std::span<const std::byte>) {
    if (is_late(sender) && topic.type == topic_of<msg::Action>().type) acted = true;
  };
  add(id, body);
  processes_.back()->start();
  const Time begin = scheduler_.now();
  while (!acted) step(begin + from_seconds(kMaxSeconds), fmt::format("'{}' was given no env_service", id));
  network_.arrived = {};
  network_.published = {};
  std::string parts;
  for (const auto& [message, bytes] : sent)
    parts += fmt::format("{} {} {:.1f} kB", parts.empty() ? "" : ",", message, static_cast<double>(bytes) * 1e-3);
  return "\nAn actor that joins was sent, until it acted:" + parts + "\n";
}

std::string Scale::table(const Snapshot& before, const Snapshot& after) const {
  const double seconds = seconds_of(after.time - before.time);
  std::string text = fmt::format(
      "{} env_services of {} agents ({} at work), {} actors, a learner, {} dashboards: {} updates in {:.1f} s\n\n",
      layout_.environments, layout_.agents, at_work_.size(), layout_.actors, layout_.dashboards,
      after.updates - before.updates, seconds);
  text +=
      "| message | writers, readers, matches | messages | copies | copies a message | MB "
      "|\n|---|---|---|---|---|---|\n";
  Traffic sum;
  std::size_t matches = 0;
  const auto row = [&text](const std::string& name, const std::string& endpoints, const Traffic& traffic) {
    text += fmt::format(
        "| {} | {} | {} | {} | {:.1f} | {:.1f} |\n", name, endpoints, traffic.published, traffic.copies,
        static_cast<double>(traffic.copies) / static_cast<double>(std::max<std::uint64_t>(traffic.published, 1)),
        static_cast<double>(traffic.bytes) * 1e-6);
  };
  // The topics of single services count as one with that of all.
  std::map<std::string, std::pair<Traffic, Endpoints>> kinds;
  const auto endpoints = network_.endpoints();
  for (const auto& [topic, last] : after.traffic) {
    const auto first = before.traffic.find(topic);
    const Traffic had = first == before.traffic.end() ? Traffic() : first->second;
    auto& [traffic, most] = kinds[base_topic(topic)];
    traffic.published += last.published - had.published;
    traffic.copies += last.copies - had.copies;
    traffic.bytes += last.bytes - had.bytes;
    most.writers += endpoints.at(topic).writers;
    most.readers += endpoints.at(topic).readers;
    most.matches += endpoints.at(topic).matches;
  }
  for (const auto& [name, kind] : kinds) {
    const auto& [traffic, most] = kind;
    sum.published += traffic.published;
    sum.copies += traffic.copies;
    sum.bytes += traffic.bytes;
    matches += most.matches;
    row(name.substr(name.find('/') + 1), fmt::format("{}, {}, {}", most.writers, most.readers, most.matches), traffic);
  }
  row("all", fmt::format("{} matches", matches), sum);
  return text;
}

}  // namespace

std::string measure_scale(int hosts, const std::function<void(const std::string&)>& progress) {
  return Scale(layout_of(hosts)).measure(progress);
}

}  // namespace citylearn::simulation
