// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "encoder_service/encoding/encoder.h"
#include "tools/paper/context.h"
#include "tools/paper/studies/memory.h"

namespace citylearn::paper {
namespace {

/// "metres" from the first known position to the last; the mean "step" and the "smallest_step" between neighbours that
/// are not the same place. Null where unknown.
Json length_of(const Traversal& traversal) {
  const auto position = [&](int i) { return static_cast<double>(traversal.positions[static_cast<std::size_t>(i)]); };
  int first = 0, last = traversal.frames - 1;
  while (first < traversal.frames && !std::isfinite(position(first))) ++first;
  while (last > first && !std::isfinite(position(last))) --last;
  if (last <= first) return {{"metres", nullptr}, {"step", nullptr}, {"smallest_step", nullptr}};
  const double metres = position(last) - position(first);
  double smallest = INFINITY;
  for (int i = first + 1; i <= last; ++i)
    if (const double step = std::abs(position(i) - position(i - 1)); step > 0) smallest = std::min(smallest, step);
  return {{"metres", number(metres)}, {"step", number(metres / (last - first))}, {"smallest_step", number(smallest)}};
}

std::string sensors_of(const Traversal& traversal) {
  std::string text = traversal.images ? "pictures" : std::to_string(traversal.dimension) + " features";
  if (!traversal.latitude.empty()) text += ", GPS";
  if (!traversal.times.empty()) text += ", time";
  return text;
}

}  // namespace

Json plan_tables(const Context& context) {
  Json traversals = Json::array(), encoders = Json::array();
  for (const std::string& name : context.world.names()) {
    const Traversal& traversal = context.world.recording(name);
    Json row = length_of(traversal);
    row.update({{"name", name},
                {"condition", traversal.condition},
                {"frames", traversal.frames},
                {"sensors", sensors_of(traversal)}});
    traversals.push_back(row);
  }
  for (const auto* entry : EncoderRegistry::instance().entries()) encoders.push_back(entry->name);
  // Measured with the features that agents are given.
  const int memory =
      context.work.add(memory_unit(context.agents.front().representation, env_service_program(), context.world));
  return {{"traversals", traversals}, {"encoders", encoders}, {"memory", memory}};
}

}  // namespace citylearn::paper
