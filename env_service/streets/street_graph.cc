// SPDX-License-Identifier: Apache-2.0
#include "env_service/streets/street_graph.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <boost/graph/compressed_sparse_row_graph.hpp>
#include <boost/graph/strong_components.hpp>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <protozero/pbf_reader.hpp>
#include <queue>

#include "core/util/error.h"
#include "core/wire/messages.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/geometry/geometry.h"
#include "env_service/geometry/plane.h"

namespace citylearn {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kOpposed = 45;               // degrees between a link's heading and that of its ends
constexpr double kOneSpot = 0.01;             // metres: nearer places have no direction from one to the other
constexpr std::size_t kMaxIdCharacters = 64;  // published ids have 22
constexpr std::size_t kMaxLine = 1024;        // characters of a line of a file
constexpr const char* kGraphKey = "panos_connectivity";

double turned(double degrees) {
  const double rest = std::fmod(degrees, 360);
  return rest < 0 ? std::fmod(rest + 360, 360) : rest;
}

/// Field numbers of streetlearn.proto.
namespace field {
enum Graph { kConnection = 3, kPano = 5 };
enum Part { kId = 1, kNeighbor = 3, kCoords = 9, kHeading = 13, kImage = 16 };  // of Pano and PanoConnection
enum Coords { kLatitude = 1, kLongitude = 2 };
}  // namespace field

/// Calls `use` with the number of each field of a message of StreetLearn, its text, else empty, and its double, else
/// NaN.
template <class Use>
void each_field(std::string_view message, const std::string& where, Use use) try {
  protozero::pbf_reader fields(message.data(), message.size());
  while (fields.next()) {
    if (fields.wire_type() == protozero::pbf_wire_type::length_delimited) {
      const protozero::data_view text = fields.get_view();
      use(fields.tag(), std::string_view(text.data(), text.size()), kNaN);
    } else if (fields.wire_type() == protozero::pbf_wire_type::fixed64) {
      use(fields.tag(), std::string_view(), fields.get_double());
    } else {
      fields.skip();
      use(fields.tag(), std::string_view(), kNaN);
    }
  }
} catch (const protozero::exception&) {
  throw Error("is not the message of StreetLearn, or one that was cut short", where, "copy it again");
}

std::string too_many_links(const std::string& place) {
  return "more than " + std::to_string(StreetMap::kMaxLinksOfPlace) + " links at " + place;
}

/// What may be wrong with places or links.
struct Finding {
  std::size_t count = 0;
  std::string first = {};
  void add(const std::string& name) {
    if (count++ == 0) first = name;
  }
};

/// A line of a text file.
struct GraphRow {
  int line = 0;
  std::vector<std::string_view> fields;
  double number(std::size_t column) const { return field_number(fields, column); }
};

/// Calls `use` for each row of a file, whose fields stand between commas. It returns what is wrong with the row, or an
/// empty text. Holds one line at a time, so that a file of any size takes no memory.
void each_row(const std::string& path, std::size_t columns, const char* otherwise,
              const std::function<std::string(const GraphRow&)>& use) {
  std::ifstream file(path);
  std::array<char, kMaxLine> text;
  GraphRow row;
  const auto require = [&](bool good, const std::string& fault) {
    if (!good) throw Error(fault, path + ":" + std::to_string(row.line));
  };
  while (++row.line, file.getline(text.data(), text.size()))
    each_line({text.data(), static_cast<std::size_t>(file.gcount()) - (file.eof() ? 0 : 1)},
              [&](std::string_view line, int) {
                if (line.empty() || line.front() == '#') return;
                row.fields.clear();
                for (std::size_t begin = 0, end = 0; end != line.npos; begin = end + 1)
                  row.fields.push_back(trimmed(line.substr(begin, (end = line.find(',', begin)) - begin)));
                require(row.fields.size() == columns, otherwise);
                const std::string fault = use(row);
                require(fault.empty(), fault);
              });
  require(file.eof(),
          file.gcount() > 0 ? "a line of more than " + std::to_string(kMaxLine - 1) + " characters" : "cannot be read");
}

StreetPlace place_of(std::string_view pano, const std::string& where) {
  StreetPlace place{"", 0, kNaN, kNaN};
  each_field(pano, where, [&](std::uint32_t part, std::string_view text, double number) {
    if (part == field::kId) place.id = text;
    if (part == field::kHeading) place.yaw = number;
    if (part != field::kCoords) return;
    each_field(text, where, [&](std::uint32_t coordinate, std::string_view, double degrees) {
      if (coordinate == field::kLatitude) place.latitude = degrees;
      if (coordinate == field::kLongitude) place.longitude = degrees;
    });
  });
  return place;
}

}  // namespace

