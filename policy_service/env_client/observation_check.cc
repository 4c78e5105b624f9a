// SPDX-License-Identifier: Apache-2.0
#include "policy_service/env_client/observation_check.h"

#include <algorithm>

#include "core/task/live.h"
#include "core/wire/observation_size.h"

namespace citylearn {
namespace {

/// Returns what is wrong with an observation under these settings; empty when nothing is.
std::string validation_error(const EnvHandle& env, const msg::Observation& observation) {
  const msg::TaskSettings& settings = env.settings;
  const StateMap* streets = env.streets.get();
  const auto off_route = [&](const std::vector<std::uint32_t>& frames) {
    return std::any_of(frames.begin(), frames.end(), [&](std::uint32_t frame) {
      return frame < settings.first_frame() || frame - settings.first_frame() >= settings.frames();
    });
  };
  const bool may_have_more = settings.task_mode() == msg::EVALUATE;  // env_service --evaluation-agents
  if (may_have_more ? observation.goal().size() < env.info.agents() : observation.goal().size() != env.info.agents())
    return "of another number of agents";
  if (!observation.by_reference() && observation.feature_dimension() != env.info.feature_dimension())
    return "of another number of features";
  if (off_route(observation.position())) return "with a position beside the route";
  if (streets ? std::any_of(observation.goal().begin(), observation.goal().end(),
                            [&](std::uint32_t goal) { return goal >= static_cast<std::uint32_t>(streets->places()); })
              : off_route(observation.goal()))
    return "with a goal beside the route";
  if (!is_live(env.info) && off_route(observation.frame())) return "with a frame beside the route";
  for (const std::uint8_t allowed : observation.allowed())
    if ((allowed & ((1u << kActions) - 1)) == 0) return "that allows no action";
  for (std::size_t i = 0; streets && i < observation.position().size(); ++i) {
    if (observation.previous_action()[i] >= kActions && !(observation.flags()[i] & (msg::FLAG_FIRST | msg::FLAG_IDLE)))
      return "after an unknown action";
    if (observation.allowed()[i] != streets->allowed(static_cast<int>(observation.position()[i])))
      return "that allows other actions than its street map";
  }
  return "";
}

/// Fills in the features that the env_service left out.
bool complete(const EnvHandle& env, msg::Observation& observation) {
  if (!env.features) return false;
  const std::size_t dimension = env.features->dimension();
  observation.features().resize(observation.frame().size() * dimension);
  float* to = observation.features().data();
  for (const std::uint32_t frame : observation.frame()) {
    const float* from = env.features->at(frame);
    if (!from) return false;
    to = std::copy_n(from, dimension, to);
  }
  observation.by_reference() = false;
  observation.feature_dimension() = static_cast<std::uint32_t>(dimension);
  return true;
}

}  // namespace

bool by_reference(Observing observing, const msg::TraversalInfo& info) {
  const std::size_t numbers = std::size_t{info.agents()} * info.feature_dimension();
  if (observing == Observing::kWhole && numbers > msg::MAX_FEATURES)
    throw Error("the features of " + std::to_string(info.agents()) + " agents x " +
                    std::to_string(info.feature_dimension()) + " do not fit one observation (at most " +
                    std::to_string(msg::MAX_FEATURES) + ")",
                "", "ask for observations by reference");
  if (is_live(info)) return false;
  if (observing == Observing::kByReference) return numbers > 0;
  return observing == Observing::kAsFits && (info.images() || numbers * sizeof(float) > kMaxWholeBytes);
}

std::string check_and_complete(const EnvHandle& env, msg::Observation& observation) {
  std::string wrong = validation_error(env, observation);
  if (wrong.empty() && observation.by_reference() && !complete(env, observation)) wrong = "of frames without features";
  return wrong;
}

}  // namespace citylearn
