// SPDX-License-Identifier: Apache-2.0
// What the paper has figures of: trainings, deployments, place recognition, and its main finding.
#include <algorithm>
#include <cmath>

#include "encoder_service/encoding/encoder.h"
#include "tools/lab/recognition/methods.h"
#include "tools/paper/sections/sections.h"

namespace citylearn::paper {
namespace {

/// Features a frame that the paper compares.
const std::vector<int> kPaperDimensions = {64, 512, 2048, 4096};
/// Those that the section on them compares.
const std::vector<int> kDimensions = {64, 128, 512, 2048, 4096};
/// An answer of place recognition is right when it is at most so many frames off.
constexpr int kPlaceTolerance = 2;

/// The paper's agent on another representation, with fewer seeds where there are more features, as its training takes
/// longer.
Agent wide_agent(const Context& context, const std::string& representation) {
  Agent agent = context.paper_agent();
  const int features = context.world.features(representation);
  agent.representation = representation;
  agent.seeds.resize(std::min<std::size_t>(agent.seeds.size(), features <= 512 ? 3 : 1));
  agent.seconds = 60 + 0.04 * features;  // on two idle processors
  return agent;
}

/// Returns the paper's agent on more features than the others compare it on, as many as the data allow.
std::vector<Agent> wide_agents(const Context& context) {
  const std::string narrow = context.paper_agent().representation, encoder = encoder_of(narrow) + "-";
  std::vector<Agent> agents;
  for (const std::string& representation : context.world.representations(kPaperDimensions))
    if (representation.starts_with(encoder) && context.world.features(representation) > context.world.features(narrow))
      agents.push_back(wide_agent(context, representation));
  if (context.quick && agents.size() > 1) agents.erase(agents.begin(), agents.end() - 1);
  return agents;
}

Json recognise(World& world, const std::string& representation, const std::string& method, const std::string& query) {
  const auto matrix = [&](const std::string& name) {
    const Traversal& traversal = world.traversal(representation, name);
    return Eigen::Map<const Eigen::MatrixXf>(traversal.features.data(), traversal.dimension, traversal.frames);
  };
  const Eigen::MatrixXf reference = matrix(world.train()), frames = matrix(query);
  const auto truth =
      GroundTruth::by_index(static_cast<int>(reference.cols()), static_cast<int>(frames.cols()), kPlaceTolerance);
  const Answers answers = lab::Method(method).run(reference, frames, truth, {}).answers;
  throw_if_stopped();
  const Interval interval = auc_interval(answers, 1);
  return {{"queries", answers.queries()},
          {"auc", precision_recall(answers).auc},
          {"auc_low", interval.low},
          {"auc_high", interval.high},
          {"recall", recall_at(answers, 1)}};
}

/// Adds the unit that recognises all frames of `query` among those of the traversal learned from. Outcome: {"queries",
/// "auc", "auc_low", "auc_high", "recall"}; the interval comes from resampled blocks of neighbouring frames. Returns
/// {"representation", "method", "query", "unit"}.
Json add_recognition(const std::string& representation, const std::string& method, const std::string& query, Work& work,
                     World& world) {
  const double size = world.frames() / 640.0;  // each frame is a class, and an example
  const int unit = work.add({"recognition of '" + query + "' by " + representation + ", " + method,
                             {{"kind", "recognition"},
                              {"representation", representation},
                              {"method", method},
                              {"frames", world.frames()},
                              {"recordings", {world.hash(world.train()), world.hash(query)}}},
                             size * size * (method == "mlp" ? 1.5 : 0.1),
                             [=, &world] { return recognise(world, representation, method, query); }});
  return {{"representation", representation}, {"method", method}, {"query", query}, {"unit", unit}};
}

void without_deployments(Study& study) { study.deploy_every = 0; }

}  // namespace

Plan figure_2(const Context& context) {
  Plan plan{context.world, {{context.agents}}};
  for (const Agent& agent : wide_agents(context)) plan.points.push_back({{agent}, {}, without_deployments});
  return plan;
}

Plan figure_6(const Context& context) {
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
        cases.push_back(add_recognition(representation, method, query, context.work, world));
  return {world,
          {},
          {{"tolerance", kPlaceTolerance},
           {"representations", representations},
           {"methods", methods},
           {"queries", queries},
           {"cases", cases}}};
}

Plan figure_7(const Context& context) { return {context.world, {{context.agents}}}; }

Plan figure_8_9(const Context& context) {
  return {context.world, {{context.agents, {"blind", "shortest_path", "sequence_filter"}}}};
}

Plan dimensions(const Context& context) {
  World& world = context.with_pictures();
  const std::string encoder = encoder_of(world.common_representation());
  const int learned_from = world.recording(world.train()).frames;
  // As many features as there can be are tried where this is less than wanted.
  const int most = std::min(world.encoder_dimension(encoder), learned_from - 1);
  std::vector<int> tried, missing;
  for (const int dimension : kDimensions) (dimension <= most ? tried : missing).push_back(dimension);
  if (!missing.empty() && (tried.empty() || tried.back() < most)) tried.push_back(most);
  Plan plan{world,
            {},
            {{"encoder", encoder},
             {"encoder_dimension", world.encoder_dimension(encoder)},
             {"learned_from", learned_from},
             {"missing", missing}},
            &world != &context.world};
  for (const int features : tried) {
    const std::string representation = encoder + "-" + std::to_string(features);
    // What the other sections need too is the same piece of work.
    const bool elsewhere = &world == &context.world && representation == context.paper_agent().representation;
    std::vector<Agent> agents = {{"place_filter", representation, context.seeds, 2 + 0.003 * features, "relabel"}};
    // Quick reports train the paper's agent on the fewest and the most alone.
    if (!context.quick || features == tried.front() || features == tried.back())
      agents.push_back(elsewhere ? context.paper_agent() : wide_agent(context, representation));
    plan.points.push_back({agents, {"sequence_filter", "blind"}, [elsewhere](Study& study) {
                             if (!elsewhere || study.policy != "features") study.deploy_every = 0;
                           }});
  }
  return plan;
}

}  // namespace citylearn::paper