std::string StreetGraph::add(StreetPlace place) {
  if (place.id.empty() || place.id.size() > kMaxIdCharacters) return "an id that has not 1 to 64 characters";
  if (!std::isfinite(place.yaw)) return "the heading of " + place.id + " is not a finite number";
  if (!(std::abs(place.latitude) <= 90) || !(std::abs(place.longitude) <= 180))
    return "the coordinates of " + place.id + " are not latitude and longitude in degrees";
  if (places_.size() == msg::MAX_FRAMES) return "more than " + std::to_string(msg::MAX_FRAMES) + " places";
  if (!index_.emplace(place.id, static_cast<int>(places_.size())).second)
    return "a second row for this id, " + place.id;
  place.yaw = turned(place.yaw);
  places_.push_back(std::move(place));
  return "";
}

std::string StreetGraph::add_link(int from, int to, int line, const double* heading) {
  StreetPlace& start = places_[static_cast<std::size_t>(from)];
  const StreetPlace& end = places_[static_cast<std::size_t>(to)];
  if (from == to) return start.id + " is linked with itself";
  if (start.links.size() == StreetMap::kMaxLinksOfPlace) return too_many_links(start.id);
  if (links_ == msg::MAX_FRAMES) return "more than " + std::to_string(msg::MAX_FRAMES) + " links";
  const double metres = metres_between(start.latitude, start.longitude, end.latitude, end.longitude);
  const double at = heading             ? *heading
                    : metres < kOneSpot ? start.yaw
                                        : heading_between(start.latitude, start.longitude, end.latitude, end.longitude);
  start.links.push_back({to, turned(at), metres, line});
  ++links_;
  return "";
}

StreetGraph StreetGraph::from_files(const std::string& nodes, const std::string& links) {
  StreetGraph graph;
  each_row(nodes, 4, "not a panorama's id, yaw, latitude and longitude", [&](const GraphRow& row) {
    return graph.add({std::string(row.fields[0]), row.number(1), row.number(2), row.number(3)});
  });
  each_row(links, 3, "not an id, a bearing and an id", [&](const GraphRow& row) {
    int ends[2];
    for (const std::size_t end : {0, 1}) {
      const std::string id(row.fields[2 * end]);
      ends[end] = graph.find(id);
      if (ends[end] < 0) return "id " + printable(id) + " is not in nodes.txt";
    }
    const double heading = row.number(1);
    if (!std::isfinite(heading)) return "'" + printable(row.fields[1]) + "' is not a heading in degrees";
    return graph.add_link(ends[0], ends[1], row.line, &heading);
  });
  if (graph.links_ == 0) throw Error("links no two panoramas", links);
  graph.where_ = links;
  return graph;
}

std::shared_ptr<const StreetGraph> StreetGraph::find_in(const std::string& folder) {
  const std::string nodes = first_file(folder, {"nodes.txt", "graph/nodes.txt"}),
                    links = first_file(folder, {"links.txt", "graph/links.txt"});
  return nodes.empty() || links.empty() ? nullptr : std::make_shared<const StreetGraph>(from_files(nodes, links));
}

StreetGraph StreetGraph::from_leveldb(const LevelDb& database) {
  const std::string where = below(database.folder(), kGraphKey);
  std::string message;
  if (!database.read(kGraphKey, message))
    throw Error(std::string("has no key ") + kGraphKey + ", the map of StreetLearn", database.folder());
  StreetGraph graph;
  const auto check = [&](const std::string& fault) {
    if (!fault.empty()) throw Error(fault, where);
  };
  each_field(message, where, [&](std::uint32_t part, std::string_view pano, double) {
    if (part == field::kPano) check(graph.add(place_of(pano, where)));
  });
  // Links refer to places, which may stand behind them.
  each_field(message, where, [&](std::uint32_t part, std::string_view connection, double) {
    if (part != field::kConnection) return;
    std::string id;
    std::vector<std::string_view> neighbors;
    each_field(connection, where, [&](std::uint32_t inner, std::string_view text, double) {
      if (inner == field::kId) id = text;
      if (inner == field::kNeighbor) neighbors.push_back(text);
      if (neighbors.size() > StreetMap::kMaxLinksOfPlace) check(too_many_links(printable(id)));
    });
    const int from = graph.find(id);
    if (from < 0) check("connects panorama " + printable(id) + ", which it does not describe");
    for (const std::string_view neighbor : neighbors) {
      const int to = graph.find(std::string(neighbor));
      if (to < 0) check("links " + id + " with panorama " + printable(neighbor) + ", which it does not describe");
      check(graph.add_link(from, to, static_cast<int>(graph.links_), nullptr));
    }
  });
  if (graph.links_ == 0) throw Error("links no two panoramas", where);
  graph.where_ = where;
  return graph;
}

