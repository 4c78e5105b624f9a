// SPDX-License-Identifier: Apache-2.0
// Streets of OpenStreetMap, as part of street_graph.h.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <osmium/io/any_compression.hpp>
#include <osmium/io/pbf_input.hpp>
#include <osmium/io/xml_input.hpp>
#include <osmium/osm/node.hpp>
#include <osmium/osm/relation.hpp>
#include <osmium/osm/way.hpp>
#include <osmium/thread/pool.hpp>
#include <protozero/pbf_reader.hpp>
#include <tuple>

#include "core/util/error.h"
#include "core/util/text.h"
#include "core/wire/messages.h"
#include "env_service/files/files.h"
#include "env_service/geometry/geometry.h"
#include "env_service/streets/street_graph.h"

namespace citylearn {
namespace {

using OsmId = osmium::object_id_type;

constexpr double kPlaceSpacing = 10;  // metres between places of a straight street: that of published panoramas
constexpr double kNearestNodes = 5;   // metres: nodes nearer to the one before only draw a curve finely
constexpr std::size_t kMaxWayNodes = 4 * std::size_t{msg::MAX_FRAMES};  // of all ways for cars, near ones too
constexpr const char* kGetAgain = "get it again";
constexpr const char* kCutOut = "cut a part out: osmium extract -b WEST,SOUTH,EAST,NORTH FILE -o PART.osm.pbf";

/// Nodes first..end of OsmWays::nodes, and in which directions cars go through them.
struct CarWay {
  std::size_t first, end;
  bool along, back;
};

struct OsmWays {
  std::vector<CarWay> ways;
  std::vector<osmium::NodeRef> nodes;  ///< with their locations, where the file has them on the ways
  std::size_t not_for_cars = 0, not_public = 0, turn_restrictions = 0;
};

bool is_one_of(std::string_view value, std::initializer_list<std::string_view> values) {
  return std::find(values.begin(), values.end(), value) != values.end();
}

bool is_for_cars(const osmium::TagList& tags) {
  std::string_view highway = tags.get_value_by_key("highway");
  if (highway.ends_with("_link")) highway.remove_suffix(5);
  return is_one_of(highway, {"motorway", "trunk", "primary", "secondary", "tertiary", "unclassified", "residential",
                             "living_street", "road"}) &&
         !tags.has_tag("area", "yes");
}

bool is_public(const osmium::TagList& tags) {
  for (const char* key : {"motorcar", "motor_vehicle", "vehicle", "access"})  // the special ones go first
    if (const char* value = tags.get_value_by_key(key)) return !is_one_of(value, {"no", "private"});
  return true;
}

void set_directions(const osmium::TagList& tags, CarWay& way) {
  const std::string_view oneway = tags.get_value_by_key("oneway", "");
  const bool implied = tags.has_tag("highway", "motorway") ||
                       is_one_of(tags.get_value_by_key("junction", ""), {"roundabout", "circular"});
  way.along = !is_one_of(oneway, {"-1", "reverse"});
  way.back =
      !is_one_of(oneway, {"yes", "1", "true"}) && (!implied || is_one_of(oneway, {"no", "0", "false"}) || !way.along);
}

/// Calls `use` for each object of these types. Its threads end with it.
void each_object(const std::string& path, osmium::osm_entity_bits::type types,
                 const std::function<void(const osmium::OSMObject&)>& use) {
  osmium::thread::Pool pool(1);
  // An absolute path cannot be taken for an address, which libosmium would give to curl.
  osmium::io::Reader reader(std::filesystem::absolute(path).string(), types, pool);
  if (reader.header().has_multiple_object_versions())
    throw Error("holds changes of a map, not a map", path, "take an extract without history");
  while (const osmium::memory::Buffer buffer = reader.read())
    for (const auto& object : buffer.select<osmium::OSMObject>())
      if (object.visible()) use(object);
  reader.close();
}

/// Throws Error where a PBF does not consist of whole blobs. libosmium takes a size of 0 for the end, as where zeros
/// fill up a download that was broken off.
void check_blobs(const std::string& path) {
  constexpr protozero::pbf_tag_type kBlobSize = 3;  // field datasize of BlobHeader
  std::ifstream file(path, std::ios::binary);
  const std::uintmax_t size = std::filesystem::file_size(path);
  std::string header;
  for (std::uintmax_t at = 0, end = 0; at < size; at = end) {
    std::array<unsigned char, 4> length{};
    file.seekg(static_cast<std::streamoff>(at)).read(reinterpret_cast<char*>(length.data()), length.size());
    header.assign(std::size_t{length[2]} << 8 | length[3], '\0');  // it has less than 64 KiB
    file.read(header.data(), static_cast<std::streamsize>(header.size()));
    end = at + length.size() + header.size();
    protozero::pbf_reader fields(header);
    while (file && fields.next(kBlobSize)) end += static_cast<std::uint32_t>(fields.get_int32());
    if (!file || header.empty() || end > size)
      throw Error(fmt::format("is damaged after {} of its {} bytes", at, size), path, kGetAgain);
  }
}

OsmWays read_ways(const std::string& path) {
  OsmWays found;
  each_object(path, osmium::osm_entity_bits::way | osmium::osm_entity_bits::relation,
              [&](const osmium::OSMObject& object) {
                if (object.type() == osmium::item_type::relation)
                  found.turn_restrictions +=
                      std::string_view(object.tags().get_value_by_key("type", "")).starts_with("restriction");
                if (object.type() != osmium::item_type::way || !object.tags().has_key("highway")) return;
                const osmium::WayNodeList& nodes = static_cast<const osmium::Way&>(object).nodes();
                if (!is_for_cars(object.tags())) {
                  ++found.not_for_cars;
                } else if (!is_public(object.tags())) {
                  ++found.not_public;
                } else if (found.nodes.size() + nodes.size() > kMaxWayNodes) {
                  throw Error(fmt::format("has streets with more than {} nodes", kMaxWayNodes), path, kCutOut);
                } else {
                  CarWay way{found.nodes.size(), found.nodes.size() + nodes.size(), true, true};
                  set_directions(object.tags(), way);
                  found.nodes.insert(found.nodes.end(), nodes.begin(), nodes.end());
                  found.ways.push_back(way);
                }
              });
  return found;
}

/// Streets by the indices of their two nodes, of which the first is less: whether cars go on, and whether back.
using OsmPieces = std::map<std::pair<std::size_t, std::size_t>, std::array<bool, 2>>;

/// The nodes of ways by id, each once.
struct OsmNodes {
  std::vector<OsmId> ids;
  std::vector<osmium::Location> locations;
  std::vector<int> uses;  ///< how often ways run through it

