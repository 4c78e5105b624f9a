// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/recognition.h"

#include "tools/lab/recognition/methods.h"

namespace citylearn::paper {
namespace {

Json recognise(World& world, const RecognitionCase& one) {
  const auto matrix = [&](const std::string& name) {
    const Traversal& traversal = world.traversal(one.representation, name);
    return Eigen::Map<const Eigen::MatrixXf>(traversal.features.data(), traversal.dimension, traversal.frames);
  };
  const Eigen::MatrixXf reference = matrix(world.train()), query = matrix(one.query);
  const auto truth =
      GroundTruth::by_index(static_cast<int>(reference.cols()), static_cast<int>(query.cols()), kPlaceTolerance);
  const lab::Method::Result result = lab::Method(one.method).run(reference, query, truth, {});
  throw_if_stopped();
  const PrecisionRecall curve = precision_recall(result.answers);
  const Interval interval = auc_interval(result.answers, 1);
  return {{"queries", result.answers.queries()},
          {"auc", curve.auc},
          {"auc_low", interval.low},
          {"auc_high", interval.high},
          {"recall", recall_at(result.answers, 1)}};
}

}  // namespace

Unit unit_of(const RecognitionCase& one, World& world) {
  Unit unit;
  unit.name = "recognition of '" + one.query + "' by " + one.representation + ", " + one.method;
  unit.spec = {{"kind", "recognition"},
               {"representation", one.representation},
               {"method", one.method},
               {"frames", world.frames()},
               {"recordings", {world.hash(world.train()), world.hash(one.query)}}};
  const double size = world.frames() / 640.0;  // each frame is a class, and an example
  unit.seconds = size * size * (one.method == "mlp" ? 1.5 : 0.1);
  unit.compute = [one, &world] { return recognise(world, one); };
  return unit;
}

Json add_case(const RecognitionCase& one, Work& work, World& world) {
  return {{"representation", one.representation},
          {"method", one.method},
          {"query", one.query},
          {"unit", work.add(unit_of(one, world))}};
}

}  // namespace citylearn::paper
