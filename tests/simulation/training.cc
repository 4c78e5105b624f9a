// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/training.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>

#include "core/files/csv.h"
#include "core/files/files.h"
#include "core/util/sha256.h"
#include "core/wire/messages.h"
#include "dashboard/store/database.h"
#include "dashboard/store/recorder.h"
#include "env_service/dataset_io/dataset.h"
#include "env_service/env_service.h"
#include "policy_service/network/checkpoint.h"
#include "policy_service/run/policy_service.h"
#include "tests/simulation/invariants.h"
#include "tests/support/records/record_until.h"

namespace citylearn::simulation {
namespace {

constexpr const char* kOutput = "policy";
constexpr const char* kStore = "store.db";

std::string describe(const Process& process) {
  return process.name() + (process.running()           ? " runs"
                           : process.failure().empty() ? " ended with status " + std::to_string(process.status())
                                                       : " failed: " + process.failure());
}

void read_csv(Records& records) {
  std::ifstream file(std::string(kOutput) + "/episodes.csv");
  std::string line;
  std::getline(file, line);
  while (std::getline(file, line)) {
    const std::vector<std::string> fields = csv_fields(line);
    if (fields.size() > 3) ++records.recorded[{fields[0], std::stoull(fields[1])}][std::stoull(fields[2])];
  }
}

void read_store(Records& records) {
  if (!std::filesystem::exists(kStore)) return;
  SQLite::Database database = open_database(kStore);
  SQLite::Statement rows(database,
                         "SELECT environment, incarnation, episode FROM episodes e JOIN sources s ON s.id = e.source");
  while (rows.executeStep()) {
    const std::uint64_t incarnation = std::stoull(value_at<std::string>(rows, 1));
    ++records.recorded[{value_at<std::string>(rows, 0), incarnation}][std::stoull(value_at<std::string>(rows, 2))];
  }
}

/// The services of a training, as processes.
class Training {
 public:
  explicit Training(const Scenario& scenario);
  ~Training() { scheduler_.end(); }
  Outcome play();

 private:
  int run_env(const std::string& id, const std::function<bool()>& stop) const;
  int run_policy() const;
  static int run_recorder(const std::function<bool()>& stop);
  void watch(const Process& sender, const Topic& topic, std::span<const std::byte> sample);
  void finish_when_trained();
  std::string state() const;

