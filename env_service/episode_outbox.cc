// SPDX-License-Identifier: Apache-2.0
#include "env_service/episode_outbox.h"

#include <algorithm>
#include <tuple>
#include <utility>

namespace citylearn {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kLongestResendInterval{2000}, kHurriedResendInterval{50};
constexpr std::uint64_t kResendWindow = 64;  // sent again to a recorder that does not answer
constexpr std::uint64_t kSendWindow = 1024;  // on their way to a recorder that acknowledges

}  // namespace

EpisodeOutbox::EpisodeOutbox(const std::vector<std::string>& required, std::size_t capacity) : capacity_(capacity) {
  for (const std::string& name : required) recorders_[name].registered = true;
  registered_ = recorders_.size();
}

template <class Outbox, class Visit>
void EpisodeOutbox::each_recorder(Outbox& outbox, Visit visit) {
  if (outbox.registered_ == 0) visit(outbox.anonymous_recorder_);
  for (auto& [name, recorder] : outbox.recorders_)
    if (recorder.registered) visit(recorder);
}

void EpisodeOutbox::set_context(const msg::TaskSettings& settings, const std::string& traversal) {
  context_ = std::make_shared<EpisodeContext>(EpisodeContext{settings.settings(), settings.task_mode() == msg::EVALUATE,
                                                             settings.shuffle(), traversal, settings.policy().c_str(),
                                                             settings.update(), settings.run_id()});
}

void EpisodeOutbox::add(const Environment::Episode& episode) {
  entries_.push_back({context_, episode});
  ++episodes_;
  if (entries_.size() > capacity_) enforce_capacity();
}

void EpisodeOutbox::fill(std::uint64_t number, msg::EpisodeStat& stat) const {
  const auto& [context, episode] = entries_.at(number - discarded_ - 1);
  stat.settings() = context->settings;
  stat.episode() = number;
  stat.acknowledged() = discarded_;
  stat.agent() = static_cast<std::uint32_t>(episode.agent);
  stat.evaluation() = context->evaluation;
  stat.task() = static_cast<std::uint32_t>(episode.task);
  stat.traversal() = context->traversal.c_str();
  stat.start() = static_cast<std::uint32_t>(episode.start);
  stat.goal() = static_cast<std::uint32_t>(episode.goal);
  stat.steps() = static_cast<std::uint32_t>(episode.steps);
  stat.shortest() = static_cast<std::uint32_t>(episode.shortest);
  stat.reward() = episode.reward;
  stat.completed() = episode.completed;
  stat.shuffled() = context->shuffled;
  stat.policy() = context->policy.c_str();
  stat.update() = context->update;
  stat.run_id() = context->run_id;
  stat.path() = episode.path;
}

// Recorders.

bool EpisodeOutbox::Recorder::hear(const msg::Header& header, Clock::time_point now) {
  const Incumbent::Heard heard = presence.hear(header.incarnation(), now);
  if (heard == Incumbent::Heard::kSuccessor) {
    order = MessageOrder();
    fresh = true;
  }
  return heard != Incumbent::Heard::kOther;
}

bool EpisodeOutbox::has_room(const std::string& name, Clock::time_point now) {
  if (recorders_.size() < kMostRecorders || recorders_.contains(name)) return true;
  const auto gone = std::find_if(recorders_.begin(), recorders_.end(), [&](const auto& entry) {
    return !entry.second.registered && !entry.second.presence.here(now);
  });
  if (gone == recorders_.end()) return false;
  recorders_.erase(gone);
  return true;
}

EpisodeOutbox::Acknowledged EpisodeOutbox::acknowledge(const msg::EpisodeAcknowledgement& acknowledgement,
                                                       Clock::time_point now) {
  if (acknowledgement.episode() > episodes_) return Acknowledged::kImpossible;
  const msg::Header& header = acknowledgement.header();
  const std::string name = header.sender().c_str();
  if (!has_room(name, now)) return Acknowledged::kTooMany;
  Recorder& recorder = recorders_[name];
  if (!recorder.hear(header, now) || !recorder.order.in_order(header, now)) return Acknowledged::kRepeated;
  const bool fresh = std::exchange(recorder.fresh, false) || !recorder.registered;
  const bool leaves = acknowledgement.recorder() == msg::LEAVES;
  recorder.stopping = acknowledgement.recorder() != msg::RECORDS;
  if (recorder.stopping) recorder.presence.leave();
  const std::uint64_t has = std::max<std::uint64_t>(acknowledgement.episode(), discarded_);
  const bool progress = has > recorder.acknowledged, loss = has < recorder.acknowledged;
  if (!recorder.registered) {
    if (leaves) return Acknowledged::kRepeated;
    recorder.registered = true;
    ++registered_;
  }
  if (fresh || loss) recorder.sent = has;
  recorder.acknowledged = has;
  if (fresh || loss)
    open_window(recorder, kResendWindow, now);
  else if (progress)
    open_window(recorder, kSendWindow, now);
  discard_acknowledged();
  if (leaves) unregister(recorder);
  return fresh || loss || progress || leaves ? Acknowledged::kYes : Acknowledged::kRepeated;
}

void EpisodeOutbox::believe(const msg::Header& header, Clock::time_point now) {
  const auto found = recorders_.find(header.sender().c_str());
  if (found == recorders_.end() || found->second.presence.incarnation() == header.incarnation()) return;
  found->second.presence.leave();
  found->second.hear(header, now);
}

