// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "core/wire/node.h"
#include "tests/support/wait.h"

namespace citylearn::testing {

/// The episodes that a recorder has on disk: they outlive the process.
using EpisodeStore = std::map<std::string, std::map<std::uint64_t, msg::EpisodeStat>>;  // by env_service and number

/// Records the episodes of all env_services of a run, and acknowledges what it has.
class Recorder {
 public:
  Recorder(const MiddlewareOptions& middleware, const std::string& run, const std::string& id, EpisodeStore& kept)
      : store(kept), node({middleware, "recorder", id, run}) {
    node.create_writer<msg::EpisodeAcknowledgement>();
    node.create_reader<msg::TraversalInfo>();
    node.create_reader<msg::EpisodeStat>();
  }

  EpisodeStore& store;
  Node node;
  int repeated = 0;                               ///< episodes that were in the store already
  std::map<std::string, std::uint64_t> recorded;  ///< by env_service: all up to this one are here, or nobody's any more

  bool until(const std::function<bool()>& condition, milliseconds patience = kMaxWait) {
    return eventually([this] { spin(); }, condition, patience);
  }
  void spin() {
    node.wait(Clock::now() + milliseconds(20));
    bool news = Clock::now() >= next_;
    while (node.take(info_)) {
      const std::string id = info_.header().sender().c_str();
      news = news || !incarnations_.contains(id);
      incarnations_[id] = std::max<std::uint64_t>(incarnations_[id], info_.header().incarnation());
    }
    while (node.take(episode_)) {
      const std::string id = episode_.header().sender().c_str();
      incarnations_[id] = std::max<std::uint64_t>(incarnations_[id], episode_.header().incarnation());
      repeated += !store[id].emplace(episode_.log().number(), episode_).second;
      recorded[id] = std::max<std::uint64_t>(recorded[id], episode_.log().first() - 1);
      while (store[id].contains(recorded[id] + 1)) ++recorded[id];
      news = true;
    }
    if (news) acknowledge(false);
  }
  void acknowledge(bool leaving) {
    next_ = Clock::now() + milliseconds(200);
    for (const auto& [id, incarnation] : incarnations_) {
      msg::EpisodeAcknowledgement message;
      message.writer() = id;
      message.writer_incarnation() = incarnation;
      message.number() = recorded[id];
      message.state() = leaving ? msg::LEAVES : msg::READS;
      node.publish(message);
    }
  }

 private:
  std::map<std::string, std::uint64_t> incarnations_;
  Clock::time_point next_{};
  msg::TraversalInfo info_;
  msg::EpisodeStat episode_;
};

}  // namespace citylearn::testing
