// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "core/wire/node.h"
#include "tests/support/options.h"
#include "tests/support/records/episodes_csv.h"
#include "tests/support/wait.h"

namespace citylearn::testing {

/// Hears what the services of a domain say of themselves and acknowledge to one another, and says nothing.
class Witness {
 public:
  Witness(const std::string& middleware, std::uint32_t domain)
      : node({middleware_options(middleware, domain), "witness", "witness", ""}) {
    node.create_reader<msg::ServiceStatus>();
    node.create_reader<msg::TrainingStat>();
    node.create_reader<msg::EpisodeStat>();
  }

  Node node;
  std::uint64_t updates = 0;                         ///< TrainingStats heard
  std::uint64_t steps = 0;                           ///< in the newest of them
  std::map<std::string, msg::ServiceStatus> status;  ///< of the newest process, by id
  std::map<Source, std::uint64_t> finished;          ///< by env_service: the largest number of an episode heard
  /// The last acknowledged episode, by recorder and env_service.
  std::map<std::string, std::map<Source, std::uint64_t>> acknowledged;

  void spin() {
    node.wait(Clock::now() + milliseconds(20));
    while (node.take(status_)) {
      msg::ServiceStatus& known = status[status_.header().sender().c_str()];
      if (status_.header().incarnation() >= known.header().incarnation()) known = status_;
      if (status_.service() == "env_service")
        node.create_reader_at<msg::EpisodeAcknowledgement>(status_.header().sender().c_str(),
                                                           status_.header().session().c_str());
    }
    while (node.take(stat_)) {
      ++updates;
      steps = stat_.steps();
    }
    while (node.take(episode_)) {
      std::uint64_t& largest = finished[{episode_.header().sender().c_str(), episode_.header().incarnation()}];
      largest = std::max<std::uint64_t>(largest, episode_.log().number());
    }
    while (node.take(acknowledgement_)) {
      std::uint64_t& largest = acknowledged[acknowledgement_.header().sender().c_str()]
                                           [{acknowledgement_.writer().c_str(), acknowledgement_.writer_incarnation()}];
      largest = std::max<std::uint64_t>(largest, acknowledgement_.number());
    }
  }
  bool until(const std::function<bool()>& condition, milliseconds patience) {
    return eventually([this] { spin(); }, condition, patience);
  }
  /// Listens for this time, whatever happens.
  void listen(milliseconds time) {
    until([] { return false; }, time);
  }
  std::uint64_t incarnation(const std::string& id) const {
    const auto found = status.find(id);
    return found == status.end() ? 0 : found->second.header().incarnation();
  }
  std::string alarm(const std::string& id) const {
    const auto found = status.find(id);
    return found == status.end() ? "" : found->second.alarm().c_str();
  }
  /// Returns the episodes of the newest process of an env_service.
  std::uint64_t episodes(const std::string& id) const {
    const auto found = finished.find({id, incarnation(id)});
    return found == finished.end() ? 0 : found->second;
  }

 private:
  msg::ServiceStatus status_;
  msg::TrainingStat stat_;
  msg::EpisodeStat episode_;
  msg::EpisodeAcknowledgement acknowledgement_;
};

}  // namespace citylearn::testing
