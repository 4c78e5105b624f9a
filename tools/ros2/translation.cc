// SPDX-License-Identifier: Apache-2.0
#include "tools/ros2/translation.h"

#include <cmath>
#include <limits>

#include "core/ros2/header.h"
#include "core/ros2/name.h"
#include "core/task/action.h"
#include "core/task/spl.h"
#include "core/task/training_figures.h"
#include "ros2/ros2.h"

namespace citylearn {
namespace {

namespace geometry = geometry_msgs::msg::dds_;
namespace sensor = sensor_msgs::msg::dds_;
namespace standard = std_msgs::msg::dds_;

template <class Message, class Value>
Message holding(Value value) {
  Message message;
  message.data(value);
  return message;
}

}  // namespace

Ros2Translation::Ros2Translation(Ros2Sink& sink, const Options& options, const Sources& sources)
    : sink_(sink), options_(options), sources_(sources) {}

/// Returns the id as a name of ROS 2, another one for each id.
std::string Ros2Translation::ros_name(const std::string& id) {
  const auto found = names_.find(id);
  if (found != names_.end()) return found->second;
  return names_[id] = ros2_name(id, "id_", taken_);
}

Ros2Translation::Environment& Ros2Translation::environment(const std::string& id, std::uint64_t incarnation) {
  Environment& environment = environments_[id];
  if (environment.incarnation == incarnation) return environment;
  environment = {};
  environment.name = ros_name(id);
  environment.incarnation = incarnation;
  return environment;
}

/// A clock that was set back does not stop what is sent.
bool Ros2Translation::is_due(const Environment& environment, std::uint64_t time) const {
  return options_.rate <= 0 || time < environment.sampled ||
         static_cast<double>(time - environment.sampled) * options_.rate >= static_cast<double>(kRos2Second);
}

std::string Ros2Translation::topic(const Environment& environment, std::size_t agent, const std::string& name) const {
  return "/" + options_.prefix + "/" + environment.name + "/agent_" + std::to_string(agent) + "/" + name;
}

template <class Message>
void Ros2Translation::publish(const std::string& topic, const Message& message, std::uint64_t time) {
  encode_ros2(message, bytes_);
  sink_.publish({topic, &ros2_type_of<Message>(), time, bytes_});
}

/// Publishes what agents see, unless it is said again or too soon: then returns null.
template <class Seen>
Ros2Translation::Environment* Ros2Translation::see(const Seen& seen, std::uint64_t time) {
  const std::string id = seen.header().sender().c_str();
  Environment& from = environment(id, seen.header().incarnation());
  const std::pair settings(seen.settings().incarnation(), seen.settings().version());
  // An observation comes again until it is answered, and once more with features.
  if (settings == from.settings && seen.step() <= from.step && from.sampled != 0) return nullptr;
  if (!is_due(from, time)) return nullptr;
  from.settings = settings;
  from.step = seen.step();
  from.sampled = time;
  from.answered = false;
  from.agents.resize(std::min(options_.agents, seen.frame().size()));
  const auto map = sources_.map(id, seen.traversal_hash());
  for (std::size_t agent = 0; agent < from.agents.size(); ++agent) {
    if (seen.flags()[agent] & msg::FLAG_IDLE) continue;
    if (map) {
      publish_place(from, agent, *map, seen.position()[agent], "", time);
      publish_place(from, agent, *map, seen.goal()[agent], "goal_", time);
    }
    from.agents[agent].next = View{{seen.traversal_hash(), seen.frame()[agent]}, time};
    publish_picture(id, from, agent, from.agents[agent]);
  }
  return &from;
}

void Ros2Translation::on_message(const msg::Scene& scene, std::uint64_t time) {
  if (!environment(scene.header().sender().c_str(), scene.header().incarnation()).observed) see(scene, time);
}

void Ros2Translation::on_message(const msg::Observation& observation, std::uint64_t time) {
  environment(observation.header().sender().c_str(), observation.header().incarnation()).observed = true;
  const Environment* from = see(observation, time);
  if (!from) return;
  for (std::size_t agent = 0; agent < from->agents.size(); ++agent)
    if (!(observation.flags()[agent] & msg::FLAG_IDLE))
      publish(topic(*from, agent, "reward"), holding<standard::Float32_>(observation.reward()[agent]), time);
}

void Ros2Translation::publish_place(const Environment& environment, std::size_t agent, const RouteMap& map,
                                    std::uint32_t frame, const std::string& prefix, std::uint64_t time) {
  if (frame < map.position.size() && std::isfinite(map.position[frame])) {
    geometry::PoseStamped_ pose;
    pose.header(ros2_header(options_.prefix + "/" + environment.name + "/route", time));
    pose.pose().position().x(map.position[frame]);
    pose.pose().orientation().w(1);
    publish(topic(environment, agent, prefix + "pose"), pose, time);
  }
  if (frame < map.latitude.size() && std::isfinite(map.latitude[frame]) && std::isfinite(map.longitude[frame])) {
    sensor::NavSatFix_ fix;
    fix.header(ros2_header(options_.prefix + "/" + environment.name + "/agent_" + std::to_string(agent), time));
    fix.status().status(0);   // STATUS_FIX
    fix.status().service(1);  // SERVICE_GPS
    fix.latitude(map.latitude[frame]);
    fix.longitude(map.longitude[frame]);
    fix.altitude(std::numeric_limits<double>::quiet_NaN());
    publish(topic(environment, agent, prefix + "fix"), fix, time);
  }
}

/// Shows the newest view whose picture is here. While one is coming, that one is waited for, or an agent that moves
/// faster than pictures come would never be shown.
void Ros2Translation::publish_picture(const std::string& id, const Environment& environment, std::size_t index,
                                      Agent& agent) {
  while (agent.coming || agent.next) {
    if (!agent.coming) agent.coming = std::exchange(agent.next, std::nullopt);
    bool coming = false;
    const auto picture = sources_.picture(id, agent.coming->key, coming);
    if (coming) return;
    const View view = *std::exchange(agent.coming, std::nullopt);
    if (!picture || picture->bytes.empty()) {
      ++missing_pictures_;
      continue;
    }
    sensor::CompressedImage_ image;
    const std::string name = "/agent_" + std::to_string(index);
    image.header(ros2_header(options_.prefix + "/" + environment.name + name + "/camera", view.time));
    image.format(picture->type.substr(picture->type.find('/') + 1));  // of "image/jpeg"
    image.data().assign(picture->bytes.begin(), picture->bytes.end());
    publish(topic(environment, index, "image/compressed"), image, view.time);
    ++pictures_;
  }
}

void Ros2Translation::poll() {
  for (auto& [id, environment] : environments_)
    for (std::size_t agent = 0; agent < environment.agents.size(); ++agent)
      publish_picture(id, environment, agent, environment.agents[agent]);
}

/// Only what answers an observation that was sent: then the rates are the same.
void Ros2Translation::on_message(const msg::Action& action, std::uint64_t time) {
  const auto found = environments_.find(action.environment().c_str());
  if (found == environments_.end()) return;
  Environment& to = found->second;
  if (action.environment_incarnation() != to.incarnation || action.step() != to.step ||
      std::pair(action.settings().incarnation(), action.settings().version()) != to.settings ||
      std::exchange(to.answered, true))  // sent again
    return;
  for (std::size_t agent = 0; agent < std::min(to.agents.size(), action.choice().size()); ++agent) {
    const std::uint8_t choice = action.choice()[agent];
    if (choice == kNoAction) continue;
    publish(topic(to, agent, "action"), holding<standard::UInt8_>(choice), time);
    geometry::Twist_ twist;
    twist.linear().x(choice == kNext ? options_.speed : choice == kPrevious ? -options_.speed : 0);
    publish(topic(to, agent, "cmd_vel"), twist, time);
  }
}

void Ros2Translation::on_message(const msg::EpisodeStat& stat, std::uint64_t time) {
  Environment& from = environment(stat.header().sender().c_str(), stat.header().incarnation());
  if (stat.log().number() <= from.episode) return;  // sent again
  from.episode = stat.log().number();
  if (stat.agent() >= options_.agents) return;
  publish(topic(from, stat.agent(), "episode/reward"), holding<standard::Float32_>(stat.reward()), time);
  const double spl = spl_of(stat.completed(), stat.shortest(), stat.steps());
  publish(topic(from, stat.agent(), "episode/spl"), holding<standard::Float32_>(static_cast<float>(spl)), time);
}

void Ros2Translation::on_message(const msg::TrainingStat& stat, std::uint64_t time) {
  const std::string id = stat.header().sender().c_str();
  const std::pair update(stat.log().stream(), stat.update());
  auto& newest = updates_[id];
  if (update <= newest) return;  // sent again
  newest = update;
  for (const TrainingFigure& figure : training_figures())
    if (const double value = figure.value(stat); std::isfinite(value))
      publish("/" + options_.prefix + "/" + ros_name(id) + "/training/" + figure.name,
              holding<standard::Float64_>(value), time);
}

}  // namespace citylearn
