// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/wire/messages.h"
#include "core/wire/presence.h"
#include "env_service/environment.h"

namespace citylearn {

/// The finished episodes of an env_service, kept until every recorder has acknowledged them, and what is to be sent of
/// them when (docs/decisions/0009-recorders.md). No wire and no clock of its own. Used by one thread.
///
/// Each episode is to be sent once, and again for a recorder that lacks it: as fast as it acknowledges, or, when it
/// does not, less and less often.
class EpisodeBook {
 public:
  static constexpr std::size_t kMost = 1'000'000;  ///< episodes kept

  /// `required`: recorders that are known before they are heard of. Beyond `most` kept episodes, whoever is furthest
  /// behind is no recorder any more; where there is none, the oldest are lost. problem() tells either.
  explicit EpisodeBook(const std::vector<std::string>& required = {}, std::size_t most = kMost);

  /// Episodes ended from now on ran under these settings, on this traversal.
  void begin(const msg::TaskSettings& settings, const std::string& traversal);
  void add(const Environment::Episode& episode);

  enum class Taken { kYes, kRepeated, kImpossible };
  /// Only its header, episode and leaving are looked at.
  Taken take(const msg::EpisodeAcknowledgement& acknowledgement, Clock::time_point now);
  /// A sign of life; of whoever is no recorder it is passed over. `stopping`: it was the last one.
  void heard(const msg::Header& header, bool stopping, Clock::time_point now);

  struct Sending {
    std::uint64_t episode = 0;
    bool again = false;  ///< it was sent before
  };
  /// The next one to be sent now, if any.
  std::optional<Sending> next(Clock::time_point now);
  /// When next() will have something, as far as is known: the clock's beginning means now.
  Clock::time_point due() const;
  /// What is not acknowledged goes out again now and at short intervals.
  void hurry(Clock::time_point now);
  /// Fills all but the header of an episode that is kept.
  void fill(std::uint64_t episode, msg::EpisodeStat& stat) const;

  std::uint64_t episodes() const { return episodes_; }       ///< ended
  std::uint64_t acknowledged() const { return forgotten_; }  ///< by everyone, up to this one; they are no longer kept
  std::size_t kept() const { return entries_.size(); }
  /// There is a recorder that lacks episodes, and lives as far as is known.
  bool awaited(Clock::time_point now) const;
  std::vector<std::string> recorders() const;
  /// What was given up because too much was kept; empty while nothing was.
  const std::string& problem() const { return problem_; }

 private:
  struct Under {  ///< what episodes of the same settings share
    msg::SettingsId settings;
    bool evaluation = false, shuffled = false;
    std::string traversal, policy;
    std::uint64_t update = 0, job = 0;
  };
  struct Entry {
    std::shared_ptr<const Under> under;
    std::uint32_t agent, task, start, goal, steps, shortest;
    float reward;
    bool completed;
    std::vector<std::uint8_t> path;
  };
  static constexpr std::chrono::milliseconds kAgain{200};
  struct Recorder {
    bool here = false;                           ///< it has not left
    std::uint64_t incarnation = 0, message = 0;  ///< of its newest acknowledgement
    std::uint64_t acknowledged = 0;
    std::uint64_t sent = 0;   ///< those behind `acknowledged` up to this one are on their way to it
    std::uint64_t limit = 0;  ///< those up to this one may be
    Clock::duration interval = kAgain;
    Clock::time_point again{};  ///< when all of them count as lost
    Presence presence;
    bool stopping = false;
  };
  void open(Recorder& recorder, std::uint64_t window, Clock::time_point now) const;
  void leave(Recorder& recorder);
  void forget_what_all_have();
  void forget(std::uint64_t up_to);
  void bound();
  template <class Book, class Visit>
  static void each(Book& book, Visit visit);

  const std::size_t most_;
  std::deque<Entry> entries_;  ///< forgotten_ + 1 .. episodes_
  std::uint64_t episodes_ = 0, forgotten_ = 0, sent_ = 0;
  std::shared_ptr<const Under> under_ = std::make_shared<Under>();
  std::map<std::string, Recorder> recorders_;  ///< those who left too, so that what comes late does not bring them back
  std::size_t here_ = 0;                       ///< recorders that have not left
  Recorder nobody_;                            ///< in their place while there are none
  std::string problem_;
};

}  // namespace citylearn
