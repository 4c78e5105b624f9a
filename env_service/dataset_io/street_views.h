// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "env_service/dataset_io/traversal.h"
#include "env_service/streets/street_graph.h"

namespace citylearn {

/// Gives a traversal, whose frames are those of the states, its streets, and latitude and longitude of their places.
void set_streets(Traversal& traversal, const StreetGraph& graph, std::shared_ptr<const StreetMap> map, StateRule rule,
                 const StateMap& states);

/// Makes frames that are views of a map those of its states: a frame for each link in the order in which they were read
/// (kStreet), 16 for each place from north clockwise (the other two), or one for each place, the same at each heading.
/// Without a rule it is the one that they fit, or else they stay a line. Throws Error naming `where` when they do not
/// fit `rule`.
void show_states(Traversal& traversal, const StreetGraph& graph, std::optional<StateRule> rule,
                 const std::string& where);

}  // namespace citylearn
