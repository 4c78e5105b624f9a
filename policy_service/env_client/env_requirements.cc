// SPDX-License-Identifier: Apache-2.0
#include "policy_service/env_client/env_requirements.h"

#include <spdlog/fmt/fmt.h>

namespace citylearn {

TraversalContents contents_of(const msg::TraversalInfo& info) {
  return {info.traversal().c_str(), info.hash(), info.feature_dimension(), info.encoder().c_str()};
}

std::string route_misfit(const msg::TraversalInfo& info, std::uint32_t first, std::uint32_t count) {
  if (count >= 1 && std::uint64_t{first} + count <= info.frames()) return "";
  return fmt::format("has {} frames, the route needs frames {}..{}", info.frames(), first,
                     std::uint64_t{first} + count - 1);
}

std::string features_misfit(const TraversalContents& contents, const TraversalContents& others,
                            const std::string& whose) {
  if (contents.feature_dimension != others.feature_dimension)
    return fmt::format("has {} features a frame, {} has {}", contents.feature_dimension, whose,
                       others.feature_dimension);
  if (contents.encoder && others.encoder && *contents.encoder != *others.encoder)
    return fmt::format("has features of encoder '{}', {} has those of '{}'", *contents.encoder, whose, *others.encoder);
  return "";
}

std::string contents_misfit(const TraversalContents& contents, const TraversalContents& others,
                            const std::string& whose) {
  if (contents.hash != others.hash)
    return fmt::format("has other contents (hash {:016x}) than {} ({:016x})", contents.hash, whose, others.hash);
  return features_misfit(contents, others, whose);
}

std::string misfit(const msg::TraversalInfo& info, const EnvRequirements& required) {
  const std::string traversal = info.traversal().c_str();
  if (!required.traversals.empty() && !required.traversals.contains(traversal)) return "";
  for (const TraversalContents& learned : required.learned)
    if (learned.traversal == traversal)
      if (std::string wrong = contents_misfit(contents_of(info), learned, "what the run learns from"); !wrong.empty())
        return wrong;
  if (required.feature_dimension && info.feature_dimension() != *required.feature_dimension)
    return fmt::format("has {} features a frame, the agent needs {}", info.feature_dimension(),
                       *required.feature_dimension);
  return required.frames > 0 ? route_misfit(info, required.first_frame, required.frames) : "";
}

}  // namespace citylearn