  const Scenario& scenario_;
  Traversal traversal_;
  Scheduler scheduler_;
  Network network_;
  std::vector<std::unique_ptr<Process>> envs_;
  Process policy_, recorder_;
  std::unique_ptr<FaultInjector> faults_;
  Evidence evidence_;
};

Training::Training(const Scenario& scenario)
    : scenario_(scenario),
      scheduler_(scenario.seed),
      network_(scheduler_, scenario.seed),
      policy_("policy", scheduler_, network_, [this](const auto&) { return run_policy(); }),
      recorder_("recorder", scheduler_, network_, run_recorder) {
  const auto& entry = DatasetRegistry::instance().find("dataset", "synthetic");
  traversal_ =
      entry.create(Parameters(entry.name, entry.parameters, {{"frames", 64}, {"images", 0}}), "")->load("summer");
  for (int i = 0; i < scenario.environments; ++i) {
    const std::string id = "env-" + std::to_string(i);
    envs_.push_back(std::make_unique<Process>(
        id, scheduler_, network_, [this, id](const std::function<bool()>& stop) { return run_env(id, stop); }));
  }
  network_.published = [this](const Process& sender, const Topic& topic, std::span<const std::byte> sample) {
    watch(sender, topic, sample);
  };
  evidence_.output = kOutput;
  evidence_.steps = scenario.steps;
  evidence_.expected_agent = scenario.expected_agent;
}

int Training::run_env(const std::string& id, const std::function<bool()>& stop) const {
  EnvServiceOptions options;
  options.node.id = id;
  options.agents = scenario_.agents;
  options.recorders = {policy_.name(), recorder_.name()};
  run_env_service(options, traversal_, stop);
  return 0;
}

int Training::run_policy() const {
  PolicyServiceOptions options;
  options.node.service = "policy_service";
  options.node.id = policy_.name();
  options.agent = "place_filter";
  options.frames = 16;
  options.steps = scenario_.steps;
  options.checkpoint_every = scenario_.checkpoint_every;
  options.tasks = 8;
  options.evaluate = {"summer"};
  options.environments = scenario_.environments;
  options.lockstep = true;
  options.seed = 5;
  options.resume = true;
  options.output = kOutput;
  return run_policy_service(options);
}

/// A dashboard without a page.
int Training::run_recorder(const std::function<bool()>& stop) {
  Store store({kStore, 0});
  Node node({{}, "dashboard", "recorder", "default"});
  Recorder recorder(node, store);
  node.report(msg::RUNNING, "records");
  testing::record_until(node, recorder, stop);
  return 0;
}

/// Notes what recorders acknowledge.
void Training::watch(const Process& sender, const Topic& topic, std::span<const std::byte> sample) {
  if (topic.name != topic_of<msg::EpisodeAcknowledgement>().name) return;
  msg::EpisodeAcknowledgement message;
  decode(sample, message);
  std::uint64_t& last = evidence_.recorders[sender.name()]
                            .acknowledged[{message.environment().c_str(), message.environment_incarnation()}];
  last = std::max<std::uint64_t>(last, message.episode());
}

/// Ends the other services once the policy_service has done its work.
void Training::finish_when_trained() {
  scheduler_.after(std::chrono::milliseconds(100), [this] {
    const bool trained = policy_.starts() > 0 && !policy_.running() && policy_.status() == 0;
    if (trained && !evidence_.trained) {
      faults_->stop();
      evidence_.trained = true;
      for (const auto& env : envs_) env->request_stop();
    }
    // Last, as env_services wait for it.
    if (trained && std::none_of(envs_.begin(), envs_.end(), [](const auto& env) { return env->running(); }))
      recorder_.request_stop();
    if (!trained || recorder_.running()) finish_when_trained();
  });
}

std::string Training::state() const {
  std::string text = describe(policy_) + ", " + describe(recorder_);
  for (const auto& env : envs_) text += ", " + describe(*env);
  return text;
}

Outcome Training::play() {
  std::vector<Process*> all{&policy_, &recorder_};
  for (const auto& env : envs_) all.push_back(env.get());
  faults_ = std::make_unique<FaultInjector>(scheduler_, network_, all, scenario_.faults, scenario_.seed);
  if (scenario_.log)
    faults_->log = [this](const std::string& line) {
      scenario_.log(std::to_string(static_cast<double>(scheduler_.now().count()) * 1e-9) + " s  " + line);
    };
  for (Process* process : all) process->start();
  finish_when_trained();
  const double last = scenario_.faults.until + scenario_.patience;
  // Processes that wait to be started again have no task, so the end of all tasks is not the end.
  while (!evidence_.at_rest && scheduler_.now() < from_seconds(last))
    evidence_.at_rest = scheduler_.run(scheduler_.now() + std::chrono::seconds(1)) && evidence_.trained;
  evidence_.state = state();
  read_csv(evidence_.recorders[policy_.name()]);
  read_store(evidence_.recorders[recorder_.name()]);
  if (const auto newest = newest_checkpoint(std::string(kOutput) + "/checkpoints"))
    evidence_.agent = sha256(read_file(*newest));
  for (const auto& env : envs_) evidence_.envs_restarted |= env->starts() > 1;

  Outcome outcome;
  for (const Invariant& invariant : invariants())
    if (const std::string wrong = invariant.violation(evidence_); !wrong.empty())
      outcome.violations.push_back(std::string(invariant.name) + ": " + wrong);
  outcome.agent = evidence_.agent;
  outcome.trace = scheduler_.trace();
  outcome.seconds = static_cast<double>(scheduler_.now().count()) * 1e-9;
  outcome.switches = scheduler_.switches();
  for (const auto& [source, episodes] : evidence_.recorders[policy_.name()].acknowledged) outcome.episodes += episodes;
  outcome.faults = faults_->counts();
  outcome.traffic = network_.traffic();
  return outcome;
}

}  // namespace

Outcome play(const Scenario& scenario) { return Training(scenario).play(); }

}  // namespace citylearn::simulation
