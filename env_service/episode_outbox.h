// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "core/exchange/log_sender.h"
#include "core/wire/messages.h"
#include "env_service/environment.h"

namespace citylearn {

/// The log of an env_service's finished episodes, with those that a recorder has not acknowledged
/// (docs/decisions/0009-recorders.md). Used by one thread.
class EpisodeOutbox : public LogSender {
 public:
  static constexpr std::size_t kCapacity = LogOptions().capacity;
  static constexpr std::size_t kMaxRecorders = LogOptions().max_readers;

  /// `required` names recorders that are known before they are heard of. `capacity` counts episodes.
  explicit EpisodeOutbox(const std::vector<std::string>& required = {}, std::size_t capacity = kCapacity)
      : LogSender({.capacity = capacity, .records = "episodes", .reader = "recorder"}, required) {}

  /// Sets the settings and the traversal of episodes that are added from now on.
  void set_context(const msg::TaskSettings& settings, const std::string& traversal);
  void add(const Environment::Episode& episode);
  Acknowledged acknowledge(const msg::LogAcknowledgement& acknowledgement, Clock::time_point now);
  /// Fills all but the header from an episode that is kept.
  void fill(std::uint64_t episode, msg::EpisodeStat& stat) const;

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

  std::deque<Entry> entries_;  ///< acknowledged() + 1 .. last()
  std::shared_ptr<const EpisodeContext> context_ = std::make_shared<EpisodeContext>();
};

}  // namespace citylearn
