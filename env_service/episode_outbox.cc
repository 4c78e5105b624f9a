// SPDX-License-Identifier: Apache-2.0
#include "env_service/episode_outbox.h"

#include <algorithm>
#include <tuple>

namespace citylearn {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kAgainAtMost{2000}, kAgainInAHurry{50};
constexpr std::uint64_t kAtOnce = 64;      // sent again to who does not answer
constexpr std::uint64_t kOnTheWay = 1024;  // to who acknowledges

}  // namespace

EpisodeBook::EpisodeBook(const std::vector<std::string>& required, std::size_t most) : most_(most) {
  for (const std::string& name : required) recorders_[name].here = true;
  here_ = recorders_.size();
}

template <class Book, class Visit>
void EpisodeBook::each(Book& book, Visit visit) {
  if (book.here_ == 0) visit(book.nobody_);
  for (auto& [name, recorder] : book.recorders_)
    if (recorder.here) visit(recorder);
}

void EpisodeBook::begin(const msg::TaskSettings& settings, const std::string& traversal) {
  auto under = std::make_shared<Under>();
  under->settings = settings.settings();
  under->evaluation = settings.task_mode() == msg::EVALUATE;
  under->shuffled = settings.shuffle();
  under->traversal = traversal;
  under->policy = settings.policy().c_str();
  under->update = settings.update();
  under->job = settings.run_id();
  under_ = under;
}

void EpisodeBook::add(const Environment::Episode& episode) {
  entries_.push_back({under_, static_cast<std::uint32_t>(episode.agent), static_cast<std::uint32_t>(episode.task),
                      static_cast<std::uint32_t>(episode.start), static_cast<std::uint32_t>(episode.goal),
                      static_cast<std::uint32_t>(episode.steps), static_cast<std::uint32_t>(episode.shortest),
                      episode.reward, episode.completed, episode.path});
  ++episodes_;
  if (entries_.size() > most_) bound();
}

void EpisodeBook::fill(std::uint64_t episode, msg::EpisodeStat& stat) const {
  const Entry& entry = entries_.at(episode - forgotten_ - 1);
  stat.settings() = entry.under->settings;
  stat.episode() = episode;
  stat.acknowledged() = forgotten_;
  stat.agent() = entry.agent;
  stat.evaluation() = entry.under->evaluation;
  stat.task() = entry.task;
  stat.traversal() = entry.under->traversal.c_str();
  stat.start() = entry.start;
  stat.goal() = entry.goal;
  stat.steps() = entry.steps;
  stat.shortest() = entry.shortest;
  stat.reward() = entry.reward;
  stat.completed() = entry.completed;
  stat.shuffled() = entry.under->shuffled;
  stat.policy() = entry.under->policy.c_str();
  stat.update() = entry.under->update;
  stat.run_id() = entry.under->job;
  stat.path() = entry.path;
}

// Who has what.

EpisodeBook::Taken EpisodeBook::take(const msg::EpisodeAcknowledgement& acknowledgement, Clock::time_point now) {
  if (acknowledgement.episode() > episodes_) return Taken::kImpossible;
  const msg::Header& header = acknowledgement.header();
  Recorder& recorder = recorders_[header.sender().c_str()];
  if (std::make_tuple(header.incarnation(), header.message()) <=
      std::make_tuple(recorder.incarnation, recorder.message))
    return Taken::kRepeated;
  const bool fresh = !recorder.here || header.incarnation() != recorder.incarnation;
  recorder.incarnation = header.incarnation();
  recorder.message = header.message();
  recorder.presence.heard(now);
  recorder.stopping = false;
  const std::uint64_t has = std::max<std::uint64_t>(acknowledgement.episode(), forgotten_);
  const bool progress = has > recorder.acknowledged, loss = has < recorder.acknowledged;
  if (!recorder.here) {
    if (acknowledgement.leaving()) return Taken::kRepeated;
    recorder.here = true;
    ++here_;
  }
  if (fresh || loss) recorder.sent = has;
  recorder.acknowledged = has;
  if (fresh || loss)
    open(recorder, kAtOnce, now);
  else if (progress)
    open(recorder, kOnTheWay, now);
  forget_what_all_have();
  if (acknowledgement.leaving()) leave(recorder);
  return fresh || loss || progress || acknowledgement.leaving() ? Taken::kYes : Taken::kRepeated;
}

void EpisodeBook::heard(const msg::Header& header, bool stopping, Clock::time_point now) {
  const auto found = recorders_.find(header.sender().c_str());
  if (found == recorders_.end() || header.incarnation() < found->second.incarnation) return;
  found->second.presence.heard(now);
  found->second.stopping = stopping;
}

