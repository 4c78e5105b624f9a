// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/sections/wide_features.h"

#include <algorithm>

namespace citylearn::paper {
namespace {

/// Estimated seconds of one training of `features`, on two idle processors.
double training_seconds(int features) { return 60 + 0.04 * features; }

}  // namespace

std::string encoder_of(const std::string& representation) {
  return representation.substr(0, representation.rfind('-'));
}

int features_of(const std::string& representation) {
  return std::stoi(representation.substr(representation.rfind('-') + 1));
}

const Context::Agent& paper_agent(const Context& context) {
  return *std::find_if(context.agents.begin(), context.agents.end(),
                       [](const Context::Agent& agent) { return agent.agent == "features"; });
}

Context::Agent wide_agent(const Context& context, const std::string& representation) {
  Context::Agent agent = paper_agent(context);
  const int features = features_of(representation);
  agent.representation = representation;
  agent.seeds.resize(std::min<std::size_t>(agent.seeds.size(), features <= 512 ? 3 : 1));
  agent.seconds = training_seconds(features);
  return agent;
}

}  // namespace citylearn::paper
