// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/training/training.h"

#include <malloc.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <opencv2/core.hpp>
#include <set>
#include <tuple>
#include <utility>

#include "core/files/csv.h"
#include "core/files/files.h"
#include "core/recording/mcap.h"
#include "core/util/sha256.h"
#include "core/wire/messages.h"
#include "dashboard/store/database.h"
#include "policy_service/distributed/parameter_fetch.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "tests/simulation/training/invariants.h"
#include "tests/simulation/training/services.h"

namespace citylearn::simulation {
namespace {

constexpr double kRecovery = 2;  // seconds in which a recorder tries again whose disk was full
constexpr double kQuiet = 30;    // seconds after the last fault in which partitions and stalls end

std::string describe(const Process& process) {
  return process.name() + (process.running()           ? " runs"
                           : process.starts() == 0     ? " was not started"
                           : process.failure().empty() ? " ended with status " + std::to_string(process.status())
                                                       : " failed: " + process.failure());
}

bool succeeded(const Process& process) { return process.starts() > 0 && !process.running() && process.status() == 0; }

std::size_t memory_in_use() {
  const auto use = ::mallinfo2();
  return use.uordblks + use.hblkhd;
}

/// Adds what a file holds to `records.recorded`: each episode, as often as it stands there.
void read_csv(const std::string& path, Records& records) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  while (std::getline(file, line)) {
    const std::vector<std::string> fields = csv_fields(line);
    if (fields.size() > 3) ++records.recorded[{fields[0], std::stoull(fields[1])}][std::stoull(fields[2])];
  }
}

void read_store(const std::string& path, Records& records) {
  if (!std::filesystem::exists(path)) return;
  SQLite::Database database = open_database(path);
  SQLite::Statement rows(database,
                         "SELECT environment, incarnation, episode FROM episodes e JOIN sources s ON s.id = e.source");
  while (rows.executeStep()) {
    const std::uint64_t incarnation = std::stoull(value_at<std::string>(rows, 1));
    ++records.recorded[{value_at<std::string>(rows, 0), incarnation}][std::stoull(value_at<std::string>(rows, 2))];
  }
  SQLite::Statement sources(database, "SELECT environment, incarnation, contiguous, missed FROM sources");
  while (sources.executeStep()) {
    const Source source(value_at<std::string>(sources, 0), std::stoull(value_at<std::string>(sources, 1)));
    records.settled[source] = value_at<std::uint64_t>(sources, 2);
    records.missed[source] = value_at<std::uint64_t>(sources, 3);
  }
}

/// Adds the episodes of all recordings that can be read, which may have one many times. Returns what is wrong with
/// another one; empty: nothing.
std::string read_recordings(Records& records) {
  std::string fault;
  for (const std::string& path : recordings()) try {
      Records found;
      McapReader reader(path);
      while (const auto message = reader.next()) {
        if (message->channel->topic != topic_of<msg::EpisodeStat>().name) continue;
        msg::EpisodeStat stat;
        try {
          decode(message->data, stat);
        } catch (const Error&) {
          continue;  // it came like that
        }
        ++found.recorded[{stat.header().sender().c_str(), stat.header().incarnation()}][stat.log().number()];
      }
      for (const auto& [source, episodes] : found.recorded)
        for (const auto& [episode, count] : episodes) records.recorded[source][episode] += count;
    } catch (const Error& error) {
      fault = error.what();
    }
  return fault;
}

/// The services of a training, as processes.
class Training {
 public:
  explicit Training(const Scenario& scenario);
  ~Training() { scheduler_.end(); }
  Outcome play();

 private:
  enum class Phase { kTraining, kServices, kRecorders, kReplay, kCalmReplay, kLeaving, kOver };
  using Group = std::vector<Process*>;

  Process* add(const std::string& id, Process::Body body);
  void watch(const Process& sender, const Topic& topic, std::span<const std::byte> sample);
  std::string check_parameters(const msg::LearnerInfo& info);
  void supervise();
  void advance();
  bool stop(const Group& group);
  std::string state() const;
  void gather_evidence();

