// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "env_service/streets/drive_streets.h"
#include "env_service/streets/street_graph.h"
#include "traversal.h"

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

/// Returns the streets that a recording has run through. Throws Error naming `where` when it has none (streets_of()).
DriveStreets streets_driven(const Traversal& recording, const std::string& where);

/// Makes the frames of a recording those of the links of a map, which are the states of rule street. `shown`: of each
/// link, in the order of the map.
void show_along_links(Traversal& traversal, std::shared_ptr<const StreetMap> map, const std::vector<int>& shown);

}  // namespace citylearn
