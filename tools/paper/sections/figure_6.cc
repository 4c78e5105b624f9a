// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/sections/wide_features.h"
#include "tools/paper/studies/recognition.h"

namespace citylearn::paper {

Json plan_figure_6(const Context& context) {
  World& world = context.world;
  std::vector<std::string> queries = world.names();
  if (queries.size() > 1) queries.erase(queries.begin());
  std::vector<std::string> representations = world.representations(kPaperDimensions);
  std::erase(representations, "raw84");  // pixels are for agents that learn to see
  // The paper's classifier, and the plain nearest frame beside it.
  const std::vector<std::string> methods = {"mlp", "nearest"};
  Json cases = Json::array();
  for (const std::string& representation : representations)
    for (const std::string& method : methods)
      for (const std::string& query : queries)
        cases.push_back(add_case({representation, method, query}, context.work, world));
  return {{"tolerance", kPlaceTolerance},
          {"representations", representations},
          {"methods", methods},
          {"queries", queries},
          {"cases", cases}};
}

}  // namespace citylearn::paper
