// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "env_service/dataset_io/traversal.h"
#include "env_service/streets/street_graph.h"

namespace citylearn {

/// Returns for each link of a map, in the order in which they were read, the frame of a recording that shows it: the
/// one nearest to its beginning, at most 15 m away, on the way within 45 degrees of its heading. -1 where there is
/// none.
std::vector<int> frames_along_links(const Traversal& recording, const StreetGraph& graph);

/// The streets of a map that all recordings with positions show, so that all are walked on the same map.
struct StreetCoverage {
  std::shared_ptr<const StreetGraph> part;         ///< its largest strong part; without links where there is none
  std::map<std::string, std::vector<int>> frames;  ///< by recording: of each link of the part, as they were read
  std::string summary;                             ///< in one line: how many links each shows, and all
};

/// Finds them for recordings by name. `load` returns one, with the positions that it has.
StreetCoverage find_coverage(const StreetGraph& graph, const std::vector<std::string>& names,
                             const std::function<Traversal(const std::string&)>& load);

}  // namespace citylearn
