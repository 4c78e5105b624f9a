// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "core/exchange/object_fetch.h"
#include "core/exchange/timing.h"
#include "core/wire/messages.h"

namespace citylearn::testing {

/// Returns the map of a traversal, fetched of an env_service; nothing when it does not come. `asker` has a Node `node`
/// and until(condition).
template <class Asker>
std::optional<msg::RouteMap> fetched_map(Asker& asker, const std::string& environment, std::uint64_t traversal) {
  asker.node.template create_reader<msg::RouteMapChunk>();
  ObjectFetch fetch({.hash = traversal, .retry = kDashboardRetry});
  fetch.want(0);
  msg::RouteMapRequest request;
  request.server() = environment;
  msg::RouteMapChunk chunk;
  std::optional<FetchedObject> object;
  if (!asker.until([&] {
        if (fetch.ask(Clock::now(), request)) asker.node.publish(request);
        while (asker.node.take(chunk)) fetch.take(chunk, Clock::now());
        return (object = fetch.next()).has_value();
      }))
    return std::nullopt;
  return decode_object<msg::RouteMap>(object->bytes);
}

}  // namespace citylearn::testing
