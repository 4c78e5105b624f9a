// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/dds/middleware.h"
#include "core/ros2/clock.h"
#include "core/ros2/graph.h"
#include "core/ros2/messages.h"
#include "core/ros2/service.h"
#include "core/ros2/subscription.h"

namespace CLI {
class App;
}

namespace citylearn {

/// How nodes are met.
struct Ros2Options : MiddlewareOptions {
  Ros2Options(MiddlewareOptions middleware = {}) : MiddlewareOptions(std::move(middleware)) {}
  std::string distro = "jazzy";  ///< their release, one of ros2_distros()
  bool use_sim_time = false;     ///< time is what /clock says
};

/// Returns the options by which nodes with their default settings are met: Fast DDS, domain 0, multicast.
Ros2Options ros2_defaults();

/// Adds --ros-domain (ROS_DOMAIN_ID), --ros-distro (ROS_DISTRO), --ros-middleware, --ros-interface, --ros-peers and
/// --use-sim-time.
void add_ros2_options(CLI::App& app, Ros2Options& ros);

/// Returns the topic's name as ROS 2 writes it: "/camera/image", also for "camera/image" and for "rt/camera/image" of
/// DDS. Throws Error naming `where` unless it is one: names of letters, digits and '_', with '/' between.
std::string ros2_topic(const std::string& name, const std::string& where);

/// A node of ROS 2. It speaks and listens to others: "/a/b" is the DDS topic "rt/a/b". It publishes with the qualities
/// of ROS 2's default, which subscriptions of that and of sensor data both accept. Used by one thread.
class Ros2Participant : public Ros2Sink {
 public:
  /// `name`: of the node /citylearn/NAME, with '_' for what it may not have. `own`: how this process meets CityLearn's
  /// services; null: it does not. Throws Error when both cannot be served by one process, or the middleware cannot
  /// start.
  Ros2Participant(const Ros2Options& ros, const std::string& name, const MiddlewareOptions* own);

  void publish(const Ros2Message& message) override;
  template <class Message>
  void publish(const std::string& topic, const Message& message) {
    encode_ros2(message, bytes_);
    publish(Ros2Message{topic, &ros2_type_of<Message>(), 0, bytes_});
  }
  /// Makes the publisher of a topic before its first message, so that others find it.
  template <class Message>
  void advertise(const std::string& topic) {
    publisher(topic, ros2_type_of<Message>());
  }
  /// Subscribes as to sensor data: every publisher matches, but messages may be lost. With kRos2Reliable none is lost.
  template <class Message>
  Ros2Subscription<Message> subscribe(const std::string& topic, Profile profile = Profile::kRos2) {
    return Ros2Subscription<Message>(create_subscription("rt" + topic, ros2_type_of<Message>(), profile));
  }
  /// Offers the service /citylearn/NODE/`name`.
  template <class Request, class Response>
  Ros2Service<Request, Response> offer(const std::string& name) {
    return Ros2Service<Request, Response>(create_server(name, ros2_type_of<Request>(), ros2_type_of<Response>()));
  }

  /// Waits until there may be something to take (true) or the deadline has passed.
  bool wait(Clock::time_point deadline) { return middleware_->wait(deadline); }
  /// Returns the time of nodes.
  const Ros2Clock& clock() const { return clock_; }
  /// Returns what its at() says now.
  Clock::time_point now() const { return clock_.at(Clock::now()); }
  /// Announces the node's endpoints where some are new, hears the time, and does what the middleware has to do. Call it
  /// several times a second. Returns what is wrong since the last call, a line each: others use a topic with another
  /// type, or are of a release that does not see this node.
  std::vector<std::string> poll();

 private:
  Publisher& publisher(const std::string& topic, const Ros2Type& type);
  std::unique_ptr<Publisher> create_publisher(const std::string& dds_topic, const Ros2Type& type);
  std::unique_ptr<Subscription> create_subscription(const std::string& dds_topic, const Ros2Type& type,
                                                    Profile profile);
  Ros2Server create_server(const std::string& name, const Ros2Type& request, const Ros2Type& response);

  const std::size_t gid_bytes_;
  std::unique_ptr<Middleware> middleware_;
  std::map<std::string, std::unique_ptr<Publisher>> publishers_;  // by topic
  std::unique_ptr<Publisher> graph_;                              // of node_
  std::unique_ptr<Subscription> other_nodes_;
  Ros2Node node_;  // an endpoint stays there until this ends
  bool node_changed_ = true, other_distro_ = false;
  Ros2Clock clock_;
  Bytes bytes_;
};

}  // namespace citylearn
