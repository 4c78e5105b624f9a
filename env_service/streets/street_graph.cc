// SPDX-License-Identifier: Apache-2.0
#include "env_service/streets/street_graph.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>

#include "core/util/error.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/geometry/geometry.h"
#include "env_service/streets/protobuf.h"

namespace citylearn {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kOneSpot = 0.01;             // metres: nearer places have no direction from one to the other
constexpr std::size_t kMaxIdCharacters = 64;  // published ids have 22
constexpr std::size_t kMaxPlaces = 1'048'576, kMaxLinks = 1'048'576, kMaxLinksOfPlace = 255;
constexpr const char* kGraphKey = "panos_connectivity";

double turned(double degrees) {
  const double rest = std::fmod(degrees, 360);
  return rest < 0 ? std::fmod(rest + 360, 360) : rest;
}

void require_whole(const ProtobufReader& reader, const std::string& where) {
  if (reader.damaged())
    throw Error("is not the message of StreetLearn, or one that was cut short", where, "copy it again");
}

/// Field numbers of streetlearn.proto.
namespace field {
enum Graph { kConnection = 3, kPano = 5 };
enum Part { kId = 1, kNeighbor = 3, kCoords = 9, kHeading = 13, kImage = 16 };  // of Pano and PanoConnection
enum Coords { kLatitude = 1, kLongitude = 2 };
}  // namespace field

std::string too_many_links(const std::string& place) {
  return "more than " + std::to_string(kMaxLinksOfPlace) + " links at " + place;
}

StreetPlace place_of(std::string_view pano, const std::string& where) {
  StreetPlace place{"", 0, kNaN, kNaN};
  ProtobufReader fields(pano);
  while (fields.next()) {
    if (fields.field() == field::kId) place.id = fields.text();
    if (fields.field() == field::kHeading) place.yaw = fields.number();
    if (fields.field() != field::kCoords) continue;
    ProtobufReader coords(fields.text());
    while (coords.next()) {
      if (coords.field() == field::kLatitude) place.latitude = coords.number();
      if (coords.field() == field::kLongitude) place.longitude = coords.number();
    }
    require_whole(coords, where);
  }
  require_whole(fields, where);
  return place;
}

}  // namespace

std::string StreetGraph::add(StreetPlace place) {
  if (place.id.empty() || place.id.size() > kMaxIdCharacters) return "an id that has not 1 to 64 characters";
  if (!std::isfinite(place.yaw)) return "the heading of " + place.id + " is not a finite number";
  if (!(std::abs(place.latitude) <= 90) || !(std::abs(place.longitude) <= 180))
    return "the coordinates of " + place.id + " are not latitude and longitude in degrees";
  if (places_.size() == kMaxPlaces) return "more than " + std::to_string(kMaxPlaces) + " places";
  if (!index_.emplace(place.id, static_cast<int>(places_.size())).second)
    return "a second row for this id, " + place.id;
  place.yaw = turned(place.yaw);
  places_.push_back(std::move(place));
  return "";
}

std::string StreetGraph::add_link(int from, int to, const double* heading) {
  StreetPlace& start = places_[static_cast<std::size_t>(from)];
  const StreetPlace& end = places_[static_cast<std::size_t>(to)];
  if (from == to) return start.id + " is linked with itself";
  if (start.links.size() == kMaxLinksOfPlace) return too_many_links(start.id);
  if (links_ == kMaxLinks) return "more than " + std::to_string(kMaxLinks) + " links";
  const double metres = metres_between(start.latitude, start.longitude, end.latitude, end.longitude);
  const double at = heading             ? *heading
                    : metres < kOneSpot ? start.yaw
                                        : heading_between(start.latitude, start.longitude, end.latitude, end.longitude);
  start.links.push_back({to, turned(at), metres});
  ++links_;
  return "";
}

StreetGraph StreetGraph::from_files(const std::string& nodes, const std::string& links) {
  StreetGraph graph;
  const TextTable node_table(nodes, {',', false});
  const auto check = [](const TextTable& table, int row, const std::string& fault) {
    if (!fault.empty()) table.fail(row, fault);
  };
  for (int row = 0; row < node_table.rows(); ++row) {
    if (node_table.columns(row) != 4) node_table.fail(row, "not a panorama's id, yaw, latitude and longitude");
    check(node_table, row,
          graph.add({std::string(node_table.text(row, 0)), node_table.number(row, 1), node_table.number(row, 2),
                     node_table.number(row, 3)}));
  }
  const TextTable link_table(links, {',', false});
  for (int row = 0; row < link_table.rows(); ++row) {
    if (link_table.columns(row) != 3) link_table.fail(row, "not an id, a bearing and an id");
    int ends[2];
    for (const int end : {0, 1}) {
      const std::string id(link_table.text(row, 2 * end));
      ends[end] = graph.find(id);
      if (ends[end] < 0) link_table.fail(row, "id " + printable(id) + " is not in nodes.txt");
    }
    const double heading = link_table.number(row, 1);
    check(link_table, row, graph.add_link(ends[0], ends[1], &heading));
  }
  if (graph.links_ == 0) throw Error("links no two panoramas", links);
  return graph;
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
  const auto each = [&](int wanted, auto&& use) {
    ProtobufReader fields(message);
    while (fields.next())
      if (fields.field() == wanted) use(fields.text());
    require_whole(fields, where);
  };
  each(field::kPano, [&](std::string_view pano) { check(graph.add(place_of(pano, where))); });
  // Links refer to places, which may stand behind them.
  each(field::kConnection, [&](std::string_view links) {
    std::string id;
    std::vector<std::string_view> neighbors;
    ProtobufReader connection(links);
    while (connection.next()) {
      if (connection.field() == field::kId) id = connection.text();
      if (connection.field() == field::kNeighbor) neighbors.push_back(connection.text());
      if (neighbors.size() > kMaxLinksOfPlace) check(too_many_links(printable(id)));
    }
    require_whole(connection, where);
    const int from = graph.find(id);
    if (from < 0) check("connects panorama " + printable(id) + ", which it does not describe");
    for (const std::string_view neighbor : neighbors) {
      const int to = graph.find(std::string(neighbor));
      if (to < 0) check("links " + id + " with panorama " + printable(neighbor) + ", which it does not describe");
      check(graph.add_link(from, to, nullptr));
    }
  });
  if (graph.links_ == 0) throw Error("links no two panoramas", where);
  return graph;
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
  ProtobufReader fields(panorama);
  while (fields.next())
    if (fields.field() == field::kImage) picture = fields.text();
  require_whole(fields, where);
  if (picture.empty()) throw Error("has no picture", where);
  if (!picture.starts_with("\xFF\xD8\xFF")) throw Error("has a picture that is not a JPEG", where);
  return picture;
}

}  // namespace citylearn
