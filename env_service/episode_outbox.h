// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/presence/incumbent.h"
#include "core/presence/message_order.h"
#include "core/wire/messages.h"
#include "env_service/environment.h"

namespace citylearn {

/// Keeps the finished episodes of an env_service until every recorder has acknowledged them, and decides which of them
/// to send when (docs/decisions/0009-recorders.md). It has no wire and no clock of its own. Used by one thread.
///
/// Each episode is sent once, and again to a recorder that lacks it: as fast as the recorder acknowledges, or, when it
/// does not, less and less often.
class EpisodeOutbox {
 public:
  static constexpr std::size_t kCapacity = 1'000'000;  ///< episodes kept
  static constexpr std::size_t kMostRecorders = 64;    ///< known at a time: anybody may say that it records

  /// `required` names recorders that are known before they are heard of. Beyond `capacity` kept episodes, the recorder
  /// that is furthest behind is dropped; without recorders, the oldest episodes are lost. problem() reports either.
  explicit EpisodeOutbox(const std::vector<std::string>& required = {}, std::size_t capacity = kCapacity);

  /// Episodes added from now on ran under these settings, on this traversal.
  void set_context(const msg::TaskSettings& settings, const std::string& traversal);
  void add(const Environment::Episode& episode);

  enum class Acknowledged { kYes, kRepeated, kImpossible, kTooMany };
  /// Reads all of the acknowledgement but whom it is for. Recorders acknowledge once a second, which shows that they
  /// live. Beyond kMostRecorders a newcomer takes the
  /// place of one that left and is silent; kTooMany: there is none.
  Acknowledged acknowledge(const msg::EpisodeAcknowledgement& acknowledgement, Clock::time_point now);

  /// The sender speaks for its id from now on, for reasons that are not known here.
  void believe(const msg::Header& header, Clock::time_point now);

  struct Sending {
    std::uint64_t episode = 0;
    bool again = false;  ///< it was sent before
  };
  /// Returns the next episode to send now, if any.
  std::optional<Sending> next(Clock::time_point now);
  /// Returns when next() will have something, as far as is known. The clock's epoch means now.
  Clock::time_point due() const;
  /// Resends what is not acknowledged now and at short intervals.
  void hurry(Clock::time_point now);
  /// Fills all but the header from an episode that is kept.
  void fill(std::uint64_t episode, msg::EpisodeStat& stat) const;

  std::uint64_t episodes() const { return episodes_; }       ///< finished so far
  std::uint64_t acknowledged() const { return discarded_; }  ///< all up to this one are acknowledged, no longer kept
  std::size_t kept() const { return entries_.size(); }
  /// Returns whether a recorder lacks episodes and is alive as far as is known.
  bool recorder_expected(Clock::time_point now) const;
  std::vector<std::string> recorders() const;
  /// Returns those that lack episodes, as far as is known.
  std::vector<std::string> lacking() const;
  /// Says what was given up because too much was kept; empty while nothing was.
  const std::string& problem() const { return problem_; }

 private:
  struct EpisodeContext {  ///< what episodes of the same settings share
    msg::SettingsId settings;
    bool evaluation = false, shuffled = false;
    std::string traversal, policy;
    std::uint64_t update = 0, run_id = 0;
  };
  struct Entry {
    std::shared_ptr<const EpisodeContext> context;
    Environment::Episode episode;
  };
  static constexpr std::chrono::milliseconds kResendInterval{200};
  struct Recorder {
    bool registered = false;  ///< it has not left
    MessageOrder order;       ///< of its acknowledgements
    bool fresh = true;        ///< no acknowledgement of its present process has come
    std::uint64_t acknowledged = 0;
    std::uint64_t sent = 0;   ///< episodes after `acknowledged` up to this one are on their way to it
    std::uint64_t limit = 0;  ///< episodes up to this one may be sent
    Clock::duration interval = kResendInterval;
    Clock::time_point again{};  ///< when all that is on its way counts as lost
    Incumbent presence;
    bool stopping = false;

    /// Returns false for a message of another process than the one that records.
    bool hear(const msg::Header& header, Clock::time_point now);
  };
  bool has_room(const std::string& name, Clock::time_point now);
  void open_window(Recorder& recorder, std::uint64_t window, Clock::time_point now) const;
  void unregister(Recorder& recorder);
  void discard_acknowledged();
  void discard(std::uint64_t up_to);
  void enforce_capacity();
  template <class Outbox, class Visit>
  static void each_recorder(Outbox& outbox, Visit visit);

  const std::size_t capacity_;
  std::deque<Entry> entries_;  ///< discarded_ + 1 .. episodes_
  std::uint64_t episodes_ = 0, discarded_ = 0, sent_ = 0;
  std::shared_ptr<const EpisodeContext> context_ = std::make_shared<EpisodeContext>();
  std::map<std::string, Recorder> recorders_;  ///< with those that left, so that late messages do not bring them back
  std::size_t registered_ = 0;                 ///< recorders that have not left
  Recorder anonymous_recorder_;                ///< sent to while no recorder is registered
  std::string problem_;
};

}  // namespace citylearn
