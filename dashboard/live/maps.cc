// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/maps.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

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
  ObjectFetch object({.hash = hash, .retry = kDashboardRetry, .most_tries = RequestTimer::kDefaultTries});
  object.want(0);
  fetches_.try_emplace(hash, Fetch{session, environment, std::move(object)});
  node_.create_reader_at<msg::RouteMapChunk>(node_.options().id, session);
}

void Maps::poll(Clock::time_point now) {
  while (node_.take(chunk_)) on_message(chunk_, now);
  for (auto fetch = fetches_.begin(); fetch != fetches_.end();) {
    const auto& [session, environment, object] = fetch->second;
    if (object.gave_up(now)) {
      spdlog::warn("the map of {:016x} does not arrive from '{}'", fetch->first, environment);
      fetch = fetches_.erase(fetch);
      continue;
    }
    request_.server() = environment.c_str();
    if (fetch->second.object.ask(now, request_)) node_.publish(request_, session);
    ++fetch;
  }
}

Clock::time_point Maps::due() const {
  Clock::time_point due = Clock::time_point::max();
  for (const auto& [hash, fetch] : fetches_) due = std::min(due, fetch.object.due());
  return due;
}

void Maps::on_message(const msg::RouteMapChunk& chunk, Clock::time_point now) {
  const auto found = fetches_.find(chunk.hash());
  if (found == fetches_.end()) return;
  ObjectFetch& fetch = found->second.object;
  if (fetch.take(chunk, now) == Taken::kDamaged) ++node_.traffic.rejected;
  const auto object = fetch.next();
  if (!object) return;
  try {
    keep(chunk.hash(), decode_object<msg::RouteMap>(object->bytes));
    fetches_.erase(found);
  } catch (const Error&) {  // there is none, or it means nothing
    ++node_.traffic.rejected;
    fetch.refuse(object->item);
  }
}

void Maps::keep(std::uint64_t hash, const msg::RouteMap& sent) {
  const auto count = static_cast<std::uint32_t>(sent.position().size());
  maps_[hash] = {std::make_shared<RouteMap>(RouteMap{count, sent.position(), sent.latitude(), sent.longitude()}),
                 ++uses_};
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
