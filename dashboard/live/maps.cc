// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/maps.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/exchange/timing.h"
#include "core/wire/streets.h"

namespace citylearn {

TraversalRow row_of(const msg::TraversalInfo& info) {
  return {info.header().sender().c_str(),
          info.dataset().c_str(),
          info.traversal().c_str(),
          info.condition().c_str(),
          info.hash(),
          info.frames(),
          info.agents(),
          info.images(),
          static_cast<StateRule>(info.rule()),
          info.streets_hash()};
}

std::shared_ptr<const RouteMap> Maps::find(std::uint64_t hash) {
  const auto found = maps_.find(hash);
  if (found == maps_.end()) return nullptr;
  found->second.used = ++uses_;
  return found->second.map;
}

void Maps::fetch(const TraversalRow& traversal, const std::string& session) {
  if (maps_.contains(traversal.hash) || fetches_.contains(traversal.hash) || fetches_.size() >= kMaxMaps) return;
  const bool streets = traversal.rule != StateRule::kLine;
  ObjectFetch object({.hash = streets ? traversal.streets : traversal.hash,
                      .retry = kDashboardRetry,
                      .most_tries = RequestTimer::kDefaultTries});
  object.want(0);
  fetches_.try_emplace(traversal.hash, Fetch{session, traversal, std::move(object)});
  if (streets)
    node_.create_reader_at<msg::StreetsChunk>(node_.options().id, session);
  else
    node_.create_reader_at<msg::RouteMapChunk>(node_.options().id, session);
}

void Maps::poll(Clock::time_point now) {
  take(chunk_, false, now);
  take(streets_chunk_, true, now);
  for (auto at = fetches_.begin(); at != fetches_.end();) {
    Fetch& fetch = at->second;
    if (fetch.object.gave_up(now)) {
      spdlog::warn("the map of {:016x} does not arrive from '{}'", at->first, fetch.traversal.environment);
      at = fetches_.erase(at);
      continue;
    }
    const auto is_due = [&](auto& message) {
      message.server() = fetch.traversal.environment.c_str();
      return fetch.object.ask(now, message);
    };
    if (fetch.streets() && is_due(streets_request_)) node_.publish(streets_request_, fetch.session);
    if (!fetch.streets() && is_due(request_)) node_.publish(request_, fetch.session);
    ++at;
  }
}

Clock::time_point Maps::due() const {
  Clock::time_point due = Clock::time_point::max();
  for (const auto& [hash, fetch] : fetches_) due = std::min(due, fetch.object.due());
  return due;
}

/// Takes all chunks of maps of one kind. Traversals of one city are on equal streets.
template <class Chunk>
void Maps::take(Chunk& chunk, bool streets, Clock::time_point now) {
  while (node_.take(chunk)) {
    bool damaged = false;
    for (auto at = fetches_.begin(); at != fetches_.end();) {
      Fetch& fetch = at->second;
      ++at;
      if (fetch.streets() != streets) continue;
      damaged = fetch.object.take(chunk, now) == Taken::kDamaged || damaged;
      const auto object = fetch.object.next();
      if (!object) continue;
      try {
        keep(fetch.traversal, object->bytes);
        at = fetches_.erase(std::prev(at));
      } catch (const Error&) {  // there is none, or it means nothing
        fetch.object.refuse(object->item);
        damaged = true;
      }
    }
    node_.traffic.rejected += damaged;
  }
}

void Maps::keep(const TraversalRow& traversal, const Bytes& object) {
  auto map = std::make_shared<RouteMap>();
  if (traversal.rule != StateRule::kLine) {
    map->frames = static_cast<std::uint32_t>(traversal.frames);
    map->streets = std::make_shared<const StreetMap>(decode_streets(object, traversal.streets));
    map->rule = traversal.rule;
  } else {
    const auto sent = decode_object<msg::RouteMap>(object);
    *map = {static_cast<std::uint32_t>(sent.position().size()), sent.position(), sent.latitude(), sent.longitude()};
  }
  maps_[traversal.hash] = {std::move(map), ++uses_};
  const auto frames = [this] {
    std::size_t sum = 0;
    for (const auto& [other, kept] : maps_) sum += kept.map->frames;
    return sum;
  };
  while (maps_.size() > 1 && (maps_.size() > kMaxMaps || frames() > kMaxFrames))
    maps_.erase(std::min_element(maps_.begin(), maps_.end(),
                                 [](const auto& a, const auto& b) { return a.second.used < b.second.used; }));
}

}  // namespace citylearn
