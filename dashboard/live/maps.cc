// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/maps.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/exchange/timing.h"

namespace citylearn {

std::shared_ptr<const RouteMap> Maps::find(std::uint64_t hash) {
  const auto found = maps_.find(hash);
  if (found == maps_.end()) return nullptr;
  found->second.used = ++uses_;
  return found->second.map;
}

void Maps::fetch(std::uint64_t hash, const std::string& session, const std::string& environment) {
  if (maps_.contains(hash) || fetches_.contains(hash) || fetches_.size() >= kMaxMaps) return;
  fetches_.try_emplace(hash, Fetch{session, environment, std::make_shared<RouteMap>(),
                                   RequestTimer(kDashboardRetry, RequestTimer::kDefaultTries)});
}

void Maps::poll(Clock::time_point now) {
  while (node_.take(chunk_)) on_message(chunk_, now);
  for (auto fetch = fetches_.begin(); fetch != fetches_.end();) {
    if (fetch->second.timer.gave_up(now)) {
      spdlog::warn("the map of {:016x} does not arrive from '{}'", fetch->first, fetch->second.environment);
      fetch = fetches_.erase(fetch);
      continue;
    }
    if (fetch->second.timer.is_due(now)) request(fetch->first, fetch->second, now);
    ++fetch;
  }
}

Clock::time_point Maps::due() const {
  Clock::time_point due = Clock::time_point::max();
  for (const auto& [hash, fetch] : fetches_) due = std::min(due, fetch.timer.due());
  return due;
}

void Maps::request(std::uint64_t hash, Fetch& fetch, Clock::time_point now) {
  node_.create_reader_at<msg::MapChunk>(node_.options().id, fetch.session);
  fetch.timer.sent(now, 1);
  msg::MapRequest message;
  message.environment() = fetch.environment.c_str();
  message.hash() = hash;
  message.first() = static_cast<std::uint32_t>(fetch.map->position.size());
  node_.publish(message, fetch.session);
}

void Maps::on_message(const msg::MapChunk& chunk, Clock::time_point now) {
  const auto found = fetches_.find(chunk.hash());
  if (found == fetches_.end()) return;
  Fetch& fetch = found->second;
  RouteMap& map = *fetch.map;
  const bool begins = map.position.empty();
  const std::size_t places = chunk.position().size();
  if (chunk.first() != map.position.size() || places == 0 || (!begins && chunk.frames() != map.frames) ||
      (!begins && chunk.latitude().empty() != map.latitude.empty()))
    return;
  map.frames = chunk.frames();
  map.position.insert(map.position.end(), chunk.position().begin(), chunk.position().end());
  map.latitude.insert(map.latitude.end(), chunk.latitude().begin(), chunk.latitude().end());
  map.longitude.insert(map.longitude.end(), chunk.longitude().begin(), chunk.longitude().end());
  fetch.timer.answered(now);
  if (map.position.size() < map.frames) {
    request(found->first, fetch, now);
    return;
  }
  maps_[found->first] = {std::move(fetch.map), ++uses_};
  fetches_.erase(found);
  const auto frames = [this] {
    std::size_t sum = 0;
    for (const auto& [hash, kept] : maps_) sum += kept.map->frames;
    return sum;
  };
  while (maps_.size() > 1 && (maps_.size() > kMaxMaps || frames() > kMaxFrames))
    maps_.erase(std::min_element(maps_.begin(), maps_.end(),
                                 [](const auto& a, const auto& b) { return a.second.used < b.second.used; }));
}

}  // namespace citylearn