  const Scenario& scenario_;
  const Layout& layout_;
  Traversal traversal_;
  Scheduler scheduler_;
  Network network_;
  std::vector<std::unique_ptr<Process>> processes_;
  Process* policy_ = nullptr;
  Group envs_, services_, recorders_;              // services_: all that are neither policy_ nor recorders
  Process *replay_ = nullptr, *viewer_ = nullptr;  // where something is replayed
  Group twins_;                                    // second processes of their ids
  std::unique_ptr<FaultInjector> faults_;
  Phase phase_ = Phase::kTraining;
  Time calm_since_{};
  bool faults_stopped_ = false;
  std::map<std::tuple<std::uint64_t, std::string, std::uint64_t>, std::uint64_t> commanded_;  // versions of settings
  struct Finished {
    Source source;
    std::uint64_t last = 0;  // episode
    int start = 0;           // of the process
  };
  std::map<const Process*, Finished> finished_;                      // by what published one last
  std::set<std::tuple<int, std::uint64_t, std::uint64_t>> checked_;  // parameters
  Evidence evidence_;
};

Training::Training(const Scenario& scenario)
    : scenario_(scenario),
      layout_(scenario.layout),
      traversal_(traversal_of(layout_)),
      scheduler_(scenario.seed),
      network_(scheduler_, scenario.seed) {
  policy_ = add(kPolicy, policy_service(layout_, scenario.checkpoint_every));
  for (const auto& [id, body] : dashboards_of(layout_)) recorders_.push_back(add(id, body));
  const std::vector<Service> envs = env_services_of(layout_, traversal_);
  for (const auto& [id, body] : envs) envs_.push_back(add(id, body));
  services_ = envs_;
  for (const auto& [id, body] : actors_of(layout_)) services_.push_back(add(id, body));
  for (const auto& [id, body] : encoder_services_of(layout_)) services_.push_back(add(id, body));
  if (layout_.replayed) {
    recorders_.push_back(add("record", record_tool()));
    viewer_ = add(kViewer, dashboard(kViewer, kReplayed));
    replay_ = add("replay", replay_tool());
  }
  for (const auto& [id, body] : envs) twins_.push_back(add(id + "-twin", body));
  twins_.push_back(add(std::string(kPolicy) + "-twin", policy_service(layout_, scenario.checkpoint_every)));
  twins_.back()->share_disk(*policy_);
  network_.published = [this](const Process& sender, const Topic& topic, std::span<const std::byte> sample) {
    watch(sender, topic, sample);
  };
  evidence_.output = kPolicy;
  evidence_.steps = layout_.steps();
  evidence_.expected_agent = scenario.expected_agent;
}

Process* Training::add(const std::string& id, Process::Body body) {
  return processes_.emplace_back(std::make_unique<Process>(id, scheduler_, network_, std::move(body))).get();
}

/// Notes what recorders acknowledge, env_services finish and learners announce.
void Training::watch(const Process& sender, const Topic& topic, std::span<const std::byte> sample) {
  if (topic.name.ends_with("/episode_acknowledgement")) {
    msg::EpisodeAcknowledgement message;
    decode(sample, message);
    const std::string& recorder = &sender == twins_.back() ? policy_->name() : sender.name();
    std::uint64_t& last =
        evidence_.recorders[recorder].acknowledged[{message.writer().c_str(), message.writer_incarnation()}];
    last = std::max<std::uint64_t>(last, message.number());
  } else if (topic.type == topic_of<msg::EpisodeStat>().type) {
    if (&sender == replay_) return;  // what came damaged is replayed so
    msg::EpisodeStat message;
    decode(sample, message);
    Finished& finished = finished_[&sender];
    const Source now(message.header().sender().c_str(), message.header().incarnation());
    finished.last = std::max<std::uint64_t>(finished.source == now ? finished.last : 0, message.log().number());
    finished.source = now;
    finished.start = sender.starts();
  } else if (layout_.encoders > 0 && topic.type == topic_of<msg::TaskSettings>().type) {
    // A policy_service may let an env_service begin anew whose encoder_service has gone.
    msg::TaskSettings message;
    decode(sample, message);
    const auto [known, fresh] =
        commanded_.try_emplace({message.settings().incarnation(), message.environment().c_str(), message.seed()},
                               message.settings().version());
    evidence_.envs_restarted |= message.task_mode() == msg::TRAIN && known->second != message.settings().version();
  } else if (topic.type == topic_of<msg::LearnerInfo>().type) {
    msg::LearnerInfo message;
    decode(sample, message);
    if (evidence_.wrong_parameters.empty()) evidence_.wrong_parameters = check_parameters(message);
  }
}

/// Returns what is wrong with parameters that a learner announces.
std::string Training::check_parameters(const msg::LearnerInfo& info) {
  const std::uint64_t version = info.version(), hash = info.hash();
  const std::string path = std::string(kPolicy) + "/checkpoints/checkpoint-" + std::to_string(version) + ".clk";
  if (version == 0 || !std::filesystem::exists(path) || !checked_.insert({policy_->starts(), version, hash}).second)
    return "";
  const Matrix<float> saved = read_checkpoint(path).tensors.at("learner.parameters");
  return parameters_object(0, version, info.agent().c_str(), saved.reshaped()).checksum == hash
             ? ""
             : "those of update " + std::to_string(version) + " differ";
}

void Training::supervise() {
  scheduler_.after(std::chrono::milliseconds(100), [this] {
    advance();
    if (phase_ != Phase::kOver) supervise();
  });
}

/// Asks the processes of a group to stop. Returns whether all have ended and none will be started again.
bool Training::stop(const Group& group) {
  bool ended = true;
  for (Process* process : group) {
    if (process->running()) process->request_stop();
    ended &= !process->running() && (faults_stopped_ || process->status() == 0);
  }
  return ended;
}

/// Ends the services once the policy_service has done its work, those last that others wait for, and then replays.
void Training::advance() {
  const auto stop_faults = [this] {
    faults_->stop();
    faults_stopped_ = true;
  };
  switch (phase_) {
    case Phase::kTraining:
      if (!succeeded(*policy_)) return;
      evidence_.trained = true;
      if (!replay_) stop_faults();
      for (Process* twin : twins_) twin->kill();
      calm_since_ = scheduler_.now();
      phase_ = Phase::kServices;
      [[fallthrough]];
    case Phase::kServices:
      if (scheduler_.now() < calm_since_ + from_seconds(kRecovery) || !stop(services_)) return;
      phase_ = Phase::kRecorders;
      [[fallthrough]];
    case Phase::kRecorders:
      if (!stop(recorders_)) return;
      phase_ = replay_ ? Phase::kReplay : Phase::kOver;
      if (!replay_) return;
      viewer_->start();
      replay_->start();
      return;
    case Phase::kReplay:
      // Once more when nothing goes wrong: a replay does not wait for a dashboard that is away for long.
      if (!succeeded(*replay_) || scheduler_.now() < from_seconds(scenario_.faults.until + kQuiet)) return;
      replay_->start();
      phase_ = Phase::kCalmReplay;
      return;
    case Phase::kCalmReplay:
      if (!succeeded(*replay_)) return;
      evidence_.replayed = true;
      phase_ = Phase::kLeaving;
      [[fallthrough]];
    case Phase::kLeaving:
      if (!stop({viewer_})) return;
      stop_faults();
      phase_ = Phase::kOver;
      return;
    case Phase::kOver:
      return;
  }
}

std::string Training::state() const {
  std::string text;
  for (const auto& process : processes_) text += (text.empty() ? "" : ", ") + describe(*process);
  return text;
}

void Training::gather_evidence() {
  evidence_.state = state();
  for (const auto& process : processes_) process->disk().power_on();
  evidence_.unexpected_errors = faults_->unexpected_errors();
  read_csv(std::string(kPolicy) + "/episodes.csv", evidence_.recorders[kPolicy]);
  for (const Process* process : recorders_)
    if (const std::string store = process->name() + ".db"; std::filesystem::exists(store))
      read_store(store, evidence_.recorders[process->name()]);
  for (const Process* process : recorders_) evidence_.recorders[process->name()].ended = succeeded(*process);
  if (!replay_)  // else faults go on when they end
    for (const Process* env : envs_)
      if (const auto found = finished_.find(env);
          found != finished_.end() && found->second.start == env->starts() && succeeded(*env))
        evidence_.finished.insert({found->second.source, found->second.last});
  evidence_.processes = processes_.size();
  if (replay_) {
    read_store(std::string(kViewer) + ".db", evidence_.recorders[kViewer]);
    const std::string fault = read_recordings(evidence_.recordings);
    if (!faults_->counts().contains("power")) evidence_.recording_fault = fault;
  }
  if (const auto newest = newest_checkpoint(std::string(kPolicy) + "/checkpoints"))
    evidence_.agent = sha256(read_file(*newest));
  for (const Process* env : envs_) evidence_.envs_restarted |= env->starts() > 1;
  for (const Process* twin : twins_) evidence_.envs_restarted |= twin != twins_.back() && twin->starts() > 0;
}

Outcome Training::play() {
  cv::setNumThreads(0);  // threads of a library decide nothing, but a fork does not inherit them
  Group all;
  for (const auto& process : processes_)
    if (std::find(twins_.begin(), twins_.end(), process.get()) == twins_.end()) all.push_back(process.get());
  faults_ = std::make_unique<FaultInjector>(scheduler_, network_, all, twins_, scenario_.faults, scenario_.seed);
  if (scenario_.log)
    faults_->log = [this](const std::string& line) {
      scenario_.log(std::to_string(static_cast<double>(scheduler_.now().count()) * 1e-9) + " s  " + line);
    };
  for (Process* process : all)
    if (process != viewer_ && process != replay_) process->start();
  supervise();
  const double last = scenario_.faults.until + scenario_.patience;
  // Processes that wait to be started again have no task, so the end of all tasks is not the end.
  const std::size_t before = memory_in_use();
  while (!evidence_.at_rest && scheduler_.now() < from_seconds(last)) {
    evidence_.at_rest = scheduler_.run(scheduler_.now() + std::chrono::seconds(1)) && phase_ == Phase::kOver;
    evidence_.memory = std::max(evidence_.memory, memory_in_use() - std::min(before, memory_in_use()));
  }
  gather_evidence();

  Outcome outcome;
  for (const Invariant& invariant : invariants())
    if (const std::string wrong = invariant.violation(evidence_); !wrong.empty())
      outcome.violations.push_back(std::string(invariant.name) + ": " + wrong);
  outcome.agent = evidence_.agent;
  outcome.trace = scheduler_.trace();
  outcome.seconds = static_cast<double>(scheduler_.now().count()) * 1e-9;
  outcome.switches = scheduler_.switches();
  for (const auto& [source, episodes] : evidence_.recorders[kPolicy].acknowledged) outcome.episodes += episodes;
  outcome.faults = faults_->counts();
  outcome.traffic = network_.traffic();
  return outcome;
}

}  // namespace

Outcome play(const Scenario& scenario) { return Training(scenario).play(); }

}  // namespace citylearn::simulation
