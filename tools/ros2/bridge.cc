// SPDX-License-Identifier: Apache-2.0
#include "tools/ros2/bridge.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/exchange/timing.h"

namespace citylearn {
namespace {

Pictures::Options picture_options(int widest) {
  Pictures::Options options;
  options.widest = widest;
  options.between = kBridgePictures;
  return options;
}

}  // namespace

Ros2Bridge::Ros2Bridge(Node& node, Ros2Sink& sink, const Options& options)
    : node_(node),
      options_(options),
      maps_(node),
      pictures_(node, picture_options(options.widest)),
      translation_(sink, options.translation,
                   {[this](const std::string& environment, std::uint64_t hash) {
                      auto map = maps_.find(hash);
                      TraversalRow& hosted = hosted_[environment];
                      hosted.environment = environment;  // its TraversalInfo may not have come
                      hosted.hash = hash;
                      if (!map) maps_.fetch(hosted, node_.options().session);
                      return map;
                    },
                    [this](const std::string& environment, const PictureKey& key, bool& coming) {
                      return picture(environment, key, coming);
                    }}) {
  node_.create_reader<msg::ServiceStatus>();
  node_.create_reader<msg::TraversalInfo>();
  node_.create_reader<msg::EpisodeStat>();
  if (!options_.actions) node_.create_reader<msg::Scene>();
  node_.create_reader<msg::TrainingStat>();
}

std::shared_ptr<const PictureFile> Ros2Bridge::picture(const std::string& environment, const PictureKey& key,
                                                       bool& coming) {
  if (auto found = pictures_.find(key)) return found;
  if (!hosted_[environment].images) return nullptr;
  pictures_.fetch(key, {node_.options().session, environment});
  coming = pictures_.fetching(key);
  return nullptr;
}

void Ros2Bridge::on_message(const msg::ServiceStatus& status, Clock::time_point now) {
  if (std::string(status.service().c_str()) != "env_service") return;
  const std::string id = status.header().sender().c_str();
  const auto [host, met] = hosts_.try_emplace(id);
  host->second.heard(now);
  if (!met) return;
  spdlog::info("'{}' is here", id);
  if (!options_.actions) return;
  node_.create_reader_at<msg::Observation>(id);
  node_.create_reader_at<msg::Action>(id);
}

void Ros2Bridge::leave_silent(Clock::time_point now) {
  std::erase_if(hosts_, [&](const auto& host) {
    if (host.second.here(now)) return false;
    spdlog::warn("'{}' is silent", host.first);
    node_.release_topics(host.first);
    return true;
  });
}

template <class Message>
void Ros2Bridge::translate(Message& message) {
  while (node_.take(message))
    if (const std::uint64_t time = options_.time()) translation_.on_message(message, time);
}

void Ros2Bridge::poll() {
  const Clock::time_point now = Clock::now();
  while (node_.take(status_)) on_message(status_, now);
  while (node_.take(info_)) hosted_[info_.header().sender().c_str()] = row_of(info_);
  leave_silent(now);
  options_.actions ? translate(observation_) : translate(scene_);
  if (options_.actions) translate(action_);
  translate(episode_);
  translate(update_);
  maps_.poll(now);
  pictures_.poll(now);
  translation_.poll();
}

Clock::time_point Ros2Bridge::due() const {
  return std::min({maps_.due(), pictures_.due(), Clock::now() + kStopCheckInterval});
}

}  // namespace citylearn
