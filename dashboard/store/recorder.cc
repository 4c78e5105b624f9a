// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/recorder.h"

#include <spdlog/spdlog.h>

namespace citylearn {
namespace {

// So many are worth a transaction of their own: an env_service that sends again waits for the acknowledgement.
constexpr std::size_t kEnough = 32;
constexpr int kBatchesATurn = 4;  // others want the thread too
constexpr int kTries = 5;         // for TrainingStats that nobody sends

constexpr std::chrono::milliseconds kAnswerGoesOn{250};
constexpr std::chrono::seconds kIdle{1};

}  // namespace

Recorder::Recorder(Node& node, Store& store, const Options& options) : node_(node), store_(store), options_(options) {
  node_.create_writer<msg::EpisodeAcknowledgement>();
  node_.create_writer<msg::TrainingStatRequest>();
  node_.create_reader<msg::EpisodeStat>();
  due_ = next_try_ = Clock::now();
}

bool Recorder::attempt(const std::function<void()>& work) {
  if (failing_ && Clock::now() < next_try_) return false;
  try {
    work();
  } catch (const Error& error) {
    // Not fatal: a disk may be emptied. What is not committed is not acknowledged, so nothing is lost meanwhile.
    next_try_ = Clock::now() + options_.again_after;
    wake_at(next_try_);
    node_.alarm("store", std::string("nothing is recorded: ") + error.what());
    if (!failing_) {
      tell({now_seconds(), "", node_.options().id, "alarm", std::string("nothing is recorded: ") + error.what()});
    }
    failing_ = true;
    return false;
  }
  return true;
}

void Recorder::tell(Event event) {
  if (told) told(event);
  events_.push_back(std::move(event));
}

void Recorder::acknowledge(const Sender& environment, bool leaving) {
  msg::EpisodeAcknowledgement message;
  message.environment(environment.id);
  message.environment_incarnation(environment.incarnation);
  message.episode(store_.recorded(environment));
  message.leaving(leaving);
  node_.publish(message, environment.run);
}

void Recorder::hear(const msg::ServiceStatus& status) {
  const Sender sender(status.header());
  if (status.service() == "env_service") {
    if (status.service_state() == msg::STOPPING || status.service_state() == msg::FAILED) {
      environments_.erase(sender);
      return;
    }
    environments_.insert(sender);
    // Once more with each heartbeat, until its episodes show that it knows: any message may be lost.
    if (!senders_.contains(sender)) attempt([&] { acknowledge(sender, false); });
  } else if (status.service() == "policy_service" && status.service_state() == msg::STOPPING) {
    endings_.insert(sender);
    wake_at(Clock::now());
  }
}

void Recorder::hear(const msg::TraversalInfo& info) {
  const Sender sender(info.header());
  const bool known = environments_.contains(sender);
  environments_.insert(sender);
  if (!known) attempt([&] { acknowledge(sender, false); });
  infos_[sender] = info;
  wake_at(Clock::now());
}

void Recorder::hear(const msg::RunInfo& info) {
  const Sender sender(info.header());
  attempt([&] {
    const bool changed = store_.heard(info);
    const auto [known, fresh] = jobs_.try_emplace({sender, info.run_id()});
    Asked& asked = known->second;
    if (changed || fresh) {
      asked = Asked();
      asked.have = store_.updates(sender, info.run_id());
      asked.complete = Clock::now();
    }
    asked.heard = Clock::now();
    asked.told = std::max(asked.told, info.updates());
    if (changed)
      tell({now_seconds(), sender.run, sender.id, "run",
            std::string(info.agent().c_str()) + ", seed " + std::to_string(info.seed()) +
                (info.ended()         ? " has ended"
                 : info.updates() > 0 ? " goes on after update " + std::to_string(info.updates())
                                      : " begins")});
  });
  wake_at(Clock::now());
}

void Recorder::hear(const msg::TrainingStat& stat) {
  // Of a process that has not said what it does, they are asked for when it has.
  const auto job = jobs_.find({Sender(stat.header()), stat.run_id()});
  if (job == jobs_.end()) return;
  Asked& asked = job->second;
  asked.told = std::max(asked.told, stat.update());
  if (asked.have.contains(stat.update())) return;
  if (stat.update() >= asked.first && stat.update() <= asked.last) {
    ++asked.answers;
    asked.tries = 0;
    asked.next = Clock::now() + kAnswerGoesOn;
  }
  if (stats_.size() >= options_.most_at_once) return;  // the store is stuck; asked for later
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
        if (const auto job = jobs_.find({Sender(stat.header()), stat.run_id()}); job != jobs_.end())
          job->second.have.add(stat.update());
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
      // Of repeated ones too: the env_service has not heard yet that they are recorded.
      for (const Sender& sender : batch) acknowledge(sender, false);
      senders_.merge(batch);
      for (const Event& event : lost) {
        spdlog::warn("{}", event.text);
        if (told) told(event);
      }
    }
    for (auto ending = endings_.begin(); ending != endings_.end(); ending = endings_.erase(ending))
      store_.ended(*ending);
    while (!events_.empty()) {
      store_.record(events_.front());
      events_.erase(events_.begin());
    }
    store_.flush();
    if (!failing_) return;
    // Only here: what merely reads succeeds on a full disk too.
    failing_ = false;
    node_.alarm("store", "");
    tell({now_seconds(), "", node_.options().id, "alarm", "recording again"});
  });
}

