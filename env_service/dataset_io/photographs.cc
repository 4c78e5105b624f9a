// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/photographs.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <map>

#include "core/files/image_header.h"
#include "core/util/types.h"
#include "env_service/files/times.h"
#include "env_service/images/heif.h"

namespace citylearn {
namespace {

constexpr std::size_t kFirstBytes = 4 << 10, kHeadBytes = 72 << 10;  // EXIF data of a JPEG take 64 KiB at most
constexpr double kZoneStep = 900;                                    // seconds; all zones are whole quarters of an hour
constexpr double kMaxStale = 2;       // seconds that a receiver's time may be behind: it comes once a second
constexpr double kMinClockError = 2;  // seconds worth mending

// Fields of EXIF data (CIPA DC-008).
constexpr unsigned kGpsLatitudeRef = 1, kGpsLatitude = 2, kGpsLongitudeRef = 3, kGpsLongitude = 4, kGpsTime = 7,
                   kGpsStatus = 9, kGpsDate = 0x1D;
struct TimeFields {
  unsigned time, fraction, zone;
};
constexpr TimeFields kTimes[] = {{0x9003, 0x9291, 0x9011}, {0x9004, 0x9292, 0x9012}};  // original, then digitized

Bytes first_bytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  Bytes bytes(kFirstBytes);
  std::size_t size = 0;
  const auto read = [&] {
    file.read(reinterpret_cast<char*>(bytes.data() + size), static_cast<std::streamsize>(bytes.size() - size));
    size += static_cast<std::size_t>(file.gcount());
  };
  read();
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), size);
  if (text.find("Exif") != text.npos || text.find("eXIf") != text.npos) {
    bytes.resize(kHeadBytes);
    read();
  }
  bytes.resize(size);
  return bytes;
}

double degrees(const Exif& exif, unsigned tag, unsigned hemisphere, char positive, char negative) {
  const std::vector<double> parts = exif.numbers(Exif::Directory::kGps, tag);
  const std::string text = exif.text(Exif::Directory::kGps, hemisphere);
  const int side = text.empty() ? 0 : std::toupper(static_cast<unsigned char>(text[0]));
  if (parts.empty() || (side != positive && side != negative)) return kUnknown;
  double value = 0, unit = 1;
  for (const double part : parts) {
    value += part * unit;
    unit /= 60;
  }
  return side == negative ? -value : value;
}

}  // namespace

Taken read_taken(const std::string& path) {
  using enum Exif::Directory;
  Taken taken{kUnknown, kUnknown, kUnknown, kUnknown, kUnknown};
  const Bytes head = first_bytes(path), inside = is_heif(head) ? heif_exif(path) : Bytes();
  const Exif exif = is_heif(head) ? Exif(inside) : exif_of(head, {});
  for (const TimeFields& fields : kTimes) {
    const Moment moment = read_moment(exif.text(kPhoto, fields.time));
    if (!std::isnan(taken.local) || std::isnan(moment.seconds)) continue;
    taken.local = moment.seconds;
    double unit = 0.1;
    for (const char digit : exif.text(kPhoto, fields.fraction)) {
      if (digit < '0' || digit > '9') break;
      taken.local += unit * (digit - '0');
      unit /= 10;
    }
    taken.zone = std::isnan(moment.zone) ? read_zone(exif.text(kPhoto, fields.zone)) : moment.zone;
  }
  const double day = read_moment(exif.text(kGps, kGpsDate)).seconds;
  if (const std::vector<double> clock = exif.numbers(kGps, kGpsTime); clock.size() == 3)
    taken.gps = day + 3600 * clock[0] + 60 * clock[1] + clock[2];
  if (exif.text(kGps, kGpsStatus).starts_with('V')) return taken;
  const double latitude = degrees(exif, kGpsLatitude, kGpsLatitudeRef, 'N', 'S'),
               longitude = degrees(exif, kGpsLongitude, kGpsLongitudeRef, 'E', 'W');
  if (std::abs(latitude) <= 90 && std::abs(longitude) <= 180) {
    taken.latitude = latitude;
    taken.longitude = longitude;
  }
  return taken;
}

std::vector<double> utc_of(const std::vector<Taken>& photographs, const std::string& where) {
  std::vector<double> zones, errors, result;
  std::map<double, int> counts;
  for (const Taken& taken : photographs) {
    const double zone = std::isnan(taken.zone) && std::abs(taken.local - taken.gps) < 15 * 3600
                            ? std::round((taken.local - taken.gps) / kZoneStep) * kZoneStep
                            : taken.zone;
    zones.push_back(zone);
    if (!std::isnan(zone)) ++counts[zone];
    if (const double error = taken.local - zone - taken.gps; !std::isnan(error)) errors.push_back(error);
  }
  const auto usual =
      std::max_element(counts.begin(), counts.end(), [](auto& a, auto& b) { return a.second < b.second; });
  std::sort(errors.begin(), errors.end());
  double ahead = 0;
  if (errors.size() > 1 && errors.back() - errors.front() <= kMaxStale && std::abs(errors.front()) >= kMinClockError) {
    ahead = std::floor(errors.front());
    spdlog::info("{}: the camera's clock is {} s ahead of GPS, which is taken off", where, ahead);
  }
  for (std::size_t i = 0; i < photographs.size(); ++i) {
    const double zone = !std::isnan(zones[i]) ? zones[i] : usual == counts.end() ? 0 : usual->first;
    const double utc = photographs[i].local - zone - ahead;
    result.push_back(std::isnan(utc) ? photographs[i].gps : utc);
  }
  if (const std::size_t strays = stray_times(result).size())
    spdlog::warn("{}: mend the dates of {} of {} pictures, hours from all others", where, strays, result.size());
  return result;
}

}  // namespace citylearn
