// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tools/paper/sections/transfer_agent.h"
#include "tools/paper/studies/recognition.h"

namespace citylearn::paper {

Json plan_viewpoint(const Context& context) {
  World& straight = context.world.pictures() ? context.world : context.drawn;
  World& world = straight.laterally_shifted();
  const std::string representation = common_representation(world);
  const int frames = std::min(context.frames, world.frames());
  Json shifts = Json::array(), cases = Json::array(), agents = Json::array();
  for (const double shift : straight.lateral_shifts())
    shifts.push_back({{"at", shift}, {"name", straight.shifted_name(shift)}});
  const std::vector<std::string> methods =
      context.quick ? std::vector<std::string>{"nearest"} : std::vector<std::string>{"mlp", "nearest"};
  for (const std::string& method : methods)
    for (const Json& shift : shifts)
      cases.push_back(add_case({representation, method, shift["name"]}, context.work, world));
  for (const Context::Agent& agent : transfer_agents(context, world))
    agents.push_back(context.add_agent(agent, [&](std::uint64_t seed) {
      const Study first = first_training(context, world, agent, seed, frames);
      context.work.add(unit_of(first, world));
      return unit_of(TransferTrial{saved_agent(first, world, context.work), representation, 0, frames, context.tasks(),
                                   world.names()},
                     world);
    }));
  const ControlStudy control{"", representation, 0, frames, context.tasks(), world.names()};
  return {{"recordings", world.description()},
          {"substitute", &straight != &context.world},
          {"representation", representation},
          {"frames", frames},
          {"tolerance", kPlaceTolerance},
          {"shifts", shifts},
          {"methods", methods},
          {"cases", cases},
          {"agents", agents},
          {"controls", context.add_controls(world, {"blind", "sequence_filter"}, control)}};
}

}  // namespace citylearn::paper
