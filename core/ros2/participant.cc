// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/participant.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cstdlib>

#include "core/dds/request_identity.h"
#include "core/files/image_header.h"
#include "core/ros2/name.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

const std::string kAll = "all";
constexpr std::size_t kMaxSampleBytes = kMaxImageBytes + 4096;  // a picture, and what stands before it

// rmw_dds_common's topic of nodes. Its type is not in msg/: a gid's size depends on the release.
const std::string kGraphTopic = "ros_discovery_info",
                  kGraphType = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",
                  kGraphHash = "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e";

/// Returns the USER_DATA by which nodes know the definition of a topic's type, and of the service that it is part of.
std::string hash_data(const std::string& hash, const std::string& service_hash = "") {
  return "typehash=" + hash + ";" + (service_hash.empty() ? "" : "sertypehash=" + service_hash + ";");
}

Topic topic_of(const std::string& dds_topic, const Ros2Type& type, Profile profile) {
  return {dds_topic, type.dds, profile, kMaxSampleBytes, false, hash_data(type.hash, type.service_hash)};
}

}  // namespace

Ros2Options ros2_defaults() {
  Ros2Options ros;
  for (const auto& [name, help] : list_middlewares())
    if (name == "fastdds") ros.name = name;
  ros.interfaces = {kAll};
  // It is not the option's environment variable, as ROS 1 and releases to come set it to names unknown here.
  const char* const distro = std::getenv("ROS_DISTRO");
  if (distro && std::ranges::count(ros2_distros(), distro)) ros.distro = distro;
  return ros;
}

void add_ros2_options(CLI::App& app, Ros2Options& ros) {
  app.add_option("--ros-domain", ros.domain, "Domain of the nodes of ROS 2")
      ->envname("ROS_DOMAIN_ID")
      ->capture_default_str()
      ->check(CLI::Range(0, 232));
  app.add_option("--ros-distro", ros.distro,
                 "Release of the nodes: up to humble, they know nodes by longer numbers ($ROS_DISTRO, where known)")
      ->capture_default_str()
      ->check(CLI::IsMember(ros2_distros()));
  app.add_option("--ros-middleware", ros.name, "fastdds or cyclonedds; nodes may use either")
      ->capture_default_str()
      ->check([](const std::string& name) {
        const bool known = name.ends_with("fastdds") || name.ends_with("cyclonedds");  // lossy:NAME too
        return known ? "" : "'" + name + "' is neither fastdds nor cyclonedds";
      });
  app.add_option("--ros-interface", ros.interfaces,
                 "Network interfaces on which nodes are: A,B,...; lo: those that stay on this machine "
                 "(ROS_LOCALHOST_ONLY); all: those with their default settings, found by multicast")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--ros-peers", ros.peers, "Hosts with nodes that multicast does not reach: HOST[:PORT],...")
      ->delimiter(',');
  app.add_flag("--use-sim-time", ros.use_sim_time,
               "Time is what nodes publish on /clock: of a simulator, or of a bag that is played");
}

std::string ros2_topic(const std::string& name, const std::string& where) {
  std::string topic = name.starts_with("rt/") ? name.substr(2) : name;
  if (!topic.starts_with("/")) topic.insert(0, "/");
  char before = '/';
  bool valid = topic.size() > 1 && topic.back() != '/';
  for (const char letter : topic.substr(1)) {
    const auto c = static_cast<unsigned char>(letter);
    valid = valid && (before == '/' ? std::isalpha(c) || c == '_' : std::isalnum(c) || c == '_' || c == '/');
    before = letter;
  }
  if (!valid) throw Error("'" + name + "' is not a topic of ROS 2", where, "as /camera/image_raw/compressed");
  return topic;
}

Ros2Participant::Ros2Participant(const Ros2Options& ros, const std::string& name, const MiddlewareOptions* own)
    : gid_bytes_(ros2_gid_bytes(ros.distro)) {
  if (own && ros.name == own->name && ros.name == "cyclonedds" && ros.domain == own->domain)
    throw Error("Cyclone DDS cannot serve both sides in domain " + std::to_string(ros.domain), "--ros-middleware",
                "use fastdds there, or another domain on one side");
  MiddlewareOptions options = ros;
  options.multicast = ros.interfaces == std::vector{kAll};
  options.participant = name;
  options.user_data = "enclave=/;";
  middleware_ = create_middleware(options);
  const Topic graph{kGraphTopic, kGraphType, Profile::kState, kMaxSampleBytes, false, hash_data(kGraphHash)};
  graph_ = middleware_->create_publisher(graph);
  other_nodes_ = middleware_->create_subscription(graph);
  std::set<std::string> taken;
  node_ = {middleware_->guid(), "/citylearn", ros2_name(name, "node_", taken), {}, {}};
  if (ros.use_sim_time) clock_.follow(subscribe<rosgraph_msgs::msg::dds_::Clock_>("/clock"));
}

Publisher& Ros2Participant::publisher(const std::string& topic, const Ros2Type& type) {
  std::unique_ptr<Publisher>& publisher = publishers_[topic];
  if (!publisher) publisher = create_publisher("rt" + topic, type);
  return *publisher;
}

std::unique_ptr<Publisher> Ros2Participant::create_publisher(const std::string& dds_topic, const Ros2Type& type) {
  auto publisher = middleware_->create_publisher(topic_of(dds_topic, type, Profile::kRos2));
  node_.writers.push_back(publisher->guid());
  node_changed_ = true;
  return publisher;
}

std::unique_ptr<Subscription> Ros2Participant::create_subscription(const std::string& dds_topic, const Ros2Type& type,
                                                                   Profile profile) {
  auto subscription = middleware_->create_subscription(topic_of(dds_topic, type, profile));
  node_.readers.push_back(subscription->guid());
  node_changed_ = true;
  return subscription;
}

Ros2Server Ros2Participant::create_server(const std::string& name, const Ros2Type& request, const Ros2Type& response) {
  const std::string path = node_.name_space.substr(1) + "/" + node_.name + "/" + name;
  auto requests = create_subscription(std::string(kRequestPrefix) + path + "Request", request, Profile::kRos2Reliable);
  return {"/" + path, middleware_->name(), std::move(requests),
          create_publisher(std::string(kReplyPrefix) + path + "Reply", response)};
}

std::vector<std::string> Ros2Participant::poll() {
  if (std::exchange(node_changed_, false)) graph_->publish(encode_ros2(node_, gid_bytes_));
  middleware_->wait(Clock::now());  // Fast DDS announces this process to those that it has just discovered
  clock_.poll(Clock::now());
  std::vector<std::string> faults = middleware_->discovery().faults();
  while (other_nodes_->take(bytes_)) {
    const std::size_t other = gid_bytes_ == 16 ? 24 : 16;
    if (other_distro_ || !has_gids_of(other, bytes_)) continue;
    other_distro_ = true;
    faults.push_back(other == 16
                         ? "nodes of ROS 2 Iron or later are here: they see this node with --ros-distro jazzy"
                         : "nodes of ROS 2 Humble or before are here: they see this node with --ros-distro humble");
  }
  return faults;
}

void Ros2Participant::publish(const Ros2Message& message) {
  publisher(message.topic, *message.type).publish(message.data);
}

}  // namespace citylearn
