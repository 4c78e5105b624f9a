// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <memory>
#include <string>

#include "core/util/random.h"
#include "core/wire/messages.h"
#include "env_service/traversal/traversal.h"
#include "tests/support/streets.h"

namespace citylearn::testing {

/// A traversal of streets whose frame i, of state i, shows its own D random features.
inline Traversal streets_traversal(const StreetMap& streets = small_streets(), StateRule rule = StateRule::kStreet,
                                   int dimension = 16, const std::string& name = "streets") {
  Traversal traversal;
  traversal.dataset = "test";
  traversal.name = name;
  traversal.frames = StateMap(streets, rule, msg::MAX_FRAMES).states();
  traversal.dimension = dimension;
  Random random(7);
  for (int i = 0; i < traversal.frames * dimension; ++i)
    traversal.features.push_back(static_cast<float>(random.uniform() - 0.5));
  traversal.positions.assign(static_cast<std::size_t>(traversal.frames), NAN);
  traversal.streets = std::make_shared<const StreetMap>(streets);
  traversal.rule = rule;
  return traversal;
}

}  // namespace citylearn::testing
