// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "core/exchange/presence.h"
#include "core/util/wall_clock.h"
#include "core/wire/node.h"
#include "dashboard/live/maps.h"
#include "dashboard/live/pictures.h"
#include "tools/ros2/translation.h"

namespace citylearn {

/// Translates what goes on in the node's session: reads the scenes of each env_service, or its observations and
/// actions, and fetches maps and pictures. It sends no settings, no actions and no acknowledgements. Used by the thread
/// of the node.
class Ros2Bridge {
 public:
  struct Options {
    Ros2Translation::Options translation;
    int widest = 640;      ///< of pictures, pixels
    bool actions = false;  ///< reads all observations and actions, for what scenes do not say
    std::function<std::uint64_t()> time = nanoseconds_since_epoch;  ///< of stamps; 0: not known, then nothing is said
  };
  /// `node` and `sink` must outlive it.
  Ros2Bridge(Node& node, Ros2Sink& sink, const Options& options);

  /// Takes what has come and does what is due. Call it when a message may have arrived, and at due().
  void poll();
  Clock::time_point due() const;
  /// Returns how many env_services are heard.
  std::size_t environments() const { return hosts_.size(); }

 private:
  void on_message(const msg::ServiceStatus& status, Clock::time_point now);
  void leave_silent(Clock::time_point now);
  template <class Message>
  void translate(Message& message);
  std::shared_ptr<const PictureFile> picture(const std::string& environment, const PictureKey& key, bool& coming);

  Node& node_;
  const Options options_;
  Maps maps_;
  Pictures pictures_;
  Ros2Translation translation_;
  std::map<std::string, Presence> hosts_;       // env_services, by id
  std::map<std::string, TraversalRow> hosted_;  // by id of the env_service
  msg::ServiceStatus status_;
  msg::TraversalInfo info_;
  msg::Scene scene_;
  msg::Observation observation_;
  msg::Action action_;
  msg::EpisodeStat episode_;
  msg::TrainingStat update_;
};

}  // namespace citylearn
