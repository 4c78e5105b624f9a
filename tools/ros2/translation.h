// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/ros2/messages.h"
#include "core/wire/messages.h"
#include "dashboard/live/maps.h"
#include "dashboard/live/picture_cache.h"

namespace citylearn {

/// Says in ROS 2's messages what agents of one session see and do (docs/how-to/use-with-ros2.md lists the topics).
/// Takes messages in any order, also late and repeated ones. Used by one thread.
class Ros2Translation {
 public:
  struct Options {
    std::string prefix = "citylearn";  ///< of all topics; a name of ROS 2
    std::size_t agents = 1;            ///< of each env_service, the first ones
    double rate = 10;                  ///< observations or scenes of an env_service a second, at most; 0: all
    double speed = 1;                  ///< of a step in Twist messages, m/s
  };
  /// Sources of data that an Observation does not have.
  struct Sources {
    /// Returns the map of the env_service's traversal; null where it is not known, or not yet.
    std::function<std::shared_ptr<const RouteMap>(const std::string& environment, std::uint64_t hash)> map;
    /// Returns a picture; null where there is none. Sets `coming` where there will be one.
    std::function<std::shared_ptr<const PictureFile>(const std::string& environment, const PictureKey&, bool& coming)>
        picture;
  };
  /// `sink` must outlive it.
  Ros2Translation(Ros2Sink& sink, const Options& options, const Sources& sources);

  // `time`: nanoseconds since 1970 when it came.
  void on_message(const msg::Observation& observation, std::uint64_t time);
  /// Says the same as an Observation, but for the reward. Ignored where observations come too.
  void on_message(const msg::Scene& scene, std::uint64_t time);
  void on_message(const msg::Action& action, std::uint64_t time);
  void on_message(const msg::EpisodeStat& stat, std::uint64_t time);
  void on_message(const msg::TrainingStat& stat, std::uint64_t time);
  /// Sends pictures that were coming.
  void poll();

  std::uint64_t pictures() const { return pictures_; }                  ///< sent
  std::uint64_t missing_pictures() const { return missing_pictures_; }  ///< there were none to send

 private:
  /// The view of an agent.
  struct View {
    PictureKey key;
    std::uint64_t time = 0;
  };
  struct Agent {
    std::optional<View> next, coming;  // the newest, and the one that is waited for
  };
  struct Environment {
    std::string name;  // as ROS 2 allows it
    std::uint64_t incarnation = 0, step = 0, sampled = 0, episode = 0;
    std::pair<std::uint64_t, std::uint32_t> settings;  // and `step`: of the observation that was sampled last
    bool observed = false;                             // an Observation came
    bool answered = false;                             // by an Action
    std::vector<Agent> agents;
  };

  Environment& environment(const std::string& id, std::uint64_t incarnation);
  std::string ros_name(const std::string& id);
  bool is_due(const Environment& environment, std::uint64_t time) const;
  template <class Seen>
  Environment* see(const Seen& seen, std::uint64_t time);
  std::string topic(const Environment& environment, std::size_t agent, const std::string& name) const;
  template <class Message>
  void publish(const std::string& topic, const Message& message, std::uint64_t time);
  void publish_place(const Environment& environment, std::size_t agent, const RouteMap& map, std::uint32_t frame,
                     const std::string& prefix, std::uint64_t time);
  void publish_picture(const std::string& id, const Environment& environment, std::size_t index, Agent& agent);

  Ros2Sink& sink_;
  const Options options_;
  const Sources sources_;
  std::map<std::string, std::string> names_;  // as ROS 2 allows them, by id
  std::set<std::string> taken_;               // the same names
  std::map<std::string, Environment> environments_;
  std::map<std::string, std::pair<std::uint64_t, std::uint64_t>>
      updates_;  // newest run_id and update, by policy_service
  std::uint64_t pictures_ = 0, missing_pictures_ = 0;
  Bytes bytes_;
};

}  // namespace citylearn