void Recorder::turn() {
  due_ = Clock::now() + kIdle;
  for (int batch = 0; batch < kBatchesATurn; ++batch) {
    take();
    const bool full = episodes_.size() >= options_.most_at_once;
    const bool waiting = !episodes_.empty() || !stats_.empty();
    const bool patient = waiting && episodes_.size() < kEnough && Clock::now() < first_waits_ + options_.gather;
    if (patient) {
      wake_at(first_waits_ + options_.gather);
    } else {
      commit();
    }
    if (!full || failing_) break;
    wake_at(Clock::now());  // there may be more
  }
  ask();
}

void Recorder::ask() {
  const Clock::time_point now = Clock::now();
  for (auto& [job, asked] : jobs_) {
    const Sender& sender = job.first;
    if (now - asked.heard > options_.policy_silence) continue;
    const auto gap = asked.have.gap(asked.told);
    if (!gap) {
      asked.complete = now;
      asked.first = asked.last = 0;
      asked.tries = 0;
      continue;
    }
    if (failing_) continue;  // what came could not be kept
    if (asked.first == 0) {
      // What is new may be on its way, or wait for the next commit.
      if (now - asked.complete < options_.ask_after) {
        wake_at(asked.complete + options_.ask_after);
        continue;
      }
    } else {
      const std::uint64_t wanted = std::min<std::uint64_t>(asked.last - asked.first + 1, msg::MAX_STATS_ASKED);
      if (asked.answers < wanted && now < asked.next) {
        wake_at(asked.next);
        continue;
      }
      if (!stats_.empty()) continue;  // the answers, before their commit
      if (asked.answers == 0 && ++asked.tries >= kTries) {
        // A process that went on from a checkpoint does not have what its predecessor did.
        spdlog::info("{} does not have updates {}..{}", sender.id, gap->first, gap->second);
        asked.have.add(gap->first, gap->second);
        asked.first = asked.last = 0;
        asked.tries = 0;
        continue;
      }
    }
    asked.first = gap->first;
    asked.last = gap->second;
    asked.answers = 0;
    asked.next = now + options_.again_after;
    wake_at(asked.next);
    msg::TrainingStatRequest request;
    request.policy(sender.id);
    request.policy_incarnation(sender.incarnation);
    request.run_id(job.second);
    request.first(asked.first);
    request.last(asked.last);
    node_.publish(request, sender.run);
  }
}

void Recorder::finish(bool leave) {
  const Clock::time_point deadline = Clock::now() + kIdle;
  bool more = true;
  while (more && !failing_ && Clock::now() < deadline) {
    take();
    more = !episodes_.empty();
    commit();
  }
  attempt([&] { store_.flush(true); });
  if (!leave) return;
  for (const Sender& environment : environments_) attempt([&] { acknowledge(environment, true); });
}

}  // namespace citylearn