  OsmNodes(const std::string& path, const std::vector<osmium::NodeRef>& nodes) {
    for (const osmium::NodeRef& node : nodes) ids.push_back(node.ref());
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    locations.resize(ids.size());
    uses.resize(ids.size());
    for (const osmium::NodeRef& node : nodes) {
      const std::size_t index = find(node.ref());
      ++uses[index];
      if (node.location().valid()) locations[index] = node.location();
    }
    if (missing() == 0) return;  // they stand on the ways
    each_object(path, osmium::osm_entity_bits::node, [&](const osmium::OSMObject& node) {
      const std::size_t index = find(node.id());
      if (index < ids.size() && ids[index] == node.id())
        locations[index] = static_cast<const osmium::Node&>(node).location();
    });
  }
  std::size_t find(OsmId id) const {
    return static_cast<std::size_t>(std::lower_bound(ids.begin(), ids.end(), id) - ids.begin());
  }
  std::size_t missing() const {
    return static_cast<std::size_t>(
        std::count_if(locations.begin(), locations.end(), [](auto& at) { return !at.valid(); }));
  }
  double metres(std::size_t a, std::size_t b) const {
    return metres_between(locations[a].lat(), locations[a].lon(), locations[b].lat(), locations[b].lon());
  }
};

/// Cuts ways at nodes that ways share, at those of bends, and where nodes are missing.
OsmPieces cut_ways(const OsmWays& found, const OsmNodes& nodes) {
  constexpr std::size_t kNone = -1;
  OsmPieces pieces;
  for (const CarWay& way : found.ways) {
    const auto node_at = [&](std::size_t i) {
      const std::size_t node = i < way.end ? nodes.find(found.nodes[i].ref()) : kNone;
      return i < way.end && nodes.locations[node].valid() ? node : kNone;
    };
    std::size_t before = kNone;
    for (std::size_t i = way.first; i < way.end; ++i) {
      const std::size_t node = node_at(i);
      const bool inside = before != kNone && node != kNone && node_at(i + 1) != kNone && nodes.uses[node] == 1;
      if (inside && nodes.metres(before, node) < kNearestNodes) continue;
      if (before != kNone && node != kNone && before != node) {
        auto& [on, back] = pieces[std::minmax(before, node)];
        on |= before < node ? way.along : way.back;
        back |= before < node ? way.back : way.along;
      }
      before = node;
    }
  }
  return pieces;
}

}  // namespace

std::shared_ptr<const StreetGraph> StreetGraph::find_osm_in(const std::string& folder) {
  const std::vector<std::string> found = files_in(folder, {".pbf", ".osm", ".osm.gz", ".osm.bz2"});
  if (found.size() > 1)
    throw Error("has two extracts of a map, " + found[0] + " and " + found[1], folder, "keep one of them");
  return found.empty() ? nullptr : std::make_shared<const StreetGraph>(from_osm(below(folder, found[0])));
}

StreetGraph StreetGraph::from_osm(const std::string& path) try {
  if (lower(path).ends_with(".pbf")) check_blobs(path);
  const OsmWays found = read_ways(path);
  const OsmNodes nodes(path, found.nodes);
  StreetGraph graph;
  graph.where_ = path;
  const auto check = [&](const std::string& fault) {
    if (!fault.empty()) throw Error("has streets with " + fault, path, kCutOut);
  };
  const auto add_place = [&](const std::string& id, double latitude, double longitude) {
    check(graph.add({id, 0, latitude, longitude}));
    return static_cast<int>(graph.places_.size()) - 1;
  };
  std::vector<int> places(nodes.ids.size(), -1);
  const auto place_of_node = [&](std::size_t node) {
    if (places[node] < 0)
      places[node] =
          add_place("n" + std::to_string(nodes.ids[node]), nodes.locations[node].lat(), nodes.locations[node].lon());
    return places[node];
  };
  for (const auto& [ends, directions] : cut_ways(found, nodes)) {
    const int begin = place_of_node(ends.first), end = place_of_node(ends.second);
    const StreetPlace a = graph.places_[static_cast<std::size_t>(begin)],
                      b = graph.places_[static_cast<std::size_t>(end)];
    const double parts = std::max(1.0, std::round(nodes.metres(ends.first, ends.second) / kPlaceSpacing));
    const double east = std::remainder(b.longitude - a.longitude, 360);
    int before = begin;
    for (double part = 1; part <= parts; ++part) {
      const int next = part == parts ? end
                                     : add_place(fmt::format("{}-{}.{:.0f}", a.id, b.id, part),
                                                 a.latitude + (b.latitude - a.latitude) * part / parts,
                                                 std::remainder(a.longitude + east * part / parts, 360));
      if (directions[0]) check(graph.add_link(before, next, static_cast<int>(graph.links_), nullptr));
      if (directions[1]) check(graph.add_link(next, before, static_cast<int>(graph.links_), nullptr));
      before = next;
    }
  }
  std::vector<bool> kept(graph.links_, true);
  StreetGraph part = graph.strong_part(kept);
  part.about_ = fmt::format("streets of {}: ways for cars {}", std::filesystem::path(path).filename().string(),
                            found.ways.size());
  for (const auto& [what, count, remark] :
       {std::tuple("nodes", nodes.ids.size() - nodes.missing(), ""),
        {"nodes that are not in the file", nodes.missing(), " (ways end before them)"},
        {"private ways left out", found.not_public, ""},
        {"footways and others left out", found.not_for_cars, ""},
        {"turn restrictions", found.turn_restrictions, " (not followed)"},
        {"places left out without a way there and back", graph.places_.size() - part.places_.size(), ""}})
    if (count > 0) part.about_ += fmt::format(", {} {}{}", what, count, remark);
  if (part.links_ == 0)
    throw Error("has no streets on which cars can go there and back (" + part.about_ + ")", path,
                "take a whole extract, with ways of highway=residential and the like, and their nodes");
  return part;
} catch (const Error&) {
  throw;
} catch (const std::exception& error) {  // libosmium's, protozero's
  throw Error(fmt::format("is not an extract of OpenStreetMap, or a damaged one: {}", error.what()), path, kGetAgain);
}

}  // namespace citylearn
