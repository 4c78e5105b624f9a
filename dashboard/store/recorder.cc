// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/recorder.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace citylearn {
namespace {

// A batch of so many is committed without waiting for more, because env_services resend until the acknowledgement.
constexpr std::size_t kCommitBatch = 32;
constexpr int kBatchesPerPoll = 4;  // others need the thread too
constexpr int kMaxTries = 5;        // requests for TrainingStats that do not come

}  // namespace

Recorder::Recorder(Node& node, Store& store, const Options& options) : node_(node), store_(store), options_(options) {
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
    next_try_ = Clock::now() + options_.retry_after;
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

void Recorder::acknowledge(const Sender& environment, msg::RecorderState recorder) {
  msg::EpisodeAcknowledgement message;
  message.environment(environment.id);
  message.environment_incarnation(environment.incarnation);
  message.episode(store_.recorded_up_to(environment));
  message.recorder(recorder);
  node_.publish(message, environment.session);
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
    for (auto& [run, requests] : runs_)
      if (run.first == sender) stopping ? requests.process.forget() : requests.process.heard(Clock::now());
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

/// Accepts the last RunInfo of each process that continues the run of a silent one. They may have ended since.
void Recorder::promote_successors() {
  std::vector<msg::RunInfo> successors;
  for (auto& [run, requests] : runs_)
    if (requests.contender && !requests.process.here(Clock::now()))
      successors.push_back(*std::exchange(requests.contender, std::nullopt));
  for (const msg::RunInfo& info : successors) on_message(info);
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
    const auto [known, fresh] = runs_.try_emplace({sender, info.run_id()});
    StatRequests& requests = known->second;
    info.ended() ? requests.process.forget() : requests.process.heard(Clock::now());
    // The other one was not a predecessor.
    if (std::exchange(requests.contender, std::nullopt) && !std::exchange(requests.reported, true))
      report({seconds_since_epoch(), sender.session, sender.id, "alarm",
              "another process announces run " + std::to_string(info.run_id()) + " of '" + sender.id +
                  "' too: what it sends is not recorded"});
    if (changed || fresh) {
      StatRequests next;
      next.process = requests.process;
      next.reported = requests.reported;
      requests = std::move(next);
      requests.updates.record(store_.recorded_updates(sender, info.run_id()));
      requests.complete = Clock::now();
    }
    requests.heard = Clock::now();
    requests.made = std::max(requests.made, info.updates());
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
  // Those of a process whose RunInfo has not arrived are requested once it has.
  const auto run = runs_.find({Sender(stat.header()), stat.run_id()});
  if (run == runs_.end()) return;
  StatRequests& requests = run->second;
  requests.made = std::max(requests.made, stat.update());
  if (requests.updates.recorded().contains(stat.update())) return;
  if (stat.update() >= requests.first && stat.update() <= requests.last) {
    ++requests.answers;
    requests.tries = 0;
    requests.next = Clock::now() + kNextReplyTimeout;
  }
  if (stats_.size() >= options_.most_at_once) return;  // the store is stuck; they are requested later
  if (episodes_.empty() && stats_.empty()) first_waits_ = Clock::now();
  stats_.push_back(stat);
  wake_at(first_waits_ + options_.gather);
}

void Recorder::take() {
  while (episodes_.size() < options_.most_at_once && node_.take(taken_)) {
    if (episodes_.empty() && stats_.empty()) first_waits_ = Clock::now();
    episodes_.push_back(taken_);
  }
}

void Recorder::commit() {
  attempt([&] {
    for (auto info = infos_.begin(); info != infos_.end(); info = infos_.erase(info)) store_.describe(info->second);
    if (!stats_.empty()) {
      store_.record(stats_);
      for (const msg::TrainingStat& stat : stats_)
        if (const auto run = runs_.find({Sender(stat.header()), stat.run_id()}); run != runs_.end())
          run->second.updates.record(stat.update());
      stats_.clear();
    }
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
  promote_successors();
  for (int batch = 0; batch < kBatchesPerPoll; ++batch) {
    take();
    const bool full = episodes_.size() >= options_.most_at_once;
    const bool waiting = !episodes_.empty() || !stats_.empty();
    const bool patient = waiting && episodes_.size() < kCommitBatch && Clock::now() < first_waits_ + options_.gather;
    behind_ = full || patient;
    if (patient) {
      wake_at(first_waits_ + options_.gather);
    } else {
      commit();
    }
    if (!full || failing_) break;
    wake_at(Clock::now());  // there may be more
  }
  request_missing();
}

void Recorder::request_missing() {
  const Clock::time_point now = Clock::now();
  for (auto& [run, requests] : runs_) {
    const Sender& sender = run.first;
    if (now - requests.heard > options_.policy_silence) continue;
    const auto gap = requests.updates.settled().gap(requests.made);
    if (!gap) {
      requests.complete = now;
      requests.first = requests.last = 0;
      requests.tries = 0;
      continue;
    }
    if (failing_) continue;  // what arrives could not be kept
    if (requests.first == 0) {
      // New ones may be on their way, or wait for the next commit.
      if (now - requests.complete < options_.request_after) {
        wake_at(requests.complete + options_.request_after);
        continue;
      }
    } else {
      const std::uint64_t wanted = std::min<std::uint64_t>(requests.last - requests.first + 1, msg::MAX_STATS_ASKED);
      if (requests.answers < wanted && now < requests.next) {
        wake_at(requests.next);
        continue;
      }
      if (!stats_.empty()) continue;  // the answers, before their commit
      if (requests.answers == 0 && ++requests.tries >= kMaxTries) {
        // A process that resumed from a checkpoint does not have what its predecessor did.
        spdlog::info("updates {}..{} of '{}' are unavailable", gap->first, gap->second, sender.id);
        requests.updates.give_up(gap->first, gap->second);
        requests.first = requests.last = 0;
        requests.tries = 0;
        continue;
      }
    }
    requests.first = gap->first;
    requests.last = gap->second;
    requests.answers = 0;
    requests.next = now + options_.retry_after;
    wake_at(requests.next);
    msg::TrainingStatRequest request;
    request.policy(sender.id);
    request.policy_incarnation(sender.incarnation);
    request.run_id(run.second);
    request.first(requests.first);
    request.last(requests.last);
    node_.publish(request, sender.session);
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
}

}  // namespace citylearn
