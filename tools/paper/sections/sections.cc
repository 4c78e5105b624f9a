// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/sections/sections.h"

namespace citylearn::paper {

const std::vector<Section>& sections() {
  static const std::vector<Section> all = {
      {"figure-2", "Fig. 2: what training costs", plan_figure_2},
      {"figure-6", "Fig. 6: place recognition", plan_figure_6},
      {"figure-7", "Fig. 7: training curves", plan_figure_7},
      {"figure-8-9", "Fig. 8 and 9: deployment and generalisation", plan_figure_8_9},
      {"figure-10", "Fig. 10: one goal, by day and by night", plan_figure_10, complete_figure_10},
      {"tables", "Tables I and II: the data and the environments", plan_tables},
      {"longer-routes", "Beyond the paper: longer routes", plan_longer_routes},
      {"transfer", "Beyond the paper: a policy on a second route", plan_transfer},
      {"viewpoint", "Beyond the paper: a camera to the side", plan_viewpoint},
      {"experiences", "Beyond the paper: two experiences of a route", plan_experiences},
      {"imperfect-world", "Beyond the paper: an imperfect world", plan_imperfect_world},
      {"dimensions", "The paper's main finding: smaller features generalise better", plan_dimensions},
      {"map", "Beyond the paper: a map with junctions", plan_map}};
  return all;
}

}  // namespace citylearn::paper
