// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/exchange/log_sender.h"
#include "core/wire/messages.h"
#include "env_service/environment.h"

namespace citylearn {

/// Keeps the finished episodes of an env_service until every recorder has acknowledged them, as a LogSender decides
/// (docs/decisions/0009-recorders.md). It has no wire and no clock of its own. Used by one thread.
class EpisodeOutbox {
 public:
  static constexpr std::size_t kCapacity = LogOptions().capacity;
  static constexpr std::size_t kMaxRecorders = LogOptions().max_readers;

  /// `required` names recorders that are known before they are heard of. `capacity` counts episodes.
  explicit EpisodeOutbox(const std::vector<std::string>& required = {}, std::size_t capacity = kCapacity);

  /// Sets the settings and the traversal of episodes that are added from now on.
  void set_context(const msg::TaskSettings& settings, const std::string& traversal);
  void add(const Environment::Episode& episode);

  using Acknowledged = LogSender::Acknowledged;
  /// As LogSender::acknowledge(): the caller checks that it is for this env_service.
  Acknowledged acknowledge(const msg::LogAcknowledgement& acknowledgement, Clock::time_point now);
  /// As LogSender::force_successor().
  void force_successor(const msg::Header& header, Clock::time_point now) { log_.force_successor(header, now); }

  struct Sending {
    std::uint64_t episode = 0;
    bool again = false;  ///< it was sent before
  };
  /// Returns the next episode to send now, if any.
  std::optional<Sending> next(Clock::time_point now);
  /// As LogSender::due().
  Clock::time_point due() const { return log_.due(); }
  /// As LogSender::hurry().
  void hurry(Clock::time_point now) { log_.hurry(now); }
  /// Fills all but the header from an episode that is kept.
  void fill(std::uint64_t episode, msg::EpisodeStat& stat) const;

  std::uint64_t episodes() const { return log_.last(); }  ///< finished so far
  std::uint64_t acknowledged() const { return log_.acknowledged(); }
  std::size_t kept() const { return entries_.size(); }
  bool recorder_expected(Clock::time_point now) const { return log_.reader_expected(now); }
  std::vector<std::string> recorders() const { return log_.readers(); }
  std::vector<std::string> lacking() const { return log_.lacking(); }
  const std::string& problem() const { return log_.problem(); }

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
  void drop_acknowledged();

  LogSender log_;
  std::deque<Entry> entries_;  ///< acknowledged() + 1 .. episodes()
  std::shared_ptr<const EpisodeContext> context_ = std::make_shared<EpisodeContext>();
};

}  // namespace citylearn
