// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/tracks.h"

#include <spdlog/spdlog.h>
#include <tinyxml2.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "env_service/files/files.h"
#include "env_service/files/times.h"

namespace citylearn {
namespace {

using nlohmann::json;
using tinyxml2::XMLElement;
using Points = std::vector<TrackPoint>;

constexpr double kMaxPause = 10;        // seconds between segments over which places are still interpolated
constexpr std::size_t kMinDelayed = 8;  // times with one fraction of a second that show a delay

/// Reads a number up to one of `ends`, or the text's end: "48,2" is none.
double number(std::string_view text, std::string_view ends = " \t\r\n") {
  while (!text.empty() && (text.front() == ' ' || text.front() == '+')) text.remove_prefix(1);
  double value = 0;
  const char* const end = text.data() + text.size();
  const auto [after, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && (after == end || ends.find(*after) != ends.npos) ? value : kUnknown;
}

std::string_view local_name(const XMLElement& element) {
  const std::string_view name = element.Name();
  return name.substr(name.rfind(':') + 1);
}

std::string_view text_of(const XMLElement& element) { return element.GetText() ? element.GetText() : ""; }

const XMLElement* child(const XMLElement& parent, std::string_view name) {
  for (const XMLElement* at = parent.FirstChildElement(); at; at = at->NextSiblingElement())
    if (local_name(*at) == name) return at;
  return nullptr;
}

/// Calls `visit` for every element below `parent` with this name, in the order of the file.
void each_below(const XMLElement& parent, std::string_view name, const std::function<void(const XMLElement&)>& visit) {
  for (const XMLElement* at = parent.FirstChildElement(); at; at = at->NextSiblingElement()) {
    if (local_name(*at) == name) visit(*at);
    each_below(*at, name, visit);
  }
}

[[noreturn]] void fail_unequal(std::size_t times, std::size_t places, const std::string& path) {
  throw Error("has a track of " + std::to_string(times) + " times and " + std::to_string(places) + " places", path,
              "export it again");
}

double number_in(const XMLElement* element) { return element ? number(text_of(*element)) : kUnknown; }
double time_in(const XMLElement* element) { return element ? read_moment(text_of(*element)).utc() : kUnknown; }

/// GPX 1.0 and 1.1 (Topografix): points of tracks; waypoints and routes have not been driven.
Points read_gpx(const XMLElement& root) {
  Points points;
  each_below(root, "trkseg", [&](const XMLElement& segment) {
    bool begins = true;
    each_below(segment, "trkpt", [&](const XMLElement& point) {
      const XMLElement* const fix = child(point, "fix");
      const char *const latitude = fix && text_of(*fix) == "none" ? nullptr : point.Attribute("lat"),
                        *const longitude = point.Attribute("lon");
      points.push_back({time_in(child(point, "time")), latitude ? number(latitude) : kUnknown,
                        longitude ? number(longitude) : kUnknown, begins, number_in(child(point, "ele"))});
      begins = false;
    });
  });
  return points;
}

TrackPoint kml_point(double time, std::string_view text, char separator) {
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.front()))) text.remove_prefix(1);
  const std::size_t second = text.find(separator);
  if (second == text.npos) return {time, kUnknown, kUnknown};
  const std::string ends = std::string(" \t\r\n") + separator;
  const std::size_t third = text.find(separator, second + 1);
  return {time, number(text.substr(second + 1), ends), number(text, ends), false,
          third == text.npos ? kUnknown : number(text.substr(third + 1), ends)};
}

/// KML 2.2 and 2.3 (OGC): tracks, whose coordinates follow all their times, and points with a time each. A LineString
/// has no times.
Points read_kml(const XMLElement& root, const std::string& path) {
  Points points;
  each_below(root, "Track", [&](const XMLElement& track) {
    std::vector<double> times;
    std::size_t next = 0;
    each_below(track, "when", [&](const XMLElement& when) { times.push_back(time_in(&when)); });
    each_below(track, "coord", [&](const XMLElement& place) {
      points.push_back(kml_point(next < times.size() ? times[next] : kUnknown, text_of(place), ' '));
      points.back().begins = next++ == 0;
    });
    if (next != times.size()) fail_unequal(times.size(), next, path);
  });
  each_below(root, "Placemark", [&](const XMLElement& mark) {
    const XMLElement *when = child(mark, "TimeStamp"), *coordinates = child(mark, "Point");
    if (when) when = child(*when, "when");
    if (coordinates) coordinates = child(*coordinates, "coordinates");
    if (when && coordinates) points.push_back(kml_point(time_in(when), text_of(*coordinates), ','));
  });
  if (points.empty())
    each_below(root, "LineString", [&](const XMLElement&) { points.push_back({kUnknown, kUnknown, kUnknown}); });
  return points;
}

/// The time that a GeoJSON file tells: ISO 8601, or seconds since 1970, or thousandths, millionths or billionths.
double json_time(const json& value) {
  if (value.is_number()) {
    double time = value.get<double>();
    while (time > 1e11 && std::isfinite(time)) time /= 1000;
    return time;
  }
  return value.is_string() ? read_moment(value.get_ref<const std::string&>()).utc() : kUnknown;
}

TrackPoint json_point(double time, const json& place) {
  const bool known = place.is_array() && place.size() >= 2 && place[0].is_number() && place[1].is_number();
  const bool high = known && place.size() >= 3 && place[2].is_number();
  return {time, known ? place[1].get<double>() : kUnknown, known ? place[0].get<double>() : kUnknown, false,
          high ? place[2].get<double>() : kUnknown};
}