StreetMap StreetGraph::map(std::vector<std::uint32_t>& rows) const {
  StreetMap map;
  std::vector<std::pair<int, const StreetLink*>> links;  // with the places that they leave
  const StreetPlace& first = places_.front();
  for (const StreetPlace& place : places_) {
    const double metres = metres_between(first.latitude, first.longitude, place.latitude, place.longitude);
    const double heading =
        metres > 0 ? kDegree * heading_between(first.latitude, first.longitude, place.latitude, place.longitude) : 0;
    map.east.push_back(static_cast<float>(metres * std::sin(heading)));
    map.north.push_back(static_cast<float>(metres * std::cos(heading)));
    for (const StreetLink& link : place.links) {
      const StreetPlace& end = places_[static_cast<std::size_t>(link.to)];
      if (end.links.empty())
        throw Error("leads to " + end.id + ", which no link leaves", position_of(link),
                    "add one, or leave out the place");
      links.emplace_back(static_cast<int>(&place - &first), &link);
    }
  }
  std::sort(links.begin(), links.end(), [](auto& a, auto& b) { return a.second->line < b.second->line; });
  for (const auto& [from, link] : links) {
    map.from.push_back(static_cast<std::uint32_t>(from));
    map.to.push_back(static_cast<std::uint32_t>(link->to));
    map.heading.push_back(static_cast<float>(link->heading));
  }
  rows = map.put_in_order();
  return map;
}

std::vector<bool> largest_strong_part(std::size_t places, const std::vector<std::pair<int, int>>& links) {
  using Graph = boost::compressed_sparse_row_graph<boost::directedS>;
  const Graph graph(boost::edges_are_unsorted_multi_pass, links.begin(), links.end(), places);
  std::vector<std::size_t> parts(places), sizes(places + 1);
  boost::strong_components(graph,
                           boost::make_iterator_property_map(parts.begin(), boost::get(boost::vertex_index, graph)));
  for (const std::size_t part : parts) ++sizes[part];
  const auto largest = static_cast<std::size_t>(std::max_element(sizes.begin(), sizes.end()) - sizes.begin());
  std::vector<bool> strong;
  for (const std::size_t part : parts) strong.push_back(part == largest);
  return strong;
}

std::string count_streets(std::size_t places, const std::vector<std::pair<int, int>>& links) {
  std::vector<std::set<int>> beside(places);
  const std::set<std::pair<int, int>> known(links.begin(), links.end());
  const auto both_ways = [&](int from, int to) { return known.contains({from, to}) && known.contains({to, from}); };
  for (const auto& [from, to] : links) {
    beside[static_cast<std::size_t>(from)].insert(to);
    beside[static_cast<std::size_t>(to)].insert(from);
  }
  int junctions = 0, dead_ends = 0, one_way = 0;
  for (std::size_t place = 0; place < places; ++place) {
    junctions += beside[place].size() > 2;
    dead_ends += beside[place].size() == 1 && both_ways(static_cast<int>(place), *beside[place].begin());
  }
  for (const auto& [from, to] : links) one_way += !both_ways(from, to);
  return fmt::format("streets: places {}, links {}, junctions {}, dead ends {}, one-way links {}", places, links.size(),
                     junctions, dead_ends, one_way);
}

std::vector<std::pair<int, int>> StreetGraph::ends(const std::function<bool(int line)>& use) const {
  std::vector<std::pair<int, int>> ends;
  for (std::size_t from = 0; from < places_.size(); ++from)
    for (const StreetLink& link : places_[from].links)
      if (use(link.line)) ends.emplace_back(static_cast<int>(from), link.to);
  return ends;
}

StreetGraph StreetGraph::strong_part(std::vector<bool>& kept) const {
  const std::vector<bool> strong =
      largest_strong_part(places_.size(), ends([&](int line) { return kept[static_cast<std::size_t>(line)]; }));
  StreetGraph part;
  part.where_ = where_;
  part.about_ = about_;
  std::vector<std::pair<int, const StreetLink*>> links(links_);  // with the places that they leave, by line
  std::vector<int> places(places_.size(), -1);                   // in the part
  for (std::size_t from = 0; from < places_.size(); ++from) {
    for (const StreetLink& link : places_[from].links)
      links[static_cast<std::size_t>(link.line)] = {static_cast<int>(from), &link};
    if (!strong[from]) continue;
    places[from] = static_cast<int>(part.places_.size());
    const StreetPlace& place = places_[from];
    part.add({place.id, place.yaw, place.latitude, place.longitude});
  }
  for (std::size_t line = 0; line < links_; ++line) {
    const auto& [from, link] = links[line];
    const int start = places[static_cast<std::size_t>(from)], end = places[static_cast<std::size_t>(link->to)];
    kept[line] = kept[line] && start >= 0 && end >= 0;
    if (kept[line]) part.add_link(start, end, static_cast<int>(part.links_), &link->heading);
  }
  return part;
}