bool EpisodeOutbox::recorder_expected(Clock::time_point now) const {
  return std::any_of(recorders_.begin(), recorders_.end(), [&](const auto& entry) {
    const Recorder& recorder = entry.second;
    if (!recorder.registered || recorder.acknowledged == episodes_) return false;
    // Also one that was started again a moment ago.
    return (!recorder.stopping && recorder.presence.here(now)) || recorder.presence.has_rival(now);
  });
}

std::vector<std::string> EpisodeOutbox::recorders() const {
  std::vector<std::string> names;
  for (const auto& [name, recorder] : recorders_)
    if (recorder.registered) names.push_back(name);
  return names;
}

std::vector<std::string> EpisodeOutbox::lacking() const {
  std::vector<std::string> names;
  for (const auto& [name, recorder] : recorders_)
    if (recorder.registered && recorder.acknowledged < episodes_) names.push_back("'" + name + "'");
  return names;
}

void EpisodeOutbox::unregister(Recorder& recorder) {
  recorder.registered = false;
  recorder.acknowledged = 0;
  if (--registered_ > 0) discard_acknowledged();
}

void EpisodeOutbox::discard_acknowledged() {
  std::uint64_t all = episodes_;
  for (const auto& [name, recorder] : recorders_)
    if (recorder.registered) all = std::min(all, recorder.acknowledged);
  if (registered_ > 0) discard(all);
}

void EpisodeOutbox::discard(std::uint64_t up_to) {
  if (up_to <= discarded_) return;
  entries_.erase(entries_.begin(), entries_.begin() + static_cast<std::ptrdiff_t>(up_to - discarded_));
  discarded_ = up_to;
  sent_ = std::max(sent_, discarded_);
  anonymous_recorder_.acknowledged = discarded_;
  anonymous_recorder_.sent = std::max(anonymous_recorder_.sent, discarded_);
  anonymous_recorder_.limit = std::max(anonymous_recorder_.limit, anonymous_recorder_.sent);
}

/// Gives up a recorder that does not come before it gives up memory, or the episodes of the others.
void EpisodeOutbox::enforce_capacity() {
  while (entries_.size() > capacity_ && registered_ > 0) {
    auto last = recorders_.end();
    for (auto recorder = recorders_.begin(); recorder != recorders_.end(); ++recorder) {
      const auto key = [](const auto& of) {
        return std::make_tuple(of->second.acknowledged, of->second.presence.last_heard());
      };
      if (recorder->second.registered && (last == recorders_.end() || key(recorder) < key(last))) last = recorder;
    }
    problem_ = "more than " + std::to_string(capacity_) + " episodes wait for recorder '" + last->first +
               "': they are no longer kept for it";
    unregister(last->second);
  }
  if (entries_.size() <= capacity_) return;
  problem_ = "more than " + std::to_string(capacity_) + " episodes and no recorder: the oldest are lost";
  discard(episodes_ - capacity_);
}

// Sending.

/// Lets the next `window` episodes be on their way to the recorder, which has a while to answer.
void EpisodeOutbox::open_window(Recorder& recorder, std::uint64_t window, Clock::time_point now) const {
  recorder.sent = std::max(recorder.sent, recorder.acknowledged);
  recorder.limit = std::max(recorder.sent, std::min(sent_, recorder.acknowledged + window));
  recorder.interval = kResendInterval;
  recorder.again = now + recorder.interval;
}

std::optional<EpisodeOutbox::Sending> EpisodeOutbox::next(Clock::time_point now) {
  std::optional<Sending> found;
  if (sent_ < episodes_) {
    found = Sending{++sent_, false};
  } else {
    each_recorder(*this, [&](Recorder& recorder) {
      if (recorder.acknowledged < sent_ && now >= recorder.again) {
        recorder.sent = recorder.acknowledged;
        recorder.limit = std::min(sent_, recorder.acknowledged + kResendWindow);
        recorder.interval = std::min<Clock::duration>(2 * recorder.interval, kLongestResendInterval);
        recorder.again = now + recorder.interval;
      }
      if (!found && recorder.sent < recorder.limit) found = Sending{recorder.sent + 1, true};
    });
  }
  if (!found) return found;
  // All recorders hear it, so those that would have got it next have got it.
  each_recorder(*this, [&](Recorder& recorder) {
    if (recorder.sent + 1 != found->episode) return;
    if (recorder.sent == recorder.acknowledged && !found->again) open_window(recorder, 0, now);  // its wait begins now
    ++recorder.sent;
    recorder.limit = std::max(recorder.limit, recorder.sent);
  });
  return found;
}

Clock::time_point EpisodeOutbox::due() const {
  if (sent_ < episodes_) return {};
  Clock::time_point due = Clock::time_point::max();
  each_recorder(*this, [&](const Recorder& recorder) {
    if (recorder.sent < recorder.limit)
      due = {};
    else if (recorder.acknowledged < sent_)
      due = std::min(due, recorder.again);
  });
  return due;
}

void EpisodeOutbox::hurry(Clock::time_point now) {
  each_recorder(*this, [&](Recorder& recorder) {
    recorder.interval = kHurriedResendInterval;
    recorder.again = now;
  });
}

}  // namespace citylearn
