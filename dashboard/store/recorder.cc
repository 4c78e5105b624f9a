// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/recorder.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace citylearn {
namespace {

// A batch of so many is committed without waiting for more. Each transaction costs a write to the disk.
constexpr std::size_t kCommitBatch = 512;
constexpr int kBatchesPerPoll = 4;       // others need the thread too
constexpr std::size_t kMaxBatch = 2000;  // episodes of a transaction

void fill(const Sender& writer, std::uint64_t stream, std::uint64_t number, msg::ReaderState state,
          msg::LogAcknowledgement& message) {
  message.writer(writer.id);
  message.writer_incarnation(writer.incarnation);
  message.stream(stream);
  message.number(number);
  message.state(state);
}

}  // namespace

Recorder::Recorder(Node& node, Store& store, std::chrono::milliseconds retry_after)
    : node_(node), store_(store), retry_after_(retry_after) {
  node_.create_reader<msg::ServiceStatus>();
  node_.create_reader<msg::TraversalInfo>();
  node_.create_reader<msg::RunInfo>();
  node_.create_reader<msg::TrainingStat>();
  node_.create_reader<msg::EpisodeStat>();
  due_ = next_try_ = Clock::now();
}

bool Recorder::attempt(const std::function<void()>& work) {
  if (failing_ && Clock::now() < next_try_) return false;
  try {
    work();
  } catch (const Error& error) {
    // Not fatal: a disk may get space again. What is not committed is not acknowledged, so nothing is lost meanwhile.
    next_try_ = Clock::now() + retry_after_;
    wake_at(next_try_);
    node_.alarm("store", std::string("nothing is recorded: ") + error.what());
    if (!failing_)
      report({seconds_since_epoch(), "", node_.options().id, "alarm",
              std::string("nothing is recorded: ") + error.what()});
    failing_ = true;
    return false;
  }
  return true;
}

void Recorder::report(Event event) {
  if (on_event) on_event(event);
  events_.push_back(std::move(event));
}

void Recorder::acknowledge(const Sender& environment, msg::ReaderState state) {
  msg::EpisodeAcknowledgement message;
  fill(environment, 0, store_.recorded_up_to(environment), state, message);
  node_.publish(message, environment.session);
}

void Recorder::acknowledge(const RunKey& run, msg::ReaderState state) {
  msg::TrainingAcknowledgement message;
  fill(run.first, run.second, runs_[run].figures.settled().reach(), state, message);
  node_.publish(message, run.first.session);
}

void Recorder::on_message(const msg::ServiceStatus& status) {
  const Sender sender(status.header());
  if (status.service() == "env_service") {
    const bool ends = status.service_state() == msg::STOPPING || status.service_state() == msg::FAILED;
    if (ends)
      environments_.erase(sender);
    else
      environments_.insert(sender);
    // With each heartbeat, also of one that ends: it waits for recorders that live.
    attempt([&] { acknowledge(sender); });
  } else if (status.service() == "policy_service") {
    const bool stopping = status.service_state() == msg::STOPPING;
    for (auto& [key, run] : runs_)
      if (key.first == sender) stopping ? run.process.forget() : run.process.heard(Clock::now());
    if (!stopping) return;
    endings_.insert(sender);
    wake_at(Clock::now());
  }
}

/// Returns whether another living process continues this run. Two processes cannot be one run at a time.
bool Recorder::held_by_other_process(const msg::RunInfo& info) {
  const Sender sender(info.header());
  const auto owner = std::find_if(runs_.begin(), runs_.end(), [&](const auto& entry) {
    const Sender& known = entry.first.first;
    return known.session == sender.session && known.id == sender.id && known.incarnation != sender.incarnation &&
           entry.first.second == info.run_id() && entry.second.process.here(Clock::now());
  });
  if (owner == runs_.end()) return false;
  owner->second.contender = info;
  wake_at(owner->second.process.gone_at());
  return true;
}

void Recorder::on_message(const msg::TraversalInfo& info) {
  const Sender sender(info.header());
  const bool known = environments_.contains(sender);
  environments_.insert(sender);
  if (!known) attempt([&] { acknowledge(sender); });
  infos_[sender] = info;
  wake_at(Clock::now());
}

void Recorder::on_message(const msg::RunInfo& info) {
  const Sender sender(info.header());
  if (held_by_other_process(info)) {
    rejections_.add(info.header(), "a RunInfo of a run that another process goes on with, until that one is silent");
    return;
  }
  attempt([&] {
    const bool changed = store_.record(info);
    const RunKey key(sender, info.run_id());
    const auto [known, fresh] = runs_.try_emplace(key);
    Run& run = known->second;
    info.ended() ? run.process.forget() : run.process.heard(Clock::now());
    // The other one was not a predecessor.
    if (std::exchange(run.contender, std::nullopt) && !std::exchange(run.reported, true))
      report({seconds_since_epoch(), sender.session, sender.id, "alarm",
              "another process announces run " + std::to_string(info.run_id()) + " of '" + sender.id +
                  "' too: what it sends is not recorded"});
    if (changed || fresh) {
      run.figures = {};
      run.figures.record(store_.recorded_stats(sender, info.run_id()));
    }
    acknowledge(key);
    if (changed)
      report({seconds_since_epoch(), sender.session, sender.id, "run",
              std::string(info.agent().c_str()) + ", seed " + std::to_string(info.seed()) +
                  (info.ended()         ? " has ended"
                   : info.updates() > 0 ? " resumes after update " + std::to_string(info.updates())
                                        : " begins")});
  });
  wake_at(Clock::now());
}

