// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/context.h"

namespace citylearn::paper {

Json plan_figure_7(const Context& context) { return {{"agents", context.add_agents()}}; }

}  // namespace citylearn::paper