/// Adds the times of lists in lists, in their order.
void add_times(const json& times, std::vector<double>& all) {
  if (!times.is_array()) return all.push_back(json_time(times));
  for (const json& time : times) add_times(time, all);
}

/// Adds the places of a line, or of lines, which have a time each from `next` on.
void add_lines(const json& places, const std::vector<double>& times, std::size_t& next, Points& points) {
  for (const json& place : places)
    if (place.is_array() && !place.empty() && place[0].is_array()) {
      add_lines(place, times, next, points);
    } else {
      points.push_back(json_point(next < times.size() ? times[next] : kUnknown, place));
      points.back().begins = &place == &places[0];
      ++next;
    }
}

/// GeoJSON (RFC 7946), which has no place for times: programs put them into a feature's properties.
void read_geojson(const json& object, const json& properties, const std::string& path, Points& points) {
  if (!object.is_object()) return;
  const auto member = [](const json& of, const char* name) {
    return of.is_object() && of.contains(name) ? of[name] : json();
  };
  for (const json& feature : member(object, "features")) read_geojson(feature, json(), path, points);
  for (const json& geometry : member(object, "geometries")) read_geojson(geometry, properties, path, points);
  if (const json geometry = member(object, "geometry"); !geometry.is_null())
    read_geojson(geometry, member(object, "properties"), path, points);
  const json places = member(object, "coordinates"), inner = member(properties, "coordinateProperties");
  json times;
  for (const json* from : {&inner, &properties})
    for (const char* const name : {"times", "coordTimes", "timestamps", "time", "timestamp"})
      if (times.is_null()) times = member(*from, name);
  const json type = member(object, "type");
  if (type == "Point") points.push_back(json_point(json_time(times), places));
  if (type != "LineString" && type != "MultiLineString") return;
  std::vector<double> all;
  if (times.is_array()) add_times(times, all);
  std::size_t next = 0;
  add_lines(places, all, next, points);
  if (!all.empty() && all.size() != next) fail_unequal(all.size(), next, path);
}

/// Receivers measure at whole seconds. Where all times have the same fraction of one, up to a half, the log is late by
/// it, and is mended.
void undo_delay(Points& points, const std::string& path) {
  const auto fraction = [](double time) { return time - std::floor(time); };
  const double delay = fraction(points[0].time);
  if (points.size() < kMinDelayed || delay < 0.001 || delay > 0.5 ||
      !std::all_of(points.begin(), points.end(),
                   [&](auto& point) { return std::abs(fraction(point.time) - delay) < 0.001; }))
    return;
  for (TrackPoint& point : points) point.time -= delay;
  spdlog::info("{}: all its times are {:.3f} s behind whole seconds, when receivers measure; this is taken off", path,
               delay);
}

GpsRows rows_of(Points points, const std::string& path) {
  GpsRows rows;
  rows.log = path;
  const std::size_t all = points.size();
  std::erase_if(points, [](const TrackPoint& point) { return std::isnan(point.time); });
  if (points.empty())
    throw Error(all == 0 ? "holds no track" : "has places without times, so that nothing tells which frame was where",
                path, "export the track with its times, or move it away");
  erase_strays(points, [](const TrackPoint& point) { return point.time; });
  if (points.size() < all)
    spdlog::warn("{}: {} of {} points have no time or one far from the others", path, all - points.size(), all);
  undo_delay(points, path);
  points.front().begins = false;  // nothing comes before it
  std::stable_sort(points.begin(), points.end(), [](auto& a, auto& b) { return a.time < b.time; });
  double last = kUnknown;
  bool begins = false;
  for (const TrackPoint& point : points) {
    begins |= point.begins;
    if (std::isnan(point.latitude) || std::isnan(point.longitude)) {
      begins = true;  // where it was meanwhile is not known
      continue;
    }
    if (std::abs(point.latitude) > 90 || std::abs(point.longitude) > 180)
      throw Error(fmt::format("has a point at {}, {}: not a latitude and a longitude in degrees", point.latitude,
                              point.longitude),
                  path);
    if (begins && point.time - last > kMaxPause) rows.add((last + point.time) / 2, kUnknown, kUnknown);
    if (last == point.time) continue;  // the first of several at one time
    rows.add(point.time, point.latitude, point.longitude, point.height);
    last = point.time;
    begins = false;
  }
  if (rows.times.empty()) throw Error("has no fix", path, "move it away");
  return rows;
}

}  // namespace

const std::vector<std::string>& track_suffixes() {
  static const std::vector<std::string> suffixes{".gpx", ".nmea", ".kml", ".geojson"};
  return suffixes;
}

GpsRows read_track(const std::string& path, double near) {
  const std::string name = lower(path), text = read_file(path, kMaxTextBytes);
  if (name.ends_with(".nmea")) {
    int broken = 0;
    Points points = read_nmea(text, near, broken);
    if (broken > 0) spdlog::warn("{}: {} sentences are broken and left out", path, broken);
    return rows_of(std::move(points), path);
  }
  Points points;
  if (name.ends_with(".geojson")) {
    read_geojson(parse_json(text, path, "export it again"), json(), path, points);
    return rows_of(std::move(points), path);
  }
  tinyxml2::XMLDocument document;
  if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS || !document.RootElement())
    throw Error("is not XML: " + std::string(document.ErrorName()),
                path + ":" + std::to_string(document.ErrorLineNum()), "export it again, in UTF-8");
  const bool gpx = name.ends_with(".gpx");
  return rows_of(gpx ? read_gpx(*document.RootElement()) : read_kml(*document.RootElement(), path), path);
}

}  // namespace citylearn