void Recorder::on_message(const msg::TrainingStat& stat) {
  // Those of a process whose RunInfo has not arrived come again once it has, and those that find the store stuck.
  if (!runs_.contains({Sender(stat.header()), stat.log().stream()}) || stats_.size() >= kMaxBatch) return;
  if (episodes_.empty() && stats_.empty()) first_waits_ = Clock::now();
  stats_.push_back(stat);
  wake_at(first_waits_ + kCommitGather);
}

void Recorder::take() {
  while (episodes_.size() < kMaxBatch && node_.take(taken_)) {
    if (episodes_.empty() && stats_.empty()) first_waits_ = Clock::now();
    episodes_.push_back(taken_);
  }
}

void Recorder::commit_stats() {
  std::set<RunKey> batch;
  const auto figures_of = [&](const msg::TrainingStat& stat) -> RecordedNumbers& {
    return runs_[*batch.emplace(stat.header(), stat.log().stream()).first].figures;
  };
  node_.traffic.repeated += std::erase_if(
      stats_, [&](const msg::TrainingStat& stat) { return figures_of(stat).recorded().contains(stat.log().number()); });
  if (!stats_.empty()) store_.record(stats_);
  for (const msg::TrainingStat& stat : stats_) {
    figures_of(stat).give_up(1, stat.log().first() - 1);
    figures_of(stat).record(stat.log().number());
  }
  stats_.clear();
  for (const RunKey& key : batch) acknowledge(key);
}

void Recorder::commit() {
  attempt([&] {
    for (auto info = infos_.begin(); info != infos_.end(); info = infos_.erase(info)) store_.describe(info->second);
    commit_stats();
    if (!episodes_.empty()) {
      std::vector<Event> lost;
      const std::size_t fresh = store_.record(episodes_, &lost);
      recorded_ += fresh;
      node_.traffic.repeated += episodes_.size() - fresh;
      std::set<Sender> batch;
      for (const msg::EpisodeStat& episode : episodes_) batch.insert(Sender(episode.header()));
      episodes_.clear();
      // Repeated episodes are acknowledged too: the env_service does not know yet that they are recorded.
      for (const Sender& sender : batch) acknowledge(sender);
      for (const Event& event : lost) {
        spdlog::warn("{}", event.text);
        if (on_event) on_event(event);
      }
    }
    for (auto ending = endings_.begin(); ending != endings_.end(); ending = endings_.erase(ending))
      store_.mark_ended(*ending);
    while (!events_.empty()) {
      store_.record(events_.front());
      events_.erase(events_.begin());
    }
    store_.flush();
    if (!failing_) return;
    // Only here, as what merely reads succeeds on a full disk too.
    failing_ = false;
    node_.alarm("store", "");
    report({seconds_since_epoch(), "", node_.options().id, "alarm", "recording again"});
  });
}

void Recorder::poll() {
  due_ = Clock::now() + kHeartbeat;
  // The last RunInfo of each process that continues the run of a silent one counts now. It may have ended since.
  for (auto& [key, run] : runs_)
    if (run.contender && !run.process.here(Clock::now())) on_message(*std::exchange(run.contender, std::nullopt));
  for (int batch = 0; batch < kBatchesPerPoll; ++batch) {
    take();
    const bool full = episodes_.size() >= kMaxBatch;
    const bool waiting = !episodes_.empty() || !stats_.empty();
    const bool patient = waiting && episodes_.size() < kCommitBatch && Clock::now() < first_waits_ + kCommitGather;
    if (patient) {
      wake_at(first_waits_ + kCommitGather);
    } else {
      commit();
    }
    if (!full || failing_) break;
    wake_at(Clock::now());  // there may be more
  }
}

void Recorder::finish(bool leave) {
  const Clock::time_point deadline = Clock::now() + kHeartbeat;
  bool more = true;
  while (more && !failing_ && Clock::now() < deadline) {
    take();
    more = !episodes_.empty();
    commit();
  }
  attempt([&] { store_.flush(true); });
  for (const Sender& environment : environments_)
    attempt([&] { acknowledge(environment, leave ? msg::LEAVES : msg::STOPS); });
  for (const auto& [key, run] : runs_)
    if (run.process.here(Clock::now())) acknowledge(key, msg::LEAVES);  // figures are kept all the same
}

}  // namespace citylearn
