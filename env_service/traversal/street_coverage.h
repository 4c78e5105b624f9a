// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "env_service/streets/street_graph.h"
#include "traversal.h"

namespace citylearn {

/// Returns for each link of a map, in the order in which they were read, the frame of a recording that shows it: the
/// one nearest to its beginning, at most 15 m away, on the way within 45 degrees of its heading. -1 where there is
/// none; empty where no latitude and longitude are known.
std::vector<int> frames_along_links(const Traversal& recording, const StreetGraph& graph);

/// The streets of a map that all recordings with positions show, so that all are walked on the same map.
struct StreetCoverage {
  std::shared_ptr<const StreetGraph> part;         ///< its largest strong part; without links where there is none
  std::map<std::string, std::vector<int>> frames;  ///< by recording: of each link of the part, as they were read
  std::string summary;                             ///< in one line: how many links each shows, and all
};

/// Finds them from what frames_along_links() returned for each recording, by name.
StreetCoverage find_coverage(const StreetGraph& graph, const std::map<std::string, std::vector<int>>& shown_by);

}  // namespace citylearn
