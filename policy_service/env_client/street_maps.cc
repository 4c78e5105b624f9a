// SPDX-License-Identifier: Apache-2.0
#include "policy_service/env_client/street_maps.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "core/exchange/timing.h"
#include "core/wire/streets.h"

namespace citylearn {

StreetMaps::StreetMaps(Node& node, std::chrono::milliseconds patience)
    : node_(node), tries_(std::max(1, static_cast<int>(patience / kObjectRetry))) {
  node_.create_reader<msg::StreetsChunk>();
}

std::shared_ptr<const StateMap> StreetMaps::find_or_ask(const msg::TraversalInfo& info) {
  const Key key{info.streets_hash(), info.rule()};
  const std::string id = info.header().sender().c_str();
  if (const auto found = maps_.find(key); found != maps_.end()) {
    fetches_.erase(id);
    if (static_cast<std::uint32_t>(found->second->places()) != info.places() ||
        static_cast<std::uint32_t>(found->second->states()) != info.frames())
      throw Error("announces other counts than those of its streets");
    return found->second;
  }
  auto fetch = fetches_.find(id);
  if (fetch != fetches_.end() && fetch->second.key != key) fetch = fetches_.erase(fetch), fetch = fetches_.end();
  if (fetch == fetches_.end()) {
    for (const auto& [other, under_way] : fetches_)
      if (under_way.key == key) return nullptr;
    ObjectFetch object({.hash = key.first,
                        .retry = kObjectRetry,
                        .most_tries = tries_,
                        .max_bytes = 64 + std::uint64_t{8} * info.places() + std::uint64_t{12} * info.links()});
    object.want(0);
    fetch = fetches_.try_emplace(id, Fetch{key, std::move(object), ""}).first;
  }
  if (fetch->second.object.gave_up(Clock::now())) {
    const std::string problem = fetch->second.problem;
    fetches_.erase(fetch);
    throw Error(problem.empty() ? "does not send its street map" : problem);
  }
  request_.server() = id.c_str();
  if (fetch->second.object.ask(Clock::now(), request_)) node_.publish(request_);
  return nullptr;
}

bool StreetMaps::take(const msg::TraversalInfo& info, const msg::StreetsChunk& chunk) {
  const auto fetch = fetches_.find(info.header().sender().c_str());
  if (fetch == fetches_.end()) return true;
  auto& [key, object, problem] = fetch->second;
  if (object.take(chunk, Clock::now()) == Taken::kDamaged) return false;
  const auto complete = object.next();
  if (!complete) return true;
  try {
    std::erase_if(maps_, [&](const auto& map) { return maps_.size() >= kMaxMaps && map.second.use_count() == 1; });
    if (maps_.size() >= kMaxMaps) throw Error(fmt::format("walks on the {}th map of streets in use", kMaxMaps + 1));
    maps_[key] = read(info, complete->bytes);
    fetches_.erase(fetch);
    return true;
  } catch (const Error& error) {
    object.refuse(complete->item);
    problem = error.what();
    return false;
  }
}

std::shared_ptr<const StateMap> StreetMaps::read(const msg::TraversalInfo& info, const Bytes& bytes) const {
  if (bytes.empty()) throw Error("has no street map");
  const StreetMap map = decode_streets(bytes);
  if (map.places() != info.places() || map.links() != info.links())
    throw Error(fmt::format("serves a street map of {} places and {} links, and announced {} and {}", map.places(),
                            map.links(), info.places(), info.links()));
  if (map.hash() != info.streets_hash()) throw Error("serves another street map than it announced");
  return std::make_shared<const StateMap>(map, static_cast<StateRule>(info.rule()), msg::MAX_FRAMES);
}

std::string streets_misfit(const msg::TraversalInfo& info) {
  const std::uint64_t states =
      info.rule() == msg::STREET ? info.links() : std::uint64_t{StateMap::kHeadings} * info.places();
  if (std::max(info.places(), info.links()) > msg::MAX_FRAMES) return "announces streets that no message holds";
  return info.frames() == states ? ""
                                 : fmt::format("has {} frames for {} states of its streets", info.frames(), states);
}

}  // namespace citylearn
