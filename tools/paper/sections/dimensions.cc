// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tools/paper/sections/transfer_agent.h"
#include "tools/paper/sections/wide_features.h"

namespace citylearn::paper {
namespace {

const std::vector<int> kDimensions = {64, 128, 512, 2048, 4096};

/// The numbers of features that are compared, and those that cannot be had.
struct Sizes {
  std::vector<int> tried, missing;
};

/// `most`: that can be had; where this is less than wanted, it is compared itself.
Sizes sizes_up_to(int most) {
  Sizes sizes;
  for (const int dimension : kDimensions) (dimension <= most ? sizes.tried : sizes.missing).push_back(dimension);
  if (!sizes.missing.empty() && (sizes.tried.empty() || sizes.tried.back() < most)) sizes.tried.push_back(most);
  return sizes;
}

}  // namespace

/// The paper's main finding, tried: agents that learn from more and fewer features of the same encoder.
Json plan_dimensions(const Context& context) {
  World& world = context.world.pictures() ? context.world : context.drawn;
  const std::string encoder = encoder_of(common_representation(world));
  const int learned_from = world.recording(world.train()).frames;
  const Sizes sizes = sizes_up_to(std::min(world.encoder_dimension(encoder), learned_from - 1));
  const int frames = std::min(context.frames, world.frames());
  Json rows = Json::array();
  for (const int features : sizes.tried) {
    const std::string representation = encoder + "-" + std::to_string(features);
    // What the other sections need too is the same piece of work.
    const bool elsewhere = &world == &context.world && representation == paper_agent(context).representation;
    const auto unit_of_seed = [&](const Context::Agent& agent) {
      return [&](std::uint64_t seed) {
        Study study = context.study(agent, seed);
        if (!elsewhere || agent.agent != "features") study.deploy_every = 0;
        study.frames = frames;
        study.traversals = world.names();
        return unit_of(study, world);
      };
    };
    const Context::Agent filter{"place_filter", representation, context.seeds, 2 + 0.003 * features, "relabel"};
    Json agents = Json::array({context.add_agent(filter, unit_of_seed(filter))});
    // Quick reports train the paper's agent on the fewest and the most alone.
    if (!context.quick || features == sizes.tried.front() || features == sizes.tried.back()) {
      const Context::Agent paper = elsewhere ? paper_agent(context) : wide_agent(context, representation);
      agents.push_back(context.add_agent(paper, unit_of_seed(paper)));
    }
    const ControlStudy control{"", representation, 0, frames, context.tasks(), world.names()};
    rows.push_back({{"features", features},
                    {"agents", agents},
                    {"controls", context.add_controls(world, {"sequence_filter", "blind"}, control)}});
  }
  return {{"recordings", world.description()},
          {"substitute", &world != &context.world},
          {"encoder", encoder},
          {"encoder_dimension", world.encoder_dimension(encoder)},
          {"learned_from", learned_from},
          {"missing", sizes.missing},
          {"frames", frames},
          {"sizes", rows}};
}

}  // namespace citylearn::paper
