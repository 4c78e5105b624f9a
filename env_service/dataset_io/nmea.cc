// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <tuple>

#include "core/util/text.h"
#include "env_service/dataset_io/tracks.h"
#include "env_service/files/text_table.h"
#include "env_service/files/times.h"

namespace citylearn {
namespace {

constexpr double kDay = 86400;  // seconds

/// The fields of a sentence: "$GPGGA", "120000.00" ...
using Fields = std::vector<std::string_view>;

/// Returns the fields of the sentence in a line, which may have something before it; none when its checksum is wrong.
std::optional<Fields> sentence(std::string_view line) {
  line.remove_prefix(std::min(line.find('$'), line.size()));
  const std::size_t star = std::min(line.rfind('*'), line.size());
  if (star < line.size()) {
    unsigned sum = 0, told = 256;
    for (const char c : line.substr(1, star - 1)) sum ^= static_cast<unsigned char>(c);
    std::from_chars(line.data() + star + 1, line.data() + line.size(), told, 16);
    if (sum != told) return std::nullopt;
  }
  return split(line.substr(0, star), ',');
}

/// hhmmss.sss in seconds of the day.
double time_of_day(const Fields& fields, std::size_t index) {
  const double value = field_number(fields, index);
  return std::floor(value / 10000) * 3600 + std::fmod(std::floor(value / 100), 100) * 60 + std::fmod(value, 100);
}

/// Returns dddmm.mmmm and a hemisphere in degrees; kUnknown for anything else, as degrees with decimals.
double degrees(const Fields& fields, std::size_t index) {
  const double value = field_number(fields, index), whole = std::floor(value / 100), minutes = value - 100 * whole;
  const std::string_view side = index + 1 < fields.size() ? fields[index + 1] : "";
  if (side.size() != 1 || std::string_view("NSEW").find(side) == side.npos) return kUnknown;
  if (fields[index].find_first_not_of("0123456789") < 4 || minutes >= 60) return kUnknown;
  return (side == "S" || side == "W" ? -1 : 1) * (whole + minutes / 60);
}

/// What one receiver says, by one kind of sentence.
struct Receiver {
  std::vector<TrackPoint> points;
  int fixes = 0;
  double worth = 0;  ///< the sum over fixes of quality, satellites and hdop
};

}  // namespace

std::vector<TrackPoint> read_nmea(std::string_view text, double near, int& broken) {
  std::map<std::string, Receiver> receivers;  // by kind and talker: "GGA GP"
  // Midnights on the clock that goes on over them, with how many sentences say when since 1970: some are late to change
  // the date, or begin with one of their own.
  std::map<double, std::map<double, int>> midnights;
  double clock = kUnknown;
  // The clock of all sentences, which goes on where the time of day begins anew.
  const auto at = [&](double time) {
    if (std::isnan(time)) return kUnknown;
    return clock = std::isnan(clock) ? time : clock + std::remainder(time - clock, kDay);
  };
  each_line(text, [&](std::string_view line, int) {
    const std::optional<Fields> found = sentence(line);
    if (!found) ++broken;
    if (!found || found->empty() || (*found)[0].size() != 6) return;
    const Fields& fields = *found;
    const std::string talker(fields[0].substr(1, 2)), kind(fields[0].substr(3));
    const bool gns = kind == "GNS";
    if (!gns && kind != "GGA" && kind != "RMC" && kind != "ZDA") return;
    const double time = at(time_of_day(fields, 1)), day = std::floor(time / kDay) * kDay;
    if (std::isnan(time)) return;
    const auto dated = [&](const std::string& iso) {
      if (const double now = read_moment(iso).seconds; !std::isnan(now)) ++midnights[day][now];
    };
    // GNS, else like GGA, has a letter for each system of satellites, N where that gives no fix.
    const double status =
        gns ? fields.size() > 6 && fields[6].find_first_not_of('N') != fields[6].npos : field_number(fields, 6);
    const bool rmc = kind == "RMC", fix = rmc ? fields.size() > 9 && fields[2] == "A" : status > 0;
    if (rmc && fix && fields[9].size() == 6) {
      const std::string date(fields[9]);  // ddmmyy
      dated((date[4] < '8' ? "20" : "19") + date.substr(4) + "-" + date.substr(2, 2) + "-" + date.substr(0, 2));
    }
    if (kind == "ZDA") {
      if (fields.size() > 4)
        dated(std::string(fields[4]) + "-" + std::string(fields[3]) + "-" + std::string(fields[2]));
      return;
    }
    Receiver& receiver = receivers[kind + " " + talker];
    TrackPoint point{time, kUnknown, kUnknown};
    if (fix) point.latitude = degrees(fields, rmc ? 3 : 2), point.longitude = degrees(fields, rmc ? 5 : 4);
    if (fix && !rmc) point.height = field_number(fields, 9);
    if (!std::isnan(point.latitude) && !std::isnan(point.longitude)) {
      ++receiver.fixes;
      const double satellites = field_number(fields, 7), hdop = field_number(fields, 8);
      // Quality 4, fixed RTK, is the best; 6 is reckoned without satellites, the worst.
      if (!rmc)
        receiver.worth += (status == 6   ? 0
                           : status == 4 ? 600
                                         : status * 100) +
                          (satellites > 0 ? satellites : 0) - (hdop > 0 ? hdop : 0);
    }
    receiver.points.push_back(point);
  });
  // Positions of GGA and GNS go first, as their quality is known; one receiver is kept to.
  const Receiver* best = nullptr;
  const auto rank = [](const Receiver& one) {
    return std::tuple(one.worth != 0, one.fixes > 0 ? one.worth / one.fixes : 0, one.fixes);
  };
  for (const auto& [name, receiver] : receivers)
    if (receiver.fixes > 0 && (!best || (2 * receiver.fixes > best->fixes && rank(receiver) > rank(*best)) ||
                               receiver.fixes > 2 * best->fixes))
      best = &receiver;
  if (!best && !receivers.empty()) best = &receivers.begin()->second;
  if (!best) return {};
  std::vector<TrackPoint> points = best->points;
  const double first = points[0].time;
  for (TrackPoint& point : points) {
    const auto nearest = std::min_element(midnights.begin(), midnights.end(), [&](auto& a, auto& b) {
      return std::abs(a.first - point.time) < std::abs(b.first - point.time);
    });
    if (nearest != midnights.end()) {
      const auto& told = nearest->second;
      const auto less = [](auto& a, auto& b) { return a.second < b.second; };
      point.time += std::max_element(told.begin(), told.end(), less)->first - nearest->first;
    } else {
      point.time += near - first + std::remainder(first - near, kDay);
    }
  }
  return points;
}

}  // namespace citylearn
