// SPDX-License-Identifier: Apache-2.0
#include "policy_service/env_client/env_requirements.h"

#include <spdlog/fmt/fmt.h>

#include "policy_service/env_client/street_maps.h"

namespace citylearn {

TraversalContents contents_of(const msg::TraversalInfo& info) {
  return {info.traversal().c_str(), info.hash(),   info.feature_dimension(), info.encoder().c_str(),
          info.dataset().c_str(),   info.frames(), info.streets_hash()};
}

std::string route_misfit(const msg::TraversalInfo& info, std::uint32_t first, std::uint32_t count) {
  if (count >= 1 && std::uint64_t{first} + count <= info.frames()) return "";
  return fmt::format("has {} frames, the route needs frames {}..{}", info.frames(), first,
                     std::uint64_t{first} + count - 1);
}

std::string misfit(const msg::TraversalInfo& info, const EnvRequirements& required) {
  const std::string traversal = info.traversal().c_str();
  if (!required.traversals.empty() && !required.traversals.contains(traversal)) return "";
  const bool streets = info.rule() != msg::LINE;
  if (std::string wrong = streets ? streets_misfit(info) : ""; !wrong.empty()) return wrong;
  if (required.streets && *required.streets != streets)
    return fmt::format("walks {}, the run {}", streets ? "on streets" : "on a line",
                       streets ? "on a line" : "on streets");
  if (std::string wrong = required.learned.misfit(contents_of(info)); !wrong.empty()) return wrong;
  if (required.feature_dimension && info.feature_dimension() != *required.feature_dimension)
    return fmt::format("has {} features a frame, the agent needs {}", info.feature_dimension(),
                       *required.feature_dimension);
  if (streets && (required.first_frame != 0 || (required.frames > 0 && required.frames != info.frames())))
    return fmt::format("walks on streets, whose {} frames are one route: leave --frames out", info.frames());
  return required.frames > 0 ? route_misfit(info, required.first_frame, required.frames) : "";
}

}  // namespace citylearn
