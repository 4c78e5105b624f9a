// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/task/street_map.h"
#include "env_service/streets/leveldb.h"

namespace citylearn {

/// A directed link between two places.
struct StreetLink {
  int to = 0;
  double heading = 0, metres = 0;  ///< degrees clockwise from north, 0 <= heading < 360; metres of the straight line
  int line = 0;                    ///< of links.txt; in a LevelDB they are counted
};
struct StreetPlace {
  std::string id;
  double yaw = 0, latitude = 0, longitude = 0;  ///< yaw: degrees clockwise from north of the panorama's middle column
  std::vector<StreetLink> links = {};
};
/// A place on a walk, and the heading of the link that leaves it.
struct StreetStep {
  int place = 0;
  double heading = 0;
};

/// Returns which of so many places are in the largest part in which each can be reached from each other one.
std::vector<bool> largest_strong_part(std::size_t places, const std::vector<std::pair<int, int>>& links);
/// Returns a line for a person that counts them: places, links, junctions, which are places beside more than two others
/// in whichever direction, dead ends, which are beside one, there and back, and links without one the other way.
std::string count_streets(std::size_t places, const std::vector<std::pair<int, int>>& links);

/// Places and the directed links between them, as a map of streets has them.
class StreetGraph {
 public:
  /// Reads nodes.txt and links.txt, a line at a time. Throws Error naming file and line where the map is wrong or
  /// larger than msg::MAX_FRAMES.
  static StreetGraph from_files(const std::string& nodes, const std::string& links);
  /// Reads these of a folder, or of graph/ in it. Returns null where one of them is not there.
  static std::shared_ptr<const StreetGraph> find_in(const std::string& folder);
  /// Reads the map of StreetLearn as it is published. A link's heading is that from position to position; where both
  /// are at one spot (1 cm) it is the yaw of the place that the link leaves, as a direction does not exist there.
  /// Throws Error naming the folder and what is wrong.
  static StreetGraph from_leveldb(const LevelDb& database);
  /// Reads the streets for cars of an extract of OpenStreetMap, their largest strong component: a place at each
  /// crossing and bend, and between them about every 10 m; crossings are where ways share a node. Throws Error naming
  /// the file: damaged, without streets, or larger than msg::MAX_FRAMES.
  static StreetGraph from_osm(const std::string& path);
  /// Reads the extract of a folder (.osm.pbf, .osm, .osm.gz, .osm.bz2). Returns null where there is none. Throws Error
  /// likewise, and naming two where there are several.
  static std::shared_ptr<const StreetGraph> find_osm_in(const std::string& folder);

  /// Returns the largest part in which each place can be reached from each, by way of these links (in the order in
  /// which they were read, L), of a map that was not read from text files. `kept` becomes the links of the part, in the
  /// same order.
  StreetGraph strong_part(std::vector<bool>& kept) const;
  std::size_t links() const { return links_; }
  const std::string& where() const { return where_; }  ///< the file or key that has the links
  const std::string& about() const { return about_; }  ///< a line for a person: what was read; or empty
  const std::vector<StreetPlace>& places() const { return places_; }
  /// Returns the map in order, places by their indices, in metres from the first one; and in `rows` which link each
  /// was, in the order in which they were read. Throws Error that names a link to a place that cannot be left.
  StreetMap map(std::vector<std::uint32_t>& rows) const;
  /// Returns lines for a person: what there is, and what may be wrong.
  std::vector<std::string> description() const;
  /// Returns the index of the place of this id, -1 when there is none.
  int find(const std::string& id) const;
  /// Returns the place farthest from `start` of those that can be reached, by way of links.
  int farthest(int start) const;
  /// Returns the shortest walk by way of these places, in metres from each to the next; the last step looks on as the
  /// one before. Throws Error naming `where` when no links lead from one to the next.
  std::vector<StreetStep> walk(const std::vector<int>& stops, const std::string& where) const;

 private:
  struct Tree {
    std::vector<double> metres;
    std::vector<StreetStep> before;  ///< the place before and the heading from there
  };
  Tree shortest(int start) const;
  /// These return what is wrong, and add nothing then; an empty text when nothing is.
  std::string add(StreetPlace place);
  std::string add_link(int from, int to, int line, const double* heading);
  /// Returns the places at both ends of the links whose line `use` takes.
  std::vector<std::pair<int, int>> ends(const std::function<bool(int line)>& use) const;
  std::string position_of(const StreetLink& link) const { return where_ + ":" + std::to_string(link.line); }

  std::vector<StreetPlace> places_;
  std::unordered_map<std::string, int> index_;  // of places_, by id
  std::size_t links_ = 0;
  std::string where_;  // the links are
  std::string about_;  // with what was left out
};

/// Returns the picture within a panorama of StreetLearn as it is published, part of `panorama`. Throws Error naming
/// `where` when the panorama is damaged or has none, or when it is not a JPEG.
std::string_view picture_of_panorama(std::string_view panorama, const std::string& where);

}  // namespace citylearn