bool EpisodeBook::awaited(Clock::time_point now) const {
  return std::any_of(recorders_.begin(), recorders_.end(), [&](const auto& entry) {
    const Recorder& recorder = entry.second;
    return recorder.here && recorder.acknowledged < episodes_ && !recorder.stopping && recorder.presence.here(now);
  });
}

std::vector<std::string> EpisodeBook::recorders() const {
  std::vector<std::string> names;
  for (const auto& [name, recorder] : recorders_)
    if (recorder.here) names.push_back(name);
  return names;
}

void EpisodeBook::leave(Recorder& recorder) {
  recorder.here = false;
  recorder.acknowledged = 0;
  if (--here_ > 0) forget_what_all_have();
}

void EpisodeBook::forget_what_all_have() {
  std::uint64_t all = episodes_;
  for (const auto& [name, recorder] : recorders_)
    if (recorder.here) all = std::min(all, recorder.acknowledged);
  if (here_ > 0) forget(all);
}

void EpisodeBook::forget(std::uint64_t up_to) {
  if (up_to <= forgotten_) return;
  entries_.erase(entries_.begin(), entries_.begin() + static_cast<std::ptrdiff_t>(up_to - forgotten_));
  forgotten_ = up_to;
  sent_ = std::max(sent_, forgotten_);
  nobody_.acknowledged = forgotten_;
  nobody_.sent = std::max(nobody_.sent, forgotten_);
  nobody_.limit = std::max(nobody_.limit, nobody_.sent);
}

/// Rather a recorder that does not come than memory without end, or the episodes of the others.
void EpisodeBook::bound() {
  while (entries_.size() > most_ && here_ > 0) {
    auto last = recorders_.end();
    for (auto recorder = recorders_.begin(); recorder != recorders_.end(); ++recorder) {
      const auto key = [](const auto& of) { return std::make_tuple(of->second.acknowledged, of->second.presence); };
      if (recorder->second.here && (last == recorders_.end() || key(recorder) < key(last))) last = recorder;
    }
    problem_ = "more than " + std::to_string(most_) + " episodes wait for recorder '" + last->first +
               "': they are no longer kept for it";
    leave(last->second);
  }
  if (entries_.size() <= most_) return;
  problem_ = "more than " + std::to_string(most_) + " episodes and no recorder: the oldest are lost";
  forget(episodes_ - most_);
}

// What to send.

/// The next `window` may be on their way to it; it has a while to answer.
void EpisodeBook::open(Recorder& recorder, std::uint64_t window, Clock::time_point now) const {
  recorder.sent = std::max(recorder.sent, recorder.acknowledged);
  recorder.limit = std::max(recorder.sent, std::min(sent_, recorder.acknowledged + window));
  recorder.interval = kAgain;
  recorder.again = now + recorder.interval;
}

std::optional<EpisodeBook::Sending> EpisodeBook::next(Clock::time_point now) {
  std::optional<Sending> found;
  if (sent_ < episodes_) {
    found = Sending{++sent_, false};
  } else {
    each(*this, [&](Recorder& recorder) {
      if (recorder.acknowledged < sent_ && now >= recorder.again) {
        recorder.sent = recorder.acknowledged;
        recorder.limit = std::min(sent_, recorder.acknowledged + kAtOnce);
        recorder.interval = std::min<Clock::duration>(2 * recorder.interval, kAgainAtMost);
        recorder.again = now + recorder.interval;
      }
      if (!found && recorder.sent < recorder.limit) found = Sending{recorder.sent + 1, true};
    });
  }
  if (!found) return found;
  // Everyone hears it, so whoever would have got it next has got it.
  each(*this, [&](Recorder& recorder) {
    if (recorder.sent + 1 != found->episode) return;
    if (recorder.sent == recorder.acknowledged && !found->again) open(recorder, 0, now);  // it waits from now on
    ++recorder.sent;
    recorder.limit = std::max(recorder.limit, recorder.sent);
  });
  return found;
}

Clock::time_point EpisodeBook::due() const {
  if (sent_ < episodes_) return {};
  Clock::time_point due = Clock::time_point::max();
  each(*this, [&](const Recorder& recorder) {
    if (recorder.sent < recorder.limit)
      due = {};
    else if (recorder.acknowledged < sent_)
      due = std::min(due, recorder.again);
  });
  return due;
}

void EpisodeBook::hurry(Clock::time_point now) {
  each(*this, [&](Recorder& recorder) {
    recorder.interval = kAgainInAHurry;
    recorder.again = now;
  });
}

}  // namespace citylearn
