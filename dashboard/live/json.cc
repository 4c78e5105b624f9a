// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/json.h"

#include <spdlog/fmt/fmt.h>

namespace citylearn {

std::string hash_text(std::uint64_t hash) { return fmt::format("{:016x}", hash); }

nlohmann::json event_json(const Event& event) {
  return {{"time", event.time},
          {"session", event.session},
          {"service", event.service},
          {"kind", event.kind},
          {"text", event.text}};
}

nlohmann::json traversal_json(const TraversalRow& t) {
  return {{"environment", t.environment}, {"dataset", t.dataset},      {"traversal", t.traversal},
          {"condition", t.condition},     {"hash", hash_text(t.hash)}, {"frames", t.frames},
          {"agents", t.agents},           {"images", t.images}};
}

}  // namespace citylearn
