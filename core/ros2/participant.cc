// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/participant.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>

#include "core/files/image_header.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

const std::string kAll = "all";
constexpr std::size_t kMaxSampleBytes = kMaxImageBytes + 4096;  // a picture, and what stands before it

}  // namespace

MiddlewareOptions ros2_defaults() {
  MiddlewareOptions ros;
  for (const auto& [name, help] : list_middlewares())
    if (name == "fastdds") ros.name = name;
  ros.interfaces = {kAll};
  return ros;
}

void add_ros2_options(CLI::App& app, MiddlewareOptions& ros) {
  app.add_option("--ros-domain", ros.domain, "Domain of the nodes of ROS 2")
      ->envname("ROS_DOMAIN_ID")
      ->capture_default_str()
      ->check(CLI::Range(0, 232));
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

Ros2Participant::Ros2Participant(const MiddlewareOptions& ros, const std::string& name, const MiddlewareOptions* own) {
  if (own && ros.name == own->name && ros.name == "cyclonedds" && ros.domain == own->domain)
    throw Error("Cyclone DDS cannot serve both sides in domain " + std::to_string(ros.domain), "--ros-middleware",
                "use fastdds there, or another domain on one side");
  MiddlewareOptions options = ros;
  options.multicast = ros.interfaces == std::vector{kAll};
  options.participant = name;
  middleware_ = create_middleware(options);
}

Topic Ros2Participant::dds_topic(const std::string& topic, const Ros2Type& type, Profile profile) {
  return {"rt" + topic, type.dds, profile, kMaxSampleBytes};
}

Publisher& Ros2Participant::publisher(const std::string& topic, const Ros2Type& type) {
  std::unique_ptr<Publisher>& publisher = publishers_[topic];
  if (!publisher) publisher = middleware_->create_publisher(dds_topic(topic, type, Profile::kRos2));
  return *publisher;
}

void Ros2Participant::publish(const Ros2Message& message) {
  publisher(message.topic, *message.type).publish(message.data);
}

}  // namespace citylearn