std::vector<std::string> StreetGraph::description() const {
  Finding opposed, shared, apart;
  std::map<std::pair<long, long>, int> spots;  // places, by 1e-7 degrees, a centimetre
  const auto spot = [](const StreetPlace& place) {
    return std::pair(std::lround(place.latitude * 1e7), std::lround(place.longitude * 1e7));
  };
  for (const StreetPlace& place : places_) {
    ++spots[spot(place)];
    for (const StreetLink& link : place.links) {
      const StreetPlace& end = places_[static_cast<std::size_t>(link.to)];
      if (link.metres < kOneSpot) continue;
      const double off =
          turned(heading_between(place.latitude, place.longitude, end.latitude, end.longitude) - link.heading);
      if (std::min(off, 360 - off) > kOpposed) opposed.add(position_of(link));
    }
  }
  const std::vector<std::pair<int, int>> links = ends([](int) { return true; });
  const std::vector<bool> strong = largest_strong_part(places_.size(), links);
  for (std::size_t place = 0; place < places_.size(); ++place) {
    if (!strong[place]) apart.add(places_[place].id);
    if (spots[spot(places_[place])] > 1) shared.add(places_[place].id);
  }
  std::vector<std::string> lines{count_streets(places_.size(), links)};
  if (!about_.empty()) lines.insert(lines.begin(), about_);
  const auto say = [&](const Finding& finding, const char* what, const char* remedy) {
    if (finding.count > 0)
      lines.push_back(fmt::format("streets: {}: {}, the first {} ({})", what, finding.count, finding.first, remedy));
  };
  say(apart, "places that cannot be reached from the others, or not left for them", "add links, or leave them out");
  say(opposed, "links that head over 45 degrees off from the positions of their ends",
      "agents go by the headings: check those of long links");
  if (about_.empty())  // on bridges that is right
    say(shared, "places at the spot of another", "join them, or take --rule street: streetlearn goes by positions");
  return lines;
}

int StreetGraph::find(const std::string& id) const {
  const auto found = index_.find(id);
  return found == index_.end() ? -1 : found->second;
}

/// Returns the shortest paths from `start` (Dijkstra).
StreetGraph::Tree StreetGraph::shortest(int start) const {
  Tree tree{std::vector<double>(places_.size(), std::numeric_limits<double>::infinity()),
            std::vector<StreetStep>(places_.size(), StreetStep{-1, 0})};
  std::priority_queue<std::pair<double, int>, std::vector<std::pair<double, int>>, std::greater<>> open;
  tree.metres[static_cast<std::size_t>(start)] = 0;
  open.emplace(0, start);
  while (!open.empty()) {
    const auto [metres, place] = open.top();
    open.pop();
    if (metres > tree.metres[static_cast<std::size_t>(place)]) continue;
    for (const StreetLink& link : places_[static_cast<std::size_t>(place)].links) {
      double& best = tree.metres[static_cast<std::size_t>(link.to)];
      if (metres + link.metres >= best) continue;
      best = metres + link.metres;
      tree.before[static_cast<std::size_t>(link.to)] = {place, link.heading};
      open.emplace(best, link.to);
    }
  }
  return tree;
}

int StreetGraph::farthest(int start) const {
  const Tree tree = shortest(start);
  int best = start;
  for (std::size_t place = 0; place < places_.size(); ++place)
    if (std::isfinite(tree.metres[place]) && tree.metres[place] > tree.metres[static_cast<std::size_t>(best)])
      best = static_cast<int>(place);
  return best;
}

std::vector<StreetStep> StreetGraph::walk(const std::vector<int>& stops, const std::string& where) const {
  std::vector<StreetStep> steps;
  for (std::size_t leg = 0; leg + 1 < stops.size(); ++leg) {
    const Tree tree = shortest(stops[leg]);
    std::vector<StreetStep> back;
    for (int at = stops[leg + 1]; at != stops[leg];) {
      const StreetStep step = tree.before[static_cast<std::size_t>(at)];
      if (step.place < 0)
        throw Error("no way from " + places_[static_cast<std::size_t>(stops[leg])].id + " to " +
                        places_[static_cast<std::size_t>(stops[leg + 1])].id,
                    where);
      back.push_back(step);
      at = step.place;
    }
    steps.insert(steps.end(), back.rbegin(), back.rend());
  }
  if (!steps.empty()) steps.push_back({stops.back(), steps.back().heading});
  return steps;
}

std::string_view picture_of_panorama(std::string_view panorama, const std::string& where) {
  std::string_view picture;
  each_field(panorama, where, [&](std::uint32_t part, std::string_view text, double) {
    if (part == field::kImage) picture = text;
  });
  if (picture.empty()) throw Error("has no picture", where);
  if (!picture.starts_with("\xFF\xD8\xFF")) throw Error("has a picture that is not a JPEG", where);
  return picture;
}

}  // namespace citylearn
