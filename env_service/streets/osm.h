// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace citylearn {

/// Returns the path of the extract of OpenStreetMap in a folder (.osm.pbf, .osm, .osm.gz, .osm.bz2), empty where there
/// is none. Throws Error naming two where there are several. StreetGraph::from_osm() reads it.
std::string osm_extract_in(const std::string& folder);

}  // namespace citylearn
