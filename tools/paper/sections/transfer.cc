// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tools/paper/sections/transfer_agent.h"

namespace citylearn::paper {
namespace {

/// How a trained agent learns on the second route.
struct Variant {
  std::string label;
  bool pretrained = true;             ///< begins with the parameters of the first route
  std::vector<std::string> frozen{};  ///< tensors that stay as they were
};

std::vector<Variant> variants_of(const std::string& agent) {
  if (agent == "place_filter")
    return {{"all of it is fine-tuned"},
            {"head learns, filter frozen", true, {"filter"}},
            {"filter learns, head frozen", true, {"head"}},
            {"trained from scratch", false}};
  return {{"all of it is fine-tuned"},
          {"input layer learns, rest frozen", true, {"lstm", "heads", "auxiliary"}},
          {"input layer frozen, rest learns", true, {"sensors"}},
          {"trained from scratch", false}};
}

Study second_training(const Context& context, const Study& first, const Context::Agent& agent, const Variant& variant) {
  const double share = context.quick ? 0.25 : 1;
  Study study = first;
  study.save_parameters = false;
  study.first = first.frames;
  study.steps = transfer_steps(context, agent, share);
  study.seconds = agent.seconds * share * context.effort;
  study.traversals = context.world.names();
  if (variant.pretrained) study.initial = saved_agent(first, context.world, context.work);
  study.frozen = variant.frozen;
  return study;
}

}  // namespace

Json plan_transfer(const Context& context) {
  World& world = context.world;
  const int frames = std::min(context.frames, world.frames() / 2);  // of each of the two routes
  Json agents = Json::array();
  for (const Context::Agent& agent : transfer_agents(context, world)) {
    const std::vector<Variant> variants = variants_of(agent.agent);
    Json unchanged = Json::array(), trained = Json::array();
    for (const Variant& variant : variants)
      trained.push_back({{"label", variant.label}, {"pretrained", variant.pretrained}, {"units", Json::array()}});
    for (const std::uint64_t seed : agent.seeds) {
      const Study first = first_training(context, world, agent, seed, frames);
      context.work.add(unit_of(first, world));
      unchanged.push_back(
          context.work.add(unit_of(TransferTrial{saved_agent(first, world, context.work), first.representation, frames,
                                                 frames, context.tasks(), world.names()},
                                   world)));
      for (std::size_t i = 0; i < variants.size(); ++i)
        trained[i]["units"].push_back(
            context.work.add(unit_of(second_training(context, first, agent, variants[i]), world)));
    }
    agents.push_back(
        {{"agent", agent.agent}, {"label", label_of(agent.agent)}, {"unchanged", unchanged}, {"variants", trained}});
  }
  const ControlStudy control{"", common_representation(world), frames, frames, context.tasks(), world.names()};
  return {{"frames", frames},
          {"agents", agents},
          {"controls", context.add_controls(world, {"blind", "sequence_filter"}, control)}};
}

}  // namespace citylearn::paper
