// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/context.h"

namespace citylearn::paper {

Json plan_figure_8_9(const Context& context) {
  const Json agents = context.add_agents();
  ControlStudy control;
  control.representation = context.agents.back().representation;  // what most agents see
  control.frames = context.frames;
  control.tasks = context.tasks();
  control.traversals = context.world.names();
  return {{"agents", agents},
          {"controls", context.add_controls(context.world, {"blind", "shortest_path", "sequence_filter"}, control)}};
}

}  // namespace citylearn::paper
